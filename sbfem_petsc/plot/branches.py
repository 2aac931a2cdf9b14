"""Pictures of branches: amplitudes over the frequency or the load, tones of their own, free motions over
their energy; stable and unstable parts, bifurcations.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import PchipInterpolator

from ..checks import instance
from ..continuation.bifurcations import Bifurcation
from ..continuation.branch import Branch
from ..continuation.orbit import Orbit
from ..continuation.problems.curve_branch import QuasiPeriodicBranch
from ..continuation.problems.free_branch import Backbone
from ..motion.states import Point
from .drawing import BLACK, BLUE, CYCLE, DASHED, GREEN, GREY, VERMILION, Scale, above, dots, legend
from .picture import Comm, divisors, named, picture, place_name, symbol, whole

KINDS = {"fold": "o", "period doubling": "s", "Neimark-Sacker": "^", "branch point": "D", "grazing": "v"}
# Lines between two points of a branch.
BETWEEN = 12
# Frequencies that differ by less, relative, are drawn as one.
FLAT = 1e-5

Part = tuple[bool, np.ndarray, np.ndarray]
Marks = Sequence[tuple[int, float, float]]


@dataclass(frozen=True)
class Height:
    """What is drawn of periodic motions: half the peak-to-peak of a displacement, or one of its harmonics.

    Attributes
    ----------
    point : str or (x, y)
    direction : {"x", "y"}
    harmonic : int or None
    """

    point: Point
    direction: str = "y"
    harmonic: int | None = None

    def of(self, motions: Branch | Backbone | Orbit) -> Any:
        """(n,) of the points of a branch, or of one motion, m."""
        if self.harmonic is None:
            return motions.amplitude(self.point, self.direction)
        return np.abs(motions.harmonics(self.point, self.direction)[..., self.harmonic])

    def label(self, curves: Mapping[str, Branch]) -> str:
        """In words, for an axis."""
        what = "amplitude" if self.harmonic is None else f"harmonic {self.harmonic}"
        return f"{what} of ${symbol(curves, self.direction, self.point)}$({place_name(self.point)})"


@picture(Branch, several=True)
def plot_branches(
    branches: Branch | Mapping[str, Branch],
    point: Point = "A",
    direction: str = "y",
    *,
    harmonic: int | None = None,
    forces: Mapping[str, float] | None = None,
    window: tuple[float, float] | None = None,
    title: str = "",
    every: bool = False,
    backbone: Backbone | None = None,
    ax: Any = None,
    comm: Comm = None,
) -> Axes | None:
    """Draw branches in one picture: stable parts solid, unstable parts dashed, bifurcations marked by
    their kind. Collective.

    Responses without contact are grey lines. Between the points that were computed the lines are monotone
    cubics.

    Parameters
    ----------
    branches : Branch or dict of str to Branch
        All over the same parameter; on rank 0 at least, on all ranks for a place (x, y).
    point : str or (x, y)
        Name, or m. Motions at a place are integrated again.
    direction : {"y", "x"}
        Of the displacement whose amplitude, half the peak-to-peak, is drawn; for x motions are integrated
        again.
    harmonic : int, optional
        Draw the modulus of this harmonic instead.
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
    ax : axes, sequence of axes, figure or subfigure of Matplotlib, optional
        What is drawn on. Default: a new figure.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    curves = named(branches)
    along = abscissa("plot_branches", curves)
    if backbone is not None:
        instance("plot_branches", "backbone", backbone, Backbone, "a Backbone")
        if forces is not None or "frequency" not in along.label:
            raise ValueError(
                "plot_branches: backbone has its place below branches over the frequency whose "
                "amplitudes are not divided by forces; leave it out"
            )
    height, divisor = Height(point, direction, harmonic), divisors("plot_branches", curves, forces)
    heights = {name: height.of(curve) / divisor[name] for name, curve in curves.items()}
    words, per = height.label(curves), "" if forces is None else "/N"
    up = Scale.of(words + (" / force" if per else ""), "m", *heights.values(), per=per)
    (axes,) = ax.panels((1, 1), 3.6)
    shades, kinds = itertools.cycle(CYCLE), set[str]()
    for name, curve in curves.items():
        x, y = along(curve.value), up(heights[name])
        if not curve.contact:
            axes.plot(x, y, color=GREY, linewidth=1.6, zorder=1.5, label=name)
            continue
        shade, marks = next(shades), marks_of(curve, height, along, up, divisor[name])
        draw_parts(axes, split(x, y, ~curve.unstable, marks), shade, name)
        for item, (_, *at) in zip(curve.bifurcations, marks):
            if every or _decides(curve, item):
                _mark(axes, at, item.kind, shade)
                kinds.add(item.kind)
    top = axes.get_ylim()[1]
    if backbone is not None:
        free = smooth(along(backbone.frequency), up(height.of(backbone)))
        axes.plot(*free, color=BLACK, linewidth=1.1, linestyle=":", zorder=1.6, label="free motion")
    name_verdicts(axes, (curve for curve in curves.values() if curve.contact))
    for kind in filter(kinds.__contains__, KINDS):
        _mark(axes, ([], []), kind, BLACK, kind)
    values = np.concatenate([curve.value for curve in curves.values()])
    start, stop = window or (values.min(), values.max())
    axes.set(xlim=(along(start), along(stop)), ylim=(0.0, top), xlabel=along.label, ylabel=up.label)
    legend(axes)
    return axes


