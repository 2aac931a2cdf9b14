"""What every mesh must satisfy, and a count of shapes that are congruent up to scale, rotation and
reflection.
"""

import numpy as np

from meshing.boundary_mesh import BoundaryMesh
from meshing.gll import gll_nodes, lagrange_slopes, lagrange_values


def check_mesh(mesh: BoundaryMesh, area: float, tolerance: float, covered: bool = True) -> None:
    """Topology, area, star-convexity and sets of a mesh."""
    uses: dict[int, list[bool]] = {}
    for edge, backwards in zip(mesh.element_edges, mesh.element_reversed):
        uses.setdefault(int(edge), []).append(bool(backwards))
    assert sorted(uses) == list(range(len(mesh.edges)))
    assert all(len(use) == 1 or sorted(use) == [False, True] for use in uses.values())
    outline = sorted(edge for edge, use in uses.items() if len(use) == 1)
    assert outline == list(mesh.outline_edges())
    if covered:
        assert sorted(np.concatenate(list(mesh.edge_sets.values()))) == outline
    assert len(np.unique(mesh.edges)) == len(mesh.nodes)

    order = mesh.order
    gauss, weight = np.polynomial.legendre.leggauss(order + 2)
    points = np.concatenate([gll_nodes(order), gauss])
    values, slopes = lagrange_values(gll_nodes(order), points), lagrange_slopes(gll_nodes(order), points)
    total = 0.0
    for element in range(mesh.elements):
        part = slice(mesh.element_start[element], mesh.element_start[element + 1])
        edges = [
            mesh.edges[e, ::-1] if r else mesh.edges[e]
            for e, r in zip(mesh.element_edges[part], mesh.element_reversed[part])
        ]
        assert all(a[-1] == b[0] for a, b in zip(edges, edges[1:]))
        assert (edges[-1][-1] == edges[0][0]) == mesh.closed[element]
        relative = mesh.nodes[np.array(edges)] - mesh.scaling_centres[element]
        at, along = values @ relative, slopes @ relative
        jacobian = at[..., 0] * along[..., 1] - at[..., 1] * along[..., 0]
        assert jacobian.min() > 0
        total += 0.5 * (jacobian[:, order + 1 :] @ weight).sum()
    assert abs(total / area - 1) < tolerance
    assert abs(mesh.area / total - 1) < 1e-12


def distinct_shapes(mesh: BoundaryMesh) -> int:
    """Number of S-elements that differ by more than translation, scaling, rotation and reflection."""
    known: list[np.ndarray] = []
    for element in range(mesh.elements):
        loop = (
            mesh.element_nodes(element)[:: mesh.order]
            if mesh.closed[element]
            else mesh.element_nodes(element)[:: mesh.order]
        )
        z = (mesh.nodes[loop] - mesh.scaling_centres[element]) @ [1, 1j]
        variants = []
        for w in (z, np.conj(z)[::-1]):
            for shift in range(len(w)):
                turned = np.roll(w, -shift)
                variants.append(turned / turned[0])
        if not any(len(k) == len(v) and np.abs(k - v).max() < 1e-6 for k in known for v in variants):
            known.append(variants[0])
    return len(known)


def smallest_angle(mesh: BoundaryMesh) -> float:
    """Smallest angle between two edges of a closed S-element, radian."""
    smallest = np.pi
    for element in np.flatnonzero(mesh.closed):
        corners = mesh.nodes[mesh.element_nodes(element)[:: mesh.order]]
        ahead, behind = np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners
        across = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
        smallest = min(smallest, (np.arctan2(across, (ahead * behind).sum(axis=1)) % (2 * np.pi)).min())
    return float(smallest)
