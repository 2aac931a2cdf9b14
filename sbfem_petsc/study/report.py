"""A self-contained HTML report of a run or a sweep."""

from __future__ import annotations

import base64
import math
import os
import re
import time
import xml.etree.ElementTree as xml
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from typing import Any

import numpy as np

import sbfem_petsc as sb
from meshing.folder_index import home_of, open_regular
from meshing.whole_file import replaced

from ..output_folder import regular_file
from ..record.about import AXES, Quantity
from ..record.units import suited
from ..writing import spare_folder
from .case.analyses import kind_called
from .pictures import lacking
from .revive import read_any
from .run import PICTURES, RunResults
from .structure import lines_of
from .sweep_file import WIDEST, Sweep

# Rows of an array that a table shows.
_ROWS = 60
# What no page may hold.
_CONTROL = re.compile("[^\t\n\r -\ud7ff\ue000-\U0010ffff]")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def write_report(path: str, output: str | None = None) -> str:
    """Write a report beside the results, with their pictures inside.

    Parameters
    ----------
    path : str
        results.h5, sweep.h5 or their folder.
    output : str, optional
        File that ends in .html. Default: report.html beside the results.

    Returns
    -------
    str
        The file.

    Raises
    ------
    TypeError, ValueError
        If there are no results, or the file cannot be written: a former report stays as it was.
    """
    if output is not None and os.path.splitext(output)[1].lower() not in (".html", ".htm"):
        raise ValueError(f"report {output!r} must end in .html or .htm")
    results = read_any(path)
    file = output or os.path.join(os.path.dirname(results.path), "report.html")
    if output is None and home_of(file) is None and os.path.lexists(file):
        raise ValueError(
            f"{file!r} exists, and nothing tells that this program has made it; move it away, or name "
            "another file with --output"
        )
    page = _page(results)
    with replaced(file, "report") as temporary, open(temporary, "w", encoding="utf-8") as target:
        target.write("<!DOCTYPE html>" + xml.tostring(page, encoding="unicode", method="html") + "\n")
    return file


def _page(results: RunResults | Sweep) -> xml.Element:
    """report.html, filled."""
    page = xml.fromstring((resources.files(__package__) / "report.html").read_text())
    body = next(page.iter("main"))
    title, facts = _sweep(body, results) if isinstance(results, Sweep) else _run(body, results)
    facts = f"{facts}, written {time.strftime('%Y-%m-%d')}"
    for item in page.iter():
        if "id" in item.attrib:
            item.text = _clean({"title": title, "facts": facts, "case": results.text}[item.attrib.pop("id")])
    return page


def _add(parent: xml.Element, tag: str, text: str = "", **attributes: str) -> xml.Element:
    """A new element in another one. All text of a page passes through here, and is escaped when it is
    written; what no page may hold has a sign in its place.
    """
    found = xml.SubElement(parent, tag, {name.rstrip("_"): _clean(item) for name, item in attributes.items()})
    found.text = _clean(text)
    return found


def _clean(text: Any) -> str:
    return _CONTROL.sub("\N{REPLACEMENT CHARACTER}", str(text))


def _run(body: xml.Element, results: RunResults) -> tuple[str, str]:
    """What a run has found; its title, and facts about it."""
    run = results.run
    _table(body, lines_of(run["model"]))
    for name, reason in run["failed"].items():
        _add(body, "p", f"{name} failed: {reason}", class_="failed")
    for name, found in results.analyses.items():
        _add(_add(body, "h2", f"{name} "), "small", f"({results.told(name).replace('_', ' ')})")
        kind = kind_called(results.kinds[name])
        for columns, rows in kind.tables(found):
            _table(body, [tuple(map(_shown, row)) for row in rows], columns)
        small = [(path, q) for path, q in found.each() if not q.about.detail and np.size(q.value) <= 3]
        _table(body, [(_label(path, q), _with_unit(q.value, q.unit)) for path, q in small])
        # "push_2" has pictures of its own, which are not those of "push"
        longer = tuple(f"{other}_" for other in results.analyses if other.startswith(f"{name}_"))
        _pictures(body, os.path.dirname(results.path), kind.captions, f"{name}_", longer)
    facts = f"sbfem-petsc {run['version']}, computed {run['ended'][:10]}"
    return run["title"] or results.case_file, facts


def _label(path: tuple[str, ...], entry: Quantity) -> str:
    """What a quantity is, in words: "displacement x, y of A"."""
    behind = path.index(entry.name) + 1
    words = [" ".join(path[:behind]).replace("_", " ")]
    words += [", ".join(AXES[dim]) for dim in entry.dims if dim in AXES]
    return " of ".join([" ".join(words), *path[behind:]])


def _with_unit(value: Any, unit: str) -> str:
    """A value in a unit that suits its magnitude."""
    if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind in "fc"):
        scale, unit = _suited(unit, value)
        value = value * scale
    return f"{_shown(value)}{'' if unit == '1' else ' ' + unit.replace('m^(1/2)', '√m')}"


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return ", ".join(_shown(v) for v in np.atleast_1d(value).tolist())
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "not asked for"}[value]
    if isinstance(value, complex):
        return f"{number(abs(value))} at {math.degrees(math.atan2(value.imag, value.real)):.1f} deg"
    return number(value) if isinstance(value, float) else str(value)


