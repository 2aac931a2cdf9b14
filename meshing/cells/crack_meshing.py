"""How cracks are meshed: the user's choices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from meshing.input_checks import checked_faces, length, number


@dataclass(frozen=True)
class CrackMeshing:
    """How cracks are meshed.

    Attributes
    ----------
    tip_element : bool
        Rings around each tip with an open cell in their middle.
    tip_size : float or None
        Half-size of that cell, m; None: 0.02 of the crack's length, or
        0.03 of the reach of the cells around the tip if that is less.
    grading : float
        Largest ratio of neighbouring rings.
    face_size : float or None
        Longest edge on the faces, m; None: `face_edges` of them along the crack.
    face_edges : int
    sectors : bool
        No rings around tips but closed cells that meet in the tip.
    tip_sizes : mapping of int to float
        Largest distance of the open cell's boundary from the tip at some vertices, in the place of
        `tip_size`, m.
    """

    tip_element: bool = True
    tip_size: float | None = None
    grading: float = 2.5
    face_size: float | None = None
    face_edges: int = 12
    sectors: bool = False
    tip_sizes: Mapping[int, float] = field(default_factory=dict)

    @classmethod
    def checked(
        cls,
        extent: float,
        tip_element: bool,
        tip_size: float | None,
        grading: float,
        face_size: float | None,
        face_edges: int,
    ) -> CrackMeshing:
        """The arguments that say how cracks are meshed, checked; `extent` is the body's size, m."""
        tip_size = None if tip_size is None else length("mesh", "tip_size", tip_size)
        if tip_size is not None and tip_size < 1e-7 * extent:
            raise ValueError(
                f"mesh: tip_size {tip_size:g} m is below 1e-7 of the body's size {extent:g} m, round-off "
                "would show; make it larger."
            )
        grading = number("mesh", "grading", grading)
        if not 1.1 <= grading <= 10:
            raise ValueError(f"mesh: grading is {grading:g}, a ratio from 1.1 to 10 was expected.")
        return cls(tip_element, tip_size, grading, *checked_faces(extent, face_size, face_edges))
