"""Plates: plane bodies with a polygon as their outline."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from meshing.boundary_mesh import BoundaryMesh, Recipe
from meshing.cells.complex import Point
from meshing.cells.crack_splitting import CrackMeshing, add_cracks
from meshing.cells.s_elements import build_mesh
from meshing.geometry.drawing import Drawing
from meshing.geometry.fill import draw_filled
from meshing.geometry.graph import plane_graph
from meshing.gmsh.discretise import discretised, write_drawing
from meshing.input_checks import checked_order, length, named_points
from meshing.shapes.features import point_of
from meshing.shapes.plate_shape import PlateShape
from meshing.warnings import check_extent

_DEFAULT_SIZE = 0.2  # of the square root of the area


@dataclass(frozen=True, repr=False)
class Plate(PlateShape):
    """A plane body: a polygon with circular holes and cracks.

    Attributes
    ----------
    outline : sequence of (x, y)
        Corners counter-clockwise, the first one not repeated, m.
    holes : sequence of Hole
    cracks : sequence of CrackLine
        They may start at the edge, at a hole or inside, cross, branch from each other, and cut the body.
    edge_names : sequence of str, optional
        Edge set of each side in the outline's order; sides may share one. Default: "edge1" from the first
        corner to the second, "edge2", ...
    """

    def mesh(
        self,
        order: int = 5,
        size: float | None = None,
        points: Mapping[str, tuple[float, float]] | None = None,
        *,
        tip_size: float | None = None,
        grading: float = 2.5,
        face_size: float | None = None,
        face_edges: int = 12,
        tip_element: bool = True,
    ) -> BoundaryMesh:
        """Divide the plate into S-elements.

        Around each tip stand a small open S-element with its scaling centre on the tip and rings that are
        scaled copies of each other; kinks of more than 20 degrees and places where cracks meet have rings,
        too. gmsh fills the rest.

        Parameters
        ----------
        order : int
            Polynomial order of the edges, 1 to 20. 1 is too stiff in bending.
        size : float, optional
            Largest edge, m. Default: 0.2 of the square root of the area.
        points : dict of str to (x, y), optional
            Named points, m; each becomes a node. One on a crack, at its mouth too, or between its faces where
            it is open, is refused.
        tip_size : float, optional
            Half-size of the S-element on a tip (its largest extent from it), m. Default: 0.02 of the crack's
            length, or 0.03 of its outermost ring if that is less.
        grading : float
            Largest size ratio of neighbouring rings, 1.1 to 10.
        face_size : float, optional
            Longest edge on the faces of cracks, m. Default: the crack's length divided by `face_edges`.
        face_edges : int
            See `face_size`.
        tip_element : bool
            False: no rings and no open S-element around the tips.

        Returns
        -------
        BoundaryMesh
            Edge sets of the sides ("edge1", ... or `edge_names`), "hole1", ..., and the faces "NAME_left" and
            "NAME_right" of each crack, its right one at the right hand of somebody who looks from the tip to
            the mouth (from the last point to the first). Inside a tip's S-element the faces carry no edges:
            `BoundaryMesh.tips` says which sets they belong to. Points: the user's, and the mouth's corners
            "NAME_left" and "NAME_right" of a crack with one mouth.

        Raises
        ------
        ValueError, TypeError
            One sentence that names the input, its value and what was expected.

        Warns
        -----
        UnitWarning
            A body above 20 m or below 1 mm.
        """
        given = {name: value for name, value in locals().items() if name != "self"}
        order, meshing = checked_order(order), CrackMeshing.checked(self.diagonal, given)
        check_extent("plate", *np.ptp(self.outline, axis=0))
        cells = discretised(self._drawing(size, points), order, "plate")
        add_cracks(cells, meshing, "plate")
        return build_mesh(cells, order, "plate", recipe=Recipe(self.mesh, given))

    def write(
        self,
        path: str | os.PathLike[str],
        size: float | None = None,
        points: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        """Write the plate as a gmsh model, in which each edge on the outline and on cracks is one curve.

        gmsh opens it; `read_gmsh` reads it and fills it as `mesh` does with the same options. `order`,
        `tip_size`, `grading`, `face_size`, `face_edges` and `tip_element` are told again there.

        Parameters
        ----------
        path : path
            With the ending .geo_unrolled; an existing file is replaced.
        size, points
            See `mesh`.

        Raises
        ------
        ValueError, TypeError
            As `mesh`; another ending; the file cannot be written.
        """
        write_drawing(self._drawing(size, points), path, "Plate.write")

    def _drawing(self, size: float | None, points: Mapping[str, Point] | None) -> Drawing:
        """What gmsh fills.

        Raises
        ------
        ValueError, TypeError
            See `mesh`; cracks or points come too close to something.
        """
        size = _DEFAULT_SIZE * math.sqrt(self.area) if size is None else length("mesh", "size", size)
        if size < 1e-3 * self.diagonal:
            raise ValueError(
                f"mesh: size {size:g} m is below 0.1 % of the body's diagonal {self.diagonal:g} m; high "
                "orders on larger cells cost less."
            )
        named = {name: point_of(f"point {name!r}", at) for name, at in named_points(points).items()}
        # From the tip, as everything that is numbered along a crack.
        lines = {name: np.array(crack.points[::-1]) for name, crack in zip(self.crack_names(), self.cracks)}
        holes = {f"hole{i}": ((hole.x, hole.y), hole.radius) for i, hole in enumerate(self.holes, 1)}
        drawing = Drawing()
        draw_filled(drawing, plane_graph(self.outline, holes, lines, named), size, self.side_names)
        drawing.name_openings({name: crack.opening for name, crack in zip(lines, self.cracks)})
        return drawing
