"""Steady states in files, of reduced and of unreduced models."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from tests.systems import same_products

LOAD = sb.PointForce("A", fy=300.0)


@pytest.fixture(scope="module")
def model():
    beam = Beam(length=0.05, height=0.005, notches=[VNotch(x=0.02, depth=0.0025, opening=0.0458366)])
    material = sb.Material(70e9, 0.33, 2700)
    return sb.Model(beam.mesh(order=3, tip_size=2e-4), material, damping=0.01, rayleigh=(0.0, 2e-7))


@pytest.fixture(scope="module", params=["modes", None])
def orbit(request, model):
    options = {"modes": 16} if request.param else {"modes": 12, "steps": 128}
    return sb.periodic(model, LOAD, 1000.0, reduction=request.param, **options)


@pytest.mark.long
def test_what_is_read_is_what_was_found(orbit, tmp_path):
    path = tmp_path / "orbit.h5"
    sb.save(path, orbit)
    found = sb.read(path)
    assert orbit.contact_resultant.max() > 1.0 and repr(found) == repr(orbit)
    for name in ("time", "state", "multipliers"):
        np.testing.assert_array_equal(getattr(found, name), getattr(orbit, name), err_msg=name)
    for name in ("gap", "contact_force", "contact_resultant"):
        same_products(getattr(found, name), getattr(orbit, name), name)
    for name in ("frequency", "periods", "residuals", "path", "products", "converged", "points", "stable"):
        assert getattr(found, name) == getattr(orbit, name), name
    np.testing.assert_array_equal(found.multiplier_error, orbit.multiplier_error)
    for point in orbit.points:
        for ask in ("displacement", "velocity", "acceleration", "harmonics"):
            same_products(getattr(found, ask)(point), getattr(orbit, ask)(point), ask)
    same_products(found.stress_intensity(), orbit.stress_intensity())


@pytest.mark.slow
def test_the_file_explains_itself(orbit, tmp_path):
    path = tmp_path / "orbit.h5"
    sb.save(path, orbit)
    with h5py.File(path) as file:
        place = list(file["place"][:]).index(b"A")
        harmonics = file["harmonics"][:, place, 1]
        assert file["harmonics"].attrs["units"] == b"m" and file["displacement"].shape[1:] == (3, 2)
    same_products(harmonics, orbit.harmonics("A")[: len(harmonics)])


def test_a_read_orbit_is_a_first_guess(model, tmp_path):
    """A reduced one goes on in the file's own reduced model."""
    orbit = sb.periodic(model, LOAD, 1000.0, modes=16)
    sb.save(tmp_path / "orbit.h5", orbit)
    found = sb.read(tmp_path / "orbit.h5")
    again = sb.periodic(found.reduced, [300.0], 1000.0, guess=found)
    u = orbit.displacement("A")
    np.testing.assert_allclose(again.displacement("A"), u, rtol=0.0, atol=1e-8 * np.abs(u).max())


def test_no_place(orbit, tmp_path):
    with pytest.raises(ValueError, match="result file .* cannot be written: No such file"):
        sb.save(tmp_path / "none" / "a.h5", orbit)
    assert not list(tmp_path.iterdir())
