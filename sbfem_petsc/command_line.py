"""A program's own options beside PETSc's on one command line."""

from __future__ import annotations

import argparse
import os
import sys
from typing import Any, NoReturn, TextIO

from .petsc_options import PREFIXES, initialise, is_option

# PETSc's own options for a whole run
GENERAL = (
    "log_",
    "info",
    "malloc",
    "on_error",
    "options_",
    "start_in_debugger",
    "citations",
    "memory",
    "mat_",
    "vec_",
    "fp_trap",
    "use_gpu",
    "version",
    "help",
)


class RanksParser(argparse.ArgumentParser):
    """`argparse` that speaks on rank 0 alone and never abbreviates."""

    def __init__(self, **options: Any):
        options.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(allow_abbrev=False, **options)

    def error(self, message: str) -> NoReturn:
        """Print usage and message, and exit with code 2."""
        self._print_message(f"{self.format_usage()}{self.prog}: error: {message}\n", sys.stderr)
        raise SystemExit(2)

    def _print_message(self, message: str, file: Any = None) -> None:
        if message and _rank() == 0:
            super()._print_message(message, file)


class Parser(RanksParser):
    """`argparse` for a program whose unknown options belong to PETSc.

    Only options with two dashes are the program's; everything else is handed to PETSc before it starts.
    """

    def __init__(self, description: str):
        prefixes = "\n".join(f"  -{name:9s} {text}" for name, text in PREFIXES.items())
        epilog = (
            f"PETSc's and SLEPc's options have one dash and a prefix that names the solve:\n{prefixes}\nAdd "
            "-help to list those of the solves that ran, -log_view for timings, -modal_eps_view for an "
            "eigensolver's settings."
        )
        super().__init__(description=description, epilog=epilog, add_help=False)
        # no short options: argparse would read -nep_tol as -n
        self.add_argument("--help", action="help", help="show this help and exit")

    def add_output(self, name: str, what: str, without: str) -> None:
        """Options --output (default output/NAME) for the folder of `what`, and --no-pictures to `without`."""
        self.add_argument(
            "--output", default=f"output/{name}", help=f"folder for {what} (default output/{name})"
        )
        self.add_argument("--no-pictures", action="store_true", help=without)

    def add_numbers(self, **options: tuple[Any, str]) -> None:
        """Options of one number, or of several: name=(default, text).

        Its type is the default's, a list's that of its members; `int` or `float` in the place of a default
        where there is none. The text of the help names the default unless it does so itself.
        """
        for name, (default, text) in options.items():
            several = isinstance(default, list)
            kind = default if isinstance(default, type) else type(default[0] if several else default)
            if not isinstance(default, type) and "(default" not in text:
                values = " ".join(f"{value:g}" for value in (default if several else [default]))
                text += f" (default {values.replace('e-0', 'e-')})"
            self.add_argument(
                f"--{name.replace('_', '-')}",
                type=kind,
                nargs="+" if several else None,
                default=None if default is kind else default,
                help=text.replace("%", "%%"),
            )

    def add_tip_mesh(self) -> None:
        """Options --order, --grading and --tip-size of a mesh that is refined towards a crack's tip."""
        self.add_numbers(
            order=(6, "polynomial order of the edges"),
            grading=(1.8, "ratio of successive rings around the tip"),
            tip_size=(5e-6, "half-size of the S-element at the tip, m"),
        )

    def parse(self, arguments: list[str] | None = None) -> argparse.Namespace:
        """The program's own options; starts PETSc with the rest.

        An argument that is neither, or has a prefix that no solve uses, ends the program with exit code 2 on
        every rank.
        """
        arguments = sys.argv[1:] if arguments is None else list(arguments)
        own, rest = self.parse_known_args(arguments)
        for word in rest:
            if word.startswith("--"):
                self.error(f"unknown option {word}; --help lists the options of this program")
        wrong = wrong_option(rest)
        if wrong is not None:
            self.error(wrong)
        start_petsc(rest)
        return own


def wrong_option(words: list[str]) -> str | None:
    """What is wrong with words meant for PETSc: a sentence, or None."""
    known = (*PREFIXES, *GENERAL)
    for position, word in enumerate(words):
        if is_option(word) and not word[1:].startswith(known):
            return (
                f"option {word} belongs to no solve of this program; PETSc's options start with "
                f"{', '.join('-' + p for p in PREFIXES)} or are general ones such as -log_view"
            )
        if not word.startswith("-") and (position == 0 or not words[position - 1].startswith("-")):
            return f"argument {word!r} belongs to no option"
    return None


def start_petsc(words: list[str]) -> None:
    """Start PETSc with its options; it names, at the end, the misspelt ones, which no solve has asked for."""
    told = [] if any(w.startswith("-options_left") for w in words) or not words else ["-options_left"]
    initialise([sys.argv[0], *words, *told])


def console(comm):
    """A rich console that writes on rank 0 alone.

    At least 120 columns wide, so that no table loses digits to "..."; plain text under mpiexec, which may
    give rank 0 a terminal of its own.
    """
    import shutil

    from rich.console import Console

    plain = comm.size > 1 or not sys.stdout.isatty()
    return Console(
        quiet=comm.rank > 0,
        highlight=False,
        force_terminal=False if plain else None,
        width=max(120, shutil.get_terminal_size((120, 24)).columns),
    )


def begin(output: str):
    """Communicator, console and checked output folder of a program that has read its options; prints the
    versions.
    """
    from mpi4py import MPI

    from .petsc import version_line
    from .writing import check_output_folder

    comm = MPI.COMM_WORLD
    out = console(comm)
    folder = check_output_folder(output, comm)
    ranks = f"{comm.size} rank{'s' if comm.size > 1 else ''}"
    version = sys.modules[__name__.split(".")[0]].__version__
    out.print(f"sbfem-petsc {version}, {version_line()}, {ranks}")
    return comm, out, folder


def run(main) -> None:
    """Call `main()` as a program: an error of the user's input or of a solve is one sentence on stderr and
    exit code 1.

    On several ranks an error that all of them raise is printed once; one that a single rank raises stops the
    others too.
    """
    from mpi4py import MPI

    try:
        main()
        sys.stdout.flush()
    except BrokenPipeError:  # nobody reads on, as of `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if MPI.COMM_WORLD.size > 1:
            MPI.COMM_WORLD.Abort(0)
        raise SystemExit(0) from None
    except (ValueError, TypeError, KeyError, RuntimeError, OSError) as error:
        raise SystemExit(ended(f"error: {error}", 1, error)) from None


def ended(text: str, code: int, error: Exception | None = None) -> int:
    """Tell how a program ends, once if all ranks end so, and give its exit code; an error that one rank alone
    meets ends the others too.
    """
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    everywhere = comm.size == 1 or getattr(error, "on_all_ranks", False)
    if comm.rank == 0 or not everywhere:
        tell(text, sys.stderr)
    if not everywhere:
        comm.Abort(code)
    return code


def tell(text: str, stream: TextIO | None = None, end: str = "\n") -> None:
    """Write lines, by default to the output; control characters but tabs and ends of lines are escaped, so
    that texts of files never move a terminal's cursor or change its state.
    """
    shown = "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)
    print(shown, end=end, file=sys.stdout if stream is None else stream, flush=True)


def _rank() -> int:
    from mpi4py import MPI

    return MPI.COMM_WORLD.rank
