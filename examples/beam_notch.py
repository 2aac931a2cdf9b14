"""The paper's beam with a breathing crack: discretisation, natural frequencies and static contact.

Case P: 400 x 5 mm, aluminium, V-notch of 2.5 mm at 80 mm with a mouth of 2 micrometres, clamped on the left.
Natural frequencies 1-46 and displacements at 1, 100 and 300 N stand beside converged values of an independent
finite element code and the columns printed in the paper.

    mpiexec -n 2 python examples/beam_notch.py --order 7 -static_ksp_type cg -static_pc_type gamg
"""

import pathlib
import sys
import warnings

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("The paper's beam with a breathing crack: frequencies 1-46, static contact at 1, 100, 300 N.")
parser.add_numbers(size=(float, "length of the cells along the beam, m (default 0.0125)"))
parser.add_numbers(tip_size=(float, "half-size of the S-element at the crack tip, m (default 5e-5)"))
parser.add_numbers(order=(5, "order of the edges"), continued_fraction=(1, "terms of continued fractions"))
layout = '"vertex": the paper\'s layout, the tip a corner of four S-elements'
parser.add_argument("--layout", choices=("tip", "vertex"), default="tip", help=layout)
parser.add_output("beam_notch", "files and pictures", "write the HDF5 and VTU files only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables.beam_notch import print_tables
    from meshing import Beam, VNotch
    from sbfem_petsc.plot import plot_contact, plot_crack, plot_discretisation, plot_modes, save_pictures

    comm, out, folder = begin(own.output)
    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    chosen = {key: getattr(own, key) for key in ("order", "size", "tip_size", "layout")}
    mesh = sb.on_root(comm, lambda: beam.mesh(**chosen))
    material = sb.Material(young=70e9, poisson=0.33, density=2700)
    model = sb.Model(mesh, material, clamped="left", continued_fraction=own.continued_fraction)
    out.print(f"{model}\n")
    modes = sb.modal(model, count=46)
    warnings.simplefilter("ignore", sb.MeshWarning)  # at 1 N; the line of K_I below says it
    pushes = {f"{f:g} N": sb.static(model, sb.PointForce("A", fy=f)) for f in (1.0, 100.0, 300.0)}
    print_tables(out, modes, pushes, tip_element=own.layout == "tip")
    sb.save(f"{folder}/beam_notch.h5", {"modes": modes, **pushes})
    sb.write_vtu(f"{folder}/static_300N.vtu", model, {"displacement": pushes["300 N"]})
    sb.write_modes(f"{folder}/modes.vtu", modes, range(3))
    if not own.no_pictures:
        save_pictures(folder, discretisation=plot_discretisation(mesh, comm=comm))
        save_pictures(folder, modes=plot_modes(modes, range(8)), contact=plot_contact(pushes))
        save_pictures(folder, crack=plot_crack(model, {k: pushes[k] for k in ("1 N", "100 N")}))
    out.print(f"\nfiles and pictures are in {folder}")
    model.destroy()


if __name__ == "__main__":
    run(main)
