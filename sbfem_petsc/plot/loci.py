"""Maps of behaviour: loci of bifurcations over frequency and a second parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes

from ..checks import instances
from ..continuation.problems.locus import KINDS, Locus
from ..petsc import MPI
from .branches import smooth
from .drawing import BLUE, GREEN, PURPLE, VERMILION, Sheet
from .picture import picture

STYLES = {
    "fold": (BLUE, "-"),
    "period doubling": (VERMILION, "--"),
    "Neimark-Sacker": (GREEN, "-."),
    "grazing": (PURPLE, ":"),
}


@picture()
def plot_loci(
    loci: Locus | Sequence[Locus],
    *,
    unit: float | None = None,
    label: str | None = None,
    title: str = "",
    ax: Any = None,
    comm: MPI.Comm | None = None,
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
    factor = 1.0 if unit is None else unit
    (axes,) = Sheet.of(ax).panels((1, 1), 3.2, 5.0)
    for kind in KINDS:
        colour, dashes = STYLES[kind]
        for number, line in enumerate(item for item in lines if item.kind == kind):
            _, frequency, value = smooth([(True, line.frequency, factor * line.value)])[0]
            axes.plot(
                frequency,
                value,
                color=colour,
                linestyle=dashes,
                linewidth=1.2,
                label=kind if number == 0 else None,
            )
    axes.set(xlabel="forcing frequency, Hz", ylabel=label or f"factor on the {names.pop()}")
    axes.legend()
    return axes
