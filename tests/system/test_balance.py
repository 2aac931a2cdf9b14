"""S-elements over ranks: each shape solved once, by ranks with as much to do, errors told on all."""

import numpy as np
import pytest

from sbfem_petsc.system.elements.shapes import shared_out
from tests.parallel import answer, on_ranks

# A plate that bisection gives to the ranks in equal shares of its cost, of which one's cells are all alike.
MODEL = """
import json
import numpy as np
from mpi4py import MPI
import sbfem_petsc as sb
from meshing import CrackLine, Plate
from sbfem_petsc.selement.coefficients import SElementError
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import SElement, inertia_of_stack, solve_selement, solve_stack
from sbfem_petsc.system.elements import shapes
comm = MPI.COMM_WORLD
shapes.STACK = 2
done, inertia, loads, shared_out = [], SElement.with_inertia, [], shapes.shared_out
def noted_loads(digest, cost, holder, ranks):
    worker = shared_out(digest, cost, holder, ranks)
    first = np.unique(digest, return_index=True)[1]
    loads.append(np.bincount(worker[first], cost[first], ranks))
    return worker
shapes.shared_out = noted_loads
def noted(work):
    def solve(*arguments, **options):
        found = work(*arguments, **options)
        done.extend(one for one in (found if isinstance(found, list) else [found]) if one is not None)
        return found
    return solve
shapes.solve_selement, SElement.with_inertia = noted(solve_selement), noted(inertia)
shapes.solve_stack, shapes.inertia_of_stack = noted(solve_stack), noted(inertia_of_stack)
body = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=[CrackLine([(0.03, 0.05), (0.07, 0.056)])])
mesh = sb.on_root(comm, lambda: body.mesh(order=3, size=0.012))
model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), clamped="edge1")
counts = [len(done)]
done.clear()
groups = model.cells.moving
counts.append(len(done))
same = []
for group in groups:
    found, material = group.solution, model.materials[group.material]
    sectors, again = Sectors(found.coordinates, found.order, material.elasticity), None
    solved = solve_selement(sectors, found.closed, density=material.densities)
    if found.closed:
        again = inertia_of_stack([solved], 1)[0]
    again = again or inertia(solved, 1).dynamics
    same.append((found.stiffness == solved.stiffness).all() and all(
        (value == getattr(again, name)).all() for name, value in vars(found.dynamics).items()
    ))
def failing(*arguments, **options):
    raise SElementError(f"of rank {comm.rank}")
if comm.rank == comm.size - 1:
    shapes.solve_stack = lambda stack, _: [None] * len(stack.shape)
    shapes.solve_selement = failing
try:
    sb.Model(mesh, sb.Material(70e9, 0.33, 2700), clamped="edge1")
    told = None
except SElementError as error:
    told = str(error)
everything = comm.gather((counts, all(map(bool, same)), told))
if comm.rank == 0:
    print(json.dumps({"ranks": everything, "shapes": model.shapes, "loads": loads[0].tolist()}))
"""


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.long)])
def test_each_shape_is_solved_once(ranks):
    """To the same bits as without the others of its stack; what is raised on one rank names the S-element on
    all.
    """
    told = answer(on_ranks(ranks, MODEL))
    assert all(same for _, same, _ in told["ranks"])
    for stage in (0, 1):
        done = [counts[stage] for counts, _, _ in told["ranks"]]
        assert sum(done) == told["shapes"] and min(done) > 0
    assert max(told["loads"]) < 1.2 * np.mean(told["loads"])
    (error,) = {error for _, _, error in told["ranks"]}
    assert error.startswith("S-element ") and error.endswith(f" m: of rank {ranks - 1}")


@pytest.mark.parametrize("lengths", [(0, 300, 10), (40, 0, 0, 0), (5, 5), (0, 0), (1,), (64, 80, 72, 900)])
def test_costs_are_even(lengths):
    """However shapes are held: those of one digest are one rank's, and none has more than the mean, nor less,
    but for a shape or two.
    """
    generator = np.random.default_rng(len(lengths))
    own = [generator.integers(2**62, size=length) for length in lengths]
    # the last three of each rank are the next one's, too
    held = [np.concatenate([other[-3:], mine]) for other, mine in zip([[], *own], own)]
    digest, holder = np.concatenate(held).astype(np.int64), np.repeat(np.arange(len(held)), [*map(len, held)])
    cost = np.array([20, 24, 60])[digest % 3] ** 3
    found = shared_out(digest, cost, holder, len(lengths))
    workers = {}
    for key, rank, one in zip(digest.tolist(), found.tolist(), cost.tolist()):
        assert workers.setdefault(key, (rank, one)) == (rank, one)
    load = np.zeros(len(lengths))
    for rank, one in workers.values():
        load[rank] += one
    assert np.abs(load - load.mean()).max(initial=0.0) <= 2 * 60**3
