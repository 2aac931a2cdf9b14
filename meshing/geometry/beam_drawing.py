"""A beam's drawing: columns, graded corners, fans around what stands alone, gmsh's filling elsewhere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from meshing.cells.complex import Point, edge_key
from meshing.cells.vertex_rings import Rings
from meshing.geometry.beam_options import BeamOptions
from meshing.geometry.blocks import Block, features_of, plan_blocks
from meshing.geometry.drawing import Drawing
from meshing.geometry.fans import Fan
from meshing.geometry.fill import draw_filled
from meshing.geometry.graph import plane_graph
from meshing.shapes.beam_shape import BeamShape
from meshing.shapes.features import CrackLine, Hole, VNotch

_NEAR = 1e-9  # distance of what is at one place, relative to the height
_COLUMN = 0.25  # of a column that is left out
_EDGE = 0.5  # largest edge of a filled block, relative to the height


def beam_drawing(beam: BeamShape, options: BeamOptions) -> Drawing:
    """Draw a beam.

    Raises
    ------
    ValueError
        Cracks or points come too close to something; sizes that do not fit.
    """
    drawing = Drawing(near=_NEAR * beam.height)
    widths = _corner_widths(beam, options)
    start, stop = widths["left"], beam.length - widths["right"]
    blocks = plan_blocks(beam, options.points, start, stop)
    _draw_columns(drawing, beam, options, blocks, (start, stop))
    _draw_ends(drawing, beam, widths)
    for block in blocks:
        if Fan.suits(beam, block):
            points = list(options.points.values())
            Fan(beam, block).draw(drawing, points, options.cracks.tip_size, options.cracks.grading)
        else:
            _fill_block(drawing, beam, block, min(_EDGE * beam.height, options.size))
    for end, width in widths.items():
        for y in (0.0, beam.height) if width else ():
            x = 0.0 if end == "left" else beam.length
            _grade(drawing, drawing.add_vertex(x, y), options)
    named = options.points | {"A": (beam.length, beam.height)}
    drawing.points |= {name: drawing.add_vertex(*place) for name, place in named.items()}
    drawing.conform()
    _name_sides(drawing, beam)
    thin = [notch.opening if notch.is_thin(beam.height) else 0.0 for notch in beam.notches]
    angles = [*thin, *(crack.opening for crack in beam.cracks)]
    drawing.name_openings(dict(zip(beam.crack_names(), angles)))
    return drawing


def _corner_widths(beam: BeamShape, options: BeamOptions) -> dict[str, float]:
    """Width of the graded corner squares at each end, 0 where there are none."""
    features, points = features_of(beam), [x for x, _ in options.points.values()]
    free = {"left": min((feature.low for feature in features), default=beam.length)}
    free["right"] = beam.length - max((feature.high for feature in features), default=0.0)
    nearest = {"left": min((x for x in points if x > 0), default=math.inf)}
    nearest["right"] = beam.length - max((x for x in points if x < beam.length), default=-math.inf)
    widths = {"left": 0.0, "right": 0.0}
    for side in options.corners:
        width = min(0.5 * beam.height, 0.5 * free[side], 0.25 * beam.length, nearest[side])
        if 1.5 * options.corner_size >= width and not options.corner_size_given:
            width = 0.0  # a notch or hole close by is graded itself
        elif options.corner_size >= width:
            raise ValueError(
                f"mesh: corner_size {options.corner_size:g} m does not fit at the {side} end, where "
                f"{width:g} m are free; make it smaller."
            )
        widths[side] = width
    return widths


def _draw_columns(
    drawing: Drawing, beam: BeamShape, options: BeamOptions, blocks: Sequence[Block], ends: Sequence[float]
) -> None:
    """Plain columns between the blocks and the ends of what they fill, equal between two fixed lines."""
    rows = math.ceil(beam.height / options.size - 1e-9)
    levels = [beam.height * i / rows for i in range(rows)] + [beam.height]
    for left, right in zip([ends[0], *(b.high for b in blocks)], [*(b.low for b in blocks), ends[1]]):
        fixed = sorted({left, right} | {x for x, _ in options.points.values() if left < x < right})
        for a, b in pairwise(fixed):
            count = max(1, math.ceil((b - a) / options.size - _COLUMN))
            _grid(drawing, [a + (b - a) * i / count for i in range(count)] + [b], levels)


def _draw_ends(drawing: Drawing, beam: BeamShape, widths: Mapping[str, float]) -> None:
    """Squares in the corners of an end, and what is left of the column between them."""
    for end, width in widths.items():
        if width:
            sides = (0.0, width) if end == "left" else (beam.length - width, beam.length)
            levels = sorted({0.0, width, beam.height - width, beam.height})
            apart = [y for y, last in zip(levels, [-1.0, *levels]) if y - last > _NEAR * beam.height]
            _grid(drawing, sides, apart)


def _grid(drawing: Drawing, xs: Sequence[float], ys: Sequence[float]) -> None:
    for a, b in pairwise(xs):
        for c, d in pairwise(ys):
            drawing.add_cell([drawing.add_vertex(*place) for place in ((a, c), (b, c), (b, d), (a, d))])


def _grade(drawing: Drawing, vertex: int, options: BeamOptions) -> None:
    """Rings of cells around a corner of the outline."""
    rings = Rings(drawing, options.cracks.grading)
    cell = next(cell.vertices for cell in drawing.cells if vertex in cell.vertices)
    place = cell.index(vertex)
    first, last = cell[(place + 1) % len(cell)], cell[place - 1]
    fan = rings.fan(vertex, first, last)
    assert fan is not None
    rings.refine(fan, [first, last], options.corner_size * math.sqrt(2), tip=False)


def _fill_block(drawing: Drawing, beam: BeamShape, block: Block, size: float) -> None:
    """A block that gmsh fills; notches that are open are cut out of its outline."""
    holes, lines, flanks = {}, {}, {}
    for feature in block.features:
        shape = feature.shape
        if isinstance(shape, Hole):
            holes[feature.name] = ((shape.x, shape.y), shape.radius)
        elif isinstance(shape, CrackLine):
            lines[feature.name] = np.array(shape.points[::-1])
        elif shape.is_thin(beam.height):
            lines[feature.name] = beam.triangle(shape)[:2]
        else:
            flanks[feature.name] = (shape, [tuple(corner) for corner in beam.triangle(shape)])
    _refuse_met_notches(lines, flanks, _NEAR * beam.height)
    triangles = sorted((triangle for _, triangle in flanks.values()), key=lambda corners: corners[1][0])
    outline, tips = _cut_out(block.corners(beam.height), triangles, beam.height)
    graph = plane_graph(outline, holes, lines, block.points)
    sides = draw_filled(drawing, graph, size, [""] * len(outline), tips)
    flank_of = {outline[place]: (sides[place - 1][::-1], sides[place]) for place in tips}
    for name, (_, triangle) in flanks.items():
        before, after = (list(pairwise(chain)) for chain in flank_of[triangle[0]])
        drawing.groups[f"crack:{name}:right"], drawing.groups[f"crack:{name}:left"] = before, after


def _refuse_met_notches(
    lines: Mapping[str, Any], flanks: Mapping[str, tuple[VNotch, Any]], near: float
) -> None:
    """ValueError for a crack that runs into an open notch, or meets it elsewhere than at a mouth corner."""
    for name, points in lines.items():
        for other, (notch, triangle) in flanks.items():
            line, inside, tip = shapely.LineString(points), shapely.Polygon(triangle), triangle[0]
            ends, mouth = shapely.points(points), shapely.MultiPoint(triangle[1:])
            met = points[(shapely.distance(ends, inside) <= near) & (shapely.distance(ends, mouth) > near)]
            if (common := line.intersection(inside)).length > 0.0:
                met = shapely.get_coordinates(common)
            elif line.distance(shapely.Point(tip)) <= near:
                met = [tip]
            if len(met):
                x, y = met[0]
                raise ValueError(
                    f"crack {other!r}: opening is {notch.opening:g} degrees, but it meets crack {name!r} at "
                    f"({x:.6g}, {y:.6g}) m; cracks that meet start closed: draw the notch as one of them "
                    "(CrackLine)."
                )


def _cut_out(
    corners: list[Point], triangles: Sequence[list[Point]], height: float
) -> tuple[list[Point], list[int]]:
    """The outline of a block without its open notches, and the places of their tips in it.

    Parameters
    ----------
    corners : list of (x, y)
        Counter-clockwise from the lower left, m.
    triangles : sequence of list of (x, y)
        Tip, mouth corner at the free-end side, that at the clamp side, from the clamp on, m.
    """
    low = [[left, tip, right] for tip, right, left in triangles if left[1] < 0.5 * height]
    high = [[right, tip, left] for tip, right, left in triangles[::-1] if left[1] > 0.5 * height]
    outline = [corners[0], *sum(low, []), *corners[1:3], *sum(high, []), corners[3]]
    tips = {triangle[0] for triangle in triangles}
    return outline, [place for place, corner in enumerate(outline) if corner in tips]


def _name_sides(drawing: Drawing, beam: BeamShape) -> None:
    """Sort the outline's edges into the beam's four edges; holes and faces are known already."""
    known = [*drawing.edge_sets.values(), *drawing.groups.values()]
    faces = {edge_key(edge) for edges in known for edge in edges}
    places = {"left": (0, 0.0), "right": (0, beam.length), "bottom": (1, 0.0), "top": (1, beam.height)}
    sets: dict[str, list[tuple[int, int]]] = {name: [] for name in places}
    for edge, count in drawing.edge_uses().items():
        if count == 1 and edge not in faces:
            ends = np.array([drawing.vertices[v] for v in edge])
            name = next((n for n, (axis, value) in places.items() if (ends[:, axis] == value).all()), None)
            if name is None:
                raise RuntimeError(
                    f"beam: the cells do not fit together between {ends[0]} and {ends[1]}; please report "
                    "this geometry."
                )
            sets[name].append(edge)
    drawing.edge_sets = sets | drawing.edge_sets
