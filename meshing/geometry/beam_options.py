"""The arguments of `Beam.mesh`, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from meshing.input_checks import (
    checked_faces,
    checked_order,
    choice,
    length,
    named_points,
    number,
    shown,
)
from meshing.shapes.beam_shape import BeamShape

_CORNER_SIZE = 0.2  # default size of the innermost cell at a graded corner, relative to the beam's height

Point = tuple[float, float]


@dataclass(frozen=True)
class BeamOptions:
    """The arguments of `Beam.mesh`, checked; sizes in m."""

    order: int
    size: float
    tip_size: float | None
    grading: float
    layout: str
    points: dict[str, Point]
    corner_size: float
    corner_size_given: bool
    corners: tuple[str, ...]
    face_size: float | None
    face_edges: int

    @classmethod
    def checked(cls, beam: BeamShape, given: Mapping[str, Any]) -> BeamOptions:
        """Check arguments of `Beam.mesh`, by their names, and fill in the defaults."""
        size, tip_size, corner_size, corners = (
            given[name] for name in ("size", "tip_size", "corner_size", "corners")
        )
        order = checked_order(given.get("order", 5))
        least = 1e-6 * beam.height
        # cells longer than the beam are no other cells
        size = 2.5 * beam.height if size is None else min(length("mesh", "size", size), 4.0 * beam.length)
        if not 0.02 * beam.height <= size:
            raise ValueError(
                f"mesh: size {size:g} m is below 2 % of the beam's height {beam.height:g} m; high orders on "
                "larger cells cost less."
            )
        if tip_size is not None and length("mesh", "tip_size", tip_size) < least:
            raise ValueError(
                f"mesh: tip_size {tip_size:g} m is below 1e-6 of the beam's height {beam.height:g} m, "
                "round-off would show; make it larger."
            )
        layout = choice("mesh", "layout", given.get("layout", "tip"), ("tip", "vertex"))
        for i, notch in enumerate(beam.notches, 1):
            room = min(notch.depth, beam.height - notch.depth)
            if tip_size is not None and tip_size >= room:
                raise ValueError(
                    f"mesh: tip_size {tip_size:g} m does not fit around the tip of notch {i}, {room:g} m "
                    "from an edge; make it smaller."
                )
        grading = number("mesh", "grading", given["grading"])
        if not 1.1 <= grading <= 10:
            raise ValueError(f"mesh: grading is {grading:g}, a ratio from 1.1 to 10 was expected.")
        if (
            corner_size is not None
            and not least <= length("mesh", "corner_size", corner_size) < 0.5 * beam.height
        ):
            raise ValueError(
                f"mesh: corner_size {corner_size:g} m must be between {least:g} m and half the beam's "
                f"height, {beam.height / 2:g} m."
            )
        if not isinstance(corners, (str, list, tuple, set, frozenset)):
            raise TypeError(
                f'mesh: corners is {shown(corners)}, a sequence of "left" and "right" was expected.'
            )
        corners = (corners,) if isinstance(corners, str) else tuple(corners)
        for name in corners:
            choice("mesh", "corners", name, ("left", "right"))
        if corner_size is not None and not corners:
            raise ValueError(f"mesh: corner_size {corner_size:g} m has no corners to be used at; name some.")
        reserved = {"A"} | {
            f"{letter}{i if i > 1 else ''}" for letter in "BC" for i in range(1, len(beam.notches) + 1)
        }
        named = {}
        for name, point in named_points(given["points"]).items():
            if name in reserved:
                raise ValueError(f"point {name!r}: this name is the mesh's own; choose another.")
            named[name] = beam.check_point(name, point)
        wanted = corner_size is not None
        # The paper's layout is there for comparison: nothing in it is graded unless asked for.
        corners = corners if wanted or layout == "tip" else ()
        corner_size = float(corner_size) if corner_size is not None else _CORNER_SIZE * beam.height
        return cls(
            order,
            size,
            None if tip_size is None else float(tip_size),
            grading,
            layout,
            named,
            corner_size,
            wanted,
            corners,
            *checked_faces(beam.height, given.get("face_size"), given.get("face_edges", 12)),
        )
