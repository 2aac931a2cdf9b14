"""The back ends of the one active set for distributed structures, in sequences of problems. The oracle is the
complementarity conditions with the structure's flexibility, as in `test_kernel_properties`.
"""

from contextlib import closing

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from sbfem_petsc.contact.complementarity import active_set
from sbfem_petsc.contact.law import FREE, PRESSED, PULLED
from sbfem_petsc.system.contact.bordered_contact import Bordered
from sbfem_petsc.system.contact.dual_contact import Dual
from sbfem_petsc.system.contact.expected_contact import _along_edges
from tests.contact.test_kernel_properties import gaps
from tests.systems import ALUMINIUM

# twice the width of a notch's mouth
MIXED = {"crack1": sb.Clearance(width=4e-6), "crack2": sb.Tied()}


@pytest.fixture(scope="module", params=[(0, {}), (4, {}), (4, MIXED)], ids=["pairs", "tips", "laws"])
def structure(request):
    """A short beam with two notches, some 60 contact rows, and their flexibility."""
    modes, laws = request.param
    notches = [VNotch(0.04, 0.003, 0.0382), VNotch(0.1, 0.003, 0.0382)]
    mesh = Beam(length=0.2, height=0.006, notches=notches).mesh(order=2)
    with sb.Model(mesh, ALUMINIUM, tip_modes=modes, contact_laws=laws) as model:
        yield model, model.compliance.gaps


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", [Bordered, Dual])
def test_sequences(structure, kind, count):
    """Some 40 problems over the three structures, or 160 in the long run, each from the set before or any
    other. Each row is trusted to 1e-9 of the largest, and moves the others.
    """
    model, w = structure
    laws, unit = model.contact.laws, np.sqrt(np.diag(w))
    generator, problems, unsolved, states = np.random.default_rng(3), 0, 0, set()
    for seed in range(count):
        start = None
        for gap in list(gaps(len(w), unit, np.random.default_rng(seed)))[:: 5 if count == 1 else 4]:
            with closing(kind(model.statics, model.contact)) as backend:
                found, _ = active_set(backend, gap, laws, start)
            problems += 1
            if found is None:  # a cycle, or borders that are not solved to round-off: left to the flexibility
                unsolved += 1
                continue
            left = w @ found.force + gap
            kept = laws.places(found.state)
            off = np.where(found.active, np.abs(left - kept), -laws.room(left))
            assert off.max() <= 1e-9 * len(w) * (np.abs(w) @ np.abs(found.force) + np.abs(gap)).max()
            assert not found.force[~found.active].any()
            assert ((found.force >= 0.0) | laws.fixed | (found.state == PULLED)).all()
            assert ((found.force <= 0.0) | (found.state == PRESSED)).all()
            states |= set(found.state.tolist())
            start = found.state if generator.random() < 0.8 else generator.integers(0, 3, len(w))
    assert unsolved <= 0.1 * problems
    assert states >= {FREE, PRESSED} and (PULLED in states) == np.isfinite(laws.table.most[FREE]).any()


@pytest.mark.parametrize("edges", [60, 110])
def test_faces_of_many_edges_that_close(edges):
    """All 131 and 231 pairs of an oblique crack close, whose borders put off so many pivots that MUMPS needs
    more workspace than it expects: the forces are those of the flexibility.
    """
    crack = CrackLine([(0.06, 0.005), (0.0615, 0.0025)])
    mesh = Plate([(0, 0), (0.2, 0), (0.2, 0.005), (0, 0.005)], cracks=[crack]).mesh(order=2, face_edges=edges)
    with sb.Model(mesh, ALUMINIUM, clamped="edge4") as model:
        count = len(model.contact)
        with closing(Bordered(model.statics, model.contact)) as backend:
            force, moved = backend.closed(np.ones(count, dtype=bool), np.full(count, -1e-8), None)
        np.testing.assert_allclose(moved, 1e-8, rtol=1e-9)
        np.testing.assert_allclose(model.compliance.gaps @ force, moved, rtol=1e-7)


def test_coarse_displacements_are_linear_along_edges():
    """Both displacements along x, which a support holds at x = 0, are among them."""
    mesh = Plate([(0, 0), (0.2, 0), (0.2, 0.1), (0, 0.1)]).mesh(order=3, size=0.1)
    with sb.Model(mesh, ALUMINIUM, clamped="edge4") as model:
        layout, along = model.layout, _along_edges(model.statics.elements)
        table = along.convert("dense").getDenseArray()
        for axis in np.eye(2):
            field = layout.owned_values(layout.part.coordinates[:, :1] * axis)
            _, (left,), _, _ = np.linalg.lstsq(table, field, rcond=None)
            assert left < 1e-24 * (field @ field)
        along.destroy()
