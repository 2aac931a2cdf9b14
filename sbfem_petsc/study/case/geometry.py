"""Tables of a case file for geometry, mesh and material."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag

from meshing import beam, plate
from meshing.gmsh import reader
from meshing.shapes import features

from ... import damping, material, supports
from ...options import Pair, item
from .laws import Law
from .tables import AnyNames, Name, Problem, Table, by_kind


class Notch(Table):
    """A V-notch or crack from the beam's top or bottom edge; `opening = 0` is a closed crack."""

    made: ClassVar = features.VNotch

    x: float = item(text="position of the tip along the beam", unit="m")
    depth: float = item(text="vertical distance of the tip from the edge", unit="m", gt=0)
    opening: float = item(text="total angle between the faces; 0 is a closed crack", unit="degree", ge=0)
    tilt: float = item(
        0.0,
        text="angle of the axis from the vertical, positive with the mouth towards the free end",
        unit="degree",
    )
    edge: Literal["top", "bottom"] = item("top", text="edge that it starts from")


class Hole(Table):
    """A circular hole."""

    made: ClassVar = features.Hole

    x: float = item(text="centre", unit="m")
    y: float = item(text="centre", unit="m")
    diameter: float = item(text="diameter", unit="m", gt=0)


class CrackLine(Table):
    """A crack along a polygonal line, from mouth to tip or from tip to tip."""

    made: ClassVar = features.CrackLine

    points: Annotated[list[Pair], Field(min_length=2)] = item(
        text="points from the mouth to the tip, or from tip to tip", unit="m"
    )
    opening: float = item(0.0, text="full angle at the mouth", unit="degree", ge=0)
    name: Name | None = item(None, text='name of the crack; else "crack1", "crack2", ...')


class _Geometry(Table):
    mesher: ClassVar[Callable[..., Any]]

    @classmethod
    def mesh_keys(cls) -> list[str]:
        """Keys of [mesh] that have a meaning for it: arguments of what makes its mesh."""
        return [key for key in Mesh.model_fields if key in inspect.signature(cls.mesher).parameters]


class BeamGeometry(_Geometry):
    """A beam [0, length] x [0, height] whose clamped end is usually x = 0."""

    made: ClassVar = beam.Beam
    mesher: ClassVar = beam.Beam.mesh

    kind: Literal["beam"] = item(text="a beam with notches and holes")
    length: float = item(text="length", unit="m", gt=0)
    height: float = item(text="height", unit="m", gt=0)
    notches: list[Notch] = item([], text="notches and cracks, [[geometry.notches]]")
    holes: list[Hole] = item([], text="holes, [[geometry.holes]]")
    cracks: list[CrackLine] = item([], text="cracks of any path, [[geometry.cracks]]")


class PlateGeometry(_Geometry):
    """A polygon with holes and cracks."""

    made: ClassVar = plate.Plate
    mesher: ClassVar = plate.Plate.mesh

    kind: Literal["plate"] = item(text="a polygon with holes and cracks")
    outline: Annotated[list[Pair], Field(min_length=3)] = item(
        text='corners counter-clockwise; its sides are the edge sets "edge1", "edge2", ...', unit="m"
    )
    holes: list[Hole] = item([], text="holes, [[geometry.holes]]")
    cracks: list[CrackLine] = item([], text="cracks, [[geometry.cracks]]")
    edge_names: list[Name] | None = item(
        None, text='edge set of each side in the outline\'s order; sides may share one; default "edge1", ...'
    )


class GmshGeometry(_Geometry):
    """A gmsh model with physical groups: surfaces are materials, curves edge sets, points named points."""

    mesher: ClassVar = reader.read_gmsh

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


class Isotropic(Table):
    """Isotropic linear elastic material."""

    made: ClassVar = material.Material

    kind: Literal["isotropic"] = item("isotropic", text="the same in all directions")
    young: float = item(text="Young's modulus", unit="Pa", gt=0)
    poisson: float = item(text="Poisson's ratio", gt=-1, le=0.5)
    density: float = item(text="density", unit="kg/m^3", gt=0)
    plane: Literal["stress", "strain"] = item("stress", text="plane stress or plane strain")


class Orthotropic(Table):
    """Orthotropic linear elastic material."""

    made: ClassVar = material.OrthotropicMaterial

    kind: Literal["orthotropic"] = item(text="different along two axes")
    young_1: float = item(text="Young's modulus along axis 1", unit="Pa", gt=0)
    young_2: float = item(text="Young's modulus along axis 2", unit="Pa", gt=0)
    poisson_12: float = item(text="-eps_2 / eps_1 under stress along 1")
    shear_12: float = item(text="shear modulus", unit="Pa", gt=0)
    density: float = item(text="density", unit="kg/m^3", gt=0)
    angle: float = item(0.0, text="from the x axis to axis 1, counter-clockwise", unit="degree")
    plane: Literal["stress", "strain"] = item("stress", text="plane stress or plane strain")
    young_3: float | None = item(
        None, text="normal to the plane, plane strain only; default: young_2", unit="Pa", gt=0
    )
    poisson_13: float | None = item(None, text="plane strain only; default: poisson_12")
    poisson_23: float | None = item(None, text="plane strain only; default: poisson_12")


def _material_kind(value: Any) -> Any:
    return value.get("kind", "isotropic") if isinstance(value, dict) else getattr(value, "kind", None)


Material = Annotated[
    Annotated[Isotropic, Tag("isotropic")] | Annotated[Orthotropic, Tag("orthotropic")],
    Discriminator(_material_kind),
]


class Support(Table):
    """A support of an edge set or a point, direction by direction."""

    made: ClassVar = supports.Support

    where: Name = item(text="edge set or point")
    x: bool | float = item(True, text="true: held, false: free, a number: stiffness", unit="N/m^3 or N/m")
    y: bool | float = item(True, text="true: held, false: free, a number: stiffness", unit="N/m^3 or N/m")


Ratio = Annotated[float, Field(ge=0, lt=1)]


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
    rayleigh: Pair | RayleighBand | None = item(
        None, text="[a, b] of a damping matrix a M + b K (1/s and s), or { low, low_ratio, high, high_ratio }"
    )
    thickness: float = item(1.0, text="thickness", unit="m", gt=0)
    continued_fraction: int = item(
        1, text="terms of the continued fraction for the inertia of S-elements", ge=0, le=20
    )

    def problems(self) -> Iterator[Problem]:
        """Damping factors below zero."""
        for k, value in enumerate(self.rayleigh if isinstance(self.rayleigh, list) else ()):
            if value < 0.0:
                yield Problem(("rayleigh", k), f"= {value:g} must not be negative")
