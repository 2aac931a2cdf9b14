"""Error types with plain sentences."""

from __future__ import annotations

import contextvars
import warnings
from collections.abc import Iterable

from meshing.warnings import MeshWarning, OptionWarning, caller_level

from .checks import shown

# The analysis that a user has called, while it is under way.
ANALYSIS: contextvars.ContextVar[str] = contextvars.ContextVar("analysis", default="")
# What it, or another function that all ranks call together, has told of options; None beside any.
TOLD: contextvars.ContextVar[set[str] | None] = contextvars.ContextVar("told", default=None)


class UnknownName(KeyError):
    """A named point, edge set or material does not exist; the text is a sentence that lists those that do."""

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class SolveError(RuntimeError):
    """A linear, nonlinear or eigenvalue solve failed; the message names the solve, the reason and the
    remedy.
    """


class SolverFailure(RuntimeError):
    """A solver cannot work as it is asked to, which no other first guess changes. It is no `SolveError`: what
    tries one guess after the other, or tells of a point that no motion is found, ends with it.
    """


class OutOfMemory(SolverFailure):
    """There is not enough memory; other ranks may know nothing of it."""


class PetscFailure(SolverFailure):
    """PETSc refuses an option of the command line, or cannot do what it is asked for."""


def called(own: str = "steady state") -> str:
    """The analysis that a user has called, for sentences of what several of them do; `own` beside any."""
    return ANALYSIS.get() or own


def on_all_ranks(error: Exception) -> Exception:
    """Mark an error that every rank raises alike, so that it is printed once."""
    error.on_all_ranks = True  # type: ignore[attr-defined]
    return error


def wrong_input(sentence: str, kind: type[Exception] = ValueError) -> Exception:
    """A ValueError, or a TypeError, that every rank raises alike."""
    return on_all_ranks(kind(sentence))


def failed_solve(sentence: str) -> Exception:
    """A SolveError that every rank raises alike."""
    return on_all_ranks(SolveError(sentence))


def warn(sentence: str, kind: type[Warning]) -> None:
    """Warn the line outside of this package that has led here."""
    warnings.warn(sentence, kind, stacklevel=caller_level())


def warn_of_mesh(sentence: str) -> None:
    """Warn of a mesh, or of what makes a body doubtful, likewise."""
    warn(sentence, MeshWarning)


def warn_of_options(options: str, sentence: str) -> None:
    """Warn of what options, such as "-newmark_ksp_...", do to a result: once in a call."""
    told = TOLD.get()
    if told is None or options not in told:
        warn(f"{called('PETSc')}: the options {options} {sentence}", OptionWarning)
    if told is not None:
        told.add(options)


def at_point(table: dict, point: str, what: str = "point"):
    """The entry of a named point, or of something else that has a name; an error that lists those that
    exist.
    """
    if not isinstance(point, str) or point not in table:
        raise UnknownName(f"{what} {shown(point)} does not exist; the model has {listed(table)}")
    return table[point]


def listed(names: Iterable) -> str:
    """Names for a sentence: "'a', 'b'", or "none"."""
    return ", ".join(map(repr, names)) or "none"
