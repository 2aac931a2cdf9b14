"""What each command does; an exit code where it is not 0."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from ..command_line import tell
from ..progress import watch_for
from ..ranks.parallel import on_root
from ..study.case.case import Case, read_case
from ..writing import as_json

Options = argparse.Namespace
# Exit code of a sweep that has come to its end, but for some of its rows.
FAILED_ROWS = 3


def _say(options: Options, comm: Any, text: str) -> None:
    if comm.rank == 0 and not options.quiet:
        tell(text)


def _answer(options: Options, comm: Any, facts: Any, text: str) -> None:
    """Facts as JSON where that is asked for, else in words."""
    if not options.json:
        _say(options, comm, text)
    elif comm.rank == 0:
        tell(as_json(facts))


def _case(options: Options, comm: Any) -> Case:
    """The case, read on every rank after rank 0 found no fault."""
    on_root(comm, lambda: read_case(options.case))
    return read_case(options.case)


def new(options: Options, comm: Any) -> None:
    """Write a starter case."""
    from ..study.starter import write_starter

    written = on_root(comm, lambda: write_starter(options.kind, options.file, replace=options.replace))
    _say(options, comm, f"written: {', '.join(written or ())}\nnext:  sbfem check {options.file}")


def check(options: Options, comm: Any) -> None:
    """Validate a case and say what it takes."""
    from ..study.estimates import as_text, requirements

    case = _case(options, comm)
    facts = requirements(case, comm)
    _answer(options, comm, facts, as_text(case, facts))


def mesh(options: Options, comm: Any) -> None:
    """Draw the discretisation, or show it in gmsh's window."""
    from meshing.gmsh.window import show_mesh

    from ..study.case import objects

    case = _case(options, comm)
    path = options.output or f"{os.path.splitext(options.case)[0]}.mesh.png"
    with watch_for(comm, options.quiet) as watch:
        watch.stage("mesh")
        found = on_root(comm, lambda: objects.mesh(case))
        if not options.gui:
            from ..plot.drawing import save_picture
            from ..plot.meshes import plot_discretisation

            axes = plot_discretisation(found, comm=comm)
            on_root(comm, lambda: save_picture(axes, path))
    if options.gui:
        on_root(comm, lambda: show_mesh(found) if found else None)
    else:
        _say(options, comm, f"{found!r}\nwritten: {path}")


def run(options: Options, comm: Any) -> int:
    """Run the analyses."""
    from ..study.run import run_case

    case = _case(options, comm)
    output = options.output or os.path.join("output", Path(options.case).stem)
    with watch_for(comm, options.quiet) as watch:
        summary = run_case(case, output, comm=comm, replace=options.replace, watch=watch)
    _answer(options, comm, summary, f"results are in {os.path.abspath(output)}")
    failed = summary["run"]["failed"]
    for name, reason in failed.items():
        if comm.rank == 0:
            tell(f"error: {name}: {reason}", sys.stderr)
    return 0 if not failed else 2 if summary["run"]["wrong_input"] else 1


def sweep(options: Options, comm: Any) -> int:
    """Run a sweep."""
    from ..study.sweep import sweep as run_sweep

    case = _case(options, comm)
    output = options.output or os.path.join("output", f"{Path(options.case).stem}_sweep")
    with watch_for(comm, options.quiet) as watch:
        keep = {"output": output, "replace": options.replace, "rows": options.rows}
        found = run_sweep(case, **keep, comm=comm, watch=watch)
    failed = [reason for reason in found.reasons if reason]
    further = "; a last call without --rows writes the table of all" if options.rows else ""
    text = f"{found!r}\nresults are in {os.path.abspath(output)}{further}"
    _answer(options, comm, found.facts(), text)
    if failed and comm.rank == 0:
        tell(f"error: {len(failed)} of {len(found.reasons)} rows failed; the first: {failed[0]}", sys.stderr)
    return FAILED_ROWS if failed else 0


def plot(options: Options, comm: Any) -> None:
    """Draw the pictures again."""
    from ..study.revive import draw_again

    with watch_for(comm, options.quiet) as watch:
        folder = draw_again(options.results, options.output, comm, watch, animation=options.animation)
    _say(options, comm, f"pictures are in {folder}")


def report(options: Options, comm: Any) -> None:
    """Write a report."""
    from ..study.report import write_report

    path = on_root(comm, lambda: write_report(options.results, options.output))
    _say(options, comm, f"written: {path}")


def info(options: Options, comm: Any) -> None:
    """Say what a results file holds."""
    from ..study.revive import described, read_any

    if comm.rank == 0:
        results = read_any(options.results)
        if options.case:
            tell(results.text, end="")
        else:
            _answer(options, comm, results.facts(), described(results))


def export(options: Options, comm: Any) -> None:
    """Write results in other formats."""
    from ..study.revive import export_results

    wanted = [name for name in ("csv", "vtu") if getattr(options, name)]
    if not wanted:
        raise ValueError("export needs a format: give --csv or --vtu, or both")
    with watch_for(comm, options.quiet) as watch:
        written = export_results(options.results, wanted, options.output, comm, watch)
    _say(options, comm, "\n".join(f"written: {path}" for path in written))


def doctor(options: Options, comm: Any) -> int:
    """Say versions and what is missing."""
    from .doctor import as_text, examine

    findings = examine(comm)
    _answer(options, comm, findings, as_text(findings))
    return 1 if findings["faults"] else 0