def marks_of(curve: Branch, height: Height, along: Scale, up: Scale, divisor: float = 1.0) -> Marks:
    """The bifurcations of a curve for `split`, in order; parameter and height as they are drawn."""
    return [
        (item.after, along(item.own_value), up(height.of(curve.orbit(item)) / divisor))
        for item in curve.bifurcations
    ]


def draw_parts(axes: Axes, parts: Iterable[Part], colour: str, name: str = "", width: float = 1.1) -> None:
    """Draw the parts of a curve, stable ones solid, unstable ones dashed, with its name in the legend."""
    axes.plot([], [], color=colour, linewidth=width, label=name)
    for stable, x, y in parts:
        axes.plot(x, y, color=colour, linewidth=width, linestyle="-" if stable else DASHED, zorder=2)


def name_verdicts(axes: Axes, curves: Iterable[Any]) -> None:
    """Entries of the legend for stable and unstable parts, where there are unstable ones."""
    if any(curve.unstable.any() for curve in curves):
        for name, dashes in (("stable", "-"), ("unstable", DASHED)):
            axes.plot([], [], color=BLACK, linewidth=1.1, linestyle=dashes, label=name)


def split(
    value: np.ndarray, height: np.ndarray, stable: np.ndarray, marks: Marks = (), between: int = BETWEEN
) -> list[Part]:
    """Stable and unstable parts of a curve, each beginning where the one before it ends.

    Parameters
    ----------
    value, height, stable : (n,) arrays
        Points in order of arc length.
    marks : sequence of (after, value, height)
        Bifurcations between the points after - 1 and after, in order: vertices of the curve, and ends of
        parts where the verdict changes. Without one the verdict changes half-way between two points.
    between : int
        See `smooth`.

    Returns
    -------
    list of (stable, value, height)
    """
    points, changes = np.column_stack([value, height]), np.flatnonzero(np.diff(stable)) + 1
    half_way = [(k, *points[k - 1 : k + 1].mean(axis=0)) for k in {*changes} - {k for k, *_ in marks}]
    vertices = np.array(sorted([*marks, *half_way], key=lambda mark: mark[0])).reshape(-1, 3)
    after = vertices[:, 0].astype(int)
    points = np.insert(points, after, vertices[:, 1:], axis=0)
    # of several the verdict changes at the first where it is lost, at the last where it is won
    first, last = np.searchsorted(after, changes), np.searchsorted(after, changes, side="right") - 1
    ends = changes + np.where(stable[changes - 1], first, last)
    spans = itertools.pairwise(between * np.array([0, *ends, len(points) - 1]))
    line = points if between == 1 else smooth(points[:, 0], points[:, 1], between).T
    return [(bool(stable[k]), *line[begin : end + 1].T) for k, (begin, end) in zip([0, *changes], spans)]


