"""A steady state of the paper's beam under two free tones: seconds on one rank, and how much less two take.

80 modes, 21 samples, 512 steps a period of the faster tone; 300 N at 3000 Hz and 100 N at 70.7 Hz. Ranks are
compared by pairs of runs that follow each other, for the clock of a core may change within minutes. Seconds
are those of the wall, the least of several repeats in each run, without stability (Lyapunov exponents) and
with it.

    ./run python benchmarks/torus.py
    mpiexec -n 2 python benchmarks/torus.py --once
"""

from __future__ import annotations

import argparse
import os
import pathlib
import re
import subprocess
import sys
import time
import warnings

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np

TONES = (3000.0, 50.0 * 2.0**0.5)
ASKED, FASTER = 1.5, 1.7


def once(repeats: int) -> None:
    """Print seconds of the wall on this communicator, without stability and with it."""
    # here alone: a process that has begun MPI cannot start mpiexec
    import sbfem_petsc as sb
    from benchmarks.default_mesh import model
    from sbfem_petsc.petsc import MPI

    warnings.simplefilter("ignore", sb.StepWarning)
    comm = MPI.COMM_WORLD
    load = sb.PointForce("A", fy=sb.Harmonic(300.0, TONES[0]) + sb.Harmonic(100.0, TONES[1]))
    reduced = sb.reduce(model(), load, modes=80)
    sb.quasi_periodic(reduced, load, TONES, samples=3, stability=False)  # compiles
    found = []
    for stability in (False, True):
        spent = []
        for _ in range(repeats):
            comm.Barrier()
            began = time.perf_counter()
            sb.quasi_periodic(reduced, load, TONES, samples=21, steps=512, stability=stability)
            spent.append(comm.allreduce(time.perf_counter() - began, MPI.MAX))
        found.append(min(spent))
    if comm.rank == 0:
        print(*(f"{item:.4f}" for item in found))


def on_ranks(ranks: int, repeats: int) -> np.ndarray:
    """The same in a run of its own."""
    program = [sys.executable, __file__, "--once", "--repeats", str(repeats)]
    command = ["mpiexec", "-n", str(ranks), *program]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return np.array(re.findall(r"\d+\.\d{4}", done.stdout)[-2:], dtype=float)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--pairs", type=int, default=5, help="of runs on one and on two ranks (default 5)")
    parser.add_argument("--repeats", type=int, default=4, help="in each run, the fastest counts (default 4)")
    parser.add_argument("--once", action="store_true", help="seconds on these ranks alone")
    own = parser.parse_args()
    if own.once:
        once(own.repeats)
        return
    pairs = []
    for _ in range(own.pairs):
        one, two = on_ranks(1, own.repeats), on_ranks(2, own.repeats)
        pairs.append((one, two))
        print("one rank {:.3f} and {:.3f} s, two {:.3f} and {:.3f} s".format(*one, *two), flush=True)
    ratios = np.array([one / two for one, two in pairs])
    least, median = np.array([one for one, _ in pairs]).min(axis=0), np.median(ratios, axis=0)
    for k, name in enumerate(("without stability", "with stability")):
        print(
            f"{name:18s} {least[k]:.3f} s on one rank (asked {ASKED}), two {median[k]:.2f} times as fast",
            end="",
        )
        print(f" ({ratios[:, k].min():.2f} to {ratios[:, k].max():.2f}, asked {FASTER})")


if __name__ == "__main__":
    main()
