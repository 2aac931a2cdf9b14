"""Sec. 4, Figs. 8, 9 and 13: steady states by shooting, their harmonics, and the same from a time history."""

from __future__ import annotations

import time

import numpy as np

import sbfem_petsc as sb
from sbfem_petsc import indicators
from sbfem_petsc.plot.drawing import CYCLE, MARKERS, figure, save_picture, style

from .bench import NEAR_TIP, REFINED, Bench, push
from .findings import Claim, Finding, Part, Table, percent, size

DAMPING = (0.0005, 0.002, 0.005)
HARMONICS = 10
# A harmonic is absent below this fraction of the first: round-off is at 1e-12, the weakest that is seen in an
# experiment far above.
ABSENT = 1e-6
FAINT = 1e-4  # of the first harmonic: what the paper's plots do not show
# Harmonics that are drawn, over the largest first one.
SHOWN = 1e-7


def orbit(
    bench: Bench,
    case: str,
    force: float,
    frequency: float,
    damping: float = 0.002,
    contact: bool = True,
    steps: int = 512,
    **mesh,
):
    """A steady state; its reduced model serves all forces and frequencies of a model."""
    model = bench.model(case, damping, **mesh)

    def solve():
        return sb.periodic(model, push(force), frequency, steps=steps, contact=contact, jacobian="dense")

    return bench.once(
        ("orbit", case, force, frequency, damping, contact, steps, *sorted(mesh.items())), solve
    )


# ---------------------------------------------------------------------- Sec. 4, Table 1
def shooting(bench: Bench) -> Finding:
    """Newton's iterations of the shooting method."""
    rows, curves, numbers, orders = [], {}, {}, {}
    for frequency in (433.0, 3000.0, 20140.0):
        began = time.perf_counter()
        found = orbit(bench, "tables", 300.0, frequency)
        seconds = time.perf_counter() - began
        residuals = np.array(found.residuals) / found.residuals[0]
        orders[frequency] = float(
            np.log(residuals[-1] / residuals[-2]) / np.log(residuals[-2] / residuals[-3])
        )
        rows.append(
            [
                f"{frequency:g} Hz",
                found.iterations,
                residuals[-1],
                orders[frequency],
                abs(found.multipliers[0]),
                "yes" if found.stable else "no",
                found.path,
                seconds,
            ]
        )
        curves[f"{frequency:g} Hz"] = residuals
        numbers[f"{frequency:g}"] = {
            "iterations": found.iterations,
            "residuals": residuals,
            "largest_multiplier": abs(found.multipliers[0]),
            "stable": found.stable,
            "c": found.harmonics("A")[: HARMONICS + 1],
        }
    settled = np.log(1e6) / (0.002 * 2.0 * np.pi * float(sb.modal(bench.model("tables"), 1).frequencies[0]))
    numbers["settling_time"] = settled
    claims = [
        Claim(
            "the shooting method converges quadratically close to the solution",
            f"iterations {', '.join(str(r[1]) for r in rows)} to relative residuals of "
            f"{', '.join(f'{r[2]:.0e}' for r in rows)}; orders at the end"
            f" {', '.join(f'{o:.1f}' for o in orders.values())}",
            all(r[2] < 1e-9 and r[1] <= 10 for r in rows) and min(orders.values()) > 1.8,
        ),
        Claim(
            "the derivative of the period map needs finite differences (below eq. 38)",
            "it is carried along exactly: with the active set of each step frozen the step is linear, and "
            "once the sets are right Newton's method ends",
            False,
        ),
    ]
    tables = [
        Table(
            "Shooting at 300 N, modal damping ratio 0.002",
            [
                "drive",
                "iterations",
                "relative residual",
                "order at the end",
                "largest |multiplier|",
                "stable",
                "reached by",
                "seconds",
            ],
            rows,
            ["text", "count", "error", "value", "value", "text", "text", "value"],
        )
    ]
    notes = [
        f"A time history from rest would need {settled:.0f} s, {settled * 3000:,.0f} periods of 3000 Hz, "
        "until what its start leaves in mode 1 has fallen by"
        " 1e6."
    ]
    return Finding(numbers, tables, claims, notes, curves)


