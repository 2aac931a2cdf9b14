"""The arguments of `Beam.mesh`, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from meshing.cells.complex import Point
from meshing.cells.crack_splitting import CrackMeshing
from meshing.input_checks import checked_order, choice, length, named_points, shown
from meshing.shapes.beam_shape import BeamShape

_CORNER_SIZE = 0.2  # default size of the innermost cell at a graded corner, relative to the beam's height
_LEAST = 1e-6  # size of a cell, relative to the beam's height


@dataclass(frozen=True)
class BeamOptions:
    """The arguments of `Beam.mesh`, checked; sizes in m."""

    order: int
    size: float
    cracks: CrackMeshing
    points: dict[str, Point]
    corner_size: float
    corner_size_given: bool
    corners: tuple[str, ...]

    @classmethod
    def checked(cls, beam: BeamShape, given: Mapping[str, Any]) -> BeamOptions:
        """Check arguments of `Beam.mesh`, by their names, and fill in the defaults."""
        order = checked_order(given.get("order", 5))
        size = _checked_size(beam, given["size"])
        layout = choice("mesh", "layout", given.get("layout", "tip"), ("tip", "vertex"))
        cracks = CrackMeshing.checked(beam.height, given, layout == "vertex", _LEAST)
        _check_tip_size(beam, cracks.tip_size)
        wanted, corners = given["corner_size"] is not None, _checked_corners(given["corners"])
        corner_size = _CORNER_SIZE * beam.height
        if wanted:
            corner_size = length("mesh", "corner_size", given["corner_size"])
        elif layout == "vertex":  # the paper's, for comparison: nothing in it is graded unless asked for
            corners = ()
        if wanted and not _LEAST * beam.height <= corner_size < 0.5 * beam.height:
            raise ValueError(
                f"mesh: corner_size {corner_size:g} m must be between {_LEAST * beam.height:g} m and half "
                f"the beam's height, {beam.height / 2:g} m."
            )
        if wanted and not corners:
            raise ValueError(f"mesh: corner_size {corner_size:g} m has no corners to be used at; name some.")
        points = _checked_points(beam, given["points"])
        return cls(order, size, cracks, points, corner_size, wanted, corners)


def _checked_size(beam: BeamShape, size: Any) -> float:
    # cells longer than the beam are no other cells
    size = 2.5 * beam.height if size is None else min(length("mesh", "size", size), 4.0 * beam.length)
    if not 0.02 * beam.height <= size:
        raise ValueError(
            f"mesh: size {size:g} m is below 2 % of the beam's height {beam.height:g} m; high orders on "
            "larger cells cost less."
        )
    return size


def _check_tip_size(beam: BeamShape, tip_size: float | None) -> None:
    for i, notch in enumerate(beam.notches, 1):
        room = min(notch.depth, beam.height - notch.depth)
        if tip_size is not None and tip_size >= room:
            raise ValueError(
                f"mesh: tip_size {tip_size:g} m does not fit around the tip of notch {i}, {room:g} m from an "
                "edge; make it smaller."
            )


def _checked_corners(corners: Any) -> tuple[str, ...]:
    if not isinstance(corners, (str, list, tuple, set, frozenset)):
        raise TypeError(f'mesh: corners is {shown(corners)}, a sequence of "left" and "right" was expected.')
    names = (corners,) if isinstance(corners, str) else tuple(corners)
    return tuple(choice("mesh", "corners", name, ("left", "right")) for name in names)


def _checked_points(beam: BeamShape, points: Any) -> dict[str, Point]:
    numbers = ["", *range(2, len(beam.notches) + 1)][: len(beam.notches)]
    reserved = {"A"} | {f"{letter}{number}" for letter in "BC" for number in numbers}
    named = {}
    for name, point in named_points(points).items():
        if name in reserved:
            raise ValueError(f"point {name!r}: this name is the mesh's own; choose another.")
        named[name] = beam.check_point(name, point)
    return named
