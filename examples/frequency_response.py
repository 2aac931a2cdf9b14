"""Frequency response of the cracked beam from 13.9 to 14.6 kHz, without contact and at 300, 500, 700 and 1500
N: Fig. 11.

Case P (400 x 5 mm aluminium, V-notch of 2.5 mm at 80 mm with a mouth of 2 micrometres, clamped on the left),
a sine at A, around mode 17 (14144 Hz with the crack open). Curves of periodic motions are followed by their
arc length, through folds, so that all branches that hang together are found; Floquet multipliers tell stable
parts from unstable ones. Amplitudes are drawn over the force: the response without contact is one line for
all forces, and what differs from it is contact.

The paper gives no damping, and on it depends which parts are unstable. --damping takes several ratios and
tells of each: peak, its shift from the linear one, skewness and half-power bandwidth; unstable ranges and
bifurcations by kind; the lines that multipliers leaving the circle announce, in units of the drive (beside f
itself); and motions of twice the period, which are looked for at every period doubling and from every
unstable motion with a negative real multiplier. An instability narrower than the distance of the points can
be missed; --largest-step sets them closer.

    python examples/frequency_response.py
    python examples/frequency_response.py --damping 0.0005 0.001 0.002 0.005       (some minutes)
    python examples/frequency_response.py --largest-step 4
    mpiexec -n 2 python examples/frequency_response.py --forces 300
"""

import dataclasses
import math
import os
import pathlib
import sys
import time
from functools import partial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

DAMPING = (0.002,)
# Distances off an unstable motion, relative to its state, at which one of twice the period is looked for;
# least amplitude at half the drive over the first harmonic.
ASIDE, SEEN = (0.02, 0.1), 1e-6
TRIES = 6


def options():
    """The example's own options; PETSc is started with the rest of the command line."""
    parser = Parser("Frequency response of the cracked beam, 13.9-14.6 kHz (Fig. 11).")
    parser.add_argument(
        "--forces",
        type=float,
        nargs="+",
        default=[300.0, 500.0, 700.0, 1500.0],
        help="amplitudes at A, N (default 300 500 700 1500)",
    )
    parser.add_argument(
        "--damping",
        type=float,
        nargs="+",
        action="extend",
        help="modal damping ratios; several are compared in tables (default 0.002)",
    )
    parser.add_argument("--start", type=float, default=13900.0, help="Hz (default 13900)")
    parser.add_argument("--stop", type=float, default=14600.0, help="Hz (default 14600)")
    parser.add_argument(
        "--largest-step",
        type=float,
        default=math.inf,
        help="largest distance between points, Hz; instabilities narrower than it can be missed (default: as "
        "the curve's bends ask for)",
    )
    parser.add_argument("--steps", type=int, default=512, help="time steps a period (default 512)")
    parser.add_argument(
        "--modes", type=int, help="modes kept (default: up to 8 times the frequency, at least 80)"
    )
    parser.add_argument("--order", type=int, default=6, help="polynomial order of the edges (default 6)")
    parser.add_argument(
        "--grading", type=float, default=1.8, help="ratio of successive rings around the tip (default 1.8)"
    )
    parser.add_argument(
        "--tip-size", type=float, default=5e-6, help="half-size of the S-element at the tip, m (default 5e-6)"
    )
    parser.add_output("frequency_response", "curves and pictures", "write the curves only")
    return parser.parse()


def main():
    """Run the example."""
    own = options()
    import sbfem_petsc as sb
    from examples.harmonics import build

    comm, out, folder = begin(own.output)
    found, failures = {}, []
    for damping in dict.fromkeys(own.damping or DAMPING):
        model = build(comm, damping, order=own.order, grading=own.grading, tip_size=own.tip_size)
        out.print(f"\n{model}")
        curves, forces = {}, {"no contact": 1.0, **{f"{force:g} N": force for force in own.forces}}
        for name, force in forces.items():
            load = sb.PointForce("A", fy=force)
            began = time.perf_counter()
            try:
                curve = sb.frequency_response(
                    model,
                    load,
                    own.start,
                    own.stop,
                    contact=name != "no contact",
                    steps=own.steps,
                    modes=own.modes,
                    **({} if name == "no contact" else {"largest_step": own.largest_step}),
                )
            except sb.SolveError as error:
                failures.append(f"{name}, damping ratio {damping:g}: {error}")
                curve = getattr(error, "branch", None)
                if curve is None:
                    continue
            curves[name] = curve
            halves = doublings(load, curve) if curve.period.pairs else []
            found[damping, name] = curve, halves
            out.print(f"{name}: {curve}, {time.perf_counter() - began:.1f} s")
            sb.on_root(
                comm,
                partial(
                    sb.save_branch,
                    curve,
                    os.path.join(folder, f"curve_{name.replace(' ', '')}_damping_{damping:g}.h5"),
                ),
            )
            for number, orbit in enumerate(halves):
                sb.on_root(
                    comm,
                    partial(
                        sb.save_orbit,
                        orbit,
                        os.path.join(
                            folder, f"doubled_{name.replace(' ', '')}_damping_{damping:g}_{number}.h5"
                        ),
                    ),
                )
        if not own.no_pictures and curves:
            pictures(folder, comm, curves, forces, damping)
        model.destroy()
    out.print(peaks(found))
    out.print(stability(found))
    sb.on_root(comm, lambda: write(folder, found))
    out.print(f"\ncurves{'' if own.no_pictures else ' and pictures'} are in {folder}")
    if failures:
        raise sb.SolveError("; ".join(failures))


