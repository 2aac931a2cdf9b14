"""Maps and curves of a sweep's indicators, and of what is detected by them."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize

from ..checks import real_array
from ..petsc import MPI
from ..record.units import suited
from .drawing import MARKED, STYLE, Scale, Sheet, bar, curves, save_picture
from .picture import picture

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


def draw_sweep(sweep: Any, folder: str) -> list[str]:
    """Draw the indicators of a sweep (frequency shifts, ratios of harmonics, modulation indices), one picture
    a quantity with a panel for each point or entry, with and without noise: maps over two numeric parameters
    with several values, curves over one.

    Parameters
    ----------
    sweep : Sweep
    folder : str
        Made if it is missing.

    Returns
    -------
    list of str
        Pictures.

    Raises
    ------
    ValueError
        If no parameter has two numeric values.
    """
    os.makedirs(folder, exist_ok=True)
    groups: dict[str, dict[str, np.ndarray]] = {}
    units: dict[str, str] = {}
    for name in filter(_INDICATORS.search, sweep.values):
        together = sweep.picture_name(name)
        groups.setdefault(together, {}).update(_columns(sweep, name))
        units[together] = sweep.units.get(name, "1")
    pictures = []
    for together, columns in groups.items():
        path = os.path.join(folder, f"{together}.png")
        pictures.append(str(save_picture(indicator_figure(sweep, columns, units[together]), path)))
    return pictures


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
    axes = _axes(sweep)
    if not axes:
        raise ValueError("no parameter of the sweep has two numeric values to draw over")
    table = np.stack(list(columns.values()))
    scale, unit = suited(unit, table)
    unit = "" if unit == "1" else unit
    table = table * scale
    if not unit:  # smaller ratios are rounding
        table = np.where(table > 0.0, np.maximum(table, ROUND_OFF), table)
    grid = len(axes) >= 2 and all(len(np.unique(sweep.inputs[a])) > 2 for a in axes[:2])
    over = axes[: 2 if grid else 1]
    others = [name for name in sweep.inputs if name not in over and _matters(sweep, name, table)]
    sheet = Sheet("draw_sweep", None)
    labels = (textwrap.fill(f"{words} ({unit})" if unit else words, 28) for words in columns)
    with rc_context(STYLE):
        (_maps if grid else _curves)(sheet, sweep, over, others, dict(zip(labels, table)))
        count = len(set(zip(*(sweep.inputs[n].tolist() for n in others))))
        if count > _CURVES:
            sheet.figure.suptitle(f"the first {_CURVES} of {count} combinations of the other parameters")
        sheet.finished(None, "")
    return sheet.figure


def _matters(sweep: Any, name: str, table: np.ndarray) -> bool:
    """Whether values change, in some row, with one parameter alone; True where no rows tell."""
    rest = list(zip(*(column.tolist() for other, column in sweep.inputs.items() if other != name)))
    alike: dict[Any, list[int]] = {}
    for row, key in enumerate(rest or [()] * len(sweep)):
        alike.setdefault(key, []).append(row)
    told = [rows for rows in alike.values() if len(rows) > 1]
    return not told or not all(
        np.allclose(table[:, rows], table[:, rows[:1]], rtol=1e-9, atol=0.0, equal_nan=True) for rows in told
    )


def _scale(sweep: Any, name: str) -> Scale:
    """Of a numeric parameter: "depth of notch 1 (mm)"."""
    return Scale.of(sweep.input_words[name], sweep.input_units.get(name, ""), sweep.inputs[name])


def _axes(sweep: Any) -> list[str]:
    """Numeric parameters with several values, those with the most first."""
    numeric = [n for n, c in sweep.inputs.items() if c.dtype.kind in "fi" and len(np.unique(c)) > 1]
    return sorted(numeric, key=lambda n: -len(np.unique(sweep.inputs[n])))


def _families(sweep: Any, names: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    """Rows of equal values of the other parameters, with a label each; nothing but the first eight."""
    columns = [sweep.inputs[n] for n in names]
    if not columns:
        return [("", np.ones(len(sweep), dtype=bool))]
    keys = list(dict.fromkeys(zip(*(c.tolist() for c in columns))))
    families = []
    for key in keys[:_CURVES]:
        rows = np.all([c == v for c, v in zip(columns, key)], axis=0)
        families.append((", ".join(_value(sweep, n, v) for n, v in zip(names, key)), rows))
    return families


def _value(sweep: Any, name: str, value: Any) -> str:
    """A parameter's value, "force of drive along y = 300 N"."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return f"{sweep.input_words[name]} = {value}"
    factor, unit = suited(sweep.input_units.get(name, ""), sweep.inputs[name])
    return f"{sweep.input_words[name]} = {value * factor:g} {unit}".rstrip()


def _curves(
    sheet: Sheet, sweep: Any, over: Sequence[str], others: Sequence[str], columns: Mapping[str, np.ndarray]
) -> None:
    """Curves over one parameter, one each combination of the others, below one another."""
    panels = sheet.panels((len(columns), 1), 0.6 + 2.1 * len(columns), NARROW, sharex=True)
    families, along, places = _families(sweep, others), _scale(sweep, over[0]), sweep.inputs[over[0]]
    order = np.argsort(places, kind="stable")
    for panel, (label, values) in zip(panels, columns.items()):
        drawn = {text: (places[order][rows[order]], values[order][rows[order]]) for text, rows in families}
        curves(panel, drawn, along, Scale(1.0, label), MARKED, markersize=3, linewidth=1)
        if _logarithmic(values):
            panel.set_yscale("log")
    if others:
        sheet.figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left")


def _logarithmic(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite) and finite.min() > 0.0 and finite.max() > 30.0 * finite.min())


def _maps(
    sheet: Sheet, sweep: Any, over: Sequence[str], others: Sequence[str], columns: Mapping[str, np.ndarray]
) -> None:
    """Maps over two parameters, one each combination of the others, with one bar for each column."""
    across, up = (_scale(sweep, name) for name in over)
    x, y = (sweep.inputs[name] for name in over)
    families = _families(sweep, others)
    wide = min(2, len(families))
    lines = -(-len(families) // wide)
    rows_in_all = lines * len(columns)
    panels = sheet.panels((rows_in_all, wide), 0.4 + 2.2 * rows_in_all, NARROW + 1.4 * (wide - 1))
    for number, (label, values) in enumerate(columns.items()):
        own = panels[number * lines * wide : (number + 1) * lines * wide]
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
    depths = real_array(owner, "depth", depth, 1, "m")
    places = real_array(owner, "place", place, 1, "m")
    if not isinstance(probability, Mapping) or not probability:
        raise TypeError(f"{owner}: probability must be a dict of names to arrays with at least one entry")
    chances = {name: real_array(owner, f"probability[{name!r}]", p, 1) for name, p in probability.items()}
    for name, values in {"place": places, **chances}.items():
        if len(values) != len(depths):
            raise ValueError(
                f"{owner}: {name} has {len(values)} values for {len(depths)} depths; give one each"
            )
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
