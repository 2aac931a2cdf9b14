"""Steady motions: harmonics, multipliers, subharmonics."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from tests.numbers import bodies
from tests.numbers.table import Group
from tests.systems import chain, one_mass, two_masses

GROUP = Group(
    "orbits",
    1e-10,
    "1e-10: the instruction sets of other processors, two and three ranks move them by up to 5e-12.",
    ranks=True,
)
TURN = 2.0 * np.pi


def of(orbit, point, harmonics=4):
    yield "harmonics", orbit.harmonics(point)[: harmonics + 1]
    yield "multipliers", np.sort(np.abs(orbit.multipliers))[::-1][:2]
    yield "stable", orbit.stable
    yield "resultant", orbit.contact_resultant.max()


@GROUP.case
def beam_near_resonance():
    yield from of(sb.periodic(bodies.beam(), sb.PointForce("A", fy=3e3), 1200.0, modes=12, steps=128), "A")


@GROUP.case
def beam_superharmonic():
    yield from of(
        sb.periodic(bodies.slit_beam(), sb.PointForce("A", fy=3e3), 700.0, modes=12, steps=128), "A"
    )


@GROUP.case
def beam_by_default():
    """Modes and steps that the program chooses."""
    orbit = sb.periodic(bodies.beam(), sb.PointForce("A", fy=3e3), 3000.0, stability=False)
    yield "steps", len(orbit.time) - 1
    yield "harmonics", orbit.harmonics("A")[:4]


@GROUP.case
def beam_in_segments():
    load = sb.PointForce("A", fy=3e3)
    yield from of(sb.periodic(bodies.beam(), load, 1200.0, modes=6, steps=128, segments=4), "A", 3)


@GROUP.case
def constant_beside_a_tone():
    load = sb.EdgeLoad("right", ty=sb.Harmonic(2e6, 800.0)) + sb.EdgeLoad("right", tx=sb.Constant(-5e6))
    orbit = sb.periodic(bodies.beam(), load, 800.0, modes=12, steps=128, stability=False)
    yield "harmonics", orbit.harmonics("A")[:4]
    yield "mean", orbit.contact_resultant.mean()


@GROUP.case
def plate_pressed():
    orbit = sb.periodic(bodies.plate(), sb.EdgeLoad("edge3", ty=0.1), 0.05, modes=12, steps=128)
    yield from of(orbit, "P", 3)


@GROUP.case
def two_halves_pressed():
    orbit = sb.periodic(bodies.two_halves(), sb.EdgeLoad("top", ty=0.1), 0.05, modes=12, steps=128)
    yield from of(orbit, "P", 3)


def stiff(damping=0.02):
    """A stop fifty times as stiff as the mass's spring, at no distance."""
    return one_mass(0.0, damping, stiffness=50.0)


@GROUP.case
def stiff_stop():
    """Near a doubling of the period, at which the steps decide on the verdict."""
    for frequency in (0.42, 0.40, 0.39725411):
        orbit = sb.periodic(stiff(), 1.0, frequency, steps=512, periods=1)
        yield f"{frequency}.multiplier", np.abs(orbit.multipliers).max()
        yield f"{frequency}.stable", orbit.stable


@GROUP.case
def doubled():
    orbit = sb.periodic(stiff(), 1.0, 0.41, steps=512, periods=2)
    yield "subharmonics", orbit.subharmonics("A")[:4]
    yield "harmonics", orbit.harmonics("A")[:4]


@GROUP.case
def two_masses_touching():
    yield from of(sb.periodic(two_masses(0.03), 1.0, 0.11, steps=256), "1", 5)


@GROUP.case
def chain_in_few_modes():
    yield from of(sb.periodic(chain(3), [0.3, 0.1], 0.12, steps=256), "3", 5)


@GROUP.case
def pulses():
    """A function of time of a twentieth's duty."""
    frequency = 0.1
    train = sb.Custom(lambda t: ((t * frequency) % 1.0 < 0.05).astype(float))
    orbit = sb.periodic(two_masses(0.03), train, frequency, steps=256)
    yield "harmonics", orbit.harmonics("2")[:4]
