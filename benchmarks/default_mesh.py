"""What analyses of case P cost on the default mesh, beside what was asked, in one run on one core.

80 modes, 512 steps a period, a modal damping ratio of 0.002. Seconds are CPU seconds, one BLAS thread, the
least of several repeats (of a curve five, and the largest beside it); compiling is not counted but in the
last line, which starts Python anew with an empty cache. The floor of orbits and curves is what the products
of large matrices and the eigenvalues alone take at the rates of the libraries in this run: two products of
each row of contact with the columns of every derivative that was made, and the eigenvalues of every monodromy
matrix. Of a history with its reduction it is the factorisation, for each Krylov vector a solve, one product
with the mass and one round of orthogonalisation, for each step two products with the factors of the gaps.

    ./run python benchmarks/default_mesh.py
"""

from __future__ import annotations

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import warnings
from unittest import mock

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.contact.tangent import BLOCK, Derivative
from sbfem_petsc.continuation import multipliers as stability
from sbfem_petsc.motion.reduced_history import CHUNK
from sbfem_petsc.system.solve import modes, pencil

BEAM = Beam(0.400, 0.005, [VNotch(0.080, 0.0025, 0.0458366)])
MATERIAL, DAMPING = sb.Material(70e9, 0.33, 2700.0), 0.002
DURATION, STEP = 0.033, 1e-6
RANGE, FREQUENCIES = (13900.0, 14600.0), (433.0, 3000.0, 20140.0)
ASKED = {"orbit": 0.05, "from the model": 0.30, 300.0: 1.0, 1500.0: 2.0, "history": 0.2, "compiling": 3.0}
COLD = """
import time
import sbfem_petsc as sb
from benchmarks.default_mesh import model, push
system = sb.reduce(model(), push(300.0))
spent = []
for _ in range(2):
    began = time.process_time()
    sb.periodic(system, push(300.0), 3000.0)
    spent.append(time.process_time() - began)
print(spent[0] - spent[1])
"""


def push(force) -> sb.PointForce:
    """At A along y."""
    return sb.PointForce("A", fy=force)


def model() -> sb.Model:
    """Case P on the default mesh."""
    return sb.Model(BEAM.mesh(order=5), MATERIAL, damping=DAMPING)


def seconds(work, repeats: int):
    """Least CPU seconds of several calls, and the last result."""
    best, result = np.inf, None
    for _ in range(repeats):
        began = time.process_time()
        result = work()
        best = min(best, time.process_time() - began)
    return best, result


def from_the_model(work, repeats: int) -> float:
    """Least CPU seconds of work on a model that knows nothing yet."""
    best = np.inf
    for _ in range(repeats):
        with model() as fresh:
            best = min(best, seconds(lambda: work(fresh), 1)[0])
    return best


def line(name: str, spent: float, asked: float, note: str = "") -> None:
    """A row of the table."""
    print(f"{name:38s}{spent:9.3f}{asked:9.2f}   {note}", flush=True)


def floor(work, modes: int) -> float:
    """Seconds of the large products and the eigenvalues of some work; see above."""
    size, entries, own = 2 * modes, [], Derivative.__call__

    def counted(derivative, x):
        entries.append(len(derivative.contacts.factors) * x.shape[1])
        return own(derivative, x)

    with (
        mock.patch.object(Derivative, "__call__", counted),
        mock.patch.object(stability, "eigenvalues", wraps=stability.eigenvalues) as values,
    ):
        work()
    block, square = np.ones((BLOCK, size)), np.random.default_rng(0).random((size, size))
    products = seconds(lambda: (block @ square, block.T @ block), 50)[0] / (BLOCK * size)
    return sum(entries) * products + values.call_count * seconds(lambda: stability.eigenvalues(square), 20)[0]


