"""The geometry of a beam with notches and holes, validated."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from meshing.input_checks import number, positive
from meshing.shapes.features import Hole, VNotch

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
    notches: tuple[VNotch, ...] = ()
    holes: tuple[Hole, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", positive("Beam", "length", self.length))
        object.__setattr__(self, "height", positive("Beam", "height", self.height))
        object.__setattr__(self, "notches", _sequence("notches", self.notches, VNotch))
        object.__setattr__(self, "holes", _sequence("holes", self.holes, Hole))
        for i, notch in enumerate(self.notches, 1):
            self._check_notch(f"notch {i}", notch)
        for i, hole in enumerate(self.holes, 1):
            self._check_hole(f"hole {i}", hole)
        self._check_distances()

    def __repr__(self) -> str:
        parts = [f"length={self.length:g} m", f"height={self.height:g} m"]
        parts += [
            f"{name}={list(items)!r}"
            for name, items in (("notches", self.notches), ("holes", self.holes))
            if items
        ]
        return f"Beam({', '.join(parts)})"

    @property
    def area(self) -> float:
        """Area of the material, m2."""
        notches = sum(0.5 * notch.depth * (notch.right_offset - notch.left_offset) for notch in self.notches)
        return self.length * self.height - notches - sum(math.pi * hole.radius**2 for hole in self.holes)

    def triangle(self, notch: VNotch) -> np.ndarray:
        """Tip, mouth corner at the free-end side, mouth corner at the clamp side of a notch: (3, 2) array,
        m.
        """
        return np.array(
            [
                [notch.x, self.height - notch.depth],
                [notch.x + notch.right_offset, self.height],
                [notch.x + notch.left_offset, self.height],
            ]
        )

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
                f"{item}: its tip at x = {notch.x:g} m is outside the beam, 0 < x < {self.length:g} m was "
                "expected."
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

    def _check_distances(self) -> None:
        least = _CLEARANCE * self.height
        triangles = [self.triangle(notch) for notch in self.notches]
        for i in range(len(triangles)):
            for j in range(i + 1, len(triangles)):
                if _triangle_distance(triangles[i], triangles[j]) < least:
                    raise ValueError(
                        f"notches {i + 1} and {j + 1} overlap or touch ({self.notches[i]!r}, "
                        f"{self.notches[j]!r}); move them apart."
                    )
        for i, hole in enumerate(self.holes):
            for j, other in enumerate(self.holes[i + 1 :], i + 1):
                if math.hypot(hole.x - other.x, hole.y - other.y) - hole.radius - other.radius < max(
                    self._wall(hole), self._wall(other)
                ):
                    raise ValueError(
                        f"holes {i + 1} and {j + 1} overlap or touch ({hole!r}, {other!r}); move them apart."
                    )
            for j, triangle in enumerate(triangles):
                if _point_distance(np.array([hole.x, hole.y]), triangle) - hole.radius < self._wall(hole):
                    raise ValueError(
                        f"hole {i + 1} touches or cuts notch {j + 1} ({hole!r}, {self.notches[j]!r}); move "
                        "them apart."
                    )

    def check_point(self, name: str, point: object) -> tuple[float, float]:
        """A user's point as two floats, or the error that says why it cannot be a node."""
        if not isinstance(name, str) or not name:
            raise TypeError(f"points: the name {name!r} is not a non-empty string.")
        try:
            x, y = point  # type: ignore[misc]
        except (TypeError, ValueError):
            raise TypeError(f"point {name!r} is {point!r}, a pair (x, y) was expected.") from None
        x, y = number(f"point {name!r}", "x", x), number(f"point {name!r}", "y", y)
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
            if _point_distance(np.array([x, y]), self.triangle(notch)) < least:
                raise ValueError(
                    f"point {name!r} at ({x:g}, {y:g}) m is in or on notch {i}; move it into the material (B "
                    "and C are its mouth corners)."
                )
        return x, y


def _sequence(name: str, items: object, kind: type) -> tuple:
    if isinstance(items, kind) or not isinstance(items, Iterable):
        raise TypeError(f"Beam: {name} is {items!r}, a list of {kind.__name__} was expected.")
    result = tuple(items)
    for item in result:
        if not isinstance(item, kind):
            raise TypeError(f"Beam: {name} contains {item!r}, only {kind.__name__} was expected.")
    return result


def _cross(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _point_distance(point: np.ndarray, triangle: np.ndarray) -> float:
    """Distance of a point from a (possibly degenerate) triangle given counter-clockwise; 0 inside."""
    ends = np.roll(triangle, -1, axis=0)
    turns = [_cross(b - a, point - a) for a, b in zip(triangle, ends)]
    if _cross(triangle[1] - triangle[0], triangle[2] - triangle[0]) > 0 and min(turns) >= 0:
        return 0.0
    distances = []
    for a, b in zip(triangle, ends):
        squared = float((b - a) @ (b - a))
        t = min(max(float((point - a) @ (b - a)) / squared, 0.0), 1.0) if squared else 0.0
        distances.append(float(np.hypot(*(point - a - t * (b - a)))))
    return min(distances)


def _triangle_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Distance of two triangles; 0 where they overlap."""
    for a, b in zip(first, np.roll(first, -1, axis=0)):
        for c, d in zip(second, np.roll(second, -1, axis=0)):
            if (
                _cross(b - a, c - a) * _cross(b - a, d - a) < 0
                and _cross(d - c, a - c) * _cross(d - c, b - c) < 0
            ):
                return 0.0
    return min([_point_distance(p, second) for p in first] + [_point_distance(p, first) for p in second])
