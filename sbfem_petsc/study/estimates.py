"""What a case will take: sizes from its mesh and model; memory, disk and time by fitted rules.

Times are those of one core of a server with MUMPS, beams of 3,206 to 112,086 unknowns with 43 to 127 contact
pairs and 30 to 200 modes: the rules for modes, reductions, steady states and histories meet them within a
factor of three. How many points and lines curves and loci have is not known beforehand. Memory is fitted to
plates with ten cracks of 72,000 to 980,000 unknowns, statics and 20 modes apart, on one and two ranks: the
rules are above what was measured, by less than a half.
"""

from __future__ import annotations

import math
from typing import Any

from ..parallel import collective
from .case import parameters
from .case.case import Case
from .solve import Structure, common_period, steps_of_two_tones
from .tones import check_tones

# Bytes: the program and its libraries, on each rank; of N log2 N of N displacement unknowns, statics with a
# factor of the stiffness and one of contact, and analyses that rest on modes.
_BASE_MEMORY = 260e6
_STATICS, _MODES = 570.0, 760.0
# An unknown, auxiliary ones included, of the unreduced model: its matrices.
_UNREDUCED = 8e3
_FEWEST_MODES, _STEPS = 80, 512
# Bytes of the figures of a row of a sweep.
ROW = 3e3
# Points of a response curve, where the case does not say.
_CURVE_POINTS = 60
# Seconds: a step of a history, for each mode and as much again for each so many contact pairs; a step of a
# steady state without its multipliers, for the square of the modes and for the pairs, and with them.
_HISTORY, _ALIKE = 1.5e-8, 26.0
_SQUARE, _PAIR, _MULTIPLIERS = 1.6e-9, 1.5e-7, 2.0


def estimate(case: Case, comm: Any) -> dict[str, Any]:
    """Sizes, and estimates of memory (bytes on all ranks), disk (bytes) and time (s of one core). Collective.

    The mesh and the model are made for it; nothing is solved.
    """
    with collective(comm):
        check_tones(case, case.tables.sweep.parameters if case.tables.sweep is not None else ())
    structure = Structure(case, comm)
    model = structure.model
    lower, upper = model.extent
    facts: dict[str, Any] = {
        "title": case.tables.title,
        "extent": [*map(float, lower), *map(float, upper)],
        "elements": int(model.elements),
        "order": int(model.order),
        "boundary_unknowns": int(model.boundary_unknowns),
        "unknowns": int(model.unknowns),
        "contact_pairs": len(model.pairs),
        "cracks": [crack.name for crack in model.cracks],
        "points": {name: list(map(float, place)) for name, (place, _, _) in model.points.items()},
        "edge_sets": list(model.edge_set_names),
        "regions": list(model.material_names),
        "analyses": {},
    }
    points = len(structure.points(case))
    structure.destroy()
    sizes = (facts["unknowns"], facts["contact_pairs"], points)
    for name, table in case.tables.analyses.items():
        seconds, memory, disk = demand(case, table, *sizes)
        facts["analyses"][name] = {
            "kind": table.kind,
            "seconds": seconds,
            "memory": memory
            + model_memory(
                table.kind,
                facts["boundary_unknowns"],
                ranks=comm.size,
                unreduced=facts["unknowns"] if not getattr(table, "reduced", True) else 0,
            ),
            "disk": disk,
        }
    entries = facts["analyses"].values()
    facts["seconds"] = 0.2 + 5e-6 * facts["unknowns"] + sum(entry["seconds"] for entry in entries)
    facts["memory"] = max(entry["memory"] for entry in entries)
    facts["disk"] = 2e5 + sum(entry["disk"] for entry in entries)
    if case.tables.sweep is not None:
        facts["sweep"] = _sweep(case, facts)
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
    each = _STATICS if kind in ("static", "load_history") else _MODES
    growth = boundary_unknowns * math.log2(boundary_unknowns + 1)
    return ranks * _BASE_MEMORY + each * growth + _UNREDUCED * unreduced


