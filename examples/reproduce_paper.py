"""Recompute every table and figure of Sepehry et al. (2020) and write one report.

    python examples/reproduce_paper.py                          the whole report, in output/reproduce_paper
    python examples/reproduce_paper.py --only table6 fig11      some parts; those that were computed before
    stay in the report python examples/reproduce_paper.py --list                   names of the parts mpiexec
    -n 2 python examples/reproduce_paper.py             parts shared out among the ranks

report.html holds its pictures and opens from disk; the same pictures are PNG files, numbers.json has all
numbers, parts/ the curves (NPZ). Each finished part is kept, and an interrupted run goes on where it was; a
part is computed again when the code, the reference data, the libraries or PETSc's options have changed, or
with --fresh. A part that fails is named with a sentence, and the exit code is 1.
"""

import json
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import PREFIXES, Parser, console, run


def options():
    """The program's own options; PETSc is started with the rest of the command line."""
    parser = Parser("Every table and figure of Sepehry et al. (2020), recomputed and checked, in one report.")
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="PART",
        help="names of the parts to compute (default: all; --list shows them)",
    )
    parser.add_argument("--list", action="store_true", help="print the names of the parts and end")
    parser.add_argument("--fresh", action="store_true", help="compute finished parts again")
    parser.add_argument(
        "--output",
        default="output/reproduce_paper",
        help="folder of the report (default output/reproduce_paper)",
    )
    parser.add_argument("--no-pictures", action="store_true", help="numbers only")
    return parser.parse()


def main():
    """Run the program."""
    own = options()
    from mpi4py import MPI
    from paper.findings import plain
    from paper.page import page
    from paper.registry import PARTS, chosen
    from paper.runner import Outcome, progress, run_parts
    from paper.store import Store, fingerprint, write_text
    from petsc4py import PETSc

    import sbfem_petsc as sb
    from sbfem_petsc.petsc import version_line
    from sbfem_petsc.results.hdf5 import check_output_folder

    comm = MPI.COMM_WORLD
    out = console(comm)
    if own.list:
        for part in PARTS:
            out.print(f"{part.name:12s} {part.title}", markup=False)
        return
    parts = chosen(own.only)
    pictures = not own.no_pictures
    version = version_line()
    solver_options = {
        name: value for name, value in PETSc.Options().getAll().items() if name.startswith(tuple(PREFIXES))
    }
    store = Store(check_output_folder(own.output, comm), comm.bcast(fingerprint(version, solver_options)))
    sb.on_root(comm, store.prepare)
    comm.barrier()
    out.print(f"{version}, {comm.size} rank{'s' if comm.size > 1 else ''}")

    began = time.perf_counter()
    with progress(comm, out) as told:
        outcomes = run_parts(parts, store, comm, own.fresh, pictures, told)

    def write():
        kept = {part.name: store.load(part, pictures) for part in PARTS if part.name not in outcomes}
        everything = outcomes | {
            name: Outcome(*result, reused=True) for name, result in kept.items() if result is not None
        }
        everything = {part.name: everything[part.name] for part in PARTS if part.name in everything}
        numbers = {
            name: {
                "seconds": o.seconds,
                **(
                    {"error": o.error}
                    if o.finding is None
                    else {k: plain(getattr(o.finding, k)) for k in ("numbers", "claims", "tables", "notes")}
                ),
            }
            for name, o in everything.items()
        }
        write_text(
            store.folder / "numbers.json", json.dumps({"version": version, "parts": numbers}, indent=1)
        )
        write_text(store.folder / "report.html", page(PARTS, everything, store, version))

    sb.on_root(comm, write)
    out.print(table(parts, outcomes))
    failed = {name: outcome.error for name, outcome in outcomes.items() if outcome.finding is None}
    out.print(
        f"{time.perf_counter() - began:.1f} s; the report is {store.folder / 'report.html'}", markup=False
    )
    if failed:
        error = RuntimeError(
            "; ".join(f"part {name} failed: {sentence}" for name, sentence in failed.items())
        )
        error.on_all_ranks = True
        raise error


def table(parts, outcomes):
    """What became of each part."""
    from rich.table import Table

    result = Table(title="Parts of the report")
    for name, justify in (("part", "left"), ("seconds", "right"), ("statements that hold", "left")):
        result.add_column(name, justify=justify)
    for part in parts:
        outcome = outcomes[part.name]
        claims = outcome.finding.claims if outcome.finding else []
        state = f"{sum(claim.holds for claim in claims)} of {len(claims)}" if outcome.finding else "failed"
        result.add_row(part.name, f"{outcome.seconds:.1f}{' (reused)' if outcome.reused else ''}", state)
    return result


if __name__ == "__main__":
    run(main)
