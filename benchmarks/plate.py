"""Statics with contact and modes of plates with random cracks and holes, or of notched beams, by stages.

    python benchmarks/plate.py --unknowns 100000 --cracks 10 --holes 2 --modes 20 --file plate.json
    mpiexec -n 2 python benchmarks/plate.py --unknowns 100000 --cracks 10
    python benchmarks/plate.py --unknowns 1000000 --structured
    python benchmarks/plate.py --notches 100
    python benchmarks/plate.py --compare before.json after.json

Every stage has its wall and CPU seconds (of the slowest rank) and the largest peak of resident memory of a
rank during it and what it leaves (where /proc tells). `--file` writes the table as JSON, `--compare` sets two
of them side by side: versions, sizes (with the exponent of the growth) or numbers of ranks. `--mesh` keeps a
mesh for the next run. Options of PETSc may follow, after `--`: multigrid instead of the factorisation is
`-- -static_ksp_type cg -static_pc_type gamg -static_pc_gamg_threshold 0.05`, or `-- -static_ksp_type cg
-static_pc_type hypre`. Set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import pathlib
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import petsc4py

_SPLIT = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
petsc4py.init([sys.argv[0], *sys.argv[_SPLIT + 1 :]])

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import sbfem_petsc as sb
from benchmarks.structured_plate import structured_plate
from meshing import Beam, BoundaryMesh, CrackLine, Hole, Plate, VNotch
from sbfem_petsc.petsc import MPI, PETSc, version_line

MATERIAL = sb.Material(70e9, 0.33, 2700)


def plate(cracks: int, holes: int, seed: int) -> Plate:
    """A square of 1 m with cracks of any direction and holes, at most one in each field of a board."""
    generator = np.random.default_rng(seed)
    side = max(1, math.ceil(math.sqrt(cracks + holes)))
    fields = generator.permutation(side * side)[: cracks + holes]
    lines, circles = [], []
    for k, field in enumerate(fields):
        centre = (np.array(divmod(int(field), side)) + generator.uniform(0.45, 0.55, 2)) / side
        if k < cracks:
            angle, half = generator.uniform(0.0, math.pi), generator.uniform(0.2, 0.35) / side
            along = half * np.array([math.cos(angle), math.sin(angle)])
            lines.append(CrackLine([tuple(centre - along), tuple(centre + along)]))
        else:
            circles.append(Hole(centre[0], centre[1], generator.uniform(0.2, 0.4) / side))
    return Plate([(0, 0), (1, 0), (1, 1), (0, 1)], holes=circles, cracks=lines)


def plate_mesh(body: Plate, unknowns: int, order: int) -> BoundaryMesh:
    """A mesh with about so many displacement unknowns: three tries, for features have their own cell size."""
    size = math.sqrt((4 * order - 2) / unknowns)
    for _ in range(3):
        mesh = body.mesh(order=order, size=size)
        ratio = 2 * len(mesh.nodes) / unknowns
        if 0.85 < ratio < 1.15:
            break
        size *= math.sqrt(ratio)
    return mesh


def notched_beam(notches: int, order: int) -> BoundaryMesh:
    """A beam 5 mm high with closed notches every 20 mm, half through."""
    places = 0.02 * (1 + np.arange(notches))
    cuts = [VNotch(x=float(x), depth=0.0025, opening=0.0) for x in places]
    return Beam(length=0.02 * (notches + 1), height=0.005, notches=cuts).mesh(order=order)


class Stages:
    """Times of the stages on all ranks of a communicator."""

    def __init__(self, comm: MPI.Comm):
        self.comm = comm
        self.rows: list[dict[str, Any]] = []

    def __call__(self, name: str, work: Callable[[], Any]) -> Any:
        """`work()`, timed."""
        forget_peak()
        self.comm.Barrier()
        wall, cpu = time.perf_counter(), time.process_time()
        result = work()
        spent = (time.perf_counter() - wall, time.process_time() - cpu)
        wall, cpu, peak, left = (self.comm.allreduce(value, MPI.MAX) for value in (*spent, *memory()))
        row = {"stage": name, "wall_s": wall, "cpu_s": cpu, "peak_MB_a_rank": peak, "left_MB_a_rank": left}
        self.rows.append(row)
        if self.comm.rank == 0:
            print(f"{name:14s} {wall:9.2f} {cpu:9.2f} {peak:9.0f} {left:9.0f}", flush=True)
        return result


def forget_peak() -> None:
    """Let the peak of this process's resident memory begin anew, where the system lets it."""
    with contextlib.suppress(OSError), open("/proc/self/clear_refs", "w") as file:
        file.write("5")


