"""Free motions of the cracked beam beside its forced peaks at 14.1 kHz, Fig. 11 of the paper.

Case P. The free motions of mode 17 are followed over their energy; response curves at several damping ratios,
under forces in proportion to them, have their peaks next to them, nearer by the square of the damping:
    python examples/backbone.py --ratios 0.004 0.002 --forces 180
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Backbone of the cracked beam's mode at 14.1 kHz beside forced peaks at falling damping.")
parser.add_numbers(ratios=([0.004, 0.002, 0.001], "modal damping ratios"))
parser.add_numbers(forces=([90.0, 180.0], "amplitudes at a damping ratio of 0.002, N"))
parser.add_numbers(modes=(80, "modes kept"), order=(5, "order of the edges"))
parser.add_output("backbone", "the free motions, the curves and the picture", "write no picture")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import dataclasses

    import numpy as np
    from scipy.interpolate import PchipInterpolator

    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc.plot import plot_branches, save_picture

    comm, out, folder = begin(own.output)
    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    mesh = sb.on_root(comm, lambda: beam.mesh(order=own.order))
    model = sb.Model(mesh, sb.Material(young=70e9, poisson=0.33, density=2700))
    reduced = sb.reduce(model, sb.PointForce("A", fy=1.0), modes=own.modes)
    chosen = {"steps": 512, "stability": False}
    free = sb.backbone(reduced, 17, 1e-3, 0.15, largest_change=0.1, refine=False, **chosen)  # J
    out.print(reduced, free, sep="\n")
    frequency_of, curves = PchipInterpolator(free.amplitude("A"), free.frequency), {}
    for force in own.forces:
        for ratio in own.ratios:
            damped = dataclasses.replace(reduced, damping=np.full(len(reduced.omega), ratio))
            width = ratio * free.frequency[0]  # half a bandwidth
            amplitude, ends = force * ratio / 0.002, free.frequency[[0, -1]] + [-4.0 * width, 4.0 * width]
            curve = sb.frequency_response(damped, [amplitude], *ends, largest_step=0.25 * width, **chosen)
            curves[f"{ratio:g}, {amplitude:g} N"], peak = curve, curve.peak("A")
            apart = peak.frequency / frequency_of(peak.amplitude) - 1.0
            out.print(f"{ratio:g}, {amplitude:g} N: {peak}, {apart:+.2e} from the free motion")
    sb.save(f"{folder}/backbone.h5", {"free": free, **curves})
    if not own.no_pictures:
        axes = plot_branches(curves, backbone=free, title="damping ratio, force", comm=comm)
        save_picture(axes, f"{folder}/backbone.png")
    out.print(f"free motions, curves and picture are in {folder}")


if __name__ == "__main__":
    run(main)