def draw_shooting(finding: Finding, path: str) -> None:
    """Residuals over the iterations."""
    drawing = figure(2.6, 4.6)
    axes = drawing.subplots()
    for k, (name, residuals) in enumerate(finding.curves.items()):
        axes.semilogy(
            np.arange(len(residuals)),
            residuals,
            color=CYCLE[k],
            marker=MARKERS[k],
            markersize=4,
            linewidth=1.0,
            label=name,
        )
    axes.set_xlabel("Newton iteration")
    axes.set_ylabel("‖x(T) − x(0)‖, relative")
    axes.set_xticks(range(max(len(r) for r in finding.curves.values())))
    axes.legend(fontsize=7, frameon=False)
    axes.grid(color="#DDDDDD", linewidth=0.4)
    style(axes)
    save_picture(drawing, path)


# ---------------------------------------------------------------------- Figs. 8, 9, 13
def harmonics(
    frequency: float, cracked: str = "tables", healthy: str = "healthy", elsewhere: str | None = "100 mm"
):
    """The function that computes Fig. 8, 9 or 13."""
    mesh = REFINED if cracked == "tables" else {}

    def compute(bench: Bench) -> Finding:
        c = {
            "healthy, 300 N": orbit(bench, healthy, 300.0, frequency),
            "cracked, no contact, 300 N": orbit(bench, cracked, 300.0, frequency, contact=False),
            "cracked, 1 N": orbit(bench, cracked, 1.0, frequency, **NEAR_TIP),
            "cracked, 300 N": orbit(bench, cracked, 300.0, frequency, **mesh),
        }
        breathing, lines = (
            c["cracked, 300 N"],
            {name: o.harmonics("A")[: HARMONICS + 1] for name, o in c.items()},
        )
        ratio = {name: indicators.harmonic_ratios(found) for name, found in lines.items()}
        finer = indicators.harmonic_ratios(
            orbit(bench, cracked, 300.0, frequency, steps=1024, **mesh).harmonics("A")[: HARMONICS + 1]
        )
        coarse = (
            indicators.harmonic_ratios(
                orbit(bench, cracked, 300.0, frequency).harmonics("A")[: HARMONICS + 1]
            )
            if mesh
            else None
        )
        over = {d: orbit(bench, cracked, 300.0, frequency, d) for d in DAMPING}
        seconds = {d: float(indicators.harmonic_ratios(o.harmonics("A"))[2]) for d, o in over.items()}
        others = {name: float(np.delete(r, 1).max()) for name, r in ratio.items()}
        rows = [
            [str(k), *(abs(found[k]) for found in lines.values()), ratio["cracked, 300 N"][k], finer[k]]
            for k in range(HARMONICS + 1)
        ]
        tables = [
            Table(
                f"Amplitudes of u_y(A) at the multiples of {frequency:g} Hz, m; modal damping ratio 0.002",
                ["harmonic", *lines, "A_k / A_1, 300 N", "at twice the steps"],
                rows,
                ["text"] + ["value"] * 4 + ["error"] * 2,
            )
        ]
        table = [
            [
                f"ζ = {d:g}",
                abs(o.harmonics("A")[1]),
                *indicators.harmonic_ratios(o.harmonics("A"))[[0, 2, 3, 4]],
                abs(o.multipliers[0]),
                "yes" if o.stable else "no",
            ]
            for d, o in over.items()
        ]
        if elsewhere:
            o = orbit(bench, elsewhere, 300.0, frequency)
            table.append(
                [
                    "crack at 100 mm, ζ = 0.002",
                    abs(o.harmonics("A")[1]),
                    *indicators.harmonic_ratios(o.harmonics("A"))[[0, 2, 3, 4]],
                    abs(o.multipliers[0]),
                    "yes" if o.stable else "no",
                ]
            )
        tables.append(
            Table(
                "300 N, default mesh: over the damping",
                [
                    "",
                    "A_1, m",
                    "mean / A_1",
                    "A_2 / A_1",
                    "A_3 / A_1",
                    "A_4 / A_1",
                    "largest |multiplier|",
                    "stable",
                ],
                table,
                ["text"] + ["value"] * 6 + ["text"],
            )
        )
        change = float(np.abs(finer[[0, 2, 3]] / ratio["cracked, 300 N"][[0, 2, 3]] - 1.0).max())
        numbers = {
            "amplitudes": {name: np.abs(found) for name, found in lines.items()},
            "ratios": ratio["cracked, 300 N"],
            "ratios_at_twice_the_steps": finer,
            "ratios_on_default_mesh": coarse,
            "largest_other": others,
            "over_damping": {
                f"{d:g}": indicators.harmonic_ratios(o.harmonics("A"))[:5] for d, o in over.items()
            },
            "stable": {f"{d:g}": o.stable for d, o in over.items()},
            "iterations": breathing.iterations,
            "largest_multiplier": abs(breathing.multipliers[0]),
        }
        claims = [
            Claim(
                "the healthy model includes the first harmonic only",
                f"the largest other one is {others['healthy, 300 N']:.0e} of the first",
                others["healthy, 300 N"] < ABSENT,
            ),
            Claim(
                "the model without contact includes the first harmonic only",
                f"the largest other one is {others['cracked, no contact, 300 N']:.0e} of the first",
                others["cracked, no contact, 300 N"] < ABSENT,
            ),
            Claim(
                "1 N is a load without contact: first harmonic only",
                f"with a tip element of 10 nm the mean is {ratio['cracked, 1 N'][0]:.1e} and the second one "
                f"{ratio['cracked, 1 N'][2]:.1e} of the first, peak contact resultant "
                f"{c['cracked, 1 N'].contact_resultant.max():.2g} N: faint, not absent",
                others["cracked, 1 N"] < FAINT,
            ),
            Claim(
                "higher harmonics appear in the contact model at 300 N",
                f"mean, second, third: {ratio['cracked, 300 N'][0]:.4f}, {ratio['cracked, 300 N'][2]:.5f}, "
                f"{ratio['cracked, 300 N'][3]:.6f} of the first",
                ratio["cracked, 300 N"][2] > 100 * ABSENT,
            ),
            Claim(
                "higher harmonics are present whatever the damping ratio from 0.0005 to 0.005",
                f"A_2 / A_1: {', '.join(f'{second:.5f} (ζ = {d:g})' for d, second in seconds.items())}",
                min(seconds.values()) > 100 * ABSENT,
                "check",
            ),
            Claim(
                "twice the steps change mean, second and third harmonic by less than 5 %",
                f"largest change {size(change)}",
                change < 0.05,
                "check",
            ),
        ]
        if elsewhere is None:
            linear = abs(lines["cracked, no contact, 300 N"][1]) / abs(lines["healthy, 300 N"][1]) - 1.0
            numbers["linear_change"] = linear
            claims.append(
                Claim(
                    "without breathing the cracked beam is not distinct from the healthy one",
                    f"the open crack changes the first harmonic by {percent(linear)}",
                    abs(linear) < 0.05,
                )
            )
        return Finding(numbers, tables, claims, [], {name: np.abs(found) for name, found in lines.items()})

    return compute


