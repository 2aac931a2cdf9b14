"""Systems that several test files take: masses with a stop, the paper's beam."""

from __future__ import annotations

import functools

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, VNotch
from tests.reference import paper_beam

ALUMINIUM = sb.Material(70e9, 0.33, 2700)


def two_masses(damping: float = 0.03, compliance: float = 0.01, force: float = 1.0) -> sb.ReducedModel:
    """Masses 1, 1 on springs 1 between and 1 to ground, damping `damping` K, a load of `force` on the second
    mass, an elastic stop for the first at a distance of 1: example 03 of NLvib, in rad/s.
    """
    stiffness = np.array([[1.0, -1.0], [-1.0, 2.0]])
    return sb.reduce_matrices(
        np.eye(2),
        stiffness,
        np.array([[1.0, 0.0]]),
        np.array([1.0]),
        loads=np.array([[0.0], [force]]),
        sensors={"1": 0, "2": 1},
        damping=damping * stiffness,
        compliance=np.array([compliance]),
    )


def beside_another(coupling: float, frequency: float) -> sb.ReducedModel:
    """Mass 1 on a spring 1 with an elastic stop of stiffness 3 at a distance of 1, coupled to a mass 1 of its
    own frequency in rad/s; without damping.
    """
    return sb.reduce_matrices(
        np.eye(2),
        np.array([[1.0, -coupling], [-coupling, frequency**2]]),
        np.array([[1.0, 0.0]]),
        np.ones(1),
        loads=np.zeros((2, 1)),
        sensors={"1": 0, "2": 1},
        compliance=np.array([1.0 / 3.0]),
    )


def one_mass(gap: float, damping: float, *, stiffness: float = 1.0, towards: float = -1.0) -> sb.ReducedModel:
    """Mass 1 on a spring 1, in rad/s, with an elastic stop of some stiffness at a distance `gap`; it is met
    at positive displacements, or at negative ones where `towards` is 1.
    """
    return sb.reduce_matrices(
        np.eye(1),
        np.eye(1),
        np.array([[towards]]),
        np.array([gap]),
        loads=np.ones((1, 1)),
        sensors={"A": 0},
        damping=damping,
        compliance=np.array([1.0 / stiffness]),
    )


CHAIN_MASS = np.diag([1.0, 2.0, 1.0, 3.0, 1.0])
CHAIN_STIFFNESS = 2.0 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1)
CHAIN_COMPLIANCE = np.array([0.05, 0.1])


def chain(modes: int = 5, damping: float = 0.03) -> sb.ReducedModel:
    """Five masses between two walls, forces on "0" and "3", elastic stops 0.02 from "1" and "4"; in fewer
    modes than five the others act by their flexibility.
    """
    return sb.reduce_matrices(
        CHAIN_MASS,
        CHAIN_STIFFNESS,
        np.eye(5)[[1, 4]],
        np.full(2, 0.02),
        loads=np.eye(5)[:, [0, 3]],
        sensors={str(k): k for k in range(5)},
        modes=modes,
        damping=damping,
        compliance=CHAIN_COMPLIANCE,
    )


def short_beam(damping: float = 0.0) -> sb.Model:
    """50 x 5 mm with the paper's notch at 20 mm, order 3: small and fast, 1.6 kHz its first frequency."""
    beam = Beam(0.05, 0.005, (VNotch(0.02, 0.0025, 0.0458366),))
    return sb.Model(beam.mesh(order=3, tip_size=2e-4), ALUMINIUM, damping=damping)


@functools.cache
def case_p(damping: float = 0.0) -> sb.Model:
    """The paper's beam (80 mm, mouth of 2 micrometres, Poisson's ratio 0.33) on the default mesh; one for the
    whole run, not to be destroyed.
    """
    return sb.Model(paper_beam().mesh(), ALUMINIUM, damping=damping)


@functools.cache
def coarse_beam(damping: float = 0.0) -> sb.Model:
    """The same beam of order 3 with a tip element of 0.2 mm: small, for what does not depend on the mesh."""
    return sb.Model(paper_beam().mesh(order=3, tip_size=2e-4), ALUMINIUM, damping=damping)


def same_products(found, expected, name: str = "") -> None:
    """Products of equal states agree to 16 units in the last place of their largest entry, not to the last
    bit: their terms are summed in another order where an array lies otherwise in memory, in a file, or is one
    of more rows.
    """
    atol = 16.0 * np.finfo(float).eps * np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=atol, err_msg=name)
