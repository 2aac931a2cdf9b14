"""Free motions of the cracked beam beside its forced peaks at 14.1 kHz, Fig. 11 of the paper.

Case P. The free motions of mode 17 are followed over their energy; response curves at several damping ratios,
under forces in proportion to them, have their peaks next to these motions, the nearer the less damping there
is: by its square. Half a minute:
    python examples/backbone.py --ratios 0.004 0.002 --forces 180
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Backbone of the cracked beam's mode at 14.1 kHz beside forced peaks at falling damping.")
parser.add_numbers(ratios=([0.004, 0.002, 0.001], "modal damping ratios"))
parser.add_numbers(forces=([90.0, 180.0], "amplitudes at a damping ratio of 0.002, N"))
parser.add_numbers(energies=([1e-3, 0.15], "first and last energy, J"))
parser.add_numbers(
    mode=(17, "number of the mode"), modes=(80, "modes kept"), steps=(512, "time steps a period")
)
parser.add_numbers(order=(5, "polynomial order of the edges"))
parser.add_output("backbone", "tables and the picture", "write the tables only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables import backbone as tables
    from examples.tables.harmonics import build

    comm, out, folder = begin(own.output)
    model = build(comm, 0.0, order=own.order)
    reduced = sb.reduce(model, sb.PointForce("A", fy=1.0), modes=own.modes)
    free = sb.backbone(
        reduced, own.mode, *own.energies, steps=own.steps, largest_change=0.1, refine=False, stability=False
    )
    out.print(f"\n{reduced}\n{free}\n")
    curves = {}
    for force in own.forces:
        for ratio in own.ratios:
            name, curve = tables.forced(reduced, free, ratio, force * ratio / 0.002, own.steps)
            curves[name] = curve
            out.print(f"{name}: {tables.told(curve, free)}")
    sb.on_root(comm, lambda: tables.write(folder, free, curves))
    if not own.no_pictures:
        tables.picture(folder, free, curves, comm)
    model.destroy()
    out.print(f"\ntables{'' if own.no_pictures else ' and the picture'} are in {folder}")


if __name__ == "__main__":
    run(main)
