"""Pictures of periodic motions: harmonics, phase planes, Floquet multipliers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..checks import instance
from ..continuation.branch import Branch
from ..continuation.orbit import Orbit
from ..parallel import agreed, on_root
from ..petsc import MPI
from .arguments import check
from .branches import DASHED, GREY, draw_growth
from .drawing import BLACK, BLUE, CYCLE, VERMILION, by_name, figure, finish_stems, stems, style
from .units import divisors, force_unit, length_unit

LIGHT = "#BBBBBB"
# Growth a period below which the scale of multipliers is linear, else logarithmic.
LINEAR = 1e-4
# Harmonics this far below the first are the rounding of the linear response.
ROUND_OFF = 1e-12
# Multipliers drawn of each point of a branch in the complex plane.
OUTERMOST = 6


# ---------------------------------------------------------------------- harmonics
@agreed("orbits")
def plot_harmonics(
    orbits: Orbit | Mapping[str, Orbit],
    point: str = "A",
    direction: str = "y",
    *,
    count: int = 10,
    decades: float = 5.0,
    forces: Mapping[str, float] | None = None,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> Axes | None:
    """Draw the moduli of the harmonics of several periodic motions as stems on a logarithmic scale.
    Collective.

    Parameters
    ----------
    orbits : Orbit or dict of str to Orbit
        On rank 0 at least.
    point : str
    direction : {"y", "x"}
    count : int
        Highest harmonic.
    decades : float
        Below the largest harmonic shown; what is smaller is left out.
    forces : dict of str to float, optional
        N: harmonics are divided by them.
    title, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    check("plot_harmonics", point=point, direction=direction, count=count, decades=decades, comm=comm)
    check("plot_harmonics", forces=forces, title=title, comm=comm)
    named = by_name("plot_harmonics", orbits, Orbit)
    return on_root(
        comm or MPI.COMM_WORLD,
        lambda: _draw_harmonics(named, point, direction, forces, _Stems(count, decades, title)),
    )


class _Stems(NamedTuple):
    """The highest harmonic, the decades below the largest one, and the title of a picture."""

    highest: int
    decades: float
    title: str


def _draw_harmonics(orbits: Mapping[str, Orbit], point: str, direction: str, forces, shown: _Stems) -> Axes:
    count, decades, title = shown
    if not orbits:
        raise ValueError("plot_harmonics: no orbit is given")
    divisor = divisors("plot_harmonics", orbits, forces)
    found = {
        name: np.abs(orbit.harmonics(point, direction)[: count + 1]) / divisor[name]
        for name, orbit in orbits.items()
    }
    top = max(float(levels.max()) for levels in found.values())
    if not top > 0.0:
        raise ValueError(f"plot_harmonics: point {point!r} does not move in {direction}")
    # stems stand on the power of ten below the least harmonic that is shown: the scale has no zero
    levels_shown = np.concatenate(
        [v[(v > top * 10.0**-decades) & (v > ROUND_OFF * v.max())] for v in found.values()]
    )
    floor = 10.0 ** np.floor(np.log10(0.7 * levels_shown.min()))
    drawing = figure(2.9)
    axes = drawing.subplots()
    apart = min(0.2, 0.7 / len(found))
    for k, (name, levels) in enumerate(found.items()):
        # rounding is no harmonic
        seen = (levels > floor) & (levels > ROUND_OFF * levels.max())
        x = np.flatnonzero(seen) + apart * (k - 0.5 * (len(found) - 1))
        stems(axes, x, levels[seen], floor=floor, curve=(k, name))
    axes.set(yscale="log", xlim=(-0.6, count + 0.6), ylim=(floor, 4.0 * top), xticks=range(count + 1))
    axes.set(
        xlabel="harmonic number",
        ylabel=f"$|u_{direction}|$({point})" + (" (m)" if forces is None else " / force (m/N)"),
    )
    finish_stems(axes, found, title)
    return axes


