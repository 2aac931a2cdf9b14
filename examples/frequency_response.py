"""Frequency response of the cracked beam, 13.9 to 14.6 kHz, without contact and at 300 to 1500 N: Fig. 11.

Case P, a sine at A, around mode 17 (14144 Hz with the crack open). Damping, which the paper does not give,
decides which parts are unstable; instabilities narrower than the points' distance need a --largest-step:
    mpiexec -n 2 python examples/frequency_response.py --damping 0.0005 0.001 0.002 --largest-step 4
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Frequency response of the cracked beam, 13.9-14.6 kHz (Fig. 11).")
parser.add_numbers(forces=([300.0, 500.0, 700.0, 1500.0], "amplitudes at A, N"))
parser.add_argument("--damping", type=float, nargs="+", action="extend", help="ratios (default 0.002)")
parser.add_numbers(start=(13900.0, "Hz"), stop=(14600.0, "Hz"), steps=(512, "time steps a period"))
parser.add_numbers(largest_step=(float, "between points, Hz (default: none)"))
parser.add_numbers(modes=(int, "modes kept (default: up to 8 times the frequency, at least 80)"))
parser.add_tip_mesh()
parser.add_output("frequency_response", "curves and pictures", "write the curves only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables import frequency_response as tables
    from examples.tables.harmonics import build

    comm, out, folder = begin(own.output)
    found, failures, choice = {}, [], {"steps": own.steps, "modes": own.modes}
    loads = {f"{force:g} N": sb.PointForce("A", fy=force) for force in own.forces}
    for damping in dict.fromkeys(own.damping or (0.002,)):
        model = build(comm, damping, order=own.order, grading=own.grading, tip_size=own.tip_size)
        out.print(f"\n{model}")
        for name, load in {"no contact": sb.PointForce("A", fy=1.0), **loads}.items():
            kind = {"contact": False} if name == "no contact" else {"largest_step": own.largest_step}
            try:
                curve = sb.frequency_response(model, load, own.start, own.stop, **kind, **choice)
            except sb.SolveError as error:  # with the part of the curve that was found, if any
                failures.append(f"{name}, damping ratio {damping:g}: {error}")
                curve = getattr(error, "branch", None)
            if curve:
                found[damping, name] = curve, tables.doublings(load, curve)
                tables.keep(folder, name, damping, *found[damping, name])
                out.print(f"{name}: {curve}")
        if not own.no_pictures:
            tables.pictures(folder, comm, found, damping)
    out.print(tables.peaks(found), tables.stability(found), sep="\n")
    sb.on_root(comm, lambda: tables.write(folder, found))
    out.print(f"\ncurves{'' if own.no_pictures else ' and pictures'} are in {folder}")
    if failures:
        raise sb.SolveError("; ".join(failures))


if __name__ == "__main__":
    run(main)
