"""Pictures (PNG) of time histories and spectra."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator

from ..parallel import on_root
from ..petsc import MPI
from .drawing import BLACK, CYCLE, figure, save, style

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
    title: str = ""
    zero: bool = True


def plot_histories(panels: Sequence[Panel], path: str, comm: MPI.Comm | None = None) -> str | None:
    """Draw time histories below each other. Collective.

    Parameters
    ----------
    panels : sequence of Panel
        On rank 0 at least.
    path : str
        PNG file.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    str on rank 0, None elsewhere
    """
    return on_root(
        MPI.COMM_WORLD if comm is None else comm, lambda: save(_draw_histories(list(panels)), path)
    )


def _draw_histories(panels: list[Panel]) -> Figure:
    if not panels:
        raise ValueError("plot_histories: no panel is given")
    drawing = figure(1.75 * len(panels) + 0.25)
    for axes, panel in zip(drawing.subplots(len(panels), 1, squeeze=False)[:, 0], panels):
        start, stop = panel.window or (
            min(t[0] for t, _ in panel.curves.values()),
            max(t[-1] for t, _ in panel.curves.values()),
        )
        for k, (name, (time, values)) in enumerate(panel.curves.items()):
            shown = (time >= start) & (time <= stop)
            axes.plot(
                *_thinned(np.asarray(time)[shown] * 1e3, np.asarray(values)[shown] * panel.scale),
                color=CYCLE[k % len(CYCLE)],
                label=name,
                linewidth=1.5 if k == 0 and len(panel.curves) > 1 else 0.8,
                linestyle="-" if k == 0 else (0, (4, 2)),
            )
        if panel.zero:
            axes.axhline(0.0, color="#999999", linewidth=0.4, zorder=0.5)
        axes.set_xlim(start * 1e3, stop * 1e3)
        axes.margins(y=0.08)
        axes.set_xlabel("time (ms)")
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
    return drawing


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


def plot_spectra(
    spectra: dict[str, tuple[np.ndarray, np.ndarray]],
    path: str,
    quantity: str,
    window: tuple[float, float],
    lines: dict[str, float] | None = None,
    decades: float = 6.0,
    harmonics: dict[str, Sequence[float]] | None = None,
    comm: MPI.Comm | None = None,
) -> str | None:
    """Draw amplitude spectra below each other on common axes, with named lines marked. Collective.

    Parameters
    ----------
    spectra : dict of str to (frequency, amplitude)
        Hz, and complex or real amplitudes.
    path : str
        PNG file.
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
    str on rank 0, None elsewhere
    """
    return on_root(
        MPI.COMM_WORLD if comm is None else comm,
        lambda: save(_draw_spectra(spectra, quantity, window, lines or {}, decades, harmonics or {}), path),
    )


def _draw_spectra(spectra, quantity: str, window, lines, decades: float, harmonics) -> Figure:
    if not spectra:
        raise ValueError("plot_spectra: no spectrum is given")
    drawing = figure(1.9 * len(spectra) + 0.45)
    grid = drawing.subplots(len(spectra), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
    top = 0.0
    for k, (axes, (name, (frequency, amplitude))) in enumerate(zip(grid, spectra.items())):
        shown = (frequency >= window[0]) & (frequency <= window[1]) & (frequency > 0.0)
        level = np.abs(amplitude[shown])
        top = max(top, float(level.max()))
        for place in lines.values():
            axes.axvline(place, color="#BBBBBB", linewidth=0.6, linestyle=(0, (3, 2)), zorder=0.5)
        axes.plot(
            frequency[shown],
            np.maximum(level, np.finfo(float).tiny),
            color=CYCLE[k % len(CYCLE)],
            linewidth=0.7,
        )
        for number, (family, places) in enumerate(harmonics.items()):
            at = [int(np.abs(frequency[shown] - f).argmin()) for f in places if window[0] <= f <= window[1]]
            at = [k for k in at if level[k] > 3.0 * np.median(level[max(k - 5, 0) : k + 6])]
            axes.plot(
                frequency[shown][at],
                level[at],
                linestyle="none",
                marker="v",
                markersize=3.5,
                markeredgewidth=0,
                color=BLACK if number == 0 else CYCLE[-1 - number],
                label=family,
            )
        axes.set_yscale("log")
        axes.set_xlim(window)
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
    grid[-1].set_xlabel("frequency (Hz)")
    for name, place in lines.items():
        if window[0] <= place <= window[1]:
            grid[0].annotate(
                name,
                (place, 1.0),
                xycoords=grid[0].get_xaxis_transform(),
                xytext=(0, 2),
                textcoords="offset points",
                fontsize=7,
                horizontalalignment="center",
                verticalalignment="bottom",
                annotation_clip=False,
            )
    return drawing
