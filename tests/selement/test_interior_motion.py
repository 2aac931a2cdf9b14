"""Motion inside S-elements against plane waves."""

from __future__ import annotations

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.material import Material
from sbfem_petsc.selement.interior_motion import inertial_operators, interior_fields
from sbfem_petsc.selement.points import locate, point_operators
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement
from tests.selement.test_interior import pentagon
from tests.systems import short_beam

MATERIAL = Material(1.0, 0.3, 1.0)
ORDER, TERMS = 8, 3
DIRECTION = np.array([np.cos(0.4), np.sin(0.4)])
POINTS = np.array([[0.1, 0.05], [-0.3, 0.2], [0.25, -0.4]])


@pytest.fixture(scope="module")
def sectors():
    outline = pentagon(ORDER)
    return Sectors(outline / np.hypot(*outline.T).max(), ORDER, MATERIAL.elasticity)


@pytest.fixture(scope="module")
def element(sectors):
    return solve_selement(sectors, True, TERMS)


def wave(at, omega, *, shear):
    """Real and imaginary part together: displacement (n, 2) and stress (n, 3) of a plane wave."""
    stiffness = MATERIAL.elasticity
    k = omega / np.sqrt(stiffness[2, 2] if shear else stiffness[0, 0])
    moves = np.array([-DIRECTION[1], DIRECTION[0]]) if shear else DIRECTION
    phase = np.exp(1j * k * at @ DIRECTION)[:, None]
    (x, y), (u, v) = DIRECTION, moves
    strain = 1j * k * np.array([x * u, y * v, x * v + y * u])
    return phase * moves, phase * (stiffness @ strain)


def auxiliary(element, boundary, omega):
    """Its unknowns at a frequency, from the pencil of the S-element."""
    return omega**2 / (1.0 - omega**2 * element.inertia) * (element.coupling.T @ boundary)


@pytest.mark.parametrize("shear", [False, True])
def test_plane_waves(element, sectors, shear):
    """The motion of the boundary gives that inside but for the fourth term, which is left out: omega^8,
    256 times as much at twice the frequency.
    """
    levels, errors = np.array([0.8, 0.5, 0.2]), []
    static, fields = interior_fields(element, levels, TERMS)
    located = locate(*sectors[:2], True, POINTS)
    resting = point_operators(element.radial, sectors, located=located, closed=True)
    moving = inertial_operators(element, TERMS, located)
    for omega in (0.25, 0.5):
        boundary = wave(element.coordinates, omega, shear=shear)[0].ravel()
        own = auxiliary(element, boundary, omega)
        far = [
            static[i] @ boundary
            + fields[i] @ own
            - wave(xi * element.coordinates, omega, shear=shear)[0].ravel()
            for i, xi in enumerate(levels)
        ]
        exact = wave(POINTS, omega, shear=shear)
        inside = [
            rest @ boundary + more[..., : len(own)] @ own - known
            for rest, more, known in zip(
                (resting.displacement, resting.stress), (moving.displacement, moving.stress), exact
            )
        ]
        errors.append([np.abs(part).max() for part in (far, *inside)])
    assert np.array(errors[1]) / errors[0] == pytest.approx(256.0, rel=0.5)
    assert errors[1][0] < 1e-10


def test_moving_tip():
    """It has a displacement and no stress."""
    motion = sb.transient(short_beam(), sb.PointForce("A", fy=1.0), 1e-5, 1e-6, modes=4)
    assert np.isnan(motion.stress((0.02, 0.0025))).all()
    assert np.isfinite(motion.displacement((0.02, 0.0025))).all()
