"""A square plate of rows and columns of cells with horizontal cracks along their lines, by whole arrays.

A million unknowns take a second, and gmsh minutes. Cells are convex quadrilaterals: vertices between crack
lines and outline are moved at random, so that no two cells are alike. A tip is a vertex of four closed cells:
displacements and contact forces converge more slowly there than around a tip's own S-element.
"""

from __future__ import annotations

import math

import numpy as np

from meshing import BoundaryMesh
from meshing.gll import gll_nodes
from meshing.mesh_arrays import ContactPairs, Crack, Tip


def structured_plate(
    unknowns: int, *, cracks: int = 10, order: int = 5, distortion: float = 0.15, seed: int = 0
) -> BoundaryMesh:
    """A plate of 1 m with about so many displacement unknowns.

    Parameters
    ----------
    unknowns : int
    cracks : int
        At random places, at most one in each field of a board.
    order : int
    distortion : float
        Largest movement of a vertex, of the size of a cell; 0: equal squares.
    seed : int

    Returns
    -------
    BoundaryMesh
        Edge sets "edge1" (bottom, counter-clockwise on) to "edge4", "crack1_left", "crack1_right", ...

    Raises
    ------
    ValueError
        If there are too few cells for the cracks.
    """
    side = max(4, round(math.sqrt(unknowns / (4 * order - 2))))
    generator = np.random.default_rng(seed)
    lines = _lines(cracks, side, generator)
    size = side + 1
    x, y = np.meshgrid(np.arange(size) / side, np.arange(size) / side)  # rows upwards
    moved = distortion / side * generator.uniform(-1.0, 1.0, (2, size, size))
    held = np.zeros((size, size), dtype=bool)
    held[[0, -1]] = held[:, [0, -1]] = True
    below = np.arange(size * size).reshape(size, size)
    above, count = below.copy(), size * size
    for row, first, last in lines:
        held[row, first : last + 1] = True
        above[row, first + 1 : last] = count + np.arange(last - first - 1)
        count += last - first - 1
    moved[:, held] = 0.0
    vertices = np.empty((count, 2))
    for number in (below, above):
        vertices[number] = np.stack([x + moved[0], y + moved[1]], axis=-1)

    # edges along the rows as the cells below see them, those of cracks again as the cells above do, columns
    lower = np.stack([below[:, :-1], below[:, 1:]], axis=-1)
    upper = np.stack([above[:, :-1], above[:, 1:]], axis=-1)
    along = np.arange(lower[..., 0].size).reshape(size, side)
    again = along.copy()
    faces = [(np.full(b - a, row), np.arange(a, b)) for row, a, b in lines]
    total = along.size
    for rows, columns in faces:
        again[rows, columns] = total + np.arange(len(columns))
        total += len(columns)
    across = total + np.arange(side * size).reshape(side, size)
    ends = np.empty((total + across.size, 2), dtype=int)
    ends[along], ends[again] = lower, upper
    for rows, columns in faces:
        ends[again[rows, columns]] = upper[rows, columns]
        ends[along[rows, columns]] = lower[rows, columns]
    ends[across] = np.stack([above[:-1], below[1:]], axis=-1)

    fraction = 0.5 * (1.0 + gll_nodes(order))[1:-1, None]
    inner = vertices[ends[:, 0], None] * (1.0 - fraction) + vertices[ends[:, 1], None] * fraction
    inner_numbers = count + np.arange(inner.shape[0] * (order - 1)).reshape(-1, order - 1)
    edges = np.concatenate([ends[:, :1], inner_numbers, ends[:, 1:]], axis=1)
    nodes = np.concatenate([vertices, inner.reshape(-1, 2)])
    loops = np.stack([again[:-1], across[:, 1:], along[1:], across[:, :-1]], axis=-1).reshape(-1, 4)
    cells = len(loops)
    corners = np.stack([above[:-1, :-1], above[:-1, 1:], below[1:, 1:], below[1:, :-1]], axis=-1)
    sets = {"edge1": along[0], "edge2": across[:, -1], "edge3": along[-1], "edge4": across[:, 0]}
    named, tips, pairs = [], [], []
    for k, (rows, columns) in enumerate(faces):
        name = f"crack{k + 1}"
        # looking from the first tip along the crack, the right hand is below
        right, left = along[rows, columns], again[rows, columns]
        sets[f"{name}_right"], sets[f"{name}_left"] = right, left
        start, end = (_place(vertices[v]) for v in (ends[right[0], 0], ends[right[-1], 1]))
        length = end[0] - start[0]
        named.append(Crack(name, start, (1.0, 0.0), 0.0, length, -1))
        both = (f"{name}_left", f"{name}_right")
        tips.append(Tip(f"{name}:1", k, start, (1.0, 0.0), 0.0, -1, both, (0.0, 0.0)))
        tips.append(Tip(f"{name}:2", k, end, (-1.0, 0.0), 0.0, -1, both[::-1], (length, length)))
        pairs.append(_pairs(edges[right], edges[left], nodes, k))
    return BoundaryMesh(
        order,
        nodes,
        edges,
        4 * np.arange(cells + 1),
        loops.ravel(),
        np.tile([False, False, True, True], cells),
        vertices[corners.reshape(-1, 4)].mean(axis=1),
        np.ones(cells, dtype=bool),
        np.zeros(cells, dtype=int),
        ("material",),
        sets,
        {},
        ContactPairs(*(np.concatenate([part[i] for part in pairs]) for i in range(7))) if pairs else _none(),
        tuple(named),
        tuple(tips),
    )


