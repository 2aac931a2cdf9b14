"""Map of behaviour of the cracked beam around 14.1 kHz: where the curves of Fig. 11 lose their stability,
over frequency and force.

Case P (400 x 5 mm aluminium, V-notch of 2.5 mm at 80 mm with a mouth of 2 micrometres, clamped on the left)
under a sine at A, modal damping ratio 0.002. Response curves at some forces are followed over the frequency;
from each bifurcation on them a line leads over the force, each line once. Ends of the lines are checked on
curves at their own force, which know nothing of the lines: the bifurcation stands there at the same
frequency.

    python examples/loci.py                                              (some minutes)
    python examples/loci.py --forces 700 --points 10
"""

import dataclasses
import os
import pathlib
import sys
import time
from functools import partial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

# Half the range of a curve that checks a point, and its largest step, relative to the frequency.
NEAR, FINE = 2e-4, 5e-5


def options():
    """The example's own options; PETSc is started with the rest of the command line."""
    parser = Parser("Loci of bifurcations of the cracked beam over frequency and force, 13.9-14.6 kHz.")
    parser.add_argument(
        "--forces",
        type=float,
        nargs="+",
        default=[700.0, 1500.0],
        help="forces of the curves from which the lines begin, N (default 700 1500)",
    )
    parser.add_argument("--least", type=float, default=300.0, help="least force, N (default 300)")
    parser.add_argument("--most", type=float, default=1500.0, help="largest force, N (default 1500)")
    parser.add_argument("--start", type=float, default=13900.0, help="Hz (default 13900)")
    parser.add_argument("--stop", type=float, default=14600.0, help="Hz (default 14600)")
    parser.add_argument("--damping", type=float, default=0.002, help="modal damping ratio (default 0.002)")
    parser.add_argument("--points", type=int, default=30, help="points to either side (default 30)")
    parser.add_argument("--checks", type=int, default=2, help="points of each line checked (default 2)")
    parser.add_argument("--steps", type=int, default=256, help="time steps a period (default 256)")
    parser.add_argument("--modes", type=int, default=80, help="modes kept (default 80)")
    parser.add_argument("--order", type=int, default=5, help="polynomial order of the edges (default 5)")
    parser.add_output("loci", "lines and the picture", "write the lines only")
    return parser.parse()


def main():
    """Run the example."""
    own = options()
    import numpy as np

    import sbfem_petsc as sb
    from meshing import Beam, VNotch

    comm, out, folder = begin(own.output)
    beam = Beam(0.400, 0.005, [VNotch(0.080, 0.0025, 0.0458366)])
    model = sb.Model(
        beam.mesh(order=own.order), sb.Material(70e9, 0.33, 2700.0), damping=own.damping, comm=comm
    )
    reduced = sb.reduce(model, sb.PointForce("A", fy=1.0), modes=own.modes)
    out.print(f"\n{model}\n{reduced}")
    lines = []
    for force in own.forces:
        began = time.perf_counter()
        curve = sb.frequency_response(
            reduced, sb.PointForce("A", fy=force), own.start, own.stop, steps=own.steps
        )
        out.print(f"\n{force:g} N: {curve}, {time.perf_counter() - began:.1f} s")
        began = time.perf_counter()
        found = sb.loci(curve, own.least / force, own.most / force, points=own.points)
        fresh = [new for new in (in_newtons(line, force) for line in found) if not known(new, lines)]
        lines += fresh
        for line in fresh:
            low, high = line.frequency.min(), line.frequency.max()
            out.print(
                f"  {line.kind}: {len(line)} points, {low:.7g} to {high:.7g} Hz, {line.value.min():.5g} to "
                f"{line.value.max():.5g} N"
            )
        out.print(f"  {len(fresh)} new lines of {len(found)}, {time.perf_counter() - began:.1f} s")
        for line in fresh:
            for k in np.linspace(0, len(line) - 1, own.checks).astype(int):
                out.print(f"  {checked(reduced, curve, line, int(k), own.steps)}")
    for number, line in enumerate(lines):
        name = os.path.join(folder, f"line_{number}_{line.kind.replace(' ', '_')}.csv")
        sb.on_root(comm, partial(line.to_csv, name))
    if not own.no_pictures and lines:
        sb.on_root(comm, lambda: picture(folder, lines, own.damping))
    model.destroy()
    out.print(f"\nlines{'' if own.no_pictures else ' and the picture'} are in {folder}")


def in_newtons(line, force):
    """A line whose second parameter is the force, N, instead of the factor on it."""
    return dataclasses.replace(line, value=force * line.value)


def known(line, others):
    """Whether the middle of a line is on one that is known, to 1 Hz and 20 N."""
    import numpy as np

    middle = len(line) // 2
    for other in others:
        if other.kind == line.kind:
            places, whole = np.linspace(0.0, len(other) - 1.0, 2000), np.arange(len(other))
            frequency, force = (np.interp(places, whole, v) for v in (other.frequency, other.value))
            apart = np.hypot(frequency - line.frequency[middle], (force - line.value[middle]) / 20.0)
            if apart.min() < 1.0:
                return True
    return False


def checked(reduced, curve, line, k, steps):
    """How far the bifurcation of a curve over the frequency at a line's own force is from that line."""
    import numpy as np

    import sbfem_petsc as sb

    frequency, load = float(line.frequency[k]), sb.PointForce("A", fy=float(line.value[k]))
    start = dataclasses.replace(curve.orbit(0), state=line.states[k])
    for side in (-1.0, 1.0):  # behind a fold there is no motion
        try:
            first = sb.periodic(reduced, load, frequency * (1.0 + side * NEAR), steps=steps, start=start)
            near = sb.frequency_response(
                reduced,
                load,
                first.frequency,
                frequency * (1.0 - side * NEAR),
                first=first,
                largest_step=FINE * frequency,
            )
        except sb.SolveError:
            continue
        found = [item.value for item in near.bifurcations if item.kind == line.kind]
        if found:
            apart = float(np.abs(np.array(found) / frequency - 1.0).min())
            return (
                f"{line.kind} at {line.value[k]:.6g} N, {frequency:.8g} Hz: on a curve {apart:.1e} of it off"
            )
    return f"{line.kind} at {line.value[k]:.6g} N, {frequency:.8g} Hz: no curve there has one"


def picture(folder, lines, damping):
    """The map."""
    from sbfem_petsc.plot import plot_loci, save_picture

    axes = plot_loci(lines, label="force, N", title=f"modal damping ratio {damping:g}")
    save_picture(axes, os.path.join(folder, "loci.png"))


if __name__ == "__main__":
    run(main)
