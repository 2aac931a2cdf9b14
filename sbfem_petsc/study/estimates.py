"""What a case will take: sizes from its mesh and model; memory and disk by fitted rules.

Memory is fitted to plates with ten cracks of 72,000 to 980,000 unknowns, statics and 20 modes apart, on one
and two ranks: the rules are above what was measured, by less than a half. How many points and lines curves
and loci have is not known beforehand. No times are told: modes that grow as an accuracy needs them, and how
many points a curve turns out to have, made rules for these wrong by up to ten times.
"""

from __future__ import annotations

import contextlib
import math
from typing import Any

from ..ranks.capacity import in_bytes
from ..ranks.parallel import collective, on_root
from .case import objects
from .case.analyses import KINDS
from .case.case import Case
from .case.problems import CaseError
from .case.sweep import structural
from .costs import ROW
from .structure import Structure, lines_of

# Bytes: the program and its libraries, on each rank; of N log2 N of N displacement unknowns, statics with a
# factor of the stiffness and one of contact, and analyses that rest on modes.
_BASE_MEMORY = 260e6
_STATICS, _MODES = 570.0, 760.0
# An unknown, auxiliary ones included, of the unreduced model: its matrices.
_UNREDUCED = 8e3


def requirements(case: Case, comm: Any) -> dict[str, Any]:
    """Sizes, and estimates of memory (bytes on all ranks) and disk (bytes). Collective.

    The mesh and the model are made for it, and under slow loads some modes; nothing else is solved.
    """
    with collective(comm):
        case.check_tones(case.unvaried)
    with contextlib.closing(Structure(case, comm)) as structure:
        facts: dict[str, Any] = {"title": case.tables.title, **structure.facts(), "analyses": {}}
        outer = facts.get("boundary_unknowns", facts["unknowns"])
        structure.check(case, case.unvaried)
        size = structure.size(case)
        for name, kind in case.tables.analyses.items():
            cost, unreduced = kind.cost(size), 0 if getattr(kind, "reduced", True) else facts["unknowns"]
            memory = cost.memory + model_memory(kind.kind, outer, ranks=comm.size, unreduced=unreduced)
            told = {"modes": cost.modes, "steps": cost.steps} if cost.modes else {}
            facts["analyses"][name] = {"kind": kind.kind, "memory": memory, "disk": cost.disk, **told}
    facts["memory"] = max(entry["memory"] for entry in facts["analyses"].values())
    disk = {name: entry["disk"] for name, entry in facts["analyses"].items()}
    facts["disk"] = 2e5 + sum(disk.values())
    if case.tables.sweep is not None:
        table, rows = case.tables.sweep, case.tables.sweep.rows()
        kept = sum(disk[name] for name in table.analyses or disk) if table.histories else 0.0
        facts["sweep"] = {
            "rows": len(rows),
            "structures": len({structural(row) for row in rows}),
            "disk": len(rows) * (ROW + kept),
            "refused": on_root(comm, lambda: _refused(case, rows)),
        }
    return facts


def model_memory(kind: str, boundary_unknowns: int, *, ranks: int = 1, unreduced: int = 0) -> float:
    """Bytes on all ranks of an analysis' matrices and factors, and of the programs.

    Parameters
    ----------
    kind : str
    boundary_unknowns : int
    ranks : int
    unreduced : int
        Unknowns of a model that is not reduced, auxiliary ones included; 0 of a reduced one.
    """
    each = _STATICS if KINDS[kind].statics else _MODES
    growth = boundary_unknowns * math.log2(boundary_unknowns + 1)
    return ranks * _BASE_MEMORY + each * growth + _UNREDUCED * unreduced


def _refused(case: Case, rows: list[dict[str, Any]]) -> list[str]:
    """Rows of a sweep that cannot be drawn or meshed, of those with the least and greatest number of each key
    of the structure, and why.
    """
    ends: set[int] = set()
    for name, _ in structural(rows[0]) if case.tables.body is None else ():
        numbers = [n for n, row in enumerate(rows) if not isinstance(row[name], str)]
        ends.update(choose(numbers, key=lambda n: rows[n][name]) for choose in (min, max) if numbers)
    refused = []
    for n in sorted(ends):
        try:
            objects.mesh(case.with_values(rows[n]))
        except CaseError as error:
            values = ", ".join(f"{name} = {value!r}" for name, value in rows[n].items())
            refused.append(f"row {n} of the sweep will fail ({values}): {error}")
    return refused


def as_text(case: Case, facts: dict[str, Any]) -> str:
    """Estimates as text."""
    names = [key for key in ("points", "cracks", "edge_sets", "regions") if key in facts]
    listed = lines_of(facts) + [(key.replace("_", " "), ", ".join(facts[key]) or "none") for key in names]
    lines = [
        f"{case.file}: a valid case" + (f", {facts['title']!r}" if facts["title"] else ""),
        *(f"  {what:14s} {words}" for what, words in listed),
        "  expected (estimates):",
    ]
    for name, entry in {**facts["analyses"], "all": facts}.items():
        told = f"memory {in_bytes(entry['memory'])}, disk {in_bytes(entry['disk'])}"
        if "modes" in entry:
            told += f", from {entry['modes']} modes and {entry['steps']:,d} steps a period"
        lines.append(f"    {name:18s} {entry.get('kind', ''):18s} {told}")
    if "sweep" in facts:
        found = facts["sweep"]
        told = f"{found['rows']:,d} rows on {found['structures']:,d} structures"
        lines.append(f"    {'sweep':18s} {told}, disk {in_bytes(found['disk'])}")
        lines += [f"    {sentence}" for sentence in found["refused"]]
    return "\n".join(lines)
