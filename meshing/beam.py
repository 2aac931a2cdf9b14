"""Beams."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from meshing.boundary_mesh import BoundaryMesh
from meshing.cells.beam_cells import beam_cells
from meshing.cells.beam_layout import MeshInputs
from meshing.cells.s_elements import build_mesh
from meshing.extent import check_extent
from meshing.recipe import Recipe
from meshing.shapes.beam_shape import BeamShape


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
            Polynomial order of the edges, 1 to 20.
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
            Further named points, m; each becomes a node.
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
        inputs = MeshInputs.checked(self, given)
        check_extent("beam", self.length, self.height)
        mesh = build_mesh(beam_cells(self, inputs), inputs.order, origin="beam")
        return replace(mesh, clamped="left", recipe=Recipe(self.mesh, given))
