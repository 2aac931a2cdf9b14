"""Cells of a beam: columns, graded corners, stars around tips and holes, and gmsh's filling between them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from meshing.cells.beam_filling import fill_block
from meshing.cells.beam_layout import Block, Feature, MeshInputs, plan_blocks
from meshing.cells.beam_lines import BlockRegion, add_lines
from meshing.cells.complex import CellComplex, CrackFaces, FacePath, TipCell, edge_key
from meshing.cells.face_division import divide_faces, with_inserted
from meshing.cells.mirror import mirrored
from meshing.cells.skeleton import Skeleton, Star
from meshing.cells.stars import Box, add_levels, add_rings, outline, ring_scales
from meshing.shapes.beam_shape import BeamShape

_WIDEST_SIDE = math.radians(55.0)
_FEWEST_ARCS, _MOST_ARCS = 8, 128  # of a hole without a ring
_DEFAULT_TIP = 0.02  # of a notch's depth
_HOLE_RING = 1.6  # smallest extent, in radii, of the outline next to a hole


def beam_cells(beam: BeamShape, inputs: MeshInputs) -> CellComplex:
    """Divide a beam into cells.

    Everything that neighbours share on vertical lines and on the beam's edges is registered first, the cells
    are made after that: a cell then includes the hanging vertices of its neighbours.

    Returns
    -------
    CellComplex
        With cracks, edge sets and points.
    """
    if beam.notches and not beam.cracks and all(notch.edge == "bottom" for notch in beam.notches):
        return _upside_down(beam, inputs)
    skeleton = Skeleton(beam, inputs)
    widths = _corner_widths(beam, inputs)
    low, high = widths["left"], beam.length - widths["right"]
    blocks = plan_blocks(beam, inputs, low, high)
    columns = _columns(inputs, blocks, low, high)
    lines = sorted(
        {0.0, beam.length, low, high}
        | {x for pair in columns for x in pair}
        | {side for b in blocks for side in (b.low, b.high)}
    )
    for x in lines:
        skeleton.add_line(x)
    _register_rows(skeleton, columns)
    _register_corners(skeleton, widths)
    _register_points(skeleton, blocks)
    regions = [BlockRegion(skeleton, block) for block in blocks if block.has_lines]
    for region in regions:
        region.divide_sides()
    blocks = [block for block in blocks if not block.has_lines]
    stars = [
        [_make_star(skeleton, block, *pair) for pair in zip(block.features, block.boxes)] for block in blocks
    ]
    for block, group in zip(blocks, stars):
        if block.filled:
            skeleton.divide_perimeter(block, group)
    for side, width in widths.items():
        if width:
            _fill_corners(skeleton, side, width)
    for left, right in columns:
        _fill_column(skeleton, left, right)
    for block, group in zip(blocks, stars):
        for star in group:
            _fill_star(skeleton, star)
        if block.filled:
            fill_block(skeleton, block, group)
    for region in regions:
        region.fill()
    cells = skeleton.cells
    every = sorted(
        (star for group in stars for star in group if star.feature.is_notch),
        key=lambda star: star.feature.index,
    )
    _divide_faces(skeleton, every)
    for star in every:
        _record_crack(skeleton, star)
    if regions:
        add_lines(skeleton, regions)
    _record_edge_sets(skeleton)
    cells.points["A"] = skeleton.vertex(beam.length, beam.height)
    return cells


def _upside_down(beam: BeamShape, inputs: MeshInputs) -> CellComplex:
    """A beam with notches from its bottom edge only: the mirror image of one with notches from its top."""
    height = beam.height
    turned = BeamShape(
        beam.length,
        height,
        tuple(replace(notch, edge="top") for notch in beam.notches),
        tuple(replace(hole, y=height - hole.y) for hole in beam.holes),
    )
    points = {name: (x, height - y) for name, (x, y) in inputs.points.items()}
    cells = beam_cells(turned, replace(inputs, points=points))
    names = {"top": "bottom", "bottom": "top"}
    for i in range(1, len(beam.notches) + 1):
        names |= {f"crack{i}_right": f"crack{i}_left", f"crack{i}_left": f"crack{i}_right"}
    result = mirrored(cells, height, names)
    corner = next(
        vertex
        for a, b in result.edge_sets["top"]
        for vertex in (a, b)
        if result.vertices[vertex][0] == beam.length
    )
    result.points["A"] = corner
    return result


def _corner_widths(beam: BeamShape, inputs: MeshInputs) -> dict[str, float]:
    """Width of the graded corner squares at each end, 0 where there are none."""
    lows = [n.x + min(0.0, n.left_offset) for n in beam.notches] + [h.x - h.radius for h in beam.holes]
    highs = [n.x + max(0.0, n.right_offset) for n in beam.notches] + [h.x + h.radius for h in beam.holes]
    lows += [x for crack in beam.cracks for x, _ in crack.points]
    highs += [x for crack in beam.cracks for x, _ in crack.points]
    free = {"left": min(lows, default=beam.length), "right": beam.length - max(highs, default=0.0)}
    points = [x for x, _ in inputs.points.values()]
    nearest = {"left": min((x for x in points if x > 0), default=math.inf)}
    nearest["right"] = beam.length - max((x for x in points if x < beam.length), default=-math.inf)
    widths = {}
    for side in ("left", "right"):
        width = (
            min(0.5 * beam.height, 0.5 * free[side], 0.25 * beam.length, nearest[side])
            if side in inputs.corners
            else 0.0
        )
        if width and 1.5 * inputs.corner_size >= width and not inputs.corner_size_given:
            width = 0.0  # a notch or hole close by is graded itself
        elif width and inputs.corner_size >= width:
            raise ValueError(
                f"mesh: corner_size {inputs.corner_size:g} m does not fit at the {side} end, where {width:g} "
                "m are free; make it smaller."
            )
        widths[side] = width
    return widths


def _columns(inputs: MeshInputs, blocks: list[Block], low: float, high: float) -> list[tuple[float, float]]:
    """Plain columns (left, right), equal between two fixed lines."""
    columns = []
    for left, right in zip([low] + [b.high for b in blocks], [b.low for b in blocks] + [high]):
        fixed = sorted({left, right} | {x for x, _ in inputs.points.values() if left < x < right})
        for a, b in zip(fixed, fixed[1:]):
            count = max(1, math.ceil((b - a) / inputs.size - 0.25))
            sides = [a + (b - a) * i / count for i in range(count)] + [b]
            columns += list(zip(sides, sides[1:]))
    return columns


def _register_rows(skeleton: Skeleton, columns: list[tuple[float, float]]) -> None:
    height, size = skeleton.beam.height, skeleton.inputs.size
    rows = math.ceil(height / size - 1e-9)
    for column in columns:
        for x in column:
            for i in range(1, rows):
                skeleton.vertex(x, height * i / rows)
    skeleton.rows = rows


def _register_corners(skeleton: Skeleton, widths: dict[str, float]) -> None:
    beam = skeleton.beam
    for side, width in widths.items():
        if width:
            for x in (0.0, width) if side == "left" else (beam.length, beam.length - width):
                for y in (width, beam.height - width):
                    skeleton.vertex(x, y)


def _register_points(skeleton: Skeleton, blocks: list[Block]) -> None:
    inner = {name for block in blocks for name in block.inner_points}
    for name, (x, y) in skeleton.inputs.points.items():
        if name not in inner:
            skeleton.cells.points[name] = skeleton.vertex(x, y)


def _fill_column(skeleton: Skeleton, left: float, right: float) -> None:
    height, rows = skeleton.beam.height, skeleton.rows
    levels = [height * i / rows for i in range(rows)] + [height]
    for low, high in zip(levels, levels[1:]):
        skeleton.add_polygon([(left, low), (right, low), (right, high), (left, high)])


def _fill_corners(skeleton: Skeleton, side: str, width: float) -> None:
    """Squares at the two corners of an end edge, in rings of two trapezoids; what is left of the column
    between them is one cell.
    """
    beam, inputs = skeleton.beam, skeleton.inputs
    inward, edge = (1.0, 0.0) if side == "left" else (-1.0, beam.length)
    scales = ring_scales(inputs.corner_size / width, inputs.grading)
    line = width if side == "left" else beam.length - width
    for y, up in ((0.0, 1.0), (beam.height, -1.0)):
        across = width if up > 0 else beam.height - width
        points = [(line, y), (line, across), (edge, across)]
        if inward * up < 0:
            points.reverse()
        outer = [skeleton.vertex(*point) for point in points]
        levels = add_levels(skeleton.vertex_or_new, (edge, y), np.array(points), scales, outer)
        add_rings(skeleton.cells, levels, False, skeleton.chain)
        corner = skeleton.vertex(edge, y)
        skeleton.cells.add_cell(skeleton.chain([corner, *levels[0], corner])[:-1])
    if beam.height - 2 * width > 1e-9 * beam.height:
        left, right = sorted((edge, line))
        skeleton.add_polygon(
            [(left, width), (right, width), (right, beam.height - width), (left, beam.height - width)]
        )


def _make_star(skeleton: Skeleton, block: Block, feature: Feature, box: Box | None) -> Star:
    """Outline of a feature's box; its vertices on lines and edges are registered."""
    beam = skeleton.beam
    if box is None:
        return Star(feature, None, np.zeros((0, 2)), [], circle=_free_circle(skeleton, block, feature))
    if not feature.is_notch:
        wall = box.smallest / feature.hole.radius - 1.0
        # An arc must stay inside the tangents at its ends by less than the wall, so that the cell keeps a
        # kernel.
        thin = 2 * math.acos(1.0 / (1.0 + 0.3 * wall))
        points = outline(box, None, min(_WIDEST_SIDE, thin), skeleton.preferred, True)
        return Star(feature, box, points, [skeleton.vertex_or_new(*p) for p in points])
    tip, shape = np.array(feature.centre), feature.notch
    mouths = [np.array([shape.x + offset, beam.height]) for offset in (shape.left_offset, shape.right_offset)]
    fraction = min(
        math.dist(tip, box.hit(math.atan2(mouth[1] - tip[1], mouth[0] - tip[0]))) / math.dist(tip, mouth)
        for mouth in mouths
    )
    if fraction > 1.0 - 1e-9:
        fraction, ends = 1.0, mouths
    else:
        # Equal fractions of both faces, although the box may hold more of one of them; nothing of the box
        # stands far above its faces.
        ends = [tip + fraction * (mouth - tip) for mouth in mouths]
        box = replace(box, top=min(box.top, tip[1] + max(fraction * shape.depth, 0.4 * box.largest)))
    points = outline(
        box,
        ((ends[0][0], ends[0][1]), (ends[1][0], ends[1][1])),
        _WIDEST_SIDE,
        skeleton.preferred,
        keep_corners=not block.filled,
    )
    # Face vertices are never looked up by their coordinates: those of a closed crack coincide.
    inner = [skeleton.vertex_or_new(*p) for p in points[1:-1]]
    vertices = [skeleton.cells.add_vertex(*points[0]), *inner, skeleton.cells.add_vertex(*points[-1])]
    return Star(feature, box, points, vertices, face_fraction=fraction)


