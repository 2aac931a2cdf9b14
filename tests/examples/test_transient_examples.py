"""The transient examples run as programs and give their pinned numbers."""

import re

import numpy as np
import pytest

import sbfem_petsc as sb
from tests.examples.programs import printed
from tests.parallel import on_ranks


@pytest.mark.long
def test_tone_burst(tmp_path):
    """Figs. 5 and 6 at steps of 2 us: 4.3e-4 at 1 N and 3.9e-4 at 300 N off the reference, peak resultant
    0.014 % below its 19146.2 N.
    """
    text = printed("tone_burst", tmp_path, "--step", "2e-6")
    apart = [float(value) for value in re.findall(r"distance to the reference (\S+)", text)]
    assert apart == [pytest.approx(4.3e-4, rel=0.1), pytest.approx(3.9e-4, rel=0.1)]
    many = sb.read(str(tmp_path / "histories.h5"))["300 N"]
    assert many.contact_resultant.max() == pytest.approx(19143.6, rel=1e-4)
    assert np.abs(many.energy.balance).max() < 1e-6 * np.abs(many.energy.external).max()
    for name in ("burst_1N.png", "burst_300N.png"):
        assert (tmp_path / name).stat().st_size > 20000


@pytest.mark.long
def test_short_tone_burst_on_two_ranks(tmp_path):
    """5 ms on a coarse mesh: the same numbers on one rank and two."""
    mesh = ("--order", "4", "--grading", "2.5", "--tip-size", "5e-5", "--no-pictures")
    found = []
    for ranks in (1, 2):
        options = ("--duration", "0.005", "--step", "4e-6", "--modes", "40")
        printed("tone_burst", tmp_path / str(ranks), *options, *mesh, ranks=ranks)
        histories = sb.read(str(tmp_path / str(ranks) / "histories.h5"))
        found.append(np.array([h.displacement("A")[:, 1] for h in histories.values()]))
    np.testing.assert_allclose(found[1], found[0], rtol=0.0, atol=1e-6 * np.abs(found[0]).max())


@pytest.mark.long
def test_long_beam(tmp_path):
    """Fig. 7: the line at f1 + f_omega stands at 1.14e-3 m/s^2 in the first second of the cracked beam (steps
    of 8 to 1 us: 1.63, 1.16, 1.12, 1.14e-3), and not in the healthy one.
    """
    text = printed("long_beam", tmp_path, "--duration", "2", "--order", "4")
    opened, healthy = re.search(r"open crack (\S+) Hz .*?healthy (\S+) Hz", text).groups()
    assert float(opened) == pytest.approx(59.545, abs=2e-3)
    assert float(healthy) == pytest.approx(60.221, abs=2e-3)
    cracked, intact = (
        float(re.search(rf"{name}, early: 1 to 6 f1 \S+ \S+ (\S+)", text).group(1))
        for name in ("cracked", "healthy")
    )
    assert cracked == pytest.approx(1.14e-3, rel=0.05) and intact < 1e-3 * cracked
    assert (tmp_path / "figure_7.png").stat().st_size > 20000


@pytest.mark.long
def test_modulation(tmp_path):
    """Fig. 10: modulation index 0.0113 of the first pair (0.01155 settled, order 5), .131 of the second; none
    in the healthy beam.
    """
    text = printed("modulation", tmp_path, "--step", "5e-6", "--rise", "0.2", "--order", "4")
    healthy, cracked = (float(value) for value in re.findall(r"modulation index .*? = (\S+)\)", text))
    assert cracked == pytest.approx(0.01134, rel=0.03) and healthy < 1e-3
    carrier, lower, upper = (
        float(value)
        for value in re.findall(r"carrier 3000 Hz: (\S+);.*?\+2 x 433 Hz: (\S+), (\S+),", text)[1]
    )
    assert (lower + upper) / carrier == pytest.approx(0.131, rel=0.03)
    assert (tmp_path / "figure_10.png").stat().st_size > 20000


@pytest.mark.long
def test_bad_options(tmp_path):
    done = on_ranks(1, "examples/tone_burst.py", "--duration", "-1", "--output", str(tmp_path), check=False)
    sentence = "duration = -1.0 must be above 0, in s"
    assert done.returncode != 0 and sentence in done.stderr and "Traceback" not in done.stderr
