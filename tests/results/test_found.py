"""What a case keeps of results: tables, summaries and files of complex numbers, of nothing, of parts."""

import csv
import dataclasses
import shutil

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.analysis.estimate import Estimate, Level
from sbfem_petsc.record.files import UNSOUND
from sbfem_petsc.record.found import Found, labelled, of_points
from sbfem_petsc.record.record import entries, record_class
from sbfem_petsc.system.solve.modal_result import Modal
from tests.fuzz import examples

# of u(t) = Re sum c_k exp(i k t)
HARMONICS = np.array([0.5, 2.0 * np.exp(0.7j), 0.3 * np.exp(-2.1j)])


@pytest.fixture
def found():
    """Notes of a steady state that has none, harmonics of two points, a verdict that is not known."""
    harmonics = {"tip": HARMONICS, "mouth": 2.0 * HARMONICS}
    peak = Found([labelled("frequency", 3.0, "Hz", "of the largest amplitude")])
    quantities = [
        labelled("notes", np.zeros(0, str), dims="note"),
        of_points("harmonics", list(harmonics), harmonics.get, "m", "of u_y", "harmonic"),
        dataclasses.replace(
            labelled("factor", np.ones((2, 2)), "SI", "K", "tip component", {"tip": ("one", "two")}),
            units={"": "SI", "two": "Pa m^(1/2)"},
        ),
        labelled("stable", None, text="whether it is"),
        labelled("gap", np.arange(3.0), "m", "over time", "time").annotated(detail=True),
        labelled("time", np.arange(3.0), "s", "instants", "time"),
    ]
    return Found(quantities, {"peak": peak, "ways": (peak, peak)}, ["time"])