def _free_circle(skeleton: Skeleton, block: Block, feature: Feature) -> list[int]:
    """Vertices of the edge of a hole that has no ring of its own: short arcs where something is near."""
    (x, y), radius = feature.centre, feature.hole.radius
    distances = [x - block.low, block.high - x, y, skeleton.beam.height - y]
    distances += [
        np.hypot(*(other.outline - feature.centre).T).min()
        for other in block.features
        if other is not feature
    ]
    gap = min(distances) - radius
    count = _FEWEST_ARCS
    while count < _MOST_ARCS and (
        radius * (1 - math.cos(math.pi / count)) > 0.1 * gap or 2 * math.pi * radius / count > 2.0 * gap
    ):
        count *= 2
    angle = 2 * math.pi * (np.arange(count) + 0.5) / count
    return skeleton.add_circle(feature, np.stack([x + np.cos(angle), y + np.sin(angle)], axis=1))


def _tip_size(inputs: MeshInputs, feature: Feature, box: Box) -> float:
    """Half-size of the element on a tip, m."""
    if inputs.tip_size is None:
        return min(_DEFAULT_TIP * feature.notch.depth, box.largest / inputs.grading)
    if inputs.tip_size >= box.largest:
        where = f"around the tip of notch {feature.index + 1}, where {box.largest:g} m are free"
        raise ValueError(f"mesh: tip_size {inputs.tip_size:g} m does not fit {where}; make it smaller.")
    return inputs.tip_size


