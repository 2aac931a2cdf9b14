"""A solid cantilever with an edge crack, from gmsh by CalculiX to the folds of its response.

Steel, 200 x 20 x 10 mm, held at x = 0; a crack of 5 mm goes down from the top at x = 80 mm. gmsh meshes
`cantilever.geo`, CalculiX (ccx) stores the matrices of `cantilever.inp`; then frequencies, 100 N at the free
end, and the response to 1 N about the first frequency with faces 5 um apart, with its folds.
    ./run python examples/cracked_cantilever.py --size 5 --fine 2
"""

import pathlib
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("A solid cantilever with a crack: gmsh, CalculiX, contact, the folds of its response.")
parser.add_numbers(size=(10.0, "size of the elements, mm"), fine=(5.0, "size of those at the crack, mm"))
parser.add_output("cracked_cantilever", "deck, matrices, curve and picture", "write no picture")


def store(folder, size, fine):
    """Mesh, deck and matrices in N, mm and t."""
    import gmsh

    given = f"gmsh -v 2 -setnumber size {size} -setnumber fine {fine}"
    gmsh.initialize(given.split(), readConfigFiles=False)
    gmsh.open(str(HERE / "cantilever.geo"))
    gmsh.write(f"{folder}/mesh.inp")
    gmsh.finalize()
    shutil.copy(HERE / "cantilever.inp", folder)
    subprocess.run(["ccx", "cantilever"], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from sbfem_petsc.plot import plot_branches, save_picture

    comm, out, folder = begin(own.output)
    sb.on_root(comm, lambda: store(folder, own.size, own.fine))
    body = sb.read_calculix(f"{folder}/cantilever", units="mm-N-t")
    corner = body.at((0.200, 0.020, 0.010), "z")
    given = {"loads": {"F": corner}, "points": {"corner": corner}, "modes": 40, "damping": 0.002}
    touching = sb.reduce(body, contact=body.contact("LEFT", "RIGHT", normal="x", gap=0.0), **given)
    out.print(body.summary(), sb.modal(touching, 5), sb.static(touching, 100.0), sep="\n")
    apart = sb.reduce(body, contact=body.contact("LEFT", "RIGHT", normal="x", gap=5e-6), **given)
    curve = sb.frequency_response(apart, 1.0, 194.0, 204.0)
    out.print(curve, *curve.bifurcations, sep="\n")
    sb.save(f"{folder}/response.h5", curve)
    if not own.no_pictures:
        save_picture(plot_branches(curve, "corner", comm=comm), f"{folder}/response.png")
    out.print(f"deck, matrices, curve and picture are in {folder}")


if __name__ == "__main__":
    run(main)
