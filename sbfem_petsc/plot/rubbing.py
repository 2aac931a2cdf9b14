"""Pictures of faces that rub: what they do over time, hysteresis loops, power lost along a crack, and what
losses and harmonics grow with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from ..analysis.load_history import LoadHistory
from ..checks import shown
from ..continuation.orbit import Orbit
from ..indicators.detection import friction_power
from ..motion.history import Motion
from ..motion.states import Point
from .drawing import BLUE, BROKEN, ORANGE, VERMILION, Scale, above, curves, dots
from .picture import Comm, a_text, named, optional, picture, place_name, symbol, whole

Rubbing = LoadHistory | Motion
_KINDS = (Motion, LoadHistory)
# Colours of a face that is apart, sticks, and slips back and forth.
_STATES = {"apart": "#F2F2F2", "sticks": BLUE, "slips back": ORANGE, "slips forth": VERMILION}
# Columns of the map at most: one a pixel; changes of a slip below this share of the largest are rounding.
_COLUMNS, _ROUNDING = 2000, 1e-9


@picture(*_KINDS, crack=optional(a_text))
def plot_slips(
    motion: Rubbing,
    *,
    crack: str | None = None,
    window: tuple[float, float] | None = None,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> Axes | None:
    """Draw where faces are apart, stick and slip, over time and along a crack. Collective.

    Parameters
    ----------
    motion : History, Orbit, LoadHistory or ReducedLoadHistory
        Of faces that rub (`Coulomb`); on rank 0 at least. Of what was read, and of matrices, pairs have
        numbers in the place of positions.
    crack : str, optional
        Default: the first that rubs.
    window : (float, float), optional
        Times shown, s; default: all.
    title : str
    ax, comm
        As for `plot_histories`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    along, place, pairs, _ = _along("plot_slips", motion, crack)
    _, slip, *_ = _rubbed("plot_slips", motion)
    chosen = np.flatnonzero(_within("plot_slips", motion, window))
    chosen = chosen[:: -(-len(chosen) // _COLUMNS)]
    moved = np.diff(slip[chosen], axis=0)
    least = _ROUNDING * np.abs(slip).max(initial=0.0)
    state = np.where(moved > least, 3, np.where(moved < -least, 2, 1))
    state = np.where(motion.contact_force[chosen[1:]] > 0.0, state, 0)[:, pairs]
    (axes,), clock = ax.panels((1, 1), 2.6), Scale.of("time", "s", motion.time[chosen])
    edges = np.concatenate([place[:1], 0.5 * (place[1:] + place[:-1]), place[-1:]])
    colours: Any = {"cmap": ListedColormap(list(_STATES.values())), "vmin": -0.5, "vmax": 3.5}
    axes.pcolormesh(clock(motion.time[chosen]), along(edges), state.T, rasterized=True, **colours)
    for name, colour in _STATES.items():
        dots(axes, ([], []), "s", 6, colour, markeredgecolor="#999999", label=name)
    above(axes)
    axes.set(xlabel=clock.label, ylabel=along.label)
    return axes


@picture(*_KINDS, several=True, pair=optional(whole(0)))
def plot_hysteresis(
    motions: Rubbing | Mapping[str, Rubbing],
    *,
    pair: int | None = None,
    window: tuple[float, float] | None = None,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> Axes | None:
    """Draw the friction of a pair over its slip: the area within a loop is what the pair loses. Collective.

    Parameters
    ----------
    motions : History, Orbit, LoadHistory or ReducedLoadHistory, or dict of str to them
        On rank 0 at least.
    pair : int, optional
        From 0. Default: the one that loses most in the first of them.
    window, title, ax, comm
        As for `plot_slips`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    each: Mapping[str, Rubbing] = named(motions)
    found = {name: _rubbed("plot_hysteresis", motion, window) for name, motion in each.items()}
    if pair is None:
        pair = int(np.argmax(friction_power(*next(iter(found.values())))))
    if pair >= (least := min(slip.shape[1] for _, slip, *_ in found.values())):
        raise ValueError(f"plot_hysteresis: pair = {pair} does not exist; there are {least}")
    drawn = {name: (slip[:, pair], along[:, pair]) for name, (_, slip, along, *_) in found.items()}
    slips, forces = zip(*drawn.values())
    (axes,) = ax.panels((1, 1), 2.9, width=3.6)
    across = Scale.of(f"slip of pair {pair}", "m", *slips)
    curves(axes, drawn, across, Scale.of("friction", "N", *forces), BROKEN, linewidth=1.5)
    above(axes)
    return axes


@picture(*_KINDS, several=True, crack=optional(a_text))
def plot_friction_power(
    motions: Rubbing | Mapping[str, Rubbing],
    *,
    crack: str | None = None,
    window: tuple[float, float] | None = None,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> Axes | None:
    """Draw the mean power that faces lose to friction along a crack, W/m of its length: what warms it in
    vibrothermography. The faces inside tip elements are not among the pairs. Collective.

    Parameters
    ----------
    motions : History, Orbit, LoadHistory or ReducedLoadHistory, or dict of str to them
        On rank 0 at least; of what was read, and of matrices, W of each pair.
    crack : str, optional
        Default: the first that rubs.
    window, title, ax, comm
        As for `plot_slips`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    drawn, numbered = {}, set[bool]()
    each: Mapping[str, Rubbing] = named(motions)
    for name, motion in each.items():
        along, place, pairs, length = _along("plot_friction_power", motion, crack)
        numbered.add(along.label == "pair")
        power = friction_power(*_rubbed("plot_friction_power", motion, window))
        drawn[name] = place, power[pairs] / length
    if len(numbered) > 1:
        raise ValueError(
            "plot_friction_power: some motions know where their pairs are and some only their numbers; draw "
            "them apart"
        )
    (axes,) = ax.panels((1, 1), 2.6)
    up = Scale(1.0, f"power lost to friction ({'W' if True in numbered else 'W/m'})")
    curves(axes, drawn, along, up, marker=".", markersize=3, linewidth=0.9)
    axes.set_ylim(bottom=0.0)
    above(axes)
    return axes


@picture(count=whole(2, 100))
def plot_losses(
    orbits: Sequence[Orbit],
    point: Point = "A",
    direction: str = "y",
    *,
    count: int = 3,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> list[Axes] | None:
    """Draw what periodic motions lose to friction, and their harmonics beside the first, over its amplitude.
    Collective.

    Parameters
    ----------
    orbits : sequence of Orbit
        Under loads that grow, say, of one model whose faces rub; on rank 0 at least, on all ranks for a place
        (x, y).
    point : str or (x, y)
        Name, or m.
    direction : {"y", "x"}
    count : int
        Highest harmonic, at least 2.
    title, ax, comm
        As for `plot_slips`.

    Returns
    -------
    Two axes on rank 0, None elsewhere; `save_picture` writes them
    """
    if not isinstance(orbits, (list, tuple)) or not orbits:
        raise TypeError(f"plot_losses: orbits = {shown(orbits)} must be a sequence of Orbits")
    losses = []
    for k, orbit in enumerate(orbits):
        if not isinstance(orbit, Orbit) or orbit.friction_loss is None:
            raise TypeError(f"plot_losses: orbits[{k}] = {shown(orbit)} is no Orbit of faces that rub")
        losses.append(orbit.friction_loss / orbit.periods)
    levels = np.array([np.abs(orbit.harmonics(point, direction)[: count + 1]) for orbit in orbits])
    order = np.argsort(levels[:, 1])
    levels = levels[order]
    if not levels[0, 1] > 0.0:
        raise ValueError(f"plot_losses: point {point!r} does not move in {direction} in one of the motions")
    first = levels[:, 1]
    u = f"${symbol(orbits[0], direction, point)}$({place_name(point)})"
    across = Scale.of(f"first harmonic of {u}", "m", first)
    harmonics = {f"harmonic {k}": (first, levels[:, k] / first) for k in range(2, levels.shape[1])}
    panels = ax.panels((2, 1), 4.2, sharex=True)
    loss = {"": (first, np.array(losses)[order])}
    for axes, drawn, label in zip(
        panels, (loss, harmonics), ("lost to friction a period (J)", "beside the first harmonic")
    ):
        curves(axes, drawn, across, Scale(1.0, label), marker=".", linewidth=1.5)
        axes.set_ylim(bottom=0.0)
    above(panels[1])
    return panels


def _within(owner: str, motion: Rubbing, window: tuple[float, float] | None) -> np.ndarray:
    """(n,): instants that are shown."""
    start, stop = window or (-np.inf, np.inf)
    seen = (motion.time >= start) & (motion.time <= stop)
    if seen.sum() < 2:
        raise ValueError(f"{owner}: window = {window!r} has fewer than two instants")
    return seen


def _rubbed(
    owner: str, motion: Rubbing, window: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """Times, and of (n, pairs) each slips, friction, and ways where they are known."""
    slip, along = motion.slip, motion.friction_force
    if slip is None or along is None or not slip.shape[1]:
        raise ValueError(
            f"{owner}: nothing rubs in {shown(motion)}; give a motion of a model with contact_laws of Coulomb"
        )
    seen, slid = _within(owner, motion, window), motion.slid if isinstance(motion, LoadHistory) else None
    return motion.time[seen], slip[seen], along[seen], None if slid is None else slid[seen]


def _along(owner: str, motion: Rubbing, crack: str | None) -> tuple[Scale, np.ndarray, np.ndarray, Any]:
    """Scale of the places of a crack's pairs, these in the order in which they are met, m, the pairs' numbers
    and the length of face of each, m; without a model the numbers themselves, and 1.
    """
    _, slip, *_ = _rubbed(owner, motion)
    of = motion.states[0] if isinstance(motion, LoadHistory) else motion.reduced
    model = None if of is None else of.model
    if model is None:
        if crack is not None:
            raise ValueError(f"{owner}: crack = {crack!r}, and the motion does not know which pairs it has")
        pairs = np.arange(slip.shape[1])
        return Scale(1.0, "pair"), pairs, pairs, 1.0
    names = [item.name for item in model.cracks]
    if crack is not None and crack not in names:
        raise ValueError(f"{owner}: crack = {crack!r} does not exist; the model has {', '.join(names)}")
    rubs = [name for name in names if name in model.contact_laws and model.contact_laws[name].rubs]
    chosen = rubs[0] if crack is None else crack
    own = np.flatnonzero(model.pairs.crack == names.index(chosen))
    own = own[np.argsort(model.pairs.arc[own], kind="stable")]
    place = model.pairs.arc[own]
    return Scale.of(f"along {chosen}", "place", place), place, own, model.pairs.weight[own]
