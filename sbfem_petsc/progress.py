"""A progress bar on rank 0 where a person watches."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable

from .checks import progress as check_progress


@contextlib.contextmanager
def progress_bar(comm, text: str, progress: Callable[[float], None] | str | None = "auto"):
    """A callable of the fraction done, or None where none is to be told.

    Parameters
    ----------
    comm : Comm
    text : str
        What is under way.
    progress : callable, "auto" or None
        "auto": a bar on standard error, on rank 0 and a terminal only.

    Raises
    ------
    TypeError, ValueError
        For another value.
    """
    if check_progress(text, progress) != "auto":
        yield progress
        return
    if comm.rank > 0 or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda done: bar.update(task, completed=done)