def draw_harmonics(finding: Finding, path: str) -> None:
    """Amplitude over the number of the harmonic."""
    drawing = figure(2.9)
    axes = drawing.subplots()
    places = np.arange(HARMONICS + 1)
    first = max(found[1] for found in finding.curves.values())
    shown = {name: found for name, found in finding.curves.items() if name != "cracked, no contact, 300 N"}
    # stems stand on the power of ten below the least harmonic that is shown
    least = min(float(found[found > SHOWN * first].min()) for found in shown.values())
    floor = 10.0 ** np.floor(np.log10(0.7 * least))
    for k, (name, found) in enumerate(shown.items()):
        seen = found > SHOWN * first
        x = places[seen] + 0.18 * (k - 1)
        axes.vlines(x, floor, found[seen], color=CYCLE[k], linewidth=1.0)
        axes.plot(
            x, found[seen], linestyle="none", marker=MARKERS[k], markersize=4.5, color=CYCLE[k], label=name
        )
    axes.set_yscale("log")
    axes.set_ylim(floor, 5.0 * first)
    axes.set_xlim(-0.6, HARMONICS + 0.6)
    axes.set_xticks(places)
    axes.set_xlabel("harmonic number")
    axes.set_ylabel("$|u_y|$(A) (m)")
    axes.grid(axis="y", color="#DDDDDD", linewidth=0.4)
    axes.set_axisbelow(True)
    axes.legend(fontsize=7, frameon=False, loc="upper right")
    style(axes)
    save_picture(drawing, path)


