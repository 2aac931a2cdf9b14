"""Pictures of periodic motions: phase planes, gaps and forces over a period, Floquet multipliers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from ..continuation.branch import Branch
from ..continuation.orbit import Orbit, component
from ..motion.states import Point
from .branches import draw_growth
from .drawing import BLACK, BLUE, BROKEN, GREY, VERMILION, Scale, above, curves, dots
from .picture import Comm, picture, place_name, symbol

LIGHT = "#BBBBBB"
# Growth a period below which the scale of multipliers is linear, else logarithmic.
LINEAR = 1e-4
# Marks of multipliers inside the unit circle and outside.
SIDES = ((False, ".", BLUE, "inside"), (True, "^", VERMILION, "outside"))
# Multipliers drawn of each point of a branch in the complex plane.
OUTERMOST = 6


# ---------------------------------------------------------------------- phase plane and gaps
@picture(Orbit)
def plot_orbit(
    orbit: Orbit,
    point: Point = "A",
    direction: str = "y",
    *,
    pairs: Mapping[str, int] | None = None,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> list[Axes] | None:
    """Draw a periodic motion: a point's displacement and velocity against each other; gaps and contact
    resultant over one period. Collective.

    Parameters
    ----------
    orbit : Orbit
        On rank 0 at least; on all ranks for a place (x, y).
    point : str or (x, y)
        Name, or m.
    direction : {"y", "x"}
    pairs : dict of str to int, optional
        Names and numbers of contact pairs whose gaps are drawn. Default: the first, the middle and the last
        one.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    [phase plane, gaps, resultant] on rank 0, None elsewhere; `save_picture` writes them
    """
    count = orbit.contact_force.shape[1]
    if pairs is None:
        pairs = {f"pair {k + 1}": k for k in dict.fromkeys((0, count // 2, count - 1))} if count else {}
    for name, k in pairs.items():
        if not 0 <= k < count:
            raise ValueError(
                f"plot_orbit: pair {name!r} is number {k}, the model has {count}; give a number from 0"
            )
    states = orbit.states
    u, v = (
        _around(component(of(point), direction, orbit.of_rows))
        for of in (states.displacement, states.velocity)
    )
    across = Scale.of(f"${symbol(orbit, direction, point)}$({place_name(point)})", "m", u)
    up = Scale.of("velocity", "m/s", v)
    layout = [["phase", "upper"], ["phase", "lower"]]
    panels = phase, upper, lower = ax.panels(layout, 3.0, width_ratios=(1.0, 1.25))
    curves(phase, {"": (u, v)}, across, up)
    # one mark a forcing period, at the zero of its phase
    each = (len(u) - 1) // orbit.periods
    marked = "$t = 0$" if orbit.periods == 1 else "once a forcing period"
    dots(phase, (across(u[:-1:each]), up(v[:-1:each])), "o", 4, VERMILION, label=marked)
    phase.margins(0.1)
    above(phase, handletextpad=0.2)
    cycles, time = np.linspace(0.0, orbit.periods, len(u)), Scale(1.0, "time (forcing periods)")
    if count:
        gaps = {name: (cycles, _around(orbit.gap[:, k])) for name, k in pairs.items()}
        curves(upper, gaps, time, Scale.of("gap", "m", *(gap for _, gap in gaps.values())), BROKEN)
        above(upper, handlelength=1.6)
        resultant = _around(orbit.contact_resultant)
        curves(lower, {"": (cycles, resultant)}, time, Scale.of("resultant", "N", resultant), color=BLACK)
    else:
        curves(upper, {"": (cycles, u)}, time, across)
        curves(lower, {"": (cycles, v)}, time, up)
    for axes in (upper, lower):
        axes.axhline(0.0, color=LIGHT, linewidth=0.5, zorder=0.5)
        axes.set_xlim(0.0, orbit.periods)
        axes.margins(y=0.1)
        axes.yaxis.set_major_locator(MaxNLocator(4))
    upper.set_xlabel("")
    upper.tick_params(labelbottom=False)
    return panels


def _around(values: np.ndarray) -> np.ndarray:
    """A whole period, both ends."""
    return np.concatenate([values, values[:1]])


# ---------------------------------------------------------------------- multipliers
@picture(Orbit, Branch)
def plot_multipliers(
    subject: Orbit | Branch, *, title: str = "", ax: Any = None, comm: Comm = None
) -> list[Axes] | None:
    """Draw Floquet multipliers with the unit circle; beside it the growth |mu| - 1 a period. Collective.

    The growth is drawn over the argument for an orbit: the angle of a multiplier in turns is the frequency at
    which its disturbance beats with the period of the motion. For a branch the largest one's is drawn along
    it.

    Parameters
    ----------
    subject : Orbit or Branch
        With multipliers; on rank 0 at least.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    [complex plane, growth] on rank 0, None elsewhere; `save_picture` writes them
    """
    if not np.size(subject.multipliers):
        raise ValueError(
            "plot_multipliers: there are no multipliers; ask for them with stability=True, or draw a motion "
            "with contact"
        )
    panels = plane, growth = ax.panels((1, 2), 3.2, width_ratios=(1.0, 1.25))
    values, error = np.atleast_2d(subject.multipliers), np.atleast_1d(subject.multiplier_error)[:, None]
    outside = np.abs(values) > 1.0 + np.nan_to_num(error, nan=1e-9)
    # of a whole curve the outermost ones: all together fill a ring
    most = OUTERMOST if isinstance(subject, Branch) else values.shape[1]
    _draw_plane(plane, values, outside, outside | (np.arange(values.shape[1]) < most))
    growth.axhline(0.0, color=GREY, linewidth=0.8)
    growth.set_yscale("symlog", linthresh=LINEAR, linscale=0.6)
    if isinstance(subject, Orbit):
        upper = values.imag >= 0.0
        for beyond, marker, colour, _ in SIDES:
            chosen = values[upper & (outside == beyond)]
            at = np.angle(chosen) / (2.0 * np.pi), np.abs(chosen) - 1.0
            dots(growth, at, marker, 4, colour, markeredgewidth=0.5)
        growth.set(xlim=(-0.01, 0.51), xlabel="arg μ / 2π", ylim=(None, None if outside.any() else LINEAR))
    else:
        draw_growth(growth, subject)
    growth.set_ylabel("|μ| − 1")
    return panels


def _draw_plane(plane: Axes, values: np.ndarray, outside: np.ndarray, shown: np.ndarray) -> None:
    """Multipliers in the complex plane, with the unit circle."""
    plane.add_patch(Circle((0.0, 0.0), 1.0, fill=False, edgecolor=GREY, linewidth=0.8, zorder=2.5))
    for beyond, marker, colour, name in SIDES:
        chosen = values[shown & (outside == beyond)]
        if len(chosen):
            style: Any = {"markeredgewidth": 0.5, "zorder": 3, "label": name}
            dots(plane, (chosen.real, chosen.imag), marker, 3, colour, **style)
    reach = 1.12 * max(1.0, float(np.abs(values).max()))
    plane.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), xlabel="Re μ", ylabel="Im μ")
    for axis in (plane.xaxis, plane.yaxis):
        axis.set_major_locator(MaxNLocator(5))
    above(plane, handletextpad=0.2)
