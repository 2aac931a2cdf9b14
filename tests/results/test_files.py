"""Records in HDF5: what is saved is read back, other programs read it, what is not whole is refused, changed
bytes are told, two ranks write what one writes.
"""

from __future__ import annotations

import csv
import dataclasses
import errno
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.output_folder import make_output_folder
from sbfem_petsc.petsc import MPI
from sbfem_petsc.ranks.parallel import whole
from sbfem_petsc.record import journal
from sbfem_petsc.record.layout import bare
from sbfem_petsc.record.record import Record, described, entries, quantity
from sbfem_petsc.results.vtkhdf import write_series
from sbfem_petsc.writing import check_output_folder
from tests.fuzz import examples
from tests.parallel import ROOT
from tests.results.results_case import LOADS, on_ranks
from tests.results.same import inverted, same


@pytest.fixture(scope="module")
def saved(solved, tmp_path_factory):
    """A file of modes and static cases."""
    path = str(tmp_path_factory.mktemp("saved") / "results.h5")
    sb.save(path, {"modes": solved[2], **solved[3]})
    return path


def test_what_is_saved_is_read_back(solved, saved):
    mesh, model, modes, cases = solved
    found = sb.read(saved)
    assert os.listdir(os.path.dirname(saved)) == ["results.h5"] and list(found) == ["modes", *LOADS]
    for name, result in {"modes": modes, **cases}.items():
        assert repr(found[name]) == repr(result)
        if name in cases:
            assert found[name].loads == result.loads == (repr(LOADS[name]),)
        same(result, found[name])
    np.testing.assert_array_equal(found["modes"].nodal(2), modes.nodal(2))
    with pytest.raises(sb.SolveError, match="read from a file knows its named points, pairs, tips and nodes"):
        found["closing"].stress((0.01, 0.001))
    with h5py.File(saved) as file:
        body = file["modes/body"]
        assert file["closing"].attrs["body"] == b"/modes/body"
        starts = np.concatenate([[0], np.cumsum(body["element_nodes_count"])])
        for element in range(mesh.elements):
            np.testing.assert_array_equal(
                body["element_nodes"][starts[element] : starts[element + 1]], mesh.element_nodes(element)
            )
        for name, values in (
            ("nodes", mesh.nodes),
            ("scaling_centres", mesh.scaling_centres),
            ("closed", mesh.closed),
            ("pair_nodes", mesh.pairs.nodes),
            ("crack_tip", [mesh.cracks[0].tip]),
            ("thickness", 1.0),
        ):
            np.testing.assert_array_equal(body[name], values)
        assert b"young=70000000000.0" in body["materials"][0] and b"left" in body["supports"][0]
        assert b"fy=600.0" in file["closing/loads"][0]


def test_three_lines_of_h5py(solved, saved):
    with h5py.File(saved) as file:
        place = list(file["closing/place"][:]).index(b"A")
        u = file["closing/displacement"][place]
        assert file["closing/displacement"].attrs["units"] == b"m"
    np.testing.assert_array_equal(u, solved[3]["closing"].displacement("A"))


def test_every_dataset_has_units_and_words_and_named_dimensions(saved):
    with h5py.File(saved) as file:
        seen = []
        file.visititems(lambda name, item: seen.append(item) if isinstance(item, h5py.Dataset) else None)
        told = [item for item in seen if not bare(item)]
        assert len(told) > 40 and all(item.attrs["units"] and item.attrs["long_name"] for item in told)
        assert all(item.is_scale or all(len(dim) == 1 for dim in item.dims) for item in told)


def test_xarray_reads_it(solved, saved):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("netCDF4")
    closing = solved[3]["closing"]
    with xarray.open_datatree(saved) as tree:
        found = tree["closing"].to_dataset()
        np.testing.assert_array_equal(found.displacement.sel(place="A"), closing.point_displacements["A"])
        assert found.contact_force.attrs["units"] == "N" and found.active.dtype == bool
    own = closing.to_xarray()
    assert own.contact_resultant == closing.contact_resultant and own.gap.attrs["units"] == "m"


def test_without_xarray(solved, monkeypatch):
    """The line that installs it."""
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match=r"to_xarray needs xarray .*; install it with `pip install"):
        solved[3]["closing"].to_xarray()


