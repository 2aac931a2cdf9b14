"""Beams."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from meshing.boundary_mesh import BoundaryMesh, Recipe
from meshing.cells.complex import CellComplex
from meshing.cells.crack_splitting import add_cracks
from meshing.cells.s_elements import build_mesh
from meshing.geometry.beam_drawing import beam_drawing
from meshing.geometry.beam_options import BeamOptions
from meshing.gmsh.discretise import discretised, write_drawing
from meshing.shapes.beam_shape import BeamShape
from meshing.warnings import check_extent


@dataclass(frozen=True, repr=False)
class Beam(BeamShape):
    """A beam [0, length] x [0, height], clamped end at x = 0, with notches, holes and cracks.

    Attributes
    ----------
    length, height : float
        m.
    notches : sequence of VNotch
    holes : sequence of Hole
    cracks : sequence of CrackLine
        Cracks of any path; they are numbered after the notches.
    """

    def mesh(
        self,
        order: int = 5,
        size: float | None = None,
        tip_size: float | None = None,
        grading: float = 2.5,
        *,
        layout: str = "tip",
        points: Mapping[str, tuple[float, float]] | None = None,
        corner_size: float | None = None,
        corners: Iterable[str] = ("left",),
        face_size: float | None = None,
        face_edges: int = 12,
    ) -> BoundaryMesh:
        """Divide the beam into S-elements.

        Plain parts become equal rectangles. Around each notch tip stand a small open S-element with its
        scaling centre on the tip and rings that are scaled copies of each other; around each hole a ring of
        curved cells. Parts where notches or holes are too close to each other for that are filled by gmsh.

        Parameters
        ----------
        order : int
            Polynomial order of the edges, 1 to 20. 1 is far too stiff in bending: in default cells a
            cantilever of 10 heights bends by .42 of what it should, with 2 by .996.
        size : float, optional
            Length of the cells along the beam, m; below the height there are several rows. Default: 2.5 times
            the height.
        tip_size : float, optional
            Half-size of the S-element on a notch's tip (its largest extent from the tip), m. Default: 0.02 of
            the notch's depth.
        grading : float
            Largest size ratio of neighbouring rings, 1.1 to 10.
        layout : {"tip", "vertex"}
            "tip": scaling centre on the tip. "vertex": the paper's Fig. 2, the tip is a vertex of four closed
            S-elements whose edges are graded down to `tip_size`.
        points : dict of str to (x, y), optional
            Further named points, m; each becomes a node. One on a crack, at its mouth too, is refused.
        corner_size : float, optional
            Size of the innermost cell where the edges are graded towards the corners of the end edges in
            `corners`, m: a clamped corner is singular. Default: 0.2 of the height where there is room, no
            grading in the "vertex" layout.
        corners : sequence of {"left", "right"}
            End edges whose two corners are graded; () for none.
        face_size : float, optional
            Longest edge on the faces of notches, m. Default: the notch's length divided by `face_edges`.
        face_edges : int
            See `face_size`; a contact front anywhere on the faces wants short edges there.

        Returns
        -------
        BoundaryMesh
            Edge sets "left", "right", "top", "bottom", "hole1" ..., "crack1_left", "crack1_right" ...; points
            "A" (top corner of the free end), "B" and "C" (mouth corners of the first notch, free-end and
            clamp side), "B2", "C2" of the second ..., and the user's.

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
        options = BeamOptions.checked(self, given)
        check_extent("beam", self.length, self.height)
        cells = discretised(beam_drawing(self, options), options.order, "beam")
        add_cracks(cells, options.cracks, "beam")
        self._finish_notches(cells)
        return build_mesh(cells, options.order, "beam", clamped="left", recipe=Recipe(self.mesh, given))

    def write(
        self,
        path: str | os.PathLike[str],
        size: float | None = None,
        tip_size: float | None = None,
        grading: float = 2.5,
        *,
        points: Mapping[str, tuple[float, float]] | None = None,
        corner_size: float | None = None,
        corners: Iterable[str] = ("left",),
    ) -> None:
        """Write the beam as a gmsh model, in which each edge of an S-element is one curve.

        gmsh opens it; `read_gmsh` reads it and finds the S-elements that `mesh` makes with the same options.
        What a gmsh model does not say is told again there: `order`, `face_size` and `face_edges`, a `grading`
        that is not the default's, the `tip_size` of cracks among other features. The mesh has no clamped
        end of its own (``Model(..., clamped="left")``), and the mouth corners of notch i are
        "cracki_right" and "cracki_left".

        Parameters
        ----------
        path : path
            With the ending .geo_unrolled; an existing file is replaced.
        size, tip_size, grading, points, corner_size, corners
            See `mesh`.

        Raises
        ------
        ValueError, TypeError
            As `mesh`; another ending; the file cannot be written.
        """
        given = {name: value for name, value in locals().items() if name not in ("self", "path")}
        options = BeamOptions.checked(self, given)
        write_drawing(beam_drawing(self, options), path, "Beam.write")

    def _finish_notches(self, cells: CellComplex) -> None:
        """Notches with their own axes and lengths, their mouth corners as "B", "C", "B2", ..."""
        for i, (notch, faces) in enumerate(zip(self.notches, cells.cracks), 1):
            tip = faces.paths[0].start
            corners = [cells.points.pop(f"{faces.name}_{side}", -1) for side in ("right", "left")]
            if tip is None or -1 in corners:
                raise ValueError(
                    f"beam: another crack meets {faces.name!r}; draw notches that meet as cracks."
                )
            faces.length, tip.axis, tip.opening = notch.length, notch.axis, math.radians(notch.opening)
            for letter, vertex in zip("BC", corners if notch.edge == "top" else corners[::-1]):
                cells.points[f"{letter}{i if i > 1 else ''}"] = vertex
