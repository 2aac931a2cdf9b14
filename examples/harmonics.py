"""Harmonics of the steady state at 3000 and 20140 Hz, healthy and with a breathing crack: Figs. 8 and 9.

Case P (400 x 5 mm aluminium, V-notch of 2.5 mm at 80 mm with a mouth of 2 micrometres, clamped on the left)
under a sine at A. The periodic motions are found by shooting; drawn are the moduli of the harmonics of
u_y(A). The healthy beam has no contact: its motion is a sine, and all harmonics but the first are zero to
rounding. So are those of the crack at 1 N, which does not close. At 300 N the crack closes in every period,
and a mean and higher harmonics appear.

The paper gives neither its damping nor the steps of its shooting. The modal damping ratio is 0.002 unless
--damping says otherwise; the first harmonic at 3000 Hz depends on it, mode 7 being at 3006 Hz.

    python examples/harmonics.py
    python examples/harmonics.py --convergence        also tables over steps, modes and meshes
    python examples/harmonics.py --frequencies 433 --forces 100 300 --damping 0.005
    mpiexec -n 2 python examples/harmonics.py
"""

import os
import pathlib
import sys
import time
from functools import partial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

FIGURES = {3000.0: "figure_8", 20140.0: "figure_9"}
REFINED = {"order": 6, "grading": 1.8, "tip_size": 5e-6}
# order, grading and tip_size of the meshes of the convergence table; the last is the one the others are
# measured against
MESHES = ((5, 2.5, 5e-5), (6, 1.8, 5e-5), (6, 1.8, 1.6e-5), (6, 1.8, 5e-6), (7, 1.6, 1.6e-6))
COUNT = 10


def options():
    """The example's own options; PETSc is started with the rest of the command line."""
    parser = Parser("Harmonics of the steady state, healthy and cracked beam (Figs. 8 and 9).")
    parser.add_argument(
        "--frequencies", type=float, nargs="+", default=list(FIGURES), help="Hz (default 3000 20140)"
    )
    parser.add_argument(
        "--forces",
        type=float,
        nargs="+",
        default=[1.0, 300.0],
        help="amplitudes at A, N; the last is also the healthy beam's (default 1 300)",
    )
    parser.add_argument("--damping", type=float, default=0.002, help="modal damping ratio (default 0.002)")
    parser.add_argument("--steps", type=int, default=1024, help="time steps a period (default 1024)")
    parser.add_argument(
        "--modes", type=int, help="modes kept (default: up to 8 times the frequency, at least 80)"
    )
    parser.add_argument(
        "--order", type=int, default=REFINED["order"], help="polynomial order of the edges (default 6)"
    )
    parser.add_argument(
        "--grading",
        type=float,
        default=REFINED["grading"],
        help="ratio of successive rings around the tip (default 1.8)",
    )
    parser.add_argument(
        "--tip-size",
        type=float,
        default=REFINED["tip_size"],
        help="half-size of the S-element at the tip, m (default 5e-6)",
    )
    parser.add_argument(
        "--convergence", action="store_true", help="tables over steps, modes and meshes at the last force"
    )
    parser.add_output("harmonics", "numbers and pictures", "write the numbers only")
    return parser.parse()


def main():
    """Run the example."""
    own = options()
    import sbfem_petsc as sb

    comm, out, folder = begin(own.output)
    mesh = {"order": own.order, "grading": own.grading, "tip_size": own.tip_size}
    healthy, cracked = (
        build(comm, own.damping, notched=False, order=own.order),
        build(comm, own.damping, **mesh),
    )
    out.print(f"healthy: {healthy}\ncracked: {cracked}")
    for frequency in own.frequencies:
        cases = {
            f"healthy, {own.forces[-1]:g} N": (healthy, own.forces[-1]),
            **{f"{force:g} N": (cracked, force) for force in own.forces},
        }
        orbits, linear = {}, None
        out.print(f"\n{frequency:g} Hz, modal damping ratio {own.damping:g}")
        for name, (model, force) in cases.items():
            began = time.perf_counter()
            orbits[name] = sb.periodic(
                model,
                sb.PointForce("A", fy=force),
                frequency,
                steps=own.steps,
                modes=own.modes,
            )
            seconds = time.perf_counter() - began
            prepared = linear is not None and model is cracked
            if model is cracked:
                linear = linear or sb.periodic(
                    orbits[name].reduced,
                    sb.PointForce("A", fy=1.0),
                    frequency,
                    steps=own.steps,
                    contact=False,
                    stability=False,
                )
            out.print(
                f"{name}: {told(orbits[name])}, {seconds:.2f} s{'' if prepared else ' with the reduction'}"
            )
        out.print(table(orbits, f"Amplitudes of u_y(A) at the multiples of {frequency:g} Hz, m"))
        for name, (model, force) in cases.items():
            c = abs(orbits[name].harmonics("A"))
            line = f"{name}: largest of harmonics 2-{COUNT} {max(c[2 : COUNT + 1]) / c[1]:.2e} of the first"
            if model is cracked:
                line += (
                    "; the first differs from that without contact by "
                    f"{abs(orbits[name].harmonics('A')[1] / (force * linear.harmonics('A')[1]) - 1.0):.2e}"
                )
            out.print(line)
        if own.convergence:
            for study in convergence(comm, cracked, own, frequency):
                out.print(study)
        sb.on_root(comm, partial(write, folder, f"{frequency:g}Hz", orbits))
        if not own.no_pictures:
            pictures(
                folder,
                comm,
                orbits,
                FIGURES.get(frequency, f"harmonics_{frequency:g}Hz"),
                f"{frequency:g} Hz",
                f"{frequency:g}Hz",
            )
    healthy.destroy()
    cracked.destroy()
    out.print(f"\nnumbers{'' if own.no_pictures else ' and pictures'} are in {folder}")


