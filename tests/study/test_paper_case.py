"""The paper's beam as a case file: the numbers of examples/beam_notch.py, which has its own test against the
independent reference."""

import json

import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from meshing import Beam, VNotch
from tests.parallel import ROOT
from tests.reference import frequencies, statics
from tests.study.small_case import sbfem, written


@pytest.fixture(scope="module")
def summary(tmp_path_factory):
    """The case as it stands, but for pictures and ParaView files."""
    folder = tmp_path_factory.mktemp("paper")
    text = (ROOT / "examples" / "beam_notch.toml").read_text().replace("vtu = true", "pictures = false")
    done = sbfem("run", written(folder, text), "--output", folder / "out", "--quiet")
    assert done.code == 0, done.err
    return json.loads((folder / "out" / "summary.json").read_text())


@pytest.mark.slow
def test_numbers_of_the_example(summary):
    """Frequencies and statics as examples/beam_notch.py computes them."""
    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    material = sb.Material(young=70e9, poisson=0.33, density=2700)
    model = sb.Model(beam.mesh(order=5), material, clamped="left", continued_fraction=1, comm=MPI.COMM_SELF)
    modes = sb.modal(model, count=46)
    # the last digits depend on the order of the unknowns: 1e-7 in modes 1-2 and displacements
    np.testing.assert_allclose(summary["frequencies"]["frequencies"], modes.frequencies, rtol=1e-7)
    for force in (1, 100, 300):
        push = sb.static(model, sb.PointForce("A", fy=float(force)))
        found = summary[f"push_{force}"]
        for point in ("A", "B", "C"):
            np.testing.assert_allclose(found["displacement"][point], push.displacement(point), rtol=1e-6)
        assert found["contact_resultant"] == pytest.approx(push.contact_resultant, rel=1e-6)
        assert found["stress_intensity"]["crack1"] == pytest.approx(push.stress_intensity["crack1"], rel=1e-5)
    model.destroy()


def test_independent_reference(summary):
    """The tolerances of the example's own test."""
    np.testing.assert_allclose(
        summary["frequencies"]["frequencies"], frequencies("crack80_nu33")[:46], rtol=1e-4
    )
    for force, tolerance in ((1, 1e-4), (100, 2e-4), (300, 2e-4)):
        exact = statics("x80_mouth2um_nu33", f"{force} N")["u"]["A"]["uy"]
        assert summary[f"push_{force}"]["displacement"]["A"][1] == pytest.approx(exact, rel=tolerance)
