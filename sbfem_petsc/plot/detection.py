"""Pictures of detection studies: which crack is seen with what probability."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..checks import real_array
from ..petsc import MPI
from .drawing import CYCLE, MARKERS, Sheet, bar
from .picture import picture


@picture()
def plot_detection(
    depth: Any,
    place: Any,
    probability: Mapping[str, Any],
    *,
    title: str = "",
    ax: Any = None,
    comm: MPI.Comm | None = None,
) -> list[Axes] | None:
    """Draw the probability of detection of cracks of several depths at several places. Collective.

    Parameters
    ----------
    depth, place : (n,) array
        Depth and position of each crack, m: every depth at every place; on rank 0 at least.
    probability : dict of str to (n,) array
        Of each way to look for them, such as `indicators.detection_probability` gives it.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    list of Axes on rank 0, None elsewhere
        First the mean over the places, over the depth; then a map of each way over place and depth.

    Raises
    ------
    ValueError
        If the arrays do not belong together.
    """
    owner = "plot_detection"
    depths = 1e3 * real_array(owner, "depth", depth, 1, "m")
    places = 1e3 * real_array(owner, "place", place, 1, "m")
    if not isinstance(probability, Mapping) or not probability:
        raise TypeError(f"{owner}: probability must be a dict of names to arrays with at least one entry")
    chances = {name: real_array(owner, f"probability[{name!r}]", p, 1) for name, p in probability.items()}
    for name, values in {"place": places, **chances}.items():
        if len(values) != len(depths):
            raise ValueError(
                f"{owner}: {name} has {len(values)} values for {len(depths)} depths; give one each"
            )
    steps, along = np.unique(depths), np.unique(places)
    if len(steps) * len(along) != len(depths) or len(
        np.unique(np.column_stack([depths, places]), axis=0)
    ) != len(depths):
        raise ValueError(
            f"{owner}: {len(depths)} cracks of {len(steps)} depths at {len(along)} places were given; every "
            "depth at every place is expected, once"
        )
    order = np.lexsort((places, depths))
    maps = {name: values[order].reshape(len(steps), len(along)) for name, values in chances.items()}
    shape = (1, 1 + len(maps))
    panels = Sheet.of(ax).panels(shape, 2.6, 3.0 + 1.6 * len(maps), width_ratios=[2.0] + [1.0] * len(maps))
    for k, (name, table) in enumerate(maps.items()):
        panels[0].plot(
            steps,
            table.mean(axis=1),
            color=CYCLE[k % len(CYCLE)],
            marker=MARKERS[k % len(MARKERS)],
            markersize=3.5,
            label=name,
        )
        panels[1 + k].pcolormesh(along, steps, table, vmin=0.0, vmax=1.0, cmap="viridis", shading="nearest")
        panels[1 + k].set_title(name)
        panels[1 + k].set(xlabel="position, mm", ylabel="depth, mm" if k == 0 else "")
    panels[0].set(xlabel="crack depth, mm", ylabel="probability, mean of positions", ylim=(-0.02, 1.02))
    panels[0].legend(loc="lower right")
    panels[0].grid()
    bar(panels[1].collections[0], panels[1:], "probability of detection")
    return panels