def test_files_of_users_stay(solved, tmp_path):
    """A result takes the place of no file of another kind, tables of none but their own."""
    closing, own, tip = solved[3]["closing"], tmp_path / "push.toml", tmp_path / "push_tip.csv"
    for file in (own, tip):
        file.write_text("mine")
    with pytest.raises(ValueError, match=r"push\.toml' would replace a file that holds no results"):
        sb.save(own, closing)
    with h5py.File(tmp_path / "measured.h5", "w") as file:  # of another program
        file["u"] = [1.0, 2.0]
    with pytest.raises(ValueError, match=r"measured\.h5' would replace a file that holds no results"):
        sb.save(tmp_path / "measured.h5", closing)
    with h5py.File(tmp_path / "measured.h5") as file:
        assert [*file["u"]] == [1.0, 2.0]
    (tmp_path / "measured.h5").unlink()
    with pytest.raises(ValueError, match=r"'push_tip\.csv', which belongs to it, would replace a file"):
        closing.to_csv(tmp_path / "push.csv")
    for text in ("[beam]\nlength = 0.4\n", "# one, two\n[beam]\n"):
        own.write_text(text)
        with pytest.raises(ValueError, match=r"table .*push\.toml' would replace a file that holds no table"):
            closing.to_csv(own)
        assert own.read_text() == text
    own.write_text("mine")
    assert own.read_text() == tip.read_text() == "mine"
    assert sorted(os.listdir(tmp_path)) == ["push.toml", "push_tip.csv"]
    tip.unlink()
    files = closing.to_csv(tmp_path / "push.csv")
    assert closing.to_csv(tmp_path / "push.csv") == files  # its own former tables
    os.symlink("push.csv", tmp_path / "link")
    assert closing.to_csv(tmp_path / "link") == files
    sb.save(tmp_path / "a.h5", closing)
    sb.save(tmp_path / "a.h5", closing)
    (tmp_path / "empty").touch()  # as the system makes temporary files
    closing.to_csv(tmp_path / "empty")
    make_output_folder(str(tmp_path / "out"))
    files = closing.to_csv(tmp_path / "out" / "push.csv")
    pathlib.Path(files[0]).write_text(
        "sep=,\n" + pathlib.Path(files[0]).read_text()
    )  # as a spreadsheet wants it
    assert closing.to_csv(tmp_path / "out" / "push.csv") == files  # which the folder's index lists


def test_files_that_cannot_be_read_stay(solved, tmp_path, monkeypatch):
    """Their folder alone would let another one take their place."""

    def refused(path, *mode):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    (tmp_path / "own").write_text("mine")
    monkeypatch.setattr(journal, "open", refused, raising=False)
    with pytest.raises(ValueError, match="'.*own' would replace a file that holds no results"):
        sb.save(tmp_path / "own", solved[3]["closing"])
    assert (tmp_path / "own").read_text() == "mine"


def test_no_tables(tmp_path):
    with pytest.raises(ValueError, match="LinearOutput has nothing to put into a table"):
        examples.oscillator().tips.to_csv(tmp_path / "tips.csv")
    assert not os.listdir(tmp_path)


