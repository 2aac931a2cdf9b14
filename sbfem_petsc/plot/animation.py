"""A crack that breathes: its deformed region over a motion as an animated picture."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter

from meshing.whole_file import destination, replaced

from ..checks import Bounds, integer, numbers_of, real
from ..continuation.orbit import Orbit
from ..errors import SolveError
from ..motion.history import Motion, model_with_fields
from ..petsc import MPI
from ..ranks.parallel import agreed, collective, on_root, ranks_of
from ..system.model import Model
from .drawing import BLUE, STYLE, VERMILION, Scale, Sheet, crack_title, curves
from .outlines import gather_outline, gather_region
from .picture import CHECKS, require_crack
from .views import Solid, Window, magnification_of, plain

DOTS = 100  # per inch


@agreed()
def animate_crack(
    motion: Motion,
    path: str,
    *,
    crack: int = 0,
    between: Sequence[float] | None = None,
    frames: int = 24,
    seconds: float = 5.0,
    magnification: float | None = None,
    colour: str = "von_mises",
) -> str | None:
    """Write the deformed region of a crack over a motion, beside its gap and contact resultant, as a GIF, or
    as an MP4 where ffmpeg is installed. Collective.

    Displacements are magnified by one factor, which the picture tells, and drawn as in `plot_crack`.

    Parameters
    ----------
    motion : Orbit or History
        Of a model, reduced or not, or of a body with elements, drawn around its contact, beside the gap that
        moves most; a steady state repeats without a seam.
    path : str
        Ends in .gif or .mp4.
    crack : int
        Number of the crack, from 0.
    between : (start, stop), optional
        s. Default: all instants.
    frames : int
        At most; each is an instant of the motion.
    seconds : float
        Time that the animation takes, s.
    magnification : float, optional
        Default: chosen by the largest displacement.
    colour : {"von_mises", "displacement"}
        Of a body the displacement.

    Returns
    -------
    str on rank 0, None elsewhere

    Raises
    ------
    TypeError, ValueError
        If an argument makes no sense or the file cannot be written; on all ranks.
    SolveError
        If the motion keeps no fields, or, for an MP4, if there is no ffmpeg or it fails.
    """
    model = model_with_fields("animate_crack", motion)
    with collective(ranks_of(model) or MPI.COMM_SELF):
        frames = integer("animate_crack", "frames", frames, least=2, most=1000)
        real("animate_crack", "seconds", seconds, "s", within=Bounds(least=0.1, most=600.0))
        for name, value in (("magnification", magnification), ("crack", crack), ("colour", colour)):
            CHECKS[name]("animate_crack", name, value)
        require_crack("animate_crack", crack, len(model.cracks) if isinstance(model, Model) else 1)
        if not isinstance(model, Model) and not model.elements:
            raise ValueError("animate_crack: the body has no elements to draw; give elements= with its nodes")
        instants = _instants(motion, between, frames)
        writer = _writer(path, len(instants) / seconds)
    fields = [motion.field(float(motion.time[instant])) for instant in instants]
    view, states, outline, rows, title = _content(motion, model, fields, crack, colour)

    def work() -> str:
        with rc_context(STYLE):
            film = _Film(view, states, outline, motion, rows)
            film.write(path, writer, instants, title, magnification)
        return os.fspath(path)

    return on_root(model.comm, work) if isinstance(model, Model) else work()


def _content(
    motion: Motion, model: Any, fields: list[Any], crack: int, colour: str
) -> tuple[Window | Solid, list[Any], Any, np.ndarray, str]:
    """What is drawn, its states and outline, contact rows, the mouth's last, and a title. Collective."""
    if not isinstance(model, Model):
        contact = motion.reduced.contact if motion.reduced else None
        widest = np.argsort(np.ptp(motion.gap, axis=0))
        return Solid(model, contact), [field.nodal for field in fields], [], widest, "contact"
    facts = model.cracks[crack]
    half = 1.1 * facts.length
    regions = [gather_region(model, field, np.array(facts.tip), half) for field in fields]
    outline = gather_outline(model, fields, max(2 * model.order, 8))
    rows = np.flatnonzero(model.pairs.crack == crack)
    rows = rows[np.argsort(model.pairs.position[rows], kind="stable")]
    return Window(facts, half, colour), regions, outline, rows, crack_title(facts)


