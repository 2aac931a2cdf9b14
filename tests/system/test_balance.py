"""Items of work that ranks take over from one another: each done once, in order, errors told on all ranks."""

import pytest

from sbfem_petsc.petsc import MPI
from sbfem_petsc.ranks.balance import balanced
from tests.parallel import answer, on_ranks

# What each rank is given: all on the last one, none on the first, all on few of many, none at all, one each.
UNEVEN = """
import json
import numpy as np
from mpi4py import MPI
from sbfem_petsc.ranks.balance import balanced
comm = MPI.COMM_WORLD
lengths = {
    "last": 150 * (comm.rank == comm.size - 1),
    "none on the first": 40 * comm.rank,
    "none": 0,
    "one each": 1,
    "two on the first": 2 * (comm.rank == 0),
    "empty and heavy": 3 if comm.rank else 400,
}
told = {}
for name, length in lengths.items():
    done = []
    items = [(comm.rank, number, np.full(number, 1.0 + comm.rank)) for number in range(length)]
    def work(item):
        done.append(item[:2])
        return item[0], item[1], 2.0 * item[2], bytes(20_000)
    found = balanced(comm, items, work)
    right = len(found) == length and all(
        (rank, number) == (comm.rank, k) and (values == 2.0 * items[k][2]).all() and len(values) == k
        for k, (rank, number, values, _) in enumerate(found)
    )
    told[name] = comm.gather((right, done, length))
if comm.rank == 0:
    print(json.dumps(told))
"""


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2, pytest.param(3, marks=pytest.mark.long)])
def test_each_once_and_in_order(ranks):
    for name, told in answer(on_ranks(ranks, UNEVEN)).items():
        assert len(told) == ranks
        assert all(right for right, _, _ in told), name
        done = sorted(tuple(item) for _, items, _ in told for item in items)
        assert done == [(rank, k) for rank, (_, _, length) in enumerate(told) for k in range(length)], name


# A rank that is so slow that others ask it for work while it is at an item, however busy the machine is.
SLOWLY = """
import time
from mpi4py import MPI
from sbfem_petsc.ranks.balance import _ASK
def until_asked():
    last = time.monotonic() + 60.0
    while time.monotonic() < last and not MPI.COMM_WORLD.Iprobe(source=MPI.ANY_SOURCE, tag=_ASK):
        time.sleep(1e-3)
"""

SLOW = (
    SLOWLY
    + """
import json, sys
from sbfem_petsc.ranks.balance import balanced
comm, slow = MPI.COMM_WORLD, int(sys.argv[1])
done = []
def work(item):
    if comm.rank == slow and len(done) < 3:
        until_asked()
    done.append(item)
    return item
items = [(comm.rank, number) for number in range(60)]
assert balanced(comm, items, work) == items
everything = sum(comm.allgather(done), [])
assert sorted(everything) == [(rank, number) for rank in range(comm.size) for number in range(60)]
counts = comm.gather(sum(rank == slow for rank, _ in done))
if comm.rank == 0:
    print(json.dumps({"counts": counts}))
"""
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "ranks, slow, least, most",
    [(2, 1, 3, 17), pytest.param(4, 2, 1, 57, marks=pytest.mark.long)],
)
def test_a_slow_rank_is_helped(ranks, slow, least, most):
    """It gives away 29, 14 and 7 of its sixty items after its first three, each time when it has been asked.

    A rank that asks again has done what it had; the last batch, and of several ranks all but an item of each,
    may come back. Several ranks that ask at once leave it its next item alone.
    """
    counts = answer(on_ranks(ranks, SLOW, str(slow)))["counts"]
    assert sum(counts) == 60 and least <= counts[slow] <= most


