"""Fig. 2 and eqs. (20)-(34): the crack section in two layouts, contact pairs, Signorini's conditions,
multipliers, the paper's time steps.
"""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection

import sbfem_petsc as sb
from meshing.gll import shape_functions
from sbfem_petsc.plot.drawing import (
    BLACK,
    BLUE,
    CYCLE,
    GREEN,
    MARKERS,
    VERMILION,
    figure,
    save_picture,
    style,
)

from .bench import CONVERGED, burst, push
from .findings import Claim, Finding, Part, Table, percent, size
from .time_scheme import at_rest, integrate

LAYOUTS = {"tip": "scaling centre on the tip", "vertex": "the paper's: tip is a vertex of four S-elements"}
FORCES = (1.0, 100.0, 300.0)


# ---------------------------------------------------------------------- Fig. 2
def layouts(bench) -> Finding:
    """Both layouts of the crack section, and what they converge to."""
    exact = bench.reference["modes"]["crack80_nu33"]["frequency_Hz"]
    rows, numbers, curves = [], {}, {}
    for layout in LAYOUTS:
        found = []
        for order in (3, 4, 5, 7, 9):
            model = bench.model("tables", order=order, layout=layout)
            frequencies = sb.modal(model, 10).frequencies
            error = np.abs(frequencies / exact[:10] - 1.0).max()
            found.append((model.boundary_unknowns, error))
            rows.append(
                [
                    layout,
                    str(order),
                    model.boundary_unknowns,
                    len(model.pairs),
                    frequencies[0],
                    frequencies[0] / exact[0] - 1.0,
                    error,
                ]
            )
        numbers[layout] = {"unknowns": [n for n, _ in found], "largest_error_1_to_10": [e for _, e in found]}
        curves |= {
            f"{layout}_unknowns": np.array([n for n, _ in found]),
            f"{layout}_error": np.array([e for _, e in found]),
            **_sketch(bench, layout),
        }
    best = {layout: min(numbers[layout]["largest_error_1_to_10"]) for layout in LAYOUTS}
    around = int(curves["vertex_at_tip"][0])
    numbers["elements_at_tip"] = around
    claims = [
        Claim(
            "the crack section consists of four subdomains that meet in the tip",
            f'{around} S-elements share the tip\'s node in the layout "vertex"',
            around == 4,
        ),
        Claim(
            "with the scaling centre on the tip the error falls below 1e-5, with the tip as a vertex it is "
            "still above at p = 9",
            f"largest errors of modes 1-10 on the best mesh: {best['tip']:.1e} and {best['vertex']:.1e}",
            best["tip"] < 1e-5 < best["vertex"],
            "check",
        ),
    ]
    tables = [
        Table(
            "Frequencies 1-10 of the open crack in both layouts",
            ["layout", "p", "unknowns", "contact pairs", "f1, Hz", "f1 to reference", "largest error 1-10"],
            rows,
            ["text", "text", "count", "count", "value", "percent", "error"],
        )
    ]
    return Finding(
        numbers,
        tables,
        claims,
        [
            "The project computes with the scaling centre on the tip, where the radial solution holds the "
            "singularity exactly; the paper's layout is there for"
            " comparison."
        ],
        curves,
    )


def _sketch(bench, layout: str) -> dict[str, np.ndarray]:
    """Edges, nodes, scaling centres and tip of a coarse mesh around the crack."""
    mesh = bench.beam("tables").mesh(order=5, layout=layout)
    values, _ = shape_functions(mesh.order, np.linspace(-1.0, 1.0, 9))
    tip = np.array(mesh.cracks[0].tip)
    at_tip = np.flatnonzero(np.linalg.norm(mesh.nodes - tip, axis=1) < 1e-12)
    count = (
        sum(bool(np.isin(at_tip, mesh.element_nodes(e)).any()) for e in range(mesh.elements))
        if len(at_tip)
        else 1
    )
    return {
        f"{layout}_lines": values @ mesh.nodes[mesh.edges] - tip,
        f"{layout}_nodes": mesh.nodes - tip,
        f"{layout}_centres": mesh.scaling_centres - tip,
        f"{layout}_at_tip": np.array([count]),
    }


