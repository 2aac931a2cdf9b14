"""What a row of a sweep keeps of an analysis: indicators, harmonics, convergence and energy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..indicators.detection import contact_duty
from ..indicators.lines import harmonic_ratios
from .case.case import Case
from .case.loads import COMPONENTS
from .case.sweep import Noise
from .solve import modulation, stresses
from .summaries import line_values, lines_of

# Harmonics kept of every point.
HARMONICS = 21
# Highest order of the ratios A_n / A_1 that stand in the table.
RATIOS = 6

Values = dict[str, tuple[Any, str]]  # value and unit by name


def figures(
    case: Case,
    name: str,
    result: Any,
    points: Sequence[str],
    *,
    noise: tuple[Noise, int] | None,
    histories: bool,
) -> Values:
    """Values of an analysis in a row.

    Parameters
    ----------
    case : Case
        That of the row.
    name : str
        Analysis.
    result
        Of the analysis.
    points : sequence of str
    noise : (Noise, int) or None
        With the number of the row, which together with its seed seeds the noise. Adds values read from a
        noisy motion, whose names end with "_noisy".
    histories : bool
        Keep the motion of the points too.
    """
    table = case.tables.analyses[name]
    makers = {
        "modal": _modal,
        "static": _static,
        "load_history": _load_history,
        "transient": _transient,
        "periodic": _periodic,
        "modulation": _modulation,
        "quasi_periodic": _quasi_periodic,
        "quasi_periodic_response": _quasi_periodic_response,
        "frequency_response": _curve,
        "load_response": _curve,
        "backbone": _backbone,
        "locus": _locus,
        "basins": _basins,
        "swept_response": _swept,
    }
    random = None
    if noise is not None:
        (kind, row), place = noise, list(case.tables.analyses).index(name)
        random = _Noisy(kind.snr, np.random.default_rng([kind.seed, row, place]))
    return makers[table.kind](case, table, result, points, random, histories)


class _Noisy:
    """Adds white noise of a signal-to-noise ratio (dB, of powers about the mean)."""

    def __init__(self, snr: float, random: np.random.Generator):
        self.share, self.random = 10.0 ** (-snr / 20.0), random

    def __call__(self, values: np.ndarray) -> np.ndarray:
        level = self.share * float(np.std(values))
        return values + level * self.random.standard_normal(values.shape)


def _modal(case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool) -> Values:
    return {
        "frequencies": (np.asarray(result.frequencies), "Hz"),
        "largest_residual": (float(np.max(result.residuals)), "1"),
        **_estimated(table, result),
    }


def _static(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    values: Values = {f"displacement/{point}": (result.displacement(point), "m") for point in points}
    values["contact_resultant"] = (float(result.contact_resultant), "N")
    values["residual"] = (float(result.residual), "1")
    for name, pair in result.stress_intensity.items():
        values[f"stress_intensity/{name}"] = (np.asarray(pair), result.model.tips.unit(name))
    for place, stress in stresses(table, result).items():
        values[f"stress/{place}"] = (stress, "Pa")
    values.update(_estimated(table, result))
    return values


def _estimated(table: Any, result: Any) -> Values:
    """Error of an analysis that an accuracy is asked of."""
    return {} if table.accuracy is None else {"estimated_error": (float(result.estimate.error), "1")}


def _load_history(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    values: Values = {
        "peak_contact_resultant": (float(result.contact_resultant.max(initial=0.0)), "N"),
        "closed_states": (float(np.sum(result.contact_resultant > 0.0)), "1"),
    }
    for point in points:
        u = result.displacement(point)
        values[f"peak/{point}"] = (float(np.abs(u[:, 1]).max()), "m")
        if histories:
            values[f"displacement/{point}"] = (u, "m")
    for name in result.states[0].stress_intensity:
        factors, unit = result.stress_intensity(name), result.states[0].model.tips.unit(name)
        values[f"peak_stress_intensity/{name}"] = (np.abs(factors).max(axis=0), unit)
        if histories:
            values[f"stress_intensity/{name}"] = (factors, unit)
    if histories:
        values["time"] = (result.time, "s")
    return values


def _transient(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    energy = result.energy
    supplied = float(np.abs(energy.external).max(initial=0.0))
    values: Values = {
        "energy_error": (float(np.abs(energy.balance).max()) / supplied if supplied else 0.0, "1"),
        "peak_contact_resultant": (float(result.contact_resultant.max(initial=0.0)), "N"),
    }
    if result.contact_force.shape[1]:
        values["contact_duty"] = (contact_duty(result.time, result.contact_force).any, "1")
    for point in points:
        u = result.displacement(point)
        values[f"peak/{point}"] = (float(np.abs(u[:, 1]).max()), "m")
        if histories:
            values[f"displacement/{point}"] = (u, "m")
            if noisy is not None:
                values[f"displacement_noisy/{point}"] = (np.stack([noisy(c) for c in u.T], axis=1), "m")
    if histories:
        values["time"] = (result.time, "s")
    return values


def _periodic(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    values: Values = {}
    for point in points:
        u = result.displacement(point)
        values[f"amplitude/{point}"] = (0.5 * float(np.ptp(u[:, 1])), "m")
        _add_harmonics(values, "", point, u[:, 1], result.periods)
        if noisy is not None:
            _add_harmonics(values, "_noisy", point, noisy(u[:, 1]), result.periods)
        if histories:
            values[f"displacement/{point}"] = (u, "m")
    if histories:
        values["time"] = (result.time, "s")
    values["peak_contact_resultant"] = (float(result.contact_resultant.max(initial=0.0)), "N")
    if result.contact_force.shape[1]:
        values["contact_duty"] = (contact_duty(result.time, result.contact_force).any, "1")
    values["converged"] = (float(result.converged), "1")
    values["iterations"] = (float(result.iterations), "1")
    values["residual"] = (float(result.residuals[-1]), "1")
    if len(result.multipliers):
        values["largest_multiplier"] = (float(np.abs(result.multipliers[0])), "1")
        values["stable"] = (_truth(result.stable), "1")
    balance = energy_balance(case, table, result)
    if balance is not None:
        values["energy_error"] = (balance, "1")
    return values


def _truth(verdict: bool | None) -> float:
    """1 or 0, nan for none."""
    return math.nan if verdict is None else float(verdict)


def _add_harmonics(values: Values, ending: str, point: str, u: np.ndarray, periods: int) -> None:
    c = np.fft.rfft(u)[::periods] / len(u)
    c[1:] *= 2.0
    values[f"harmonics{ending}/{point}"] = (c[:HARMONICS], "m")
    if abs(c[1]) > 0.0:
        ratio = harmonic_ratios(c[:HARMONICS])
        for n in range(2, RATIOS + 1):
            values[f"A{n}_A1{ending}/{point}"] = (float(ratio[n]), "1")


def _modulation(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    values = _periodic(case, table, result, points, None, histories)
    # ratios to the low tone's own amplitude mean little for tones that are no multiples of it
    values = {key: entry for key, entry in values.items() if not key.startswith("A")}
    found = {"": modulation(table, result)["sidebands"]}
    if noisy is not None:
        found["_noisy"] = modulation(table, result, noisy)["sidebands"]
    for ending, sidebands in found.items():
        values[f"modulation_index{ending}"] = (sidebands.modulation_index, "1")
        values[f"sideband_indices{ending}"] = (np.asarray(sidebands.indices), "1")
        values[f"carrier_amplitude{ending}"] = (abs(sidebands.centre), "m")
    return values


def _quasi_periodic(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    named = lines_of(result.frequencies, table.order)
    values: Values = {
        "contact_peak": (float(result.contact_peak), "N"),
        "residual": (float(result.residuals[-1]), "1"),
        "iterations": (float(len(result.residuals) - 1), "1"),
        "line_frequency": (np.abs(named @ np.array(result.frequencies)), "Hz"),
    }
    if len(result.exponents):
        values["largest_exponent"] = (float(result.exponents[0]), "1/s")
        values["stable"] = (_truth(result.stable), "1")
    for point in points:
        values[f"lines/{point}"] = (line_values(result, named, point), "m")
        values[f"modulation_index/{point}"] = (result.modulation_index(point), "1")
        values[f"carrier_amplitude/{point}"] = (abs(result.line(1, 0, point)), "m")
    return values


def _quasi_periodic_response(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    own = result.frequencies[:, 1]
    values: Values = {
        "complete": (float(result.complete), "1"),
        "curve_points": (float(len(result)), "1"),
        "unstable_points": (float(np.sum(~result.stable)), "1"),
        "least_own_frequency": (float(own.min()), "Hz"),
        "largest_own_frequency": (float(own.max()), "Hz"),
    }
    for point in points:
        values[f"own_amplitude/{point}"] = (float(np.abs(result.line(0, 1, point)).max()), "m")
    return values


def _curve(case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool) -> Values:
    values: Values = {
        "complete": (float(result.complete), "1"),
        "curve_points": (float(len(result.value)), "1"),
        "unstable_points": (float(np.sum(~np.asarray(result.stable))), "1"),
        "bifurcations": (float(len(result.bifurcations)), "1"),
    }
    for point in points:
        if result.parameter == "frequency":
            peak = result.peak(point)
            values[f"peak_frequency/{point}"] = (peak.frequency, "Hz")
            values[f"peak_amplitude/{point}"] = (peak.amplitude, "m")
            values[f"bandwidth/{point}"] = (peak.bandwidth, "Hz")
            values[f"skewness/{point}"] = (peak.skewness, "1")
        else:
            values[f"last_amplitude/{point}"] = (float(result.amplitude(point)[-1]), "m")
    return values


def _backbone(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    frequency = np.asarray(result.frequency)
    return {
        "first_frequency": (float(frequency[0]), "Hz"),
        "last_frequency": (float(frequency[-1]), "Hz"),
        "last_energy": (float(np.asarray(result.energy)[-1]), "J"),
    }


def _locus(case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool) -> Values:
    values: Values = {}
    for kind in table.bifurcations:
        lines = [line for line in result if line.kind == kind]
        name = kind.replace(" ", "_").replace("-", "_").lower()
        values[f"{name}_lines"] = (float(len(lines)), "1")
        least = min((float(line.value.min()) for line in lines), default=math.nan)
        values[f"{name}_least_factor"] = (least, "1")
    return values


def _swept(case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool) -> Values:
    values: Values = {}
    for swept in result:
        way = "up" if swept.upwards else "down"
        for point in points:
            jumps = swept.jumps(point, table.least) if swept.tells_jumps else ()
            values[f"{way}_amplitude/{point}"] = (float(swept.amplitude(point).max()), "m")
            values[f"{way}_jumps/{point}"] = (float(len(jumps)) if swept.tells_jumps else math.nan, "1")
            values[f"{way}_first_jump/{point}"] = (jumps[0].frequency if jumps else math.nan, "Hz")
    return values


def _basins(
    case: Case, table: Any, result: Any, points: Sequence[str], noisy: Any, histories: bool
) -> Values:
    return {
        "orbits": (float(len(result.orbits)), "1"),
        "largest_share": (float(result.share.max(initial=0.0)), "1"),
        "not_settled": (float(np.mean(result.reached < 0)), "1"),
    }


def energy_balance(case: Case, table: Any, result: Any) -> float | None:
    """What the loads supply over a period less what damping takes, relative to the former: zero but for the
    time steps' error. None where loads other than point forces act, or nothing is damped.
    """
    names = [*(getattr(table, "load", None) or []), *(getattr(table, "pump", None) or [])]
    names += getattr(table, "probe", None) or []
    loads = [case.tables.loads[name] for name in names]
    reduced, states = result.reduced, result.states
    if reduced is None or any(load.kind != "point_force" for load in loads):
        return None
    duration = result.periods / result.frequency
    lost = 2.0 * duration * float((reduced.damping * reduced.omega * (states.v**2).mean(axis=0)).sum())
    supplied, column = 0.0, 0
    for load in loads:
        for key in COMPONENTS:
            value = getattr(load, key, 0.0)
            if isinstance(value, float) and value == 0.0:
                continue
            u = result.displacement(load.point)[:, "xy".index(key[1])]
            supplied += duration * float(np.mean(states.amplitudes[:, column] * _derivative(u, duration)))
            column += 1
    return (supplied - lost) / supplied if supplied > 0.0 and lost > 0.0 else None


def _derivative(u: np.ndarray, duration: float) -> np.ndarray:
    c = np.fft.rfft(u)
    turns = 2.0j * np.pi / duration * np.arange(len(c))
    if len(u) % 2 == 0:
        turns[-1] = 0.0
    return np.fft.irfft(turns * c, len(u))
