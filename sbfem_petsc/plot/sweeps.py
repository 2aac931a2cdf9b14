"""Amplitudes under a swept frequency, drawn over the response curve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes

from ..checks import instance, instances
from ..continuation.branch import Branch
from ..motion.swept import SweptResponse
from ..petsc import MPI
from ..record.units import frequency_unit, length_unit
from .branches import Height, draw_parts, marks_of, name_verdicts, smooth, split
from .drawing import BLACK, BLUE, GREEN, VERMILION, Sheet
from .picture import named_point, picture, symbol


@picture(point=named_point)
def plot_swept(
    branch: Branch | None,
    swept: SweptResponse | Sequence[SweptResponse],
    point: str = "A",
    direction: str = "y",
    *,
    least: float = 0.2,
    title: str = "",
    ax: Any = None,
    comm: MPI.Comm | None = None,
) -> Axes | None:
    """Draw amplitudes under swept frequencies, over the response curve; arrows mark the jumps. Collective.

    Parameters
    ----------
    branch : Branch or None
        Over the frequency; None: the swept motions alone. On rank 0 at least, as `swept`.
    swept : SweptResponse or sequence of SweptResponse
    point : str
        Whose amplitude, half the peak-to-peak, is drawn. Named: of swept motions no others are kept.
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
            raise ValueError(f"plot_swept: branch = {branch!r} is over the load; give one over the frequency")
    sweeps = instances("plot_swept", "swept", swept, SweptResponse, "a SweptResponse, or several")
    shown: list[Branch | SweptResponse] = [*([] if branch is None else [branch]), *sweeps]
    if not shown:
        raise ValueError("plot_swept: swept is empty and there is no branch; give one SweptResponse at least")
    factor, unit = length_unit(max(float(item.amplitude(point, direction).max()) for item in shown))
    along, name = frequency_unit(max(float(item.frequency.max()) for item in shown))
    (axes,) = Sheet.of(ax).panels((1, 1), 3.6)
    if branch is not None:
        height = Height(point, direction)
        marks = marks_of(branch, height, along, factor)
        parts = split(branch.value * along, height.along(branch) * factor, ~branch.unstable, marks)
        name_verdicts(axes, draw_parts(axes, smooth(parts), BLACK, 1.3))
    for upwards, colour, label in ((True, VERMILION, "swept up"), (False, BLUE, "swept down")):
        for number, item in enumerate(s for s in sweeps if s.upwards == upwards):
            axes.plot(
                item.frequency * along,
                item.amplitude(point, direction) * factor,
                color=colour,
                linewidth=0.8,
                label=label if number == 0 else None,
            )
            for jump in item.jumps(point, least, direction) if item.tells_jumps else ():
                axes.annotate(
                    "",
                    (jump.frequency * along, jump.after * factor),
                    (jump.frequency * along, jump.before * factor),
                    arrowprops={"arrowstyle": "->", "color": GREEN, "linewidth": 1.2},
                )
    of = symbol(shown[0], direction, point)
    axes.set(xlabel=f"frequency ({name})", ylabel=f"amplitude of ${of}$({point}) ({unit})")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    return axes