def _lines(cracks: int, side: int, generator: np.random.Generator) -> list[tuple[int, int, int]]:
    """Row, first and last column of each crack."""
    board = max(1, math.ceil(math.sqrt(cracks)))
    if side < 6 * board:
        raise ValueError(f"{cracks} cracks need at least {6 * board} rows of cells, but there are {side}")
    found = []
    for field in generator.permutation(board * board)[:cracks]:
        row, column = divmod(int(field), board)
        middle = (np.array([row, column]) + generator.uniform(0.4, 0.6, 2)) * side / board
        half = generator.uniform(0.2, 0.35) * side / board
        ends = round(middle[1] - half), round(middle[1] + half)
        found.append((round(middle[0]), ends[0], max(ends[1], ends[0] + 2)))
    return found


def _pairs(right: np.ndarray, left: np.ndarray, nodes: np.ndarray, crack: int) -> tuple[np.ndarray, ...]:
    """Columns of `ContactPairs` of the edges of a crack's faces, tips left out."""
    at = gll_nodes(right.shape[1] - 1)
    length = nodes[right[:, -1], 0] - nodes[right[:, 0], 0]
    order = len(at) - 1
    weights = 2.0 / (order * (order + 1) * np.polynomial.legendre.legval(at, [0.0] * order + [1.0]) ** 2)
    spread = 0.5 * length[:, None] * weights
    # edges follow one another: each vertex between two of them is one pair
    numbers = np.concatenate([right[:, :-1].ravel(), right[-1:, -1]])
    others = np.concatenate([left[:, :-1].ravel(), left[-1:, -1]])
    weight = np.concatenate([spread[:, :-1].ravel(), spread[-1:, -1]])
    weight[order::order][: len(spread) - 1] += spread[:-1, -1]
    arc = nodes[numbers, 0] - nodes[numbers[0], 0]
    inside = slice(1, -1)
    count = len(numbers) - 2
    return (
        np.stack([numbers, others], axis=1)[inside],
        np.tile([0.0, -1.0], (count, 1)),
        np.zeros(count),
        np.full(count, crack),
        (arc / arc[-1])[inside],
        arc[inside],
        weight[inside],
    )


def _place(vertex: np.ndarray) -> tuple[float, float]:
    return float(vertex[0]), float(vertex[1])


def _none() -> ContactPairs:
    empty, whole = np.zeros(0), np.zeros(0, dtype=int)
    return ContactPairs(np.zeros((0, 2), dtype=int), np.zeros((0, 2)), empty, whole, empty, empty, empty)
