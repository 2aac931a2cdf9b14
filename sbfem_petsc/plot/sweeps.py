"""Amplitudes under a swept frequency over the response curve, and loci of its bifurcations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes

from ..checks import instance, instances
from ..continuation.branch import Branch
from ..continuation.problems.locus import KINDS, Locus
from ..motion.states import Point
from ..motion.swept import SweptResponse
from .branches import Height, draw_parts, marks_of, name_verdicts, smooth, split
from .drawing import BLACK, BLUE, GREEN, PURPLE, VERMILION, Scale, legend
from .picture import Comm, picture, place_name, symbol

STYLES = {
    "fold": (BLUE, "-"),
    "period doubling": (VERMILION, "--"),
    "Neimark-Sacker": (GREEN, "-."),
    "grazing": (PURPLE, ":"),
}


@picture()
def plot_swept(
    branch: Branch | None,
    swept: SweptResponse | Sequence[SweptResponse],
    point: Point = "A",
    direction: str = "y",
    *,
    least: float = 0.2,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> Axes | None:
    """Draw amplitudes under swept frequencies, over the response curve; arrows mark the jumps. Collective.

    Parameters
    ----------
    branch : Branch or None
        Over the frequency; None: the swept motions alone. On rank 0 at least, as `swept`.
    swept : SweptResponse or sequence of SweptResponse
    point : str or (x, y)
        Whose amplitude, half the peak-to-peak, is drawn.
    direction : {"y", "x"}
        As for `plot_branches`.
    least : float
        See `SweptResponse.jumps`.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them

    Raises
    ------
    TypeError, ValueError, KeyError
        For other objects, a branch over the load, or an unknown point; SolveError for x of rows.
    """
    if branch is not None:
        instance("plot_swept", "branch", branch, Branch, "a Branch, or None")
        if branch.parameter != "frequency":
            raise ValueError(
                f"plot_swept: branch = {branch!r} is over the {branch.parameter}; give one over the frequency"
            )
    sweeps = instances("plot_swept", "swept", swept, SweptResponse, "a SweptResponse, or several")
    shown: list[Branch | SweptResponse] = [*([] if branch is None else [branch]), *sweeps]
    if not shown:
        raise ValueError("plot_swept: swept is empty and there is no branch; give one SweptResponse at least")
    heights = [item.amplitude(point, direction) for item in shown]  # at a place integrated again
    of = f"${symbol(shown[0], direction, point)}$({place_name(point)})"
    along = Scale.of("frequency", "Hz", *(item.frequency for item in shown))
    up = Scale.of(f"amplitude of {of}", "m", *heights)
    (axes,) = ax.panels((1, 1), 3.6)
    for item, height in zip(shown, heights):
        x, y = along(item.frequency), up(height)
        if isinstance(item, Branch):
            marks = marks_of(item, Height(point, direction), along, up)
            draw_parts(axes, split(x, y, ~item.unstable, marks), BLACK, width=1.3)
            name_verdicts(axes, [item])
            continue
        colour, label = (VERMILION, "swept up") if item.upwards else (BLUE, "swept down")
        axes.plot(x, y, color=colour, linewidth=0.8, label=label)
        for jump in item.jumps(point, least, direction) if item.tells_jumps else ():
            begin, end = ((along(jump.frequency), up(height)) for height in (jump.before, jump.after))
            arrow = {"arrowstyle": "->", "color": GREEN, "linewidth": 1.2}
            axes.annotate("", end, begin, arrowprops=arrow)
    axes.set(xlabel=along.label, ylabel=up.label)
    axes.set_ylim(bottom=0.0)
    legend(axes)
    return axes


@picture()
def plot_loci(
    loci: Locus | Sequence[Locus],
    *,
    unit: float | None = None,
    label: str | None = None,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> Axes | None:
    """Draw loci of one second parameter over the forcing frequency; monotone cubics between their points.
    Collective.

    Parameters
    ----------
    loci : Locus or sequence of Locus
        On rank 0 at least.
    unit : float, optional
        What the factor 1 stands for, such as 300.0 (N); `label` then names it with its unit.
    label : str, optional
        Of the vertical axis. Default: "factor on the load".
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them

    Raises
    ------
    TypeError, ValueError
        For something else than loci, and for loci of different second parameters.
    """
    lines = instances("plot_loci", "loci", loci, Locus, "a Locus, or several")
    names = {line.parameter for line in lines}
    if len(names) != 1:
        raise ValueError(
            f"plot_loci: loci over {', '.join(sorted(names)) or 'nothing'} were given; all of one second "
            "parameter are expected"
        )
    (axes,) = ax.panels((1, 1), 3.2, 5.0)
    for line in sorted(lines, key=lambda line: KINDS.index(line.kind)):
        colour, dashes = STYLES[line.kind]
        at = smooth(line.frequency, (unit or 1.0) * line.value)
        axes.plot(*at, color=colour, linestyle=dashes, linewidth=1.2, label=line.kind)
    axes.set(xlabel="forcing frequency (Hz)", ylabel=label or f"factor on the {names.pop()}")
    legend(axes)
    return axes