def _fill_star(skeleton: Skeleton, star: Star) -> None:
    if star.box is None:
        return
    cells, feature, box = skeleton.cells, star.feature, star.box
    if not feature.is_notch:
        scales = ring_scales(
            min(1.0 - 1e-12, _HOLE_RING * feature.hole.radius / box.smallest), skeleton.inputs.grading
        )
        if box.smallest < _HOLE_RING * skeleton.inputs.grading**0.5 * feature.hole.radius:
            scales = np.ones(1)
        levels = add_levels(cells.add_vertex, feature.centre, star.points, scales, star.vertices)
        circle = skeleton.add_circle(feature, star.points)
        star.circle = circle
        add_rings(cells, [circle, *levels], True, skeleton.chain)
        return
    inputs = skeleton.inputs
    scales = ring_scales(_tip_size(inputs, feature, box) / box.largest, inputs.grading)
    star.ring_ratio = scales[-1] / scales[-2]
    levels = add_levels(cells.add_vertex, feature.centre, star.points, scales, star.vertices)
    star.left = [level[0] for level in levels]
    star.right = [level[-1] for level in levels]
    if inputs.layout == "tip":
        star.tip_cell = cells.add_cell(levels[0], centre=feature.centre, closed=False)
        add_rings(cells, levels, False, skeleton.chain)
        return
    tip = cells.add_vertex(*feature.centre)
    star.left.insert(0, tip)
    star.right.insert(0, tip)
    _fill_quadrants(skeleton, star, levels, tip)


