"""Notches and holes as a person describes them, validated; SI units, angles in degrees."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import shapely

from meshing.input_checks import check_fields, choice, length, number, said, shown

THIN = 1e-6  # width of a mouth, relative to the height, up to which its corners are one place
_STEEPEST = 85.0  # degrees between a face and the vertical
WIDEST_OPENING = 30.0  # degrees, of a crack
NEAR = 1e-3  # distance of features that are too near to each other, relative to the body's size
_THINNEST_WALL = 0.02  # beside a hole, relative to its diameter


@dataclass(frozen=True)
class VNotch:
    """A V-notch or crack that runs from a tip in the beam to its top or bottom edge.

    Attributes
    ----------
    x : float
        Position of the tip along the beam, m.
    depth : float
        Vertical distance of the tip from that edge, m.
    opening : float
        Total angle between the faces, degrees; 0 is a closed crack.
    tilt : float
        Angle of the axis from the vertical, degrees, positive with the mouth towards the free end (+x).
    edge : {"top", "bottom"}
        Where its mouth is.
    """

    x: float = field(metadata=said("position of the tip along the beam", "m"))
    depth: float = field(metadata=said("vertical distance of the tip from the edge", "m", gt=0))
    opening: float = field(
        metadata=said("total angle between the faces; 0 is a closed crack", "degree", ge=0)
    )
    tilt: float = field(
        default=0.0,
        metadata=said("angle of the axis from the vertical, positive with the mouth towards +x", "degree"),
    )
    edge: str = field(
        default="top", kw_only=True, metadata=said("edge that it starts from", one_of=("top", "bottom"))
    )

    def __post_init__(self) -> None:
        check_fields(self, "VNotch", {"x": number, "depth": length, "opening": number, "tilt": number})
        choice("VNotch", "edge", self.edge, ("top", "bottom"))
        if self.opening < 0:
            raise ValueError(
                f"VNotch: opening is {self.opening:g} degrees, it must be 0 (closed crack) or positive."
            )
        steepest = abs(self.tilt) + self.opening / 2
        if steepest > _STEEPEST:
            raise ValueError(
                f"VNotch: with opening {self.opening:g} and tilt {self.tilt:g} degrees a face leans "
                f"{steepest:g} degrees from the vertical; |tilt| + opening / 2 must be at most {_STEEPEST:g} "
                "for the faces to reach the edge."
            )

    def __repr__(self) -> str:
        return (
            f"VNotch(x={self.x:g} m, depth={self.depth:g} m, opening={self.opening:g} deg, "
            f"tilt={self.tilt:g} deg{', bottom' if self.edge == 'bottom' else ''})"
        )

    @property
    def right_offset(self) -> float:
        """x of the mouth corner at the free-end side minus x of the tip, m."""
        return self.depth * math.tan(math.radians(self.tilt + self.opening / 2))

    @property
    def left_offset(self) -> float:
        """x of the mouth corner at the clamp side minus x of the tip, m."""
        return self.depth * math.tan(math.radians(self.tilt - self.opening / 2))

    def is_thin(self, height: float) -> bool:
        """Whether its mouth is one place in the drawing of a beam: it is drawn closed, and then opened."""
        return self.right_offset - self.left_offset <= THIN * height

    @property
    def axis(self) -> tuple[float, float]:
        """Unit vector from the tip along the axis to the mouth."""
        upwards = 1.0 if self.edge == "top" else -1.0
        return math.sin(math.radians(self.tilt)), upwards * math.cos(math.radians(self.tilt))

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

    x: float = field(metadata=said("centre", "m"))
    y: float = field(metadata=said("centre", "m"))
    diameter: float = field(metadata=said("diameter", "m", gt=0))

    def __post_init__(self) -> None:
        check_fields(self, "Hole", {"x": number, "y": number, "diameter": length})

    def __repr__(self) -> str:
        return f"Hole(x={self.x:g} m, y={self.y:g} m, diameter={self.diameter:g} m)"

    @property
    def radius(self) -> float:
        """m."""
        return self.diameter / 2

    def wall(self, size: float) -> float:
        """Least thickness of the material beside it in a body of such a size, m."""
        return max(NEAR * size, _THINNEST_WALL * self.diameter)


@dataclass(frozen=True)
class CrackLine:
    """A crack along a line of straight segments.

    It may start and end inside the body (a tip), on its edge or on a hole (a mouth), or on another crack; it
    may cross other cracks.

    Attributes
    ----------
    points : sequence of (x, y)
        Corners of the line, m: from the mouth to the tip, or from tip to tip, or from mouth to mouth.
    opening : float
        Full angle between the faces, degrees: at a distance s from the tip the faces stand
        2 s tan(opening / 2) apart; with two tips s counts from the nearer one. 0 is a closed crack.
        It must be 0 without a tip and where cracks meet.
    name : str, optional
        Default: "crack1", "crack2", ... by position among the body's cracks.
    """

    points: Sequence[tuple[float, float]] = field(
        metadata=said("points from the mouth to the tip, or from tip to tip", "m")
    )
    opening: float = field(default=0.0, metadata=said("full angle at the mouth", "degree", ge=0))
    name: str | None = field(default=None, metadata=said('name of the crack; else "crack1", "crack2", ...'))

    def __post_init__(self) -> None:
        item = "CrackLine" if self.name is None else f"CrackLine {shown(self.name)}"
        if self.name is not None and (
            not isinstance(self.name, str) or not self.name or ":" in self.name or not self.name.isprintable()
        ):
            raise TypeError(
                f"{item}: name is {shown(self.name)}, a non-empty string without ':' and control "
                "characters was expected."
            )
        check_fields(self, item, {"points": partial(corners_of, least=2), "opening": number})
        if not 0 <= self.opening <= WIDEST_OPENING:
            raise ValueError(
                f"{item}: opening is {self.opening:g} degrees, 0 (closed crack) to {WIDEST_OPENING:g} was "
                "expected; draw a wider notch as part of the outline."
            )
        for first, second in zip(self.points, self.points[1:]):
            if first == second:
                raise ValueError(
                    f"{item}: the point ({first[0]:g}, {first[1]:g}) m stands twice in a row; leave one out."
                )

    def __repr__(self) -> str:
        line = ", ".join(f"({x:g}, {y:g})" for x, y in self.points)
        name = "" if self.name is None else f", name={self.name!r}"
        return f"CrackLine([{line}] m, opening={self.opening:g} deg{name})"


def _counted(items: object) -> bool:
    """Whether something iterable can be gone through: an array without dimensions cannot."""
    return getattr(items, "ndim", 1) > 0


def point_of(item: str, point: object) -> tuple[float, float]:
    """A point (x, y) as two floats, or the error that names what is wrong."""
    if isinstance(point, str) or not isinstance(point, Iterable) or len(pair := list(point)) != 2:
        raise TypeError(f"{item} is {shown(point)}, a pair (x, y) was expected.")
    return number(item, "x", pair[0]), number(item, "y", pair[1])


def corners_of(item: str, name: str, points: Any, least: int) -> tuple[tuple[float, float], ...]:
    """Points (x, y) as floats, or the error that names what is wrong."""
    if isinstance(points, str) or not hasattr(points, "__iter__") or not _counted(points):
        raise TypeError(f"{item}: {name} is {shown(points)}, a list of points (x, y) was expected.")
    result = [point_of(f"{item}: point {place} of {name}", point) for place, point in enumerate(points, 1)]
    if len(result) < least:
        raise ValueError(f"{item}: {name} has {len(result)} points, at least {least} were expected.")
    return tuple(result)


def items_of(owner: str, name: str, items: object, kind: type) -> tuple:
    """`items` as a tuple of objects of one kind, or the error that says otherwise."""
    if isinstance(items, kind) or not isinstance(items, Iterable) or not _counted(items):
        raise TypeError(f"{owner}: {name} is {shown(items)}, a list of {kind.__name__} was expected.")
    result = tuple(items)
    for item in result:
        if not isinstance(item, kind):
            raise TypeError(f"{owner}: {name} contains {shown(item)}, only {kind.__name__} was expected.")
    return result


def lists_of(**kinds: type) -> dict[str, Callable[[str, str, Any], tuple]]:
    """Checks of fields that hold several of a kind."""
    return {name: partial(items_of, kind=kind) for name, kind in kinds.items()}


def described(**items: Sequence[object]) -> str:
    """Lists of features, those that are not empty, as they stand behind others in a representation."""
    return "".join(f", {name}={list(own)!r}" for name, own in items.items() if own)


def refuse_close(
    owner: str, notches: Sequence[tuple[VNotch, shapely.Geometry]], holes: Sequence[Hole], size: float
) -> None:
    """ValueError for notches and holes that overlap, touch or come too close to each other.

    Parameters
    ----------
    notches : sequence of (VNotch, geometry)
        Each with the area that it takes.
    size : float
        Of the body, m.
    """
    items: list[tuple[VNotch | Hole, shapely.Geometry, float, float]]
    items = [(notch, area, 0.0, NEAR * size) for notch, area in notches]
    items += [(hole, shapely.Point(hole.x, hole.y), hole.radius, hole.wall(size)) for hole in holes]
    if len(items) < 2:
        return
    places = [place for _, place, _, _ in items]
    reach = 2 * max(radius for _, _, radius, _ in items) + max(wall for *_, wall in items)
    for i, j in sorted(shapely.STRtree(places).query(places, predicate="dwithin", distance=reach).T.tolist()):
        (one, here, inner, wall), (other, there, outer, thick) = items[i], items[j]
        if i >= j or shapely.distance(here, there) - inner - outer >= max(wall, thick):
            continue
        first, second = (k + 1 if k < len(notches) else k + 1 - len(notches) for k in (i, j))
        if type(one) is type(other):
            kind = "notches" if isinstance(one, VNotch) else "holes"
            raise ValueError(
                f"{owner}{kind} {first} and {second} overlap or touch ({one!r}, {other!r}); move them apart."
            )
        raise ValueError(
            f"{owner}hole {second} touches or cuts notch {first} ({other!r}, {one!r}); move them apart."
        )
