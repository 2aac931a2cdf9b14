"""What a person describes: a beam, its V-notches and holes, validated; SI units, angles in degrees."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from meshing.boundary_mesh import BoundaryMesh
from meshing.input_checks import number, positive

_STEEPEST = 85.0  # degrees between a face and the vertical
_CLEARANCE = 1e-3  # smallest distance between features, relative to the beam's height
_THINNEST_WALL = 0.02  # beside a hole, relative to its diameter


@dataclass(frozen=True)
class VNotch:
    """A V-notch or crack that runs from a tip in the beam to its top edge.

    Attributes
    ----------
    x : float
        Position of the tip along the beam, m.
    depth : float
        Vertical distance of the tip from the top edge, m.
    opening : float
        Total angle between the faces, degrees; 0 is a closed crack.
    tilt : float
        Angle of the axis from the vertical, degrees, positive with the mouth towards the free end (+x).
    """

    x: float
    depth: float
    opening: float
    tilt: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", number("VNotch", "x", self.x))
        object.__setattr__(self, "depth", positive("VNotch", "depth", self.depth))
        object.__setattr__(self, "opening", number("VNotch", "opening", self.opening))
        object.__setattr__(self, "tilt", number("VNotch", "tilt", self.tilt))
        if self.opening < 0:
            raise ValueError(
                f"VNotch: opening is {self.opening:g} degrees, it must be 0 (closed crack) or positive."
            )
        if abs(self.tilt) + self.opening / 2 > _STEEPEST:
            raise ValueError(
                f"VNotch: with opening {self.opening:g} and tilt {self.tilt:g} degrees a face leans "
                f"{abs(self.tilt) + self.opening / 2:g} degrees "
                f"from the vertical; |tilt| + opening / 2 must be at most {_STEEPEST:g} for the faces to "
                "reach the top edge."
            )

    def __repr__(self) -> str:
        return (
            f"VNotch(x={self.x:g} m, depth={self.depth:g} m, opening={self.opening:g} deg, "
            f"tilt={self.tilt:g} deg)"
        )

    @property
    def right_offset(self) -> float:
        """x of the mouth corner at the free-end side minus x of the tip, m."""
        return self.depth * math.tan(math.radians(self.tilt + self.opening / 2))

    @property
    def left_offset(self) -> float:
        """x of the mouth corner at the clamp side minus x of the tip, m."""
        return self.depth * math.tan(math.radians(self.tilt - self.opening / 2))

    @property
    def axis(self) -> tuple[float, float]:
        """Unit vector from the tip along the axis to the mouth."""
        return math.sin(math.radians(self.tilt)), math.cos(math.radians(self.tilt))

    @property
    def length(self) -> float:
        """Distance from the tip to the mouth along the axis, m."""
        return self.depth / math.cos(math.radians(self.tilt))


@dataclass(frozen=True)
class Hole:
    """A circular hole.

    Attributes
    ----------
    x, y : float
        Centre, m; y from the lower edge.
    diameter : float
        m.
    """

    x: float
    y: float
    diameter: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", number("Hole", "x", self.x))
        object.__setattr__(self, "y", number("Hole", "y", self.y))
        object.__setattr__(self, "diameter", positive("Hole", "diameter", self.diameter))

    def __repr__(self) -> str:
        return f"Hole(x={self.x:g} m, y={self.y:g} m, diameter={self.diameter:g} m)"

    @property
    def radius(self) -> float:
        """m."""
        return self.diameter / 2


@dataclass(frozen=True)
class Beam:
    """A beam [0, length] x [0, height], clamped end at x = 0, with notches from its top edge and holes.

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

    def mesh(
        self,
        order: int = 5,
        size: float | None = None,
        tip_size: float | None = None,
        grading: float = 2.5,
        layout: str = "tip",
        points: Mapping[str, tuple[float, float]] | None = None,
        corner_size: float | None = None,
        corners: Iterable[str] = ("left",),
    ) -> BoundaryMesh:
        """Divide the beam into S-elements.

        Plain parts become equal rectangles. Around each notch tip stand a small open S-element with its
        scaling centre on the tip and rings that are scaled copies of each other; around each hole a ring of
        curved cells. Parts where notches or holes are too close to each other for that are filled by gmsh.

        Parameters
        ----------
        order : int
            Polynomial order of the edges, 1 to 20.
        size : float, optional
            Length of the cells along the beam, m; below the height there are several rows. Default: 2.5 times
            the height.
        tip_size : float, optional
            Half-size of the S-element on a notch's tip (its largest extent from the tip), m. Default: 0.02 of
            the notch's depth.
        grading : float
            Largest size ratio of neighbouring rings, 1.1 to 10.
        layout : {"tip", "vertex"}
            "tip": scaling centre on the tip. "vertex": the paper's Fig. 2, the tip is a vertex of four closed
            S-elements whose edges are graded down to `tip_size`.
        points : dict of str to (x, y), optional
            Further named points, m; each becomes a node.
        corner_size : float, optional
            Size of the innermost cell where the edges are graded towards the corners of the end edges in
            `corners`, m: a clamped corner is singular. Default: 0.2 of the height where there is room, no
            grading in the "vertex" layout.
        corners : sequence of {"left", "right"}
            End edges whose two corners are graded; () for none.

        Returns
        -------
        BoundaryMesh
            Edge sets "left", "right", "top", "bottom", "hole1" ..., "crack1_left", "crack1_right" ...; points
            "A" (top corner of the free end), "B" and "C" (mouth corners of the first notch, free-end and
            clamp side), "B2", "C2" of the second ..., and the user's.

        Raises
        ------
        ValueError, TypeError
            One sentence that names the input, its value and what was expected.
        """
        # Here, because the modules that mesh a beam know its shapes.
        from meshing.beam_cells import beam_cells
        from meshing.beam_layout import MeshInputs
        from meshing.polygons import build_mesh

        inputs = MeshInputs.checked(
            self, order, size, tip_size, grading, layout, points, corner_size, corners
        )
        return build_mesh(beam_cells(self, inputs), inputs.order, origin="beam")


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
