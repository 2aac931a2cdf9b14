"""The examples of periodic motions run as programs and give their pinned numbers: those of this code on the
meshes named, with what a finer mesh changes.
"""

import csv
import re

import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from sbfem_petsc.study.case.case import read_case
from tests.examples.test_transient_examples import cells, example
from tests.parallel import ROOT, on_ranks
from tests.systems import case_p


def column(path, name):
    """One column of a CSV file."""
    with open(path, newline="") as file:
        return np.array([float(row[name]) for row in csv.DictReader(file)])


def harmonics(path, case):
    """Moduli of the harmonics of a motion in a CSV file."""
    return np.abs(column(path, f"re_{case}_m") + 1j * column(path, f"im_{case}_m"))


@pytest.mark.long
def test_harmonics(tmp_path):
    """Figs. 8 and 9 on the refined mesh; a mesh of 113 pairs changes A1 by 1e-4, the ratios by 1e-4 at 3000
    Hz and 5e-4 at 20140 Hz, twice the steps by 1e-5.
    """
    lines, text = example("harmonics", tmp_path, "--steps", "512")
    # A1 (m), and mean, A2, A3 over A1
    pinned = {
        "3000Hz": (8.6946e-5, 2.8188e-1, 1.1007e-2, 6.132e-4),
        "20140Hz": (2.5043e-6, 1.8762, 1.8160e-2, 1.0898e-3),
    }
    for name, (first, *ratios) in pinned.items():
        c = harmonics(tmp_path / f"harmonics_{name}.csv", "300_N")
        assert c[1] == pytest.approx(first, rel=1e-3)
        np.testing.assert_allclose(c[[0, 2, 3]] / c[1], ratios, rtol=1e-3)
        for case in ("healthy_300_N", "1_N"):  # no contact, or none that closes: the first harmonic alone
            c = harmonics(tmp_path / f"harmonics_{name}.csv", case)
            assert np.delete(c, 1).max() < 1e-12 * c[1]
        orbit = sb.read(str(tmp_path / f"orbit_{name}_300_N.h5"))
        assert (
            orbit.stable
            and orbit.iterations <= 10  # with updated derivatives, two for the price of one
            and abs(orbit.harmonics("A")[1]) == pytest.approx(first, rel=1e-3)
        )
    # one newton does not close the crack: rounding alone is left
    apart = re.findall(r" 1 N: largest of harmonics .*? differs from that without contact by (\S+)", text)
    assert len(apart) == 2 and all(float(value) < 1e-14 for value in apart)
    assert float(cells(lines, "2")[3]) == pytest.approx(9.570e-7, rel=1e-3)
    for name in ("figure_8.png", "figure_9.png", "orbit_3000Hz.png", "multipliers_20140Hz.png"):
        assert (tmp_path / name).stat().st_size > 20000


@pytest.mark.long
def test_harmonics_on_two_ranks(tmp_path):
    """A coarse mesh and 256 steps: the same numbers on one rank and two."""
    options = (
        "--frequencies",
        "3000",
        "--order",
        "4",
        "--grading",
        "2.5",
        "--tip-size",
        "5e-5",
        "--steps",
        "256",
        "--no-pictures",
    )
    found = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        example("harmonics", folder, *options, ranks=ranks)
        found.append(harmonics(folder / "harmonics_3000Hz.csv", "300_N"))
    np.testing.assert_allclose(found[1][:7], found[0][:7], rtol=1e-4)
    # 1.5e-3 off the refined mesh
    assert found[0][1] == pytest.approx(8.69e-5, rel=3e-3) and found[0][2] / found[0][1] == pytest.approx(
        1.10e-2, rel=1e-2
    )


@pytest.mark.long
def test_frequency_response(tmp_path):
    """Fig. 11 at 300 N over two damping ratios, on a mesh of 71 pairs."""
    lines, text = example(
        "frequency_response",
        tmp_path,
        "--forces",
        "300",
        "--damping",
        "0.002",
        "--damping",
        "0.005",
        "--order",
        "5",
        "--grading",
        "2.5",
        "--tip-size",
        "5e-5",
    )
    open_crack, contact = cells(lines, "0.002", "no contact"), cells(lines, "0.002", "300 N")
    assert float(open_crack[3]) == pytest.approx(14145.5, abs=0.2) and float(open_crack[4]) == pytest.approx(
        23.780, rel=1e-3
    )
    assert float(contact[3]) == pytest.approx(14167.3, abs=1.0) and float(contact[4]) == pytest.approx(
        22.15, rel=1e-3
    )
    assert float(contact[5]) == pytest.approx(21.8, abs=1.1)
    with open(tmp_path / "curves.csv", newline="") as file:
        rows = {(row["damping"], row["force_N"]): row for row in csv.DictReader(file)}
    low, high = (float(end) for end in rows["0.002", "300"]["unstable_Hz"].split("-"))
    assert (low, high) == (pytest.approx(14169.5, abs=0.5), pytest.approx(14185.5, abs=0.5))
    assert rows["0.002", "300"]["neimark_sacker"] == "2" and rows["0.002", "300"]["folds"] == "0"
    assert rows["0.005", "300"]["unstable_Hz"] == "" and float(
        rows["0.005", "300"]["peak_Hz"]
    ) == pytest.approx(14153.5, abs=0.5)
    curve = sb.read(str(tmp_path / "curve_300N_damping_0.002.h5"))
    assert curve.complete and [item.kind for item in curve.bifurcations] == 2 * ["Neimark-Sacker"]
    assert 0 < curve.unstable.sum() < 15 and column(
        tmp_path / "curve_300N_damping_0.002.csv", "frequency_Hz"
    ) == pytest.approx(curve.frequency, rel=1e-9)
    for name in (
        "figure_11_damping_0.002.png",
        "figure_11_damping_0.005.png",
        "multipliers_300N_damping_0.002.png",
    ):
        assert (tmp_path / name).stat().st_size > 20000