def test_parts_and_phases_give_the_motion(found, tmp_path):
    """Of tables the real and the imaginary part, of summaries magnitude and phase."""
    paths = found.to_csv(tmp_path / "drive.csv")
    names = ["drive.csv", "drive_harmonic.csv", "drive_tip.csv", "drive_values.csv", "drive_peak_values.csv"]
    assert [path.rsplit("/", 1)[1] for path in paths] == names
    with open(tmp_path / "drive.csv", newline="") as file:
        assert next(csv.reader(file)) == ["time [s]", "gap [m]"]
    with open(tmp_path / "drive_harmonic.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    parts = np.array([[float(row[f"{part}_harmonics_tip [m]"]) for row in rows] for part in ("re", "im")])
    np.testing.assert_array_equal(parts, [HARMONICS.real, HARMONICS.imag])
    assert [row["harmonic"] for row in rows] == ["0", "1", "2"]
    told_of = found.summary()
    assert (
        "gap" not in told_of and told_of["stable"] is None and found.summary(True)["gap"] == [0.0, 1.0, 2.0]
    )
    magnitude, phase = (np.array(told_of["harmonics"]["mouth"][name]) for name in ("magnitude", "phase"))
    np.testing.assert_allclose(magnitude * np.exp(1j * phase), 2.0 * HARMONICS, rtol=1e-15)
    number_first = Found([labelled("frequency", 3.0, "Hz"), labelled("gap", np.arange(3.0), dims="time")])
    with pytest.raises(ValueError, match="none/drive.csv' cannot be written"):
        number_first.to_csv(tmp_path / "none/drive.csv")


def test_it_is_read_as_it_was_written(found, tmp_path):
    with h5py.File(tmp_path / "found.h5", "w", libver="v110", track_order=True) as file:
        found.write(file)
        with h5py.File(tmp_path / "again.h5", "w", libver="v110", track_order=True) as other:
            Found.read(file).write(other)
            again = Found.read(other)
        assert file["harmonics"].dims[1][0].name == "/place" and list(file["place"]) == [b"tip", b"mouth"]
    assert repr(again) == repr(found) and again.summary(True) == found.summary(True)
    assert again["harmonics"]["tip"].value.tolist() == HARMONICS.tolist()
    assert (again["factor"]["one"].unit, again["factor"]["two"].unit) == ("SI", "Pa m^(1/2)")
    assert again.coordinates == ["time"] and list(again.tables()["time"]) == ["time [s]", "gap [m]"]
    assert again["stable"].value is None and again["gap"].about.detail and again["gap"].unit == "m"
    assert again["ways"][1]["frequency"].about.text == "of the largest amplitude"


@pytest.mark.parametrize("value", ["a", -1, np.zeros(3)], ids=str)
def test_attributes_of_a_strangers_file(value, found, tmp_path):
    """Each of another type is told of, or read: HDF5's own functions for axes crash at one."""
    with h5py.File(tmp_path / "found.h5", "w", libver="v110", track_order=True) as file:
        found.write(file)
        places = [("/", key) for key in file.attrs]
        file.visititems(lambda name, item: places.extend((name, key) for key in item.attrs))
    told = set()
    for name, key in places:
        shutil.copy(tmp_path / "found.h5", tmp_path / "copy.h5")
        with h5py.File(tmp_path / "copy.h5", "r+") as file:
            file[name].attrs[key] = value
            try:
                Found.read(file)
            except UNSOUND:
                told.add((name, key))
    assert {(name, key) for name, key in places if key == "REFERENCE_LIST"} <= told


def test_what_has_no_checksum_is_not_read(found, tmp_path):
    """HDF5 keeps lists of axes apart, without one: it looped for ever at some changed bytes of theirs."""
    path = tmp_path / "found.h5"
    with h5py.File(path, "w", libver="v110", track_order=True) as file:
        found.write(file)
    kept = path.read_bytes()
    heaps = [k for k in range(len(kept)) if kept.startswith(b"GCOL", k)]
    assert heaps
    for start in heaps:
        length = int.from_bytes(kept[start + 8 : start + 16], "little")
        kept = kept[: start + 16] + b"\xff" * (length - 16) + kept[start + length :]
    path.write_bytes(kept)
    with h5py.File(path) as file:
        assert Found.read(file).summary(True) == found.summary(True)


# What tables and summaries leave out unless details are asked for: what is as long as the motion, or of use
# to a program alone.
ROWS = {"gap", "contact_force", "slip", "friction_force"}
CURVE = {"states", "multipliers", "point_harmonics"}
DETAILS = {
    "Static": {"tip_facts", "loads"},
    "Modal": {"auxiliary_inertia"},
    "LoadHistory": {*ROWS, "slid", "states"},
    "History": {*ROWS, "states", "energy"},
    "Orbit": {*ROWS, "state", "states"},
    "Branch": {*CURVE, "map", "iterations", "multiplier_error", "point_subharmonics"},
    "Backbone": {*CURVE, "steps", "excitation", "reduced", "own_frequency"},
    "Bifurcation": {"after", "direction", "state"},
    "Locus": {"states"},
    "QuasiPeriodic": {"states", "lines", "orders", "own", "fast_loads", "slow_loads", "reduced", "swapped"},
    "Basins": {"initial_states", "orbits", "shape"},
}


@pytest.mark.parametrize("name", DETAILS)
def test_what_is_left_out_until_asked_for(name):
    found = entries(record_class(name))
    assert {field for field, about in found.items() if about.detail} == DETAILS[name]


def test_details_are_kept_where_they_are_named():
    places = {"tip": np.ones((2, 2)), "mouth": np.zeros((2, 2))}
    both, none = np.array([1.0, 2.0]), np.zeros((0, 2))
    modes = Modal(both, both, none, places, np.ones((2, 2)), "by hand", 1, 3, None)
    plain, whole = (Found.of(modes, ["tip"], details=named) for named in ((), ["auxiliary_inertia"]))
    assert "auxiliary_inertia" not in plain and {*whole.found} == {*plain.found, "auxiliary_inertia"}
    # what is named is a detail of the case's files, whatever it is of the result
    assert {name for name, q in whole.found.items() if q.about.detail} == {"auxiliary_inertia"}
    assert whole["displacement"].value.tolist() == [[[1.0, 1.0]], [[1.0, 1.0]]]


def test_a_part_that_stands_alone(tmp_path):
    """As the errors of a static solution that was asked to be accurate."""
    level = Level({"order": 5}, {}, 96, 1.0, np.nan)
    model = examples.model()
    solution = sb.static(model, examples.PUSH)
    solution = dataclasses.replace(solution, estimate=Estimate(1.0, 0.25, 0.5, True, (level, level)))
    found = Found.of(solution, ["A"])
    assert found["estimate"]["error"].value == 0.25
    assert found.summary()["estimate"]["unknowns"] == [96, 96]
    with h5py.File(tmp_path / "found.h5", "w", libver="v110", track_order=True) as file:
        found.write(file)
        assert repr(Found.read(file)) == repr(found)
    assert any("estimate" in path for path in found.to_csv(tmp_path / "static.csv"))
