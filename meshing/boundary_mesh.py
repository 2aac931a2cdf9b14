"""The boundary mesh: plain arrays that describe S-elements, contact pairs and named sets, with its files."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from meshing.gll import gll_nodes, lagrange_slopes, lagrange_values
from meshing.initial_gaps import Gap, gaps_with, remade_with_gap
from meshing.mesh_checks import check_mesh
from meshing.mesh_files import Kinds, export, load, save
from meshing.mesh_summary import summary
from meshing.vectors import cross


@dataclass(frozen=True, eq=False)
class Recipe:
    """A function that meshes and the options it was called with.

    Attributes
    ----------
    make : callable
        ``make(**options)`` gives the mesh: `Beam.mesh`, `Plate.mesh`, `read_gmsh` of a path.
    options : mapping
        None stands for a default.
    """

    make: Callable[..., Any]
    options: Mapping[str, Any]

    @property
    def chosen(self) -> dict[str, Any]:
        """The options that were given."""
        return {name: value for name, value in self.options.items() if value is not None}

    def remade(self, changes: Mapping[str, Any]) -> Any:
        """The mesh made with some options changed."""
        return self.make(**{**self.options, **changes})


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
        edges, backwards = self.edges[self.element_edges[part]], self.element_reversed[part]
        edges[backwards] = edges[backwards, ::-1]
        return np.append(edges[:, :-1], [] if self.closed[element] else edges[-1, -1:]).astype(int)

    def __post_init__(self) -> None:
        check_mesh(self)

    def __repr__(self) -> str:
        (left, bottom), (right, top) = self.nodes.min(axis=0), self.nodes.max(axis=0)
        made = f"{self.elements} S-elements of order {self.order}"
        parts = [
            f"{made}, {len(self.edges)} edges, {len(self.nodes)} nodes",
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

    def summary(self) -> str:
        """Extent, S-elements, unknowns, materials, edge sets, points, cracks and tips, as a text."""
        return summary(self)

    def with_gap(self, crack: str, gap: Gap) -> BoundaryMesh:
        """The mesh with other initial gaps between the faces of a crack.

        The faces stay where they are drawn, the contact sees the gap, as in the theory of small
        displacements: a cylinder on a plane is a line between two bodies with the gap ``x**2 / (2 * R)``.
        Inside a tip's S-element the gap runs straight on to the tip.

        Parameters
        ----------
        crack : str
        gap : float, callable or (n,) array
            Distance of the faces along the pairs' normals, m, in place of the drawn one: a number, a function
            of x and y (arrays, m, halfway between the faces) or one value for each of the crack's pairs in
            their order. A finer mesh of the same structure (`sb.estimate`) asks the function again.

        Raises
        ------
        TypeError, ValueError
            The mesh has no such crack; the gaps are no finite numbers >= 0, one for each pair.
        """
        recipe = self.recipe and Recipe(
            functools.partial(remade_with_gap, self.recipe.make, crack, gap), self.recipe.options
        )
        pairs = replace(self.pairs, gap=gaps_with(self, crack, gap))
        return replace(self, pairs=pairs, recipe=recipe)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write to an HDF5 file; an existing file is replaced only once the new one is complete. See
        `meshing.mesh_files`.
        """
        save(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BoundaryMesh:
        """Read what `save` has written; ValueError if the file is missing, truncated or something else."""
        return load(path, Kinds(cls, ContactPairs, Crack, Tip))

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the edges as polylines through their nodes in any format meshio writes (.vtu, .vtk, .xdmf
        ...). See `meshing.mesh_files`.
        """
        export(self, path)
