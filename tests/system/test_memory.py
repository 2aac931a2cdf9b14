"""Memory stays flat over many calls of the analyses, each with a model of its own."""

import ctypes
import gc
import sys
import warnings

import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch

PUSH = sb.PointForce("A", fy=10.0)
ANALYSES = {
    "modal": lambda model: sb.modal(model, 4),
    "band": lambda model: sb.modal(model, band=(100.0, 6000.0)),
    "static": lambda model: sb.static(model, PUSH),
    "reduce": lambda model: sb.reduce(model, PUSH, modes=6),
    "transient": lambda model: sb.transient(model, PUSH, 1e-3, 1e-5, modes=6),
    "unreduced transient": lambda model: sb.transient(model, PUSH, 1e-4, 1e-5, reduction=None),
    "periodic": lambda model: sb.periodic(model, PUSH, 300.0, modes=6, steps=64),
}
# The first calls fill caches and the allocator's pools; a leaked factor alone takes 200 kB and more.
FIRST, CALLS, LIMIT = 60, 200, 10_000


def resident() -> int:
    """Bytes of memory of this process, without what the allocator keeps for later."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize("name", ANALYSES)
def test_memory_is_flat(name):
    """Less than 10 kB a call."""
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.05)]).mesh(order=1, face_edges=2)
    steel = sb.Material(70e9, 0.33, 2700)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for call in range(FIRST + CALLS):
            if call == FIRST:
                before = resident()
            with sb.Model(mesh, steel, damping=0.02) as model:
                ANALYSES[name](model)
    assert (resident() - before) / CALLS < LIMIT
