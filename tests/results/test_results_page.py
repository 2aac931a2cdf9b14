"""What docs/results.md says of each kind of result is what its files and tables hold, as h5py, xarray and
pandas open them without any argument.
"""

from __future__ import annotations

import csv
import pathlib
import re
import warnings

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.record.layout import bare
from sbfem_petsc.record.record import Record
from tests.fuzz import examples

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "results.md"
# With more in them than those that all functions are tried with.
FULL = {"Basins": examples.two_axes, "Branch": examples.with_bifurcation, "History": examples.motion}
KINDS = [name for name in examples.OBJECTS if issubclass(getattr(sb, name, object), Record)]
MADE = examples.OBJECTS | FULL


def page() -> dict[str, dict[str, tuple[str, str, list[str]]]]:
    """Axes or type, unit and places by the name in files, by kind."""
    found = {}
    for section in PAGE.read_text().split("\n## ")[1:]:
        rows = [re.split(r"(?<!\\)\|", line) for line in section.splitlines() if line.startswith("| `")]
        found[section.split("\n")[0]] = {
            re.findall(r"`(\w+)`", row[1])[-1]: (row[2].strip(), row[3].strip(), row[5].strip().split(", "))
            for row in rows
        }
    return found


@pytest.fixture(scope="module", params=KINDS)
def kept(request, tmp_path_factory):
    """A result and its files."""
    folder = tmp_path_factory.mktemp("kept")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = MADE[request.param]()
    sb.save(folder / "result.h5", result)
    return result, folder / "result.h5", result.to_csv(folder / "result.csv")


def test_each_kind_is_tried():
    public = {name: getattr(sb, name) for name in sb.__all__}
    kinds = {name for name, kind in public.items() if isinstance(kind, type) and issubclass(kind, Record)}
    assert kinds == {*KINDS, "Estimate", "StartAxis"}  # which stand inside others


def test_numbers_have_no_name_of_an_axis(kept):
    """Of their group or one around it: xarray would take them for the axis' entries."""

    def look(name, item):
        if isinstance(item, h5py.Dataset) and not item.shape:
            *around, own = name.split("/")
            above = ["/".join([*around[:k], own]) for k in range(len(around))]
            assert not any(
                isinstance(file.get(place), h5py.Dataset) and file[place].is_scale for place in above
            )

    with h5py.File(kept[1]) as file:
        file.visititems(look)


def test_what_a_file_holds(kept):
    told, parts = page(), []

    def look(_, item):
        if isinstance(item, h5py.Group) and "record" in item.attrs:
            parts.append(item)

    with h5py.File(kept[1]) as file:
        look("", file)
        file.visititems(look)
        for group in parts:
            mine = told[group.attrs["record"].decode()]
            assert {key for key in mine if key in group} | {"body"} >= {
                key
                for key, item in group.items()
                if not (isinstance(item, h5py.Dataset) and item.is_scale and (bare(item) or key not in mine))
            }
            for key, (axes, unit, where) in mine.items():
                if isinstance(group.get(key), h5py.Dataset) and not bare(group[key]):
                    assert "file" in where
                    if unit != "of its value":
                        assert group[key].attrs["units"].decode() == unit, (group.name, key)
                    if "*" not in axes and not group[key].is_scale and group[key].ndim:
                        names = [pathlib.Path(dim[0].name).name for dim in group[key].dims]
                        assert [re.sub("further_|slow_", "", one) for one in names] == axes.split(", ")
                elif "file" not in where:
                    assert key not in group.attrs


def test_what_tables_hold(kept):
    result, _, tables = kept
    mine = page()[type(result).__name__]
    heads = []
    for path in tables:
        with open(path, newline="") as file:
            rows = list(csv.reader(file))
        heads += [f"{row[0]} [{row[2]}]" for row in rows[1:]] if rows[0][0] == "quantity" else rows[0]
    for key, (_, unit, where) in mine.items():
        longer = [one for one in mine if one.startswith(f"{key}_")]
        found = [
            head
            for head in heads
            if re.fullmatch(rf"((re|im)_)?{key}(_\w+)?( \[.*\])?", head)
            and not any(one in head for one in longer)
        ]
        if "table" not in where:
            assert not found, key
        elif unit not in ("of its value", "1"):
            assert all(head.endswith(f"[{unit}]") for head in found), (key, found)


def test_three_lines_of_h5py(kept):
    result, path, _ = kept
    q = next(q for q in result.quantities(lambda about: about.stored and not about.distributed) if q.dims)
    with h5py.File(path) as file:
        values = file[q.name][:]
        unit = file[q.name].attrs["units"].decode()
    if values.dtype.kind == "S":
        values = np.char.decode(values)
    np.testing.assert_array_equal(values, q.value)
    assert unit == q.unit


@pytest.mark.filterwarnings("error")
def test_xarray_opens_it(kept):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("netCDF4")
    result, path, _ = kept
    with xarray.open_datatree(path) as tree:
        for q in result.quantities(lambda about: about.stored and not about.distributed):
            if isinstance(q.value, str):
                assert tree.attrs[q.name] == q.value
                continue
            found = tree[q.name]
            values = found.values.view(complex) if found.dtype.names else found.values
            np.testing.assert_array_equal(values, q.value)
            assert found.dims == q.dims and found.attrs["units"] == q.unit
            for dim, names in q.names.items():
                assert tuple(found[dim].values) == names


@pytest.mark.filterwarnings("error")
def test_pandas_opens_its_tables(kept):
    pandas = pytest.importorskip("pandas")
    result, _, tables = kept
    for path, columns in zip(tables, result.tables().values()):
        frame, exact = pandas.read_csv(path), pandas.read_csv(path, dtype=str)
        assert list(frame) == list(columns) and len(frame) == len(next(iter(columns.values())))
        for name, values in columns.items():
            if name != "value" and np.asarray(values).dtype.kind in "fiu":
                np.testing.assert_array_equal(exact[name].astype(float), values)
                np.testing.assert_allclose(frame[name], np.asarray(values, dtype=float), 1e-10)
