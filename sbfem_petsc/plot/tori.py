"""Pictures of quasi-periodic motions over the parameter of their branch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..continuation.problems.curve_branch import QuasiPeriodicBranch
from ..petsc import MPI
from ..record.units import frequency_unit, length_unit
from .branches import draw_parts, name_verdicts, smooth, split
from .drawing import CYCLE, Sheet
from .picture import named, named_point, picture, symbol


@picture(QuasiPeriodicBranch, several=True, point=named_point)
def plot_quasi_periodic(
    branches: QuasiPeriodicBranch | Mapping[str, QuasiPeriodicBranch],
    point: str = "A",
    direction: str = "y",
    *,
    title: str = "",
    ax: Any = None,
    comm: MPI.Comm | None = None,
) -> list[Axes] | None:
    """Draw branches of motions with a tone of their own: the tone's amplitude and, below it, its frequency
    over the branch's parameter; unstable parts dashed. Collective.

    Parameters
    ----------
    branches : QuasiPeriodicBranch or dict of str to QuasiPeriodicBranch
        All over the frequency, or all over the load; on rank 0 at least.
    point : str
    direction : {"y", "x"}
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Two axes on rank 0, None elsewhere; `save_picture` writes them
    """
    curves = named(branches)
    if len({branch.parameter for branch in curves.values()}) != 1:
        raise ValueError(
            "plot_quasi_periodic: branches of one parameter, frequency or load, are expected; draw others "
            "apart"
        )
    heights = {name: np.abs(branch.line(0, 1, point, direction)) for name, branch in curves.items()}
    factor, unit = length_unit(max(float(h.max()) for h in heights.values()))
    times, unit_of_tone = frequency_unit(max(float(b.frequencies[:, 1].max()) for b in curves.values()))
    along, label = 1.0, "factor on the load"
    if next(iter(curves.values())).parameter == "frequency":
        along, name = frequency_unit(max(float(b.value.max()) for b in curves.values()))
        label = f"forcing frequency ({name})"
    panels = Sheet.of(ax).panels((2, 1), 4.6, sharex=True)
    broken = False
    for k, (name, branch) in enumerate(curves.items()):
        colour, x = CYCLE[k % len(CYCLE)], branch.value * along
        panels[0].plot([], [], color=colour, linewidth=1.2, label=name or "_")
        for axes, values in zip(panels, (heights[name] * factor, branch.frequencies[:, 1] * times)):
            broken |= draw_parts(axes, smooth(split(x, values, branch.stable)), colour, 1.2)
            axes.plot(x, values, color=colour, linestyle="none", marker=".", markersize=3)
    name_verdicts(panels[0], broken)
    panels[0].set(
        xlabel=label,
        ylabel=f"own tone of ${symbol(curves, direction, point)}$({point}) ({unit})",
    )
    panels[1].set(xlabel=label, ylabel=f"its frequency ({unit_of_tone})")
    panels[0].set_ylim(bottom=0.0)
    if any(curves) or broken:
        panels[0].legend()
    return panels
