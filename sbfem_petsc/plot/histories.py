"""Pictures of time histories and spectra."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator

from ..analysis.load_history import LoadHistory
from ..checks import flag, instance, real, shown, text
from ..motion.history import Motion
from ..parallel import agreed, on_root
from ..petsc import MPI
from .arguments import check, curve
from .drawing import BLACK, CYCLE, figure, style
from .units import force_unit, frequency_unit, length_unit, stress_unit, time_unit

# Above this many samples in a panel, the least and the greatest of each column of pixels are drawn.
COLUMNS = 2000


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
        check("Panel", quantity=self.quantity, window=self.window, title=self.title)
        real("Panel", "scale", self.scale)
        flag("Panel", "zero", self.zero)
        if not isinstance(self.curves, Mapping) or not self.curves:
            raise TypeError(
                f"Panel: curves = {shown(self.curves)} must be a dict of at least one curve by name"
            )
        for name, values in self.curves.items():
            curve("Panel", f"curves[{name!r}]", values)
            start, stop = self.window or (-np.inf, np.inf)
            time = np.asarray(values[0])
            if not ((time >= start) & (time <= stop)).any():
                raise ValueError(f"Panel: curves[{name!r}] has no instant in window = {self.window!r}")


@agreed("panels")
def plot_histories(panels: Sequence[Panel], *, comm: MPI.Comm | None = None) -> list[Axes] | None:
    """Draw time histories below each other. Collective.

    Parameters
    ----------
    panels : sequence of Panel
        On rank 0 at least.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    Axes of the panels on rank 0, None elsewhere; `save_picture` writes them
    """
    check("plot_histories", comm=comm)
    if not isinstance(panels, (list, tuple)):
        raise TypeError(f"plot_histories: panels = {panels!r} must be a sequence of Panel")
    for panel in panels:
        instance("plot_histories", "panels", panel, Panel, "of Panels")
    return on_root(MPI.COMM_WORLD if comm is None else comm, lambda: _draw_histories(list(panels)))


@agreed("motion")
def plot_history(
    motion: Motion,
    point: str = "A",
    *,
    window: tuple[float, float] | None = None,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> list[Axes] | None:
    """Draw what a motion does over time: displacement of a point, and the contact resultant where there is
    contact. Collective.

    Parameters
    ----------
    motion : History or Orbit
        On rank 0 at least.
    point : str
    window : (float, float), optional
        Times shown, s; default: all.
    title : str
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    Axes of the panels on rank 0, None elsewhere; `save_picture` writes them
    """

    check("plot_history", point=point, window=window, title=title, comm=comm)

    def draw() -> list[Axes]:
        instance("plot_history", "motion", motion, Motion, "a History or an Orbit")
        u, resultant = motion.displacement(point), motion.contact_resultant
        scale, unit = length_unit(float(np.abs(u).max()))
        curves = {f"$u_{axis}$": (motion.time, u[:, k]) for k, axis in ((1, "y"), (0, "x"))}
        panels = [Panel(f"displacement of {point} ({unit})", curves, scale, window, title=title)]
        if motion.states.contact.shape[1]:
            scale, unit = force_unit(float(resultant.max(initial=0.0)))
            panels.append(Panel(f"contact resultant ({unit})", {"": (motion.time, resultant)}, scale, window))
        return _draw_histories(panels)

    return on_root(MPI.COMM_WORLD if comm is None else comm, draw)


@agreed("history")
def plot_load_history(
    history: LoadHistory,
    point: str = "A",
    *,
    crack: str | None = None,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> list[Axes] | None:
    """Draw static states under slowly changing loads: displacement of a point, contact resultant, and the
    stress intensity factors of a crack. Collective.

    Parameters
    ----------
    history : LoadHistory
        On rank 0 at least.
    point : str
    crack : str, optional
        Default: the first crack with a tip element.
    title, comm
        As for `plot_history`.

    Returns
    -------
    Axes of the panels on rank 0, None elsewhere; `save_picture` writes them
    """

    check("plot_load_history", point=point, title=title, comm=comm)
    if crack is not None:
        text("plot_load_history", "crack", crack)

    def draw() -> list[Axes]:
        instance("plot_load_history", "history", history, LoadHistory, "a LoadHistory")
        time, u, resultant = history.time, history.displacement(point), history.contact_resultant
        scale, unit = length_unit(float(np.abs(u).max()))
        curves = {f"$u_{axis}$": (time, u[:, k]) for k, axis in ((1, "y"), (0, "x"))}
        panels = [Panel(f"displacement of {point} ({unit})", curves, scale, title=title)]
        if history.contact_force.shape[1]:
            scale, unit = force_unit(float(resultant.max(initial=0.0)))
            panels.append(Panel(f"contact resultant ({unit})", {"": (time, resultant)}, scale))
        tips = list(history.states[0].stress_intensity)
        if tips:
            factors = history.stress_intensity(crack or tips[0])
            curves = {name: (time, factors[:, k]) for k, name in enumerate(("$K_I$", "$K_{II}$"))}
            scale, unit = stress_unit(float(np.nan_to_num(np.abs(factors)).max()))
            panels.append(Panel(f"K of {crack or tips[0]} ({unit} m$^{{1/2}}$)", curves, scale))
        return _draw_histories(panels)

    return on_root(MPI.COMM_WORLD if comm is None else comm, draw)


def _draw_histories(panels: list[Panel]) -> list[Axes]:
    if not panels:
        raise ValueError("plot_histories: no panel is given")
    drawing = figure(1.75 * len(panels) + 0.25)
    grid = drawing.subplots(len(panels), 1, squeeze=False)[:, 0]
    for axes, panel in zip(grid, panels):
        start, stop = panel.window or (
            min(t[0] for t, _ in panel.curves.values()),
            max(t[-1] for t, _ in panel.curves.values()),
        )
        clock, unit = time_unit(max(abs(start), abs(stop)))
        for k, (name, (time, values)) in enumerate(panel.curves.items()):
            shown = (time >= start) & (time <= stop)
            axes.plot(
                *_thinned(np.asarray(time)[shown] * clock, np.asarray(values)[shown] * panel.scale),
                color=CYCLE[k % len(CYCLE)],
                label=name,
                linewidth=1.5 if k == 0 and len(panel.curves) > 1 else 0.8,
                linestyle="-" if k == 0 else (0, (4, 2)),
            )
        if panel.zero:
            axes.axhline(0.0, color="#999999", linewidth=0.4, zorder=0.5)
        axes.set_xlim(start * clock, stop * clock)
        axes.margins(y=0.08)
        axes.set_xlabel(f"time ({unit})")
        axes.set_ylabel(panel.quantity)
        axes.set_title(panel.title, fontsize=8, loc="left")
        axes.yaxis.set_major_locator(MaxNLocator(5))
        style(axes)
        if len(panel.curves) > 1:  # above the axes: a history leaves no corner free
            axes.legend(
                fontsize=7,
                frameon=False,
                loc="lower right",
                bbox_to_anchor=(1.0, 0.97),
                ncols=len(panel.curves),
                borderaxespad=0.0,
            )
    return list(grid)


def _thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest value of each column of pixels, in their order: drawn, nothing is
    missing.
    """
    width = len(x) // COLUMNS
    if width < 3:
        return x, y
    rows = y[: len(y) // width * width].reshape(-1, width)
    pair = (
        np.sort(np.stack([rows.argmin(axis=1), rows.argmax(axis=1)], axis=1), axis=1)
        + width * np.arange(len(rows))[:, None]
    )
    chosen = np.unique(np.concatenate([pair.ravel(), [len(x) - 1]]))
    return x[chosen], y[chosen]


@agreed("spectra")
def plot_spectra(
    spectra: Mapping[str, tuple[np.ndarray, np.ndarray]],
    quantity: str,
    window: tuple[float, float],
    *,
    lines: Mapping[str, float] | None = None,
    decades: float = 6.0,
    harmonics: Mapping[str, Sequence[float]] | None = None,
    comm: MPI.Comm | None = None,
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
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    Axes of the panels on rank 0, None elsewhere; `save_picture` writes them
    """
    owner = "plot_spectra"
    check(owner, quantity=quantity, window=window, lines=lines, decades=decades, comm=comm)
    check(owner, spectra=spectra, harmonics=harmonics, comm=comm)
    if spectra is None or window is None:
        raise TypeError(f"{owner}: spectra and window must be given")
    return on_root(
        MPI.COMM_WORLD if comm is None else comm,
        lambda: _draw_spectra(spectra, quantity, window, lines or {}, decades, harmonics or {}),
    )


def _draw_spectra(spectra, quantity: str, window, lines, decades: float, harmonics) -> list[Axes]:
    if not spectra:
        raise ValueError("plot_spectra: no spectrum is given")
    drawing = figure(1.9 * len(spectra) + 0.45)
    grid = drawing.subplots(len(spectra), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
    top, (tone, unit) = 0.0, frequency_unit(window[1])
    for k, (axes, (name, (frequency, amplitude))) in enumerate(zip(grid, spectra.items())):
        shown = (frequency >= window[0]) & (frequency <= window[1]) & (frequency > 0.0)
        level = np.abs(amplitude[shown])
        top = max(top, float(level.max()))
        for place in lines.values():
            axes.axvline(place * tone, color="#BBBBBB", linewidth=0.6, linestyle=(0, (3, 2)), zorder=0.5)
        axes.plot(
            frequency[shown] * tone,
            np.maximum(level, np.finfo(float).tiny),
            color=CYCLE[k % len(CYCLE)],
            linewidth=0.7,
        )
        for number, (family, places) in enumerate(harmonics.items()):
            at = [int(np.abs(frequency[shown] - f).argmin()) for f in places if window[0] <= f <= window[1]]
            at = [k for k in at if level[k] > 3.0 * np.median(level[max(k - 5, 0) : k + 6])]
            axes.plot(
                frequency[shown][at] * tone,
                level[at],
                linestyle="none",
                marker="v",
                markersize=3.5,
                markeredgewidth=0,
                color=BLACK if number == 0 else CYCLE[-1 - number],
                label=family,
            )
        axes.set_yscale("log")
        axes.set_xlim(window[0] * tone, window[1] * tone)
        axes.set_ylabel(quantity)
        axes.text(
            0.995,
            0.95,
            name,
            transform=axes.transAxes,
            fontsize=8,
            color=BLACK,
            horizontalalignment="right",
            verticalalignment="top",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5},
        )
        style(axes)
    if harmonics:
        grid[-1].legend(fontsize=7, frameon=False, loc="lower left")
    grid[0].set_ylim(top * 10.0**-decades, 4.0 * top)
    grid[0].yaxis.set_major_locator(LogLocator(numticks=6))
    grid[-1].set_xlabel(f"frequency ({unit})")
    for name, place in lines.items():
        if window[0] <= place <= window[1]:
            grid[0].annotate(
                name,
                (place * tone, 1.0),
                xycoords=grid[0].get_xaxis_transform(),
                xytext=(0, 2),
                textcoords="offset points",
                fontsize=7,
                horizontalalignment="center",
                verticalalignment="bottom",
                annotation_clip=False,
            )
    return list(grid)
