"""Pictures of quasi-periodic motions over the parameter of their branch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..continuation.problems.own_tone_branch import QuasiPeriodicBranch
from ..parallel import agreed, on_root
from ..petsc import MPI
from .arguments import check
from .branches import DASHED, smooth, split
from .drawing import BLACK, CYCLE, by_name, figure, style
from .units import frequency_unit, length_unit


@agreed("branches")
def plot_quasi_periodic(
    branches: QuasiPeriodicBranch | Mapping[str, QuasiPeriodicBranch],
    point: str = "A",
    direction: str = "y",
    *,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> np.ndarray | None:
    """Draw branches of motions with a tone of their own: the tone's amplitude and, below it, its frequency
    over the branch's parameter; unstable parts dashed. Collective.

    Parameters
    ----------
    branches : QuasiPeriodicBranch or dict of str to QuasiPeriodicBranch
        All over the frequency, or all over the load; on rank 0 at least.
    point : str
    direction : {"y", "x"}
    title, comm
        As for `plot_branches`.

    Returns
    -------
    (2,) array of Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    check("plot_quasi_periodic", point=point, direction=direction, title=title, comm=comm)
    named = by_name("plot_quasi_periodic", branches, QuasiPeriodicBranch)
    return on_root(comm or MPI.COMM_WORLD, lambda: _draw(named, point, direction, title))


def _draw(branches: Mapping[str, QuasiPeriodicBranch], point: str, direction: str, title: str) -> np.ndarray:
    if len({branch.parameter for branch in branches.values()}) != 1:
        raise ValueError(
            "plot_quasi_periodic: branches of one parameter, frequency or load, are expected; draw others "
            "apart"
        )
    heights = {name: np.abs(branch.line(0, 1, point, direction)) for name, branch in branches.items()}
    factor, unit = length_unit(max(float(h.max()) for h in heights.values()))
    times, unit_of_tone = frequency_unit(max(float(b.frequencies[:, 1].max()) for b in branches.values()))
    along, label = 1.0, "factor on the load"
    if next(iter(branches.values())).parameter == "frequency":
        along, name = frequency_unit(max(float(b.value.max()) for b in branches.values()))
        label = f"forcing frequency ({name})"
    panels = figure(4.6).subplots(2, 1, sharex=True)
    broken = False
    for k, (name, branch) in enumerate(branches.items()):
        colour = CYCLE[k % len(CYCLE)]
        panels[0].plot([], [], color=colour, linewidth=1.2, label=name or "_")
        for axes, values in zip(panels, (heights[name] * factor, branch.frequencies[:, 1] * times)):
            for stable, x, y in smooth(split(branch.value, values, branch.stable)):
                axes.plot(x * along, y, color=colour, linewidth=1.2, linestyle="-" if stable else DASHED)
                broken = broken or not stable
            axes.plot(branch.value * along, values, color=colour, linestyle="none", marker=".", markersize=3)
    if broken:
        panels[0].plot([], [], color=BLACK, linewidth=1.2, linestyle=DASHED, label="unstable")
    panels[0].set_ylabel(f"own tone of $u_{direction}$({point}) ({unit})")
    panels[1].set(xlabel=label, ylabel=f"its frequency ({unit_of_tone})")
    panels[0].set_title(title, fontsize=8, loc="left")
    panels[0].set_ylim(bottom=0.0)
    if any(branches) or broken:
        panels[0].legend(fontsize=7, frameon=False)
    for axes in panels:
        style(axes)
    return panels
