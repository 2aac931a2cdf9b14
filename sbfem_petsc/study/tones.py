"""Whether loads have the common period and the tones that an analysis needs: what a run would come to refuse
behind the analyses before it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from ..loads import separate
from ..motion.excitation import common_periods
from ..motion.preparation import LONGEST
from ..motion.two_tones import drives
from ..signals.signal import Signal
from ..signals.waves import Harmonic
from .case.case import Case
from .case.objects import load, located


def check_tones(case: Case, varied: Iterable[str] = ()) -> None:
    """Refuse analyses whose loads have no common period, or tones that belong to none of theirs.

    Parameters
    ----------
    case : Case
    varied : iterable of str
        Keys that a sweep gives other values: analyses with tones among them are left to its rows.

    Raises
    ------
    CaseError
    """
    prefixes = {".".join(key.split(".")[:2]) for key in varied}
    for name, table in case.tables.analyses.items():
        loads = {item for key in ("load", "pump", "probe") for item in getattr(table, key, None) or ()}
        used = {f"analyses.{name}", *(f"loads.{item}" for item in loads)}
        check = _CHECKS.get(table.kind)
        if check is not None and not used & prefixes:
            check(case, name, table)


def _signals(case: Case, names: Any, factor: float, frequency: float) -> list[Signal]:
    found = load(case, names, factor, frequency)
    return separate(found, lambda value: Harmonic(value, frequency))[1]


def _periodic(case: Case, name: str, table: Any) -> None:
    signals = _signals(case, table.load, getattr(table, "factor", 1.0), table.frequency)
    with located(case, "analyses", name, "load"):
        periods = common_periods(signals, table.frequency, getattr(table, "periods", None), LONGEST)
    segments, steps = getattr(table, "segments", 1), table.steps
    if steps is not None and steps * periods % segments:
        raise case.problem(
            ("analyses", name, "segments"),
            f"= {segments} must divide the {steps * periods} steps of a period of the motion; give "
            "another number of either, or leave steps out",
        )


def _modulation(case: Case, name: str, table: Any) -> None:
    signals = [
        *_signals(case, table.pump, 1.0, table.pump_frequency),
        *_signals(case, table.probe, 1.0, table.probe_frequency),
    ]
    with located(case, "analyses", name, "probe_frequency"):
        common_periods(signals, table.pump_frequency, None, table.longest)


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
