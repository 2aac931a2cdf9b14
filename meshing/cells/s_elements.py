"""Cells to S-elements: GLL nodes on the true curves, scaling centres, star-convexity, contact pairs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from meshing.boundary_mesh import BoundaryMesh, Recipe
from meshing.cells.complex import Cell, CellComplex, CrackFaces, Edge, edge_key
from meshing.cells.contact_faces import crack_pairs, join_pairs, without_doubles
from meshing.gll import gll_nodes, lagrange_slopes, lagrange_values
from meshing.mesh_arrays import Crack, Tip
from meshing.vectors import cross

# Distance of the scaling centre from the nearest tangent of the outline, relative to the square root of the
# cell's area: a centroid with less than the first is worth a search in the kernel, less than the second is no
# admissible centre.
_COMFORTABLE = 0.08
_ADMISSIBLE = 1e-3


def build_mesh(
    cells: CellComplex,
    order: int,
    origin: str = "mesh",
    *,
    clamped: str | None = None,
    recipe: Recipe | None = None,
) -> BoundaryMesh:
    """Turn cells into S-elements.

    Parameters
    ----------
    cells : CellComplex
    order : int
        Polynomial order of the edges.
    origin : str
        What is being meshed, for messages.
    clamped : str, optional
        Edge set that a model holds fixed unless told otherwise.
    recipe : Recipe, optional
        How the mesh can be made again.

    Returns
    -------
    BoundaryMesh

    Raises
    ------
    ValueError
        A cell is not star-convex from any centre, or the faces of a crack do not match.
    """
    middles = [np.mean([cells.vertices[v][0] for v in cell.vertices]) for cell in cells.cells]
    sequence = np.argsort(middles, kind="stable")
    ordered = [cells.cells[i] for i in sequence]
    directed = [edge for cell in ordered for edge in cell.edges()]
    edge_number = {key: number for number, key in enumerate(dict.fromkeys(map(edge_key, directed)))}
    nodes, edge_nodes, node_of_vertex = _numbered(cells, edge_number, order)
    flat = np.array([edge_number[edge_key(edge)] for edge in directed])
    backwards = np.array([first > last for first, last in directed])
    start = np.cumsum([0, *(len(cell.edges()) for cell in ordered)])
    centres = _scaling_centres(ordered, nodes[edge_nodes[flat]], backwards, start, origin)
    element_of_cell = np.argsort(sequence)

    def nodes_of(edge: Edge) -> np.ndarray:
        return edge_nodes[edge_number[edge_key(edge)], :: 1 if edge[0] < edge[1] else -1]

    cracks, tips, pairs = [], [], []
    for index, faces in enumerate(cells.cracks):
        found, length = crack_pairs(faces, nodes_of, nodes, index)
        pairs.append(found)
        tips_here = _tips(faces, index, element_of_cell)
        cracks.append(_crack(faces, tips_here, length, nodes_of, nodes))
        tips += tips_here
    return BoundaryMesh(
        order=order,
        nodes=nodes,
        edges=edge_nodes,
        element_start=start,
        element_edges=flat,
        element_reversed=backwards,
        scaling_centres=centres,
        closed=np.array([cell.closed for cell in ordered]),
        materials=np.array([cell.material for cell in ordered]),
        sector_materials={
            number: np.array(cell.sectors) for number, cell in enumerate(ordered) if cell.sectors is not None
        },
        material_names=tuple(cells.materials),
        edge_sets={
            name: np.sort(np.array([edge_number[edge_key(edge)] for edge in own], int))
            for name, own in cells.edge_sets.items()
        },
        points={name: node_of_vertex[vertex] for name, vertex in cells.points.items()},
        pairs=without_doubles(join_pairs(pairs)),
        cracks=tuple(cracks),
        tips=tuple(tips),
        clamped=clamped,
        recipe=recipe,
    )


def _numbered(
    cells: CellComplex, edges: Iterable[Edge], order: int
) -> tuple[np.ndarray, np.ndarray, dict[int, int]]:
    """Coordinates of all nodes, m, nodes of each edge, and the node of each vertex."""
    parameter = 0.5 * (gll_nodes(order) + 1.0)
    coordinates: list[tuple[float, float]] = []
    node_of_vertex: dict[int, int] = {}
    edge_nodes: list[list[int]] = []
    for key in edges:
        for vertex in key:
            if vertex not in node_of_vertex:
                node_of_vertex[vertex] = len(coordinates)
                coordinates.append(cells.vertices[vertex])
        inner = range(len(coordinates), len(coordinates) + order - 1)
        coordinates.extend(map(tuple, _edge_points(cells, key, parameter)[1:-1]))
        edge_nodes.append([node_of_vertex[key[0]], *inner, node_of_vertex[key[1]]])
    return np.array(coordinates), np.array(edge_nodes), node_of_vertex


def _tips(faces: CrackFaces, index: int, element_of_cell: np.ndarray) -> list[Tip]:
    """Tips of a crack, sorted and named."""
    sets = (f"{faces.name}_left", f"{faces.name}_right")
    found = [(tip, sets if tip is path.start else sets[::-1]) for path in faces.paths for tip in path.tips]
    found.sort(key=lambda item: item[0].position)
    tips = []
    for number, (tip, names) in enumerate(found, 1):
        name = faces.name if len(found) == 1 else f"{faces.name}:{number}"
        element = int(element_of_cell[tip.cell]) if tip.cell >= 0 else -1
        tips.append(Tip(name, index, tip.position, tip.axis, tip.opening, element, names, tip.arc))
    return tips


def _crack(faces: CrackFaces, tips: list[Tip], length: float, nodes_of, nodes: np.ndarray) -> Crack:
    if tips:
        tip = tips[0]
        return Crack(faces.name, tip.position, tip.axis, tip.opening, length, tip.element)
    start = nodes[nodes_of(faces.paths[0].right[0])]
    step = start[-1] - start[0]
    return Crack(faces.name, tuple(start[0]), tuple(step / np.hypot(*step)), 0.0, length, -1)


def _edge_points(cells: CellComplex, key: tuple[int, int], parameter: np.ndarray) -> np.ndarray:
    """Points of an edge at parameters in [0, 1]."""
    if key in cells.curves:
        return cells.curves[key](parameter)
    first, last = (np.array(cells.vertices[v]) for v in key)
    # Weighted from both ends, so that an edge and its mirror image get mirrored nodes to the last digit.
    return parameter[::-1, None] * first + parameter[:, None] * last


def _scaling_centres(
    cells: list[Cell], x: np.ndarray, backwards: np.ndarray, start: np.ndarray, origin: str
) -> np.ndarray:
    """Centre of each S-element, from which its whole outline is visible: the prescribed one (a tip), the
    centroid if it sees the outline well, else a point of the kernel.

    Parameters
    ----------
    cells : list of Cell
    x : (uses, p + 1, 2) array
        Nodes of their edges, one cell after the other, m.
    backwards : (uses,) bool array
        Edges that the cell runs through from their last node.
    start : (cells + 1,) array
        Where each cell's edges begin.
    origin : str
        What is being meshed, for messages.

    Raises
    ------
    ValueError
        No point, or not the prescribed one, sees the whole outline.
    """
    points, tangents, first = _outlines(x, backwards, start)
    count = np.diff([*first, len(points)])
    owner = np.repeat(np.arange(len(cells)), count)
    middle = np.add.reduceat(points, first) / count[:, None]
    local, length = points - middle[owner], np.hypot(*tangents.T)
    following = np.roll(local, -1, axis=0)
    following[first + count - 1] = local[first]
    swept = cross(local, following)
    given = np.array([i for i, cell in enumerate(cells) if cell.centre is not None], int)
    tips = np.array([cells[i].centre for i in given]).reshape(-1, 2) - middle[given]
    for i, tip in zip(given, tips):  # the outline passes through the centre
        end = first[i] + count[i] - 1
        swept[end] = cross(local[end], tip) + cross(tip, local[first[i]])
    area = 0.5 * np.add.reduceat(swept, first)
    extent = np.maximum.reduceat(local, first) - np.minimum.reduceat(local, first)
    where = [f"{origin}: cell near ({mx:.6g}, {my:.6g}) m" for mx, my in middle.tolist()]
    wrong = (np.minimum.reduceat(length, first) == 0.0) | (area <= 1e-12 * extent.max(axis=1) ** 2)
    for i in np.flatnonzero(wrong):
        raise ValueError(
            f"{where[i]} is inverted or degenerate (area {area[i]:.3g} m2); mend the mesh there."
        )
    unit = tangents / length[:, None]

    def sight(centre: np.ndarray, of: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Least distance of centres, one for each row of `of`, from the tangents in these rows."""
        return np.minimum.reduceat(cross(local[of] - centre, unit[of]), starts)

    centre = np.add.reduceat((local + following) * swept[:, None], first) / (6 * area[:, None])
    centre[given] = tips
    everything = np.arange(len(points))
    seen = sight(centre[owner], everything, first) / np.sqrt(area)
    for i in given[seen[given] < _ADMISSIBLE]:
        tip = tips[given == i][0] + middle[i]
        raise ValueError(
            f"{where[i]} does not see its whole outline from the crack tip ({tip[0]:.6g}, {tip[1]:.6g}); "
            "refine the mesh there."
        )
    for i in np.flatnonzero(seen < _COMFORTABLE):
        own = everything[first[i] : first[i] + count[i]]
        kernel = _kernel(local[own], unit[own]) if cells[i].centre is None else np.zeros((0, 2))
        if len(kernel):
            candidate = kernel.mean(axis=0)
            found = sight(candidate, own, np.zeros(1, int))[0] / np.sqrt(area[i])
            if found > seen[i]:
                centre[i], seen[i] = candidate, found
        if seen[i] < _ADMISSIBLE:
            raise ValueError(
                f"{where[i]} is not star-convex: no point sees its whole outline; split the cell or "
                "straighten its edges."
            )
    return middle + centre


