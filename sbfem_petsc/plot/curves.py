"""Pictures (PNG) of periodic motions: response curves, harmonics, orbits, Floquet multipliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from scipy.interpolate import PchipInterpolator

from ..analysis.periodic import Orbit
from ..analysis.response import Branch
from ..dynamics.bifurcations import Bifurcation
from ..parallel import on_root
from ..petsc import MPI
from .drawing import BLACK, BLUE, CYCLE, GREEN, MARKERS, VERMILION, figure, save, style

GREY, LIGHT = "#8A8A8A", "#BBBBBB"
KINDS = {"fold": "o", "period doubling": "s", "Neimark-Sacker": "^", "branch point": "D", "grazing": "v"}
DASHED = (0, (3.0, 1.6))
# Growth a period below which the scale of multipliers is linear, else logarithmic.
LINEAR = 1e-4
# Harmonics this far below the first are the rounding of the linear response.
ROUND_OFF = 1e-12
# Multipliers drawn of each point of a curve in the complex plane, and lines between two of its points.
OUTERMOST, BETWEEN = 6, 12


# ---------------------------------------------------------------------- response curves
def plot_curves(
    curves: dict[str, Branch],
    path: str,
    point: str = "A",
    forces: dict[str, float] | None = None,
    window: tuple[float, float] | None = None,
    title: str = "",
    every: bool = False,
    comm: MPI.Comm | None = None,
) -> str | None:
    """Draw response curves in one picture: stable parts solid, unstable parts dashed, bifurcations marked by
    their kind. Collective.

    Responses without contact are grey lines. Between the points that were computed the lines are monotone
    cubics.

    Parameters
    ----------
    curves : dict of str to Branch
        All over the frequency, or all over the load; on rank 0 at least.
    path : str
        PNG file.
    point : str
        Whose amplitude, half the peak-to-peak of u_y, is drawn.
    forces : dict of str to float, optional
        N: amplitudes are divided by them. What is linear then falls on one line.
    window : (float, float), optional
        Of the parameter; default: all.
    title : str
    every : bool
        Mark also the points where further multipliers pass the unit circle on a part that is unstable on both
        sides; folds, period doublings and branch points are always marked.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    str on rank 0, None elsewhere
    """
    return on_root(
        comm or MPI.COMM_WORLD, lambda: save(_draw_curves(curves, point, forces, window, title, every), path)
    )


def split(
    value: np.ndarray, height: np.ndarray, stable: np.ndarray, marks: Sequence[tuple[int, float, float]] = ()
) -> list[tuple[bool, np.ndarray, np.ndarray]]:
    """Stable and unstable parts of a curve, each beginning where the one before it ends.

    Parameters
    ----------
    value, height, stable : (n,) arrays
        Points in order of arc length.
    marks : sequence of (after, value, height)
        Bifurcations between the points after - 1 and after, in order: vertices of the curve, and ends of
        parts where the verdict changes. Without one the verdict changes half-way between two points.

    Returns
    -------
    list of (stable, value, height)
    """
    parts, x, y = [], [float(value[0])], [float(height[0])]
    for k in range(1, len(value)):
        between = [(v, h) for after, v, h in marks if after == k]
        changes = bool(stable[k]) != bool(stable[k - 1])
        if changes and not between:
            between = [(0.5 * (value[k - 1] + value[k]), 0.5 * (height[k - 1] + height[k]))]
        for number, (v, h) in enumerate(between):
            x.append(float(v))
            y.append(float(h))
            # of several the verdict changes at the first where it is lost, at the last where it is won
            if changes and number == (0 if stable[k - 1] else len(between) - 1):
                parts.append((bool(stable[k - 1]), np.array(x), np.array(y)))
                x, y = x[-1:], y[-1:]
        x.append(float(value[k]))
        y.append(float(height[k]))
    parts.append((bool(stable[-1]), np.array(x), np.array(y)))
    return parts


def amplitude_at(curve: Branch, item: Bifurcation, point: str) -> float:
    """Amplitude of a point at a bifurcation, integrated from its state, m."""
    alone = replace(
        curve,
        value=np.array([item.value]),
        states=item.state[None],
        multipliers=np.zeros((1, 0), dtype=complex),
        multiplier_error=np.zeros(1),
    )
    return alone.orbit(0).amplitude(point)


def in_order(curve: Branch) -> list[Bifurcation]:
    """Bifurcations in order of arc length, also those between the same two points."""

    def place(item: Bifurcation) -> float:
        chord = curve.states[item.after] - curve.states[item.after - 1]
        return item.after + float((item.state - curve.states[item.after - 1]) @ chord) / max(
            float(chord @ chord), 1e-300
        )

    return sorted(curve.bifurcations, key=place)


def smooth(parts: list[tuple[bool, np.ndarray, np.ndarray]]) -> list[tuple[bool, np.ndarray, np.ndarray]]:
    """The parts of a curve with points between theirs: monotone cubics of the arc length, without
    overshoot.
    """
    x, y = (np.concatenate([parts[0][k][:1], *(part[k][1:] for part in parts)]) for k in (1, 2))
    arc = np.concatenate(
        [[0.0], np.cumsum(np.hypot(np.diff(x) / (np.ptp(x) or 1.0), np.diff(y) / (np.ptp(y) or 1.0)))]
    )
    apart = np.concatenate([[True], np.diff(arc) > 1e-9 * arc[-1]])
    if apart.sum() < 3:
        return parts
    through = PchipInterpolator(arc[apart], np.stack([x, y], axis=1)[apart])
    result, begin = [], 0
    for stable, places, _ in parts:
        knots = arc[begin : begin + len(places)]
        begin += len(places) - 1
        fine = np.unique(np.linspace(knots[:-1], knots[1:], BETWEEN + 1)) if len(knots) > 1 else knots
        result.append((stable, *through(np.clip(fine, 0.0, arc[apart][-1])).T))
    return result


def _draw_curves(curves: dict[str, Branch], point: str, forces, window, title: str, every: bool) -> Figure:
    if not curves:
        raise ValueError("plot_curves: no curve is given")
    if len({curve.parameter for curve in curves.values()}) > 1:
        raise ValueError(
            "plot_curves: some curves are over the frequency and some over the load; draw them apart"
        )
    divisor = _divisors("plot_curves", curves, forces)
    heights = {name: curve.amplitude(point) / divisor[name] for name, curve in curves.items()}
    factor, unit = _unit(max(float(h.max()) for h in heights.values()))
    along, label = _abscissa(curves)
    drawing = figure(3.6)
    axes = drawing.subplots()
    colour, kinds, dashed = iter(CYCLE * len(curves)), set(), False
    for name, curve in curves.items():
        if not curve.period.pairs:
            axes.plot(
                curve.value * along, heights[name] * factor, color=GREY, linewidth=1.6, zorder=1.5, label=name
            )
            continue
        shade = next(colour)
        found = in_order(curve)
        marks = [(item.after, item.value, amplitude_at(curve, item, point) / divisor[name]) for item in found]
        # the legend shows the solid line whichever part comes first
        axes.plot([], [], color=shade, linewidth=1.1, label=name)
        for stable, x, y in smooth(split(curve.value, heights[name], curve.stable, marks)):
            axes.plot(
                x * along,
                y * factor,
                color=shade,
                linewidth=1.1,
                linestyle="-" if stable else DASHED,
                zorder=2,
            )
            dashed = dashed or not stable
        for item, (_, x, y) in zip(found, marks):
            if every or _decides(curve, item):
                _mark(axes, x * along, y * factor, item.kind, shade)
                kinds.add(item.kind)
    if dashed:
        axes.plot([], [], color=BLACK, linewidth=1.1, linestyle=DASHED, label="unstable")
    for kind in KINDS:
        if kind in kinds:
            _mark(axes, [], [], kind, BLACK, kind)
    limits = window or (
        min(float(c.value.min()) for c in curves.values()),
        max(float(c.value.max()) for c in curves.values()),
    )
    axes.set(
        xlim=(limits[0] * along, limits[1] * along),
        xlabel=label,
        ylabel=f"amplitude of $u_y$({point})" + (f" ({unit})" if forces is None else f" / force ({unit}/N)"),
    )
    axes.set_ylim(bottom=0.0)
    axes.set_title(title, fontsize=8, loc="left")
    axes.legend(fontsize=7, frameon=False)
    style(axes)
    return drawing


def _decides(curve: Branch, item: Bifurcation) -> bool:
    """Whether a bifurcation is marked in any case: it changes the verdict, or other branches begin or turn
    there.
    """
    return item.kind not in ("Neimark-Sacker", "grazing") or bool(
        curve.stable[item.after] != curve.stable[item.after - 1]
    )


def _mark(axes, x, y, kind: str, colour: str, label: str | None = None) -> None:
    axes.plot(
        x,
        y,
        marker=KINDS[kind],
        markersize=4,
        markerfacecolor="white",
        markeredgecolor=colour,
        markeredgewidth=0.8,
        linestyle="none",
        zorder=3,
        label=label,
    )


# ---------------------------------------------------------------------- harmonics
def plot_harmonics(
    orbits: dict[str, Orbit],
    path: str,
    point: str = "A",
    direction: str = "y",
    count: int = 10,
    decades: float = 8.0,
    forces: dict[str, float] | None = None,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> str | None:
    """Draw the moduli of the harmonics of several periodic motions as stems on a logarithmic scale.
    Collective.

    Parameters
    ----------
    orbits : dict of str to Orbit
        On rank 0 at least.
    point : str
    direction : {"y", "x"}
    count : int
        Highest harmonic.
    decades : float
        Below the largest harmonic shown; what is smaller is left out.
    forces : dict of str to float, optional
        N: harmonics are divided by them.
    path, title, comm
        As for `plot_curves`.
    """
    return on_root(
        comm or MPI.COMM_WORLD,
        lambda: save(_draw_harmonics(orbits, point, direction, count, decades, forces, title), path),
    )


def _draw_harmonics(
    orbits: dict[str, Orbit], point: str, direction: str, count: int, decades: float, forces, title: str
) -> Figure:
    if not orbits:
        raise ValueError("plot_harmonics: no orbit is given")
    divisor = _divisors("plot_harmonics", orbits, forces)
    found = {
        name: np.abs(orbit.harmonics(point, direction)[: count + 1]) / divisor[name]
        for name, orbit in orbits.items()
    }
    top = max(float(levels.max()) for levels in found.values())
    if not top > 0.0:
        raise ValueError(f"plot_harmonics: point {point!r} does not move in {direction}")
    floor = top * 10.0**-decades
    drawing = figure(2.9)
    axes = drawing.subplots()
    apart = min(0.2, 0.7 / len(found))
    for k, (name, levels) in enumerate(found.items()):
        # rounding is no harmonic
        seen = (levels > floor) & (levels > ROUND_OFF * levels.max())
        x = np.flatnonzero(seen) + apart * (k - 0.5 * (len(found) - 1))
        axes.vlines(x, floor, levels[seen], color=CYCLE[k % len(CYCLE)], linewidth=1.4)
        axes.plot(
            x,
            levels[seen],
            linestyle="none",
            marker=MARKERS[k % len(MARKERS)],
            markersize=4,
            color=CYCLE[k % len(CYCLE)],
            label=name,
        )
    axes.set(yscale="log", xlim=(-0.6, count + 0.6), ylim=(floor, 4.0 * top), xticks=range(count + 1))
    axes.set(
        xlabel="harmonic number",
        ylabel=f"$|u_{direction}|$({point})" + (" (m)" if forces is None else " / force (m/N)"),
    )
    axes.yaxis.set_major_locator(LogLocator(numticks=12))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y", color="#E2E2E2", linewidth=0.4)
    axes.set_axisbelow(True)
    axes.set_title(title, fontsize=8, loc="left")
    axes.legend(fontsize=7, frameon=False, loc="upper right")
    style(axes)
    return drawing


# ---------------------------------------------------------------------- one orbit
def plot_orbit(
    orbit: Orbit,
    path: str,
    point: str = "A",
    pairs: dict[str, int] | None = None,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> str | None:
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
    path, title, comm
        As for `plot_curves`.
    """
    return on_root(comm or MPI.COMM_WORLD, lambda: save(_draw_orbit(orbit, point, pairs, title), path))


