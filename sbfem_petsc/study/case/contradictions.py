"""What single keys cannot tell: names that do not exist, tables that contradict each other."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

from .problems import filed, one_of
from .tables import Path, Problem, Table

# Names that the summary of a run uses itself.
RESERVED = ("run",)


def contradictions(case: Any, folder: str) -> list[Problem]:
    """Problems of tables that are valid each by itself.

    Parameters
    ----------
    case : CaseTables
    folder : str
        Folder that paths in the case are relative to.
    """
    return [
        *_geometry(case, folder),
        *_model(case),
        *_loads(case, folder),
        *_within(case, ()),
        *_analyses(case),
    ]


def _within(value: Any, path: Path) -> Iterator[Problem]:
    """What each table says of itself."""
    if isinstance(value, Table):
        for problem in value.problems():
            yield Problem((*path, *problem.path), problem.text)
        value = {name: getattr(value, name) for name in type(value).model_fields}
    entries = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
    for key, entry in entries:
        yield from _within(entry, (*path, key))


def _geometry(case: Any, folder: str) -> Iterator[Problem]:
    kind = case.geometry.kind
    for key in sorted(case.mesh.model_fields_set):
        known = case.geometry.mesh_keys()
        if key not in known:
            yield Problem(("mesh", key), f"is not for geometry.kind = {kind!r}; {one_of(known)}")
    if kind == "gmsh":
        path = os.path.join(folder, case.geometry.file)
        if not os.path.isfile(path):
            yield Problem(
                ("geometry", "file"),
                f"= {case.geometry.file!r} does not exist in {folder!r}; name a gmsh model relative to the "
                "case file",
            )
        if case.points:
            yield Problem(
                ("points",),
                "is not for a gmsh model, whose named points are its physical points; add them there",
            )
    if case.material is not None and case.materials:
        yield Problem(
            ("materials",),
            "stands beside [material]; give one material for the whole body or one a region, not both",
        )
    if case.material is None and not case.materials:
        yield Problem(("material",), "is missing; add [material] with young, poisson and density")


def _model(case: Any) -> Iterator[Problem]:
    if case.model.clamped is None and not case.model.supports and case.geometry.kind != "beam":
        yield Problem(
            ("model", "clamped"),
            f"is missing, which only a beam has a default for; name an edge set of the {case.geometry.kind}, "
            "or write clamped = [] for a free structure",
        )


def _loads(case: Any, folder: str) -> Iterator[Problem]:
    for name, load in case.loads.items():
        given = load.components
        if all(value == 0.0 for value in given.values()):
            yield Problem(("loads", name), f"has no component other than 0; give {' or '.join(given)}")
        for key, value in given.items():
            missing = getattr(value, "kind", None) == "samples" and not os.path.isfile(
                os.path.join(folder, value.file)
            )
            if missing:
                yield Problem(
                    ("loads", name, key, "file"),
                    f"= {value.file!r} does not exist in {folder!r}; name a file relative to the case file",
                )


def _analyses(case: Any) -> Iterator[Problem]:
    for name, analysis in case.analyses.items():
        path: Path = ("analyses", name)
        if name in RESERVED or not filed(name):
            yield Problem(
                path, "cannot be a name of an analysis; use letters, digits, '-' and '_', at most 100 of them"
            )
        rubbing = [crack for crack, law in case.model.contact_laws.items() if law.rubs]
        if rubbing and analysis.frictionless is not None:
            yield Problem(
                (*path, "kind"),
                f"= {analysis.kind!r}{analysis.frictionless} knows no friction yet, and the faces of "
                f"{rubbing[0]!r} rub; leave it out, or give model.contact_laws.{rubbing[0]} another kind",
            )
        for problem in analysis.against(case):
            yield Problem((*path, *problem.path), problem.text)
    for name in (case.sweep.analyses if case.sweep is not None else None) or ():
        if name not in case.analyses:
            text = f"= {name!r} is no analysis; {one_of(case.analyses, name)}"
            yield Problem(("sweep", "analyses"), text)
