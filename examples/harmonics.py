"""Harmonics of the steady state at 3000 and 20140 Hz, healthy and with a breathing crack: Figs. 8 and 9.

Case P under a sine at A. The healthy beam has no contact, the crack at 1 N does not close: all harmonics but
the first are zero to rounding. At 300 N the crack closes in every period, and a mean and higher harmonics
appear. The first at 3000 Hz depends on the damping, which the paper does not give: mode 7 is at 3006 Hz.

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
parser.add_tip_mesh()
parser.add_output("harmonics", "motions and pictures", "write the motions only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc.plot import plot_harmonics, plot_orbit, save_pictures
    from sbfem_petsc.results.harmonics import harmonics_table

    comm, out, folder = begin(own.output)
    material, models = sb.Material(young=70e9, poisson=0.33, density=2700), {}
    refined = {"order": own.order, "grading": own.grading, "tip_size": own.tip_size}
    notch = VNotch(x=0.080, depth=0.0025, opening=0.0458366)
    for name, notches, chosen in (("healthy", [], {"order": own.order}), ("cracked", [notch], refined)):
        beam = Beam(length=0.400, height=0.005, notches=notches)
        mesh = sb.on_root(comm, lambda beam=beam, chosen=chosen: beam.mesh(**chosen))
        models[name] = sb.Model(mesh, material, clamped="left", damping=own.damping)
        out.print(f"{name}: {models[name]}")
    cases = {f"healthy, {own.forces[-1]:g} N": ("healthy", own.forces[-1])}
    cases |= {f"{force:g} N": ("cracked", force) for force in own.forces}
    for f in own.frequencies:
        orbits = {}
        for name, (model, force) in cases.items():
            orbit = sb.periodic(models[model], sb.PointForce("A", fy=force), f, steps=own.steps)
            orbits[name] = orbit
            out.print(f"{name}: {orbit}")
        out.print(harmonics_table(orbits, "A", title=f"Amplitudes of u_y(A) at the multiples of {f:g} Hz, m"))
        sb.save(f"{folder}/orbits_{f:g}Hz.h5", orbits)
        if not own.no_pictures:
            all_of_them = plot_harmonics(orbits, "A", title=f"{f:g} Hz", comm=comm)
            last = plot_orbit(orbit, title=f"{name}, {f:g} Hz", comm=comm)
            save_pictures(folder, **{f"harmonics_{f:g}Hz": all_of_them, f"orbit_{f:g}Hz": last})
    out.print(f"motions and pictures are in {folder}")


if __name__ == "__main__":
    run(main)