def number(value: float, digits: int = 6) -> str:
    """A number to some digits, powers of ten as a person writes them."""
    if not math.isfinite(value):
        return "-"
    mantissa, _, power = f"{value:.{digits}g}".partition("e")
    mantissa = mantissa.replace("-", "−")
    if not power:
        return mantissa
    raised = f"10{str(int(power)).translate(_RAISED)}"
    return raised if mantissa == "1" else f"{mantissa} × {raised}"


def _sweep(body: xml.Element, results: Sweep) -> tuple[str, str]:
    """What a sweep has found, with pictures that are drawn for it; its title, and facts about it."""
    lack = lacking()
    if lack is not None:
        _add(body, "p", lack, class_="failed")
    _table(body, list(_parameters(results)), ("parameter", "values", "range"))
    _add(body, "h2", "Quantities")
    _table(body, list(_ranges(results)), ("quantity", "smallest", "largest", "unit"))
    if results.failed:
        rows = [(str(k), reason) for k, reason in enumerate(results.reasons) if reason][:_ROWS]
        _add(body, "h2", "Failed rows")
        _table(body, rows, ("row", "reason"))
    _add(body, "h2", "Indicators")
    if lack is None:
        from ..plot.maps import draw_sweep

        with spare_folder() as folder:
            draw_sweep(results, os.path.join(folder, PICTURES))
            told = reversed(results.value_words.items())  # those without noise last
            captions = {results.picture_name(name): words.split(",")[0] for name, words in told}
            _pictures(_add(body, "div", class_="beside"), folder, captions)
    facts = f"{len(results)} rows, {results.failed} failed; sbfem-petsc {sb.__version__}"
    return f"Sweep of {os.path.basename(results.case_file)}", facts


def _parameters(results: Sweep) -> Iterator[tuple[str, str, str]]:
    """What is varied, between which values."""
    for name, column in results.inputs.items():
        values = np.unique(column)
        span = ", ".join(map(str, values))
        if column.dtype.kind in "fi":
            low, high, unit = _extremes(results.input_units[name], column)
            span = f"{low} to {high} {unit}".rstrip()
        yield results.input_words[name] or name, str(len(values)), span


def _ranges(results: Sweep) -> Iterator[tuple[str, str, str, str]]:
    """Smallest and largest values of all rows, of each entry of short arrays."""
    for name, array in results.values.items():
        table, words = array.reshape(len(array), -1), results.value_words[name]
        if np.iscomplexobj(table) or table.shape[1] > WIDEST:
            continue
        for k, column in enumerate(table.T, 1):
            if np.isfinite(column).any():
                own = words if array.ndim == 1 else f"{words}, {k}"
                yield own, *_extremes(results.units[name], column, 5)


def _extremes(unit: str, values: np.ndarray, digits: int = 6) -> tuple[str, str, str]:
    """Smallest and largest of values, and their unit."""
    scale, unit = _suited(unit, values)
    low, high = (number(scale * float(of(values)), digits) for of in (np.nanmin, np.nanmax))
    return low, high, "" if unit == "1" else unit


def _suited(unit: str, values: Any) -> tuple[float, str]:
    """Frequencies are read as they are."""
    return (1.0, unit) if unit == "Hz" else suited(unit, values)


def _table(body: xml.Element, rows: Sequence[tuple[str, ...]], heading: tuple[str, ...] = ()) -> None:
    if not rows:
        return
    # names and values may take several lines on a narrow screen
    look = {} if heading else {"class_": "values"}
    table = _add(_add(body, "div", class_="wide"), "table", **look)
    for tag, row in [("th", heading)] * bool(heading) + [("td", row) for row in rows]:
        line = _add(table, "tr")
        for cell in row:
            _add(line, tag, cell)


def _pictures(
    body: xml.Element, home: str, captions: Mapping[str, str], start: str = "", others: tuple[str, ...] = ()
) -> None:
    """Pictures whose names begin so, without those that begin as others do."""
    folder = os.path.join(home, PICTURES)
    for name in sorted(os.listdir(folder)) if os.path.isdir(folder) else ():
        stem, ending = os.path.splitext(name)
        mine = name.startswith(start) and not name.startswith(others) and ending in (".png", ".gif")
        found = regular_file(home, PICTURES, name) if mine else None
        if found is None:
            continue
        with os.fdopen(open_regular(found, os.O_RDONLY), "rb") as file:
            data = base64.b64encode(file.read()).decode()
        caption = _caption(captions, stem[len(start) :])
        figure = _add(body, "figure")
        _add(figure, "img", alt=caption, src=f"data:image/{ending[1:]};base64,{data}")
        _add(figure, "figcaption", caption)


def _caption(captions: Mapping[str, str], stem: str) -> str:
    """What a picture shows: "contact1" is that of the first crack."""
    kind = stem.rstrip("0123456789") if stem not in captions else stem
    return f"{captions.get(kind, kind.replace('_', ' '))} {stem[len(kind) :]}".rstrip()
