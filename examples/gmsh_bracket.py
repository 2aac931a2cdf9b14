"""A gmsh model of one's own: a bolted bracket with bronze bushes and a crack in its arm.

Reads `bracket.geo`, which lies beside this file, and finds the natural frequencies 1-10 with the crack open,
static contact when the arm's end is pushed up with 4 kN, the linear response when it is pulled down, and the
stress intensity factors of both. The crack ends below the arm's neutral axis: pushed up, its upper part
closes and its tip still opens. Edges of orders 3 to 6 tell the error.

    mpiexec -n 2 python examples/gmsh_bracket.py --size 0.01 -static_ksp_type cg -static_pc_type gamg
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

GEOMETRY, FORCE = pathlib.Path(__file__).parent / "bracket.geo", 4000.0  # N
parser = Parser(
    "A bracket from a gmsh model: two materials, curved edges, a crack; modes and static contact."
)
size_text = "largest size of the cells, m (default: the sizes in bracket.geo, at most 0.020)"
parser.add_numbers(order=(5, "polynomial order of the edges"), size=(float, size_text))
parser.add_output("gmsh_bracket", "files and pictures", "write the HDF5 and VTU files only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables.gmsh_bracket import print_tables, summary, write
    from meshing import read_gmsh

    comm, out, folder = begin(own.output)
    materials = {
        "steel": sb.Material(young=210e9, poisson=0.30, density=7850),
        "bronze": sb.Material(young=105e9, poisson=0.34, density=8700),
    }
    measured = {}
    for order in sorted({3, 4, 5, 6, own.order}, key=lambda order: order == own.order):
        mesh = sb.on_root(comm, lambda order=order: read_gmsh(GEOMETRY, order=order, size=own.size))
        model = sb.Model(mesh, materials, clamped="bolts", thickness=0.020)
        modes = sb.modal(model, count=10)
        cases = {
            "closing": sb.static(model, sb.PointForce("load", fy=FORCE)),
            "opening": sb.static(model, sb.PointForce("load", fy=-FORCE), contact=False),
        }
        measured[order] = summary(model, modes, cases)
    out.print(f"{model}\n")
    print_tables(out, model, modes, cases, measured, order=own.order, force=FORCE)
    write(folder, mesh, model, modes, cases, pictures=not own.no_pictures)
    out.print(f"\nfiles and pictures are in {folder}")


if __name__ == "__main__":
    run(main)
