"""Free motions over the energy."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from tests.numbers import bodies
from tests.numbers.table import Group
from tests.systems import one_mass, two_masses

GROUP = Group(
    "free",
    1e-10,
    "1e-10: the instruction sets of other processors move them by up to 4e-13;\n"
    "what is read between points, 1e-6; errors, 1e-2.",
)


def of(backbone, point, energies):
    order = np.argsort(backbone.energy)
    at = np.log(backbone.energy[order])
    yield "ends", backbone.energy[[0, -1]]
    yield "frequency", backbone.frequency[[0, -1]]
    yield "amplitude", backbone.amplitude(point)[[0, -1]]
    yield "between", np.interp(np.log(energies), at, backbone.frequency[order]), 1e-6
    yield "error", backbone.frequency_error[-1], 1e-2
    if backbone.damped:
        yield "damping", backbone.damping_ratio[[0, -1]]


@GROUP.case
def one_mass_with_a_stop():
    found = sb.backbone(one_mass(1.0, 0.01, stiffness=8.0), 1, 0.6, 3.0, damping=True, steps=128)
    yield from of(found, "A", (0.9, 2.0))


@GROUP.case
def two_masses_first():
    yield from of(sb.backbone(two_masses(0.0), 1, 0.2, 2.0, steps=128), "1", (0.5, 1.0))


@GROUP.case
def beam_first():
    found = sb.backbone(bodies.beam(), 1, 1e-3, 3e-2, modes=4, steps=128, refine=False, stability=False)
    yield from of(found, "A", (3e-3, 1e-2))
