"""What a start leads to, and slowly swept frequencies."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from tests.numbers import bodies
from tests.numbers.table import Group
from tests.systems import one_mass

GROUP = Group("basins", 1e-10, "1e-10: the instruction sets of other processors move them by up to 4e-13.")
TURN = 2.0 * np.pi


@GROUP.case
def one_mass_basins():
    axes = [sb.StartAxis(np.linspace(-4.0, 4.0, 7)), sb.StartAxis(np.linspace(-4.0, 4.0, 7), "velocity")]
    found = sb.basins(one_mass(1.0, 0.03), 0.15, 1.08 / TURN, axes, steps=128)
    sizes = np.sort([orbit.amplitude("A") for orbit in found.orbits])
    yield "amplitudes", sizes
    yield "orbits", len(found.orbits)
    yield "share", np.sort(found.share)
    yield "settled", int((found.reached >= 0).sum())


@GROUP.case
def one_mass_swept():
    for name, ends in (("up", (0.95, 1.2)), ("down", (1.2, 0.95))):
        start, stop = (end / TURN for end in ends)
        found = sb.swept_response(one_mass(1.0, 0.03), 0.15, start, stop, duration=1200.0, steps=128)
        yield f"{name}.largest", found.amplitude("A").max()
        yield f"{name}.jumps", [jump.frequency for jump in found.jumps("A")]


@GROUP.case
def beam_swept():
    found = sb.swept_response(
        bodies.beam(), sb.PointForce("A", fy=1e3), 1450.0, 1650.0, duration=0.1, steps=96, modes=6
    )
    amplitude = found.amplitude("A")
    yield "largest", amplitude.max()
    yield "last", amplitude[-1]