@pytest.mark.long
def test_hole(tmp_path):
    """Figs. 12 and 13: the breathing crack adds a second harmonic of 4.3e-4 of the first; hole and open crack
    alone add none.
    """
    lines, text = example("hole", tmp_path, "--steps", "512")
    c = {
        name: harmonics(tmp_path / "harmonics_3000Hz.csv", name)
        for name in ("healthy", "without_contact", "cracked")
    }
    assert [c[name][1] for name in c] == pytest.approx([5.8631e-5, 6.3109e-5, 6.2949e-5], rel=1e-3)
    np.testing.assert_allclose(c["cracked"][[0, 2]] / c["cracked"][1], [9.631e-3, 4.289e-4], rtol=5e-3)
    assert all(np.delete(c[name], 1).max() < 1e-12 * c[name][1] for name in ("healthy", "without_contact"))
    assert "f1 by -1.253" in text and float(cells(lines, "1")[3]) == pytest.approx(6.295e-5, rel=1e-3)
    for name in ("figure_12.png", "figure_13.png", "orbit.png", "multipliers.png"):
        assert (tmp_path / name).stat().st_size > 20000


@pytest.mark.long
def test_loci(tmp_path):
    """A line of Neimark-Sacker points around 700 N, its ends on curves at their own force to 1e-6; files with
    the force in newtons.
    """
    _, text = example(
        "loci",
        tmp_path,
        "--forces",
        "700",
        "--modes",
        "40",
        "--start",
        "14138",
        "--stop",
        "14150",
        "--least",
        "690",
        "--most",
        "710",
    )
    apart = [float(value) for value in re.findall(r"on a curve (\S+) of it off", text)]
    assert len(apart) == 2 and max(apart) < 1e-6
    force = column(tmp_path / "line_0_Neimark-Sacker.csv", "force_N")
    assert len(force) > 5 and sorted(force)[:: len(force) - 1] == pytest.approx([690.0, 710.0])
    assert (tmp_path / "loci.png").stat().st_size > 20000


@pytest.mark.long
def test_backbone(tmp_path):
    """A forced peak within 4e-4 of the free motion of its amplitude at a damping ratio of 0.004."""
    options = ("--order", "4", "--modes", "50", "--ratios", "0.004", "--forces", "90")
    _, text = example("backbone", tmp_path, *options)
    (apart,) = re.findall(r"free motion \S+ Hz, (\S+) from it", text)
    assert 0.0 < float(apart) < 4e-4
    energy = column(tmp_path / "backbone.csv", "energy_J")
    assert energy[0] == pytest.approx(1e-3) and energy[-1] == pytest.approx(0.15)
    assert (tmp_path / "backbone.png").stat().st_size > 20000


@pytest.mark.long
def test_modulation_map():
    """Nothing is modulated where the pump does not close the crack; from there the index rises with the force
    and with the depth. Its largest within 1 % of that with twice the samples.
    """
    case = read_case(ROOT / "examples/modulation_map.toml")
    axes = {"geometry.notches[0].depth": [0.5e-3, 1.5e-3, 2.5e-3], "loads.pump.fy": [1.0, 100.0, 300.0]}
    index = sb.sweep(case, axes, comm=MPI.COMM_SELF).values["lines/modulation_index/A"].reshape(3, 3)
    assert (index[:, 0] < 1e-12).all() and (np.diff(index) > 0.0).all()
    assert (np.diff(index[:, 1:], axis=0) > 0.0).all()
    load = sb.PointForce("A", fy=sb.Harmonic(1.0, 3000.0) + sb.Harmonic(300.0, 431.7))
    finer = sb.quasi_periodic(
        sb.reduce(case_p(0.002), load, modes=30), load, (3000.0, 431.7), samples=61, stability=False
    )
    assert index[2, 2] == pytest.approx(finer.modulation_index("A"), rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize(
    "name, options, sentence",
    [
        ("harmonics", ("--frequencies", "-3"), "frequency = -3.0 must be finite and above 0 (Hz)"),
        ("frequency_response", ("--start", "14000", "--stop", "14000"), "stop = 14000 is start itself"),
        ("hole", ("--steps", "3"), "steps = 3 must be between 48"),
        ("frequency_response", ("--damping", "-1"), "damping"),
    ],
)
def test_bad_options(tmp_path, name, options, sentence):
    done = on_ranks(1, f"examples/{name}.py", *options, "--output", str(tmp_path), check=False)
    assert done.returncode != 0 and sentence in done.stderr and "Traceback" not in done.stderr
