"""Natural frequencies and shapes of open cracks."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, Plate, VNotch
from tests.numbers import bodies
from tests.numbers.table import Group

GROUP = Group(
    "modes",
    1e-10,
    "1e-10: the instruction sets of other processors, two and three ranks move them by up to 2e-11.",
    ranks=True,
)


def of(model, count=4):
    found = sb.modal(model, count)
    for k, frequency in enumerate(found.frequencies, 1):
        yield f"f{k}", frequency


@GROUP.case
def beam():
    yield from of(bodies.beam())
    yield "A.1", np.abs(sb.modal(bodies.beam(), 2).displacement("A"))


@GROUP.case
def slit_beam():
    yield from of(bodies.slit_beam())


@GROUP.case
def plate():
    yield from of(bodies.plate())


@GROUP.case
def two_halves():
    yield from of(bodies.two_halves())


@GROUP.case
def branching():
    yield from of(bodies.branching())


@GROUP.case
def free_plate():
    """Without supports: the first three are of the rigid body."""
    yield from list(of(sb.Model(Plate(bodies.SQUARE).mesh(order=4), bodies.UNIT, None), 6))[3:]


@GROUP.case
def orthotropic_plate():
    wood = sb.OrthotropicMaterial(10.0, 1.0, 0.3, 0.7, 1.0, angle=25.0)
    yield from of(sb.Model(Plate(bodies.SQUARE).mesh(order=4), wood, "edge4"), 3)


@GROUP.case
def thick_beam_on_springs():
    """Plane strain, two notches, an elastic support and a continued fraction of order 2."""
    material = sb.Material(70e9, 0.33, 2700, plane="strain")
    shape = Beam(0.1, 0.02, (VNotch(0.03, 0.008, 1.0), VNotch(0.07, 0.006, 1.0)))
    held = [sb.Support("left", x=True, y=True), sb.Support("bottom", y=1e9)]
    model = sb.Model(shape.mesh(order=3), material, None, 2, thickness=0.01, supports=held)
    yield from of(model, 3)
