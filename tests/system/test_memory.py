"""Memory stays flat over many calls of the analyses, each with a model of its own."""

import sys

import pytest

from tests.parallel import answer, on_ranks

PROGRAM = """
import ctypes, gc, json, sys, warnings
import sbfem_petsc as sb
from mpi4py import MPI
from meshing import Beam, VNotch

push = sb.PointForce("A", fy=10.0)
ANALYSES = {
    "modal": lambda model: sb.modal(model, 4),
    "band": lambda model: sb.modal(model, band=(100.0, 6000.0)),
    "static": lambda model: sb.static(model, push),
    "reduce": lambda model: sb.reduce(model, push, modes=6),
    "transient": lambda model: sb.transient(model, push, 1e-3, 1e-5, modes=6),
    "unreduced transient": lambda model: sb.transient(model, push, 1e-4, 1e-5, reduction=None),
    "periodic": lambda model: sb.periodic(model, push, 300.0, modes=6, steps=64),
}

def resident():
    "Bytes of memory of this process, without what the allocator keeps for later."
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096

warnings.simplefilter("ignore")
names, first, calls = sys.argv[1].split(","), int(sys.argv[2]), int(sys.argv[3])
mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.05)]).mesh(order=1, face_edges=2)
steel = sb.Material(70e9, 0.33, 2700)
for call in range(first + calls):
    if call == first:
        before = resident()
    for name in names:
        with sb.Model(mesh, steel, damping=0.02) as model:
            ANALYSES[name](model)
growth = MPI.COMM_WORLD.allreduce(resident() - before, MPI.MAX) / calls / len(names)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({"growth": growth}))
"""
# Bytes a call. Measured over 200 calls: below 1500; a factorisation that is kept alone takes 200,000.
LIMIT = 10_000

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


def growth(names: str, ranks: int, first: int, calls: int) -> float:
    """Bytes a call after the first calls, which fill caches and the allocator's pools."""
    done = on_ranks(ranks, PROGRAM, names, str(first), str(calls), timeout=600)
    return answer(done)["growth"]


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "name",
    [
        "modal",
        "static",
        "reduce",
        "transient",
        pytest.param("periodic", marks=pytest.mark.xfail(reason="a known defect: 20 kB a call")),
    ],
)
def test_memory_is_flat_over_500_calls(name):
    assert growth(name, 1, 20, 500) < LIMIT


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", ["band", "unreduced transient"])
def test_memory_is_flat_on_other_paths(name):
    assert growth(name, 1, 60, 150) < LIMIT


@pytest.mark.long
@pytest.mark.timeout(900)
def test_memory_is_flat_on_two_ranks():
    assert growth("modal,static,transient", 2, 20, 50) < LIMIT
