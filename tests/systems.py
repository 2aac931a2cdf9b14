"""Systems that several test files take: two masses with a stop, the paper's beam."""

from __future__ import annotations

import functools

import numpy as np

import sbfem_petsc as sb
from tests.reference import paper_beam

ALUMINIUM = sb.Material(70e9, 0.33, 2700)


def two_masses(damping: float = 0.03) -> sb.Reduction:
    """Masses 1, 1 on springs 1 between and 1 to ground, damping `damping` K, a force on the second mass, and an
    elastic stop (100) for the first at a distance of 1: example 03 of NLvib, in rad/s.
    """
    stiffness = np.array([[1.0, -1.0], [-1.0, 2.0]])
    return sb.reduce_matrices(
        np.eye(2),
        stiffness,
        np.array([[1.0, 0.0]]),
        np.array([1.0]),
        loads=np.array([[0.0], [1.0]]),
        sensors={"1": 0, "2": 1},
        damping=damping * stiffness,
        compliance=np.array([0.01]),
    )


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
