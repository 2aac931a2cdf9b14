"""Cells to S-elements: GLL nodes on the true curves, scaling centres, star-convexity, contact pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from meshing.boundary_mesh import BoundaryMesh, Crack, Tip
from meshing.cells.complex import CellComplex, CrackFaces, edge_key
from meshing.cells.contact_faces import crack_pairs, join_pairs, without_doubles
from meshing.gll import gll_nodes, lagrange_slopes, lagrange_values
from meshing.recipe import Recipe

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
    sequence = np.argsort([_middle(cells, cell.vertices)[0] for cell in cells.cells], kind="stable")
    parameter = 0.5 * (gll_nodes(order) + 1.0)
    coordinates: list[tuple[float, float]] = []
    node_of_vertex: dict[int, int] = {}
    edge_number: dict[tuple[int, int], int] = {}
    edges: list[list[int]] = []
    starts, used, turned = [0], [], []

    def vertex_node(vertex: int) -> int:
        if vertex not in node_of_vertex:
            node_of_vertex[vertex] = len(coordinates)
            coordinates.append(cells.vertices[vertex])
        return node_of_vertex[vertex]

    for number in sequence:
        for edge in cells.cells[number].edges():
            key = edge_key(edge)
            if key not in edge_number:
                first, last = vertex_node(key[0]), vertex_node(key[1])
                inner = range(len(coordinates), len(coordinates) + order - 1)
                coordinates.extend(map(tuple, _edge_points(cells, key, parameter)[1:-1]))
                edge_number[key] = len(edges)
                edges.append([first, *inner, last])
            used.append(edge_number[key])
            turned.append(key != edge)
        starts.append(len(used))

    nodes, edge_nodes = np.array(coordinates), np.array(edges)
    outlines = _Outlines(np.array(used), np.array(turned), np.array(starts))
    flat, backwards, start = outlines
    centres = _scaling_centres([cells.cells[i] for i in sequence], nodes, edge_nodes, outlines, origin)
    element_of_cell = np.argsort(sequence)

    def numbers(pairs: list[tuple[int, int]]) -> np.ndarray:
        return np.array([edge_number[edge_key(pair)] for pair in pairs], dtype=int)

    def nodes_of(edge: tuple[int, int]) -> np.ndarray:
        key = edge_key(edge)
        return edge_nodes[edge_number[key]] if key == edge else edge_nodes[edge_number[key]][::-1]

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
        closed=np.array([cells.cells[i].closed for i in sequence]),
        materials=np.array([cells.cells[i].material for i in sequence]),
        sector_materials={
            number: np.array(cells.cells[i].sectors)
            for number, i in enumerate(sequence)
            if cells.cells[i].sectors is not None
        },
        material_names=tuple(cells.materials),
        edge_sets={name: np.sort(numbers(pairs_of_set)) for name, pairs_of_set in cells.edge_sets.items()},
        points={name: node_of_vertex[vertex] for name, vertex in cells.points.items()},
        pairs=without_doubles(join_pairs(pairs)),
        cracks=tuple(cracks),
        tips=tuple(tips),
        clamped=clamped,
        recipe=recipe,
    )


def _tips(faces: CrackFaces, index: int, element_of_cell: np.ndarray) -> list[Tip]:
    """Tips of a crack, sorted and named."""
    sets = (f"{faces.name}_left", f"{faces.name}_right")
    found = [(path.start, sets) for path in faces.paths if path.start]
    found += [(path.end, sets[::-1]) for path in faces.paths if path.end]
    found.sort(key=lambda item: item[0].position)
    return [
        Tip(
            faces.name if len(found) == 1 else f"{faces.name}:{number}",
            index,
            (tip.position[0], tip.position[1]),
            (tip.axis[0], tip.axis[1]),
            tip.opening,
            int(element_of_cell[tip.cell]) if tip.cell >= 0 else -1,
            face_sets,
            tip.arc,
        )
        for number, (tip, face_sets) in enumerate(found, 1)
    ]


def _crack(faces: CrackFaces, tips: list[Tip], length: float, nodes_of, nodes: np.ndarray) -> Crack:
    if tips:
        tip = tips[0]
        return Crack(faces.name, tip.position, tip.axis, tip.opening, length, tip.element)
    start = nodes[nodes_of(faces.paths[0].right[0])]
    step = start[-1] - start[0]
    return Crack(faces.name, tuple(start[0]), tuple(step / np.hypot(*step)), 0.0, length, -1)


def _middle(cells: CellComplex, vertices: list[int]) -> np.ndarray:
    return np.mean([cells.vertices[v] for v in vertices], axis=0)


def _edge_points(cells: CellComplex, key: tuple[int, int], parameter: np.ndarray) -> np.ndarray:
    """Points of an edge at parameters in [0, 1]."""
    if key in cells.curves:
        return cells.curves[key](parameter)
    first, last = (np.array(cells.vertices[v]) for v in key)
    # Weighted from both ends, so that an edge and its mirror image get mirrored nodes to the last digit.
    return parameter[::-1, None] * first + parameter[:, None] * last


class _Outlines(NamedTuple):
    """Edges of one S-element after the other, whether they run backwards, where each S-element starts."""

    edges: np.ndarray
    backwards: np.ndarray
    start: np.ndarray


def _scaling_centres(elements, nodes, edges, outlines: _Outlines, origin: str) -> np.ndarray:
    """Centre of each S-element, after the check that it sees the whole outline."""
    flat, backwards, start = outlines
    order = edges.shape[1] - 1
    at = np.unique(np.concatenate([gll_nodes(order), np.polynomial.legendre.leggauss(order + 3)[0]]))
    values, slopes = (evaluate(gll_nodes(order), at) for evaluate in (lagrange_values, lagrange_slopes))
    chord = nodes[edges[:, -1]] - nodes[edges[:, 0]]
    parameter = 0.5 * (gll_nodes(order) + 1.0)
    straight = nodes[edges[:, 0]][:, None, :] + parameter[None, :, None] * chord[:, None, :]
    curved = np.abs(nodes[edges] - straight).max(axis=(1, 2)) > 1e-10 * np.hypot(*chord.T)
    centres = np.empty((len(elements), 2))
    for number, element in enumerate(elements):
        points, tangents = [], []
        for edge, backward in zip(
            flat[start[number] : start[number + 1]], backwards[start[number] : start[number + 1]]
        ):
            sign = -1.0 if backward else 1.0
            if curved[edge]:
                points.append(values @ nodes[edges[edge]])
                tangents.append(sign * (slopes @ nodes[edges[edge]]))
                if backward:
                    points[-1], tangents[-1] = points[-1][::-1], tangents[-1][::-1]
            else:
                points.append(nodes[edges[edge, [-1 if backward else 0]]])
                tangents.append(sign * 0.5 * chord[edge][None, :])
        centres[number] = find_centre(np.vstack(points), np.vstack(tangents), element.centre, origin)
    return centres


def find_centre(
    points: np.ndarray, tangents: np.ndarray, prescribed: tuple[float, float] | None, origin: str
) -> np.ndarray:
    """Scaling centre from which the whole outline is visible.

    Parameters
    ----------
    points, tangents : (n, 2) array
        Points of the outline, counter-clockwise, m, and the outline's direction there (any length). For
        straight edges one point is enough.
    prescribed : (x, y) or None
        The centre to be checked (a crack tip); None: the centroid if it sees the outline well, else a point
        of the kernel.
    origin : str
        What is being meshed, for messages.

    Returns
    -------
    (2,) array
        m.

    Raises
    ------
    ValueError
        No point, or not the prescribed one, sees the whole outline.
    """
    middle = points.mean(axis=0)
    local = points - middle
    length = np.hypot(*tangents.T)
    outline = local if prescribed is None else np.vstack([local, np.subtract(prescribed, middle)])
    following = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]
    area = 0.5 * cross.sum()
    where = f"{origin}: cell near ({middle[0]:.6g}, {middle[1]:.6g})"
    if not length.all() or area <= 1e-12 * np.ptp(local, axis=0).max() ** 2:
        raise ValueError(f"{where} m is inverted or degenerate (area {area:.3g} m2); mend the mesh there.")
    unit = tangents / length[:, None]
    scale = np.sqrt(area)

    def sight(centre: np.ndarray) -> float:
        return float(
            (((local[:, 0] - centre[0]) * unit[:, 1] - (local[:, 1] - centre[1]) * unit[:, 0]).min()) / scale
        )

    if prescribed is not None:
        if sight(np.subtract(prescribed, middle)) < _ADMISSIBLE:
            raise ValueError(
                f"{where} m does not see its whole outline from the crack tip ({prescribed[0]:.6g}, "
                f"{prescribed[1]:.6g}); refine the mesh there."
            )
        return np.array(prescribed, float)
    centroid = (outline + following).T @ cross / (6 * area)
    best, best_sight = centroid, sight(centroid)
    if best_sight < _COMFORTABLE:
        kernel = _kernel(local, unit)
        if len(kernel):
            candidate = kernel.mean(axis=0)
            if sight(candidate) > best_sight:
                best, best_sight = candidate, sight(candidate)
    if best_sight < _ADMISSIBLE:
        raise ValueError(
            f"{where} m is not star-convex: no point sees its whole outline; split the cell or straighten "
            "its edges."
        )
    return middle + best


def _kernel(points: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """Corners of the set of points that lie to the left of every tangent; empty if there is none."""
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    for point, direction in zip(points, unit):
        side = direction[0] * (corners[:, 1] - point[1]) - direction[1] * (corners[:, 0] - point[0])
        if side.min() >= 0:
            continue
        kept = []
        for i, (here, there) in enumerate(zip(side, np.roll(side, -1))):
            following = corners[(i + 1) % len(corners)]
            if here >= 0:
                kept.append(corners[i])
            if (here >= 0) != (there >= 0):
                kept.append(corners[i] + here / (here - there) * (following - corners[i]))
        if len(kept) < 3:
            return np.zeros((0, 2))
        corners = np.array(kept)
    return corners
