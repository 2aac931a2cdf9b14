"""Free motions over the energy."""

from __future__ import annotations

from functools import partial

import sbfem_petsc as sb
from tests.numbers import bodies
from tests.numbers.table import Group
from tests.systems import one_mass, two_masses

GROUP = Group(
    "free",
    1e-10,
    "1e-10: the instruction sets of other processors move them by up to 4e-13;\nerrors, 1e-2.",
)


def of(follow, point, start, energies):
    """Numbers of a branch up to the last of some energies, and frequencies at the others: those of branches
    that end there, for between points they would be those of chords.
    """
    backbone = follow(start, energies[-1])
    yield "ends", backbone.energy[[0, -1]]
    yield "frequency", backbone.frequency[[0, -1]]
    yield "amplitude", backbone.amplitude(point)[[0, -1]]
    yield "at", [follow(start, energy).frequency[-1] for energy in energies[:-1]]
    yield "error", backbone.frequency_error[-1], 1e-2
    if backbone.damped:
        yield "damping", backbone.damping_ratio[[0, -1]]


@GROUP.case
def one_mass_with_a_stop():
    system = one_mass(1.0, 0.01, stiffness=8.0)
    follow = partial(sb.backbone, system, 1, damping=True, steps=128)
    yield from of(follow, "A", 0.6, (0.9, 2.0, 3.0))


@GROUP.case
def two_masses_first():
    follow = partial(sb.backbone, two_masses(0.0), 1, steps=128)
    yield from of(follow, "1", 0.2, (0.5, 1.0, 2.0))


@GROUP.case
def beam_first():
    options = {"modes": 4, "steps": 128, "refine": False, "stability": False}
    follow = partial(sb.backbone, bodies.beam(), 1, **options)
    yield from of(follow, "A", 1e-3, (3e-3, 1e-2, 3e-2))
