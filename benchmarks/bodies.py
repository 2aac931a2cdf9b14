"""The solid cantilever of `examples/cracked_cantilever.py` over its size: numbers, CPU seconds and memory.

    ./run python benchmarks/bodies.py                # 17,136 and 46,071 free unknowns
    ./run python benchmarks/bodies.py --motion       # wedge, folds and backbone of 17,136 too, two minutes
    mpiexec -n 2 ./run python benchmarks/bodies.py   # reduced by both
    mpiexec -n 2 ./run python benchmarks/bodies.py --last --turns 5  # alone, each for itself, together
    mpiexec -n 2 ./run python benchmarks/bodies.py --last --phases 5  # factors and passes over them likewise

CalculiX (ccx) stores the matrices; reading them is not counted.
"""

import argparse
import pathlib
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np
from mpi4py import MPI

import sbfem_petsc as sb
from examples.cracked_cantilever import store
from sbfem_petsc.reduction.sparse import _Columns

# mm, of elements and of those at the crack.
SIZES = [(5.0, 2.0), (3.3, 1.5)]
# Over a factor, in one measurement.
PASSES = 8


def body_of(size: float, fine: float) -> sb.FiniteElementModel:
    """By gmsh and CalculiX, on rank 0, read on all."""
    folder = MPI.COMM_WORLD.bcast(tempfile.mkdtemp() if MPI.COMM_WORLD.rank == 0 else None)
    sb.on_root(MPI.COMM_WORLD, lambda: store(folder, size, fine))
    return sb.read_calculix(f"{folder}/cantilever")


def reduced(
    body: sb.FiniteElementModel, gap, modes: int = 80, damping: float = 0.0, comm=MPI.COMM_WORLD
) -> sb.ReducedModel:
    """Load and sensor along z at a corner of the free end."""
    tip, crack = body.at((0.2, 0.02, 0.01), "z"), body.contact("LEFT", "RIGHT", normal="x", gap=gap)
    given = {"loads": {"F": tip}, "points": {"tip": tip}, "modes": modes, "damping": damping}
    return sb.reduce(body, contact=crack, shapes=False, comm=comm, **given)


def row(body: sb.FiniteElementModel) -> None:
    """One of the table in docs/bodies.md."""
    begun, clock = time.process_time(), time.perf_counter()
    rom = reduced(body, 0.0, damping=0.005)
    spent = time.process_time() - begun, time.perf_counter() - clock
    spent = tuple(MPI.COMM_WORLD.allreduce(seconds, MPI.MAX) for seconds in spent)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    found, orbit = sb.static(rom, 100.0), sb.periodic(rom, 100.0, 150.0)
    if MPI.COMM_WORLD.rank == 0:
        print(
            f"{len(body.unknowns)} unknowns, {rom.pairs} pairs: {np.round(rom.frequencies[:3], 4)} Hz, "
            f"{1e3 * float(found.displacement('tip')):.7f} mm, {found.contact_resultant:.2f} N, "
            f"{found.active.sum()} closed; harmonics {1e6 * np.abs(orbit.harmonics('tip')[:4])} um; "
            f"reduced in {spent[0]:.2f} CPU s, {spent[1]:.2f} s, {memory:.2f} GB",
            flush=True,
        )


def turns(body: sb.FiniteElementModel, count: int) -> None:
    """How much faster all ranks are together than one alone, in turns, and what no program can exceed on this
    machine: as many reductions at once, each by one rank, that is what its cores do to each other.
    """
    world, found = MPI.COMM_WORLD, []

    for _ in range(count):
        both = _seconds(partial(reduced, body, 0.0, comm=world))
        found.append((*_alone_and_both(partial(reduced, body, 0.0, comm=MPI.COMM_SELF)), both))
        if world.rank == 0:
            print(
                "alone {:.2f} s, each for itself {:.2f} s, together {:.2f} s".format(*found[-1]), flush=True
            )
    alone, copies, together = np.median(found, axis=0)
    if world.rank == 0:
        print(
            f"medians of {count}: {world.size} ranks {alone / together:.2f} times as fast as one, of "
            f"{world.size * alone / copies:.2f} that the machine's cores are together; "
            f"{copies / together:.2f} times as fast as one whose neighbours work too"
        )