def build(comm, damping, notched=True, **choice):
    """Case P, or the beam without its notch, on a mesh."""
    import sbfem_petsc as sb
    from meshing import Beam, VNotch

    beam = Beam(
        length=0.400,
        height=0.005,
        notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)] if notched else [],
    )
    return sb.Model(
        sb.on_root(comm, lambda: beam.mesh(**choice)),
        sb.Material(young=70e9, poisson=0.33, density=2700),
        clamped="left",
        damping=damping,
    )


def told(orbit):
    """An orbit in one line."""
    last = orbit.residuals[-1] / orbit.residuals[0] if orbit.residuals[0] > 0.0 else 0.0
    return (
        f"{orbit.iterations} Newton iterations to {last:.0e}, {len(orbit.reduced.omega)} modes, "
        f"{'stable' if orbit.stable else 'unstable'} (largest multiplier {abs(orbit.multipliers[0]):.6f}), "
        f"peak contact resultant {orbit.contact_resultant.max(initial=0.0):.4g} N"
    )


def table(orbits, title):
    """Moduli of the harmonics, and of the last motion over its first."""
    from rich.table import Table

    last = list(orbits)[-1]
    result = Table(title=title, caption="0: the mean; what is below 1e-12 of the first is rounding")
    for name in ("harmonic", *orbits, f"{last}, over the first"):
        result.add_column(name, justify="right")
    found = {name: abs(orbit.harmonics("A")) for name, orbit in orbits.items()}
    for k in range(COUNT + 1):
        result.add_row(
            str(k), *(f"{c[k]:.4e}" for c in found.values()), f"{found[last][k] / found[last][1]:.3e}"
        )
    return result


def convergence(comm, model, own, frequency):
    """Tables of harmonics at the last force over steps, modes and meshes."""
    from rich.table import Table

    import sbfem_petsc as sb

    load = sb.PointForce("A", fy=own.forces[-1])

    def study(title, parameter, orbits):
        import numpy as np

        result = Table(
            title=f"{title}: {own.forces[-1]:g} N at {frequency:g} Hz",
            caption="change: of the complex harmonics 0-6 together to those of the last row, over the first",
        )
        for name in (parameter, "A1, m", *(f"A{k}/A1" for k in (0, 2, 3, 4)), "change"):
            result.add_column(name, justify="right")
        finest = orbits[-1][1].harmonics("A")
        for name, orbit in orbits:
            c = orbit.harmonics("A")
            change = np.linalg.norm(c[:7] - finest[:7]) / abs(finest[1])
            result.add_row(
                name,
                f"{abs(c[1]):.5e}",
                *(f"{abs(c[k] / c[1]):.4e}" for k in (0, 2, 3, 4)),
                f"{change:.1e}" if change > 0.0 else "",
            )
        return result

    yield study(
        "Steps",
        "steps",
        [
            (str(n), sb.periodic(model, load, frequency, steps=n, modes=own.modes, stability=False))
            for n in (256, 512, 1024, 2048, 4096)
        ],
    )
    yield study(
        "Modes",
        "modes",
        [
            (str(m), sb.periodic(model, load, frequency, steps=own.steps, modes=m, stability=False))
            for m in (40, 80, 150, 250)
        ],
    )
    orbits = []
    for order, grading, tip_size in MESHES:
        other = build(comm, own.damping, order=order, grading=grading, tip_size=tip_size)
        orbits.append(
            (
                f"{order} / {grading:g} / {tip_size * 1e6:g} um / {len(other.pairs)}",
                sb.periodic(other, load, frequency, steps=own.steps, modes=own.modes, stability=False),
            )
        )
        other.destroy()
    yield study("Meshes", "order / grading / tip / pairs", orbits)


def write(folder, name, orbits):
    """CSV of the complex harmonics; HDF5 of the motions."""
    import numpy as np

    import sbfem_petsc as sb

    def plain(case):
        return case.replace(", ", "_").replace(" ", "_")

    c = np.array([orbit.harmonics("A")[: COUNT + 1] for orbit in orbits.values()])
    columns = np.stack([c.real, c.imag], axis=1).reshape(-1, COUNT + 1)
    header = "harmonic," + ",".join(f"{part}_{plain(case)}_m" for case in orbits for part in ("re", "im"))
    np.savetxt(
        os.path.join(folder, f"harmonics_{name}.csv"),
        np.column_stack([np.arange(COUNT + 1), columns.T]),
        delimiter=",",
        fmt=["%d"] + ["%.9e"] * len(columns),
        comments="",
        header=header,
    )
    for case, orbit in orbits.items():
        sb.save_orbit(orbit, os.path.join(folder, f"orbit_{name}_{plain(case)}.h5"))


def pictures(folder, comm, orbits, figure, title, name):
    """The figure; phase plot, gaps and resultant of the last motion, and its multipliers."""
    from sbfem_petsc.plot import plot_harmonics, plot_multipliers, plot_orbit, save_picture

    last = list(orbits)[-1]
    pairs = orbits[last].contact_force.shape[1]
    shown, text = {"at the tip": 0, "middle pair": pairs // 2, "mouth": pairs - 1}, f"{last}, {title}"
    for file, drawing in (
        (figure, plot_harmonics(orbits, "A", count=COUNT, title=title, comm=comm)),
        (f"orbit_{name}", plot_orbit(orbits[last], "A", pairs=shown, title=text, comm=comm)),
        (f"multipliers_{name}", plot_multipliers(orbits[last], title=text, comm=comm)),
    ):
        save_picture(drawing, os.path.join(folder, f"{file}.png"))


if __name__ == "__main__":
    run(main)
