"""Displacements and stresses inside: of statics, of histories, of steady states."""

from __future__ import annotations

import sbfem_petsc as sb
from tests.numbers import bodies
from tests.numbers.table import Group

GROUP = Group(
    "fields",
    1e-10,
    "1e-10: the instruction sets of other processors, two and three ranks move them by up to 4e-12.",
    ranks=True,
)


@GROUP.case
def beam_static():
    found = sb.static(bodies.beam(), sb.PointForce("A", fy=3e4))
    for name, place in (("front", (0.02, 0.005)), ("tip", (0.041, 0.011)), ("end", (0.09, 0.01))):
        yield f"u.{name}", found.displacement(place)
        yield f"stress.{name}", found.stress(place)


@GROUP.case
def plate_static():
    found = sb.static(bodies.plate(), sb.EdgeLoad("edge3", tx=0.2, ty=1.0))
    _, u, stress = found.along((0.1, 0.2), (0.9, 0.8), 4)
    yield "u", u
    yield "stress", stress


@GROUP.case
def two_halves_static():
    found = sb.static(bodies.two_halves(), sb.EdgeLoad("top", tx=0.2, ty=-1.0))
    for name, place in (("low", (0.55, 0.48)), ("high", (0.55, 0.52))):
        yield f"stress.{name}", found.stress(place)


@GROUP.case
def beam_moving():
    load = sb.PointForce("A", fy=sb.ToneBurst(1e4, 4000.0, 2))
    found = sb.transient(bodies.beam(), load, 1e-3, 4e-6, modes=12)
    yield "stress", found.stress((0.02, 0.005))[[60, 120, 180]]
    yield "K", found.stress_intensity("crack1")[[60, 120, 180]]


@GROUP.case
def beam_steady():
    found = sb.periodic(
        bodies.beam(), sb.PointForce("A", fy=3e3), 1200.0, modes=12, steps=128, stability=False
    )
    yield "stress", found.stress((0.02, 0.005))[[0, 40, 80]]
    yield "K", found.stress_intensity("crack1")[[0, 40, 80]]