def _fill_quadrants(skeleton: Skeleton, star: Star, levels: list[list[int]], tip: int) -> None:
    """The paper's layout: closed cells that meet in the tip, cut apart along the horizontal through it and
    the ligament.
    """
    points, (x, y) = star.points, star.feature.centre
    # Cuts go through the outline's vertices nearest to the three directions; near a face there is no cut.
    angle = np.unwrap(np.arctan2(points[:, 1] - y, points[:, 0] - x))
    cuts = [0]
    for wanted in (math.pi, 1.5 * math.pi, 2 * math.pi):
        wanted += 2 * math.pi * round((angle.mean() - 1.5 * math.pi) / (2 * math.pi))
        nearest = int(np.abs(angle - wanted).argmin())
        if abs(angle[nearest] - wanted) < math.radians(30) and cuts[-1] < nearest < len(points) - 1:
            cuts.append(nearest)
    cuts.append(len(points) - 1)
    for first, last in zip(cuts, cuts[1:]):
        rim = []
        for i in range(first, last):
            rim += [star.vertices[i], *skeleton.between(star.vertices[i], star.vertices[i + 1])]
        out = [level[first] for level in levels[:-1]]
        back = [level[last] for level in levels[::-1]]
        skeleton.cells.add_cell([tip, *out, *rim, *back])


def _divide_faces(skeleton: Skeleton, stars: list[Star]) -> None:
    """Shorter edges on the faces of notches, at equal fractions of both."""
    cells, inputs = skeleton.cells, skeleton.inputs
    wanted, counts = [], []
    for star in stars:
        longest = inputs.face_size or star.feature.notch.length / inputs.face_edges
        for pair in zip(zip(star.right, star.right[1:]), zip(star.left, star.left[1:])):
            wanted.append(pair)
            counts.append(math.ceil(max(cells.edge_length(*edge) for edge in pair) / longest - 1e-6))
    inserted = divide_faces(cells, wanted, counts)
    for star in stars:
        star.right, star.left = (with_inserted(face, inserted) for face in (star.right, star.left))


def _record_crack(skeleton: Skeleton, star: Star) -> None:
    cells, notch, index = skeleton.cells, star.feature.notch, star.feature.index
    right, left = (list(zip(face, face[1:])) for face in (star.right, star.left))
    name, suffix = f"crack{index + 1}", str(index + 1) if index else ""
    tip = TipCell(star.feature.centre, notch.axis, math.radians(notch.opening), star.tip_cell)
    cells.cracks.append(CrackFaces(name, [FacePath(right, left, tip)], notch.length))
    cells.edge_sets[f"{name}_right"], cells.edge_sets[f"{name}_left"] = right, left
    cells.points[f"B{suffix}"], cells.points[f"C{suffix}"] = star.right[-1], star.left[-1]


def _record_edge_sets(skeleton: Skeleton) -> None:
    """Sort the outline's edges into the beam's four edges; holes and faces are known already."""
    cells, beam = skeleton.cells, skeleton.beam
    known = {edge_key(edge) for edges in cells.edge_sets.values() for edge in edges}
    sides = {"left": (0, 0.0), "right": (0, beam.length), "bottom": (1, 0.0), "top": (1, beam.height)}
    sets: dict[str, list[tuple[int, int]]] = {name: [] for name in sides}
    for edge, uses in cells.edge_uses().items():
        if uses == 1 and edge not in known:
            ends = [cells.vertices[v] for v in edge]
            name = next(
                (n for n, (axis, value) in sides.items() if all(end[axis] == value for end in ends)), None
            )
            if name is None:
                raise RuntimeError(
                    f"beam: the cells do not fit together between {ends[0]} and {ends[1]}; please report "
                    "this geometry."
                )
            sets[name].append(edge)
    cells.edge_sets = sets | cells.edge_sets
