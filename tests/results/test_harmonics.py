"""Harmonics of several steady states as a table and as comma-separated values."""

import csv

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.plot import plot_harmonics, plot_orbit, save_pictures
from sbfem_petsc.results.harmonics import harmonics_table, write_harmonics
from tests.systems import same_products


@pytest.fixture(scope="module")
def orbits():
    """A mass of 1 kg on a spring, with and without a stop at rest."""
    reduced = sb.reduce_matrices(
        mass=np.eye(1),
        stiffness=np.array([[1e4]]),
        contact_rows=np.array([[1.0]]),
        gap=np.zeros(1),
        loads=np.ones((1, 1)),
        sensors={"A": 0},
        damping=0.05,
        compliance=np.array([1e-5]),
    )
    return {
        "free, 1 N": sb.periodic(reduced, 1.0, 5.0, steps=64, contact=False),
        "stop": sb.periodic(reduced, 1.0, 5.0, steps=64),
    }


def test_file(orbits, tmp_path):
    """All digits, under names that programs can read; the free motion against the oscillator's formula."""
    write_harmonics(orbits, tmp_path / "harmonics.csv", "A", count=5)
    with open(tmp_path / "harmonics.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["harmonic", "re_free_1_N_m", "im_free_1_N_m", "re_stop_m", "im_stop_m"]
    found = {
        name: np.array([complex(float(row[f"re_{name}_m"]), float(row[f"im_{name}_m"])) for row in rows])
        for name in ("free_1_N", "stop")
    }
    w, k = 2.0 * np.pi * 5.0, 1e4
    exact = -1j / (k - w**2 + 1j * w * 2.0 * 0.05 * np.sqrt(k))  # under sin w t
    np.testing.assert_allclose(found["free_1_N"][1], exact, rtol=1e-9)
    same_products(found["stop"], orbits["stop"].harmonics("A")[:6])
    assert abs(found["stop"][0]) > 0.1 * abs(found["stop"][1])


def test_table(orbits):
    table = harmonics_table(orbits, "A", count=3, title="Amplitudes")
    columns = [list(column.cells) for column in table.columns]
    assert [column.header for column in table.columns] == ["harmonic", *orbits, "stop, over the first"]
    assert columns[0] == ["0", "1", "2", "3"] and columns[3][1] == "1.000e+00"
    assert float(columns[2][2]) == pytest.approx(abs(orbits["stop"].harmonics("A")[2]), rel=1e-4)


def test_wrong_input_is_named(orbits, tmp_path):
    with pytest.raises(TypeError, match="must be a dict of motions by name"):
        harmonics_table(orbits["stop"], "A")
    with pytest.raises(TypeError, match="orbits\\['a'\\] = 1 is no Orbit"):
        write_harmonics({"a": 1}, tmp_path / "a.csv", "A")
    with pytest.raises(ValueError, match="count = 33 is above the last harmonic of 'free, 1 N', 32"):
        write_harmonics(orbits, tmp_path / "a.csv", "A", count=33)
    assert not list(tmp_path.iterdir())


def test_pictures_by_name(orbits, tmp_path):
    save_pictures(tmp_path, figure_8=plot_harmonics(orbits, "A"), not_on_this_rank=None)
    assert [file.name for file in tmp_path.iterdir()] == ["figure_8.png"]


def test_rows_have_no_x(orbits):
    """One displacement each: x is refused, where zeros had been told and drawn."""
    orbit = orbits["stop"]
    for told in (orbit.harmonics, orbit.amplitude, lambda *of: plot_orbit(orbit, *of)):
        with pytest.raises(
            ValueError, match="direction = 'x', but the point is a row along a direction of its"
        ):
            told("A", "x")
