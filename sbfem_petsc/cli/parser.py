"""The command line of `sbfem`: its own words before `--`, PETSc's after it; their completion in shells."""

from __future__ import annotations

import argparse
import re
from importlib import resources
from typing import NoReturn

import sbfem_petsc as sb

from ..command_line import PREFIXES, RanksParser
from ..study.case.sweep import MOST
from ..study.starter import KINDS

EXIT_CODES = """exit codes:
  0    all is well
  1    the run failed, or an analysis of it; summary.json says why, the others are kept
  2    input that makes no sense: command line, case file, results file, folder
  3    rows of a sweep failed; sweep.csv says why, the others are kept
  130  interrupted (Ctrl-C); the same command goes on where it was
  143  ended by a signal; the same command goes on where it was
mpiexec may end with a code of its own, 1 for 143 say"""


class _Parser(RanksParser):
    def error(self, message: str) -> NoReturn:
        if message.startswith("unrecognized arguments"):
            message += "; --help after a command lists its options, PETSc's stand after --"
        super().error(message)


def make_parser() -> argparse.ArgumentParser:
    """Parser of all commands."""
    prefixes = "\n".join(f"  -{name:9s} {text}" for name, text in PREFIXES.items())
    parser = _Parser(
        prog="sbfem",
        description="Vibration of structures with breathing cracks, from a case file to data and pictures.",
        epilog="A first case:\n  sbfem new beam case.toml\n  sbfem check case.toml\n  sbfem run case.toml "
        "--output results\n\nOn several ranks: mpiexec -n 4 sbfem run case.toml --output results\n\nWords "
        f"after -- go to PETSc and SLEPc, by the prefix of each solve:\n{prefixes}\n  for example  sbfem run "
        f"case.toml -- -static_ksp_type cg -log_view\n\n{EXIT_CODES}",
    )
    parser.add_argument("--version", action="version", version=f"sbfem-petsc {sb.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, text: str, more: str = "") -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=more)
        made.add_argument("--quiet", action="store_true", help="tell errors alone")
        return made

    new = command("new", "write a commented starter case")
    new.add_argument("kind", metavar="KIND", help=f"one of {', '.join(KINDS)}")
    new.add_argument("file", metavar="FILE", help="the case file to write")
    new.add_argument("--replace", action="store_true", help="overwrite existing files")

    check = command(
        "check",
        "validate a case; say its extent, unknowns, contact pairs, and what it will take",
        "Memory and disk are estimates from measurements, good to a factor of two.",
    )

    mesh = command("mesh", "draw the discretisation of a case")
    shown = mesh.add_mutually_exclusive_group()
    shown.add_argument("--output", metavar="PNG", help="picture (default: CASE with .mesh.png)")
    shown.add_argument("--gui", action="store_true", help="show it in gmsh's window, without a picture")

    run = command(
        "run",
        "run the analyses of a case",
        "Writes DIR/results.h5, DIR/summary.json, DIR/pictures and the files of single analyses. Finished "
        "analyses are not repeated, interrupted ones go on.\n\n" + EXIT_CODES,
    )
    sweep = command(
        "sweep",
        "run a case for all values of its [sweep] table",
        "Writes DIR/sweep.h5 and DIR/sweep.csv. Finished rows are not repeated; failed ones are "
        "tried again.\n\n" + EXIT_CODES,
    )
    for made in (check, mesh, run, sweep):
        made.add_argument("case", metavar="CASE", help="case file")
    for made, folder in ((run, "output/NAME"), (sweep, "output/NAME_sweep")):
        where = f"folder of the results (default: {folder} of the case)"
        made.add_argument("--output", metavar="DIR", help=where)
        left = "give up what another case left in the folder"
        made.add_argument("--replace", action="store_true", help=left)

    sweep.add_argument(
        "--rows",
        metavar="A:B",
        type=_rows,
        help="rows from A to before B alone, numbered from 0, beside processes that compute others into the "
        "same folder; a last call without it finishes what is missing and writes the table",
    )

    plot = command("plot", "draw the pictures of a run or sweep again")
    report = command("report", "write a self-contained HTML report of a run or sweep")
    info = command("info", "say what a results file holds")
    export = command("export", "write results in other formats")
    for made in (plot, report, info, export):
        made.add_argument("results", metavar="RESULTS", help="results.h5, sweep.h5 or the folder of a run")
    plot.add_argument("--output", metavar="DIR", help="folder (default: pictures/ beside the results)")
    again = "also a GIF of the first crack over each history and steady state, which are computed again"
    plot.add_argument("--animation", action="store_true", help=again)
    report.add_argument("--output", metavar="HTML", help="file (default: report.html beside the results)")
    info.add_argument("--case", action="store_true", help="print the case that the results were made from")
    export.add_argument("--csv", action="store_true", help="tables")
    export.add_argument("--vtu", action="store_true", help="modes and static displacements for ParaView")
    export.add_argument("--output", metavar="DIR", help="folder (default: export/ beside the results)")

    doctor = command("doctor", "say versions and what is missing, with remedies")
    for made in (check, run, sweep, info, doctor):
        made.add_argument("--json", action="store_true", help="answer in JSON on standard output")
    command(
        "completion",
        "print what completes these words in bash and zsh",
        'A line of ~/.bashrc or ~/.zshrc:  eval "$(sbfem completion)"',
    )
    return parser


def _rows(text: str) -> tuple[int, int]:
    """Numbers of the first row and behind the last; either may be left out."""
    found = re.fullmatch(r"(\d{0,9}):(\d{0,9})", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r} must be A:B, two numbers of rows from 0, such as 0:25")
    return int(found[1] or 0), int(found[2] or MOST)


def split(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Words of `sbfem` and words of PETSc."""
    at = arguments.index("--") if "--" in arguments else len(arguments)
    return arguments[:at], arguments[at + 1 :]


def completion(parser: argparse.ArgumentParser) -> str:
    """What a shell evaluates to complete the commands of a parser, their options and the kinds of cases."""
    (commands,) = (a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    options = {
        name: " ".join(text for action in made._actions for text in action.option_strings if text[1] == "-")
        for name, made in commands.items()
    }
    text = (resources.files(__package__) / "completion.sh").read_text()
    return text.format(
        commands=" ".join([*commands, "--help", "--version"]),
        options="\n".join(f'            {name}) words="{found}" ;;' for name, found in options.items()),
        kinds=" ".join(KINDS),
    )
