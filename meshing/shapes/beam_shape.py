"""The geometry of a beam with notches and holes, validated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from meshing.input_checks import length, number, shown
from meshing.shapes.features import CrackLine, Hole, VNotch, items_of, refuse_close

_CLEARANCE = 1e-3  # smallest distance between features, relative to the beam's height
_THINNEST_WALL = 0.02  # beside a hole, relative to its diameter


@dataclass(frozen=True)
class BeamShape:
    """What describes a beam; `meshing.Beam` adds the mesh.

    Attributes
    ----------
    length, height : float
        m.
    notches : sequence of VNotch
    holes : sequence of Hole
    """

    length: float
    height: float
    notches: Sequence[VNotch] = ()
    holes: Sequence[Hole] = ()
    cracks: Sequence[CrackLine] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", length("Beam", "length", self.length))
        object.__setattr__(self, "height", length("Beam", "height", self.height))
        object.__setattr__(self, "notches", items_of("Beam", "notches", self.notches, VNotch))
        object.__setattr__(self, "holes", items_of("Beam", "holes", self.holes, Hole))
        object.__setattr__(self, "cracks", items_of("Beam", "cracks", self.cracks, CrackLine))
        for i, notch in enumerate(self.notches, 1):
            self._check_notch(f"notch {i}", notch)
        for i, hole in enumerate(self.holes, 1):
            self._check_hole(f"hole {i}", hole)
        self._check_distances()

    def __repr__(self) -> str:
        parts = [f"length={self.length:g} m", f"height={self.height:g} m"]
        parts += [
            f"{name}={list(items)!r}"
            for name, items in (("notches", self.notches), ("holes", self.holes), ("cracks", self.cracks))
            if items
        ]
        return f"Beam({', '.join(parts)})"

    @property
    def area(self) -> float:
        """Area of the material, m2; cracks count as closed."""
        notches = sum(0.5 * notch.depth * (notch.right_offset - notch.left_offset) for notch in self.notches)
        return self.length * self.height - notches - sum(math.pi * hole.radius**2 for hole in self.holes)

    def triangle(self, notch: VNotch) -> np.ndarray:
        """Tip, mouth corner at the free-end side, mouth corner at the clamp side of a notch: (3, 2) array,
        m.
        """
        corners = np.array(
            [
                [notch.x, self.height - notch.depth],
                [notch.x + notch.right_offset, self.height],
                [notch.x + notch.left_offset, self.height],
            ]
        )
        if notch.edge == "bottom":
            corners[:, 1] = self.height - corners[:, 1]
        return corners

    def _check_notch(self, item: str, notch: VNotch) -> None:
        smallest = 0.01 * self.height
        if notch.depth >= self.height:
            raise ValueError(
                f"{item}: depth {notch.depth:g} m is not less than the beam's height {self.height:g} m; make "
                "the notch shallower."
            )
        if not smallest <= notch.depth <= self.height - smallest:
            raise ValueError(
                f"{item}: depth {notch.depth:g} m is within 1 % of 0 or of the beam's height {self.height:g} "
                "m; "
                "leave the notch out or cut the beam there."
            )
        if not 0 < notch.x < self.length:
            raise ValueError(
                f"{item}: its tip at x = {notch.x:g} m is outside the beam, 0 < x < {self.length:g} m (its "
                "length) was expected."
            )
        clearance = _CLEARANCE * self.height
        for corner in (notch.x, notch.x + notch.left_offset, notch.x + notch.right_offset):
            if not clearance <= corner <= self.length - clearance:
                raise ValueError(
                    f"{item}: its mouth reaches x = {corner:g} m, which is outside the top edge 0 to "
                    f"{self.length:g} m or too near its end; "
                    "move the notch, make it shallower or lessen its tilt or opening."
                )

    def _check_hole(self, item: str, hole: Hole) -> None:
        clearance = self._wall(hole) + hole.radius
        for name, value, extent in (("x", hole.x, self.length), ("y", hole.y, self.height)):
            if not clearance <= value <= extent - clearance:
                raise ValueError(
                    f"{item}: centre {name} = {value:g} m with diameter {hole.diameter:g} m leaves or "
                    "touches the domain or leaves too thin a wall, "
                    f"{name} between {clearance:g} and {extent - clearance:g} m was expected; move the hole "
                    "or make it smaller."
                )

    def _wall(self, hole: Hole) -> float:
        """Least thickness of the material beside a hole, m."""
        return max(_CLEARANCE * self.height, _THINNEST_WALL * hole.diameter)

    def crack_names(self) -> tuple[str, ...]:
        """Of the notches and the cracks in order."""
        first = len(self.notches) + 1
        names = [f"crack{i}" for i in range(1, first)]
        return (*names, *(crack.name or f"crack{i}" for i, crack in enumerate(self.cracks, first)))

    def _check_distances(self) -> None:
        names = self.crack_names()
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"Beam: two cracks have the name {name!r}; choose another.")
        areas = [_notch_polygon(self.triangle(notch)) for notch in self.notches]
        least = _CLEARANCE * self.height
        refuse_close("", [*zip(self.notches, areas)], self.holes, [self._wall(h) for h in self.holes], least)

    def check_point(self, name: str, point: object) -> tuple[float, float]:
        """A user's point as two floats, or the error that says why it cannot be a node."""
        if not isinstance(name, str) or not name:
            raise TypeError(f"points: the name {name!r} is not a non-empty string.")
        if isinstance(point, str) or not isinstance(point, Iterable) or len(pair := list(point)) != 2:
            raise TypeError(f"point {name!r} is {shown(point)}, a pair (x, y) was expected.")
        x, y = number(f"point {name!r}", "x", pair[0]), number(f"point {name!r}", "y", pair[1])
        if not (0 <= x <= self.length and 0 <= y <= self.height):
            raise ValueError(
                f"point {name!r} at ({x:g}, {y:g}) m is outside the beam, [0, {self.length:g}] x [0, "
                f"{self.height:g}] m; move it inside."
            )
        least = _CLEARANCE * self.height
        for i, hole in enumerate(self.holes, 1):
            if math.hypot(x - hole.x, y - hole.y) < hole.radius + least:
                raise ValueError(
                    f"point {name!r} at ({x:g}, {y:g}) m is in or on hole {i}; move it into the material."
                )
        for i, notch in enumerate(self.notches, 1):
            if _notch_polygon(self.triangle(notch)).distance(shapely.Point(x, y)) < least:
                raise ValueError(
                    f"point {name!r} at ({x:g}, {y:g}) m is in or on notch {i}; move it into the material (B "
                    "and C are its mouth corners)."
                )
        return x, y


def _notch_polygon(triangle: np.ndarray) -> shapely.Geometry:
    """A notch as an area, or a line if it is closed."""
    polygon = shapely.Polygon(triangle)
    return polygon if polygon.area > 0 and polygon.is_valid else shapely.LineString(triangle[:2])
