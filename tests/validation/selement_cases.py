"""Examples of the book on the method, whose S-elements have two-node edges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import sbfem_petsc as sb
from meshing.boundary_mesh import BoundaryMesh
from meshing.mesh_arrays import ContactPairs
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import SElement, solve_selement
from tests.validation.page import Row, case

BOOK = "Song, The Scaled Boundary Finite Element Method (Wiley 2018), "
PRINTED = "four digits are printed"


def exponents(element: SElement) -> np.ndarray:
    """Of the radial displacements, falling."""
    return np.sort(np.linalg.eigvals(element.radial).real)[::-1]


@case("Square S-element", BOOK + "example 3.1: corners (+-1, +-1), E = 10, nu = 0, rho = 2.")
def square() -> Iterator[Row]:
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    element = solve_selement(Sectors(corners, 1, sb.Material(1.0, 0.0, 1.0).elasticity), True, 0)
    for name, value, printed in (
        ("K11", 10 * element.stiffness[0, 0], 4.8936),
        ("K12", 10 * element.stiffness[0, 1], 1.2500),
        ("K13", 10 * element.stiffness[0, 2], -2.3936),
        ("M11", 2 * element.mass[0, 0], 0.8954),
        ("largest exponent", exponents(element)[0], 1.915),
    ):
        yield Row(name, printed, float(value), 1e-4, note=PRINTED)
    yield Row("exponent of uniform strain", 1.0, float(exponents(element)[2]), 1e-9)


@case("Pentagon S-element", BOOK + "example 3.2: regular, radius 1, nu = 0.")
def pentagon() -> Iterator[Row]:
    angle = np.deg2rad(-126.0 + 72.0 * np.arange(5))
    corners = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = exponents(solve_selement(Sectors(corners, 1, sb.Material(1.0, 0.0, 1.0).elasticity), True, 0))
    yield Row("exponents 1 and 2", 2.1922, float(found[:2].mean()), 1e-4, note=PRINTED)
    yield Row("exponents 3 and 4", 2.1731, float(found[2:4].mean()), 1e-4, note=PRINTED)
    yield Row("exponents 5 to 8", 1.0, float(found[4:8].mean()), 1e-9)


def two_node_mesh(nodes, cells, centres, closed, edge_sets, points) -> BoundaryMesh:
    """S-elements of straight edges, each a list of nodes in counter-clockwise order."""
    edges: dict[tuple[int, int], int] = {}
    flat, turned, starts = [], [], [0]
    for cell, loop in zip(cells, closed):
        following = cell[1:] + cell[:1] if loop else cell[1:]
        for first, last in zip(cell, following):
            turned.append((last, first) in edges)
            flat.append(edges.setdefault((last, first) if turned[-1] else (first, last), len(edges)))
        starts.append(len(flat))
    none = np.zeros(0)
    pairs = ContactPairs(np.zeros((0, 2), int), np.zeros((0, 2)), none, none.astype(int), none, none, none)
    return BoundaryMesh(
        1,
        np.array(nodes, float),
        np.array(list(edges)),
        np.array(starts),
        np.array(flat),
        np.array(turned),
        np.array(centres, float),
        np.array(closed),
        np.zeros(len(cells), int),
        ("body",),
        {name: np.array([edges[e] for e in set_]) for name, set_ in edge_sets.items()},
        points,
        pairs,
    )


@case(
    "Edge-cracked rectangle of six S-elements",
    BOOK + "example 3.6: 0.4 x 0.6 m, crack of 0.1 m, E = 10 GPa, nu = 0.25, base fixed, 1 MPa on top, "
    "two-node edges.",
)
def cracked_rectangle() -> Iterator[Row]:
    # In units of 0.1 m; the crack's mouth is node 0 (lower face) and node 16 (upper one).
    nodes = [
        (0, 0),
        (0, -0.5),
        (0, -1),
        (0.5, -1),
        (1, -1),
        (1.5, -1),
        (2, -1),
        (2, -0.5),
        (2, 0),
        (2, 0.5),
        (2, 1),
    ]
    nodes += [
        (1.5, 1),
        (1, 1),
        (0.5, 1),
        (0, 1),
        (0, 0.5),
        (0, 0),
        (0, -2),
        (0, -3),
        (1, -3),
        (2, -3),
        (2, -2),
    ]
    nodes += [
        (3, -3),
        (4, -3),
        (4, -2),
        (4, -1),
        (3, -1),
        (4, 0),
        (4, 1),
        (3, 1),
        (4, 2),
        (4, 3),
        (3, 3),
        (2, 3),
    ]
    nodes += [(2, 2), (1, 3), (0, 3), (0, 2)]
    cells = [
        list(range(17)),
        [2, 17, 18, 19, 20, 21, 6, 5, 4, 3],
        [20, 22, 23, 24, 25, 26, 6, 21],
        [6, 26, 25, 27, 28, 29, 10, 9, 8, 7],
        [10, 29, 28, 30, 31, 32, 33, 34],
        [14, 13, 12, 11, 10, 34, 33, 35, 36, 37],
    ]
    centres = 0.1 * np.array([(1, 0), (1, -2), (3, -2), (3, 0), (3, 2), (1, 2)])
    mesh = two_node_mesh(
        0.1 * np.array(nodes),
        cells,
        centres,
        [False] + [True] * 5,
        {"base": [(18, 19), (19, 20), (20, 22), (22, 23)], "top": [(31, 32), (32, 33), (33, 35), (35, 36)]},
        {"lower": 0, "upper": 16},
    )
    model = sb.Model(mesh, sb.Material(10e9, 0.25, 2000), clamped="base")
    found = sb.static(model, sb.EdgeLoad("top", ty=1e6))
    opening = found.displacement("upper") - found.displacement("lower")
    yield Row("opening across the crack, m", 0.7827e-4, float(opening[1]), 1e-4, note=PRINTED)
    yield Row(
        "opening along the crack, m", -0.0046e-4, float(opening[0]), 1e-4, scale=0.7827e-4, note=PRINTED
    )


@case(
    "Edge-cracked disc of one S-element",
    BOOK + "example 3.9: crack of 0.75 R, radial tension p, nu = 0.25, 16 two-node edges, "
    "nodal forces p R pi / 8.",
)
def cracked_disc() -> Iterator[Row]:
    count = 16
    angle = np.linspace(-np.pi, np.pi, count + 1)
    nodes = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    element = solve_selement(Sectors(nodes - [-0.25, 0.0], 1, sb.Material(1.0, 0.25, 1.0).elasticity), False)
    share = np.full(count + 1, 2 * np.pi / count)
    share[[0, -1]] *= 0.5
    force = (share[:, None] * nodes).ravel()
    # rigid-body motions: x of the lowest and the highest node, y of the rightmost
    held = [2 * 4, 2 * 8 + 1, 2 * 12]
    free = np.setdiff1d(np.arange(2 * (count + 1)), held)
    u = np.zeros(2 * (count + 1))
    u[free] = np.linalg.solve(element.stiffness[np.ix_(free, free)], force[free])
    opening = abs(u[-1] - u[1])
    yield Row(
        "opening at the mouth times E / (p R)", 11.2226, float(opening), 1e-5, note="six digits are printed"
    )
