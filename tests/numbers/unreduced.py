"""Runs without modes: histories and steady motions of all unknowns."""

from __future__ import annotations

import functools

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, VNotch
from tests.numbers import bodies
from tests.numbers.table import Group

GROUP = Group(
    "unreduced",
    1e-10,
    "1e-10: the instruction sets of other processors, two and three ranks move them by up to 2e-12;\n"
    "1e-8 of orbits, which end by Newton's tolerance.",
    ranks=True,
)


@functools.cache
def body():
    shape = Beam(0.1, 0.02, (VNotch(0.04, 0.008, 0.02),))
    ratios = sb.rayleigh_factors(1000.0, 0.01, 9000.0, 0.01)
    return sb.Model(shape.mesh(order=2, face_edges=4), bodies.ALUMINIUM, rayleigh=ratios)


@GROUP.case
def history():
    load = sb.PointForce("A", fy=sb.ToneBurst(1e4, 4000.0, 2))
    found = sb.transient(body(), load, 1e-3, 1e-5, reduction=None)
    at = [20, 40, 60, 80, 100]
    yield "u", found.displacement("A")[at, 1]
    yield "resultant", found.contact_resultant.max()
    yield "energy", found.energy.total[at[1]]


@GROUP.case
def orbit():
    found = sb.periodic(body(), sb.PointForce("A", fy=3e3), 1200.0, steps=65, reduction=None)
    yield "harmonics", found.harmonics("A")[:5], 1e-8
    yield "resultant", found.contact_resultant.max(), 1e-8


@GROUP.case
def orbit_without_contact():
    found = sb.periodic(body(), sb.PointForce("A", fy=3e3), 1200.0, steps=65, reduction=None, contact=False)
    yield "harmonic", np.atleast_1d(found.harmonics("A")[1]), 1e-8
