"""A case as a user's file gives it: its tables, and where they stand in the file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...options import Pair, item
from .body import Body
from .geometry import Geometry, Material, Mesh, ModelTable
from .parts import Load
from .problems import CaseError
from .sweep import SweepTable
from .tables import Name, Path, Problem, Table


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


class Tables(Table):
    """The tables of a case file; of what kinds its analyses are, `CaseTables` says."""

    title: str = item("", text="what the case is about")
    geometry: Geometry | None = item(None, text="what is drawn and meshed; or [body]")
    body: Body | None = item(None, text="a body by another code's matrices, in the place of [geometry]")
    mesh: Mesh = item(Mesh(), text="its division into S-elements")
    points: dict[Name, Pair] = item({}, text="further named points, name = [x, y]", unit="m")
    material: Material | None = item(None, text="material of the whole body")
    materials: dict[Name, Material] = item({}, text="materials by region (a gmsh model's surfaces)")
    model: ModelTable = item(ModelTable(), text="supports, damping, thickness")
    loads: dict[Name, Load] = item({}, text="loads by name, [loads.NAME]")
    analyses: dict[Name, Any] = item(text="analyses by name")
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


@dataclass(frozen=True, eq=False)
class Given:
    """What a case consists of.

    Attributes
    ----------
    tables : Tables
    data : dict
        The tables as the user wrote them.
    text : str
        The file's text.
    file : str
        Its path, for messages.
    folder : str
        Folder that the paths in the case are relative to.
    lines : dict of tuple to int
        Line of each path of the case.
    """

    tables: Tables
    data: dict[str, Any]
    text: str
    file: str
    folder: str
    lines: Mapping[Path, int] = field(repr=False, default_factory=dict)

    def problem(self, path: Path, text: str) -> CaseError:
        """The error that something is wrong at a path of the case."""
        return CaseError(self.file, [Problem(path, text)], self.lines)

    def resolve(self, file: str) -> str:
        """Path of a file that the case names."""
        return os.path.join(self.folder, file)
