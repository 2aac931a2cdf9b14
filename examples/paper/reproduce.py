"""Recompute every table and figure of Sepehry et al. (2020) and write one report.

    python examples/paper/reproduce.py                          the whole report, in output/reproduce_paper
    python examples/paper/reproduce.py --only table6 fig11      some parts; the report keeps the others
    python examples/paper/reproduce.py --list                   names of the parts
    mpiexec -n 2 python examples/paper/reproduce.py             parts shared out among the ranks

report.html holds its pictures and opens from disk; the same pictures are PNG files, numbers.json has all
numbers, parts/ the curves (NPZ). Each finished part is kept, and an interrupted run goes on where it was; a
part is computed again when the code, the reference data, the libraries or PETSc's options have changed, or
with --fresh. A part that fails is named with a sentence, and the exit code is 1.
"""

import pathlib
import sys

# in the place of this folder, whose modules are a package
sys.path[0] = str(pathlib.Path(__file__).resolve().parents[2])

from sbfem_petsc.command_line import Parser, run

parser = Parser("Every table and figure of Sepehry et al. (2020), recomputed and checked, in one report.")
only = "names of the parts to compute (default: all; --list shows them)"
parser.add_argument("--only", nargs="+", metavar="PART", help=only)
parser.add_argument("--list", action="store_true", help="print the names of the parts and end")
parser.add_argument("--fresh", action="store_true", help="compute finished parts again")
parser.add_output("reproduce_paper", "the report", "numbers only")


def main():
    """Run the program."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    from examples.paper.program import reproduce

    reproduce(own)


if __name__ == "__main__":
    run(main)
