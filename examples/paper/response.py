"""Fig. 11: frequency response between 13.9 and 14.6 kHz with contact: symmetry, stability, lines between
the harmonics.
"""

from __future__ import annotations

import numpy as np
import scipy.optimize

import sbfem_petsc as sb
from sbfem_petsc import indicators
from sbfem_petsc.continuation.branch import find_peak
from sbfem_petsc.plot.drawing import BLACK, CYCLE, figure, save_picture, style

from .bench import Bench, closed_frequencies, push
from .findings import Claim, Finding, Part, Table, percent
from .steady import DAMPING

START, STOP, FORCES, MIDDLE = 13900.0, 14600.0, (300.0, 500.0, 700.0, 1500.0), DAMPING[1]
# Around the peaks, Hz.
NEAR = np.arange(14080.0, 14301.0, 4.0)
# Largest multipliers at 256 steps a period are those at 1024 within 2e-4, and on 67 contact pairs instead of
# 26 too.
MODES, STEPS = 80, 256
# History from an unstable steady state: periods of the drive, those at its end that are looked at, and the
# growth (as exponent) below which there is nothing to see.
PERIODS, TAIL, GROWTH = 4000, 1000, 4.0
# A resonance curve is called symmetric if its distance to its mirror image is less than this, within a
# half-power width of the linear response, 57 Hz, of the peak: farther away neighbouring modes make the linear
# response unsymmetric too.
SYMMETRIC, REACH = 0.1, 57.0
# Lines between the harmonics count from this fraction of the first harmonic.
VISIBLE = 1e-3


def curve(bench: Bench, force: float, damping: float, contact: bool = True):
    """Frequency response at a force and damping ratio; as far as it goes."""

    def follow():
        try:
            return sb.frequency_response(
                bench.reduced("tables", damping, MODES),
                push(force),
                START,
                STOP,
                contact=contact,
                steps=STEPS,
                progress=None,
            )
        except sb.SolveError as error:
            found = getattr(error, "branch", None)
            if found is None:
                raise
            return found

    return bench.once(("response", force, damping, contact), follow)