def test_tables(solved, tmp_path):
    closing = solved[3]["closing"]
    paths = closing.to_csv(tmp_path / "push.csv")
    assert [os.path.basename(path) for path in paths] == [
        *(
            "push.csv",
            "push_place.csv",
            "push_values.csv",
            "push_tip.csv",
            "push_support.csv",
            "push_note.csv",
        )
    ]
    with open(tmp_path / "push_support.csv", newline="") as file:
        (held,) = csv.DictReader(file)
    assert held["support"] == "left"
    assert [float(held[f"reactions_{way} [N]"]) for way in "xy"] == closing.reactions["left"].tolist()
    assert "reactions left: (" in repr(closing) and "crack1: K = (" in repr(closing)
    with open(tmp_path / "push_tip.csv", newline="") as file:
        (tip,) = csv.DictReader(file)
    for column, value in (
        (f"stress_intensity_I [{closing.tip_facts.common}]", closing.stress_intensity["crack1"][0]),
        ("energy_release_rate [J/m^2]", closing.energy_release_rate["crack1"]),
        ("t_stress [Pa]", closing.t_stress["crack1"]),
    ):
        np.testing.assert_equal(float(tip[column]), value)
    with open(tmp_path / "push.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["pair_cracks", "contact_force [N]", "gap [m]", "active"]
    np.testing.assert_array_equal([float(row["gap [m]"]) for row in rows], closing.gap)
    with open(tmp_path / "push_place.csv", newline="") as file:
        named = {row["place"]: row for row in csv.DictReader(file)}
    assert float(named["A"]["displacement_y [m]"]) == closing.displacement("A")[1]
    pandas = pytest.importorskip("pandas")
    exact = pandas.read_csv(paths[0], dtype=str)  # as numbers one of 37 is an ulp off, before pandas 3
    np.testing.assert_array_equal(exact["contact_force [N]"].astype(float), closing.contact_force)


def test_summary_row_and_page(solved):
    closing = solved[3]["closing"]
    told = json.loads(json.dumps(closing.summary(), allow_nan=False))
    assert told["displacement"]["A"] == closing.displacement("A").tolist() and "field" not in told
    value, unit = closing.sweep_row()["contact_resultant"]
    assert (value, unit) == (closing.contact_resultant, "N")
    assert set(closing.sweep_row()) >= {"displacement/A", "stress_intensity/crack1"}
    page = closing._repr_html_()
    assert "contact forces, compression positive" in page and "<td>N</td>" in page


def test_attributes_in_docstrings():
    for kind in (sb.Static, sb.Modal, sb.ReducedModel, sb.Estimate):
        assert kind.__doc__.count("Attributes") == 1
        assert all(f"\n    {name} : " in kind.__doc__ for name in entries(kind))


def test_what_is_not_finite_is_not_written(tmp_path):
    """It could not be read again; an orbit without points is shown all the same."""
    orbit = dataclasses.replace(examples.orbit(), residuals=(np.nan,))
    with pytest.raises(ValueError, match=r"'residuals' of Orbit\(.* has values that are not finite"):
        sb.save(tmp_path / "orbit.h5", orbit)
    assert not os.listdir(tmp_path)
    blind = sb.reduce_matrices(**examples.matrices() | {"sensors": {}})
    assert "<b>Orbit(" in sb.periodic(blind, 100.0, 20.0, steps=64)._repr_html_()


def test_no_quantity_is_named_as_an_axis():
    with pytest.raises(TypeError, match="Closing: pair is named as an axis is"):

        @described
        class Closing(Record):
            pair: int = quantity("1", "the first")
            factor: np.ndarray = quantity("1", "of each", "pair")


def test_petsc_options_are_recorded(solved, tmp_path):
    from sbfem_petsc.petsc import PETSc

    options = PETSc.Options()
    options["static_ksp_rtol"] = 1e-13
    try:
        sb.save(tmp_path / "r.h5", solved[3]["opening"])
    finally:
        del options["static_ksp_rtol"]
    with h5py.File(tmp_path / "r.h5") as file:
        assert b"static_ksp_rtol 1e-13" in list(file["body/petsc_options"])
        assert file.attrs["sbfem_petsc"].decode() == sb.__version__


@pytest.mark.long
def test_two_ranks_write_what_one_writes(serial_files, parallel_files):
    one, two = (sb.read(folder / "results.h5") for folder in (serial_files, parallel_files))
    with (
        h5py.File(serial_files / "results.h5") as serial,
        h5py.File(parallel_files / "results.h5") as parallel,
    ):
        for name in ("nodes", "scaling_centres", "closed", "element_nodes", "element_nodes_count"):
            np.testing.assert_array_equal(serial[f"modes/body/{name}"], parallel[f"modes/body/{name}"])
        assert parallel["modes/body/ranks"][()] == 2
    np.testing.assert_allclose(two["modes"].frequencies, one["modes"].frequencies, rtol=1e-7)
    for a, b in zip(one["modes"].fields, two["modes"].fields):
        assert (a * b).sum() ** 2 / ((a * a).sum() * (b * b).sum()) > 1.0 - 1e-10
    for name in LOADS:
        scale = np.abs(one[name].field).max()
        np.testing.assert_allclose(two[name].field, one[name].field, atol=1e-7 * scale)
        np.testing.assert_array_equal(two[name].active, one[name].active)


def test_what_is_missing_truncated_foreign_or_of_another_version(saved, tmp_path):
    with open(saved, "rb") as file:
        data = file.read()
    with pytest.raises(ValueError, match="does not exist"):
        sb.read(tmp_path / "none.h5")
    os.mkfifo(tmp_path / "pipe")
    for waits in (tmp_path / "pipe", "/dev/zero"):  # for ever
        with pytest.raises(ValueError, match="is no regular file"):
            sb.read(waits)
    for length in (0, 100, len(data) // 2, len(data) - 1):
        (tmp_path / "cut.h5").write_bytes(data[:length])
        with pytest.raises(ValueError, match="truncated, damaged or no HDF5 file"):
            sb.read(tmp_path / "cut.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["complete"] = True
    with pytest.raises(ValueError, match="another kind"):
        sb.read(tmp_path / "other.h5")
    shutil.copy(saved, tmp_path / "older.h5")
    with h5py.File(tmp_path / "older.h5", "a") as file:
        file.attrs["schema"] = 2
    with pytest.raises(
        ValueError, match="has schema 2 of version .*; this program reads schema 11; compute it again"
    ):
        sb.read(tmp_path / "older.h5")
    with pytest.raises(TypeError, match="is no result that can be written"):
        sb.save(tmp_path / "x.h5", {"a": 1})
    with pytest.raises(ValueError, match="without '/'"):
        sb.save(tmp_path / "x.h5", {"a/b": sb.read(saved)["closing"]})
    assert not (tmp_path / "x.h5").exists()


def test_a_failed_write_leaves_the_old_file(solved, tmp_path, monkeypatch):
    path, old = tmp_path / "results.h5", b"\x89HDF\r\n\x1a\nold"
    path.write_bytes(old)

    def refuse(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(h5py.Group, "create_dataset", refuse)
    with pytest.raises(ValueError, match="cannot be written: No space left on device"):
        sb.save(path, solved[2])
    assert path.read_bytes() == old and os.listdir(tmp_path) == ["results.h5"]


# Saves results again on a disk that is full after so many bytes, and once more when it is not any more.
FULL = """
import gc, resource, signal, sys
import sbfem_petsc as sb

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
found = sb.read(sys.argv[1])
for size in map(int, sys.argv[3:]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    try:
        sb.save(sys.argv[2], found)
    except ValueError as error:
        print(error)
    gc.collect()
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
sb.save(sys.argv[2], found)
print(sb.read(sys.argv[2])["closing"])
"""


def test_a_full_disk_does_not_end_the_process(solved, saved, tmp_path):
    """As it did where HDF5 could not write what it still had: its files did not close."""
    sb.save(tmp_path / "again.h5", sb.read(saved))
    whole = os.path.getsize(tmp_path / "again.h5")
    sizes = [0, 1, 600, 5000, *(share * whole // 8 for share in range(1, 8)), whole - 2000, whole - 1]
    command = [sys.executable, "-B", "-c", FULL, saved, str(tmp_path / "again.h5"), *map(str, sizes)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    *told, last = done.stdout.splitlines()
    sentence = f"result file {str(tmp_path / 'again.h5')!r} cannot be written: File too large"
    assert told == [sentence] * len(sizes) and last == repr(solved[3]["closing"])
    assert os.listdir(tmp_path) == ["again.h5"]


# Saves results while Ctrl-C comes as HDF5 writes for the first, third ... time, and once more.
INTERRUPTED = """
import gc, signal, sys
import sbfem_petsc as sb
from sbfem_petsc.record import files

found, write, own, left = sb.read(sys.argv[1]), files._Target.write, signal.getsignal(signal.SIGINT), 0

def interrupted(target, data):
    global left
    left -= 1
    if not left:
        signal.raise_signal(signal.SIGINT)
    return write(target, data)

files._Target.write = interrupted
for left in map(int, sys.argv[3:]):
    try:
        sb.save(sys.argv[2], found)
    except KeyboardInterrupt:
        print("interrupted", signal.getsignal(signal.SIGINT) is own)
    gc.collect()
sb.save(sys.argv[2], found)
print(sb.read(sys.argv[2])["closing"])
"""


def test_an_interrupt_does_not_end_the_process(solved, saved, tmp_path):
    """As it did (a segmentation fault) where its handler ran within HDF5, which could not write then."""
    command = [sys.executable, "-B", "-c", INTERRUPTED, saved, str(tmp_path / "again.h5"), "1", "3", "20"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert done.stdout.splitlines() == ["interrupted True"] * 3 + [repr(solved[3]["closing"])]
    assert os.listdir(tmp_path) == ["again.h5"]


def test_series_are_interrupted_between_their_times(tmp_path):
    """They may take minutes: none is computed behind a signal."""
    shown = []

    def meshes():
        for k in range(9):
            shown.append(k)
            if k == 2:
                signal.raise_signal(signal.SIGINT)
            cells = [("triangle", np.array([[0, 1, 2]]))]
            yield {"points": np.eye(3), "cells": cells, "point_data": {"u": np.ones(3)}, "cell_data": {}}

    with pytest.raises(KeyboardInterrupt):
        write_series(str(tmp_path / "a.vtkhdf"), np.arange(9.0), meshes())
    assert shown == [0, 1, 2] and not os.listdir(tmp_path)


@pytest.mark.long
def test_failures_are_known_to_all_ranks(tmp_path, parallel_files):
    (tmp_path / "file").write_text("")
    done = on_ranks(2, "fail", str(tmp_path))
    for rank in (0, 1):
        assert f"rank {rank}: result file" in done.stdout and "No space left on device" in done.stdout, (
            done.stderr
        )
    assert os.listdir(tmp_path) == ["file"]
    assert done.returncode != 0 and done.stderr.count(f"{tmp_path / 'file'}' cannot be made") == 1


def test_output_folder(tmp_path):
    assert check_output_folder(str(tmp_path / "a" / "b"), MPI.COMM_WORLD) == str(tmp_path / "a" / "b")
    assert os.listdir(tmp_path / "a" / "b") == []
    (tmp_path / "file").write_text("")
    for name in ("file", "file/below"):
        with pytest.raises(ValueError, match="output folder .* cannot be made"):
            check_output_folder(str(tmp_path / name), MPI.COMM_WORLD)
    if os.geteuid():
        (tmp_path / "locked").mkdir(mode=0o500)
        with pytest.raises(ValueError, match="output folder .* cannot be written"):
            check_output_folder(str(tmp_path / "locked"), MPI.COMM_WORLD)


def test_rows_by_their_numbers():
    numbers, values = np.array([0, 3, 1, 4, 6]), np.arange(10.0).reshape(5, 2)
    found = whole(MPI.COMM_SELF, numbers, values)
    np.testing.assert_array_equal(found[numbers], values)
    assert found.shape == (7, 2) and (found[[2, 5]] == 0.0).all()


@pytest.mark.long
@pytest.mark.parametrize(
    "kind",
    ["orbit", "branch", "locus", "basins", "swept_response", "history"]
    + ["backbone", "quasi_periodic", "quasi_periodic_branch"],
)
def test_inverted_bytes(kind, tmp_path):
    """Every 307th byte of a file of each kind: told of, or without effect."""
    path = tmp_path / "result.h5"
    sb.save(path, getattr(examples, kind)())
    told, without, silent = inverted(path, sb.read, every=307)
    assert silent == [] and told > 0


@pytest.mark.long
def test_inverted_bytes_of_chunks(tmp_path):
    """Of what is too large for a header, beside statics and modes."""
    history = sb.transient(examples.oscillator(), 20.0, 60.0, 1e-2)
    sb.save(tmp_path / "result.h5", history)
    told, without, silent = inverted(tmp_path / "result.h5", sb.read, every=3001)
    assert silent == [] and told > 0


@pytest.mark.long
def test_inverted_bytes_of_statics_and_modes(saved, tmp_path):
    shutil.copy(saved, tmp_path / "result.h5")
    told, without, silent = inverted(tmp_path / "result.h5", sb.read, every=307)
    assert silent == [] and told > 0
