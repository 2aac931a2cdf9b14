"""Families of steady motions over the frequency and the load, with their bifurcations."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from tests.numbers import bodies
from tests.numbers.table import Group
from tests.systems import one_mass, two_masses

GROUP = Group(
    "curves",
    1e-9,
    "1e-9: the instruction sets of other processors move points by up to 2e-10;\n"
    "1e-8 of bifurcations, which secants find, and of peaks (6e-10).",
)
TURN = 2.0 * np.pi


def of(branch, point):
    amplitude = branch.amplitude(point)
    peak = branch.peak(point)
    yield "first", amplitude[0]
    yield "last", amplitude[-1]
    yield "end", branch.value[-1]
    yield "peak", peak.amplitude, 1e-8
    yield "peak.at", peak.frequency, 1e-8
    yield "complete", branch.complete
    for kind in ("fold", "period doubling", "Neimark-Sacker", "branch point"):
        found = [item for item in branch.bifurcations if item.kind == kind]
        name = kind.replace(" ", "_")
        yield f"{name}.count", len(found)
        if found:
            yield f"{name}.at", [item.value for item in found], 1e-8


@GROUP.case
def beam_peak():
    """Of the first resonance, moved by contact."""
    load = sb.PointForce("A", fy=1e3)
    yield from of(sb.frequency_response(bodies.beam(), load, 1450.0, 1800.0, modes=6, steps=128), "A")


@GROUP.case
def beam_linear():
    load = sb.PointForce("A", fy=1e3)
    branch = sb.frequency_response(bodies.beam(), load, 1200.0, 1800.0, modes=6, contact=False)
    yield "peak", branch.peak("A").amplitude, 1e-8
    yield "peak.at", branch.peak("A").frequency, 1e-8


@GROUP.case
def beam_over_the_load():
    load = sb.PointForce("A", fy=3e3) + sb.PointForce("A", fx=sb.Constant(500.0))
    yield from of(sb.load_response(bodies.beam(), load, 1200.0, modes=6, steps=128), "A")


@GROUP.case
def one_mass_folds():
    system = one_mass(1.0, 0.03)
    yield from of(sb.frequency_response(system, 0.15, 0.9 / TURN, 1.3 / TURN, steps=256), "A")


@GROUP.case
def two_masses_bifurcate():
    system = two_masses(0.02, compliance=0.1)
    yield from of(sb.frequency_response(system, [0.1], 0.5 / TURN, 0.9 / TURN, steps=256), "1")


@GROUP.case
def two_masses_over_the_load():
    yield from of(sb.load_response(two_masses(0.05, compliance=0.1), 1.0, 0.14, 0.1, steps=256), "1")


@GROUP.case
def stiff_stop_doubles():
    """Doublings that stand where the steps put them."""
    system = one_mass(0.0, 0.02, stiffness=50.0)
    branch = sb.frequency_response(system, 1.0, 0.38, 0.44, steps=512)
    yield from of(branch, "A")
    doubled = next(item for item in branch.bifurcations if item.kind == "period doubling")
    orbit = sb.switch_branch(branch, doubled)
    yield "doubled.amplitude", orbit.amplitude("A"), 1e-8
    yield "doubled.at", orbit.frequency, 1e-8
