"""Motions in time: bursts, steps, functions and constants as loads, with contact and without."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from meshing import Beam
from tests.numbers import bodies
from tests.numbers.table import Group
from tests.systems import chain, two_masses

GROUP = Group(
    "histories",
    1e-10,
    "1e-10: the instruction sets of other processors, two and three ranks move them by up to 2e-11.",
    ranks=True,
)


def of(history, point, samples=5):
    """At equal intervals of time."""
    at = np.linspace(0, len(history.time) - 1, samples + 1).astype(int)[1:]
    yield "u", history.displacement(point)[at, 1]
    yield "v", history.velocity(point)[at, 1]
    if history.gap.shape[1]:
        yield "resultant", [history.contact_resultant[at[-1]], history.contact_resultant.max()]
    yield "energy", history.energy.total[at[[0, -1]]]


@GROUP.case
def beam_burst():
    burst = sb.PointForce("A", fy=sb.ToneBurst(1e4, 4000.0, 2))
    yield from of(sb.transient(bodies.beam(), burst, 2e-3, 4e-6, modes=12), "A")


@GROUP.case
def beam_burst_by_default():
    """The step that the program chooses."""
    burst = sb.PointForce("A", fy=sb.ToneBurst(1e4, 4000.0, 2))
    history = sb.transient(bodies.beam(), burst, 1e-3, modes=12)
    yield "steps", len(history.time) - 1
    yield from of(history, "A", 3)


@GROUP.case
def beam_burst_newmark():
    burst = sb.PointForce("A", fy=sb.ToneBurst(1e4, 4000.0, 2))
    yield from of(sb.transient(bodies.beam(), burst, 1e-3, 4e-6, modes=12, scheme="newmark"), "A", 3)


@GROUP.case
def slit_beam_support_motion():
    history = sb.transient(
        bodies.slit_beam(), sb.SupportMotion(ay=sb.Harmonic(1e5, 1000.0)), 2e-3, 5e-6, modes=10
    )
    yield from of(history, "A", 3)


@GROUP.case
def plate_burst():
    load = sb.EdgeLoad("edge3", tx=sb.ToneBurst(0.3, 0.2, 3), ty=-0.1)
    yield from of(sb.transient(bodies.plate(), load, 30.0, 0.05, modes=12), "P")


@GROUP.case
def preload_beside_a_tone():
    load = sb.EdgeLoad("right", ty=sb.Harmonic(2e6, 800.0)) + sb.EdgeLoad("right", tx=-5e6)
    beam = bodies.beam.__wrapped__()  # what other cases have left in the kept one moves these numbers by 3e-8
    yield from of(sb.transient(beam, load, 2e-3, 4e-6, modes=12), "A", 3)


def slender():
    return sb.Model(Beam(0.4, 0.01).mesh(order=3), sb.Material(70e9, 0.33, 2700), damping=0.005)


@GROUP.case
def jumps():
    """Of a step and of samples, at the default step."""
    loads = {
        "step": sb.Step(1.0, time=0.01),
        "risen": sb.Step(1.0, time=0.01, rise=1e-3),
        "samples": sb.Samples((0.0, 0.01, 0.010001, 0.04), (0.0, 0.0, 1.0, 1.0)),
        "begin": sb.Step(1.0),
    }
    model = slender()
    for name, signal in loads.items():
        history = sb.transient(model, sb.PointForce("A", fy=signal), 0.04, modes=4)
        at = np.searchsorted(history.time, [0.02, 0.03])
        yield (
            f"{name}.u",
            [np.interp(t, history.time, history.displacement("A")[:, 1]) for t in history.time[at]],
        )


@GROUP.case
def function_of_time():
    wave = sb.Custom(lambda t: np.sin(2.0 * np.pi * 2514.0 * t))
    history = sb.transient(slender(), sb.PointForce("A", fy=wave), 1.0, modes=4)
    yield "largest", np.abs(history.displacement("A")[:, 1]).max()


@GROUP.case
def two_masses_at_rest():
    history = sb.transient(two_masses(), sb.Harmonic(1.0, 0.12), 100.0, 0.05)
    yield from of(history, "1")


@GROUP.case
def two_masses_let_go():
    """Without damping: the energy stays."""
    system = two_masses(0.0)
    start = np.linspace(1.0, 2.0, len(system.omega)), np.zeros(len(system.omega))
    try:
        history = sb.transient(system, sb.Constant(0.0), 60.0, 0.05, initial=start)
    except sb.SolveError:
        yield "refused", True
        return
    yield "refused", False
    yield from of(history, "1")
    yield "work_of_contact", history.energy.contact[-1:]


@GROUP.case
def chain_in_few_modes():
    history = sb.transient(chain(3), [sb.Harmonic(0.3, 0.1), 0.05], 60.0, 0.05)
    yield from of(history, "3")
