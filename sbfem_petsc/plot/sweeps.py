"""Amplitudes under a swept frequency, drawn over the response curve."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from ..checks import instance, positive
from ..continuation.branch import Branch
from ..motion.swept import SweptResponse
from .arguments import check
from .branches import DASHED, amplitude_at, in_order, smooth, split
from .drawing import BLACK, BLUE, GREEN, VERMILION, figure, style
from .units import frequency_unit, length_unit


def plot_swept(
    branch: Branch | None,
    swept: SweptResponse | Sequence[SweptResponse],
    point: str = "A",
    *,
    least: float = 0.2,
    title: str = "",
) -> Axes:
    """Draw amplitudes under swept frequencies, over the response curve; arrows mark the jumps.

    Parameters
    ----------
    branch : Branch or None
        Over the frequency; None: the swept motions alone.
    swept : SweptResponse or sequence of SweptResponse
    point : str
        Whose amplitude, half the peak-to-peak of u_y, is drawn.
    least : float
        See `SweptResponse.jumps`.
    title : str

    Returns
    -------
    Axes

    Raises
    ------
    TypeError, ValueError, KeyError
        For other objects, a branch over the load, or an unknown point.
    """
    owner = "plot_swept"
    if branch is not None:
        instance(owner, "branch", branch, Branch, "a Branch, or None")
        if branch.parameter != "frequency":
            raise ValueError(f"{owner}: branch = {branch!r} is over the load; give one over the frequency")
    if not isinstance(swept, (SweptResponse, list, tuple)):
        raise TypeError(f"{owner}: swept = {swept!r} must be a SweptResponse, or several")
    sweeps = [swept] if isinstance(swept, SweptResponse) else list(swept)
    for item in sweeps:
        instance(owner, "swept", item, SweptResponse, "a SweptResponse, or several")
    least = positive(owner, "least", least)
    check(owner, point=point, title=title)
    shown: list[Branch | SweptResponse] = [*([] if branch is None else [branch]), *sweeps]
    if not shown:
        raise ValueError(f"{owner}: swept is empty and there is no branch; give one SweptResponse at least")
    factor, unit = length_unit(max(float(item.amplitude(point).max()) for item in shown))
    along, name = frequency_unit(max(float(item.frequency.max()) for item in shown))
    drawing = figure(3.6)
    axes = drawing.add_subplot()
    if branch is not None:
        _draw_branch(axes, branch, point, along, factor)
    for upwards, colour, label in ((True, VERMILION, "swept up"), (False, BLUE, "swept down")):
        for number, item in enumerate(s for s in sweeps if s.upwards == upwards):
            axes.plot(
                item.frequency * along,
                item.amplitude(point) * factor,
                color=colour,
                linewidth=0.8,
                label=label if number == 0 else None,
            )
            for jump in item.jumps(point, least) if item.tells_jumps else ():
                axes.annotate(
                    "",
                    (jump.frequency * along, jump.after * factor),
                    (jump.frequency * along, jump.before * factor),
                    arrowprops={"arrowstyle": "->", "color": GREEN, "linewidth": 1.2},
                )
    axes.set(xlabel=f"frequency ({name})", ylabel=f"amplitude of $u_y$({point}) ({unit})")
    axes.set_ylim(bottom=0.0)
    axes.set_title(title, fontsize=9)
    axes.legend(fontsize=7, frameon=False)
    style(axes)
    return axes


def _draw_branch(axes: Axes, branch: Branch, point: str, along: float, factor: float) -> None:
    """Stable parts solid, unstable ones dashed, black."""
    marks = [(item.after, item.own_value, amplitude_at(branch, item, point)) for item in in_order(branch)]
    named: set[bool] = set()
    for stable, x, y in smooth(split(branch.value, branch.amplitude(point), branch.stable, marks)):
        name = None if stable in named else "stable" if stable else "unstable"
        named.add(stable)
        dashes = "-" if stable else DASHED
        axes.plot(x * along, y * factor, color=BLACK, linewidth=1.3, linestyle=dashes, label=name)