def _draw_orbit(orbit: Orbit, point: str, pairs, title: str) -> Figure:
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
    factor, unit = _unit(float(np.abs(u).max()))
    speed, speed_unit = _unit(float(np.abs(v).max()))
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
        factor, unit = _unit(max((float(np.abs(g).max()) for g in gaps.values()), default=1.0))
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
        kilo = resultant.max() >= 1000.0
        lower.plot(cycles, resultant * (1e-3 if kilo else 1.0), color=BLACK, linewidth=1.1)
        lower.set_ylabel(f"resultant ({'kN' if kilo else 'N'})")
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
    return drawing


# ---------------------------------------------------------------------- multipliers
def plot_multipliers(
    subject: Orbit | Branch, path: str, title: str = "", comm: MPI.Comm | None = None
) -> str | None:
    """Draw Floquet multipliers with the unit circle; beside it the growth |mu| - 1 a period. Collective.

    The growth is drawn over the argument for an orbit: the angle of a multiplier in turns is the frequency at
    which its disturbance beats with the period of the motion. For a curve the largest one's is drawn along
    it.

    Parameters
    ----------
    subject : Orbit or Branch
        With multipliers; on rank 0 at least.
    path, title, comm
        As for `plot_curves`.
    """
    return on_root(comm or MPI.COMM_WORLD, lambda: save(_draw_multipliers(subject, title), path))


