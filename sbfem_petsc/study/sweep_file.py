"""A sweep's table: rows put together, HDF5 and CSV."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from ..record.about import About
from ..record.layout import bare, put, text, text_of, value_of
from ..writing import write_table
from .case.case import Case
from .case.case_tables import CaseTables
from .case.locations import parse
from .case.sweep import unit_of, words_of
from .folder import case_in, new_results
from .rows import Row

FILE, TABLE = "sweep.h5", "sweep.csv"
# Entries up to which an array stands in the CSV file, a column each.
WIDEST = 12


@dataclass(frozen=True, eq=False)
class Sweep:
    """The rows of a sweep.

    Attributes
    ----------
    inputs : dict of str to (n,) array
        Values of the parameters, by their dotted paths.
    values : dict of str to (n, ...) array
        By "analysis/quantity" or "analysis/quantity/point"; nan where a row failed, and where arrays of other
        rows are longer.
    units : dict of str to str
        Of the values.
    reasons : list of str
        Why a row failed; "" where it did not.
    seconds : (n,) array
        Wall time of each row, what it shares with others counted in the first of them.
    text : str
        The case.
    case_file : str
    files : dict of str to bytes
        Contents of the files that the case names.
    path : str
        The file that it was read from.
    """

    inputs: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    units: dict[str, str]
    reasons: list[str]
    seconds: np.ndarray
    text: str
    case_file: str
    files: dict[str, bytes]
    path: str = ""

    @classmethod
    def of(cls, path: str, file: h5py.File) -> Sweep:
        """What stands in an open file of results."""
        values: dict[str, np.ndarray] = {}
        units: dict[str, str] = {}

        def visit(key: str, entry: Any) -> None:
            if isinstance(entry, h5py.Dataset) and not bare(entry):
                values[key], units[key] = value_of(entry), text(entry.attrs["units"])

        if "values" in file:
            file["values"].visititems(visit)
        inputs = {text(entry.attrs["name"]): value_of(entry) for entry in file["inputs"].values()}
        reasons = value_of(file["reasons"]).tolist()
        return cls(inputs, values, units, reasons, value_of(file["seconds"]), *case_in(file), path)

    def __len__(self) -> int:
        return len(self.reasons)

    @property
    def failed(self) -> int:
        """Number of rows that failed."""
        return sum(map(bool, self.reasons))

    @property
    def input_units(self) -> dict[str, str]:
        """Units of the parameters, "" where a key has none."""
        tables = CaseTables.model_validate(parse(self.text, self.case_file)[0])
        return {name: unit_of(tables, name) for name in self.inputs}

    @property
    def input_words(self) -> dict[str, str]:
        """What the parameters are, in words."""
        return {name: words_of(name) for name in self.inputs}

    @property
    def value_words(self) -> dict[str, str]:
        """What the values are, in words: "steady: A2/A1 with noise, A" of steady/A2_A1_noisy/A."""
        found = {}
        for name in self.values:
            analysis, quantity, *rest = name.split("/")
            words = re.sub(r"^(A\d)_(A1)", r"\1/\2", quantity).replace("_noisy", " with noise")
            found[name] = f"{analysis}: {', '.join([words.replace('_', ' '), *rest])}"
        return found

    @staticmethod
    def picture_name(name: str) -> str:
        """The picture of a quantity with all its points, with and without noise: steady_A2_A1."""
        return re.sub(r"[^A-Za-z0-9_]+", "_", "/".join(name.split("/")[:2]).removesuffix("_noisy"))

    def facts(self) -> dict[str, Any]:
        """Size, failures, names and ranges, as JSON can hold them."""
        shapes = {name: list(array.shape) for name, array in self.values.items()}
        return {
            "rows": len(self),
            "failed": self.failed,
            "reasons": sorted({reason for reason in self.reasons if reason}),
            "inputs": {name: np.unique(column).tolist() for name, column in self.inputs.items()},
            "values": {name: {"shape": shapes[name], "unit": self.units[name]} for name in shapes},
            "seconds": float(np.nansum(self.seconds)),
        }

    def write(self, case: Case, folder: str) -> None:
        """Write sweep.h5 and sweep.csv, each replaced as a whole."""
        with new_results(os.path.join(folder, FILE), "sweep", case) as file:

            def add(group: h5py.Group, name: str, array: Any, text: str, unit: str = "1") -> h5py.Dataset:
                dims = ("row", *(f"{name}_{k}" for k in range(np.ndim(array) - 1)))
                return put(group, name, np.asarray(array), About(text=text), unit, dims)

            add(file, "row", np.arange(len(self)), "number of the row")
            # paths with dots and brackets are attributes: readers stumble over them in names
            inputs, words, units = file.create_group("inputs"), self.input_words, self.input_units
            for k, (name, column) in enumerate(self.inputs.items()):
                data = add(inputs, f"{k:02d}", column, words[name] or name, units[name] or "1")
                data.attrs["name"] = text_of(name)
            for name, array in self.values.items():
                above, _, own = f"values/{name}".rpartition("/")
                add(file.require_group(above), own, array, name, self.units[name])
            add(file, "reasons", np.array(self.reasons, dtype=str), "why it failed")
            add(file, "seconds", self.seconds, "wall time", "s")
        self.to_csv(folder)

    def to_csv(self, folder: str) -> list[str]:
        """Write inputs, scalar values and short arrays, a row a line, units in the heading; the file."""
        columns: dict[str, Any] = {"row": range(len(self)), **self.inputs}
        for name, array in self.values.items():
            if np.iscomplexobj(array) or array.ndim > 2 or array[0].size > WIDEST:
                continue
            ending = "" if self.units[name] == "1" else f" [{self.units[name]}]"
            if array.ndim == 1:
                columns[f"{name}{ending}"] = array
            else:
                columns |= {f"{name}/{k + 1}{ending}": column for k, column in enumerate(array.T)}
        columns |= {"seconds": self.seconds, "reason": np.array(self.reasons, dtype=str)}
        return write_table(os.path.join(folder, TABLE), columns)

    def __repr__(self) -> str:
        return (
            f"Sweep({len(self)} rows over {', '.join(self.inputs)}; {self.failed} failed, {len(self.values)} "
            f"quantities, {np.nansum(self.seconds):.1f} s in all rows)"
        )


def together(case: Case, inputs: Sequence[Mapping[str, Any]], rows: Sequence[Row]) -> Sweep:
    """The table of rows."""
    units = {name: unit for row in rows for name, (_, unit) in row.values.items()}
    return Sweep(
        inputs={name: np.array([row[name] for row in inputs]) for name in inputs[0]},
        values={name: _column([row.values.get(name, (None,))[0] for row in rows]) for name in sorted(units)},
        units=units,
        reasons=[row.reason for row in rows],
        seconds=np.array([row.seconds for row in rows]),
        text=case.text,
        case_file=case.file,
        files=case.named_files(),
    )


def _column(entries: Sequence[np.ndarray | None]) -> np.ndarray:
    """Of all rows; nan where a row has none, and where arrays of others are longer."""
    there = [np.asarray(entry) for entry in entries if entry is not None]
    shape = np.max([array.shape for array in there], axis=0).astype(int)
    found = np.full((len(entries), *shape), np.nan, np.result_type(float, *{array.dtype for array in there}))
    for row, entry in enumerate(entries):
        if entry is not None:
            found[(row, *map(slice, np.shape(entry)))] = entry
    return found
