"""The detection study, small: what it reads from a motion."""

from __future__ import annotations

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from tests.examples.programs import EXAMPLES, run

POINTS = "start = 0.25e-3, stop = 2.5e-3, count = 10", "start = 0.04, stop = 0.36, count = 9"
FEWER = "start = 1e-3, stop = 2e-3, count = 2", "start = 0.12, stop = 0.28, count = 2"


@pytest.mark.long
def test_the_lines_it_reads(tmp_path):
    """The sidebands beside the pump's line are those of two tones of their own, by the method that knows no
    common period; on two ranks, picture included.
    """
    text = (EXAMPLES / "detection.toml").read_text()
    for points, fewer in zip(POINTS, FEWER):
        assert points in text
        text = text.replace(points, fewer)
    case = tmp_path / "case.toml"
    case.write_text(text)
    done = run("detection.py", "--case", case, "--output", tmp_path / "found", ranks=2)
    assert "sidebands 1, 2" in done.stdout and (tmp_path / "found" / "detection.png").exists()
    study = sb.read(tmp_path / "found" / "sweep.h5")
    (row,) = np.flatnonzero(
        (study.inputs["geometry.notches[0].depth"] == 2e-3) & (study.inputs["geometry.notches[0].x"] == 0.12)
    )
    lines = study.values["modulated/harmonics/A"][row]
    mesh = Beam(0.4, 0.005, [VNotch(0.12, 2e-3, 0.0458366)]).mesh()
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700.0), damping=0.002)
    loads = [sb.PointForce("A", fy=sb.Harmonic(*tone)) for tone in ((300.0, 400.0), (30.0, 3000.0))]
    motion = sb.quasi_periodic(model, loads, (400.0, 3000.0), samples=41)
    size = abs(motion.line(1, 0, "A"))
    assert abs(lines[2]) == pytest.approx(size, rel=2e-3)
    for place, n in ((11, -2), (13, -1), (15, 0), (17, 1), (19, 2)):
        assert abs(lines[place]) == pytest.approx(abs(motion.line(n, 1, "A")), rel=1e-2, abs=1e-6 * size)