def _draw_multipliers(subject: Orbit | Branch, title: str) -> Figure:
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
        _draw_growth(growth, subject)
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
    return drawing


def _draw_growth(axes, curve: Branch) -> None:
    """Growth of the largest multiplier along a curve, over the parameter, over the arc's number of points
    where it turns back.
    """
    largest = np.abs(curve.multipliers[:, 0]) - 1.0
    turns = bool((np.diff(curve.value)[1:] * np.diff(curve.value)[:-1] < 0.0).any())
    factor, label = (1.0, "point of the curve") if turns else _abscissa({"": curve})
    x = np.arange(float(len(largest))) if turns else curve.value * factor
    marked = [item for item in in_order(curve) if _decides(curve, item)]
    at = [item.after - 0.5 if turns else item.value * factor for item in marked]
    crossings = [
        (item.after, place, 0.0)
        for item, place in zip(marked, at)
        if curve.stable[item.after] != curve.stable[item.after - 1]
    ]
    for stable, places, y in split(x, largest, curve.stable, crossings):
        axes.plot(
            places, y, color=BLUE if stable else VERMILION, linewidth=1.1, linestyle="-" if stable else DASHED
        )
    for stable, colour, marker in ((curve.stable, BLUE, "."), (~curve.stable, VERMILION, "^")):
        axes.plot(x[stable], largest[stable], linestyle="none", marker=marker, markersize=3, color=colour)
    for kind in KINDS:
        chosen = [place for item, place in zip(marked, at) if item.kind == kind]
        if chosen:
            _mark(axes, chosen, np.zeros(len(chosen)), kind, GREEN, kind)
    axes.set_xlabel(label)
    if marked:
        axes.legend(
            fontsize=7,
            frameon=False,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=len(KINDS),
            borderaxespad=0.0,
            handletextpad=0.2,
            columnspacing=1.0,
        )


# ---------------------------------------------------------------------- units
def _divisors(what: str, names, forces: dict[str, float] | None) -> dict[str, float]:
    missing = [name for name in names if forces is not None and not forces.get(name, 0.0) > 0.0]
    if missing:
        raise ValueError(
            f"{what}: forces has no positive force for {missing[0]!r}; give one for each name, or none"
        )
    return {name: 1.0 if forces is None else forces[name] for name in names}


def _abscissa(curves: dict[str, Branch]) -> tuple[float, str]:
    """Factor and label of the parameter."""
    first = next(iter(curves.values()))
    if first.parameter == "load":
        return 1.0, "factor on the load"
    return (
        (1e-3, "frequency (kHz)")
        if max(float(c.value.max()) for c in curves.values()) >= 1e3
        else (1.0, "frequency (Hz)")
    )


def _unit(top: float) -> tuple[float, str]:
    """Factor and name of the unit of length in which a value is written with few digits."""
    for factor, name in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")):
        if top * factor >= 0.5:
            return factor, name
    return 1e9, "nm"