def memory() -> tuple[float, float]:
    """Peak and present resident memory of this process, MB."""
    try:
        with open("/proc/self/status", encoding="ascii") as file:
            table = dict(line.split(":", 1) for line in file)
        peak, present = (float(table[name].split()[0]) / 1024 for name in ("VmHWM", "VmRSS"))
        return peak, present
    except OSError:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        return peak, peak


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """One table."""
    comm = MPI.COMM_WORLD
    stages = Stages(comm)
    if comm.rank == 0:
        print(f"{'stage':14s} {'wall s':>9s} {'CPU s':>9s} {'peak MB':>9s} {'left MB':>9s}")

    def make() -> BoundaryMesh:
        if arguments.mesh and os.path.exists(arguments.mesh):
            return BoundaryMesh.load(arguments.mesh)
        if arguments.notches:
            made = notched_beam(arguments.notches, arguments.order)
        elif arguments.structured:
            made = structured_plate(
                arguments.unknowns, cracks=arguments.cracks, order=arguments.order, seed=arguments.seed
            )
        else:
            body = plate(arguments.cracks, arguments.holes, arguments.seed)
            made = plate_mesh(body, arguments.unknowns, arguments.order)
        if arguments.mesh:
            made.save(arguments.mesh)
        return made

    mesh = stages("mesh", lambda: sb.on_root(comm, make))
    clamped, load = (
        ("left", sb.PointForce("A", fy=1.0))
        if arguments.notches
        else ("edge1", sb.EdgeLoad("edge3", pressure=1e6, tx=2e5))
    )
    model = stages("model, kernel", lambda: sb.Model(mesh, MATERIAL, clamped=clamped))
    stages("assembly", lambda: model.stiffness)
    stages("contact rows", lambda: (model.contact, model.tips.intensities))
    solved = stages("static", lambda: sb.static(model, load))
    if arguments.flexibility:
        stages("flexibility W", lambda: model.compliance)
    if arguments.modes:
        stages("inertia", lambda: model.cells.moving)
        stages("modes", lambda: sb.modal(model, arguments.modes))
    return {
        "versions": version_line(),
        "ranks": comm.size,
        **{
            name: getattr(arguments, name)
            for name in ("order", "cracks", "holes", "notches", "structured", "seed", "modes")
        },
        "s_elements": model.elements,
        "shapes": model.shapes,
        "boundary_unknowns": model.boundary_unknowns,
        "unknowns": model.unknowns,
        "pairs": len(model.pairs),
        "pairs_in_contact": int(solved.active.sum()),
        "contact_resultant_N": solved.contact_resultant,
        "solver": solved.solver,
        "linear_iterations": model.solver.ksp.getIterationNumber(),
        "matrix_entries": model.stiffness.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"],
        "stages": stages.rows,
    }


def compare(first: str, second: str) -> None:
    """Print two tables side by side."""
    tables = []
    for name in (first, second):
        with open(name, encoding="utf-8") as file:
            tables.append(json.load(file))
    for name in ("versions", "ranks", "boundary_unknowns", "pairs", "solver"):
        print(f"{name:20s} {tables[0][name]!s:>30s} {tables[1][name]!s:>30s}")
    growth = math.log(tables[1]["boundary_unknowns"] / tables[0]["boundary_unknowns"])
    print("stage" + "CPU s".rjust(31) + "ratio".rjust(8) + "exponent".rjust(9) + "peak MB".rjust(16))
    others = {row["stage"]: row for row in tables[1]["stages"]}
    for row in tables[0]["stages"]:
        other = others.get(row["stage"])
        if other is None:
            continue
        ratio = other["cpu_s"] / max(row["cpu_s"], 1e-9)
        exponent = f"{math.log(ratio) / growth:9.2f}" if abs(growth) > 0.1 and ratio > 0 else f"{'':9s}"
        memories = [r["peak_MB_a_rank"] for r in (row, other)]
        print(
            f"{row['stage']:16s}{row['cpu_s']:10.2f}{other['cpu_s']:10.2f}{ratio:8.2f}{exponent}"
            f"{memories[0]:8.0f}{memories[1]:8.0f}{memories[1] / memories[0]:8.2f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--unknowns", type=int, default=30_000)
    parser.add_argument("--order", type=int, default=5)
    parser.add_argument("--cracks", type=int, default=10)
    parser.add_argument("--holes", type=int, default=0)
    parser.add_argument("--notches", type=int, default=0, help="a beam with so many instead of the plate")
    parser.add_argument("--structured", action="store_true", help="rows and columns of cells, without gmsh")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--modes", type=int, default=0)
    parser.add_argument("--flexibility", action="store_true", help="also all contact rows' flexibility")
    parser.add_argument("--mesh", metavar="FILE", help="read from here if it exists, else saved to it")
    parser.add_argument("--file")
    parser.add_argument("--compare", nargs=2, metavar="FILE", help="set two tables side by side, and end")
    arguments = parser.parse_args(sys.argv[1:_SPLIT])
    if arguments.holes and arguments.structured:
        parser.error("--structured: rows and columns of cells have no holes; leave out --holes")
    if arguments.compare:
        return compare(*arguments.compare)
    result = run(arguments)
    if MPI.COMM_WORLD.rank == 0:
        print({name: value for name, value in result.items() if name != "stages"})
        if arguments.file:
            with open(arguments.file, "w", encoding="utf-8") as file:
                json.dump(result, file, indent=2)


if __name__ == "__main__":
    main()
