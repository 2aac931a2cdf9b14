"""Cost of the paper's tone burst of 300 N, 0-33 ms, case P, in one run on one core.

The refined mesh of `examples/tone_burst.py` (67 pairs, frequencies 1-10 within 1.4e-6), 80 modes; the error is the relative L2
distance of u_y(A) to the independent reference, asked for: 3e-3. Seconds are CPU seconds, one BLAS thread, the least of several
repeats; compiling is not counted. Both schemes run over halved steps: the time to the required error is that of the largest step
that reaches it.

    ./run python benchmarks/transient.py
    ./run python benchmarks/transient.py --full-steps 400     also the unreduced model's step
"""

from __future__ import annotations

import argparse
import os
import pathlib
import sys
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402

import sbfem_petsc as sb  # noqa: E402
from examples.tone_burst import REFERENCE, REFINED, build, burst, distance  # noqa: E402

DURATION, FORCE, MODES, ASKED = 0.033, 300.0, 80, 3e-3
STEPS = {"exact": (16e-6, 8e-6, 4e-6, 2e-6, 1e-6, 0.5e-6), "newmark": (4e-6, 2e-6, 1e-6, 0.5e-6, 0.25e-6)}


def least(work, repeats):
    """Least CPU seconds of several calls, and the last result."""
    best = np.inf
    for _ in range(repeats):
        began = time.process_time()
        result = work()
        best = min(best, time.process_time() - began)
    return best, result


def reduced(model, repeats):
    """Seconds of the reduction and of the history at 1 us, and those of each scheme to the required error."""
    from sbfem_petsc.loads import separate
    from sbfem_petsc.reduction import reduce

    unit_loads, _ = separate(burst(FORCE))
    seconds, reduction = least(lambda: reduce(model, unit_loads, MODES), min(repeats, 2))
    print(f"reduction to {MODES} modes: {seconds:.2f} s")
    reference = dict(np.load(REFERENCE / "transient_paper.npz"))
    sb.transient(model, burst(FORCE), 1e-5, step=1e-6, reduction=reduction)
    reached, at_one = {}, None
    print("scheme      step, us     steps   relative L2   seconds    steps/s")
    for scheme, steps in STEPS.items():
        for step in steps:
            seconds, history = least(lambda: sb.transient(model, burst(FORCE), DURATION, step=step, reduction=reduction, scheme=scheme), repeats)
            error, count = distance(history, reference, FORCE), round(DURATION / history.step)
            print(f"{scheme:8s}{history.step * 1e6:12.4g}{count:10,d}{error:14.2e}{seconds:10.3f}{count / seconds:11,.0f}")
            if error <= ASKED and scheme not in reached:
                reached[scheme] = seconds
            if scheme == "exact" and step == 1e-6:
                at_one = seconds
    for scheme in STEPS:
        print(f"{scheme}: " + (f"{reached[scheme]:.3f} s to an error of {ASKED:g}" if scheme in reached else f"{ASKED:g} is not reached"))
    if len(reached) == 2:
        print(f"newmark / exact: {reached['newmark'] / reached['exact']:.1f} times the time")
    print(f"exact at 1 us: {at_one:.3f} s (asked: at most 1 s)")
    return at_one / round(DURATION / 1e-6)


def full(model, steps, reduced_step):
    """Seconds of the unreduced model's step, its factorisation subtracted, beside the reduced one."""
    short, long = (least(lambda: sb.transient(model, burst(FORCE), n * 1e-6, step=1e-6, reduction=None), 1)[0] for n in (steps // 4, steps))
    step = (long - short) / (steps - steps // 4)
    print(f"unreduced, crack open: {1e3 * step:.3f} ms a step, {step / reduced_step:.0f} times the reduced one's mean over the history with contact; {step * DURATION / 1e-6:.0f} s for 33 ms")


def main() -> None:
    """Print the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--repeats", type=int, default=3, help="runs of each, the fastest counts (default 3)")
    parser.add_argument("--full-steps", type=int, default=0, help="steps of the unreduced model that are timed (default 0: none)")
    own = parser.parse_args()
    from mpi4py import MPI

    model = build(MPI.COMM_WORLD, **REFINED)
    print(model)
    step = reduced(model, own.repeats)
    if own.full_steps:
        full(model, own.full_steps, step)
    model.destroy()


if __name__ == "__main__":
    main()