def draw_layouts(finding: Finding, path: str) -> None:
    """Crack section in both layouts, and the convergence."""
    drawing = figure(3.1)
    grid = drawing.subplots(1, 3)
    for axes, layout in zip(grid, LAYOUTS):
        curves = {
            name.removeprefix(f"{layout}_"): values
            for name, values in finding.curves.items()
            if name.startswith(layout)
        }
        axes.add_collection(LineCollection(curves["lines"] * 1e3, colors="#5A6570", linewidths=0.6))
        axes.plot(
            *curves["nodes"].T * 1e3,
            linestyle="none",
            marker=".",
            markersize=2.5,
            color=BLUE,
            markeredgewidth=0,
        )
        axes.plot(
            *curves["centres"].T * 1e3,
            linestyle="none",
            marker="+",
            markersize=5,
            color=VERMILION,
            markeredgewidth=0.8,
        )
        axes.plot([0, 0], [0, 2.5], color=BLACK, linewidth=1.2)
        axes.set_xlim(-2.9, 2.9)
        axes.set_ylim(-2.6, 2.6)
        axes.set_aspect("equal")
        axes.set_xlabel("x from the tip (mm)")
        axes.set_title(
            {"tip": "scaling centre on the tip", "vertex": "tip as a vertex (paper)"}[layout], fontsize=8
        )
        style(axes)
    grid[0].set_ylabel("y from the tip (mm)")
    for k, (layout, label) in enumerate({"tip": "centre on the tip", "vertex": "tip as a vertex"}.items()):
        grid[2].loglog(
            finding.curves[f"{layout}_unknowns"],
            finding.curves[f"{layout}_error"],
            color=CYCLE[k],
            marker=MARKERS[k],
            markersize=4,
            linewidth=1.0,
            label=label,
        )
    grid[2].set_xlabel("displacement unknowns")
    grid[2].set_ylabel("largest error, modes 1-10")
    grid[2].legend(fontsize=7, frameon=False)
    grid[2].set_xticks([700, 1000, 2000, 3000], ["700", "1000", "2000", "3000"])
    grid[2].minorticks_off()
    grid[2].set_title("convergence, p = 3 to 9", fontsize=8)
    style(grid[2])
    save_picture(drawing, path)