# ---------------------------------------------------------------------- phase plane and gaps
@agreed("orbit")
def plot_orbit(
    orbit: Orbit,
    point: str = "A",
    *,
    pairs: Mapping[str, int] | None = None,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> list[Axes] | None:
    """Draw a periodic motion: a point's displacement and velocity against each other; gaps and contact
    resultant over one period. Collective.

    Parameters
    ----------
    orbit : Orbit
        On rank 0 at least.
    point : str
    pairs : dict of str to int, optional
        Names and numbers of contact pairs whose gaps are drawn. Default: the first, the middle and the last
        one.
    title, comm
        As for `plot_branches`.

    Returns
    -------
    [phase plane, gaps, resultant] on rank 0, None elsewhere; `save_picture` writes them
    """
    check("plot_orbit", point=point, pairs=pairs, title=title, comm=comm)
    return on_root(comm or MPI.COMM_WORLD, lambda: _draw_orbit(orbit, point, pairs, title))


def _draw_orbit(orbit: Orbit, point: str, pairs, title: str) -> list[Axes]:
    instance("plot_orbit", "orbit", orbit, Orbit, "an Orbit")
    count = orbit.contact_force.shape[1]
    if pairs is None:
        pairs = {f"pair {k + 1}": k for k in dict.fromkeys((0, count // 2, count - 1))} if count else {}
    for name, k in pairs.items():
        if not 0 <= k < count:
            raise ValueError(
                f"plot_orbit: pair {name!r} is number {k}, the model has {count}; give a number from 0"
            )

    def around(values):
        """A whole period, both ends."""
        return np.concatenate([values, values[:1]])

    u, v = around(orbit.displacement(point)[:, 1]), around(orbit.velocity(point)[:, 1])
    cycles = np.arange(len(u)) * (orbit.periods / (len(u) - 1))
    drawing = figure(3.0)
    grid = drawing.add_gridspec(2, 2, width_ratios=(1.0, 1.25))
    phase = drawing.add_subplot(grid[:, 0])
    factor, unit = length_unit(float(np.abs(u).max()))
    speed, speed_unit = length_unit(float(np.abs(v).max()))
    phase.plot(u * factor, v * speed, color=BLUE, linewidth=1.1)
    # one mark a forcing period, at the zero of its phase
    each = (len(u) - 1) // orbit.periods
    phase.plot(
        u[:-1:each] * factor,
        v[:-1:each] * speed,
        linestyle="none",
        marker="o",
        markersize=4,
        color=VERMILION,
        label="$t = 0$" if orbit.periods == 1 else "once a forcing period",
    )
    phase.set(xlabel=f"$u_y$({point}) ({unit})", ylabel=f"velocity ({speed_unit}/s)")
    phase.margins(0.1)
    phase.legend(
        fontsize=7,
        frameon=False,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.0,
        handletextpad=0.2,
    )
    upper, lower = drawing.add_subplot(grid[0, 1]), drawing.add_subplot(grid[1, 1])
    if count:
        gaps = {name: around(orbit.gap[:, k]) for name, k in pairs.items()}
        factor, unit = length_unit(max((float(np.abs(g).max()) for g in gaps.values()), default=1.0))
        for k, (name, gap) in enumerate(gaps.items()):
            upper.plot(
                cycles,
                gap * factor,
                color=CYCLE[k % len(CYCLE)],
                linewidth=1.1,
                linestyle=("-", DASHED, (0, (1, 1)))[k % 3],
                label=name,
            )
        upper.set_ylabel(f"gap ({unit})")
        upper.legend(
            fontsize=7,
            frameon=False,
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            ncols=len(gaps),
            borderaxespad=0.0,
            handlelength=1.6,
            columnspacing=1.0,
        )
        resultant = around(orbit.contact_resultant)
        factor, unit = force_unit(float(resultant.max()))
        lower.plot(cycles, resultant * factor, color=BLACK, linewidth=1.1)
        lower.set_ylabel(f"resultant ({unit})")
    else:
        for axes, values, name in (
            (upper, u * factor, f"$u_y$({point}) ({unit})"),
            (lower, v * speed, f"velocity ({speed_unit}/s)"),
        ):
            axes.plot(cycles, values, color=BLUE, linewidth=1.1)
            axes.set_ylabel(name)
    for axes in (upper, lower):
        axes.axhline(0.0, color=LIGHT, linewidth=0.5, zorder=0.5)
        axes.set_xlim(0.0, orbit.periods)
        axes.margins(y=0.1)
        axes.yaxis.set_major_locator(MaxNLocator(4))
    upper.tick_params(labelbottom=False)
    lower.set_xlabel("time (forcing periods)")
    for axes in (phase, upper, lower):
        style(axes)
    if title:
        drawing.suptitle(title, fontsize=8, x=0.01, horizontalalignment="left")
    return [phase, upper, lower]


# ---------------------------------------------------------------------- multipliers
@agreed("subject")
def plot_multipliers(
    subject: Orbit | Branch, *, title: str = "", comm: MPI.Comm | None = None
) -> list[Axes] | None:
    """Draw Floquet multipliers with the unit circle; beside it the growth |mu| - 1 a period. Collective.

    The growth is drawn over the argument for an orbit: the angle of a multiplier in turns is the frequency at
    which its disturbance beats with the period of the motion. For a branch the largest one's is drawn along
    it.

    Parameters
    ----------
    subject : Orbit or Branch
        With multipliers; on rank 0 at least.
    title, comm
        As for `plot_branches`.

    Returns
    -------
    [complex plane, growth] on rank 0, None elsewhere; `save_picture` writes them
    """
    check("plot_multipliers", title=title, comm=comm)
    return on_root(comm or MPI.COMM_WORLD, lambda: _draw_multipliers(subject, title))


def _draw_multipliers(subject: Orbit | Branch, title: str) -> list[Axes]:
    instance("plot_multipliers", "subject", subject, (Orbit, Branch), "an Orbit or a Branch")
    if not np.size(subject.multipliers):
        raise ValueError(
            "plot_multipliers: there are no multipliers; ask for them with stability=True, or draw a motion "
            "with contact"
        )
    drawing = figure(3.2)
    plane, growth = drawing.subplots(1, 2, width_ratios=(1.0, 1.25))
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    plane.plot(np.cos(turn), np.sin(turn), color=GREY, linewidth=0.8, zorder=2.5)
    values = np.ravel(subject.multipliers)
    outside = np.abs(values) > 1.0 + np.repeat(
        np.nan_to_num(np.atleast_1d(subject.multiplier_error), nan=1e-9), np.shape(subject.multipliers)[-1]
    )
    # of a whole curve the outermost ones: all together fill a ring
    shown = (
        np.ones(len(values), dtype=bool)
        if isinstance(subject, Orbit)
        else np.tile(np.arange(np.shape(subject.multipliers)[1]) < OUTERMOST, len(subject.value)) | outside
    )
    for chosen, colour, marker, name in (
        (~outside & shown, BLUE, ".", "inside"),
        (outside, VERMILION, "^", "outside"),
    ):
        if chosen.any():
            plane.plot(
                values[chosen].real,
                values[chosen].imag,
                linestyle="none",
                marker=marker,
                markersize=3,
                markeredgewidth=0.5,
                color=colour,
                label=name,
                zorder=3,
            )
    reach = 1.12 * max(1.0, float(np.abs(values).max()))
    plane.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), xlabel="Re μ", ylabel="Im μ")
    plane.xaxis.set_major_locator(MaxNLocator(5))
    plane.yaxis.set_major_locator(MaxNLocator(5))
    growth.axhline(0.0, color=GREY, linewidth=0.8)
    growth.set_yscale("symlog", linthresh=LINEAR, linscale=0.6)
    if isinstance(subject, Orbit):
        for chosen, colour, marker in (
            (~outside & (values.imag >= 0.0), BLUE, "."),
            (outside & (values.imag >= 0.0), VERMILION, "^"),
        ):
            growth.plot(
                np.angle(values[chosen]) / (2.0 * np.pi),
                np.abs(values[chosen]) - 1.0,
                linestyle="none",
                marker=marker,
                markersize=4,
                markeredgewidth=0.5,
                color=colour,
            )
        growth.set(xlim=(-0.01, 0.51), xlabel="arg μ / 2π", ylim=(None, None if outside.any() else LINEAR))
    else:
        draw_growth(growth, subject)
    plane.legend(
        fontsize=7,
        frameon=False,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=2,
        borderaxespad=0.0,
        handletextpad=0.2,
        columnspacing=1.0,
    )
    growth.set_ylabel("|μ| − 1")
    for axes in (plane, growth):
        style(axes)
    if title:
        drawing.suptitle(title, fontsize=8, x=0.01, horizontalalignment="left")
    return [plane, growth]
