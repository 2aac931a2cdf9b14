"""The examples of periodic motions run as programs and give their pinned numbers: those of this code on the
meshes named, with what a finer mesh changes.
"""

import re

import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from sbfem_petsc.study.case.case import read_case
from tests.examples.programs import printed
from tests.parallel import ROOT, on_ranks
from tests.systems import case_p


def harmonics(path):
    """Moduli of the harmonics of u_y(A) of the motions in a file, by name."""
    return {name: np.abs(orbit.harmonics("A")) for name, orbit in sb.read(str(path)).items()}


@pytest.mark.long
def test_harmonics(tmp_path):
    """Figs. 8 and 9 on the refined mesh; a mesh of 113 pairs changes A1 by 1e-4, the ratios by 1e-4 at 3000
    Hz and 5e-4 at 20140 Hz, twice the steps by 1e-5.
    """
    text = printed("harmonics", tmp_path, "--steps", "512")
    # A1 (m), and mean, A2, A3 over A1
    pinned = {
        "3000Hz": (8.6946e-5, 2.8188e-1, 1.1007e-2, 6.132e-4),
        "20140Hz": (2.5043e-6, 1.8762, 1.8160e-2, 1.0898e-3),
    }
    for name, (first, *ratios) in pinned.items():
        found = harmonics(tmp_path / f"orbits_{name}.h5")
        c = found["300 N"]
        assert c[1] == pytest.approx(first, rel=1e-3)
        np.testing.assert_allclose(c[[0, 2, 3]] / c[1], ratios, rtol=1e-3)
        for case in ("healthy, 300 N", "1 N"):  # no contact, or none that closes: the first harmonic alone
            assert np.delete(found[case][:11], 1).max() < 1e-12 * found[case][1]
        orbit = sb.read(str(tmp_path / f"orbits_{name}.h5"))["300 N"]
        assert orbit.stable and orbit.iterations <= 10  # with updated derivatives, two for the price of one
    (second,) = re.findall(r"│ 2 │ [^│]+│ [^│]+│ (\S+) │", text.split("20140 Hz, m")[0])
    assert float(second) == pytest.approx(9.570e-7, rel=1e-3)
    for name in ("harmonics_3000Hz.png", "harmonics_20140Hz.png", "orbit_3000Hz.png", "orbit_20140Hz.png"):
        assert (tmp_path / name).stat().st_size > 20000


@pytest.mark.long
def test_frequency_response(tmp_path):
    """Fig. 11 at 300 N at two damping ratios, on a mesh of 71 pairs."""
    options, found = ("--forces", "300", "--order", "5", "--grading", "2.5", "--tip-size", "5e-5"), {}
    for damping in ("0.002", "0.005"):
        printed("frequency_response", tmp_path / damping, *options, "--damping", damping)
        found[damping] = sb.read(str(tmp_path / damping / "curves.h5"))
    linear, curve = found["0.002"]["no contact"].peak("A"), found["0.002"]["300 N"]
    assert linear.frequency == pytest.approx(14145.5, abs=0.2)
    assert 1e6 * linear.amplitude == pytest.approx(0.02378, rel=1e-3)
    assert curve.peak("A").frequency == pytest.approx(14167.3, abs=1.0)
    assert curve.peak("A").amplitude / 300.0 == pytest.approx(2.215e-8, rel=1e-3)
    ends = [item.value for item in curve.bifurcations]
    assert curve.complete and [item.kind for item in curve.bifurcations] == 2 * ["Neimark-Sacker"]
    assert ends == [pytest.approx(14169.5, abs=0.5), pytest.approx(14185.5, abs=0.5)]
    assert 0 < curve.unstable.sum() < 15
    damped = found["0.005"]["300 N"]
    assert damped.stable.all() and damped.peak("A").frequency == pytest.approx(14153.5, abs=0.5)
    for name in ("figure_11.png", "multipliers.png"):
        assert (tmp_path / "0.002" / name).stat().st_size > 20000


@pytest.mark.long
def test_hole(tmp_path):
    """Figs. 12 and 13: the breathing crack adds a second harmonic of 4.3e-4 of the first; hole and open crack
    alone add none.
    """
    text = printed("hole", tmp_path, "--steps", "512")
    c = harmonics(tmp_path / "orbits.h5")
    names = ("healthy", "without contact", "cracked")
    assert [c[name][1] for name in names] == pytest.approx([5.8631e-5, 6.3109e-5, 6.2949e-5], rel=1e-3)
    np.testing.assert_allclose(c["cracked"][[0, 2]] / c["cracked"][1], [9.631e-3, 4.289e-4], rtol=5e-3)
    assert all(np.delete(c[name][:11], 1).max() < 1e-12 * c[name][1] for name in names[:2])
    healthy, cracked = (float(f) for f in re.findall(r"Modal\(1 frequencies: (\S+) Hz", text))
    assert cracked / healthy - 1.0 == pytest.approx(-0.01253, rel=1e-3)
    for name in ("figure_12.png", "figure_13.png", "orbit.png"):
        assert (tmp_path / name).stat().st_size > 20000


@pytest.mark.long
def test_loci(tmp_path):
    """A line of Neimark-Sacker points from 690 to 710 N; curves at the forces of its ends have the same
    bifurcation to 1e-6.
    """
    options = ("--forces", "700", "--modes", "40", "--start", "14138", "--stop", "14150")
    printed("loci", tmp_path, *options, "--least", "690", "--most", "710")
    (line,) = sb.read(str(tmp_path / "lines.h5"))
    assert line.kind == "Neimark-Sacker" and len(line) > 5
    reduced = sb.reduce(case_p(0.002), sb.PointForce("A", fy=1.0), modes=40)
    for k in (0, -1):
        assert line.value[k] == pytest.approx(690.0 if line.value[k] < 700.0 else 710.0)
        load, found = sb.PointForce("A", fy=float(line.value[k])), float(line.frequency[k])
        near = sb.frequency_response(
            reduced, load, found * (1 - 2e-4), found * (1 + 2e-4), steps=256, largest_step=5e-5 * found
        )
        values = [item.own_value for item in near.bifurcations if item.kind == line.kind]
        assert np.abs(np.array(values) / found - 1.0).min() < 1e-6
    assert (tmp_path / "loci.png").stat().st_size > 20000


@pytest.mark.long
def test_backbone(tmp_path):
    """Forced peaks 2.9e-4 and a quarter of it from the free motion of their amplitude at damping ratios of
    0.004 and 0.002.
    """
    options = ("--order", "4", "--modes", "50", "--ratios", "0.004", "0.002", "--forces", "90")
    text = printed("backbone", tmp_path, *options)
    one, other = (float(value) for value in re.findall(r", (\S+) from the free motion", text))
    assert 0.0 < one < 4e-4 and one / other == pytest.approx(4.0, rel=0.05)
    energy = sb.read(str(tmp_path / "backbone.h5"))["free"].energy
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
        ("harmonics", ("--frequencies", "-3"), "frequency = -3.0 must be at least 1e-12, in Hz"),
        ("frequency_response", ("--start", "14000", "--stop", "14000"), "stop = 14000 is start itself"),
        ("hole", ("--steps", "3"), "steps = 3 must be at least 48"),
    ],
)
def test_bad_options(tmp_path, name, options, sentence):
    done = on_ranks(1, f"examples/{name}.py", *options, "--output", str(tmp_path), check=False)
    assert done.returncode != 0 and sentence in done.stderr and "Traceback" not in done.stderr
