"""Plan of a beam's mesh: inputs checked, features gathered into blocks, a box around every tip and hole."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from meshing.cells.stars import Box
from meshing.input_checks import (
    checked_faces,
    checked_order,
    choice,
    named_points,
    number,
    positive,
    shown,
)
from meshing.shapes.beam_shape import BeamShape
from meshing.shapes.features import CrackLine, Hole, VNotch

# All relative to the beam's height.
_REACH = 0.5  # half-width of a block around a notch tip or hole
_CLEAR = 0.15  # least distance of a block's side from its features
_CORNER_SIZE = 0.2  # default size of the innermost cell at a graded corner
_SLIDE = 0.25  # how far a block's side moves to pass through a user's point or to avoid a thin strip
# Relative to the box's smallest extent.
_LONGEST_SIDE = 4.01  # a box from edge to edge of the beam may be this long
_WALL = 1.25  # a box around a hole is at least this many radii

Point = tuple[float, float]


@dataclass(frozen=True)
class MeshInputs:
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
    def checked(cls, beam: BeamShape, given: Mapping[str, Any]) -> MeshInputs:
        """Check the arguments of `Beam.mesh`, by their names, and fill in the defaults."""
        size, tip_size, corner_size, corners = (
            given[name] for name in ("size", "tip_size", "corner_size", "corners")
        )
        order = checked_order(given["order"])
        least = 1e-6 * beam.height
        # cells longer than the beam are no other cells
        size = 2.5 * beam.height if size is None else min(positive("mesh", "size", size), 4.0 * beam.length)
        if not 0.02 * beam.height <= size:
            raise ValueError(
                f"mesh: size {size:g} m is below 2 % of the beam's height {beam.height:g} m; high orders on "
                "larger cells cost less."
            )
        if tip_size is not None and positive("mesh", "tip_size", tip_size) < least:
            raise ValueError(
                f"mesh: tip_size {tip_size:g} m is below 1e-6 of the beam's height {beam.height:g} m, "
                "round-off would show; make it larger."
            )
        layout = choice("mesh", "layout", given["layout"], ("tip", "vertex"))
        if layout == "vertex" and (beam.cracks or any(notch.edge == "bottom" for notch in beam.notches)):
            raise ValueError(
                'mesh: layout "vertex" knows notches from the top edge only; leave it out for this beam.'
            )
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
            and not least <= positive("mesh", "corner_size", corner_size) < 0.5 * beam.height
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
            *checked_faces(beam.height, given["face_size"], given["face_edges"]),
        )


@dataclass(frozen=True)
class Feature:
    """A notch, hole or crack with what the plan needs of it.

    Attributes
    ----------
    shape : VNotch, Hole or CrackLine
    index : int
        Position in `Beam.notches`, `Beam.holes` or `Beam.cracks`.
    centre : (x, y)
        Tip or centre, m.
    low, high : float
        Range of x that it occupies, m.
    wanted_low, wanted_high : float
        Sides of a comfortable block around it, m.
    outline : (n, 2) array
        Points on its outline, m.
    """

    shape: VNotch | Hole | CrackLine
    index: int
    centre: Point
    low: float
    high: float
    wanted_low: float
    wanted_high: float
    outline: np.ndarray

    @property
    def notch(self) -> VNotch:
        """The shape of a feature that is a notch."""
        assert isinstance(self.shape, VNotch)
        return self.shape

    @property
    def hole(self) -> Hole:
        """The shape of a feature that is a hole."""
        assert isinstance(self.shape, Hole)
        return self.shape

    @classmethod
    def of_notch(cls, beam: BeamShape, index: int) -> Feature:
        """A notch: outline is its two faces."""
        notch = beam.notches[index]
        triangle = beam.triangle(notch)
        fraction = np.linspace(0, 1, 101)[:, None]
        faces = np.vstack([triangle[0] + fraction * (mouth - triangle[0]) for mouth in triangle[1:]])
        low, high = triangle[:, 0].min(), triangle[:, 0].max()
        reach, slide = _REACH * beam.height, _SLIDE * beam.height
        return cls(
            notch,
            index,
            tuple(triangle[0]),
            low,
            high,
            min(notch.x - reach, low - slide),
            max(notch.x + reach, high + slide),
            faces,
        )

    @classmethod
    def of_hole(cls, beam: BeamShape, index: int) -> Feature:
        """A hole: outline is its circle."""
        hole = beam.holes[index]
        angle = np.linspace(0, 2 * math.pi, 181)
        circle = np.stack(
            [hole.x + hole.radius * np.cos(angle), hole.y + hole.radius * np.sin(angle)], axis=1
        )
        reach = max(_REACH * beam.height, hole.radius + _SLIDE * beam.height)
        return cls(
            hole,
            index,
            (hole.x, hole.y),
            hole.x - hole.radius,
            hole.x + hole.radius,
            hole.x - reach,
            hole.x + reach,
            circle,
        )

    @classmethod
    def of_crack(cls, beam: BeamShape, index: int) -> Feature:
        """A crack: outline is its line."""
        crack = beam.cracks[index]
        line = shapely.segmentize(shapely.LineString(crack.points), 0.01 * beam.height)
        outline = shapely.get_coordinates(line)
        low, high = outline[:, 0].min(), outline[:, 0].max()
        reach = _REACH * beam.height
        return cls(crack, index, crack.points[-1], low, high, low - reach, high + reach, outline)

    @property
    def is_notch(self) -> bool:
        """A notch, not a hole or a crack."""
        return isinstance(self.shape, VNotch)

    @property
    def is_line(self) -> bool:
        """A notch or crack that is no notch from the top edge."""
        return isinstance(self.shape, CrackLine) or getattr(self.shape, "edge", "top") == "bottom"


@dataclass
class Block:
    """A piece of the beam over its full height that holds features.

    Attributes
    ----------
    low, high : float
        Its sides, m.
    features : list of Feature
    boxes : list of Box or None
        Box around each feature; None for a hole that stands too close to something.
    filled : bool
        Part of the block is outside the boxes and is filled by gmsh.
    inner_points : list of str
        Users' points in the interior that become vertices of gmsh's cells.
    """

    low: float
    high: float
    features: list[Feature]
    boxes: list[Box | None] = field(default_factory=list)
    filled: bool = False
    inner_points: list[str] = field(default_factory=list)

    @property
    def has_lines(self) -> bool:
        """It holds cracks that are no notches from the top edge: no boxes, gmsh fills all of it."""
        return any(feature.is_line for feature in self.features)


def plan_blocks(beam: BeamShape, inputs: MeshInputs, low: float, high: float) -> list[Block]:
    """Blocks around the features, from left to right; their sides pass through users' points where they can.

    Parameters
    ----------
    low, high : float
        Range of x left for blocks by the graded corners, m.
    """
    features = [
        *(Feature.of_notch(beam, i) for i in range(len(beam.notches))),
        *(Feature.of_hole(beam, i) for i in range(len(beam.holes))),
        *(Feature.of_crack(beam, i) for i in range(len(beam.cracks))),
    ]
    blocks = _gather(beam, features)
    _set_sides(beam, inputs, blocks, low, high)
    for block in blocks:
        block.inner_points = [
            name
            for name, (x, y) in inputs.points.items()
            if block.low < x < block.high and 0 < y < beam.height
        ]
        if not block.has_lines:
            _set_boxes(beam, inputs, block)
    return blocks


def _gather(beam: BeamShape, features: list[Feature]) -> list[Block]:
    blocks: list[Block] = []
    reached = -math.inf
    for feature in sorted(features, key=lambda f: f.low):
        if blocks and feature.low - reached < 2 * _CLEAR * beam.height:
            blocks[-1].features.append(feature)
        else:
            blocks.append(Block(0.0, 0.0, [feature]))
        reached = max(reached, feature.high)
    return blocks


def _set_sides(beam: BeamShape, inputs: MeshInputs, blocks: list[Block], start: float, stop: float) -> None:
    slide, clear = _SLIDE * beam.height, _CLEAR * beam.height
    lines = sorted({x for x, _ in inputs.points.values()})
    for block in blocks:
        block.low = min(f.wanted_low for f in block.features)
        block.high = max(f.wanted_high for f in block.features)
    # Each gap between neighbouring blocks (or a block and the end): the right side of the one before, the
    # left side of the one after.
    for before, after in zip([None, *blocks], [*blocks, None]):
        lowest = max(f.high for f in before.features) + clear if before else start
        highest = min(f.low for f in after.features) - clear if after else stop
        right, left = before.high if before else start, after.low if after else stop
        if left - right < slide:
            # Too thin for plain cells of its own: one common side; an end of the range cannot move.
            right = left = start if not before else stop if not after else 0.5 * (lowest + highest)
        inside = [x for x in lines if lowest < x < highest]
        if before and inside and inside[0] <= right + slide:
            right = inside[0]
        if after and inside and inside[-1] >= left - slide:
            left = inside[-1]
        if before:
            before.high = min(right, stop)
        if after:
            after.low = max(left, start)


def _set_boxes(beam: BeamShape, inputs: MeshInputs, block: Block) -> None:
    """Boxes of a block: edge to edge for a lone feature with room around it, else the largest that keep clear
    of each other.
    """
    points = [np.array([inputs.points[name]]) for name in block.inner_points]
    if len(block.features) == 1 and not points:
        feature = block.features[0]
        box = Box(feature.centre, block.low, block.high, 0.0, beam.height)
        room = feature.is_notch or box.smallest >= _WALL * feature.hole.radius
        if room and box.largest <= _LONGEST_SIDE * box.smallest:
            block.boxes = [box]
            return
    block.filled = True
    for feature in block.features:
        others = [other.outline for other in block.features if other is not feature] + points
        # Chebyshev distance; two boxes that reach less than half way to each other's feature cannot meet.
        half_way = 0.45 * min(
            (np.abs(outline - feature.centre).max(axis=1).min() for outline in others), default=math.inf
        )
        box = _largest_box(beam, block, feature.centre, half_way)
        fits = feature.is_notch or box.smallest >= _WALL * feature.hole.radius
        block.boxes.append(box if fits else None)


def _largest_box(beam: BeamShape, block: Block, centre: Point, half_way: float) -> Box:
    """A box that reaches an edge exactly or stays well away from it."""
    x, y = centre
    distances = {"left": x - block.low, "right": block.high - x, "bottom": y, "top": beam.height - y}
    smallest = min(half_way, *distances.values())
    extents = {}
    for side, distance in distances.items():
        if distance <= min(1.8 * smallest, half_way):
            extents[side] = distance
        else:
            extents[side] = min(1.2 * smallest, half_way, 0.6 * distance)
    reached = {side: extents[side] == distances[side] for side in distances}
    return Box(
        centre,
        block.low if reached["left"] else x - extents["left"],
        block.high if reached["right"] else x + extents["right"],
        0.0 if reached["bottom"] else y - extents["bottom"],
        beam.height if reached["top"] else y + extents["top"],
    )
