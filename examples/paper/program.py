"""The program: parts chosen by its options, shared out, kept, and written as one report."""

import json
import time

from mpi4py import MPI
from petsc4py import PETSc
from rich.table import Table

import sbfem_petsc as sb
from sbfem_petsc.command_line import PREFIXES, console
from sbfem_petsc.petsc import version_line
from sbfem_petsc.writing import check_output_folder

from .findings import plain
from .page import page
from .registry import PARTS, chosen
from .runner import Outcome, progress, run_parts
from .store import Store, fingerprint, write_text


def reproduce(own):
    """Compute the parts that the options choose, or list all."""
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
    result = Table(title="Parts of the report")
    for name, justify in (("part", "left"), ("seconds", "right"), ("statements that hold", "left")):
        result.add_column(name, justify=justify)
    for part in parts:
        outcome = outcomes[part.name]
        claims = outcome.finding.claims if outcome.finding else []
        state = f"{sum(claim.holds for claim in claims)} of {len(claims)}" if outcome.finding else "failed"
        result.add_row(part.name, f"{outcome.seconds:.1f}{' (reused)' if outcome.reused else ''}", state)
    return result
