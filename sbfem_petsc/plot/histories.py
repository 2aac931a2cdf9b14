"""Pictures of time histories and spectra."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator

from ..analysis.load_history import LoadHistory, ReducedLoadHistory
from ..checks import flag, instances, real
from ..continuation.orbit import component
from ..motion.history import Motion
from ..motion.states import Point
from .drawing import BLACK, BROKEN, CYCLE, Scale, Sheet, above, curves, dots, legend, note
from .picture import CHECKS, Comm, a_text, curve, optional, picture, place_name, symbol, table_of, two_numbers


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes of `plot_histories`.

    Attributes
    ----------
    quantity : str
        Label of the ordinate, with the unit after scaling.
    curves : dict of str to (time, values)
        s, and what is drawn; the second and further curves are drawn broken over the first.
    scale : float
        Factor of all values.
    window : (float, float), optional
        Times shown, s; default: all.
    title : str
    zero : bool
        Whether a line marks zero.
    """

    quantity: str
    curves: dict[str, tuple[np.ndarray, np.ndarray]]
    scale: float = 1.0
    window: tuple[float, float] | None = None
    title: str = field(default="", kw_only=True)
    zero: bool = field(default=True, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("quantity", "window", "title"):
            CHECKS[name]("Panel", name, getattr(self, name))
        real("Panel", "scale", self.scale)
        flag("Panel", "zero", self.zero)
        table_of(curve, "curve")("Panel", "curves", self.curves)
        start, stop = self.window or (-np.inf, np.inf)
        for name, (time, _) in self.curves.items():
            if not ((np.asarray(time) >= start) & (np.asarray(time) <= stop)).any():
                raise ValueError(f"Panel: curves[{name!r}] has no instant in window = {self.window!r}")


@picture()
def plot_histories(
    panels: Panel | Sequence[Panel], *, ax: Any = None, comm: Comm = None
) -> list[Axes] | None:
    """Draw time histories below each other. Collective.

    Parameters
    ----------
    panels : Panel or sequence of Panel
        On rank 0 at least.
    ax : axes, sequence of axes, figure or subfigure of Matplotlib, optional
        What is drawn on; in fewer axes than there are panels the first of these. Default: a new figure.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    Axes of the panels on rank 0, None elsewhere; `save_picture` writes them
    """
    several = instances("plot_histories", "panels", panels, Panel, "a Panel or a sequence of them")
    if not several:
        raise ValueError("plot_histories: no panel is given")
    return _draw(ax, several)


@picture(Motion, direction=optional(CHECKS["direction"]))
def plot_history(
    motion: Motion,
    point: Point = "A",
    direction: str | None = None,
    *,
    window: tuple[float, float] | None = None,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> list[Axes] | None:
    """Draw what a motion does over time: displacement of a point, and the contact resultant where there is
    contact. Collective.

    Parameters
    ----------
    motion : History or Orbit
        On rank 0 at least; on all ranks for a place (x, y).
    point : str or (x, y)
        Name, or m.
    direction : {"x", "y"}, optional
        Default: both.
    window : (float, float), optional
        Times shown, s; default: all.
    title : str
    ax, comm
        As for `plot_histories`.

    Returns
    -------
    Axes of the panels on rank 0, None elsewhere; `save_picture` writes them
    """
    return _draw(ax, _moved(motion, point, direction, window))


@picture(LoadHistory, ReducedLoadHistory, crack=optional(a_text), direction=optional(CHECKS["direction"]))
def plot_load_history(
    history: LoadHistory | ReducedLoadHistory,
    point: Point = "A",
    direction: str | None = None,
    *,
    crack: str | None = None,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> list[Axes] | None:
    """Draw static states under slowly changing loads: displacement of a point, contact resultant, and the
    stress intensity factors of a crack. Collective.

    Parameters
    ----------
    history : LoadHistory or ReducedLoadHistory
        On rank 0 at least; on all ranks for a place (x, y).
    point, direction
        As for `plot_history`.
    crack : str, optional
        Default: the first crack with a tip element.
    title : str
    ax, comm
        As for `plot_histories`.

    Returns
    -------
    Axes of the panels on rank 0, None elsewhere; `save_picture` writes them
    """
    panels = _moved(history, point, direction)
    if isinstance(history, LoadHistory) and (tips := list(history.states[0].stress_intensity)):
        factors = history.stress_intensity(crack or tips[0])
        both = {name: (history.time, factors[:, k]) for k, name in enumerate(("$K_I$", "$K_{II}$"))}
        up = Scale.of(f"K of {crack or tips[0]}", "Pa", factors, per=" m$^{1/2}$")
        panels.append(Panel(up.label, both, up.factor))
    return _draw(ax, panels)


def _moved(
    motion: Motion | LoadHistory,
    point: Point,
    direction: str | None,
    window: tuple[float, float] | None = None,
) -> list[Panel]:
    """One displacement of a point over time, or both, and the contact resultant where there is contact."""
    states = motion.states if isinstance(motion, Motion) else motion
    u = states.displacement(point)
    axes = direction or ("y" if motion.of_rows else "yx")
    shown = {
        f"${symbol(motion, axis, point)}$": (motion.time, component(u, axis, motion.of_rows)) for axis in axes
    }
    name = "displacement" if direction is None else f"${symbol(motion, direction, point)}$"
    up = Scale.of(f"{name} of {place_name(point)}", "m", *(values for _, values in shown.values()))
    panels = [Panel(up.label, shown, up.factor, window)]
    if (motion.states.contact if isinstance(motion, Motion) else motion.contact_force).shape[1]:
        up = Scale.of("contact resultant", "N", motion.contact_resultant)
        panels.append(Panel(up.label, {"": (motion.time, motion.contact_resultant)}, up.factor, window))
    return panels


def _draw(sheet: Sheet, panels: Sequence[Panel]) -> list[Axes]:
    grid = sheet.panels((len(panels), 1), 1.75 * len(panels) + 0.25)
    for axes, panel in zip(grid, panels):
        ends = [time[k] for time, _ in panel.curves.values() for k in (0, -1)]
        start, stop = panel.window or (min(ends), max(ends))
        clock, drawn = Scale.of("time", "s", start, stop), {}
        for name, (time, values) in panel.curves.items():
            shown = (np.asarray(time) >= start) & (np.asarray(time) <= stop)
            drawn[name] = np.asarray(time)[shown], np.asarray(values)[shown]
        curves(axes, drawn, clock, Scale(panel.scale, panel.quantity), BROKEN, linewidth=0.8)
        if len(drawn) > 1:
            axes.lines[-len(drawn)].set_linewidth(1.5)
            above(axes)
        if panel.zero:
            axes.axhline(0.0, color="#999999", linewidth=0.4, zorder=0.5)
        axes.set_xlim(clock(start), clock(stop))
        axes.margins(y=0.08)
        axes.set_title(panel.title, loc="left")
        axes.yaxis.set_major_locator(MaxNLocator(5))
    return grid


@picture(window=two_numbers)
def plot_spectra(
    spectra: Mapping[str, tuple[np.ndarray, np.ndarray]],
    quantity: str,
    window: tuple[float, float],
    *,
    lines: Mapping[str, float] | None = None,
    decades: float = 6.0,
    harmonics: Mapping[str, Sequence[float]] | None = None,
    ax: Any = None,
    comm: Comm = None,
) -> list[Axes] | None:
    """Draw amplitude spectra below each other on common axes, with named lines marked. Collective.

    Parameters
    ----------
    spectra : dict of str to (frequency, amplitude)
        Hz, and complex or real amplitudes.
    quantity : str
        Label of the ordinate.
    window : (float, float)
        Frequencies shown, Hz.
    lines : dict of str to float, optional
        Names and frequencies (Hz) marked in every panel.
    decades : float
        Below the largest amplitude shown.
    harmonics : dict of str to sequence of float, optional
        Families of frequencies (Hz) marked by triangles where there is a peak, named in a legend.
    ax, comm
        As for `plot_histories`.

    Returns
    -------
    Axes of the panels on rank 0, None elsewhere; `save_picture` writes them
    """
    spectra = table_of(curve, "spectrum")("plot_spectra", "spectra", spectra)
    low, high = window
    lines, harmonics = lines or {}, harmonics or {}
    height, along = 1.9 * len(spectra) + 0.45, Scale.of("frequency", "Hz", high)
    grid, top = ax.panels((len(spectra), 1), height, sharex=True, sharey=True), 0.0
    for colour, axes, (name, (frequency, amplitude)) in zip(cycle(CYCLE), grid, spectra.items()):
        seen = (frequency >= low) & (frequency <= high) & (frequency > 0.0)
        if not seen.any():
            raise ValueError(f"plot_spectra: spectra[{name!r}] has no frequency in window = {window!r}")
        places, level = frequency[seen], np.abs(amplitude[seen])
        top = max(top, float(level.max()))
        for place in lines.values():
            axes.axvline(along(place), color="#BBBBBB", linewidth=0.6, linestyle=(0, (3, 2)), zorder=0.5)
        axes.plot(along(places), np.maximum(level, np.finfo(float).tiny), color=colour, linewidth=0.7)
        for shade, (family, tones) in zip(cycle((BLACK, *CYCLE[-2::-1])), harmonics.items()):
            peaks = _peaks(places, level, [f for f in tones if low <= f <= high])
            dots(axes, (along(places[peaks]), level[peaks]), "v", 3.5, shade, label=family, markeredgewidth=0)
        axes.set(yscale="log", xlim=(along(low), along(high)), ylabel=quantity, xlabel=along.label)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
        axes.text(0.995, 0.95, name, transform=axes.transAxes, fontsize=8, ha="right", va="top", bbox=box)
    legend(grid[-1], loc="lower left")
    for axes in grid:
        axes.set_ylim(top * 10.0**-decades, 4.0 * top)
        axes.yaxis.set_major_locator(LogLocator(numticks=6))
    for name, place in lines.items():
        if low <= place <= high:
            note(grid[0], name, (along(place), 1.0), xycoords=grid[0].get_xaxis_transform())
    return grid


def _peaks(frequency: np.ndarray, level: np.ndarray, places: Sequence[float]) -> list[int]:
    """Indices next to some places where the level is well above that around them."""
    nearest = [int(np.abs(frequency - place).argmin()) for place in places]
    return [k for k in nearest if level[k] > 3.0 * np.median(level[max(k - 5, 0) : k + 6])]