def _outlines(
    x: np.ndarray, backwards: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of the outlines of all cells, the outlines' directions there (any length), and where each cell's
    begin; of a straight edge one point is enough.
    """
    order = x.shape[1] - 1
    at = np.unique(np.concatenate([gll_nodes(order), np.polynomial.legendre.leggauss(order + 3)[0]]))
    values, slopes = (evaluate(gll_nodes(order), at) for evaluate in (lagrange_values, lagrange_slopes))
    ahead = np.where(backwards, -1, 1)
    chord = x[:, -1] - x[:, 0]
    parameter = 0.5 * (gll_nodes(order) + 1.0)
    straight = x[:, :1] + parameter[:, None] * chord[:, None, :]
    curved = np.abs(x - straight).max(axis=(1, 2)) > 1e-10 * np.hypot(*chord.T)
    count = np.where(curved, len(at), 1)
    use = np.repeat(np.arange(len(x)), count)
    # of the edge as it is, from which its two cells must have the same
    points, tangents = x[use, np.where(backwards, -1, 0)[use]], 0.5 * (ahead[:, None] * chord)[use]
    shape, slope = values @ x[curved], ahead[curved, None, None] * (slopes @ x[curved])
    turned = backwards[curved]
    shape[turned], slope[turned] = shape[turned, ::-1], slope[turned, ::-1]
    points[curved[use]], tangents[curved[use]] = shape.reshape(-1, 2), slope.reshape(-1, 2)
    return points, tangents, np.concatenate([[0], np.cumsum(count)])[start[:-1]]


def _kernel(points: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """Corners of the set of points that lie to the left of every tangent; empty if there is none."""
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    corners = np.array([(left, low), (right, low), (right, high), (left, high)])
    for point, direction in zip(points, unit):
        here = cross(direction, corners - point)
        if here.min() >= 0:
            continue
        there, steps = np.roll(here, -1), np.roll(corners, -1, axis=0) - corners
        crossed = (here >= 0) != (there >= 0)
        share = np.divide(here, here - there, out=np.zeros(len(here)), where=crossed)
        both = np.stack([corners, corners + share[:, None] * steps], axis=1)
        corners = both[np.stack([here >= 0, crossed], axis=1)]
        if len(corners) < 3:
            return np.zeros((0, 2))
    return corners
