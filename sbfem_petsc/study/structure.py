"""A model that the analyses of a case share."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from ..errors import on_all_ranks
from ..motion.preparation import expected
from .case import objects
from .case.case import Case
from .case.objects import located
from .case.problems import CaseError
from .case.tables import Problem
from .costs import FEWEST_MODES, Size

# What of a model stands in its facts.
_NUMBERS = ("elements", "order", "boundary_unknowns", "unknowns")


class Structure:
    """A model, which keeps its modes and reductions, or the reduced model of a body, for cases that differ in
    loads and analyses only.

    Parameters
    ----------
    case : Case
    comm : mpi4py communicator
    """

    def __init__(self, case: Case, comm: Any):
        self.comm, self._case = comm, case
        self.body = None if case.tables.body is None else objects.body(case)
        if self.body is None:
            self.model = objects.model(case, comm)

    @functools.cached_property
    def model(self) -> Any:
        """Model, or ReducedModel of a body, made where it is asked for. Collective."""
        assert self.body is not None
        return objects.reduced(self._case, self.body, self.comm)

    def facts(self) -> dict[str, Any]:
        """Sizes and names, for summaries and reports."""
        if self.body is not None:
            found, contact = self.body["model"], self.body["contact"]
            return {
                "body": found.summary().splitlines(),
                "unknowns": len(found.unknowns),
                "contact_pairs": 0 if contact is None else len(contact.gap),
                "points": {name: row.direction for name, row in self.body["points"].items()},
            }
        model = self.model
        return {
            **{name: int(getattr(model, name)) for name in _NUMBERS},
            "contact_pairs": len(model.pairs),
            "extent": [float(x) for corner in model.extent for x in corner],
            "area": float(model.area),
            "points": {name: list(map(float, place)) for name, (place, _, _) in model.points.items()},
            "cracks": [crack.name for crack in model.cracks],
            "edge_sets": list(model.layout.edge_sets),
            "regions": list(model.layout.material_names),
        }

    def size(self, case: Case) -> Size:
        """What the cost of an analysis depends on."""
        facts = self.facts()
        found = functools.partial(expected, self.model) if self.body is None else None
        return Size(case, facts["unknowns"], facts["contact_pairs"], len(self.points(case)), found)

    def points(self, case: Case) -> tuple[str, ...]:
        """Points whose motion is kept."""
        chosen = case.tables.output.points
        known = self.model.points if self.body is None else self.body["points"]
        return tuple(known) if chosen is None else tuple(chosen)

    def check(self, case: Case, names: Iterable[str]) -> None:
        """Raise CaseError where analyses ask for what the structure has not, before any is solved: a run
        would come to it behind those before them. Collective.
        """
        if self.body is None:
            found = self.model, self.model.boundary_unknowns // 2
            words = "half the unknowns on boundaries; ask for fewer, or take a finer mesh"
        else:
            table: Any = case.tables.body
            found = None, table.modes or max(min(FEWEST_MODES, len(self.body["model"].unknowns) // 2), 1)
            words = "those of the reduced body; ask for fewer, or give more as body.modes"
        problems: list[Problem] = []
        for name in names:
            try:
                with located(case, "analyses", name):
                    lacking = [*case.tables.analyses[name].lacking(case, *found, words)]
                problems += (replace(one, path=("analyses", name, *one.path)) for one in lacking)
            except CaseError as error:
                problems += error.problems
        if problems:
            raise on_all_ranks(CaseError(case.file, problems, case.lines))

    def solve(self, case: Case, name: str, **run: Any) -> Any:
        """Result of an analysis of a case of this structure, with `file` and `progress` of `Kind.solve`.
        Collective.
        """
        return case.tables.analyses[name].solve(case, self.model, **run)

    def release(self, result: Any) -> None:
        """Free the finer model that a result of an accuracy asked for was computed on."""
        if getattr(result, "estimate", None) is not None and result.model is not self.model:
            result.model.destroy()

    def close(self) -> None:
        """Free the PETSc objects."""
        if self.body is None:
            self.model.destroy()


def lines_of(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Heading and text of what `Structure.facts` tells of a structure."""
    contact = ("contact pairs", str(facts["contact_pairs"]))
    if "body" in facts:
        return [("body", "; ".join(facts["body"])), contact]
    x0, y0, x1, y1 = facts["extent"]
    unknowns = f"{facts['boundary_unknowns']:,d} on boundaries, {facts['unknowns']:,d} with auxiliary ones"
    return [
        ("body", f"[{x0:g}, {x1:g}] x [{y0:g}, {y1:g}] m"),
        ("mesh", f"{facts['elements']} S-elements of order {facts['order']}"),
        ("unknowns", unknowns),
        contact,
    ]
