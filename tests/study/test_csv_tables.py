"""Complex quantities in CSV tables and in the summary."""

import csv

import numpy as np

from sbfem_petsc.study.csv_tables import write_tables
from sbfem_petsc.study.quantities import Quantity, plain

# of u(t) = Re sum c_k exp(i k t)
HARMONICS = np.array([0.5, 2.0 * np.exp(0.7j), 0.3 * np.exp(-2.1j)])


def test_magnitudes_and_phases_give_the_motion(tmp_path):
    (path,) = write_tables({"harmonics": Quantity(HARMONICS, "m")}, str(tmp_path), "drive")
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    table = np.array([[float(row["|harmonics| [m]"]), float(row["arg harmonics [rad]"])] for row in rows])
    t = np.linspace(0.0, 6.0, 7)
    exact = (HARMONICS[:, None] * np.exp(1j * np.outer(range(3), t))).real.sum(axis=0)
    summary = plain({"harmonics": Quantity(HARMONICS, "m")})["harmonics"]
    for magnitude, phase in (table.T, (summary["magnitude"], summary["phase"])):
        found = sum(a * np.cos(k * t + p) for k, (a, p) in enumerate(zip(magnitude, phase)))
        assert np.abs(found - exact).max() < 1e-14


def test_empty_arrays(tmp_path):
    """Notes of a steady state that has none: its other quantities are written all the same."""
    tree = {"notes": Quantity(np.zeros(0)), "harmonics": Quantity(HARMONICS, "m"), "periods": Quantity(1)}
    paths = write_tables(tree, str(tmp_path), "drive")
    assert [path.rsplit("/", 1)[1] for path in paths] == ["drive.csv", "drive_3.csv"]
