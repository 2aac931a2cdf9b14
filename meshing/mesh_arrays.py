"""The arrays of a boundary mesh, and their checks: S-elements, contact pairs, named sets."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from meshing.gll import gll_nodes, lagrange_slopes, lagrange_values
from meshing.recipe import Recipe


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

    nodes: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    crack: np.ndarray
    position: np.ndarray
    arc: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.gap)

    def __repr__(self) -> str:
        if not len(self):
            return "ContactPairs(none)"
        return f"ContactPairs({len(self)}, gaps {self.gap.min():g} to {self.gap.max():g} m)"


@dataclass(frozen=True, eq=False)
class MeshArrays:
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
        Index into `material_names`; of an S-element in several materials that of its first edge.
    material_names : tuple of str
    edge_sets : dict of str to int array
        Named sets of edges: "left", "right", "top", "bottom", "hole1", "crack1_left", "crack1_right" ...,
        or the names of the user's physical curves.
    points : dict of str to int
        Named points, each one node.
    pairs : ContactPairs
    cracks : tuple of Crack
    tips : tuple of Tip
        Of all cracks; a crack has 0, 1 or more.
    clamped : str or None
        Edge set that a model holds fixed unless told otherwise: "left" of a beam.
    sector_materials : dict of int to int array
        For the S-elements in several materials, around tips at an interface: material of the sector that each
        of the edges spans with the scaling centre.
    recipe : Recipe or None
        How the mesh was made; None if that is not known, as of a mesh read by `BoundaryMesh.load`.
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
    tips: tuple[Tip, ...] = field(default=())
    clamped: str | None = None
    sector_materials: dict[int, np.ndarray] = field(default_factory=dict)
    recipe: Recipe | None = field(default=None, compare=False)

    @property
    def elements(self) -> int:
        """Number of S-elements."""
        return len(self.closed)

    def element_nodes(self, element: int) -> np.ndarray:
        """Nodes of S-element `element` in counter-clockwise order; the closing node of a loop is not
        repeated.
        """
        part = slice(self.element_start[element], self.element_start[element + 1])
        chain = [
            self.edges[e, ::-1] if r else self.edges[e]
            for e, r in zip(self.element_edges[part], self.element_reversed[part])
        ]
        nodes = np.concatenate([c[:-1] for c in chain] + [chain[-1][-1:]])
        return nodes[:-1] if self.closed[element] else nodes

    def __post_init__(self) -> None:
        check(self)

    def __repr__(self) -> str:
        (left, bottom), (right, top) = self.nodes.min(axis=0), self.nodes.max(axis=0)
        parts = [
            f"{self.elements} S-elements of order {self.order}, {len(self.edges)} edges, {len(self.nodes)} "
            "nodes",
            f"[{left:g}, {right:g}] x [{bottom:g}, {top:g}] m",
            f"{len(self.cracks)} cracks with {len(self.tips)} tips and {len(self.pairs)} contact pairs",
            f"sets {', '.join(self.edge_sets) or 'none'}",
            f"points {', '.join(self.points) or 'none'}",
        ]
        return f"{type(self).__name__}({'; '.join(parts)})"

    @property
    def area(self) -> float:
        """Area enclosed by the S-elements, m2; exact for the polynomial edges."""
        at, weight = np.polynomial.legendre.leggauss(self.order + 1)
        x, dx = (
            evaluate(gll_nodes(self.order), at) @ self.nodes[self.edges]
            for evaluate in (lagrange_values, lagrange_slopes)
        )
        swept = 0.5 * (x[..., 0] * dx[..., 1] - x[..., 1] * dx[..., 0]) @ weight
        total = float(
            np.where(self.element_reversed, -swept[self.element_edges], swept[self.element_edges]).sum()
        )
        # An open element is bounded by two straight faces to its scaling centre as well.
        for element in np.flatnonzero(~self.closed):
            chain, centre = self.nodes[self.element_nodes(element)[[0, -1]]], self.scaling_centres[element]
            total += 0.5 * float(
                centre[0] * chain[0, 1]
                - centre[1] * chain[0, 0]
                + chain[1, 0] * centre[1]
                - chain[1, 1] * centre[0]
            )
        return total

    def outline_edges(self) -> np.ndarray:
        """Edges that belong to one S-element only, ascending."""
        return np.flatnonzero(np.bincount(self.element_edges, minlength=len(self.edges)) == 1)


def check(mesh: MeshArrays) -> None:
    """Consistency of a mesh's arrays.

    Raises
    ------
    ValueError
        Shapes that do not fit, numbers out of range, coordinates that are not finite, elements whose edges
        are not a chain or loop, edges used by more than two elements or twice in the same direction.
    """

    def fail(what: str) -> None:
        raise ValueError(f"boundary mesh: {what}.")

    nodes, elements = len(mesh.nodes), len(mesh.closed)
    if mesh.order < 1 or mesh.edges.ndim != 2 or mesh.edges.shape[1] != mesh.order + 1:
        fail(f"edges has shape {mesh.edges.shape}, (n, {mesh.order + 1}) was expected for order {mesh.order}")
    if mesh.nodes.shape != (nodes, 2) or not np.isfinite(mesh.nodes).all():
        fail("nodes is not an (n, 2) array of finite coordinates")
    start, flat = mesh.element_start, mesh.element_edges
    if (
        len(start) != elements + 1
        or start[0] != 0
        or start[-1] != len(flat)
        or (np.diff(start) < 1).any()
        or len(mesh.element_reversed) != len(flat)
    ):
        fail("element_start, element_edges and element_reversed do not fit together")
    if mesh.scaling_centres.shape != (elements, 2) or len(mesh.materials) != elements:
        fail("scaling_centres or materials do not have one row for each S-element")
    for name, numbers, limit in (
        ("edges", mesh.edges, nodes),
        ("element_edges", flat, len(mesh.edges)),
        ("materials", mesh.materials, len(mesh.material_names)),
        *(("sector_materials", part, len(mesh.material_names)) for part in mesh.sector_materials.values()),
        ("pairs.nodes", mesh.pairs.nodes, nodes),
        ("pairs.crack", mesh.pairs.crack, len(mesh.cracks)),
        ("tips.crack", np.array([tip.crack for tip in mesh.tips], int), len(mesh.cracks)),
        ("tips.element", np.array([max(tip.element, 0) for tip in mesh.tips], int), elements),
        ("points", np.array(list(mesh.points.values()), int), nodes),
        *((f"edge set {key!r}", value, len(mesh.edges)) for key, value in mesh.edge_sets.items()),
    ):
        if numbers.size and (numbers.min() < 0 or numbers.max() >= limit):
            fail(
                f"{name} refers to number {numbers.min() if numbers.min() < 0 else numbers.max()}, 0 to "
                f"{limit - 1} exist"
            )
    for element, sectors in mesh.sector_materials.items():
        if not 0 <= element < elements or len(sectors) != start[element + 1] - start[element]:
            fail(f"sector_materials of S-element {element} are not one for each of its edges")
    first = np.where(mesh.element_reversed, mesh.edges[flat, -1], mesh.edges[flat, 0])
    last = np.where(mesh.element_reversed, mesh.edges[flat, 0], mesh.edges[flat, -1])
    inner = np.ones(len(flat), bool)
    inner[start[1:] - 1] = False
    broken = np.flatnonzero(inner & (last != np.roll(first, -1)))
    if len(broken):
        fail(
            f"the edges of S-element {int(np.searchsorted(start, broken[0], side='right')) - 1} are not a "
            "chain"
        )
    is_loop = last[start[1:] - 1] == first[start[:-1]]
    if (is_loop != mesh.closed).any():
        fail(
            f"S-element {int(np.flatnonzero(is_loop != mesh.closed)[0])} is marked closed but its edges are "
            "no loop, or the other way round"
        )
    uses = np.bincount(flat, minlength=len(mesh.edges))
    same_way = np.bincount(
        flat, weights=np.where(mesh.element_reversed, -1.0, 1.0), minlength=len(mesh.edges)
    )
    wrong = np.flatnonzero((uses > 2) | ((uses == 2) & (same_way != 0)))
    if len(wrong):
        fail(f"edge {wrong[0]} is used {uses[wrong[0]]} times or twice in the same direction")
    if (mesh.pairs.gap < 0).any():
        fail("a contact pair has a negative gap")
    count = len(mesh.pairs)
    for name, shape in (
        ("nodes", (count, 2)),
        ("normal", (count, 2)),
        ("crack", (count,)),
        ("position", (count,)),
        ("arc", (count,)),
        ("weight", (count,)),
    ):
        values = getattr(mesh.pairs, name)
        if values.shape != shape or not np.isfinite(values).all():
            fail(f"pairs.{name} is not an array of {shape} finite numbers")