# ---------------------------------------------------------------------- eqs. (20)-(24)
def signorini(bench) -> Finding:
    """Pairs found by the search, gap function and Signorini's conditions."""
    model = bench.model("tables", **CONVERGED)
    pairs, crack = model.pairs, model.cracks[0]
    distance = pairs.position * crack.length
    exact = 2.0 * distance * np.tan(np.radians(0.5 * 0.0458366))
    gap_error = float(np.abs(pairs.gap - exact).max() / exact.max())
    lengths = model.pairs.weight
    rows, numbers, curves = (
        [],
        {"pairs": len(pairs), "gap_error": gap_error},
        {"distance": distance, "initial": pairs.gap},
    )
    worst = {"gap": 0.0, "force": 0.0, "product": 0.0}
    for force in FORCES:
        solved = bench.once(("contact", force), lambda force=force: sb.static(model, push(force)))
        known = bench.reference["static"]["x80_mouth2um_nu33"]["contact"][f"{force:g} N"]["cracks"][0]
        closed = float(distance[solved.active].max()) if solved.active.any() else 0.0
        k1, k2 = solved.stress_intensity["crack1"]
        rows.append(
            [
                f"{force:g}",
                f"{int(solved.active.sum())} of {len(pairs)}",
                solved.contact_resultant,
                known["resultant"],
                solved.contact_resultant / known["resultant"] - 1.0 if known["resultant"] else None,
                1e3 * closed,
                1e3 * known["s_max"],
                k1,
                k2,
            ]
        )
        worst["gap"] = min(worst["gap"], float(solved.gap.min()))
        worst["force"] = min(worst["force"], float(solved.contact_force.min()))
        worst["product"] = max(
            worst["product"],
            float(
                np.abs(solved.gap * solved.contact_force).max()
                / (pairs.gap.max() * max(solved.contact_force.max(), 1.0))
            ),
        )
        numbers[f"{force:g} N"] = {
            "resultant": solved.contact_resultant,
            "reference": known["resultant"],
            "closed_length": closed,
            "active": int(solved.active.sum()),
        }
        curves |= {f"gap_{force:g}": solved.gap, f"pressure_{force:g}": solved.contact_force / lengths}
    numbers |= {f"worst_{name}": value for name, value in worst.items()}
    off = [
        abs(numbers[f"{f:g} N"]["resultant"] / numbers[f"{f:g} N"]["reference"] - 1.0) for f in (100.0, 300.0)
    ]
    claims = [
        Claim(
            "the initial gap is that of the notch, 2 r tan(α/2)",
            f"{len(pairs)} pairs found by a search over the two faces, largest relative difference "
            f"{gap_error:.1e}",
            gap_error < 1e-9,
            "check",
        ),
        Claim(
            "Signorini's conditions: gap ≥ 0, pressure ≥ 0, their product 0 (eqs. 23, 24)",
            f"least gap {worst['gap']:.1e} m, least force {worst['force']:.1e} N, largest product "
            f"{worst['product']:.1e} of the mouth's width times the largest"
            " force",
            worst["gap"] > -1e-14 and worst["force"] >= 0.0 and worst["product"] < 1e-12,
        ),
        Claim(
            "1 N is a load without contact",
            f"{rows[0][1]} pairs touch outside the tip element of 1 µm; in the reference, finer there, "
            f"{1e3 * rows[0][6]:.2g} µm of 2500 µm close with a"
            f" resultant of {rows[0][3]:.2g} N",
            max(numbers["1 N"]["closed_length"], 1e-3 * rows[0][6]) < 1e-3 * crack.length,
        ),
        Claim(
            "contact resultants agree with the reference within 1 %",
            f"{percent(rows[1][4])} at 100 N, {percent(rows[2][4])} at 300 N",
            max(off) < 0.01,
            "check",
        ),
    ]
    tables = [
        Table(
            "Unilateral contact of the paper's beam",
            [
                "force, N",
                "pairs in contact",
                "resultant, N",
                "reference, N",
                "difference",
                "closed length, mm",
                "reference, mm",
                "K_I, Pa√m",
                "K_II, Pa√m",
            ],
            rows,
            ["text", "text", "value", "value", "percent", "value", "value", "value", "value"],
        )
    ]
    notes = [
        (
            "A closing load closes the notch from the tip outwards: ahead of any contact the faces near the "
            "tip overlap as √r while the notch opens as r, so"
            " that even 1 N closes a fraction of a micrometre."
        ),
        "K_I of faces that touch up to the tip is zero; where they do not yet, inside the tip element, it is "
        "that of the small overlap left there.",
    ]
    return Finding(numbers, tables, claims, notes, curves)


def draw_signorini(finding: Finding, path: str) -> None:
    """Pressure and gap along the crack."""
    drawing = figure(3.2)
    left, right = drawing.subplots(1, 2)
    distance = finding.curves["distance"] * 1e3
    right.plot(
        distance,
        finding.curves["initial"] * 1e6,
        color="#777777",
        linestyle=(0, (4, 2)),
        linewidth=0.9,
        label="initial",
    )
    for k, force in enumerate(FORCES):
        shown = dict(color=CYCLE[k], marker=MARKERS[k], markersize=2.5, linewidth=0.8, label=f"{force:g} N")
        left.plot(distance[1:], finding.curves[f"pressure_{force:g}"][1:] * 1e-6, **shown)
        right.plot(distance, finding.curves[f"gap_{force:g}"] * 1e6, **shown)
    left.set_ylabel("contact pressure (MPa)")
    left.set_ylim(-0.5, 40.0)  # it grows towards the tip without limit
    right.set_ylabel("gap (µm)")
    for axes in (left, right):
        axes.set_xlabel("distance from the tip (mm)")
        axes.set_xlim(0.0, 2.55)
        axes.legend(fontsize=7, frameon=False)
        style(axes)
    save_picture(drawing, path)


