"""A solid cantilever with an edge crack, from gmsh by CalculiX to the folds of its response.

Steel, 200 x 20 x 10 mm, held at x = 0; the crack goes down from the top at x = 80 mm, 5 mm deep over the
whole width. gmsh makes second-order tetrahedra and opens the crack, the deck `cantilever.inp` has CalculiX
(ccx) store the matrices; then frequencies, 100 N at a corner of the free end at rest, and the response to 1 N
about the first frequency with faces that are 5 um apart, whose folds are told and drawn.

    ./run python examples/cracked_cantilever.py --size 5 --fine 2
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("A solid cantilever with a crack: gmsh, CalculiX, contact, the folds of its response.")
parser.add_numbers(
    size=(10.0, "size of the elements, mm"),
    fine=(5.0, "size of those at the crack, mm"),
    modes=(40, "modes that are kept"),
)
parser.add_output("cracked_cantilever", "deck, matrices, files and pictures", "write no pictures")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables.cracked_cantilever import HEIGHT, LENGTH, WIDTH, calculix, mesh, write_deck
    from sbfem_petsc.plot import plot_branches, save_picture

    comm, out, folder = begin(own.output)
    deck = pathlib.Path(folder) / "cantilever.inp"
    sb.on_root(comm, lambda: (write_deck(deck, *mesh(own.size, own.fine)), calculix(deck)))
    body = sb.read_calculix(deck, units="mm-N-t")
    out.print(body.summary())
    corner = body.at((1e-3 * LENGTH, 1e-3 * WIDTH, 1e-3 * HEIGHT), "z")
    given = {"loads": {"F": corner}, "points": {"corner": corner}, "modes": own.modes, "damping": 0.002}
    touching = sb.reduce(body, contact=body.contact("LEFT", "RIGHT", normal="x", gap=0.0), **given)
    out.print(sb.modal(touching, 5), sb.static(touching, 100.0), sep="\n")
    apart = sb.reduce(body, contact=body.contact("LEFT", "RIGHT", normal="x", gap=5e-6), **given)
    curve = sb.frequency_response(apart, 1.0, 194.0, 204.0)
    out.print(curve, *curve.bifurcations, sep="\n")
    sb.save(pathlib.Path(folder) / "response.h5", curve)
    if not own.no_pictures:
        save_picture(plot_branches(curve, "corner", comm=comm), pathlib.Path(folder) / "response.png")
    out.print(f"\ndeck, matrices, files and pictures are in {folder}")


if __name__ == "__main__":
    run(main)
