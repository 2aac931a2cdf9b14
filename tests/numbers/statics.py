"""Displacements, resultants, gaps, reactions and energies under constant loads."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, Plate, VNotch
from tests.numbers import bodies
from tests.numbers.table import Group

GROUP = Group(
    "statics",
    1e-10,
    "1e-10: the instruction sets of other processors, two and three ranks move them by up to 7e-12.",
    ranks=True,
)
PUSH = sb.PointForce("A", fy=3e4)


def of(found, point):
    yield "u", found.displacement(point)
    if len(found.gap):
        yield "resultant", found.contact_resultant
        yield "gap", [found.gap.min(), found.gap.max()]
        yield "touching", int(found.active.sum())
    yield "energy", found.strain_energy
    for name, force in found.reactions.items():
        yield f"reaction.{name}", force


@GROUP.case
def beam_closing():
    yield from of(sb.static(bodies.beam(), PUSH), "A")


@GROUP.case
def beam_opening():
    yield from of(sb.static(bodies.beam(), sb.PointForce("A", fy=-3e4)), "A")


@GROUP.case
def slit_beam_closing():
    found = sb.static(bodies.slit_beam(), sb.PointForce("A", fx=-1e5, fy=-2e4))
    yield from of(found, "A")
    yield "force", [found.contact_force.max(), np.median(found.contact_force)]


@GROUP.case
def notch_tilted_forwards():
    """Tractions on one face of a notch that leans."""
    yield from of(sb.static(bodies.tilted_beam(10.0), sb.EdgeLoad("crack1_left", pressure=1e6)), "A")


@GROUP.case
def notch_tilted_backwards():
    yield from of(sb.static(bodies.tilted_beam(-10.0), sb.EdgeLoad("crack1_left", pressure=1e6)), "A")


@GROUP.case
def plate_pressed():
    yield from of(sb.static(bodies.plate(), sb.EdgeLoad("edge3", pressure=1.0)), "P")


@GROUP.case
def plate_pulled():
    yield from of(sb.static(bodies.plate(), sb.EdgeLoad("edge3", pressure=-1.0)), "P")


@GROUP.case
def two_halves_pressed():
    yield from of(sb.static(bodies.two_halves(), sb.EdgeLoad("top", pressure=1.0, tx=0.3)), "P")


@GROUP.case
def branching_pressed():
    yield from of(sb.static(bodies.branching(), sb.EdgeLoad("top", pressure=1.0, tx=0.3)), "P")


@GROUP.case
def springs_and_a_fixed_point():
    """An elastic edge that shares a node with a point that is held."""
    held = [sb.Support("edge1", y=2.0, x=1.0), sb.Support("P")]
    mesh = Plate(bodies.SQUARE).mesh(order=3, points={"P": (0.0, 0.0), "Q": (1.0, 1.0)})
    yield from of(
        sb.static(sb.Model(mesh, bodies.UNIT, None, supports=held), sb.EdgeLoad("edge3", ty=0.1)), "Q"
    )


@GROUP.case
def elastic_layers():
    """A layer in a notch, in the tied and in the unilateral law."""
    mesh = Beam(0.1, 0.02, (VNotch(0.04, 0.008, 0.0),)).mesh(order=3, face_edges=6)
    for law in (sb.Tied(4e-13), sb.Unilateral(4e-13)):
        name = type(law).__name__.lower()
        found = sb.static(sb.Model(mesh, bodies.ALUMINIUM, contact_laws=law), PUSH)
        yield f"{name}.u", found.displacement("A")
        yield f"{name}.resultant", found.contact_resultant


@GROUP.case
def load_history():
    """Closing and opening again over a preload."""
    ramp = sb.Samples((0.0, 0.6, 1.0), (0.0, 5e4, 0.0))
    found = sb.load_history(
        bodies.beam(), sb.PointForce("A", fx=300.0, fy=ramp - 500.0), np.linspace(0, 1, 4)
    )
    yield "u", found.displacement("A")
    yield "resultant", found.contact_resultant
