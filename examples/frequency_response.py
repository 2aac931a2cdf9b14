"""Frequency response of the cracked beam, 13.9 to 14.6 kHz, without contact and at 300 to 1500 N: Fig. 11.

Case P, a sine at A, around mode 17 (14144 Hz with the crack open). Damping, which the paper does not give,
decides which parts are unstable; instabilities narrower than the points' distance need a --largest-step:
    mpiexec -n 2 python examples/frequency_response.py --damping 0.0005 --largest-step 4
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Frequency response of the cracked beam, 13.9-14.6 kHz (Fig. 11).")
parser.add_numbers(forces=([300.0, 500.0, 700.0, 1500.0], "amplitudes at A, N"))
parser.add_numbers(damping=(0.002, "modal damping ratio"), largest_step=(float, "between points, Hz"))
parser.add_numbers(start=(13900.0, "Hz"), stop=(14600.0, "Hz"), steps=(512, "time steps a period"))
parser.add_tip_mesh()
parser.add_output("frequency_response", "curves and pictures", "write the curves only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc.plot import plot_branches, plot_multipliers, save_pictures

    comm, out, folder = begin(own.output)
    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    refined = {"order": own.order, "grading": own.grading, "tip_size": own.tip_size}
    mesh = sb.on_root(comm, lambda: beam.mesh(**refined))
    material = sb.Material(young=70e9, poisson=0.33, density=2700)
    model = sb.Model(mesh, material, clamped="left", damping=own.damping)
    out.print(model)
    curves = {}
    for force in (0.0, *own.forces):
        # the linear response is that to 1 N, drawn at its own scale
        name = f"{force:g} N" if force else "no contact"
        load = sb.PointForce("A", fy=force or 1.0)
        chosen = {"largest_step": own.largest_step} if force else {"contact": False}
        curve = sb.frequency_response(model, load, own.start, own.stop, steps=own.steps, **chosen)
        curves[name] = curve
        out.print(f"{name}: {curve}", curve.peak("A"), *curve.bifurcations, sep="\n  ")
    sb.save(f"{folder}/curves.h5", curves)
    if not own.no_pictures:
        forces = dict(zip(curves, (1.0, *own.forces)))
        title = f"modal damping ratio {own.damping:g}"
        drawing = plot_branches(curves, "A", forces=forces, title=title, comm=comm)
        last = plot_multipliers(curve, title=f"{name}, {title}", comm=comm)
        save_pictures(folder, figure_11=drawing, multipliers=last)
    out.print(f"curves and pictures are in {folder}")


if __name__ == "__main__":
    run(main)
