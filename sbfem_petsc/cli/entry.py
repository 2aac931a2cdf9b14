"""Entry of the command `sbfem`: reads the command line, starts PETSc, turns errors into exit codes."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from types import FrameType
from typing import Any, NoReturn

from ..command_line import ended, start_petsc, tell, wrong_option
from ..installation import remedy
from ..ranks import abort
from .parser import completion, make_parser, split

# numba would colour its messages by colorama, which writes a code behind the answer of a command
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

FAILED, WRONG_INPUT, INTERRUPTED, TERMINATED = 1, 2, 130, 143
# Seconds after which a signal that was lost is sent again.
AGAIN = 0.05


class _Terminated(BaseException):
    """The process was asked to end."""


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a command and exit with its code."""
    try:
        try:
            sys.exit(_run(sys.argv[1:] if arguments is None else list(arguments)))
        except ImportError as error:
            sys.exit(_not_installed(error))
    except SystemExit as error:  # on several ranks the others may still be at work
        abort.leaves(error)
        raise


def _run(arguments: list[str]) -> int:
    own, rest = split(arguments)
    parser = make_parser()
    options = parser.parse_args(own)
    wrong = wrong_option(rest)
    if wrong is not None:
        parser.error(wrong)
    if options.command == "completion":  # a shell waits for it: PETSc is not started
        tell(completion(parser), sys.stdout)
        return 0
    # what is missing then is what this command is to tell
    with contextlib.suppress(ImportError) if options.command == "doctor" else contextlib.nullcontext():
        start_petsc(rest)
    signal.signal(signal.SIGTERM, _terminate)
    with _no_signal_lost():
        return _guarded(options)


@contextlib.contextmanager
def _no_signal_lost() -> Iterator[None]:
    """Python drops what the handler of a signal raises while it clears a weak reference, as it does whenever
    rows are written to a file: the signal is sent again.
    """
    former = sys.unraisablehook

    def send_again(dropped: Any) -> None:
        number = {KeyboardInterrupt: signal.SIGINT, _Terminated: signal.SIGTERM}.get(dropped.exc_type)
        if number is None:
            former(dropped)
        else:
            threading.Timer(AGAIN, os.kill, (os.getpid(), number)).start()

    sys.unraisablehook = send_again
    try:
        yield
    finally:
        sys.unraisablehook = former


def _not_installed(error: ImportError) -> int:
    """Tell of a package that is missing or broken; the ranks of other machines may have it."""
    text = f"error: {error}"
    if error.name is not None:
        text = f"error: {error.name.split('.')[0]} cannot be imported ({error}); {remedy(error)}"
    try:
        return ended(text, FAILED)
    except ImportError:
        tell(text, sys.stderr)
        return FAILED


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    raise _Terminated


def _guarded(options) -> int:
    """Exit code of a command; an error that one rank alone meets ends all ranks."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD

    def warn(message: Any, *_: Any, **__: Any) -> None:
        if comm.rank == 0:
            tell(f"warning: {message}", sys.stderr)

    try:
        from . import commands  # takes a second, in which a signal may come

        with warnings.catch_warnings():
            warnings.showwarning = warn
            return int(getattr(commands, options.command)(options, comm) or 0)
    except KeyboardInterrupt:
        return ended("interrupted; the same command goes on where it was", INTERRUPTED)
    except _Terminated:
        return ended("ended by a signal; the same command goes on where it was", TERMINATED)
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except MemoryError as error:
        words = f"there is not enough memory ({error}); use a coarser mesh, or more ranks on more machines"
        return ended(f"error: {words}", FAILED)
    except (ValueError, TypeError, KeyError, OSError, RuntimeError) as error:
        return ended(f"error: {error}", FAILED if isinstance(error, RuntimeError) else WRONG_INPUT, error)
