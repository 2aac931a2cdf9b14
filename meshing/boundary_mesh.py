"""The boundary mesh: plain arrays that describe S-elements, contact pairs and named sets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Crack:
    """One crack or V-notch of a mesh.

    Attributes
    ----------
    name : str
        "crack1", "crack2", ... in the order given, or the name of the physical group.
    tip : tuple of float
        Coordinates of the tip, m.
    axis : tuple of float
        Unit vector along the crack's axis, from the tip to the mouth.
    opening : float
        Total opening angle between the faces at the tip, radian (0: closed crack).
    length : float
        Distance from the tip to the mouth along the axis, m.
    tip_element : int
        S-element whose scaling centre is the tip, -1 if the layout has none.
    """

    name: str
    tip: tuple[float, float]
    axis: tuple[float, float]
    opening: float
    length: float
    tip_element: int


@dataclass(frozen=True, eq=False)
class ContactPairs:
    """Node-to-node contact pairs of all cracks, in the order of the cracks, from the tip outwards.

    The gap of pair i is ``gap[i] + normal[i] . (u[nodes[i, 0]] - u[nodes[i, 1]])`` >= 0.

    Attributes
    ----------
    nodes : (n, 2) int array
        Node on the face the normal points to (free-end side) and node on the opposite face.
    normal : (n, 2) array
        Unit normal of the crack's axis, from the second node's side to the first's.
    gap : (n,) array
        Initial gap g0 >= 0, m.
    crack : (n,) int array
        Index into the mesh's cracks.
    position : (n,) array
        Fraction of the face's length from the tip (0) to the mouth (1).
    """

    nodes: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    crack: np.ndarray
    position: np.ndarray

    def __len__(self) -> int:
        return len(self.gap)


@dataclass(frozen=True, eq=False)
class BoundaryMesh:
    """S-elements given by their boundary edges alone.

    Attributes
    ----------
    order : int
        Polynomial order p of every edge; p + 1 Gauss-Lobatto-Legendre (GLL) nodes an edge.
    nodes : (n_nodes, 2) array
        Coordinates, m. Coincident nodes on the two faces of a closed crack are separate nodes.
    edges : (n_edges, p + 1) int array
        Nodes of each edge at the GLL points in order. An edge shared by two S-elements stands here once.
    element_start : (n_elements + 1,) int array
        ``element_edges[element_start[e]:element_start[e + 1]]`` are the edges of S-element e, one after
        the other, counter-clockwise about its scaling centre.
    element_edges : int array
        Edges of all elements, flat.
    element_reversed : bool array
        True where the element runs through the edge from its last node to its first.
    scaling_centres : (n_elements, 2) array
        m.
    closed : (n_elements,) bool array
        Closed: the edges form a loop around the scaling centre. Open: the scaling centre is on the boundary
        (crack tip, re-entrant corner); the edges form a chain whose two ends are joined to the
        scaling centre by straight faces that carry no nodes.
    materials : (n_elements,) int array
        Index into `material_names`.
    material_names : tuple of str
    edge_sets : dict of str to int array
        Named sets of edges: "left", "right", "top", "bottom", "hole1", "crack1_left", "crack1_right" ...,
        or the names of the user's physical curves.
    points : dict of str to int
        Named points, each one node.
    pairs : ContactPairs
    cracks : tuple of Crack
    """

    order: int
    nodes: np.ndarray
    edges: np.ndarray
    element_start: np.ndarray
    element_edges: np.ndarray
    element_reversed: np.ndarray
    scaling_centres: np.ndarray
    closed: np.ndarray
    materials: np.ndarray
    material_names: tuple[str, ...]
    edge_sets: dict[str, np.ndarray]
    points: dict[str, int]
    pairs: ContactPairs
    cracks: tuple[Crack, ...] = field(default=())

    @property
    def elements(self) -> int:
        """Number of S-elements."""
        return len(self.closed)

    def element_nodes(self, element: int) -> np.ndarray:
        """Nodes of S-element `element` in counter-clockwise order; the closing node of a loop is not repeated."""
        part = slice(self.element_start[element], self.element_start[element + 1])
        chain = [self.edges[e, ::-1] if r else self.edges[e] for e, r in zip(self.element_edges[part], self.element_reversed[part])]
        nodes = np.concatenate([c[:-1] for c in chain] + [chain[-1][-1:]])
        return nodes[:-1] if self.closed[element] else nodes
