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
from ..record.units import force_unit, length_unit, time_unit
from ..system.model import Model
from .crack import Window, plain
from .drawing import BLUE, STYLE, VERMILION, Sheet, crack_title
from .outlines import Piece, gather_outline, gather_region
from .picture import CHECKS, require_crack
from .solids import Solid

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
    window, regions, outline, rows, title = _content(motion, model, fields, crack, colour)

    def work() -> str:
        # gap of the last row, the mouth's, and resultant
        curves = {"gap": motion.gap[:, rows[-1]] if len(rows) else np.zeros(len(motion.time))}
        curves["resultant"] = motion.contact_resultant
        closed = (motion.contact_force[:, rows] > 0.0).sum(axis=1)
        with rc_context(STYLE):
            film = _Film(window, regions, outline, motion.time, curves, magnification)
            told = [f"{count} of {len(rows)} pairs closed" for count in closed]
            film.write(path, writer, instants, title, told)
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
    """One figure whose states follow one another: the crack on the left, its gap and force on the right."""

    def __init__(
        self,
        window: Window | Solid,
        regions: list[Any],
        outline: list[Piece] | None,
        time: np.ndarray,
        curves: dict[str, np.ndarray],
        magnification: float | None,
    ):
        states = [region for region in regions if region is not None]
        assert outline is not None  # on rank 0
        self.window, self.regions, self.outline, self.time = window, states, outline, time
        self.factor = magnification or window.magnification(states)
        self.colours = window.colours(states)
        sheet = Sheet("animate_crack", None)
        layout = [["crack", "gap"], ["crack", "resultant"]]
        self.axes, *panels = sheet.panels(layout, 3.3, width_ratios=(1.35, 1.0))
        self.drawing = sheet.figure
        self.unit_of_time, name = time_unit(float(time[-1]))
        self.curves, self.marks = [], []
        units = {"gap": length_unit, "resultant": force_unit}
        labels = {"gap": window.gap, "resultant": "contact resultant"}
        for row, (key, values) in enumerate(curves.items()):
            scale, unit = units[key](float(np.abs(values).max()))
            axes = panels[row]
            axes.plot(time * self.unit_of_time, values * scale, color=(BLUE, VERMILION)[row], linewidth=1.0)
            axes.set_ylabel(f"{labels[key]} ({unit})")
            axes.set_xlim(time[0] * self.unit_of_time, time[-1] * self.unit_of_time)
            axes.grid()
            self.curves.append(values * scale)
            self.marks += axes.plot([], [], "o", color="black", markersize=4, clip_on=False, zorder=5)
        axes.set_xlabel(f"time ({name})")
        self.drawing.align_ylabels()
        window.frame(self.axes)
        sheet.finished(self.axes, "")
        self.unit_name = name

    def write(
        self, path: str, writer: AbstractMovieWriter, instants: np.ndarray, title: str, told: Sequence[str]
    ) -> None:
        """Draw and write the states of some instants; `told` is said of each instant of the motion."""
        title = f"{title}, {self.window.magnified} × {plain(self.factor)}"
        with replaced(path, "animation") as temporary:
            try:
                with writer.saving(self.drawing, temporary, DOTS):
                    self._draw(writer, instants, title, told)
            except subprocess.CalledProcessError as error:
                raise SolveError(
                    f"animation {path!r}: the program ffmpeg ended with code {error.returncode}"
                    f"{_said(error.stderr)}; write a .gif, or mend its installation"
                ) from None

    def _draw(
        self, writer: AbstractMovieWriter, instants: np.ndarray, title: str, told: Sequence[str]
    ) -> None:
        for number, instant in enumerate(instants):
            painted = self._state(number, int(instant))
            at = f"{self.time[instant] * self.unit_of_time:.4g} {self.unit_name}"
            self.axes.set_title(f"{title}\n{at}, {told[instant]}")
            if number == 0:  # the layout of the first is that of all
                self.colours.bar(painted[0], self.axes)
                self.drawing.draw_without_rendering()
                self.drawing.set_layout_engine(None)  # which would draw every state twice
            writer.grab_frame()
            for artist in painted:
                artist.remove()

    def _state(self, number: int, instant: int) -> list[Any]:
        painted = self.window.paint(
            self.axes, self.regions[number], self.outline, number, factor=self.factor, colours=self.colours
        )
        at = self.time[instant] * self.unit_of_time
        for mark, values in zip(self.marks, self.curves):
            mark.set_data([at], [values[instant]])
        return painted
