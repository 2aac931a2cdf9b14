"""Maps and curves of a sweep's indicators."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.colors import LogNorm, Normalize

from ..record.units import force_unit, frequency_unit, length_unit, stress_unit, time_unit
from .drawing import CYCLE, MARKERS, STYLE, Sheet, bar, save_picture

# Quantities that are drawn without being asked for: indicators of damage.
_INDICATORS = re.compile(
    r"(frequency_shift|A[2-6]_A1(_noisy)?|modulation_index(_noisy)?|peak_frequency|contact_resultant)(/|$)"
)
# Values of a key up to which it is drawn as a family of curves, not as an axis.
_CURVES = 8
# Ratios below this are the rounding of responses without contact.
ROUND_OFF = 1e-12
_UNITS = {"m": length_unit, "s": time_unit, "N": force_unit, "Pa": stress_unit, "Hz": frequency_unit}


def draw_sweep(sweep: Any, folder: str, quantities: Sequence[str] | None = None) -> list[str]:
    """Draw the indicators of a sweep: a map over two numeric parameters with several values, curves over one.

    Parameters
    ----------
    sweep : Sweep
    folder : str
        Made if it is missing.
    quantities : sequence of str, optional
        Names in `sweep.values`. Default: frequency shifts, ratios of harmonics, modulation indices.

    Returns
    -------
    list of str
        Pictures.

    Raises
    ------
    ValueError
        If a quantity does not exist, or no parameter has two numeric values.
    """
    chosen = [name for name in sweep.values if _INDICATORS.search(name)] if quantities is None else quantities
    os.makedirs(folder, exist_ok=True)
    pictures = []
    for name in chosen:
        if name not in sweep.values:
            raise ValueError(
                f"quantity {name!r} does not exist; the sweep has {', '.join(map(repr, sweep.values))}"
            )
        for part, values in _columns(name, sweep.values[name]):
            path = os.path.join(folder, f"{re.sub(r'[^A-Za-z0-9_]+', '_', part)}.png")
            drawing = indicator_figure(sweep, part, values, sweep.units.get(name, "1"))
            pictures.append(str(save_picture(drawing, path)))
    return pictures


def _columns(name: str, array: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Real columns of a quantity, the first of an array's."""
    values = np.abs(array) if np.iscomplexobj(array) else array
    if values.ndim == 1:
        return [(name, values)]
    flat = values.reshape(len(values), -1)
    return [(f"{name}/{k + 1}", flat[:, k]) for k in range(min(3, flat.shape[1]))]


def indicator_figure(sweep: Any, name: str, values: np.ndarray, unit: str) -> Any:
    """A figure of one quantity over the sweep's parameters.

    Parameters
    ----------
    sweep : Sweep
    name : str
        Title.
    values : (n,) array
        A row each.
    unit : str
    """
    axes = _axes(sweep)
    if not axes:
        raise ValueError("no parameter of the sweep has two numeric values to draw over")
    scale, unit = _suited(unit, values)
    values, label = values * scale, _in_words(name) + (f" ({unit})" if unit else "")
    if not unit:  # smaller ratios are rounding
        values = np.where(values > 0.0, np.maximum(values, ROUND_OFF), values)
    grid = len(axes) >= 2 and all(len(np.unique(sweep.inputs[a])) > 2 for a in axes[:2])
    sheet = Sheet("draw_sweep", None)
    with rc_context(STYLE):
        others = (_map if grid else _curves)(sheet, sweep, axes, values, label)
        count = len(set(zip(*(sweep.inputs[n].tolist() for n in others))))
        left_out = f"the first {_CURVES} of {count} combinations of the other parameters"
        sheet.finished(None, left_out if count > _CURVES else "")
    return sheet.figure


def _suited(unit: str, values: np.ndarray) -> tuple[float, str]:
    """Factor and name of a unit that suits values; without one, and for one that stays as it is, 1."""
    finite = np.abs(values[np.isfinite(values)])
    choose = _UNITS.get(unit)
    if choose is None or not len(finite) or finite.max() == 0.0:
        return 1.0, "" if unit == "1" else unit
    return choose(float(finite.max()))


def _in_words(name: str) -> str:
    """ "steady/A2_A1_noisy/A" as "steady: A2/A1 with noise, A"."""
    analysis, quantity, *rest = name.split("/")
    words = re.sub(r"^(A\d)_(A1)", r"\1/\2", quantity).replace("_noisy", " with noise").replace("_", " ")
    return f"{analysis}: {', '.join([words, *rest])}"


def _parameter(sweep: Any, name: str) -> tuple[float, str, str]:
    """Factor, label and unit of a parameter: "depth of notch 1" in mm."""
    scale, unit = _suited(sweep.input_units.get(name, ""), sweep.inputs[name])
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


def _curves(sheet: Sheet, sweep: Any, axes: Sequence[str], values: np.ndarray, label: str) -> list[str]:
    """Curves over one parameter, one each combination of the others; names of these."""
    over, others = axes[0], [n for n in sweep.inputs if n != axes[0]]
    (panel,) = sheet.panels((1, 1), 3.4, 5.4)
    places, text_of_axis = _axis(sweep, over)
    for k, (text, rows) in enumerate(_families(sweep, others)):
        x, y = places[rows], values[rows]
        order = np.argsort(x)
        colour, marker = CYCLE[k % len(CYCLE)], MARKERS[k % len(MARKERS)]
        panel.plot(x[order], y[order], color=colour, marker=marker, markersize=3, linewidth=1, label=text)
    if _logarithmic(values):
        panel.set_yscale("log")
    panel.set(xlabel=text_of_axis, ylabel=label)
    if others:
        panel.legend(fontsize=6)
    return others


def _logarithmic(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite) and finite.min() > 0.0 and finite.max() > 30.0 * finite.min())


def _map(sheet: Sheet, sweep: Any, axes: Sequence[str], values: np.ndarray, label: str) -> list[str]:
    """Maps over two parameters, one each combination of the others; names of these."""
    across, up = axes[:2]
    places, labels = zip(*(_axis(sweep, name) for name in (across, up)))
    others = [n for n in sweep.inputs if n not in (across, up)]
    families = _families(sweep, others)
    columns = min(3, len(families))
    lines = -(-len(families) // columns)
    panels = sheet.panels((lines, columns), 0.5 + 2.3 * lines, 2.6 * columns + 1.2)
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    norm = LogNorm(low, high) if _logarithmic(values) else Normalize(low, high)
    for panel, (text, rows) in zip(panels, families):
        x, y, z = places[0][rows], places[1][rows], values[rows]
        xs, ys = np.unique(x), np.unique(y)
        if len(xs) * len(ys) == len(x):
            table = np.full((len(ys), len(xs)), np.nan)
            table[np.searchsorted(ys, y), np.searchsorted(xs, x)] = z
            drawn: Any = panel.pcolormesh(xs, ys, table, norm=norm, cmap="viridis", shading="nearest")
        else:
            drawn = panel.scatter(x, y, c=z, norm=norm, cmap="viridis", s=12)
        panel.set(xlabel=labels[0], ylabel=labels[1])
        panel.set_title(text, fontsize=7)
    for panel in panels[len(families) :]:
        panel.set_axis_off()
    bar(drawn, panels, label)
    return others
