"""Harmonics of the steady state at 3000 and 20140 Hz, healthy and with a breathing crack: Figs. 8 and 9.

Case P under a sine at A: moduli of the harmonics of u_y(A). The healthy beam has no contact, the crack at 1 N
does not close: all harmonics but the first are zero to rounding. At 300 N the crack closes in every period,
and a mean and higher harmonics appear. The first harmonic at 3000 Hz depends on the damping, which the paper
does not give, mode 7 being at 3006 Hz.

    mpiexec -n 2 python examples/harmonics.py --frequencies 433 --forces 100 300 --damping 0.005
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Harmonics of the steady state, healthy and cracked beam (Figs. 8 and 9).")
parser.add_numbers(frequencies=([3000.0, 20140.0], "Hz"), damping=(0.002, "modal damping ratio"))
parser.add_numbers(forces=([1.0, 300.0], "amplitudes at A, N; the last is also the healthy beam's"))
parser.add_numbers(steps=(1024, "time steps a period"))
parser.add_numbers(modes=(int, "modes kept (default: up to 8 times the frequency, at least 80)"))
parser.add_tip_mesh()
parser.add_argument("--convergence", action="store_true", help="tables over steps, modes and meshes")
parser.add_output("harmonics", "numbers and pictures", "write the numbers only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables.harmonics import build, comparison, convergence, pictures_at, told, write
    from sbfem_petsc.results.harmonics import harmonics_table

    comm, out, folder = begin(own.output)
    healthy = build(comm, own.damping, notched=False, order=own.order)
    cracked = build(comm, own.damping, order=own.order, grading=own.grading, tip_size=own.tip_size)
    out.print(f"healthy: {healthy}\ncracked: {cracked}")
    for f in own.frequencies:
        out.print(f"\n{f:g} Hz, modal damping ratio {own.damping:g}")
        forces, choice = {f"{n:g} N": n for n in own.forces}, {"steps": own.steps, "modes": own.modes}
        loads = {name: sb.PointForce("A", fy=force) for name, force in forces.items()}
        last = list(loads)[-1]
        orbits = {f"healthy, {last}": sb.periodic(healthy, loads[last], f, **choice)}
        orbits |= {name: sb.periodic(cracked, load, f, **choice) for name, load in loads.items()}
        choice |= {"contact": False, "stability": False}
        linear = sb.periodic(cracked, sb.PointForce("A", fy=1.0), f, **choice)
        out.print("\n".join(f"{name}: {told(orbit)}" for name, orbit in orbits.items()))
        out.print(harmonics_table(orbits, "A", title=f"Amplitudes of u_y(A) at the multiples of {f:g} Hz, m"))
        for part in (*comparison(orbits, linear, forces), *convergence(cracked, own, f)):
            out.print(part)
        write(comm, folder, f, orbits)
        if not own.no_pictures:
            pictures_at(folder, comm, orbits, f)
    out.print(f"\nnumbers{'' if own.no_pictures else ' and pictures'} are in {folder}")


if __name__ == "__main__":
    run(main)
