"""Tables of a case file for geometry, mesh and material."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from meshing import beam, plate
from meshing.gmsh import reader
from meshing.shapes import features

from ... import damping
from ...options import Pair, item
from .parts import CrackLine, Hole, Isotropic, Law, Notch, Orthotropic, Support
from .tables import AnyNames, Name, Table, by_kind, table_of


class _Geometry(Table):
    """What makes its mesh is the method `mesh` of what it stands for, or that itself."""

    @classmethod
    def mesh_keys(cls) -> list[str]:
        """Keys of [mesh] that have a meaning for it: arguments of what makes its mesh."""
        arguments = inspect.signature(getattr(cls.made, "mesh", cls.made)).parameters
        return [key for key in Mesh.model_fields if key in arguments]


_shaped = functools.partial(
    table_of,
    base=_Geometry,
    types={
        Sequence[features.VNotch]: list[Notch],
        Sequence[features.Hole]: list[Hole],
        Sequence[features.CrackLine]: list[CrackLine],
        tuple[str, ...] | None: list[Name] | None,
        "outline": Annotated[list[Pair], Field(min_length=3)],
    },
)
BeamGeometry = _shaped(beam.Beam, "BeamGeometry", "beam", "a beam with notches and holes")
PlateGeometry = _shaped(plate.Plate, "PlateGeometry", "plate", "a polygon with holes and cracks")


class GmshGeometry(_Geometry):
    """A gmsh model with physical groups: surfaces are materials, curves edge sets, points named points."""

    made: ClassVar = reader.read_gmsh

    kind: Literal["gmsh"] = item(text="a model of gmsh's")
    file: Name = item(
        text="path of a model that read_gmsh reads (.geo, .msh, .inp, .unv ...), relative to the case file"
    )
    scale: float | None = item(
        None,
        text="length of the file's unit: 1e-3 for a model in mm; default: that of STEP and IGES, else 1",
        unit="m",
        gt=0,
    )


GEOMETRIES = (BeamGeometry, PlateGeometry, GmshGeometry)
Geometry = by_kind(*GEOMETRIES)


class Mesh(Table):
    """How the body is divided into S-elements."""

    order: int = item(5, text="polynomial order of the edges", ge=1, le=20)
    size: float | None = item(
        None, text="length of the cells; default: 2.5 times a beam's height", unit="m", gt=0
    )
    tip_size: float | None = item(
        None, text="half-size of the S-element on a tip; default: 0.02 of the depth", unit="m", gt=0
    )
    grading: float = item(2.5, text="largest size ratio of neighbouring rings", ge=1.1, le=10)
    layout: Literal["tip", "vertex"] = item(
        "tip", text='"tip": scaling centre on the tip; "vertex": the tip is a corner of four S-elements'
    )
    corner_size: float | None = item(
        None,
        text="innermost cell at the graded corners; default: 0.2 of the height where there is room",
        unit="m",
        gt=0,
    )
    corners: list[Literal["left", "right"]] = item(["left"], text="end edges whose corners are graded")
    face_size: float | None = item(None, text="largest edge on crack faces", unit="m", gt=0)
    face_edges: int = item(12, text="edges on each crack face, at least", ge=1)
    tip_element: bool = item(True, text="merge the cells around each crack tip into one S-element")


Material: Any = by_kind(Isotropic, Orthotropic, default="isotropic")
Ratio = Annotated[float, Field(ge=0, lt=1)]


Factors = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=2, max_length=2)]


class RayleighBand(Table):
    """Rayleigh damping by its ratios at two frequencies."""

    made: ClassVar = damping.rayleigh_factors

    low: float = item(text="lower frequency", unit="Hz", gt=0)
    low_ratio: float = item(text="damping ratio there", ge=0, lt=1)
    high: float = item(text="upper frequency", unit="Hz", gt=0)
    high_ratio: float = item(text="damping ratio there", ge=0, lt=1)


class DampingByFrequency(Table):
    """Modal damping ratios by frequency, constant beyond the first and the last one."""

    made: ClassVar = damping.DampingTable

    points: list[Pair] = item(text="[frequency in Hz, ratio], frequencies ascending", min_length=1)


class ModelTable(Table):
    """Supports, damping, thickness."""

    clamped: AnyNames | None = item(
        None,
        text='edge set or point, or several, held fixed; [] for a free structure; default "left" of a beam',
    )
    supports: list[Support] = item([], text="further supports, [[model.supports]]")
    contact_laws: dict[str, Law] = item(
        {}, text="what faces do to each other, [model.contact_laws.CRACK]; others are unilateral"
    )
    damping: Ratio | Annotated[list[Ratio], Field(min_length=1)] | DampingByFrequency = item(
        0.0,
        text="modal damping ratio of every dynamic analysis, from 0 to below 1; an array: of the lowest "
        "modes, the last one for all further modes; a table: by frequency, { points }",
    )
    rayleigh: Factors | RayleighBand | None = item(
        None, text="[a, b] of a damping matrix a M + b K (1/s and s), or { low, low_ratio, high, high_ratio }"
    )
    thickness: float = item(1.0, text="thickness", unit="m", gt=0)
    continued_fraction: int = item(
        1, text="terms of the continued fraction for the inertia of S-elements", ge=0, le=20
    )
