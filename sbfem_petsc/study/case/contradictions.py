"""What single keys cannot tell: names that do not exist, tables that contradict each other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...options import one_of
from .tables import Path, Problem, Table, within

# Names that the summary of a run uses itself.
RESERVED = ("run",)


def contradictions(case: Any) -> list[Problem]:
    """Problems of the tables of a case (`CaseTables`) that are valid each by itself."""
    if (case.geometry is None) == (case.body is None):
        return [
            Problem(("body",), "stands beside [geometry]; give one of them")
            if case.body is not None
            else Problem(("geometry",), "is missing; add it, or [body] for a body of another code")
        ]
    return [
        *(_geometry(case) if case.body is None else _body(case)),
        *_loads(case),
        *(
            Problem((*path, *problem.path), problem.text)
            for path, table in within(case)
            if isinstance(table, Table)
            for problem in table.problems()
        ),
        *_analyses(case),
    ]


def _geometry(case: Any) -> Iterator[Problem]:
    kind = case.geometry.kind
    known = case.geometry.mesh_keys()
    for key in sorted(case.mesh.model_fields_set.difference(known)):
        yield Problem(("mesh", key), f"is not for geometry.kind = {kind!r}; {one_of(known)}")
    if kind == "gmsh" and case.points:
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
    if case.model.clamped is None and not case.model.supports and kind != "beam":
        yield Problem(
            ("model", "clamped"),
            f"is missing, which only a beam has a default for; name an edge set of the {kind}, or write "
            "clamped = [] for a free structure",
        )


# What a body has not: tables, and keys of [model].
_DRAWN = ("mesh", "points", "material", "materials")
_PLANE = ("clamped", "supports", "contact_laws", "thickness", "continued_fraction")


def _body(case: Any) -> Iterator[Problem]:
    """What stands beside a body and belongs to a geometry, and points that the body has not."""
    given: list[Path] = [(key,) for key in _DRAWN if key in case.model_fields_set]
    given += [("model", key) for key in _PLANE if key in case.model.model_fields_set]
    for path in given:
        yield Problem(path, "is not for a [body], which is held and meshed by its own code; leave it out")
    for path, name, _ in case.named_places():
        if name not in case.body.points:
            yield Problem(path, f"= {name!r} is no point of the body; {one_of(case.body.points, name)}")


def _loads(case: Any) -> Iterator[Problem]:
    for name, load in case.loads.items():
        given, own = load.components, (load.kind in ("force", "support_motion"), load.kind != "force")
        if not own[case.body is None]:
            yield Problem(
                ("loads", name, "kind"),
                f"= {load.kind!r} is not for a {'[body]' if case.body else '[geometry]'}; "
                + (one_of(("force", "support_motion")) if case.body else 'take "point_force", say'),
            )
        if case.body is None and given.get("az"):
            yield Problem(("loads", name, "az"), "is of a [body] in space; leave it out")
        if all(value == 0.0 for value in given.values()):
            yield Problem(("loads", name), f"has no component other than 0; give {' or '.join(given)}")


def _analyses(case: Any) -> Iterator[Problem]:
    for name, analysis in case.analyses.items():
        path: Path = ("analyses", name)
        if name in RESERVED:
            yield Problem(path, f"cannot be a name of an analysis; use another than {', '.join(RESERVED)}")
        laws = {f"model.contact_laws.{crack}": law for crack, law in case.model.contact_laws.items()}
        if case.body is not None:
            laws = {f"body.contacts[{k}].law": pair.law for k, pair in enumerate(case.body.contacts)}
        rubbing = next((name for name, law in laws.items() if law is not None and law.rubs), None)
        if rubbing is not None and analysis.frictionless is not None:
            yield Problem(
                (*path, "kind"),
                f"= {analysis.kind!r}{analysis.frictionless} knows no friction yet, and the faces of "
                f"{rubbing.removeprefix('model.contact_laws.')!r} rub; leave it out, or give {rubbing} "
                "another kind",
            )
        for problem in analysis.against(case):
            yield Problem((*path, *problem.path), problem.text)
    for name in (case.sweep.analyses if case.sweep is not None else None) or ():
        if name not in case.analyses:
            text = f"= {name!r} is no analysis; {one_of(case.analyses, name)}"
            yield Problem(("sweep", "analyses"), text)
