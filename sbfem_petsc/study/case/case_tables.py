"""The tables of a case file, together."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from ...options import Pair, item
from .analyses import Analysis
from .body import Body
from .geometry import Geometry, Material, Mesh, ModelTable
from .parts import Load
from .sweep import SweepTable
from .tables import FileName, Name, Path, Table


class Output(Table):
    """What is kept and drawn."""

    points: list[Name] | None = item(None, text="points whose motion is kept; default: all named points")
    pictures: bool = item(True, text="draw pictures into the folder's pictures/")
    animation: bool = item(
        False,
        text="draw the first crack over each history and steady state of a reduced model, as a GIF in "
        "pictures/",
    )
    vtu: bool = item(False, text="write modes and static displacements for ParaView")
    csv: bool = item(False, text="write tables as CSV files into the folder's tables/")


class CaseTables(Table):
    """The tables of a case file."""

    title: str = item("", text="what the case is about")
    geometry: Geometry | None = item(None, text="what is drawn and meshed; or [body]")
    body: Body | None = item(None, text="a body by another code's matrices, in the place of [geometry]")
    mesh: Mesh = item(Mesh(), text="its division into S-elements")
    points: dict[Name, Pair] = item({}, text="further named points, name = [x, y]", unit="m")
    material: Material | None = item(None, text="material of the whole body")
    materials: dict[Name, Material] = item({}, text="materials by region (a gmsh model's surfaces)")
    model: ModelTable = item(ModelTable(), text="supports, damping, thickness")
    loads: dict[Name, Load] = item({}, text="loads by name, [loads.NAME]")
    analyses: Annotated[dict[FileName, Analysis], Field(min_length=1)] = item(
        text="analyses by name, [analyses.NAME], run in this order"
    )
    output: Output = item(Output(), text="what is kept and drawn")
    sweep: SweepTable | None = item(None, text="many values of the case's keys")

    @property
    def kind(self) -> str:
        """That of the geometry or the body."""
        return getattr(self.body or self.geometry, "kind", "")

    @property
    def clamped(self) -> tuple[str, ...]:
        """Names of what is held fixed; a beam's default is its left end."""
        if self.model.clamped is None:
            return ("left",) if self.kind == "beam" and not self.model.supports else ()
        return tuple(self.model.clamped)

    def named_places(self) -> Iterator[tuple[Path, str, str]]:
        """Names of places that the mesh or the body must have: where in the case, which name, and what it is
        not if it does not exist.
        """
        either = "neither an edge set nor a point"
        yield from ((("model", "clamped"), name, either) for name in self.clamped)
        for k, support in enumerate(self.model.supports):
            yield ("model", "supports", k, "where"), support.where, either
        for name, load in self.loads.items():
            for key, what in (("point", "no point"), ("edge_set", "no edge set"), ("where", either)):
                if hasattr(load, key):
                    yield ("loads", name, key), getattr(load, key), what
        yield from ((("output", "points"), name, "no point") for name in self.output.points or ())
        for name, analysis in self.analyses.items():
            yield from ((("analyses", name, *path), point, "no point") for path, point in analysis.places())