def phases(body: sb.FiniteElementModel, count: int) -> None:
    """Medians of so many turns of a factor, and of passes over it for twelve columns and for each rank's
    share of these: by rank 0 while the others stand still, and by all at once, each for itself.
    """
    random, found = np.random.default_rng(0), []
    widths = 12, 12 // MPI.COMM_WORLD.size
    for _ in range(count):
        solvers = list[_Columns]()
        times = [_alone_and_both(partial(_factor, body, solvers))]
        for width in widths:
            right = np.asfortranarray(random.standard_normal((len(body.unknowns), width)))
            solvers[-1].own(right)
            times.append(_alone_and_both(partial(_passes, solvers[-1], right)))
        for solver in solvers:
            solver.close()
        found.append(times)
    whole, *passes = np.median(found, axis=0)
    if MPI.COMM_WORLD.rank == 0:
        print(f"factor: {whole[0]:.3f} s alone, {whole[1]:.3f} s by all at once")
        for width, (alone, both) in zip(widths, passes):
            told = f"{alone / PASSES:.4f} s alone, {both / PASSES:.4f} s by all at once"
            print(f"pass of {width} columns: {told}")


def _factor(body: sb.FiniteElementModel, made: list[_Columns]) -> None:
    made.append(_Columns(MPI.COMM_SELF, body.stiffness, "phases_"))
    made[-1].factorised(sure=False)


def _passes(solver: _Columns, right: np.ndarray) -> None:
    for _ in range(PASSES):
        solver.own(right)


def _alone_and_both(work: Callable[[], object]) -> tuple[float, float]:
    """Wall time of the slowest, in s, of work by rank 0 while others stand still, and by all."""
    return _seconds(work if MPI.COMM_WORLD.rank == 0 else lambda: None), _seconds(work)


def _seconds(work: Callable[[], object]) -> float:
    world = MPI.COMM_WORLD
    _calm(world)
    begun = time.perf_counter()
    work()
    spent = time.perf_counter() - begun
    _calm(world)
    return world.allreduce(spent, MPI.MAX)


def _calm(world: MPI.Comm) -> None:
    """Wait for all ranks, without work that slows others."""
    arrived = world.Ibarrier()
    while not arrived.Test():
        time.sleep(0.005)


def motion(body: sb.FiniteElementModel) -> None:
    """A wedge at rest, the folds of two gaps, the backbone of the wedge and of faces that touch."""

    def wedge(x, y, z):
        return 1e-3 * (z - 0.005)

    rom = reduced(body, wedge, 40)
    for force in (20.0, 40.0, 60.0):
        found = sb.static(rom, force)
        print(f"{force:g} N: {1e3 * float(found.displacement('tip')):.7f} mm, {found.active.sum()} closed")
    print(sb.backbone(rom, 1, 0.01, 0.3, stability=False))
    print(sb.backbone(reduced(body, 0.0, 40), 1, 0.1, 0.101, points=2, stability=False))
    for gap in (wedge, 5e-6):
        curve = sb.frequency_response(reduced(body, gap, damping=0.002), 1.0, 194.0, 204.0)
        print(*curve.bifurcations, f"peak {1e3 * curve.amplitude('tip').max():.3f} mm")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motion", action="store_true")
    parser.add_argument("--last", action="store_true", help="the larger body alone")
    parser.add_argument("--turns", type=int, default=0, help="one rank and all, beside each other, so often")
    parser.add_argument("--phases", type=int, default=0, help="parts of the reduction, so often")
    chosen = parser.parse_args()
    for sizes in SIZES[chosen.last :]:
        cantilever = body_of(*sizes)
        row(cantilever)
        if chosen.turns:
            turns(cantilever, chosen.turns)
        if chosen.phases:
            phases(cantilever, chosen.phases)
        if chosen.motion and sizes == SIZES[0]:
            motion(cantilever)
