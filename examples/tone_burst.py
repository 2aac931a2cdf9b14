"""Tone bursts on the paper's beam with a breathing crack: Figs. 5 and 6.

Case P, undamped, under bursts of 100 cycles at 3000 Hz and of 1 N and 300 N (eq. 39, which peaks at twice
that) at A, 0-33 ms. At 1 N the crack stays open; at 300 N it breathes. Histories on a mesh refined towards
the tip stand beside those of an independent hp finite element computation (its error is 2e-4).

    python examples/tone_burst.py --duration 0.005 --step 2e-6
"""

import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Tone bursts of 1 N and 300 N on the paper's beam with a breathing crack (Figs. 5 and 6).")
parser.add_numbers(duration=(0.033, "s"), step=(1e-6, "time step, s"), modes=(80, "modes kept"))
parser.add_tip_mesh()
parser.add_output("tone_burst", "histories and pictures", "write the histories only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import numpy as np

    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc.plot import Panel, plot_histories, save_picture

    comm, out, folder = begin(own.output)
    known = np.load(HERE / "reference" / "transient_paper.npz")
    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    refined = {"order": own.order, "grading": own.grading, "tip_size": own.tip_size}
    mesh = sb.on_root(comm, lambda: beam.mesh(**refined))
    model = sb.Model(mesh, sb.Material(young=70e9, poisson=0.33, density=2700), clamped="left")
    out.print(model)
    histories, places = {}, {1.0: ("t_linear", "uA_y_1N_linear"), 300.0: ("t", "uA_y_300N_contact")}
    for force, names in places.items():
        load = sb.PointForce("A", fy=sb.ToneBurst(force, frequency=3000.0, cycles=100))
        history = sb.transient(model, load, own.duration, step=own.step, modes=own.modes)
        histories[f"{force:g} N"] = history
        time, exact = (known[name][known[names[0]] <= own.duration * (1 + 1e-9)] for name in names)
        u = history.displacement("A")[:, 1]
        apart = np.linalg.norm(np.interp(time, history.time, u) - exact) / np.linalg.norm(exact)
        out.print(f"{force:g} N: {history}", f"relative L2 distance to the reference {apart:.2e}", sep="\n")
        if not own.no_pictures:
            both = {"reference": (time, exact), "sbfem-petsc": (history.time, u)}
            panels = [Panel("$u_y$(A) (m)", both, 1.0, (0.0, own.duration), title=f"{force:g} N")]
            panels += [Panel("$u_y$(A) (m)", both, 1.0, (0.9 * own.duration, own.duration), title="its end")]
            save_picture(plot_histories(panels, comm=comm), f"{folder}/burst_{force:g}N.png")
    sb.save(f"{folder}/histories.h5", histories)
    out.print(f"histories and pictures are in {folder}")


if __name__ == "__main__":
    run(main)