def _instants(motion: Motion, between: Sequence[float] | None, frames: int) -> np.ndarray:
    """Indices of the instants to draw, evenly spaced; of a period the end is left out."""
    time = motion.time
    ends = time[[0, -1]] if between is None else between
    start, stop = numbers_of("animate_crack", "between", ends, 2, "two times, s")
    first, last = (int(np.abs(time - at).argmin()) for at in (start, stop))
    if not time[0] <= start < stop <= time[-1] * (1.0 + 1e-9) or first >= last:
        raise ValueError(
            f"animate_crack: between = ({start:g}, {stop:g}) must be two times from {time[0]:g} to "
            f"{time[-1]:.6g} s, the later one last"
        )
    closed = isinstance(motion, Orbit) and between is None
    end = len(time) if closed else last
    return np.unique(np.linspace(first, end, frames, endpoint=not closed).astype(int))


def _writer(path: Any, rate: float) -> AbstractMovieWriter:
    """Who writes a file of this ending."""
    ending = os.path.splitext(destination(path, "animation"))[1].lower()
    frames_a_second: Any = rate  # any number, though the writers' annotations know whole ones alone
    if ending == ".gif":
        return PillowWriter(fps=frames_a_second)
    if ending != ".mp4":
        raise ValueError(f"animation {os.fspath(path)!r} must end in .gif or .mp4")
    if not FFMpegWriter.isAvailable():
        raise SolveError(
            f"animation {os.fspath(path)!r} needs the program ffmpeg, which is not on PATH; install it, or "
            "write a .gif"
        )
    return FFMpegWriter(fps=frames_a_second)


def _said(output: bytes | str | None) -> str:
    """The last line of what a program has written, in brackets."""
    text = output.decode(errors="replace") if isinstance(output, bytes) else output or ""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return f" ({lines[-1][:200]})" if lines else ""


class _Film:
    """One figure whose states follow one another: the crack on the left, its gap and force on the right;
    `rows` are those of its contact, the mouth's last.
    """

    def __init__(
        self, view: Window | Solid, states: list[Any], outline: Any, motion: Motion, rows: np.ndarray
    ):
        self.view, self.states, self.outline, self.motion, self.rows = view, states, outline, motion, rows
        sheet, time = Sheet("animate_crack", None), motion.time
        layout = [["crack", "gap"], ["crack", "resultant"]]
        self.axes, *panels = sheet.panels(layout, 3.3, width_ratios=(1.35, 1.0))
        self.figure, self.clock, self.marks = sheet.figure, Scale.of("time", "s", time), []
        gap = motion.gap[:, rows[-1]] if len(rows) else np.zeros(len(time))
        drawn = ((view.gap, "m", gap), ("contact resultant", "N", motion.contact_resultant))
        for axes, (words, unit, values), colour in zip(panels, drawn, (BLUE, VERMILION)):
            up = Scale.of(words, unit, values)
            curves(axes, {"": (time, values)}, self.clock, up, color=colour, linewidth=1.0)
            axes.set_xlim(self.clock(time[[0, -1]]))
            axes.grid()
            (mark,) = axes.plot([], [], "o", color="black", markersize=4, clip_on=False, zorder=5)
            self.marks.append((mark, up(values)))
        panels[0].set_xlabel("")
        self.figure.align_ylabels()
        view.frame(self.axes)
        sheet.finished(self.axes, "")

    def write(
        self,
        path: str,
        writer: AbstractMovieWriter,
        instants: np.ndarray,
        title: str,
        magnification: float | None,
    ) -> None:
        """Draw and write the states, which are those of some instants."""
        factor, colours = (
            magnification or magnification_of(self.view, self.states),
            self.view.colours(self.states),
        )
        closed = (self.motion.contact_force[:, self.rows] > 0.0).sum(axis=1)
        with replaced(path, "animation") as temporary:
            try:
                with writer.saving(self.figure, temporary, DOTS):
                    for number, (instant, state) in enumerate(zip(instants, self.states)):
                        painted = self.view.paint(
                            self.axes, state, self.outline, number, factor=factor, colours=colours
                        )
                        at = self.clock(self.motion.time[instant])
                        for mark, values in self.marks:
                            mark.set_data([at], [values[instant]])
                        self.axes.set_title(
                            f"{title}, {self.view.magnified} × {plain(factor)}\n{at:.4g} {self.clock.unit}, "
                            f"{closed[instant]} of {len(self.rows)} pairs closed"
                        )
                        if number == 0:  # the layout of the first is that of all
                            colours.bar(painted[0], self.axes)
                            self.figure.draw_without_rendering()
                            self.figure.set_layout_engine(None)  # which would draw every state twice
                        writer.grab_frame()
                        for artist in painted:
                            artist.remove()
            except subprocess.CalledProcessError as error:
                raise SolveError(
                    f"animation {path!r}: the program ffmpeg ended with code {error.returncode}"
                    f"{_said(error.stderr)}; write a .gif, or mend its installation"
                ) from None