def doublings(load, curve):
    """Motions of twice the period: at period doublings, and near unstable motions with a negative real
    multiplier.
    """
    import numpy as np

    import sbfem_petsc as sb

    result = []
    for item in curve.bifurcations:
        if item.kind == "period doubling":
            try:
                result.append(sb.switch_branch(curve, item))
            except sb.SolveError:
                continue
    real = (curve.multipliers.imag == 0.0) & (curve.multipliers.real < -1.0)
    for k in np.flatnonzero(real.any(axis=1))[:TRIES]:
        orbit = curve.orbit(int(k))
        direction = np.random.default_rng(0).standard_normal(len(orbit.state))
        for share in ASIDE:
            # the disturbance that grows shows itself whatever the direction
            start = dataclasses.replace(
                orbit,
                state=orbit.state
                + share * np.linalg.norm(orbit.state) * direction / np.linalg.norm(direction),
            )
            try:
                other = sb.periodic(
                    curve.reduced, load, orbit.frequency, periods=2, steps=len(orbit.time), start=start
                )
            except sb.SolveError:
                continue
            if half(other) > SEEN:
                result.append(other)
                break
    return result


def half(orbit):
    """Amplitude at half the drive over the first harmonic."""
    return float(abs(orbit.subharmonics("A")[1]) / abs(orbit.harmonics("A")[1]))


def unstable(curve):
    """Frequencies between which a curve is unstable, in order of its arc length, Hz."""
    from sbfem_petsc.plot.branches import in_order, split

    marks = [(item.after, item.value, 0.0) for item in in_order(curve)]
    return [
        (float(value.min()), float(value.max()))
        for stable, value, _ in split(curve.value, 0.0 * curve.value, curve.stable, marks)
        if not stable
    ]


def together(curve):
    """Frequencies with two stable motions of the curve, Hz, or None."""
    import numpy as np

    from sbfem_petsc.plot.branches import in_order, split

    marks = [(item.after, item.value, 0.0) for item in in_order(curve)]
    pieces = []
    for stable, value, _ in split(curve.value, 0.0 * curve.value, curve.stable, marks):
        turns = np.flatnonzero(np.diff(np.sign(np.diff(value))) != 0) + 1
        pieces += [(part.min(), part.max()) for part in np.split(value, turns) if stable and len(part) > 1]
    shared = [(max(a[0], b[0]), min(a[1], b[1])) for n, a in enumerate(pieces) for b in pieces[:n]]
    shared = [(low, high) for low, high in shared if high - low > 1e-6 * high]
    return (float(min(s[0] for s in shared)), float(max(s[1] for s in shared))) if shared else None


def lines(curve):
    """Frequencies over the drive that multipliers leaving the circle announce where stability is lost or won,
    ascending.
    """
    import numpy as np

    ends = [
        item
        for item in curve.bifurcations
        if item.kind == "Neimark-Sacker" and curve.stable[item.after] != curve.stable[item.after - 1]
    ]
    return sorted({round(abs(float(np.angle(item.multiplier))) / (2.0 * np.pi), 3) for item in ends})


def peaks(found):
    """Peak, shift, skewness and bandwidth."""
    from rich.table import Table

    result = Table(
        title="Peaks of half the peak-to-peak u_y(A)",
        caption="shift: of the peak from that without contact; skewness: above 0 where the peak leans to "
        "higher frequencies, above 1 where it overhangs; bandwidth: between the half-power "
        "frequencies",
    )
    for name in (
        "damping",
        "curve",
        "points",
        "peak, Hz",
        "amplitude / force, nm/N",
        "shift, Hz",
        "skewness",
        "bandwidth, Hz",
        "peak resultant, kN",
    ):
        result.add_column(name, justify="right")
    for damping, name, curve, _ in rows(found):
        peak = curve.peak("A")
        linear = found.get((damping, "no contact"))
        result.add_row(
            f"{damping:g}",
            name,
            str(len(curve.value)),
            f"{peak.frequency:.2f}",
            f"{1e9 * peak.amplitude / force_of(name):.4f}",
            f"{peak.frequency - linear[0].peak('A').frequency:+.2f}" if linear else "",
            f"{peak.skewness:+.3f}",
            f"{peak.bandwidth:.2f}",
            f"{curve.contact_peak.max() * 1e-3:.2f}",
        )
    return result


