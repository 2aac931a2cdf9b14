"""Maps: a sweep's indicators over its parameters (or curves of them), what is detected by them, basins of
attraction over two initial values.
"""

from __future__ import annotations

import math
import os
import re
import textwrap
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize, to_rgb

from ..checks import real_array
from ..continuation.basins import Basins, StartAxis
from .drawing import BLACK, CYCLE, MARKED, STYLE, Scale, Sheet, bar, curves, dots, legend, save_picture
from .picture import Comm, picture, table_of

# Rows of equal values of the parameters that are no axes, with these values in words.
Families = Sequence[tuple[str, list[int]]]
# Quantities that are drawn without being asked for: indicators of damage.
_INDICATORS = re.compile(
    r"(frequency_shift|A[2-6]_A1(_noisy)?|modulation_index(_noisy)?|peak_frequency|contact_resultant)(/|$)"
)
# Values of a key up to which it is drawn as a family of curves, not as an axis.
_CURVES = 8
# Inches: type can be read where a picture is as wide as the screen of a phone.
NARROW = 4.4
# Ratios below this are the rounding of responses without contact.
ROUND_OFF = 1e-12
UNSETTLED = "#BBBBBB"
# Share of white in the colour of a basin, in which the orbits' marks are to be seen.
LIGHT = 0.55


def draw_sweep(sweep: Any, folder: str) -> None:
    """Draw the indicators of a sweep (frequency shifts, ratios of harmonics, modulation indices), one picture
    a quantity with a panel for each point or entry, with and without noise: maps over two numeric parameters
    with several values, curves over one.

    Parameters
    ----------
    sweep : Sweep
    folder : str
        Made if it is missing.

    Raises
    ------
    ValueError
        If no parameter has two numeric values.
    """
    os.makedirs(folder, exist_ok=True)
    groups: dict[str, tuple[str, dict[str, np.ndarray]]] = {}
    for name in filter(_INDICATORS.search, sweep.values):
        _, columns = groups.setdefault(sweep.picture_name(name), (sweep.units.get(name, "1"), {}))
        columns |= _columns(sweep, name)
    for name, (unit, columns) in groups.items():
        save_picture(indicator_figure(sweep, columns, unit), os.path.join(folder, f"{name}.png"))


def _columns(sweep: Any, name: str) -> dict[str, np.ndarray]:
    """Real columns of a quantity by what they are, the first of an array's."""
    array, words = sweep.values[name], sweep.value_words[name]
    values = np.abs(array) if np.iscomplexobj(array) else array
    if values.ndim == 1:
        return {words: values}
    flat = values.reshape(len(values), -1)
    return {f"{words}, {k + 1}": flat[:, k] for k in range(min(3, flat.shape[1]))}


def indicator_figure(sweep: Any, columns: Mapping[str, np.ndarray], unit: str) -> Any:
    """A figure of one quantity over the sweep's parameters.

    Parameters
    ----------
    sweep : Sweep
    columns : dict of str to (n,) array
        A row each, by what they are: a panel each.
    unit : str
    """
    counts = {n: len(np.unique(c)) for n, c in sweep.inputs.items() if c.dtype.kind in "fi"}
    axes = sorted((n for n in counts if counts[n] > 1), key=lambda n: -counts[n])
    if not axes:
        raise ValueError("no parameter of the sweep has two numeric values to draw over")
    table = np.stack(list(columns.values()))
    if unit == "1":  # smaller ratios are rounding
        unit, table = "", np.where(table > 0.0, np.maximum(table, ROUND_OFF), table)
    scales = [Scale.of(words, unit, table) for words in columns]
    grid = len(axes) >= 2 and counts[axes[1]] > 2
    over = axes[: 2 if grid else 1]
    others = [name for name in sweep.inputs if name not in over and _matters(sweep, name, table)]
    families = [
        (", ".join(_value(sweep, name, value) for name, value in zip(others, key)), rows)
        for key, rows in _alike(sweep, others).items()
    ]
    sheet = Sheet("draw_sweep", None)
    drawn = {textwrap.fill(scale.label, 28): scale(values) for scale, values in zip(scales, table)}
    with rc_context(STYLE):
        (_maps if grid else _curves)(sheet, sweep, over, families[:_CURVES], drawn)
        if len(families) > _CURVES:
            words = f"the first {_CURVES} of {len(families)} combinations of the other parameters"
            sheet.figure.suptitle(words)
        sheet.finished(sheet.own, "")
    return sheet.figure