def _sweep(case: Case, facts: dict[str, Any]) -> dict[str, Any]:
    table = case.tables.sweep
    assert table is not None
    rows = parameters.rows(table)
    structures = len({parameters.structural(row) for row in rows})
    chosen = [facts["analyses"][name] for name in table.analyses or facts["analyses"]]
    each, shared = 0.0, 0.2 + 5e-6 * facts["unknowns"]
    for entry in chosen:
        once = entry["kind"] in ("modal", "periodic", "modulation", "quasi_periodic")
        quick = min(entry["seconds"], 0.15) if once else entry["seconds"]
        quick = 0.0 if entry["kind"] == "modal" else quick
        each, shared = each + quick, shared + entry["seconds"] - quick
    return {
        "rows": len(rows),
        "structures": structures,
        "seconds": structures * shared + len(rows) * each,
        "disk": len(rows) * (ROW + (sum(e["disk"] for e in chosen) if table.histories else 0.0)),
    }


def demand(case: Case, table: Any, unknowns: int, pairs: int, points: int) -> tuple[float, float, float]:
    """Seconds, bytes of memory beside the model's, and bytes on the disk, of an analysis of a case."""
    kind = table.kind
    if kind == "modal":
        count = table.count or 50
        return _modal(unknowns, count), 8.0 * unknowns * 3 * count, 16.0 * count * (points + 1)
    if kind == "static":
        return 0.03 + 1e-5 * unknowns, 0.0, 32.0 * pairs
    if kind == "load_history":
        count = len(parameters.grid(table.times))
        return (
            count * (0.01 + 1e-5 * unknowns),
            24.0 * unknowns * count,
            8.0 * count * (2 * pairs + 4 * points),
        )
    modes = getattr(table, "modes", None) or min(_FEWEST_MODES, max(1, unknowns // 4))
    reduction = _modal(unknowns, modes)
    stepping = _HISTORY * modes * (1.0 + pairs / _ALIKE)
    shooting = _SQUARE * modes**2 + _PAIR * pairs  # of a step
    if kind == "transient":
        step = table.step or _step(case, table)
        count = max(1, math.ceil(table.duration / step))
        row = 8.0 * (2 * modes + pairs + 6 + 4 * points)
        seconds = reduction + count * stepping
        if not table.reduced:
            seconds = count * 2.4e-7 * unknowns
        kept = count / (table.decimation or 1)
        return seconds, row * min(kept, 1e9), 2.0 * row * kept
    if kind == "basins":
        starts = math.prod(len(parameters.grid(axis.values)) for axis in table.starts)
        # about a hundred periods a history
        seconds = 100 * starts * (table.steps or _STEPS) * stepping
        return reduction + seconds, 16.0 * starts * modes, 32.0 * starts
    if kind == "swept_response":
        cycles = 0.5 * (table.start + table.stop) * table.duration * (1 + table.back)
        count = cycles * (table.steps or 320) * max(table.start, table.stop) / min(table.start, table.stop)
        return reduction + count * stepping, 8.0 * count * points, 16.0 * cycles * (points + 2)
    steps = getattr(table, "steps", None) or _STEPS
    periods = getattr(table, "periods", None) or 1
    if kind == "quasi_periodic":
        steps = table.steps or _STEPS
        # iterations of Newton's method on all samples, each with the derivative of its trajectory
        seconds = 4 * table.samples * steps * shooting
        memory = 8.0 * table.samples * (2 * modes * (2 * modes + steps) + steps * pairs)
        return reduction + seconds, memory, 16.0 * points * (2 * table.order + 1) ** 2
    if kind == "modulation":
        steps = table.steps or steps_of_two_tones(table.pump_frequency, table.probe_frequency)
        low = common_period(table.pump_frequency, table.probe_frequency, table.longest)
        periods = max(1, round(low * table.pump_frequency))
    one = steps * periods * shooting
    arrays = 8.0 * steps * periods * (6 * modes + 3 * pairs)
    if getattr(table, "stability", False):
        one *= _MULTIPLIERS
    if kind in ("frequency_response", "load_response"):
        if not getattr(table, "contact", True):
            return reduction, 0.0, 1e6
        count = min(table.points, _CURVE_POINTS)
        return reduction + one * count, arrays, 400.0 * count * (modes + points * 60)
    if kind == "locus":
        # a curve with its multipliers, and three Newton iterations with four sets of them a point of a line
        count, lines = _CURVE_POINTS, 4
        seconds = _MULTIPLIERS * one * (count + 12 * lines * min(table.points, 40))
        return reduction + seconds, arrays, 64.0 * lines * table.points
    if kind == "backbone":
        # some iterations a point, and each once more with half the step
        count = min(table.points, _CURVE_POINTS)
        return reduction + 6 * one * count, arrays, 400.0 * count * (modes + points * 60)
    if kind == "quasi_periodic_response":
        # a curve with its multipliers, and about four iterations on all samples a motion
        count, lines = min(table.points, _CURVE_POINTS), points * (2 * table.order + 1) ** 2
        seconds = _MULTIPLIERS * one * (_CURVE_POINTS + 8 * table.samples * count)
        memory = 8.0 * table.samples * (2 * modes * (2 * modes + steps) + steps * pairs)
        return reduction + seconds, memory, 16.0 * count * (lines + 2 * table.samples * modes)
    return reduction + one, arrays, 8.0 * steps * periods * (3 * modes + pairs + 2 * points)


def _modal(unknowns: int, count: int) -> float:
    return 0.05 + 6e-7 * unknowns * count


def _step(case: Case, table: Any) -> float:
    """The default step of a history whose highest mode is not known yet: that of the load, at most."""
    highest = 0.0
    for name in table.load:
        for value in case.tables.loads[name].model_dump().values():
            if isinstance(value, dict):
                found = [value.get(key) or 0.0 for key in ("frequency", "start", "stop")]
                highest = max(highest, *found)
    return 1.0 / (320.0 * highest) if highest > 0.0 else table.duration / 2000.0


def told(case: Case, facts: dict[str, Any]) -> str:
    """Estimates as text."""
    x0, y0, x1, y1 = facts["extent"]
    cracks = len(facts["cracks"])
    lines = [
        f"{case.file}: a valid case" + (f", {facts['title']!r}" if facts["title"] else ""),
        f"  body           [{x0:g}, {x1:g}] x [{y0:g}, {y1:g}] m, {cracks} crack{'s' * (cracks != 1)}",
        f"  mesh           {facts['elements']} S-elements of order {facts['order']}, "
        f"{facts['boundary_unknowns']:,d} boundary unknowns, {facts['unknowns']:,d} with auxiliary ones, "
        f"{facts['contact_pairs']} contact pairs",
        f"  points         {', '.join(facts['points']) or 'none'}",
        f"  edge sets      {', '.join(facts['edge_sets'])}",
        f"  regions        {', '.join(facts['regions'])}",
        "  expected (estimates, one core):",
    ]
    for name, entry in facts["analyses"].items():
        lines.append(
            f"    {name:18s} {entry['kind']:18s} {duration(entry['seconds']):>9s}   memory "
            f"{size(entry['memory'])}, disk {size(entry['disk'])}"
        )
    lines.append(
        f"    {'all':18s} {'':18s} {duration(facts['seconds']):>9s}   memory {size(facts['memory'])}, disk "
        f"{size(facts['disk'])}; the first run compiles for some 20 s more"
    )
    if "sweep" in facts:
        found = facts["sweep"]
        lines.append(
            f"    sweep              {found['rows']:,d} rows on {found['structures']:,d} structures  "
            f"{duration(found['seconds'])} of one core, disk {size(found['disk'])}"
        )
    return "\n".join(lines)


def duration(seconds: float) -> str:
    """A time to two digits, in a fitting unit."""
    for limit, unit, factor in ((90.0, "s", 1.0), (5400.0, "min", 60.0), (math.inf, "h", 3600.0)):
        if seconds < limit:
            return f"{float(f'{seconds / factor:.2g}'):g} {unit}"
    raise AssertionError


def size(count: float) -> str:
    """Bytes to two digits, in a fitting unit."""
    for limit, unit, factor in ((1e6, "kB", 1e3), (1e9, "MB", 1e6), (math.inf, "GB", 1e9)):
        if count < limit:
            return f"{float(f'{count / factor:.2g}'):g} {unit}"
    raise AssertionError