# ---------------------------------------------------------------------- the same from a time history
def against_history(bench: Bench) -> Finding:
    """Harmonics from shooting against those of a time history, 3000 Hz, 300 N, and the energy of a period."""
    frequency, rise, held = 3000.0, 0.5, 0.6
    found = orbit(bench, "tables", 300.0, frequency)

    def rising(t):
        return (
            300.0 * np.sin(0.5 * np.pi * np.minimum(t / rise, 1.0)) ** 2 * np.sin(2.0 * np.pi * frequency * t)
        )

    history = sb.transient(
        found.reduced,
        sb.PointForce("A", fy=sb.Custom(rising, highest_frequency=frequency)),
        rise + held,
        step=1.0 / frequency / 256,
        decimation=2,
        progress=None,
    )
    kept = history.time >= rise + held - 0.2 - 1e-12
    u = history.displacement("A")[:, 1]
    measured = indicators.harmonics(history.time[kept], u[kept], frequency, HARMONICS)
    exact = found.harmonics("A")[: HARMONICS + 1]
    rows = [
        [str(k), abs(exact[k]), abs(measured[k]), abs(measured[k]) / abs(exact[k]) - 1.0]
        for k in range(HARMONICS + 1)
    ]
    off = float(max(abs(row[3]) for row in rows[:4]))
    # energy of a period of the orbit: work of the load and loss in the modes
    r, states = found.reduced, found.states
    power = states.amplitudes[:, 0] * (states.v @ r.load_modes[:, 0])
    loss = (2.0 * r.damping * r.omega * states.v**2).sum(axis=1)
    step = 1.0 / frequency / len(found.time)
    work, lost = float(power.sum() * step), float(loss.sum() * step)
    numbers = {
        "orbit": np.abs(exact),
        "history": np.abs(measured),
        "largest_difference_0_to_3": off,
        "work_of_a_period": work,
        "loss_of_a_period": lost,
    }
    claims = [
        Claim(
            "harmonics 0 to 3 of a time history that has risen over 0.5 s are those of the orbit within 2 %",
            f"largest difference {size(off)}",
            off < 0.02,
            "check",
        ),
        Claim(
            "in a period of the orbit the load's work is what damping takes, within 0.1 %",
            f"{work:.6g} J and {lost:.6g} J ({percent(work / lost - 1.0)})",
            abs(work / lost - 1.0) < 1e-3,
            "check",
        ),
    ]
    tables = [
        Table(
            "Amplitudes of u_y(A), m: 3000 Hz, 300 N, ζ = 0.002",
            ["harmonic", "shooting", "time history", "difference"],
            rows,
            ["text", "value", "value", "percent"],
        )
    ]
    curves = {"shooting": np.abs(exact), "time history": np.abs(measured)}
    return Finding(
        numbers,
        tables,
        claims,
        ["What is left is the free vibration of mode 1, which decays by 0.31 a second."],
        curves,
    )


def draw_against_history(finding: Finding, path: str) -> None:
    """Amplitudes of the harmonics of both."""
    drawing = figure(2.5, 4.8)
    axes = drawing.subplots()
    for (name, found), marker, colour, width in zip(finding.curves.items(), ("o", "x"), CYCLE, (7, 5)):
        axes.semilogy(
            np.arange(HARMONICS + 1),
            found,
            linestyle="none",
            marker=marker,
            markersize=width,
            markerfacecolor="none",
            markeredgecolor=colour,
            label=name,
        )
    axes.set_xticks(range(HARMONICS + 1))
    axes.set_xlabel("harmonic number")
    axes.set_ylabel("$|u_y|$(A) (m)")
    axes.grid(axis="y", color="#DDDDDD", linewidth=0.4)
    axes.legend(fontsize=7, frameon=False)
    style(axes)
    save_picture(drawing, path)


CAPTION = (
    "Displacement of A at the multiples of the driving frequency, modal damping ratio 0.002; harmonics below "
    "1e-7 of the largest first one are not drawn."
)
TABLE1 = Part(
    "table1",
    "Sec. 4, Table 1: the shooting method",
    shooting,
    draw_shooting,
    "Residual of the periodicity condition over Newton's iterations, 300 N, modal damping ratio 0.002.",
    1.0,
)
FIGURES = [
    Part("fig8", "Fig. 8: harmonics at 3000 Hz", harmonics(3000.0), draw_harmonics, CAPTION, 3.0),
    Part("fig9", "Fig. 9: harmonics at 20140 Hz", harmonics(20140.0), draw_harmonics, CAPTION, 14.0),
]
FIG13 = Part(
    "fig13",
    "Fig. 13: harmonics of the beam with a hole at 3000 Hz",
    harmonics(3000.0, "hole, cracked", "hole, healthy", None),
    draw_harmonics,
    CAPTION,
    4.0,
)
CHECK = Part(
    "spectra",
    "Check: harmonics from shooting against a time history",
    against_history,
    draw_against_history,
    "Harmonics of the displacement of A at 3000 Hz, 300 N, modal damping ratio 0.002: steady state from "
    "shooting, and the end of a time history from rest.",
    5.0,
)
