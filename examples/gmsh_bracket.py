"""A gmsh model of one's own: a bolted bracket with bronze bushes and a crack in its arm.

Reads `bracket.geo`, which lies beside this file, and finds the natural frequencies 1-10 with the crack open,
static contact when the arm's end is pushed up with 4 kN, the linear response when it is pulled down, and the
stress intensity factors of both. The crack ends below the arm's neutral axis: pushed up, its upper part
closes and its tip still opens. Edges of orders 3 to 6 tell the error, of which those of 3 and 4 are warned.

    mpiexec -n 2 python examples/gmsh_bracket.py --size 0.01 -static_ksp_type cg -static_pc_type gamg
"""

import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("A gmsh model with two materials, curved edges and a crack; modes and static contact.")
parser.add_numbers(orders=([3, 4, 5, 6], "of the edges"), size=(float, "largest size of the cells, m"))
parser.add_output("gmsh_bracket", "files and pictures", "write the HDF5 and VTU files only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from meshing import read_gmsh
    from sbfem_petsc.plot import plot_contact, plot_crack, plot_discretisation, plot_modes, save_pictures

    comm, out, folder = begin(own.output)
    materials = {
        "steel": sb.Material(young=210e9, poisson=0.30, density=7850),
        "bronze": sb.Material(young=105e9, poisson=0.34, density=8700),
    }
    for order in own.orders:
        mesh = sb.on_root(
            comm, lambda order=order: read_gmsh(HERE / "bracket.geo", order=order, size=own.size)
        )
        model = sb.Model(mesh, materials, clamped="bolts", thickness=0.020)
        modes = sb.modal(model, count=10)
        closing = sb.static(model, sb.PointForce("load", fy=4000.0))
        opening = sb.static(model, sb.PointForce("load", fy=-4000.0), contact=False)
        out.print(model, modes, f"closing: {closing}", f"opening: {opening}\n", sep="\n")
    cases = {"closing": closing, "opening": opening}
    sb.save(f"{folder}/gmsh_bracket.h5", {"modes": modes, **cases})  # of the last order
    sb.write_vtu(f"{folder}/static.vtu", model, cases)
    sb.write_modes(f"{folder}/modes.vtu", modes, range(3))
    if not own.no_pictures:
        save_pictures(folder, discretisation=plot_discretisation(mesh, comm=comm))
        save_pictures(folder, modes=plot_modes(modes, range(6), columns=3), crack=plot_crack(model, cases))
        save_pictures(folder, contact=plot_contact({"closing": closing}))
    out.print(f"files and pictures are in {folder}")


if __name__ == "__main__":
    run(main)
