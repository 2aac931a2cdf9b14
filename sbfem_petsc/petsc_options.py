"""PETSc's options on the command line of any program: those that begin with a prefix of ours."""

from __future__ import annotations

import contextlib
import difflib
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from typing import Any

from meshing.warnings import OptionWarning

PREFIXES = {
    "modal_": "natural frequencies: -modal_eps_... (SLEPc's eigensolver), -modal_st_ksp_..., "
    "-modal_st_pc_... (its linear solves)",
    "static_": "static displacement, contact, static part of a reduction: -static_ksp_..., -static_pc_...",
    "contact_dual": "contact forces by iteration, without their flexibility: -contact_dual, "
    "-contact_dual_ksp_...",
    "newmark_": "steps of the unreduced model: -newmark_ksp_..., -newmark_pc_...",
    "shooting_": "periodic motions: -shooting_snes_... (Newton's method), -shooting_ksp_..., "
    "-shooting_pc_... (its linear solves)",
    "torus_": "motions of two tones: -torus_ksp_..., -torus_pc_... (linear solves of Newton's method)",
    "floquet_": "Floquet multipliers: -floquet_eps_...",
}
# PETSc's own options for a whole run that no program of its own is likely to have.
WHOLE_RUN = (
    "log_view",
    "options_left",
    "options_view",
    "options_file",
    "malloc_",
    "memory_view",
    "citations",
)
# Share of equal letters from which a prefix is taken for a misspelt one of ours; -start_in_debugger of PETSc
# has .77 of them with static_.
ALIKE = 0.78


def start() -> None:
    """Start PETSc with the options in `sys.argv` that are meant for it, and those in PETSC_OPTIONS, unless
    the program has started it itself.

    Each rank starts it for itself: a rank that has left, or never uses it, is not waited for, at the start
    as at the end. Only where an option asks for what is of all ranks, such as -log_view, they start together.
    An option that no solve has asked for is named by PETSc at the end of the program.

    Warns
    -----
    OptionWarning
        If the prefix of an option is nearly one of ours.
    """
    if "petsc4py.PETSc" in sys.modules:
        _complete(meant(sys.argv[1:]))
        return
    from mpi4py import MPI

    world, words = MPI.COMM_WORLD, meant(sys.argv[1:])
    everything = [*words, *meant(os.environ.get("PETSC_OPTIONS", "").split())]
    together = world.size == 1 or any(
        word.startswith(tuple("-" + name for name in WHOLE_RUN)) for word in everything
    )
    told = any(word.startswith("-options_left") for word in everything)
    left = ["-options_left"] if everything and not told and (together or world.rank == 0) else []
    initialise([*sys.argv[:1], *words, *left], comm=world if together else MPI.COMM_SELF)
    from petsc4py import PETSc

    PETSc.Sys.setDefaultComm(world)  # as a program that goes on with PETSc itself knows it


def initialise(words: list[str], **options: Any) -> None:
    """`petsc4py.init` with these words and those in the environment variable PETSC_OPTIONS alone: a file
    .petscrc in the working directory, whosever it is, could have code run and files written.

    A closed pipe, as of `| head`, is afterwards again what it was for Python: an error of the write, where
    PETSc would end the program with a dump.
    """
    import petsc4py

    former = signal.getsignal(signal.SIGPIPE)
    # the first word is the program's name; that of `python -c` would pass for an option
    named = [sys.executable, *words[1:]] if words[:1] == ["-c"] else words
    try:
        petsc4py.init([*(named[:1] or [sys.executable]), "-skip_petscrc", *named[1:]], **options)
    except ValueError as error:  # of a library that was compiled for another NumPy
        raise ImportError(str(error), name="petsc4py") from error
    with contextlib.suppress(ValueError):  # of a thread other than the main one
        signal.signal(signal.SIGPIPE, former)


def meant(words: list[str]) -> list[str]:
    """The words of a command line that are for PETSc: options with one dash and one of our prefixes, with
    their values.
    """
    found: list[str] = []
    for name, value in _options(words):
        if name.startswith((*PREFIXES, *WHOLE_RUN)):
            found += [f"-{name}", *value]
        elif "_" in name:
            prefix = name.split("_")[0] + "_"
            near = difflib.get_close_matches(prefix, PREFIXES, 1, ALIKE)
            if near:
                warnings.warn(
                    f"option -{name} belongs to no solve; is {near[0]!r} meant where it has {prefix!r}?",
                    OptionWarning,
                    stacklevel=2,
                )
    return found


def _options(words: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Names of options with one dash, and the value of each if it has one."""
    for place, word in enumerate(words):
        if is_option(word):
            yield word[1:], [value for value in words[place + 1 : place + 2] if not is_option(value)]


def is_option(word: str) -> bool:
    """Whether a word is an option with one dash and no negative number."""
    if not word.startswith("-") or word.startswith("--") or len(word) < 2:
        return False
    try:
        float(word)
    except ValueError:
        return True
    return False


def _complete(words: list[str]) -> None:
    """Add options to a PETSc that runs already; those that it has are left alone."""
    from petsc4py import PETSc

    options = PETSc.Options()
    known = options.getAll()  # to ask for one by its name would count as its use
    for name, value in _options(words):
        if name not in known:
            options.setValue(name, value[0] if value else None)
