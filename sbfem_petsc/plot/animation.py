"""A crack that breathes: its deformed region over a motion as an animated picture."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes

from meshing.whole_file import destination, replaced

from ..checks import numbers_of
from ..continuation.orbit import Orbit
from ..errors import SolveError
from ..motion.history import Motion, model_with_fields
from ..petsc import MPI
from ..ranks.parallel import collective, on_root, ranks_of
from ..system.fields.outlines import gather_outline, gather_region
from ..system.model import Model
from .drawing import BLUE, VERMILION, Scale, Sheet, crack_title, curves
from .picture import number, picture, require_crack, whole
from .views import Solid, Window, magnification_of, plain

DOTS = 100  # per inch


@picture(frames=whole(2, 1000), seconds=number("s", least=0.1, most=600.0))
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
    comm = ranks_of(model) or MPI.COMM_SELF
    with collective(comm):
        require_crack("animate_crack", crack, len(model.cracks) if isinstance(model, Model) else 1)
        if not isinstance(model, Model) and not model.elements:
            raise ValueError("animate_crack: the body has no elements to draw; give elements= with its nodes")
        instants = _instants(motion, between, frames)
        writer = _writer(path, len(instants) / seconds)
    fields = [motion.field(float(motion.time[instant])) for instant in instants]
    film = _film(motion, model, fields, crack, colour)
    return on_root(comm, lambda: film.write(path, writer, instants, magnification))


def _film(motion: Motion, model: Any, fields: list[Any], crack: int, colour: str) -> _Film:
    """Of a model's crack, or of the contact of a body. Collective."""
    if not isinstance(model, Model):
        contact = motion.reduced.contact if motion.reduced else None
        widest = np.argsort(np.ptp(motion.gap, axis=0))
        states = [field.nodal for field in fields]
        return _Film(motion, Solid(model, contact), states, [], widest, "contact")
    facts = model.cracks[crack]
    half = 1.1 * facts.length
    regions = [gather_region(model, field, np.array(facts.tip), half) for field in fields]
    rows = np.flatnonzero(model.pairs.crack == crack)
    rows = rows[np.argsort(model.pairs.position[rows], kind="stable")]
    outline, title = gather_outline(model, fields), crack_title(facts)
    return _Film(motion, Window(facts, half, colour), regions, outline, rows, title)


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
    kinds: dict[str, Any] = {".gif": PillowWriter, ".mp4": FFMpegWriter}
    if ending not in kinds:
        raise ValueError(f"animation {os.fspath(path)!r} must end in .gif or .mp4")
    if not kinds[ending].isAvailable():
        raise SolveError(
            f"animation {os.fspath(path)!r} needs the program ffmpeg, which is not on PATH; install it, or "
            "write a .gif"
        )
    return kinds[ending](fps=rate)


def _said(output: bytes | str | None) -> str:
    """The last line of what a program has written, in brackets."""
    text = output.decode(errors="replace") if isinstance(output, bytes) else output or ""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return f" ({lines[-1][:200]})" if lines else ""


@dataclass(frozen=True, eq=False)
class _Film:
    """What an animation shows: states of a motion in a view, with an outline; the rows of its contact, the
    mouth's last.
    """

    motion: Motion
    view: Window | Solid
    states: list[Any]
    outline: Any
    rows: np.ndarray
    title: str

    def write(
        self, path: str, writer: AbstractMovieWriter, instants: np.ndarray, magnification: float | None
    ) -> str:
        """Draw and write the states, which are those of some instants, on the left of one figure, the gap and
        the force over time on its right.
        """
        motion, view, sheet = self.motion, self.view, Sheet("animate_crack", None)
        clock = Scale.of("time", "s", motion.time)
        layout = [["crack", "gap"], ["crack", "resultant"]]
        axes, *panels = sheet.panels(layout, 3.3, width_ratios=(1.35, 1.0))
        marks = self._beside(panels, clock)
        view.frame(axes)
        sheet.finished(axes, "")
        factor, colours = magnification or magnification_of(view, self.states), view.colours(self.states)
        closed = (motion.contact_force[:, self.rows] > 0.0).sum(axis=1)

        def draw(number: int) -> list[Any]:
            instant = instants[number]
            at = clock(motion.time[instant])
            for mark, values in marks:
                mark.set_data([at], [values[instant]])
            axes.set_title(
                f"{self.title}, {view.magnified} × {plain(factor)}\n{at:.4g} {clock.unit}, "
                f"{closed[instant]} of {len(self.rows)} pairs closed"
            )
            return view.paint(axes, self.states[number], self.outline, number, factor=factor, colours=colours)

        with replaced(path, "animation") as temporary:
            try:
                with writer.saving(sheet.figure, temporary, DOTS):
                    for number in range(len(instants)):
                        painted = draw(number)
                        if number == 0:  # the layout of the first is that of all
                            colours.bar(painted[0], axes)
                            sheet.figure.draw_without_rendering()
                            sheet.figure.set_layout_engine(None)  # which would draw every state twice
                        writer.grab_frame()
                        for artist in painted:
                            artist.remove()
            except subprocess.CalledProcessError as error:
                raise SolveError(
                    f"animation {path!r}: the program ffmpeg ended with code {error.returncode}"
                    f"{_said(error.stderr)}; write a .gif, or mend its installation"
                ) from None
        return os.fspath(path)

    def _beside(self, panels: list[Axes], clock: Scale) -> list[tuple[Any, np.ndarray]]:
        """Draw gap and contact resultant over time; the mark that is to move over each, and its heights."""
        time, marks = self.motion.time, []
        gap = self.motion.gap[:, self.rows[-1]] if len(self.rows) else np.zeros(len(time))
        drawn = ((self.view.gap, "m", gap), ("contact resultant", "N", self.motion.contact_resultant))
        for axes, (words, unit, values), colour in zip(panels, drawn, (BLUE, VERMILION)):
            up = Scale.of(words, unit, values)
            curves(axes, {"": (time, values)}, clock, up, color=colour, linewidth=1.0)
            axes.set_xlim(clock(time[[0, -1]]))
            axes.grid()
            (mark,) = axes.plot([], [], "o", color="black", markersize=4, clip_on=False, zorder=5)
            marks.append((mark, up(values)))
        panels[0].set_xlabel("")
        panels[0].figure.align_ylabels()
        return marks