def smooth(x: np.ndarray, y: np.ndarray, between: int = BETWEEN) -> np.ndarray:
    """(2, m): a curve through some points, with so many lines between two of them: monotone cubics of the arc
    length, without overshoot. Results keep no tangents: points stand so near to each other that these cubics
    are within 2e-4 to 1.2e-3 of a picture's size of curves with many more, a third of the line's width.
    """
    points = np.column_stack([x, y])
    size = np.ptp(points, axis=0)
    lengths = np.linalg.norm(np.diff(points / np.where(size > 0.0, size, 1.0), axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    apart = np.concatenate([[True], np.diff(arc) > 1e-9 * arc[-1]])
    fine = np.interp(np.arange(between * len(lengths) + 1) / between, np.arange(len(arc)), arc)
    if apart.sum() < 2:
        return np.repeat(points[:1], len(fine), axis=0).T
    return PchipInterpolator(arc[apart], points[apart])(np.clip(fine, 0.0, arc[apart][-1])).T


def _decides(curve: Branch, item: Bifurcation) -> bool:
    """Whether a bifurcation is marked in any case: it changes the verdict, or other branches begin or turn
    there.
    """
    return item.kind not in ("Neimark-Sacker", "grazing") or bool(
        curve.stable[item.after] != curve.stable[item.after - 1]
    )


def _mark(axes: Axes, at: Any, kind: str, colour: str, label: str = "") -> None:
    style: Any = {"markerfacecolor": "white", "markeredgewidth": 0.8, "zorder": 3, "label": label}
    dots(axes, at, KINDS[kind], 4, colour, **style)


def draw_growth(axes: Axes, curve: Branch) -> None:
    """Growth of the largest multiplier along a curve, over the parameter, over the arc's number of points
    where it turns back.
    """
    largest = np.abs(curve.multipliers[:, 0]) - 1.0
    turns = bool((np.diff(curve.value)[1:] * np.diff(curve.value)[:-1] < 0.0).any())
    across = Scale(1.0, "point of the curve") if turns else abscissa("plot_multipliers", {"": curve})
    x = across(np.arange(len(largest)) if turns else curve.value)
    marked = [item for item in curve.bifurcations if _decides(curve, item)]
    at = [across(item.after - 0.5 if turns else item.own_value) for item in marked]
    crossings = [
        (item.after, place, 0.0)
        for item, place in zip(marked, at)
        if curve.stable[item.after] != curve.stable[item.after - 1]
    ]
    for part in split(x, largest, curve.stable, crossings, between=1):
        draw_parts(axes, [part], BLUE if part[0] else VERMILION)
    for rows, colour, marker in ((curve.stable, BLUE, "."), (~curve.stable, VERMILION, "^")):
        dots(axes, (x[rows], largest[rows]), marker, 3, colour)
    for item, place in sorted(zip(marked, at), key=lambda found: [*KINDS].index(found[0].kind)):
        _mark(axes, (place, 0.0), item.kind, GREEN, item.kind)
    axes.set_xlabel(across.label)
    above(axes, handletextpad=0.2)


def abscissa(owner: str, curves: Mapping[str, Any], words: str = "frequency") -> Scale:
    """Of branches over one parameter; ValueError for others."""
    over = {curve.parameter for curve in curves.values()}
    if len(over) > 1:
        raise ValueError(
            f"{owner}: some branches are over the {' and some over the '.join(sorted(over))}; draw them apart"
        )
    (parameter,) = over
    if parameter != "frequency":
        return Scale(1.0, f"factor on the {parameter}")
    return Scale.of(words, "Hz", *(curve.value for curve in curves.values()))


@picture(Backbone, several=True)
def plot_backbone(
    backbones: Backbone | Mapping[str, Backbone], *, title: str = "", ax: Any = None, comm: Comm = None
) -> Axes | None:
    """Draw frequencies of free motions over their energy, broken where they are unstable, and below them the
    damping ratios where there are damped motions; monotone cubics between their points. Collective.

    Parameters
    ----------
    backbones : Backbone or dict of str to Backbone
        On rank 0 at least.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes of the frequencies on rank 0, None elsewhere; `save_picture` writes the whole picture
    """
    curves = named(backbones)
    up = Scale.of("frequency of free vibration", "Hz", *(backbone.frequency for backbone in curves.values()))
    damped = any(backbone.damped for backbone in curves.values())
    panels = ax.panels((1 + damped, 1), 4.6 if damped else 3.0, sharex=True)
    for colour, (name, backbone) in zip(itertools.cycle(CYCLE), curves.items()):
        drawn = [up(backbone.frequency)] + [backbone.damping_ratio] * backbone.damped
        for panel, values in zip(panels, drawn):
            parts = split(np.log10(backbone.energy), values, ~backbone.unstable)
            drawn_parts = [(stable, 10.0**energy, value) for stable, energy, value in parts]
            draw_parts(panel, drawn_parts, colour, name, 1.2)
    axes = panels[0]
    name_verdicts(axes, curves.values())
    for panel, label in zip(panels, (up.label, "damping ratio (decay)")):
        panel.set(xscale="log", xlabel="energy (J)", ylabel=label)
        panel.tick_params(axis="x", which="minor", labelsize=7)
        panel.margins(y=0.1)
    legend(axes)
    low, high = axes.get_ylim()
    middle, half = 0.5 * (low + high), 0.5 * max(high - low, FLAT * high)
    axes.set_ylim(middle - half, middle + half)
    return axes


@picture(QuasiPeriodicBranch, several=True, harmonic=whole(1, 20))
def plot_quasi_periodic(
    branches: QuasiPeriodicBranch | Mapping[str, QuasiPeriodicBranch],
    point: Point = "A",
    direction: str = "y",
    *,
    harmonic: int = 1,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> list[Axes] | None:
    """Draw branches of motions with a tone of their own: the tone's amplitude and, below it, its frequency
    over the branch's parameter; unstable parts dashed. Collective.

    Parameters
    ----------
    branches : QuasiPeriodicBranch or dict of str to QuasiPeriodicBranch
        All over the same parameter; on rank 0 at least, on all ranks for a place (x, y).
    point : str or (x, y)
        Name, or m. Motions at a place are integrated again.
    direction : {"y", "x"}
    harmonic : int
        The multiple of the own tone whose amplitude is drawn.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Two axes on rank 0, None elsewhere; `save_picture` writes them
    """
    curves = named(branches)
    along = abscissa("plot_quasi_periodic", curves, "forcing frequency")
    found = {
        name: (np.abs(branch.line(0, harmonic, point, direction)), branch.frequencies[:, 1])
        for name, branch in curves.items()
    }
    of = "" if harmonic == 1 else f"harmonic {harmonic} of the "
    label = f"{of}own tone of ${symbol(curves, direction, point)}$({place_name(point)})"
    heights, tones = zip(*found.values())
    scales = Scale.of(label, "m", *heights), Scale.of("its frequency", "Hz", *tones)
    panels = ax.panels((2, 1), 4.6, sharex=True)
    for colour, (name, branch) in zip(itertools.cycle(CYCLE), curves.items()):
        x = along(branch.value)
        for axes, scale, values in zip(panels, scales, found[name]):
            draw_parts(axes, split(x, scale(values), ~branch.unstable), colour, name, 1.2)
            dots(axes, (x, scale(values)), ".", 3, colour)
            axes.set(xlabel=along.label, ylabel=scale.label)
    name_verdicts(panels[0], curves.values())
    panels[0].set_ylim(bottom=0.0)
    legend(panels[0])
    return panels
