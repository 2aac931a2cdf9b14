"""A plate with holes and cracks to cells."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from meshing.cells.arrangement import Arrangement, CrackPath, arrange
from meshing.cells.complex import CellComplex
from meshing.cells.crack_meshing import CrackMeshing
from meshing.cells.crack_opening import open_cracks
from meshing.cells.crack_splitting import add_cracks
from meshing.cells.region import RegionPlan, divide_circle, divide_line, fill_region, plan_region
from meshing.shapes.plate_shape import PlateShape


def plate_cells(
    plate: PlateShape, size: float, points: Mapping[str, tuple[float, float]], meshing: CrackMeshing
) -> CellComplex:
    """Divide a plate into cells.

    Parameters
    ----------
    size : float
        Largest edge, m.
    points : mapping of str to (x, y)
        Named points, m.
    meshing : CrackMeshing
    """
    holes = [((hole.x, hole.y), hole.radius) for hole in plate.holes]
    # From the tip, as everything that is numbered along a crack.
    cracks = [
        CrackPath(name, np.array(crack.points[::-1]))
        for name, crack in zip(plate.crack_names(), plate.cracks)
    ]
    body = arrange(np.array(plate.outline), holes, cracks, points)
    plan = plan_region(body, size)
    cells = CellComplex()
    vertex_of: dict[int, int] = {}
    loop: list[int] = []
    for name, side in zip(plate.side_names, body.sides):
        chain = divide_side(cells, body, plan, side, vertex_of)
        cells.edge_sets.setdefault(name, []).extend(zip(chain, chain[1:]))
        loop += chain[:-1]
    loops = [loop]
    for number in range(len(body.circles)):
        loops.append(add_circle(cells, body, plan, number, vertex_of))
        cells.edge_sets[f"hole{number + 1}"] = list(zip(loops[-1], loops[-1][1:] + loops[-1][:1]))
    lines = fill_region(cells, loops, body, plan, vertex_of)
    cells.points = {name: vertex_of[vertex] for name, vertex in body.points.items()}
    groups = {f"crack:{crack.name}": list(zip(line, line[1:])) for crack, line in zip(cracks, lines)}
    add_cracks(cells, groups, meshing, "plate")
    open_cracks(cells, {name: crack.opening for name, crack in zip(plate.crack_names(), plate.cracks)})
    return cells


def divide_side(
    cells: CellComplex,
    body: Arrangement,
    plan: RegionPlan,
    side: list[int],
    vertex_of: dict[int, int],
) -> list[int]:
    """Vertices of cells along a side of the outline."""
    for vertex in side:
        if vertex not in vertex_of:
            vertex_of[vertex] = cells.add_vertex(*body.vertices[vertex])
    chain = [vertex_of[side[0]]]
    for a, b in zip(side, side[1:]):
        start, stop = (np.array(body.vertices[v]) for v in (a, b))
        chain += [cells.add_vertex(*place) for place in divide_line(start, stop, plan.sizes)]
        chain.append(vertex_of[b])
    return chain


def add_circle(
    cells: CellComplex, body: Arrangement, plan: RegionPlan, number: int, vertex_of: dict[int, int]
) -> list[int]:
    """Vertices of cells on a hole, joined by arcs."""
    centre, radius, fixed = body.circles[number]
    known = {body.vertices[v]: v for v in fixed}
    loop = []
    for angle, point in divide_circle(centre, radius, list(known), plan.sizes):
        place = point or (centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle))
        loop.append(cells.add_vertex(*place))
        if point:
            vertex_of[known[point]] = loop[-1]
    for first, last in zip(loop, loop[1:] + loop[:1]):
        cells.add_arc(first, last, centre, radius)
    return loop