# ---------------------------------------------------------------------- eqs. (25)-(34)
def multipliers(bench) -> Finding:
    """Eq. (33) as printed and as meant; the paper's time steps against steps that keep the energy."""
    reduced = bench.reduced("tables")
    meant = at_rest(reduced, 100.0)
    free, compliance, touching = meant.free_gap, meant.compliance, meant.free_gap < 0.0
    deepest = float(-free.min())
    printed = -compliance @ np.where(touching, free, 0.0)  # eq. (33): no inverse
    moved = -compliance @ printed  # eq. (34): its sign, on top of that of (33)
    left = float(np.abs(free[touching] + moved[touching]).max() / deepest)
    closed = float(np.abs(meant.gap[touching]).max() / deepest)
    tension = float(-meant.force.min())

    duration, step = 0.033, 2e-6
    runs = {f"paper, Mcf = {terms}": paper_steps(bench, terms, duration, step) for terms in (1, 0)}
    exact, newmark = (
        sb.transient(reduced, burst(300.0), duration, step, scheme=scheme, progress=None)
        for scheme in ("exact", "newmark")
    )
    rows, numbers = [], {"printed_eq33_left": left, "meant_eq33_left": closed, "one_pass_tension": tension}
    curves = {}
    for name, (time, energy, work, resultant, sentence) in {
        **runs,
        "average acceleration": _of(newmark),
        "exact steps": _of(exact),
    }.items():
        excess = (energy - work) / np.abs(work).max()
        rows.append(
            [
                name,
                1e3 * time[-1],
                float(energy[-1]),
                float(work[-1]),
                float(excess[-1]),
                1e-3 * float(resultant.max()),
                sentence,
            ]
        )
        numbers[name] = {
            "end": time[-1],
            "energy": energy[-1],
            "work": work[-1],
            "excess": excess[-1],
            "largest_excess": np.abs(excess).max(),
            "peak_resultant": resultant.max(),
            "stopped": sentence,
        }
        every = max(1, len(time) // 1500)
        curves |= {
            f"{name}|time": time[::every],
            f"{name}|energy": energy[::every],
            f"{name}|work": work[::every],
        }
    gained = {name: numbers[name]["largest_excess"] for name in runs}
    claims = [
        Claim(
            "eq. (33) gives the multiplier",
            f"as printed, without an inverse, it leaves {percent(left, '')} of the deepest penetration; with "
            "λ = (G K⁻¹ Gᵀ)⁻¹ G (u_exp + x₀) and eq. (34) it"
            f" leaves {closed:.0e}",
            left < 0.01,
            "implied",
        ),
        Claim(
            "one correction of all penetrating pairs is contact (Table 1, steps 4-8)",
            f"at 100 N the pass leaves tension of up to {tension:.3g} N in a pair: contact would have to "
            "hold the faces together",
            tension < 1e-9,
            "implied",
        ),
        Claim(
            "the time integration of eqs. (28)-(34) conserves energy",
            "energy beyond the work done grows to "
            f"{', '.join(f'{size(g)} ({n[7:]})' for n, g in gained.items())} of the work; peak resultant"
            f" {1e-3 * numbers['paper, Mcf = 1']['peak_resultant']:.1f} kN against "
            f"{1e-3 * numbers['exact steps']['peak_resultant']:.1f} kN",
            max(gained.values()) < 1e-3,
            "implied",
        ),
        Claim(
            "this project's steps keep the energy balance within 1e-4 of the work",
            f"largest error {numbers['exact steps']['largest_excess']:.1e} (exact steps), "
            f"{numbers['average acceleration']['largest_excess']:.1e} (average"
            " acceleration)",
            numbers["exact steps"]["largest_excess"] < 1e-4,
            "check",
        ),
    ]
    tables = [
        Table(
            "300 N tone burst, 2 µs: energy balance of the time integrations",
            [
                "scheme",
                "until, ms",
                "energy, J",
                "work of the load, J",
                "excess",
                "peak resultant, kN",
                "remark",
            ],
            rows,
            ["text", "value", "value", "value", "percent", "value", "text"],
        )
    ]
    notes = [
        "The paper carries the multiplier in the acceleration of contact nodes that have mass. Here contact "
        "nodes have no mass: the contact force is then a"
        " Lipschitz function of the modal displacement and average acceleration, or exact steps, cannot feed "
        "energy in."
    ]
    return Finding(numbers, tables, claims, notes, curves)


def paper_steps(bench, terms: int, duration: float, step: float):
    """The paper's time integration: times, energy, work, contact resultant and a remark where it was
    stopped because its energy ran away.
    """
    model = bench.model("tables", continued_fraction=terms)
    signal = sb.ToneBurst(300.0, frequency=3000.0, cycles=100)
    run = integrate(model, push(1.0), signal, step, round(duration / step))
    remark = "stopped: the energy ran away" if run.stopped else ""
    return run.time, run.energy, run.work, run.resultant, remark


def _of(history):
    return history.time, history.energy.total, history.energy.external, history.contact_resultant, ""


def draw_multipliers(finding: Finding, path: str) -> None:
    """Energy beyond the work done."""
    drawing = figure(2.8)
    axes = drawing.subplots()
    names = [name.removesuffix("|time") for name in finding.curves if name.endswith("|time")]
    looks = {
        "paper, Mcf = 1": (VERMILION, "-"),
        "paper, Mcf = 0": ("#E69F00", "-"),
        "average acceleration": (GREEN, "--"),
        "exact steps": (BLUE, "-"),
    }
    for name in names:
        time, energy, work = (finding.curves[f"{name}|{kind}"] for kind in ("time", "energy", "work"))
        colour, line = looks[name]
        axes.plot(
            time * 1e3,
            100.0 * (energy - work) / np.abs(work).max(),
            color=colour,
            linestyle=line,
            linewidth=1.0,
            label=name.replace("Mcf", "$M_{cf}$"),
        )
    axes.axhline(0.0, color="#999999", linewidth=0.4, zorder=0.5)
    axes.set_xlabel("time (ms)")
    axes.set_ylabel("energy − work (% of peak work)")
    axes.set_xlim(0.0, 33.0)
    axes.legend(fontsize=7, frameon=False, loc="upper left")
    style(axes)
    save_picture(drawing, path)


PARTS = [
    Part(
        "fig2",
        "Fig. 2: the crack section in two layouts",
        layouts,
        draw_layouts,
        "The crack section: scaling centre (+) on the tip with similar rings around it, and the paper's four "
        "subdomains that meet in the tip; largest error of"
        " frequencies 1-10 for orders 3, 4, 5, 7 and 9.",
        2.5,
    ),
    Part(
        "eq20",
        "Eqs. 20-24, Sec. 3.1: contact pairs, gap, Signorini's conditions",
        signorini,
        draw_signorini,
        "Contact pressure and gap along the crack at 1, 100 and 300 N.",
        1.0,
    ),
    Part(
        "eq25",
        "Eqs. 25-34: Lagrange multipliers and the paper's time integration",
        multipliers,
        draw_multipliers,
        "300 N tone burst: energy beyond the work of the load, in percent of the peak work. The paper's "
        "scheme with and without continued fraction, average"
        " acceleration and exact steps on massless contact nodes.",
        28.0,
    ),
]