def stability(found):
    """Unstable ranges, bifurcations, subharmonics."""
    from rich.table import Table

    result = Table(
        title="Stability and subharmonics",
        caption="|mu|: the largest along the curve; lines: announced by the multipliers at the ends of "
        "unstable ranges, over the drive; f/2: largest amplitude on a motion of twice the period "
        "over A1",
    )
    for name in (
        "damping",
        "curve",
        "unstable, Hz",
        "bifurcations",
        "|mu| - 1",
        "two stable, Hz",
        "lines / f",
        "f/2",
    ):
        result.add_column(name, justify="right", no_wrap=True)
    for damping, name, curve, halves in rows(found):
        if curve.period.pairs:
            kinds = [item.kind for item in curve.bifurcations]
            shared = together(curve)
            result.add_row(
                f"{damping:g}",
                name,
                "\n".join(f"{low:.1f}-{high:.1f}" for low, high in unstable(curve)) or "none",
                "\n".join(f"{kinds.count(kind)} {kind}" for kind in sorted(set(kinds))) or "none",
                f"{abs(curve.multipliers[:, 0]).max() - 1.0:+.1e}",
                f"{shared[0]:.1f}-{shared[1]:.1f}" if shared else "none",
                "\n".join(f"{line:.3f}" for line in lines(curve)) or "none",
                strongest(halves),
            )
    return result


def strongest(halves):
    """The motion of twice the period with the largest amplitude at half the drive, as text."""
    if not halves:
        return "none"
    orbit = max(halves, key=half)
    return f"{half(orbit):.1e} at\n{orbit.frequency:.1f} Hz,\n{'stable' if orbit.stable else 'unstable'}"


def rows(found):
    return [(damping, name, curve, halves) for (damping, name), (curve, halves) in found.items()]


def force_of(name):
    return 1.0 if name == "no contact" else float(name.split()[0])


def write(folder, found):
    """CSV of what the tables say, one row a curve, and of each curve."""
    import csv

    import numpy as np

    with open(os.path.join(folder, "curves.csv"), "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            [
                "damping",
                "force_N",
                "contact",
                "points",
                "complete",
                "peak_Hz",
                "peak_m",
                "skewness",
                "bandwidth_Hz",
                "unstable_Hz",
                "folds",
                "period_doublings",
                "neimark_sacker",
                "grazing",
                "largest_multiplier",
                "half_over_first",
            ]
        )
        for damping, name, curve, halves in rows(found):
            peak, kinds = curve.peak("A"), [item.kind for item in curve.bifurcations]
            writer.writerow(
                [
                    f"{damping:g}",
                    f"{force_of(name):g}",
                    curve.period.pairs > 0,
                    len(curve.value),
                    curve.complete,
                    f"{peak.frequency:.6f}",
                    f"{peak.amplitude:.9e}",
                    f"{peak.skewness:.6f}",
                    f"{peak.bandwidth:.6f}",
                    " ".join(f"{low:.3f}-{high:.3f}" for low, high in unstable(curve)),
                    *(kinds.count(kind) for kind in ("fold", "period doubling", "Neimark-Sacker", "grazing")),
                    f"{abs(curve.multipliers[:, 0]).max():.9f}" if curve.multipliers.size else "",
                    f"{max(map(half, halves)):.6e}" if halves else "",
                ]
            )
            largest = (
                abs(curve.multipliers[:, 0]) if curve.multipliers.size else np.full(len(curve.value), np.nan)
            )
            np.savetxt(
                os.path.join(folder, f"curve_{name.replace(' ', '')}_damping_{damping:g}.csv"),
                np.column_stack(
                    [
                        curve.value,
                        curve.amplitude("A"),
                        curve.stable,
                        largest,
                        abs(curve.harmonics("A")[:, :7]),
                    ]
                ),
                delimiter=",",
                fmt="%.9e",
                comments="",
                header="frequency_Hz,amplitude_m,stable,largest_multiplier,"
                + ",".join(f"A{k}_m" for k in range(7)),
            )


def pictures(folder, comm, curves, forces, damping):
    """The figure, and the multipliers along the curve of the largest force."""
    from sbfem_petsc.plot import plot_branches, plot_multipliers, save_picture

    drawing = plot_branches(
        curves,
        "A",
        forces={name: forces[name] for name in curves},
        title=f"modal damping ratio {damping:g}",
        comm=comm,
    )
    save_picture(drawing, os.path.join(folder, f"figure_11_damping_{damping:g}.png"))
    last = list(curves)[-1]
    if curves[last].multipliers.size:
        title = f"{last}, modal damping ratio {damping:g}"
        drawing = plot_multipliers(curves[last], title=title, comm=comm)
        file = f"multipliers_{last.replace(' ', '')}_damping_{damping:g}.png"
        save_picture(drawing, os.path.join(folder, file))


if __name__ == "__main__":
    run(main)