def _alike(sweep: Any, names: Sequence[str]) -> dict[tuple, list[int]]:
    """Rows with the same values of some parameters, by these."""
    alike: dict[tuple, list[int]] = {}
    for row, *key in zip(range(len(sweep)), *(sweep.inputs[name].tolist() for name in names)):
        alike.setdefault(tuple(key), []).append(row)
    return alike


def _matters(sweep: Any, name: str, table: np.ndarray) -> bool:
    """Whether values change, in some row, with one parameter alone; True where no rows tell."""
    alike = _alike(sweep, [other for other in sweep.inputs if other != name])
    told = [rows for rows in alike.values() if len(rows) > 1]
    return not told or not all(
        np.allclose(table[:, rows], table[:, rows[:1]], rtol=1e-9, atol=0.0, equal_nan=True) for rows in told
    )


def _scale(sweep: Any, name: str) -> Scale:
    """Of a numeric parameter: "depth of notch 1 (mm)"."""
    return Scale.of(sweep.input_words[name], sweep.input_units.get(name, ""), sweep.inputs[name])


def _value(sweep: Any, name: str, value: Any) -> str:
    """A parameter's value, "force of drive along y = 300 N"."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return f"{sweep.input_words[name]} = {value}"
    scale = _scale(sweep, name)
    return f"{sweep.input_words[name]} = {scale(value):g} {scale.unit}".rstrip()


def _curves(
    sheet: Sheet, sweep: Any, over: Sequence[str], families: Families, columns: Mapping[str, np.ndarray]
) -> None:
    """Curves over one parameter, one each combination of the others, below one another."""
    panels = sheet.panels((len(columns), 1), 0.6 + 2.1 * len(columns), NARROW, sharex=True)
    along, places = _scale(sweep, over[0]), sweep.inputs[over[0]]
    ordered = {text: sorted(rows, key=places.__getitem__) for text, rows in families}
    for panel, (label, values) in zip(panels, columns.items()):
        drawn = {text: (places[rows], values[rows]) for text, rows in ordered.items()}
        curves(panel, drawn, along, Scale(1.0, label), MARKED, markersize=3, linewidth=1)
        if _logarithmic(values):
            panel.set_yscale("log")
    if any(ordered):
        legend(panels[0], sheet.figure, loc="outside lower left")


def _logarithmic(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite) and finite.min() > 0.0 and finite.max() > 30.0 * finite.min())


def _maps(
    sheet: Sheet, sweep: Any, over: Sequence[str], families: Families, columns: Mapping[str, np.ndarray]
) -> None:
    """Maps over two parameters, one each combination of the others, with one bar for each column."""
    across, up = (_scale(sweep, name) for name in over)
    x, y = (sweep.inputs[name] for name in over)
    wide = min(2, len(families))
    each = -(-len(families) // wide) * wide  # panels of a column
    lines = each // wide * len(columns)
    panels = sheet.panels((lines, wide), 0.4 + 2.2 * lines, NARROW + 1.4 * (wide - 1))
    for number, (label, values) in enumerate(columns.items()):
        own = panels[number * each : (number + 1) * each]
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
        norm = LogNorm(low, high) if _logarithmic(values) else Normalize(low, high)
        for panel, (text, rows) in zip(own, families):
            drawn = _map(panel, across(x[rows]), up(y[rows]), values[rows], norm)
            panel.set(xlabel=across.label, ylabel=up.label)
            panel.set_title(text, fontsize=7)
        for panel in own[len(families) :]:
            panel.set_axis_off()
        bar(drawn, own, label)


def _map(panel: Any, x: np.ndarray, y: np.ndarray, z: np.ndarray, norm: Any) -> Any:
    """One map, or points where they are no grid."""
    xs, ys = np.unique(x), np.unique(y)
    if len(xs) * len(ys) != len(set(zip(x.tolist(), y.tolist()))):
        return panel.scatter(x, y, c=z, norm=norm, cmap="viridis", s=12)
    table = np.full((len(ys), len(xs)), np.nan)
    table[np.searchsorted(ys, y), np.searchsorted(xs, x)] = z
    return panel.pcolormesh(xs, ys, table, norm=norm, cmap="viridis", shading="nearest")


@picture()
def plot_detection(
    depth: Any,
    place: Any,
    probability: Mapping[str, Any],
    *,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
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
    depths = real_array(owner, "depth", depth, 1, "m")
    places = real_array(owner, "place", place, depths.shape, "m")
    each = table_of(lambda owner, name, item: real_array(owner, name, item, depths.shape), "array")
    chances = each(owner, "probability", probability)
    steps, along = np.unique(depths), np.unique(places)
    if not len(steps) * len(along) == len(set(zip(depths, places))) == len(depths):
        raise ValueError(
            f"{owner}: {len(depths)} cracks of {len(steps)} depths at {len(along)} places were given; every "
            "depth at every place is expected, once"
        )
    ratios = [2.0] + [1.0] * len(chances)
    mean, *maps = panels = ax.panels((1, len(ratios)), 2.6, 1.4 + 1.6 * len(ratios), width_ratios=ratios)
    up, across = Scale.of("crack depth", "place", depths), Scale.of("position", "place", places)
    means = {name: (steps, [chance[depths == at].mean() for at in steps]) for name, chance in chances.items()}
    curves(mean, means, up, Scale(1.0, "probability, mean of positions"), MARKED, markersize=3.5)
    mean.set_ylim(-0.02, 1.02)
    mean.legend(loc="lower right")
    mean.grid()
    for panel, (name, chance) in zip(maps, chances.items()):
        drawn = _map(panel, across(places), up(depths), chance, Normalize(0.0, 1.0))
        panel.set(title=name, xlabel=across.label)
    maps[0].set_ylabel(up.label)
    bar(drawn, maps, "probability of detection")
    return panels


@picture(Basins)
def plot_basins(basins: Basins, *, title: str = "", ax: Any = None, comm: Comm = None) -> Axes | None:
    """Draw which orbit each initial state of a grid of two axes leads to. Collective.

    The orbits' own states at t = 0 are marked where they fall in the plane, unstable ones by a cross; of a
    model with several modes they are its two coordinates alone. What has not settled is grey.

    Parameters
    ----------
    basins : Basins
        Of two axes with at least two values each; on rank 0 at least.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them

    Raises
    ------
    TypeError, ValueError
        For something else than basins over two axes.
    """
    if len(basins.axes) != 2 or min(basins.reached.shape) < 2:
        raise ValueError(
            f"plot_basins: basins has {len(basins.axes)} axes and the shape {basins.reached.shape}; a "
            "grid of two axes with at least two values each is expected"
        )
    scales = across, up = [_start_scale(axis) for axis in basins.axes]
    first, second = (scale(axis.values) for scale, axis in zip(scales, basins.axes))
    colours = [colour for colour, _ in zip(cycle(CYCLE), basins.orbits)]
    pale = [tuple((1.0 - LIGHT) * np.array(to_rgb(colour)) + LIGHT) for colour in colours]
    (axes,) = ax.panels((1, 1), 3.6, 5.2)
    look: Any = {"cmap": ListedColormap([to_rgb(UNSETTLED), *pale]), "vmin": -1.5, "vmax": len(pale) - 0.5}
    axes.pcolormesh(first, second, basins.reached.T, shading="nearest", rasterized=True, **look)
    for k, (orbit, share, colour) in enumerate(zip(basins.orbits, basins.share, colours)):
        x, y = _place(basins, orbit.state)
        times = f"{orbit.periods} periods" if orbit.periods > 1 else "1 period"
        reached = f"{100.0 * share:.3g} %" if orbit.stable is not False else "unstable"
        edge = {"markeredgecolor": BLACK, "markeredgewidth": 0.8, "label": f"orbit {k}, {times}: {reached}"}
        dots(axes, (across(x), up(y)), "X" if orbit.stable is False else "o", 6, colour, **edge)
    if (basins.reached < 0).any():
        dots(axes, ([], []), "s", 6, UNSETTLED, label="not settled")
    axes.set(xlabel=across.label, ylabel=up.label, xlim=first[[0, -1]], ylim=second[[0, -1]])
    legend(axes, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return axes


def _start_scale(axis: StartAxis) -> Scale:
    """Of an axis, in a unit that suits its values."""
    top = max(map(abs, axis.values))
    if "kg" not in axis.unit or not top > 0.0:
        return Scale.of(axis.quantity, axis.unit, axis.values)
    exponent = 3 * math.floor(math.log10(top) / 3.0)  # of units that have no smaller ones
    unit = f"$10^{{{exponent}}}$ {axis.unit}" if exponent else axis.unit
    return Scale(10.0**-exponent, f"{axis.quantity} ({unit})")


def _place(basins: Basins, state: np.ndarray) -> tuple[float, float]:
    """Values on both axes of a state's projection on the plane of the axes, which may be oblique."""
    corner = basins.states[0, 0]
    directions = [
        (other - corner) / (axis.values[1] - axis.values[0])
        for axis, other in zip(basins.axes, (basins.states[1, 0], basins.states[0, 1]))
    ]
    found = np.linalg.lstsq(np.array(directions).T, state - corner, rcond=None)[0]
    return basins.axes[0].values[0] + float(found[0]), basins.axes[1].values[0] + float(found[1])
