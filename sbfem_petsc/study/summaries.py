"""Results of analyses as trees of named quantities, for HDF5, JSON and reports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..indicators.lines import Sidebands
from .quantities import Quantity, Tree

# Harmonics of a periodic motion that are kept beside its whole waveform.
HARMONICS = 41


def tree_of(kind: str, result: Any, points: Sequence[str], **further: Any) -> Tree:
    """Quantities of a result.

    Parameters
    ----------
    kind : str
        Kind of the analysis.
    result : Modal, Static, Transient, Orbit, Curve ...
    points : sequence of str
        Points whose motion is kept.
    further
        What the analysis adds: `sidebands` of a modulation, `stress` of a static solution, the `estimate` of
        an accuracy asked for, the `order` of lines, what is said where there is `none`.
    """
    makers: dict[str, Callable[..., Tree]] = {
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
    return makers[kind](result, points, **further)


def _of_points(points: Sequence[str], value: Callable[[str], Any], unit: str, text: str, **more: Any) -> Tree:
    return {point: Quantity(value(point), unit, text, **more) for point in points}


def _modal(result: Any, points: Sequence[str], estimate: Any = None) -> Tree:
    return {
        "frequencies": Quantity(result.frequencies, "Hz", "natural frequencies, open cracks"),
        "residuals": Quantity(result.residuals, "1", "residuals of the eigenpairs"),
        "displacement": _of_points(
            points, result.displacement, "m", "displacement (x, y) in each mass-normalised mode"
        ),
        "solver": Quantity(result.solver),
        "iterations": Quantity(int(result.iterations)),
        "unknowns": Quantity(int(result.unknowns)),
        **_estimated(estimate),
    }


def _estimated(estimate: Any) -> Tree:
    """What an accuracy asked for has led to."""
    if estimate is None:
        return {}
    return {
        "estimate": {
            "error": Quantity(float(estimate.error), "1", "estimated relative error"),
            "first_error": Quantity(float(estimate.first_error), "1", "that of the case's own mesh"),
            "converged": Quantity(bool(estimate.converged), "1", "whether the accuracy is reached"),
            "unknowns": Quantity(
                np.array([level.unknowns for level in estimate.levels]), "1", "displacement unknowns by level"
            ),
        }
    }


def _static(result: Any, points: Sequence[str], stress: dict[str, Any], estimate: Any = None) -> Tree:
    tree: Tree = {
        "displacement": _of_points(points, result.displacement, "m", "displacement (x, y)"),
        "contact_resultant": Quantity(float(result.contact_resultant), "N", "sum of the contact forces"),
        "contact_force": Quantity(result.contact_force, "N", "contact forces, compression positive"),
        "gap": Quantity(result.gap, "m", "gaps of the contact pairs"),
        "active": Quantity(result.active, "1", "pairs in contact"),
        "stress_intensity": {
            name: Quantity(np.asarray(values), result.model.tips.unit(name), "K_I, K_II")
            for name, values in result.stress_intensity.items()
        },
        **_notes(result),
        "residual": Quantity(float(result.residual), "1", "imbalance of the forces, relative to the load"),
        "iterations": Quantity(int(result.iterations), "1", "iterations of the active set"),
        "solver": Quantity(result.solver),
    }
    if stress:
        tree["stress"] = {
            name: Quantity(np.asarray(values), "Pa", "stress xx, yy, xy") for name, values in stress.items()
        }
    return {**tree, **_estimated(estimate)}


def _notes(result: Any) -> Tree:
    """What K, G and T of the tips do not tell by themselves."""
    return {"notes": Quantity("; ".join(result.notes))} if result.notes else {}


def _load_history(result: Any, points: Sequence[str]) -> Tree:
    return {
        "time": Quantity(result.time, "s", "times of the states"),
        "displacement": _of_points(points, result.displacement, "m", "displacement (x, y)"),
        "contact_resultant": Quantity(result.contact_resultant, "N", "sum of the contact forces"),
        "contact_force": Quantity(result.contact_force, "N", "contact forces", detail=True),
        "gap": Quantity(result.gap, "m", "gaps of the contact pairs", detail=True),
        "stress_intensity": {
            name: Quantity(result.stress_intensity(name), result.states[0].model.tips.unit(name), "K_I, K_II")
            for name in result.states[0].stress_intensity
        },
        **_notes(result),
    }


def _transient(result: Any, points: Sequence[str]) -> Tree:
    energy = result.energy
    supplied = float(np.abs(energy.external).max(initial=0.0))
    tree: Tree = {
        "time": Quantity(result.time, "s", "instants"),
        "displacement": _of_points(points, result.displacement, "m", "displacement (x, y)"),
        "velocity": _of_points(points, result.velocity, "m/s", "velocity (x, y)", detail=True),
        "acceleration": _of_points(points, result.acceleration, "m/s^2", "acceleration (x, y)", detail=True),
        "contact_resultant": Quantity(result.contact_resultant, "N", "sum of the contact forces"),
        "contact_force": Quantity(result.contact_force, "N", "contact forces", detail=True),
        "energy": {
            name: Quantity(getattr(energy, name), "J", text, detail=True)
            for name, text in (
                ("kinetic", "kinetic energy"),
                ("strain", "strain energy"),
                ("external", "work of the loads"),
                ("damping", "energy dissipated by damping"),
                ("contact", "work of the contact forces"),
            )
        },
        "step": Quantity(float(result.step), "s", "time step"),
        "energy_error": Quantity(
            float(np.abs(energy.balance).max()) / supplied if supplied > 0.0 else 0.0,
            "1",
            "largest imbalance of the energies, relative to the loads' work",
        ),
    }
    facts = result.states.tip_facts
    if facts.names:
        tree["stress_intensity"] = {
            name: Quantity(result.stress_intensity(name), facts.unit(name), "K_I, K_II", detail=True)
            for name in facts.names
        }
        tree.update(_notes(result))
    return tree


def _periodic(result: Any, points: Sequence[str]) -> Tree:
    tree: Tree = {
        "frequency": Quantity(float(result.frequency), "Hz", "forcing frequency"),
        "periods": Quantity(int(result.periods), "1", "forcing periods in one period of the motion"),
        "harmonics": _of_points(
            points,
            lambda point: result.harmonics(point)[:HARMONICS],
            "m",
            "complex harmonics of u_y, the mean first",
        ),
        "harmonics_x": _of_points(
            points,
            lambda point: result.harmonics(point, "x")[:HARMONICS],
            "m",
            "complex harmonics of u_x, the mean first",
        ),
        "amplitude": _of_points(
            points,
            lambda point: 0.5 * float(np.ptp(result.displacement(point)[:, 1])),
            "m",
            "half the peak-to-peak of u_y",
        ),
        "converged": Quantity(bool(result.converged)),
        "stable": Quantity(result.stable, "1", "stability, None if it was not asked for or is not known"),
        "time": Quantity(result.time, "s", "instants of one period"),
        "displacement": _of_points(points, result.displacement, "m", "displacement (x, y)", detail=True),
        "contact_force": Quantity(result.contact_force, "N", "contact forces", detail=True),
        "contact_resultant": Quantity(result.contact_resultant, "N", "sum of the contact forces"),
    }
    if result.periods > 1:
        tree["subharmonics"] = _of_points(
            points, result.subharmonics, "m", "complex amplitudes of u_y at j f / periods"
        )
    for name, unit, text in (
        ("multipliers", "1", "Floquet multipliers"),
        ("multiplier_error", "1", "uncertainty of the largest modulus"),
        ("iterations", "1", "Newton iterations"),
        ("residuals", "1", "norm of x(T) - x(0) at each iterate"),
        ("path", "1", "how the motion was reached"),
    ):
        value = getattr(result, name)
        tree[name] = Quantity(np.asarray(value) if isinstance(value, tuple) else value, unit, text)
    return tree


def _modulation(result: Any, points: Sequence[str], sidebands: Sidebands, common_period: float) -> Tree:
    tree = _periodic(result, points)
    tree["common_period"] = Quantity(common_period, "s", "common period of both tones")
    tree["sidebands"] = {
        "carrier": Quantity(sidebands.carrier, "Hz", "high tone"),
        "modulation": Quantity(sidebands.modulation, "Hz", "low tone"),
        "centre": Quantity(np.asarray(sidebands.centre), "m", "complex amplitude at the high tone"),
        "lower": Quantity(sidebands.lower, "m", "complex amplitudes at high - n low"),
        "upper": Quantity(sidebands.upper, "m", "complex amplitudes at high + n low"),
        "indices": Quantity(sidebands.indices, "1", "(|lower| + |upper|) / |centre| of each pair"),
        "modulation_index": Quantity(sidebands.modulation_index, "1", "that of the first pair"),
    }
    return tree


def _quasi_periodic(result: Any, points: Sequence[str], order: int) -> Tree:
    named = lines_of(result.frequencies, order)
    tree: Tree = {
        "probe_frequency": Quantity(float(result.frequencies[0]), "Hz", "first tone"),
        "pump_frequency": Quantity(float(result.frequencies[1]), "Hz", "second tone"),
        "line": Quantity(named, "1", "m, n of each line"),
        "frequency": Quantity(
            np.abs(named @ np.array(result.frequencies)), "Hz", "frequency of each line, |m probe + n pump|"
        ),
        "lines": _of_points(
            points, lambda point: line_values(result, named, point), "m", "complex amplitudes of u_y by line"
        ),
        "lines_x": _of_points(
            points,
            lambda point: line_values(result, named, point, "x"),
            "m",
            "complex amplitudes of u_x by line",
        ),
        "modulation_index": _of_points(
            points, result.modulation_index, "1", "(|c_1,1| + |c_1,-1|) / |c_1,0| of u_y"
        ),
        "stable": Quantity(result.stable, "1", "stability, None if it was not asked for or is not known"),
        "exponents": Quantity(result.exponents, "1/s", "largest Lyapunov exponents"),
        "tail": Quantity(result.tail, "1", "share of the highest quarter of the samples' harmonics"),
        "contact_peak": Quantity(float(result.contact_peak), "N", "largest contact resultant"),
        "residuals": Quantity(np.array(result.residuals), "1", "of Newton's method, relative"),
        "samples": Quantity(int(result.samples), "1", "phases of the slower tone"),
        "steps": Quantity(int(result.steps), "1", "time steps a period of the faster tone"),
    }
    return tree


def _quasi_periodic_response(result: Any, points: Sequence[str], order: int) -> Tree:
    named = lines_of(result.frequencies[0], order)

    def lines(point: str) -> np.ndarray:
        return np.array([line_values(motion, named, point) for motion in result.motions])

    return {
        "value": Quantity(result.value, "Hz", "forcing frequency"),
        "own_frequency": Quantity(result.frequencies[:, 1], "Hz", "of the motion's own tone"),
        "line": Quantity(named, "1", "m, n of each line, in order of frequency at the first motion"),
        "lines": _of_points(
            points, lines, "m", "complex amplitudes of u_y at m f1 + n f2, by motion and line"
        ),
        "own_amplitude": _of_points(
            points, lambda point: np.abs(result.line(0, 1, point)), "m", "amplitude of u_y at the own tone"
        ),
        "stable": Quantity(result.stable, "1", "stability of each motion"),
        "tail": Quantity(result.tail, "1", "share of the highest quarter of the samples' harmonics"),
        "contact_peak": Quantity(
            np.array([motion.contact_peak for motion in result.motions]), "N", "largest contact resultant"
        ),
        "complete": Quantity(bool(result.complete)),
        "reason": Quantity(result.reason, "1", "why the curve ends"),
    }


def lines_of(frequencies: Sequence[float], order: int) -> np.ndarray:
    """(k, 2): m and n of the lines m f1 + n f2 with |m|, |n| <= order, by ascending frequency from the mean
    on; of a line and its mirror image the one whose frequency is positive.
    """
    span = range(-order, order + 1)
    found = [(m * frequencies[0] + n * frequencies[1], m, n) for m in span for n in span]
    found = [entry for entry in found if entry[0] > 0.0 or entry[1:] == (0, 0)]
    return np.array([entry[1:] for entry in sorted(found)])


def line_values(result: Any, lines: np.ndarray, point: str, direction: str = "y") -> np.ndarray:
    """(k,) complex amplitudes of a quasi-periodic motion at lines (m, n), m."""
    return np.array([result.line(int(m), int(n), point, direction) for m, n in lines])


def _curve(result: Any, points: Sequence[str]) -> Tree:
    tree: Tree = {
        "parameter": Quantity(result.parameter),
        "frequency": Quantity(np.asarray(result.frequency), "Hz", "forcing frequency"),
        "value": Quantity(
            result.value,
            "Hz" if result.parameter == "frequency" else "1",
            "frequency, or factor on the loads",
        ),
        "amplitude": _of_points(points, result.amplitude, "m", "half the peak-to-peak of u_y"),
        "harmonics": _of_points(points, result.harmonics, "m", "complex harmonics of u_y, the mean first"),
        "stable": Quantity(result.stable, "1", "stability of each point"),
        "undecided": Quantity(result.undecided, "1", "whether its uncertainty leaves that open"),
        "converged": Quantity(result.converged),
        "contact_peak": Quantity(result.contact_peak, "N", "largest contact resultant"),
        "bifurcations": [
            {
                "kind": item.kind,
                "value": float(item.value),
                "error": float(item.error),
                "own_value": float(item.own_value),
                "multiplier": complex(item.multiplier),
            }
            for item in result.bifurcations
        ],
        "complete": Quantity(bool(result.complete)),
        "reason": Quantity(result.reason, "1", "why the curve ends"),
    }
    if result.parameter == "frequency":
        tree["peak"] = {point: _peak(result.peak(point)) for point in points}
    return tree


def _peak(peak: Any) -> Tree:
    return {
        "frequency": Quantity(peak.frequency, "Hz", "of the largest amplitude"),
        "amplitude": Quantity(peak.amplitude, "m", "largest amplitude"),
        "lower": Quantity(peak.lower, "Hz", "lower half-power frequency"),
        "upper": Quantity(peak.upper, "Hz", "upper half-power frequency"),
        "bandwidth": Quantity(peak.bandwidth, "Hz", "half-power bandwidth"),
        "skewness": Quantity(peak.skewness, "1", "0 symmetric, +1 leaning to higher frequencies"),
    }


def _backbone(result: Any, points: Sequence[str]) -> Tree:
    return {
        "mode": Quantity(int(result.mode), "1", "number of the mode"),
        "energy": Quantity(result.energy, "J", "energy of the motion"),
        "frequency": Quantity(result.frequency, "Hz", "frequency of the motion"),
        "frequency_error": Quantity(result.frequency_error, "Hz", "estimated error of the frequency"),
        "damping_ratio": Quantity(result.damping_ratio, "1", "damping ratio by the rate of decay"),
        "damping_error": Quantity(result.damping_error, "1", "estimated error of damping_ratio"),
        "energy_damping_ratio": Quantity(result.energy_damping_ratio, "1", "damping ratio by the energy"),
        "energy_damping_error": Quantity(
            result.energy_damping_error, "1", "estimated error of energy_damping_ratio"
        ),
        "amplitude": _of_points(points, result.amplitude, "m", "half the peak-to-peak of u_y"),
        "harmonics": _of_points(points, result.harmonics, "m", "complex harmonics of u_y, the mean first"),
        "stable": Quantity(result.stable, "1", "stability of each point"),
        "complete": Quantity(bool(result.complete)),
        "reason": Quantity(result.reason, "1", "why the branch ends"),
    }


def _locus(result: Any, points: Sequence[str], none: str) -> Tree:
    lines = [
        {
            "kind": line.kind,
            "parameter": line.parameter,
            "frequency": Quantity(line.frequency, "Hz", "forcing frequency"),
            "value": Quantity(line.value, "1", "factor on the second parameter"),
            "multiplier": Quantity(line.multiplier, "1", "multiplier on the unit circle, nan for grazing"),
            "ends": f"{line.reasons[0]}; {line.reasons[1]}",
        }
        for line in result
    ]
    tree: Tree = {"count": Quantity(len(lines), "1", "number of lines"), "loci": lines}
    if not lines:
        tree["reason"] = Quantity(none, "1", "why there is none")
    return tree


def _swept(result: Any, points: Sequence[str], least: float) -> Tree:
    return {
        "up" if swept.upwards else "down": {
            "frequency": Quantity(swept.frequency, "Hz", "mean forcing frequency of each cycle"),
            "amplitude": _of_points(points, swept.amplitude, "m", "half the peak-to-peak of u_y in a cycle"),
            "contact_peak": Quantity(swept.contact_peak, "N", "largest contact resultant in a cycle"),
            "jump": {
                point: Quantity(
                    np.array([jump.frequency for jump in swept.jumps(point, least)])
                    if swept.tells_jumps
                    else np.array([np.nan]),
                    "Hz",
                    "frequencies at which the amplitude jumps; nan for a sweep too short or fast to tell",
                )
                for point in points
            },
        }
        for swept in result
    }


def _basins(result: Any, points: Sequence[str]) -> Tree:
    tree: Tree = {
        "reached": Quantity(result.reached, "1", "number of the orbit that is reached, -1 for none"),
        "periods": Quantity(result.periods, "1", "forcing periods until that was known"),
        "share": Quantity(result.share, "1", "share of the initial states that reach each orbit"),
    }
    for number, axis in enumerate(result.axes, 1):
        tree[f"axis{number}"] = Quantity(np.array(axis.values), "1", axis.label)
    tree["orbits"] = [
        {
            "periods": Quantity(int(orbit.periods), "1", "forcing periods in its period"),
            "largest_multiplier": Quantity(complex(orbit.multipliers[0]), "1", "of largest modulus"),
            "contact_peak": Quantity(
                float(orbit.contact_resultant.max(initial=0.0)), "N", "largest resultant"
            ),
            "amplitude": _of_points(points, orbit.amplitude, "m", "half the peak-to-peak of u_y"),
            "integrity": Quantity(
                result.integrity(k), "J", "energy of the least disturbance that leads away"
            ),
        }
        for k, orbit in enumerate(result.orbits)
    ]
    return tree
