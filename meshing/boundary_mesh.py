"""The boundary mesh: checked arrays that describe S-elements, contact pairs and named sets; its files."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from meshing.initial_gaps import Gap, gaps_with, remade_with_gap
from meshing.mesh_arrays import MeshArrays
from meshing.mesh_checks import check_mesh
from meshing.mesh_files import export, load, save
from meshing.mesh_summary import summary


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


@dataclass(frozen=True, eq=False)
class BoundaryMesh(MeshArrays):
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

    recipe: Recipe | None = field(default=None, compare=False)

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

    def summary(self) -> str:
        """Extent, S-elements, unknowns, materials, edge sets, points, cracks and tips, as a text."""
        return summary(self)

    def with_gap(self, crack: str, gap: Gap) -> BoundaryMesh:
        """The mesh with other initial gaps between the faces of a crack.

        The faces stay where they are drawn, the contact sees the gap, as in the theory of small
        displacements: a cylinder on a plane is a line between two bodies with the gap ``x**2 / (2 * R)``.
        Inside a tip's S-element the gap runs straight on to the tip, or falls with the root of the distance
        where it does so beside the element, as that of an ellipse.

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
        return load(path, cls)

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the edges as polylines through their nodes in any format meshio writes (.vtu, .vtk, .xdmf
        ...). See `meshing.mesh_files`.
        """
        export(self, path)
