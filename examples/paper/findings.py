"""What a part of the report consists of: numbers, tables, checked statements, curves."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Claim:
    """A statement held against a number.

    Attributes
    ----------
    says : str
        The statement.
    found : str
        What was computed.
    holds : bool
    source : str
        Who says so: "paper"; "implied" for what its text takes for granted; "check" for what the report
        demands of itself.
    """

    says: str
    found: str
    holds: bool
    source: str = "paper"


@dataclass(frozen=True)
class Table:
    """A table of the report.

    Attributes
    ----------
    caption : str
    columns : list of str
    rows : list of lists
        Texts, numbers, or None for an empty cell.
    formats : list of str
        Of each column: "text", "value" (five digits), "frequency" (three decimals), "percent" (a ratio as
        signed percentage), "error" (two digits), "count".
    """

    caption: str
    columns: list[str]
    rows: list[list]
    formats: list[str]

    def __post_init__(self):
        if any(len(row) != len(self.columns) for row in [self.formats, *self.rows]):
            raise ValueError(
                f"table {self.caption!r}: {len(self.columns)} columns, {len(self.formats)} formats and rows "
                f"of {sorted({len(row) for row in self.rows})} cells"
            )


@dataclass(frozen=True)
class Finding:
    """Result of a part.

    Attributes
    ----------
    numbers : dict
        What matters, by name; plain floats, lists and dicts.
    tables : list of Table
    claims : list of Claim
    notes : list of str
        Sentences on choices and on what the numbers mean.
    curves : dict of str to array
        What the picture shows.
    """

    numbers: dict
    tables: list[Table] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    curves: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Part:
    """A row of the report.

    Attributes
    ----------
    name : str
        As in `--only`.
    title : str
    compute : callable
        Bench -> Finding.
    draw : callable or None
        (Finding, path): write the picture.
    caption : str
        Of the picture.
    seconds : float
        Usual duration, by which parts are shared out among ranks.
    """

    name: str
    title: str
    compute: Callable
    draw: Callable | None = None
    caption: str = ""
    seconds: float = 1.0


def plain(value):
    """Numbers, lists and dicts of JSON from NumPy's types, dataclasses and complex numbers ([real,
    imaginary]).
    """
    if dataclasses.is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (complex, np.complexfloating)):
        return [float(value.real), float(value.imag)]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value


def cell(value, form: str) -> str:
    """A table's cell as text."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "-"
    if form == "percent":
        return percent(value)
    if form == "frequency":
        return f"{value:,.3f}"
    if form == "error":
        return f"{value:.1e}"
    if form == "count":
        return f"{value:,d}"
    return f"{value:.5g}" if 1e-3 <= abs(value) < 1e5 or value == 0.0 else f"{value:.4e}"


def percent(ratio: float, sign: str = "+") -> str:
    """A ratio as percentage of two digits; sign = "" for sizes, which need none."""
    if abs(ratio) < 1e-6:
        return f"{100.0 * ratio:{sign}.1e} %" if ratio else "0 %"
    digits = max(0, 1 - math.floor(math.log10(abs(100.0 * ratio))))
    return f"{100.0 * ratio:{sign}.{digits}f} %"


def size(ratio: float) -> str:
    """A ratio without a direction as percentage."""
    return percent(abs(ratio), "")
