"""Whether loads have the common period and the tones that an analysis needs: what a run would come to refuse
behind the analyses before it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..analysis.quasi_periodic import drives
from ..dynamics.excitation import Excitation
from ..dynamics.preparation import LONGEST
from ..loads import separate
from ..signals import Harmonic, Signal
from .case import Case
from .objects import load, located


def check_tones(case: Case) -> None:
    """Refuse analyses whose loads have no common period, or tones that belong to none of theirs.

    Raises
    ------
    CaseError
    """
    for name, table in case.tables.analyses.items():
        check = _CHECKS.get(table.kind)
        if check is not None:
            check(case, name, table)


def _signals(case: Case, names: Any, factor: float, frequency: float) -> list[Signal]:
    found = load(case, names, factor, frequency)
    return separate(found, lambda value: Harmonic(value, frequency))[1]


def _periodic(case: Case, name: str, table: Any) -> None:
    signals = _signals(case, table.load, getattr(table, "factor", 1.0), table.frequency)
    with located(case, "analyses", name, "load"):
        found = Excitation.of(signals, table.frequency, getattr(table, "periods", None), LONGEST)
    segments, steps = getattr(table, "segments", 1), table.steps
    if steps is not None and steps * found.periods % segments:
        raise case.problem(
            ("analyses", name, "segments"),
            f"= {segments} must divide the {steps * found.periods} steps of a period of the motion; give "
            "another number of either, or leave steps out",
        )


def _modulation(case: Case, name: str, table: Any) -> None:
    signals = [
        *_signals(case, table.pump, 1.0, table.pump_frequency),
        *_signals(case, table.probe, 1.0, table.probe_frequency),
    ]
    with located(case, "analyses", name, "probe_frequency"):
        Excitation.of(signals, table.pump_frequency, None, table.longest)


def _quasi_periodic(case: Case, name: str, table: Any) -> None:
    pair = (table.probe_frequency, table.pump_frequency)
    signals = [*_signals(case, table.probe, 1.0, pair[0]), *_signals(case, table.pump, 1.0, pair[1])]
    with located(case, "analyses", name):
        drives(signals, (max(pair), min(pair)))


_CHECKS: dict[str, Callable[[Case, str, Any], None]] = {
    "periodic": _periodic,
    "load_response": _periodic,
    "basins": _periodic,
    "modulation": _modulation,
    "quasi_periodic": _quasi_periodic,
}
