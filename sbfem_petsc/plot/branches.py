"""Pictures of branches: amplitudes over the frequency or the load, stable and unstable parts,
bifurcations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import PchipInterpolator

from ..analysis.backbone import Backbone
from ..checks import instance
from ..continuation.bifurcations import Bifurcation
from ..continuation.branch import Branch
from ..parallel import agreed, collective, on_root
from ..petsc import MPI
from .arguments import check
from .drawing import BLACK, BLUE, CYCLE, GREEN, VERMILION, by_name, figure, style
from .units import divisors, frequency_unit, length_unit

GREY = "#8A8A8A"
KINDS = {"fold": "o", "period doubling": "s", "Neimark-Sacker": "^", "branch point": "D", "grazing": "v"}
DASHED = (0, (3.0, 1.6))
# Lines between two points of a branch.
BETWEEN = 12


@agreed("branches", "backbone")
def plot_branches(
    branches: Branch | Mapping[str, Branch],
    point: str = "A",
    *,
    forces: Mapping[str, float] | None = None,
    window: tuple[float, float] | None = None,
    title: str = "",
    every: bool = False,
    backbone: Backbone | None = None,
    comm: MPI.Comm | None = None,
) -> Axes | None:
    """Draw branches in one picture: stable parts solid, unstable parts dashed, bifurcations marked by
    their kind. Collective.

    Responses without contact are grey lines. Between the points that were computed the lines are monotone
    cubics.

    Parameters
    ----------
    branches : Branch or dict of str to Branch
        All over the frequency, or all over the load; on rank 0 at least.
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
    backbone : Backbone, optional
        Free motions of the mode, on which the peaks stand as damping falls: a dotted line below branches over
        the frequency, without `forces`.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    check("plot_branches", point=point, forces=forces, window=window, title=title, every=every, comm=comm)
    named = by_name("plot_branches", branches, Branch)
    with collective(comm or MPI.COMM_WORLD):
        if backbone is not None:
            instance("plot_branches", "backbone", backbone, Backbone, "a Backbone")
            if forces is not None or any(curve.parameter == "load" for curve in named.values()):
                raise ValueError(
                    "plot_branches: backbone has its place below branches over the frequency whose "
                    "amplitudes are not divided by forces; leave it out"
                )
    return on_root(
        comm or MPI.COMM_WORLD, lambda: _draw(named, point, forces, backbone, _Frame(window, title, every))
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
        value=np.array([item.own_value]),
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
    x, y = (
        np.concatenate([pieces[0][:1], *(piece[1:] for piece in pieces)])
        for pieces in ([part[1] for part in parts], [part[2] for part in parts])
    )
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


class _Frame(NamedTuple):
    """The part of the parameter that is shown, the title, and whether all bifurcations are marked."""

    window: tuple[float, float] | None
    title: str
    every: bool


def _draw(
    curves: Mapping[str, Branch],
    point: str,
    forces,
    backbone: Backbone | None,
    frame: _Frame,
) -> Axes:
    window, title, every = frame
    if not curves:
        raise ValueError("plot_branches: no branch is given")
    if len({curve.parameter for curve in curves.values()}) > 1:
        raise ValueError(
            "plot_branches: some branches are over the frequency and some over the load; draw them apart"
        )
    divisor = divisors("plot_branches", curves, forces)
    heights = {name: curve.amplitude(point) / divisor[name] for name, curve in curves.items()}
    factor, unit = length_unit(max(float(h.max()) for h in heights.values()))
    along, label = abscissa(curves)
    drawing = figure(3.6)
    axes = drawing.subplots()
    colour, kinds, dashed = iter(CYCLE * len(curves)), set(), False
    for name, curve in curves.items():
        if not curve.period.pairs:
            axes.plot(
                curve.value * along,
                heights[name] * factor,
                color=GREY,
                linewidth=1.6,
                zorder=1.5,
                label=name or "_",
            )
            continue
        shade = next(colour)
        found = in_order(curve)
        marks = [
            (item.after, item.own_value, amplitude_at(curve, item, point) / divisor[name]) for item in found
        ]
        # the legend shows the solid line whichever part comes first
        axes.plot([], [], color=shade, linewidth=1.1, label=name or "_")
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
        for item, (_, at, height) in zip(found, marks):
            if every or _decides(curve, item):
                _mark(axes, at * along, height * factor, item.kind, shade)
                kinds.add(item.kind)
    limits = window or (
        min(float(c.value.min()) for c in curves.values()),
        max(float(c.value.max()) for c in curves.values()),
    )
    top = axes.get_ylim()[1]
    if backbone is not None:
        axes.plot(
            backbone.frequency * along,
            backbone.amplitude(point) * factor,
            color=BLACK,
            linewidth=1.1,
            linestyle=":",
            zorder=1.6,
            label="free motion",
        )
        axes.set_ylim(top=top)
    if dashed:
        axes.plot([], [], color=BLACK, linewidth=1.1, linestyle=DASHED, label="unstable")
    for kind in KINDS:
        if kind in kinds:
            _mark(axes, [], [], kind, BLACK, kind)
    axes.set(
        xlim=(limits[0] * along, limits[1] * along),
        xlabel=label,
        ylabel=f"amplitude of $u_y$({point})" + (f" ({unit})" if forces is None else f" / force ({unit}/N)"),
    )
    axes.set_ylim(bottom=0.0)
    axes.set_title(title, fontsize=8, loc="left")
    if any(curves) or dashed or kinds:
        axes.legend(fontsize=7, frameon=False)
    style(axes)
    return axes


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


def draw_growth(axes: Axes, curve: Branch) -> None:
    """Growth of the largest multiplier along a curve, over the parameter, over the arc's number of points
    where it turns back.
    """
    largest = np.abs(curve.multipliers[:, 0]) - 1.0
    turns = bool((np.diff(curve.value)[1:] * np.diff(curve.value)[:-1] < 0.0).any())
    factor, label = (1.0, "point of the curve") if turns else abscissa({"": curve})
    x = np.arange(float(len(largest))) if turns else curve.value * factor
    marked = [item for item in in_order(curve) if _decides(curve, item)]
    at = [item.after - 0.5 if turns else item.own_value * factor for item in marked]
    crossings = [
        (item.after, place, 0.0)
        for item, place in zip(marked, at)
        if curve.stable[item.after] != curve.stable[item.after - 1]
    ]
    for stable, places, y in split(x, largest, curve.stable, crossings):
        axes.plot(
            places, y, color=BLUE if stable else VERMILION, linewidth=1.1, linestyle="-" if stable else DASHED
        )
    for rows, colour, marker in ((curve.stable, BLUE, "."), (~curve.stable, VERMILION, "^")):
        axes.plot(x[rows], largest[rows], linestyle="none", marker=marker, markersize=3, color=colour)
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


def abscissa(curves: Mapping[str, Branch]) -> tuple[float, str]:
    """Factor and label of the parameter."""
    first = next(iter(curves.values()))
    if first.parameter == "load":
        return 1.0, "factor on the load"
    factor, unit = frequency_unit(max(float(c.value.max()) for c in curves.values()))
    return factor, f"frequency ({unit})"