def shape(bench: Bench, force: float, damping: float, contact: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and amplitudes of a curve without folds, with more points around the peak.

    The continuation's own steps there are as long as Newton's method allows.
    """
    found = curve(bench, force, damping, contact)
    frequency, amplitude = found.frequency, found.amplitude("A")
    if not contact:
        return frequency, amplitude
    near, fine = bench.once(("near", force, damping), lambda: near_peak(bench, force, damping, found))
    below, above = frequency < near[0], frequency > near[-1]
    return tuple(
        np.concatenate([values[below], close, values[above]])
        for values, close in ((frequency, near), (amplitude, fine))
    )


def near_peak(bench: Bench, force: float, damping: float, found) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and amplitudes around the peak, as far as asymmetry looks, each steady state from the
    nearest one that is known.

    Where Newton's method does not converge from there the curve's own points stand alone.
    """
    wanted = NEAR[np.abs(NEAR - found.peak("A").frequency) < REACH + 10.0]
    inside = (found.frequency >= wanted[0]) & (found.frequency <= wanted[-1])
    kept = [found.orbit(int(k)) for k in np.flatnonzero(inside)]
    for frequency in wanted:
        nearest = min(kept, key=lambda o: abs(o.frequency - frequency))
        try:
            kept.append(
                sb.periodic(
                    found.reduced,
                    push(force),
                    float(frequency),
                    steps=STEPS,
                    guess=nearest,
                    stability=False,
                )
            )
        except sb.SolveError:
            continue
    kept.sort(key=lambda o: o.frequency)
    return np.array([o.frequency for o in kept]), np.array([o.amplitude("A") for o in kept])


def asymmetry(frequency: np.ndarray, amplitude: np.ndarray) -> float:
    """Mean distance of a curve without folds to its mirror image about its peak over its mean height."""
    peak, away = find_peak(frequency, amplitude).frequency, np.linspace(0.0, REACH, 401)
    above, below = (np.interp(peak + sign * away, frequency, amplitude) for sign in (1.0, -1.0))
    return float(np.abs(above - below).sum() / (0.5 * (above + below)).sum())


def runs(frequency: np.ndarray, chosen: np.ndarray) -> list[list[float]]:
    """First and last frequency of each run of chosen points along a curve."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    return [[float(frequency[a]), float(frequency[b - 1])] for a, b in zip(edges[::2], edges[1::2])]


def over_force(bench: Bench):
    """Curves at one damping ratio: their numbers by name, table and picture."""
    numbers, rows, curves = {}, [], {}
    for name, force, contact in (("no contact", 300.0, False), *((f"{f:g} N", f, True) for f in FORCES)):
        found = curve(bench, force, MIDDLE, contact)
        frequency, amplitude = shape(bench, force, MIDDLE, contact)
        peak, unstable = find_peak(frequency, amplitude), found.unstable
        second = float((np.abs(found.harmonics("A")[:, 2]) / np.abs(found.harmonics("A")[:, 1])).max())
        touching = found.orbit(int(found.amplitude("A").argmax())).contact_force > 0.0
        numbers[name] = {
            "points": len(found.frequency),
            "converged": bool(found.converged.all()),
            "peak_frequency": peak.frequency,
            "peak_amplitude": peak.amplitude,
            "bandwidth": peak.bandwidth,
            "skewness": peak.skewness,
            "asymmetry": asymmetry(frequency, amplitude),
            "largest_second_harmonic": second,
            "unstable": runs(found.frequency, unstable),
            "bifurcations": [[b.kind, b.value] for b in found.bifurcations],
            "any_in_contact": touching.any(axis=1).mean(),
            "all_in_contact": touching.all(axis=1).mean(),
        }
        n = numbers[name]
        rows.append(
            [
                name,
                n["points"],
                peak.frequency,
                peak.amplitude / force,
                peak.bandwidth,
                peak.skewness,
                n["asymmetry"],
                second,
                100.0 * n["any_in_contact"],
                100.0 * n["all_in_contact"],
                int(unstable.sum()),
                "; ".join(f"{b.value:.1f}" for b in found.bifurcations),
            ]
        )
        curves |= {
            f"{name}|frequency": frequency,
            f"{name}|amplitude": amplitude / force,
            f"{name}|unstable": np.stack([found.frequency, found.amplitude("A") / force])[:, unstable],
        }
    columns = [
        "force",
        "points",
        "peak at, Hz",
        "peak, m/N",
        "half-power width, Hz",
        "skewness",
        "asymmetry",
        "largest A_2 / A_1",
        "some pair closed at the peak, % of the time",
        "all pairs",
        "unstable points",
        "stability changes at, Hz",
    ]
    table = Table(
        f"Frequency response of A, 13.9-14.6 kHz, modal damping ratio {MIDDLE:g}",
        columns,
        rows,
        [
            "text",
            "count",
            "frequency",
            "value",
            "value",
            "value",
            "value",
            "error",
            "value",
            "value",
            "count",
            "text",
        ],
    )
    return numbers, table, curves


def over_damping(bench: Bench):
    """The same at the lowest and highest force over the damping ratio, and what grows out of unstable
    steady states.
    """
    numbers, rows = {}, []
    for damping in DAMPING:
        for force in (FORCES[0], FORCES[-1]):
            found = curve(bench, force, damping)
            # at the lowest damping curves turn back
            close = shape(bench, force, damping) if damping >= MIDDLE else None
            n = numbers[force, damping] = beyond(bench, force, damping, found) | {
                "asymmetry": asymmetry(*close) if close else None,
                "peak_frequency": (find_peak(*close) if close else found.peak("A")).frequency,
                "end": found.frequency[-1],
                "complete": found.complete,
                "unstable_points": int(found.unstable.sum()),
                "points": len(found.frequency),
                "unstable": runs(found.frequency, found.unstable),
                "bifurcations": {
                    kind: sum(b.kind == kind for b in found.bifurcations)
                    for kind in sorted({b.kind for b in found.bifurcations})
                },
            }
            rows.append(
                [
                    f"{force:g} N",
                    f"{damping:g}",
                    n["peak_frequency"],
                    n["asymmetry"],
                    n["end"],
                    f"{n['unstable_points']} of {n['points']}",
                    "; ".join(f"{count} {kind}" for kind, count in n["bifurcations"].items()),
                    n["frequency"],
                    n["growth"],
                    n["announced"],
                    n["line"] or None,
                    n["line_over_drive"],
                ]
            )
    columns = [
        "force",
        "ζ",
        "peak at, Hz",
        "asymmetry",
        "followed to, Hz",
        "unstable points",
        "bifurcations",
        "most unstable at, Hz",
        "growth a period",
        "line it announces / f",
        "strongest line found below f / A_1",
        "at, / f",
    ]
    return numbers, Table(
        "Symmetry, stability and lines between the harmonics over the damping ratio",
        columns,
        rows,
        [
            "text",
            "text",
            "frequency",
            "value",
            "frequency",
            "text",
            "text",
            "frequency",
            "error",
            "value",
            "error",
            "value",
        ],
    )


def response(bench: Bench) -> Finding:
    """Curves, their symmetry and stability, and what the paper says of them."""
    numbers, table, curves = over_force(bench)
    damped, second_table = over_damping(bench)
    shapes = {name: n["asymmetry"] for name, n in numbers.items()}
    shift = numbers["1500 N"]["peak_frequency"] / numbers["no contact"]["peak_frequency"] - 1.0
    begins = [f"{name}: {n['unstable'][0][0]:.0f} Hz" for name, n in numbers.items() if n["unstable"]] or [
        "none"
    ]
    high = {d: damped[1500.0, d] for d in DAMPING}
    parts = [f"{n['unstable_points']} of {n['points']} points (ζ = {d:g})" for d, n in high.items()]
    seen = {force: ", ".join(told(damped[force, d], d) for d in DAMPING) for force in (300.0, 1500.0)}
    natural = bench.reference["modes"]["crack80_nu33"]["frequency_Hz"]
    known = combination(bench, curve(bench, 1500.0, MIDDLE), high[MIDDLE])
    claims = [
        Claim(
            "at low force the response is symmetric around the natural frequency (asymmetry below "
            f"{SYMMETRIC:g})",
            f"at 300 N {shapes['300 N']:.3f} at ζ = {MIDDLE:g} (without contact {shapes['no contact']:.3f}), "
            f"{damped[300.0, 0.005]['asymmetry']:.3f} at ζ ="
            f" 0.005; peak at {numbers['300 N']['peak_frequency']:.1f} Hz, natural frequency "
            f"{natural[16]:.1f} Hz",
            shapes["300 N"] < SYMMETRIC,
        ),
        Claim(
            "with increasing force the symmetry disappears",
            f"asymmetry {', '.join(f'{shape:.3f} ({name})' for name, shape in shapes.items())}",
            min(shapes[f"{f:g} N"] for f in FORCES[1:]) > max(SYMMETRIC, 2.0 * shapes["no contact"]),
        ),
        Claim(
            "contact shifts the resonance",
            f"the peak moves by {percent(shift)} from the open crack to 1500 N",
            abs(shift) > 1e-3,
        ),
        Claim(
            "the nonlinearity leads to unstable regions",
            f"they begin at ζ = {MIDDLE:g} with {', '.join(begins)}; at 1500 N {', '.join(parts)}",
            bool(numbers["1500 N"]["unstable"]),
        ),
        Claim(
            f"the unstable line at 1500 N, ζ = {MIDDLE:g} is a combination resonance at twice the drive",
            known["text"],
            known["holds"],
            "check",
        ),
        Claim(
            "with increasing force subharmonics appear",
            f"strongest line below the drive in histories from unstable steady states: 300 N: {seen[300.0]}; "
            f"1500 N: {seen[1500.0]}",
            high[MIDDLE]["line"] > VISIBLE,
        ),
    ]
    notes = [
        (
            "Asymmetry is the mean distance of a curve to its mirror image about its peak over its mean "
            f"height, within {REACH:g} Hz of the peak; the symmetry"
            " is called lost if every curve from 500 N on is at least twice as unsymmetric as the linear "
            "one. Skewness compares the two halves of the"
            " half-power width: 0 if they are equal, above 0 if the peak leans to higher frequencies. At "
            "1500 N all pairs close in most of the closed phase,"
            " the peak nears that of a crack without a gap (the bilinear formula gives 14263 Hz for mode "
            "17), and the asymmetry lies in a second, unstable"
            " foot at the open crack's frequency, farther from the peak than the measure reaches."
        ),
        (
            "Steady states of the drive's own period are followed by their arc length. Where one is unstable "
            "a history from it, disturbed by 1 %, shows what"
            " the beam does instead."
        ),
        (
            "The lines below the drive are no fractions f/2 or f/3. The other instability, above each peak, "
            "is slow: it modulates the response with the beam's"
            " first natural frequency."
        ),
    ]
    return Finding(
        numbers
        | {"combination": known, "over_damping": {f"{f:g} N, {d:g}": n for (f, d), n in damped.items()}},
        [table, second_table],
        claims,
        notes,
        curves,
    )


def combination(bench: Bench, found, most: dict) -> dict:
    """Two lines that add up to twice the drive, and the two modes below that which hold most of the unstable
    disturbance.

    It is a combination resonance if the lines lie between these modes' frequencies with the crack open and
    closed.
    """
    passing = [b for b in found.bifurcations if b.kind == "Neimark-Sacker"]
    if not passing or not most["announced"]:
        return {"holds": False, "text": "there is no such instability"}
    nearest = min(passing, key=lambda b: abs(abs(np.angle(b.multiplier)) / (2.0 * np.pi) - most["announced"]))
    opened, closed = found.reduced.frequencies, closed_frequencies(found.reduced)
    share = (np.abs(nearest.direction.reshape(2, -1)) ** 2).sum(axis=0) * (opened < 2.0 * most["frequency"])
    modes = sorted(int(m) for m in np.argsort(-share)[:2])
    lines = [most["announced"] * most["frequency"], (2.0 - most["announced"]) * most["frequency"]]
    text = " and ".join(
        f"{line:.0f} Hz beside mode {m + 1} ({opened[m]:.0f} Hz open, {closed[m]:.0f} Hz closed)"
        for m, line in zip(modes, lines)
    )
    return {
        "holds": all(opened[m] < line < closed[m] for m, line in zip(modes, lines)),
        "text": f"{text} add up to 2 × {most['frequency']:.0f} Hz",
        "modes": [m + 1 for m in modes],
        "lines": lines,
    }


def told(found: dict, damping: float) -> str:
    """What grows out of an unstable steady state, as text."""
    if found["line"]:
        return f"{found['line']:.1e} of A_1 at {found['line_over_drive']:.3f} f (ζ = {damping:g})"
    what = f"a growth of {found['growth']:.1e} a period only" if found["growth"] else "all stable"
    return f"{what} (ζ = {damping:g})"


def most_unstable(force: float, found):
    """Steady state with the largest multiplier, between the points around the most unstable one of a curve:
    the curve's own steps are as long as Newton's method allows.
    """
    largest = int(np.argmax(np.abs(found.multipliers[:, 0])))
    kept = [found.orbit(largest)]
    around = found.frequency[max(largest - 1, 0) : largest + 2]
    if not (np.diff(around) > 0.0).all():
        return kept[0]

    def negative(frequency: float) -> float:
        nearest = min(kept, key=lambda o: abs(o.frequency - frequency))
        try:
            orbit = sb.periodic(found.reduced, push(force), float(frequency), steps=STEPS, guess=nearest)
        except sb.SolveError:
            return 0.0
        kept.append(orbit)
        return -abs(orbit.multipliers[0])

    scipy.optimize.minimize_scalar(
        negative, bounds=(around[0], around[-1]), method="bounded", options={"xatol": 0.1}
    )
    return max(kept, key=lambda o: abs(o.multipliers[0]))


def beyond(bench: Bench, force: float, damping: float, found) -> dict:
    """What a history does that starts, disturbed, from the most unstable steady state of a curve.

    Its frequency, growth a period of the drive and the line that the Floquet multiplier announces, over the
    drive; strongest line found below the drive, over the drive's, and its frequency over the drive's. No line
    if all are stable or nothing grows within the history.
    """
    unstable = np.flatnonzero(found.unstable)
    if not len(unstable):
        return {"frequency": None, "growth": 0.0, "announced": None, "line": 0.0, "line_over_drive": None}
    orbit = most_unstable(force, found)
    frequency, multiplier = orbit.frequency, orbit.multipliers[0]
    result = {
        "frequency": frequency,
        "growth": abs(multiplier) - 1.0,
        "announced": abs(np.angle(multiplier)) / (2.0 * np.pi),
        "line": 0.0,
        "line_over_drive": None,
    }
    if result["growth"] * PERIODS < GROWTH:
        return result
    history = sb.transient(
        orbit.reduced,
        sb.PointForce("A", fy=sb.Harmonic(force, frequency)),
        PERIODS / frequency,
        step=1.0 / frequency / 128,
        decimation=8,
        initial=(orbit.states.q[0], 1.01 * orbit.states.v[0]),
        progress=None,
    )
    kept = history.time > history.time[-1] - TAIL / frequency
    spectrum = indicators.spectrum(history.time[kept], history.displacement("A")[kept, 1], window="hann")
    level, fraction = np.abs(spectrum.amplitude), spectrum.frequency / frequency
    between = np.flatnonzero((fraction > 0.1) & (fraction < 0.95))
    line = between[level[between].argmax()]
    return result | {
        "line": level[line] / level[np.abs(fraction - 1.0).argmin()],
        "line_over_drive": fraction[line],
    }


def draw(finding: Finding, path: str) -> None:
    """Amplitude over force, unstable parts marked."""
    drawing = figure(3.4)
    axes = drawing.subplots()
    names = [name.removesuffix("|frequency") for name in finding.curves if name.endswith("|frequency")]
    for name, colour in zip(names, (BLACK, *CYCLE)):
        frequency, amplitude, unstable = (
            finding.curves[f"{name}|{kind}"] for kind in ("frequency", "amplitude", "unstable")
        )
        axes.plot(
            frequency / 1e3,
            amplitude * 1e9,
            color=colour,
            linewidth=1.1,
            linestyle=(0, (4, 2)) if name.startswith("no") else "-",
            label=name,
        )
        axes.plot(
            unstable[0] / 1e3,
            unstable[1] * 1e9,
            linestyle="none",
            marker="o",
            markersize=3.5,
            markerfacecolor="white",
            markeredgecolor=colour,
            markeredgewidth=0.8,
        )
    axes.plot(
        [],
        [],
        linestyle="none",
        marker="o",
        markersize=3.5,
        markerfacecolor="white",
        markeredgecolor=BLACK,
        label="unstable",
    )
    axes.set_xlim(START / 1e3, STOP / 1e3)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("frequency (kHz)")
    axes.set_ylabel("amplitude of $u_y$(A) / force (nm/N)")
    axes.legend(fontsize=7, frameon=False)
    style(axes)
    save_picture(drawing, path)


PARTS = [
    Part(
        "fig11",
        "Fig. 11: frequency response, 13.9-14.6 kHz",
        response,
        draw,
        "Half the peak-to-peak displacement of A over the force, modal damping ratio 0.002; open marks are "
        "unstable steady states.",
        90.0,
    )
]
