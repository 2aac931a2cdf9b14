"""The arrays of a boundary mesh: S-elements by their edges, contact pairs, cracks and their tips."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from meshing.gll import tabulated
from meshing.vectors import cross


def _array(shape: str, description: str, of: str = "") -> dict[str, str]:
    """Of a field that is an array: what is checked of it, and what a file says of it.

    Parameters
    ----------
    shape : str
        What there is one of along each axis (see `meshing.mesh_checks`), or "2".
    description : str
    of : str
        What its whole numbers refer to; "truth" for true and false; empty for floating-point numbers.
    """
    return {"shape": shape, "description": description, "of": of}


@dataclass(frozen=True)
class Crack:
    """One crack or V-notch of a mesh.

    Attributes
    ----------
    name : str
        "crack1", "crack2", ... in the order given, or the name of the physical group.
    tip : tuple of float
        Coordinates of the tip, m; of the first of several; of the line's start where there is none.
    axis : tuple of float
        Unit vector from there back along the crack.
    opening : float
        Total opening angle between the faces there, radian (0: closed crack).
    length : float
        Length of the crack's line, of all its branches, m.
    tip_element : int
        S-element whose scaling centre is that tip, -1 if there is none.
    """

    name: str
    tip: tuple[float, float]
    axis: tuple[float, float]
    opening: float
    length: float
    tip_element: int

    def __repr__(self) -> str:
        x, y = self.tip
        element = f", tip element {self.tip_element}" if self.tip_element >= 0 else ""
        return (
            f"Crack({self.name}, tip ({x:g}, {y:g}) m, length {self.length:g} m, opening "
            f"{math.degrees(self.opening):g} deg{element})"
        )


@dataclass(frozen=True)
class Tip:
    """One tip of a crack.

    Attributes
    ----------
    name : str
        The crack's name if it has one tip, else "NAME:1", "NAME:2", ... sorted by x, then y.
    crack : int
        Index into the mesh's cracks.
    position : tuple of float
        m.
    axis : tuple of float
        Unit vector from the tip back along the crack's last segment.
    opening : float
        Total opening angle between the faces at the tip, radian (0: closed crack).
    element : int
        Open S-element whose scaling centre is the tip, -1 if the layout has none. Its chain of edges runs
        from the face at the left hand of somebody who looks along `axis` round to the face at the right.
    faces : tuple of str
        Edge sets to which these two faces belong, "NAME_left" and "NAME_right", or the other way round at
        the far tip of a crack with two: inside the element the faces carry no edges, what acts on a set acts
        there, too.
    arc : tuple of float
        Where the tip and the boundary of its S-element stand in the `arc` of the crack's pairs, m.
    """

    name: str
    crack: int
    position: tuple[float, float]
    axis: tuple[float, float]
    opening: float
    element: int
    faces: tuple[str, str]
    arc: tuple[float, float]

    def __repr__(self) -> str:
        x, y = self.position
        element = f", element {self.element}" if self.element >= 0 else ""
        return f"Tip({self.name}, ({x:g}, {y:g}) m{element})"


@dataclass(frozen=True, eq=False)
class ContactPairs:
    """Node-to-node contact pairs of all cracks, in the order of the cracks, from the tip outwards.

    Of a crack with several tips from its first one; of one that branches line by line, in the order of their
    first tips.

    The gap of pair i is ``gap[i] + normal[i] . (u[nodes[i, 0]] - u[nodes[i, 1]])`` >= 0. Where a face has a
    sharp kink, or cracks meet, each side has a pair of its own: two pairs may have the same nodes and
    different normals.

    Attributes
    ----------
    nodes : (n, 2) int array
        Node on the right face, to which the normal points (right hand of somebody who looks from the tip to
        the mouth), and node on the left face.
    normal : (n, 2) array
        Unit normal of the two faces' mean at that place, weighted as the nodal forces of a uniform pressure
        are.
    gap : (n,) array
        Initial gap g0 >= 0, m.
    crack : (n,) int array
        Index into the mesh's cracks.
    position : (n,) array
        Fraction of the crack's length: from the tip (0) to the mouth (1), or from its first tip to the other;
        of a crack that branches the lengths of its lines follow one another.
    arc : (n,) array
        The same in m.
    weight : (n,) array
        Length of face that the pair stands for, m: a uniform pressure p has the force p * weight here.
    """

    nodes: np.ndarray = field(
        metadata=_array("pairs 2", "node on the face the normal points to, node on the other", "nodes")
    )
    normal: np.ndarray = field(metadata=_array("pairs 2", "unit normal of the faces"))
    gap: np.ndarray = field(metadata=_array("pairs", "initial gap, m"))
    crack: np.ndarray = field(metadata=_array("pairs", "index of the crack", "cracks"))
    position: np.ndarray = field(
        metadata=_array("pairs", "fraction of the crack's length from the first tip (0) to the end (1)")
    )
    arc: np.ndarray = field(metadata=_array("pairs", "the same, m"))
    weight: np.ndarray = field(metadata=_array("pairs", "length of face that the pair stands for, m"))

    def __len__(self) -> int:
        return len(self.gap)

    def __repr__(self) -> str:
        if not len(self):
            return "ContactPairs(none)"
        return f"ContactPairs({len(self)}, gaps {self.gap.min():g} to {self.gap.max():g} m)"


@dataclass(frozen=True, eq=False)
class MeshArrays:
    """What a `BoundaryMesh` consists of, which says what each of it is; unchecked."""

    order: int
    nodes: np.ndarray = field(metadata=_array("nodes 2", "coordinates of the nodes, m"))
    edges: np.ndarray = field(
        metadata=_array("edges points", "nodes of each edge at the Gauss-Lobatto-Legendre points", "nodes")
    )
    element_start: np.ndarray = field(
        metadata=_array(
            "starts",
            "element_edges[element_start[e]:element_start[e + 1]] are the edges of S-element e",
            "ends",
        )
    )
    element_edges: np.ndarray = field(metadata=_array("uses", "edges of all S-elements, flat", "edges"))
    element_reversed: np.ndarray = field(
        metadata=_array(
            "uses", "true where the element runs through the edge from its last node to its first", "truth"
        )
    )
    scaling_centres: np.ndarray = field(metadata=_array("elements 2", "scaling centre of each S-element, m"))
    closed: np.ndarray = field(
        metadata=_array(
            "elements",
            "true: a loop of edges; false: a chain whose scaling centre is on the boundary",
            "truth",
        )
    )
    materials: np.ndarray = field(metadata=_array("elements", "index into material_names", "materials"))
    material_names: tuple[str, ...]
    edge_sets: dict[str, np.ndarray]
    points: dict[str, int]
    pairs: ContactPairs
    cracks: tuple[Crack, ...] = field(default=())
    tips: tuple[Tip, ...] = field(default=())
    clamped: str | None = None
    sector_materials: dict[int, np.ndarray] = field(default_factory=dict)

    @property
    def elements(self) -> int:
        """Number of S-elements."""
        return len(self.closed)

    def element_nodes(self, element: int) -> np.ndarray:
        """Nodes of S-element `element` in counter-clockwise order; the closing node of a loop is not
        repeated.
        """
        part = slice(self.element_start[element], self.element_start[element + 1])
        edges, backwards = self.edges[self.element_edges[part]], self.element_reversed[part]
        edges[backwards] = edges[backwards, ::-1]
        return np.append(edges[:, :-1], [] if self.closed[element] else edges[-1, -1:]).astype(int)

    @property
    def area(self) -> float:
        """Area enclosed by the S-elements, m2; exact for the polynomial edges."""
        *tables, weight = tabulated(self.order, self.order + 1)
        x, dx = (table @ self.nodes[self.edges] for table in tables)
        swept = (0.5 * cross(x, dx) @ weight)[self.element_edges]
        total = float(np.where(self.element_reversed, -swept, swept).sum())
        # An open element is bounded by two straight faces to its scaling centre as well.
        for element in np.flatnonzero(~self.closed):
            first, last = self.nodes[self.element_nodes(element)[[0, -1]]]
            total += 0.5 * float(cross(self.scaling_centres[element], first - last))
        return total

    def outline_edges(self) -> np.ndarray:
        """Edges that belong to one S-element only, ascending."""
        return np.flatnonzero(np.bincount(self.element_edges, minlength=len(self.edges)) == 1)
