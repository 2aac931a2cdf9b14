"""Maps and curves of a sweep's indicators."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.colors import LogNorm, Normalize

from ..record.units import suited
from .drawing import CYCLE, MARKERS, STYLE, Sheet, bar, save_picture

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
    sheet, labels = Sheet("draw_sweep", None), [_label(name, unit) for name in columns]
    with rc_context(STYLE):
        (_maps if grid else _curves)(sheet, sweep, over, others, dict(zip(labels, table)))
        count = len(set(zip(*(sweep.inputs[n].tolist() for n in others))))
        if count > _CURVES:
            sheet.figure.suptitle(f"the first {_CURVES} of {count} combinations of the other parameters")
        sheet.finished(None, "")
    return sheet.figure


def _label(words: str, unit: str) -> str:
    """What a panel shows, in lines that it has room for."""
    return textwrap.fill(f"{words} ({unit})" if unit else words, 28)


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


def _parameter(sweep: Any, name: str) -> tuple[float, str, str]:
    """Factor, label and unit of a parameter: "depth of notch 1" in mm."""
    scale, unit = suited(sweep.input_units.get(name, ""), sweep.inputs[name])
    return scale, sweep.input_words[name], unit


def _axis(sweep: Any, name: str) -> tuple[np.ndarray, str]:
    """Values of a numeric parameter, and the axis's label."""
    scale, text, unit = _parameter(sweep, name)
    return sweep.inputs[name] * scale, f"{text} ({unit})" if unit else text


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
    scale, text, unit = _parameter(sweep, name)
    return f"{text} = {value * scale:g} {unit}".rstrip()


def _curves(
    sheet: Sheet, sweep: Any, over: Sequence[str], others: Sequence[str], columns: Mapping[str, np.ndarray]
) -> None:
    """Curves over one parameter, one each combination of the others, below one another."""
    panels = sheet.panels((len(columns), 1), 0.6 + 2.1 * len(columns), NARROW, sharex=True)
    places, label = _axis(sweep, over[0])
    for panel, (text_of_axis, values) in zip(panels, columns.items()):
        for k, (text, rows) in enumerate(_families(sweep, others)):
            x, y = places[rows], values[rows]
            order = np.argsort(x)
            colour, marker = CYCLE[k % len(CYCLE)], MARKERS[k % len(MARKERS)]
            panel.plot(x[order], y[order], color=colour, marker=marker, markersize=3, linewidth=1, label=text)
        if _logarithmic(values):
            panel.set_yscale("log")
        panel.set(xlabel=label, ylabel=text_of_axis)
    if others:
        sheet.figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left")


def _logarithmic(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite) and finite.min() > 0.0 and finite.max() > 30.0 * finite.min())


def _maps(
    sheet: Sheet, sweep: Any, over: Sequence[str], others: Sequence[str], columns: Mapping[str, np.ndarray]
) -> None:
    """Maps over two parameters, one each combination of the others, with one bar for each column."""
    places, labels = zip(*(_axis(sweep, name) for name in over))
    families = _families(sweep, others)
    across = min(2, len(families))
    lines = -(-len(families) // across)
    panels = sheet.panels(
        (lines * len(columns), across), 0.4 + 2.2 * lines * len(columns), NARROW + 1.4 * (across - 1)
    )
    for number, (label, values) in enumerate(columns.items()):
        own = panels[number * lines * across : (number + 1) * lines * across]
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
        norm = LogNorm(low, high) if _logarithmic(values) else Normalize(low, high)
        for panel, (text, rows) in zip(own, families):
            drawn = _map(panel, places[0][rows], places[1][rows], values[rows], norm)
            panel.set(xlabel=labels[0], ylabel=labels[1])
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