def history_floor(load) -> float:
    """Seconds of the large products and solves of a history with its reduction; see above."""
    vectors, own = 0, pencil.CondensedSolve.apply

    def counted(solve, pc, right, left):
        nonlocal vectors
        vectors += 1
        own(solve, pc, right, left)

    with model() as fresh:
        with mock.patch.object(pencil.CondensedSolve, "apply", counted):
            reduced = sb.reduce(fresh, load)
        matrices = pencil.Pencil(
            fresh.statics, pencil.top_of_band(fresh.cells, len(reduced.omega)), modes.TOLERANCE
        )
        factorisation, solve = seconds(
            lambda: pencil.CondensedSolve(matrices, 0.0, "modal_st_", "benchmark"), 1
        )
        right, left = matrices.mass.createVecs()
        right.setRandom()
        # on average half of them are there
        basis, column = np.ones((vectors // 2, matrices.unknowns)), np.ones(matrices.unknowns)
        coefficients = np.ones(vectors // 2)

        def one_vector():
            for _ in range(50):
                matrices.mass.mult(right, left)
                solve.ksp.solve(solve.right, solve.left)
                basis @ column, coefficients @ basis

        every = seconds(one_vector, 5)[0] / 50
        states, (left_factor, right_factor) = np.ones((CHUNK, len(reduced.omega))), reduced.thin_gaps
        marched, _ = seconds(lambda: (states @ right_factor) @ left_factor.T, 20)
        solve.release()
        matrices.destroy()
    return factorisation + vectors * every + marched * round(DURATION / STEP) / CHUNK


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument(
        "--repeats", type=int, default=20, help="of an orbit, the fastest counts (default 20)"
    )
    own = parser.parse_args()
    warnings.simplefilter("ignore", sb.StepWarning)
    system = model()
    reduced = sb.reduce(system, push(1.0))
    print(reduced)
    print(f"{'':38s}{'CPU s':>9s}{'asked':>9s}")
    for frequency in FREQUENCIES:
        spent, orbit = seconds(lambda f=frequency: sb.periodic(reduced, push(300.0), f), own.repeats)
        alone, _ = seconds(
            lambda f=frequency: sb.periodic(reduced, push(300.0), f, stability=False), own.repeats
        )
        least = floor(lambda f=frequency: sb.periodic(reduced, push(300.0), f), len(reduced.omega))
        note = f"{orbit.iterations} iterations, {alone:.3f} without multipliers, floor {least:.3f}"
        line(f"orbit, 300 N, {frequency:g} Hz", spent, ASKED["orbit"], note)

    spent = from_the_model(lambda fresh: sb.periodic(fresh, push(300.0), 3000.0), own.repeats)
    line("the same from the model, 3000 Hz", spent, ASKED["from the model"])
    for force in (300.0, 1500.0):

        def follow(system=reduced, force=force):
            return sb.frequency_response(system, push(force), *RANGE, progress=None)

        runs = [seconds(follow, 1) for _ in range(5)]
        spent, curve = min(runs, key=lambda run: run[0])
        note = f"to {max(run[0] for run in runs):.2f}, "
        note += f"{from_the_model(follow, 5):.2f} from the model, "
        note += f"{len(curve.value)} points, {len(curve.bifurcations)} bifurcations, "
        note += f"floor {floor(follow, len(reduced.omega)):.2f}"
        line(f"curve of Fig. 11, {force:g} N", spent, ASKED[force], note)
    load = push(sb.ToneBurst(300.0, 3000.0, 20))
    spent, _ = seconds(lambda: sb.transient(reduced, load, DURATION, step=STEP, progress=None), 3)

    line(
        "33 ms in steps of 1 us, with reduction",
        from_the_model(
            lambda fresh: sb.transient(fresh, load, DURATION, step=STEP, progress=None), own.repeats
        ),
        ASKED["history"],
        f"{spent:.3f} from the reduced model, floor {history_floor(load):.3f}",
    )
    system.destroy()
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", COLD],
            cwd=ROOT,
            env={**os.environ, "NUMBA_CACHE_DIR": folder, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        )
    line("compiling for a first orbit", float(done.stdout.split()[-1]), ASKED["compiling"])


if __name__ == "__main__":
    main()
