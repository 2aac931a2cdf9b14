"""Notches, holes and cracks of a beam gathered into blocks: pieces of the beam over its full height."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely

from meshing.cells.complex import Point
from meshing.shapes.beam_shape import BeamShape
from meshing.shapes.features import CrackLine, Hole, VNotch

# All relative to the beam's height.
_REACH = 0.5  # half-width of a block around a notch tip or hole
_CLEAR = 0.15  # least distance of a block's side from its features
_SLIDE = 0.25  # how far a block's side moves to pass through a user's point or to avoid a thin strip


@dataclass(frozen=True)
class Feature:
    """A notch, hole or crack.

    Attributes
    ----------
    shape : VNotch, Hole or CrackLine
    name : str
        Of the crack, or of the hole's edge set.
    low, high : float
        Range of x that it occupies, m.
    """

    shape: VNotch | Hole | CrackLine
    name: str
    low: float
    high: float


@dataclass
class Block:
    """A piece of the beam over its full height.

    Attributes
    ----------
    features : list of Feature
    low, high : float
        Its sides, m.
    points : dict of str to (x, y)
        Users' points inside, m.
    """

    features: list[Feature]
    low: float = 0.0
    high: float = 0.0
    points: Mapping[str, Point] = field(default_factory=dict)

    def corners(self, height: float) -> list[Point]:
        """Counter-clockwise from the lower left, m."""
        return [(self.low, 0.0), (self.high, 0.0), (self.high, height), (self.low, height)]


def features_of(beam: BeamShape) -> list[Feature]:
    """Notches, cracks and holes, in this order."""
    names = [*beam.crack_names(), *(f"hole{i}" for i in range(1, len(beam.holes) + 1))]
    features = []
    shapes: list[VNotch | CrackLine | Hole] = [*beam.notches, *beam.cracks, *beam.holes]
    for name, shape in zip(names, shapes):
        if isinstance(shape, Hole):
            low, high = shape.x - shape.radius, shape.x + shape.radius
        else:
            xs = beam.triangle(shape)[:, 0] if isinstance(shape, VNotch) else np.array(shape.points)[:, 0]
            low, high = float(xs.min()), float(xs.max())
        features.append(Feature(shape, name, low, high))
    return features


def plan_blocks(beam: BeamShape, points: Mapping[str, Point], start: float, stop: float) -> list[Block]:
    """Blocks from left to right; their sides pass through users' points where they can.

    Parameters
    ----------
    points : mapping of str to (x, y)
        m.
    start, stop : float
        Range of x left for blocks by the graded corners, m.
    """
    blocks: list[Block] = []
    for feature in sorted(features_of(beam), key=lambda f: f.low):
        reached = max((f.high for f in blocks[-1].features), default=0.0) if blocks else 0.0
        if blocks and feature.low - reached < 2 * _CLEAR * beam.height:
            blocks[-1].features.append(feature)
        else:
            blocks.append(Block([feature]))
    for block in blocks:
        wanted = [_sides(beam.height, feature) for feature in block.features]
        block.low, block.high = min(low for low, _ in wanted), max(high for _, high in wanted)
    xs = sorted({x for x, _ in points.values()})
    for before, after in pairwise([None, *blocks, None]):
        _set_sides(beam.height, before, after, xs, start, stop)
    for block in blocks:
        inside = shapely.box(block.low, 0, block.high, beam.height)
        block.points = {name: at for name, at in points.items() if inside.contains(shapely.Point(at))}
    return blocks


def _sides(height: float, feature: Feature) -> tuple[float, float]:
    """Sides of a comfortable block around a feature, m."""
    shape = feature.shape
    reach, slide = _REACH * height, _SLIDE * height
    if isinstance(shape, CrackLine):
        return feature.low - reach, feature.high + reach
    return min(shape.x - reach, feature.low - slide), max(shape.x + reach, feature.high + slide)


def _set_sides(
    height: float, before: Block | None, after: Block | None, xs: list[float], start: float, stop: float
) -> None:
    """The sides that face each other across a gap between neighbouring blocks, or a block and the end."""
    slide, clear = _SLIDE * height, _CLEAR * height
    lowest = max(f.high for f in before.features) + clear if before else start
    highest = min(f.low for f in after.features) - clear if after else stop
    right, left = before.high if before else start, after.low if after else stop
    if left - right < slide:
        # Too thin for plain cells of its own: one common side; an end of the range cannot move.
        right = left = start if not before else stop if not after else 0.5 * (lowest + highest)
    inside = [x for x in xs if lowest < x < highest]
    if before and inside and inside[0] <= right + slide:
        right = inside[0]
    if after and inside and inside[-1] >= left - slide:
        left = inside[-1]
    if before:
        before.high = min(right, stop)
    if after:
        after.low = max(left, start)
