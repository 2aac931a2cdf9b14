"""Names of places that a case uses, and that its mesh or body must have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .tables import Path


def clamped(tables: Any) -> tuple[str, ...]:
    """Names of what is held fixed; a beam's default is its left end."""
    names = tables.model.clamped
    if names is None:
        return ("left",) if tables.kind == "beam" and not tables.model.supports else ()
    return tuple(names)


def named_places(tables: Any) -> Iterator[tuple[Path, str, str]]:
    """Where in the case, which name, and what it is not if it does not exist."""
    either = "neither an edge set nor a point"
    yield from ((("model", "clamped"), name, either) for name in clamped(tables))
    for k, support in enumerate(tables.model.supports):
        yield ("model", "supports", k, "where"), support.where, either
    for name, load in tables.loads.items():
        for key, what in (("point", "no point"), ("edge_set", "no edge set"), ("where", either)):
            if hasattr(load, key):
                yield ("loads", name, key), getattr(load, key), what
    yield from ((("output", "points"), name, "no point") for name in tables.output.points or ())
    for name, analysis in tables.analyses.items():
        yield from ((("analyses", name, *path), point, "no point") for path, point in analysis.places())