# The slow rank has all the items, and another meets one that fails; then a batch is left over.
FAILS = (
    SLOWLY
    + """
import json
from sbfem_petsc.ranks.balance import balanced
from sbfem_petsc.selement.coefficients import SElementError
comm, MET = MPI.COMM_WORLD, 1
class Own(RuntimeError):
    def __init__(self, one, other):  # cannot be copied
        super().__init__(f"{one} and {other}")
def work(item):
    if comm.rank == 0:
        if item == 0:
            until_asked()
        elif item == 1:  # others have met the item, or this rank might take it back
            comm.recv(source=MPI.ANY_SOURCE, tag=MET)
    elif item in (50, 70):
        if item == 50:
            comm.send(None, dest=0, tag=MET)
        if kind == "result":
            return lambda: None
        raise SElementError(f"item {item}") if kind == "known" else Own("item", item)
    return item
told = []
for kind in ("known", "own", "result"):
    try:
        balanced(comm, range(80) if comm.rank == 0 else [], work)
        told.append("none")
    except Exception as error:
        told.append(f"{type(error).__name__}: {error}")
again = balanced(comm, range(5), lambda item: (comm.rank, item)[1])
everything = comm.gather((told, again))
if comm.rank == 0:
    print(json.dumps({"ranks": everything}))
"""
)


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.long)])
def test_error_of_an_item_taken_over(ranks):
    """Raised on all ranks, the first by number, also where a result cannot travel; what comes after meets no
    message of before.
    """
    for told, again in answer(on_ranks(ranks, FAILS))["ranks"]:
        assert told[:2] == ["SElementError: item 50", "RuntimeError: item and 50"]
        assert "pickle" in told[2] and "lambda" in told[2]
        assert again == list(range(5))


def test_own_error_is_itself():
    """On one rank the error, not a copy, and the first one."""
    errors = [ValueError("0"), ValueError("1")]

    def work(item):
        raise errors[item]

    with pytest.raises(ValueError) as caught:
        balanced(MPI.COMM_SELF, range(2), work)
    assert caught.value is errors[0]


# Rank 0 is slow, and others take over some of its S-elements; it asks for none of theirs, or its count would
# not tell whose they were where another rank has to wait for a core.
MODEL = (
    SLOWLY
    + """
import json
import numpy as np
import sbfem_petsc as sb
from meshing import CrackLine, Plate
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import SElement, solve_selement
from sbfem_petsc.selement.stacked import inertia_of_stack, solve_stack
from sbfem_petsc.ranks import balance
from sbfem_petsc.system.elements import shapes
comm = MPI.COMM_WORLD
if comm.rank == 0:
    balance._Exchange._ask = lambda exchange, other: balance._Batch(other, balance.deque())
shapes.STACK = 2
done, inertia = [], SElement.with_inertia
def slowed(work):
    def solve(*arguments, **options):
        if comm.rank == 0 and len(done) < 2:
            until_asked()
        found = work(*arguments, **options)
        done.extend(one for one in (found if isinstance(found, list) else [found]) if one is not None)
        return found
    return solve
shapes.solve_selement, SElement.with_inertia = slowed(solve_selement), slowed(inertia)
shapes.solve_stack, shapes.inertia_of_stack = slowed(solve_stack), slowed(inertia_of_stack)
body = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=[CrackLine([(0.03, 0.05), (0.07, 0.056)])])
mesh = sb.on_root(comm, lambda: body.mesh(order=3, size=0.012))
model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), clamped="edge1")
own, counts = len(model.cells._solutions._shapes), [len(done)]
done.clear()
groups = model.cells.moving
counts.append(len(done))
same = []
for group in groups:
    found, material = group.solution, model.materials[group.material]
    stack = Sectors(found.coordinates[None], found.order, material.elasticity)
    solved, again = solve_stack(stack, True)[0] if found.closed else None, None
    if solved is None:
        sectors = Sectors(found.coordinates, found.order, material.elasticity)
        solved = solve_selement(sectors, found.closed, isotropic=True, density=material.densities)
    elif found.closed:
        again = inertia_of_stack([solved], 1)[0]
    again = again or inertia(solved, 1).dynamics
    same.append((found.stiffness == solved.stiffness).all() and all(
        (value == getattr(again, name)).all() for name, value in vars(found.dynamics).items()
    ))
everything = comm.gather((own, counts, all(map(bool, same))))
if comm.rank == 0:
    print(json.dumps({"ranks": everything, "shapes": model.shapes}))
"""
)


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.long)])
def test_selements_taken_over(ranks):
    """Each S-element is solved once, some of the slow rank's by others, to the same bits as by its own rank
    and as without the others of its stack.
    """
    told = answer(on_ranks(ranks, MODEL))
    assert all(same for _, _, same in told["ranks"])
    for stage in (0, 1):
        assert sum(counts[stage] for _, counts, _ in told["ranks"]) == told["shapes"]
        own, counts, _ = told["ranks"][0]
        assert 1 <= counts[stage] < 0.8 * own
