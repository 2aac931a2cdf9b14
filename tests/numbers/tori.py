"""Motions of two tones."""

from __future__ import annotations

import functools

import numpy as np

import sbfem_petsc as sb
from tests.numbers import bodies
from tests.numbers.table import Group
from tests.systems import two_masses

GROUP = Group(
    "tori",
    1e-10,
    "1e-10: the instruction sets of other processors move them by up to 3e-13;\n"
    "1e-8 behind a bifurcation, which a secant finds.",
)
TURN = 2.0 * np.pi


def of(motion, point):
    yield "lines", np.array([motion.line(m, n, point) for m, n in ((1, 0), (0, 1), (1, 1), (1, -1), (2, 0))])
    yield "stable", motion.stable
    yield "frequencies", motion.frequencies


@GROUP.case
def beam_probed_and_pumped():
    load = sb.PointForce("A", fy=sb.Harmonic(1e3, 6000.0) + sb.Harmonic(3e3, 700.0))
    yield from of(sb.quasi_periodic(bodies.beam(), load, (6000.0, 700.0), modes=8, samples=11, steps=96), "A")


@GROUP.case
def two_masses_driven_twice():
    load = [sb.Harmonic(0.8, 0.11) + sb.Harmonic(0.3, 0.023)]
    yield from of(
        sb.quasi_periodic(two_masses(0.1, compliance=1.0), load, (0.11, 0.023), samples=15, steps=128), "1"
    )


@functools.cache
def curve():
    return sb.frequency_response(
        two_masses(0.02, compliance=0.1), [0.1], 0.607 / TURN, 0.602 / TURN, steps=256
    )


@GROUP.case
def own_tone():
    point = next(item for item in curve().bifurcations if item.kind == "Neimark-Sacker")
    motion = sb.switch_branch(curve(), point, samples=11)
    for name, value in of(motion, "1"):
        if name == "lines":  # the phase of its own tone is free
            value = np.abs(value)
        yield name, value, 1e-8
    branch = sb.quasi_periodic_response(motion, 0.603 / TURN, progress=None, stability=False)
    yield "last", np.abs([branch.motions[-1].line(m, n, "1") for m, n in ((1, 0), (0, 1), (1, 1))]), 1e-8
    yield "last.frequencies", branch.motions[-1].frequencies, 1e-8
