"""Map of behaviour of the cracked beam around 14.1 kHz: where the curves of Fig. 11 lose their stability.

Case P under a sine at A, modal damping ratio 0.002. Response curves at some forces are followed over the
frequency; from each bifurcation on them a line leads over the force, each line once. Ends of the lines are
checked on curves at their own force, which know nothing of the lines (some minutes in all):
    python examples/loci.py --forces 700 --points 10
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Loci of bifurcations of the cracked beam over frequency and force, 13.9-14.6 kHz.")
parser.add_numbers(forces=([700.0, 1500.0], "forces of the curves from which the lines begin, N"))
parser.add_numbers(least=(300.0, "least force, N"), most=(1500.0, "largest force, N"))
parser.add_numbers(start=(13900.0, "Hz"), stop=(14600.0, "Hz"), damping=(0.002, "modal damping ratio"))
parser.add_numbers(points=(30, "points to either side"), checks=(2, "points of each line checked"))
parser.add_numbers(steps=(256, "time steps a period"), modes=(80, "modes kept"))
parser.add_numbers(order=(5, "polynomial order of the edges"))
parser.add_output("loci", "lines and the picture", "write the lines only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables import loci as tables
    from examples.tables.harmonics import build

    comm, out, folder = begin(own.output)
    model = build(comm, own.damping, order=own.order)
    reduced = sb.reduce(model, sb.PointForce("A", fy=1.0), modes=own.modes)
    out.print(f"\n{model}\n{reduced}")
    lines = []
    for force in own.forces:
        load = sb.PointForce("A", fy=force)
        curve = sb.frequency_response(reduced, load, own.start, own.stop, steps=own.steps)
        out.print(f"\n{force:g} N: {curve}")
        fresh = tables.new_lines(curve, force, own.least, own.most, own.points, lines)
        for line in fresh:
            out.print(f"  {tables.told(line)}")
            for sentence in tables.checks(reduced, curve, line, own.checks, own.steps):
                out.print(f"    {sentence}")
        lines += fresh
    tables.write(folder, comm, lines)
    if not own.no_pictures and lines:
        tables.picture(folder, comm, lines, own.damping)
    model.destroy()
    out.print(f"\nlines{'' if own.no_pictures else ' and the picture'} are in {folder}")


if __name__ == "__main__":
    run(main)
