"""Telling a person what is under way: a bar on a terminal, plain lines elsewhere, or nothing."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable
from html import escape
from typing import Any, TextIO

from .checks import progress as check_progress

Progress = Callable[[float], None] | str | None
# Seconds between two lines in a log.
PAUSE = 10.0
# Seconds from which on a notebook tells of a work.
MOMENT = 0.5


class Watch:
    """Tells nothing; what the others build on."""

    def stage(self, text: str) -> None:
        """A new piece of work begins."""

    def fraction(self, done: float) -> None:
        """Share of the piece that is done."""

    def say(self, text: str) -> None:
        """A line that stays."""

    def close(self) -> None:
        """Nothing more is told."""

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class LogLines(Watch):
    """Plain lines, for files and pipes: one a piece of work, and one every ten seconds of a long one."""

    def __init__(self, stream: TextIO, pause: float = PAUSE):
        self.stream, self.pause = stream, pause
        self.text, self.done, self.began = "", None, time.monotonic()  # type: str, float | None, float
        self.last_line = self.began
        self.lock, self.over = threading.Lock(), threading.Event()
        # a thread, because some work tells no fraction
        self.thread = threading.Thread(target=self._beat, daemon=True)
        self.thread.start()

    def stage(self, text: str) -> None:
        with self.lock:
            self.text, self.done, self.began = text, None, time.monotonic()
        self.say(text)

    def fraction(self, done: float) -> None:
        self.done = done

    def say(self, text: str) -> None:
        with self.lock:
            self.last_line = time.monotonic()
            self.stream.write(f"{text}\n")
            self.stream.flush()

    def close(self) -> None:
        self.over.set()
        self.thread.join()

    def _beat(self) -> None:
        while not self.over.wait(min(1.0, self.pause / 4)):
            now = time.monotonic()
            if self.text and now - self.last_line >= self.pause - min(1.0, self.pause / 4):
                share = "" if self.done is None else f" {100 * self.done:.0f} %,"
                self.say(f"{self.text}:{share} {now - self.began:.0f} s")


class Bar(Watch):
    """Rich's progress bar on a terminal."""

    def __init__(self, stream: TextIO):
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        self.progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            console=Console(file=stream, highlight=False),
            transient=True,
        )
        self.task: Any = None
        self.progress.start()

    def stage(self, text: str) -> None:
        if self.task is not None:
            self.progress.remove_task(self.task)
        self.task = self.progress.add_task(text, total=None)

    def fraction(self, done: float) -> None:
        if self.task is not None:
            self.progress.update(self.task, total=1.0, completed=done)

    def say(self, text: str) -> None:
        self.progress.console.print(text, markup=False)

    def close(self) -> None:
        self.progress.stop()


class Cell(Watch):
    """A bar below the cell of a notebook, for work of more than a moment; gone when that is done."""

    def __init__(self) -> None:
        self.text, self.handle, self.began = "", None, time.monotonic()  # type: str, Any, float

    def stage(self, text: str) -> None:
        self.text = text

    def fraction(self, done: float) -> None:
        if time.monotonic() - self.began >= MOMENT:
            self._show(f'{escape(self.text)} <progress value="{done:.3f}"></progress> {100.0 * done:.0f} %')

    def say(self, text: str) -> None:
        sys.stderr.write(f"{text}\n")

    def close(self) -> None:
        if self.handle is not None:
            self._show("")

    def _show(self, text: str) -> None:
        from IPython.display import HTML, display

        if self.handle is None:
            self.handle = display(HTML(text), display_id=True)
        else:
            self.handle.update(HTML(text))


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this program."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def watch_for(comm: Any, quiet: bool = False) -> Watch:
    """A bar on a terminal, lines elsewhere, nothing on other ranks than 0 and where quiet is asked for."""
    if quiet or comm.rank > 0:
        return Watch()
    return (Bar if sys.stderr.isatty() and comm.size == 1 else LogLines)(sys.stderr)


def silent(done: float) -> None:
    """Nobody is told the fraction that is done."""


def refused(error: Exception) -> bool:
    """Whether a caller's own `progress` has raised it, which no attempt in another way mends."""
    return bool(getattr(error, "of_progress", False))


def _marked(progress: Callable[[float], None]) -> Callable[[float], None]:
    """A caller's own, whose errors `refused` knows."""

    def told(done: float) -> None:
        try:
            progress(done)
        except Exception as error:
            error.of_progress = True  # type: ignore[attr-defined]
            raise

    return told


@contextlib.contextmanager
def progress_bar(comm, text: str, progress: Progress = "auto"):
    """A callable of the fraction done, `silent` where nobody is to be told.

    Parameters
    ----------
    comm : Comm
    text : str
        What is under way.
    progress : callable, "auto" or None
        "auto": a bar on standard error, on rank 0 and a terminal only, or below a notebook's cell.

    Raises
    ------
    TypeError, ValueError
        For another value.
    """
    if check_progress(text, progress) != "auto":
        yield _marked(progress) if callable(progress) else silent
        return
    if comm.rank > 0 or not (in_notebook() or sys.stderr.isatty()):
        yield silent
        return
    with Cell() if in_notebook() else Bar(sys.stderr) as bar:
        bar.stage(text)
        yield bar.fraction
