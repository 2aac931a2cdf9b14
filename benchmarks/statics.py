"""Cost of three static contact solutions, case P at 1, 100 and 300 N: sbfem-petsc beside scikit-fem's quartic
triangles of equal accuracy, in one run on one core.

Seconds are CPU seconds from the mesh in memory to the three solutions, one BLAS thread, the least of several
repeats by turns; making the meshes is not counted. The error is the largest relative distance of u_y(A) at 1,
100 and 300 N to the independent reference. scikit-fem has no contact: to its matrices (`peer_transient.py`,
SuperLU in symmetric mode) belongs the same condensation onto the pairs and the same active set as ours, with
one factorisation, one solve for each pair and one for each load. The peer's meshes are those of
`peer_scikit_fem.py` for the natural frequencies; the finest is still less accurate here than the default
mesh of sbfem-petsc, and of 37 more, with smaller elements at the tip and the corners, none was as
accurate.

    ./run python benchmarks/statics.py
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import pathlib
import sys
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np

import sbfem_petsc as sb
from benchmarks import peer_scikit_fem as peer
from benchmarks import peer_transient as quartic
from meshing import Beam, VNotch
from sbfem_petsc.contact.complementarity import solve_complementarity

BEAM = Beam(0.400, 0.005, [VNotch(0.080, 0.0025, 0.0458366)])
MATERIAL = sb.Material(peer.YOUNG, peer.POISSON, peer.DENSITY)
FORCES = (1.0, 100.0, 300.0)
CASE = json.loads(peer.REFERENCE_FILE.read_text())["static"]["x80_mouth2um_nu33"]["contact"]
REFERENCE = np.array([CASE[f"{force:g} N"]["u"]["A"]["uy"] for force in FORCES])


def ours(mesh) -> tuple[np.ndarray, int]:
    """u_y(A) under each force, and the unknowns."""
    model = sb.Model(mesh, MATERIAL)
    found = [sb.static(model, sb.PointForce("A", fy=force)).displacement("A")[1] for force in FORCES]
    unknowns = model.boundary_unknowns
    model.destroy()
    return np.array(found), unknowns


def theirs(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, int]:
    """The same with quartic triangles."""
    system = quartic.matrices(points, triangles)
    factors = quartic.factorise(system.stiffness)
    columns = factors.solve(np.column_stack([system.gaps.T.toarray(), system.load]))
    gaps, displacements = system.gaps @ columns, columns[system.sensor]
    flexibility, by_load = gaps[:, :-1], gaps[:, -1]
    flexibility = 0.5 * (flexibility + flexibility.T)
    found = []
    for force in FORCES:
        contact = solve_complementarity(flexibility, system.initial_gap + force * by_load)
        found.append(displacements[:-1] @ contact.force + force * displacements[-1])
    return np.array(found), len(system.load)


def error(found: np.ndarray) -> float:
    """Largest relative error of u_y(A)."""
    return float(np.abs(found / REFERENCE - 1.0).max())


def seconds(work) -> float:
    """CPU seconds of one call."""
    began = time.process_time()
    work()
    return time.process_time() - began


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--repeats", type=int, default=9, help="runs of each, the fastest counts (default 9)")
    parser.add_argument(
        "--order", type=int, default=5, help="of the edges (default 5, the mesh's own default)"
    )
    own = parser.parse_args()
    mesh = BEAM.mesh(order=own.order)
    works = {f"sbfem-petsc, order {own.order}": lambda: ours(mesh)}
    for target in peer.TARGETS:
        graded = peer.graded_mesh(peer.BEST[4, target])
        works[f"scikit-fem P4, {target:g} mesh"] = functools.partial(theirs, *graded)
    times = np.min([[seconds(work) for work in works.values()] for _ in range(own.repeats)], axis=0)
    print("three statics              unknowns  error of u_y(A)   CPU s")
    for (name, work), spent in zip(works.items(), times):
        found, unknowns = work()
        print(f"{name:25s}{unknowns:10,d}{error(found):17.1e}{spent:8.3f}")
    print(f"sbfem-petsc / the finest of them: {times[0] / times[-1]:.2f}   (asked: at most 1)")


if __name__ == "__main__":
    main()
