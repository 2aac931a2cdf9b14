"""The geometry of a beam with notches and holes, validated."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from meshing.input_checks import check_fields, length, said
from meshing.shapes.features import NEAR, CrackLine, Hole, VNotch, described, lists_of, point_of, refuse_close


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

    length: float = field(metadata=said("length", "m", gt=0))
    height: float = field(metadata=said("height", "m", gt=0))
    notches: Sequence[VNotch] = field(default=(), metadata=said("notches and straight cracks"))
    holes: Sequence[Hole] = field(default=(), metadata=said("holes"))
    cracks: Sequence[CrackLine] = field(default=(), kw_only=True, metadata=said("cracks of any path"))

    def __post_init__(self) -> None:
        lists = lists_of(notches=VNotch, holes=Hole, cracks=CrackLine)
        check_fields(self, "Beam", {"length": length, "height": length, **lists})
        for i, notch in enumerate(self.notches, 1):
            self._check_notch(f"notch {i}", notch)
        for i, hole in enumerate(self.holes, 1):
            self._check_hole(f"hole {i}", hole)
        self._check_distances()

    def __repr__(self) -> str:
        size = f"length={self.length:g} m, height={self.height:g} m"
        return f"Beam({size}{described(notches=self.notches, holes=self.holes, cracks=self.cracks)})"

    @property
    def area(self) -> float:
        """Area of the material, m2; cracks count as closed."""
        notches = sum(0.5 * notch.depth * (notch.right_offset - notch.left_offset) for notch in self.notches)
        return self.length * self.height - notches - sum(math.pi * hole.radius**2 for hole in self.holes)

    def triangle(self, notch: VNotch) -> np.ndarray:
        """Tip, mouth corner at the free-end side, mouth corner at the clamp side of a notch: (3, 2) array,
        m.
        """
        x = notch.x + np.array([0.0, notch.right_offset, notch.left_offset])
        y = np.array([self.height - notch.depth, self.height, self.height])
        return np.stack([x, self.height - y if notch.edge == "bottom" else y], axis=1)

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
                "m; leave the notch out or cut the beam there."
            )
        if not 0 < notch.x < self.length:
            raise ValueError(
                f"{item}: its tip at x = {notch.x:g} m is outside the beam, 0 < x < {self.length:g} m (its "
                "length) was expected."
            )
        clearance = NEAR * self.height
        for corner in (notch.x, notch.x + notch.left_offset, notch.x + notch.right_offset):
            if not clearance <= corner <= self.length - clearance:
                raise ValueError(
                    f"{item}: its mouth reaches x = {corner:g} m, which is outside the top edge 0 to "
                    f"{self.length:g} m or too near its end; move the notch, make it shallower or lessen its "
                    "tilt or opening."
                )

    def _check_hole(self, item: str, hole: Hole) -> None:
        clearance = hole.wall(self.height) + hole.radius
        for name, value, extent in (("x", hole.x, self.length), ("y", hole.y, self.height)):
            if not clearance <= value <= extent - clearance:
                raise ValueError(
                    f"{item}: centre {name} = {value:g} m with diameter {hole.diameter:g} m leaves or "
                    f"touches the domain or leaves too thin a wall, {name} between {clearance:g} and "
                    f"{extent - clearance:g} m was expected; move the hole or make it smaller."
                )

    def crack_names(self) -> tuple[str, ...]:
        """Of the notches and the cracks in order."""
        first = len(self.notches) + 1
        names = [f"crack{i}" for i in range(1, first)]
        return (*names, *(crack.name or f"crack{i}" for i, crack in enumerate(self.cracks, first)))

    def _check_distances(self) -> None:
        for name, count in Counter(self.crack_names()).items():
            if count > 1:
                raise ValueError(f"Beam: two cracks have the name {name!r}; choose another.")
        areas = [_notch_polygon(self.triangle(notch)) for notch in self.notches]
        refuse_close("", [*zip(self.notches, areas)], self.holes, self.height)

    def check_point(self, name: str, point: object) -> tuple[float, float]:
        """A user's point as two floats, or the error that says why it cannot be a node."""
        x, y = point_of(f"point {name!r}", point)
        where = f"point {name!r} at ({x:g}, {y:g}) m is"
        if not (0 <= x <= self.length and 0 <= y <= self.height):
            raise ValueError(
                f"{where} outside the beam, [0, {self.length:g}] x [0, {self.height:g}] m; move it inside."
            )
        gaps = {f"hole {i}": math.dist((x, y), (h.x, h.y)) - h.radius for i, h in enumerate(self.holes, 1)}
        for i, notch in enumerate(self.notches, 1):
            area = _notch_polygon(self.triangle(notch))
            gaps[f"notch {i} (B and C are its mouth corners)"] = area.distance(shapely.Point(x, y))
        for crack, line in zip(self.crack_names()[len(self.notches) :], self.cracks):
            words = f"crack {crack!r} (a mouth's corners are {crack}_right and {crack}_left)"
            gaps[words] = shapely.LineString(line.points).distance(shapely.Point(x, y))
        for item, gap in gaps.items():
            if gap < NEAR * self.height:
                raise ValueError(f"{where} in or on {item}; move it into the material.")
        return x, y


def _notch_polygon(triangle: np.ndarray) -> shapely.Geometry:
    """A notch as an area, or a line if it is closed."""
    polygon = shapely.Polygon(triangle)
    return polygon if polygon.area > 0 and polygon.is_valid else shapely.LineString(triangle[:2])
