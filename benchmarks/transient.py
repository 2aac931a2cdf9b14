"""Cost of the paper's tone burst of 300 N, 0-33 ms, case P, in one run on one core.

The refined mesh of `examples/tone_burst.py` (67 pairs, frequencies 1-10 within 1.4e-6), 80 modes; the error
is the relative L2 distance of u_y(A) to the independent reference, asked for: 3e-3. Seconds are CPU seconds,
one BLAS thread, the least of several repeats; compiling is not counted. Both schemes run over halved steps:
the time to the required error is that of the largest step that reaches it.

    ./run python benchmarks/transient.py
    ./run python benchmarks/transient.py --full     also the unreduced model and what its step costs (about a
    minute)
"""

from __future__ import annotations

import argparse
import os
import pathlib
import sys
import time
import warnings
from functools import partial

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np

import sbfem_petsc as sb
from examples.paper.bench import REFINED, Bench, burst, off_reference

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
    """Seconds of the history at 1 us; prints those of the reduction and of each scheme to the required
    error.
    """
    seconds, system = least(lambda: sb.reduce(model, burst(FORCE), modes=MODES), 1)
    print(f"reduction to {MODES} modes: {seconds:.2f} s")
    sb.transient(system, burst(FORCE), 1e-5, step=1e-6)
    reached, at_one = {}, None
    print("scheme      step, us     steps   relative L2   seconds    steps/s")
    for scheme, steps in STEPS.items():
        for step in steps:
            seconds, history = least(
                partial(sb.transient, system, burst(FORCE), DURATION, step=step, scheme=scheme),
                repeats,
            )
            error, count = off_reference(history, FORCE), round(DURATION / history.step)
            print(
                f"{scheme:8s}{history.step * 1e6:12.4g}{count:10,d}"
                f"{error:14.2e}{seconds:10.3f}{count / seconds:11,.0f}"
            )
            if error <= ASKED and scheme not in reached:
                reached[scheme] = seconds
            if scheme == "exact" and step == 1e-6:
                at_one = seconds
    for scheme in STEPS:
        print(
            f"{scheme}: "
            + (
                f"{reached[scheme]:.3f} s to an error of {ASKED:g}"
                if scheme in reached
                else f"{ASKED:g} is not reached"
            )
        )
    if len(reached) == 2:
        print(f"newmark / exact: {reached['newmark'] / reached['exact']:.1f} times the time")
    print(f"exact at 1 us: {at_one:.3f} s (asked: at most 1 s)")
    return at_one


def parts(model, step, repeats=400):
    """Seconds of one KSP solve and of one product with M of the unreduced model at a step, by turns so
    that neither finds its matrix in the cache.
    """
    from sbfem_petsc.system.solve.pencil import CondensedSolve, Pencil

    pencil = Pencil(model.statics, 1.0, 0.0)
    solve = CondensedSolve(pencil, -4.0 / step**2, prefix="newmark_", what="benchmark")
    left, right = pencil.mass.createVecs()
    given, found = solve.matrix.createVecs()
    left.setRandom()
    given.setRandom()
    spent = np.empty((repeats, 2))
    for k in range(repeats):
        times = [time.perf_counter()]
        for work in (lambda: solve.ksp.solve(given, found), lambda: pencil.mass.mult(left, right)):
            work()
            times.append(time.perf_counter())
        spent[k] = np.diff(times)
    for item in (left, right, given, found):
        item.destroy()
    solve.release()
    pencil.destroy()
    return np.median(spent, axis=0)


def full(model, reduced_seconds, duration):
    """The same history unreduced, every step recorded, beside the parts of a step and the reduced model."""
    step = 1e-6
    before = parts(model, step)
    prepared, _ = least(lambda: sb.transient(model, burst(FORCE), 8 * step, step=step, reduction=None), 2)
    seconds, history = least(
        lambda: sb.transient(model, burst(FORCE), duration, step=step, reduction=None), 1
    )
    solve, product = 0.5 * (before + parts(model, step))
    count = round(duration / step)
    each, touching = (seconds - prepared) / count, float((history.contact_force > 0).any(axis=1).mean())
    error = off_reference(history, FORCE)
    print(
        f"unreduced, {model.unknowns:,d} unknowns: {seconds:.1f} s for {count:,d} steps of 1 us, "
        f"{prepared:.2f} s of them before the first; relative L2 {error:.2e}"
    )
    print(
        f"  a step {1e3 * each:.3f} ms ({touching:.0%} of them with contact, every one recorded); one KSP "
        f"solve {1e3 * solve:.3f} ms, one product with M {1e3 * product:.3f} ms"
    )
    print(f"  step / (solve + product) = {each / (solve + product):.2f} (asked: at most 2)")
    print(
        "  largest error of the energy balance "
        f"{np.abs(history.energy.balance).max() / np.abs(history.energy.external).max():.1e} of the peak "
        f"work, contact dissipates {-history.energy.contact[-1] / np.abs(history.energy.external).max():.1e}"
    )
    print(
        f"  the reduced model is {each * DURATION / step / reduced_seconds:.0f} times faster over 33 ms at "
        "the same step"
    )


def main() -> None:
    """Print the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--repeats", type=int, default=3, help="runs of each, the fastest counts (default 3)")
    parser.add_argument(
        "--full",
        type=float,
        nargs="?",
        const=DURATION,
        default=0.0,
        metavar="DURATION",
        help="also the unreduced model, over 33 ms or a duration (s) of your own",
    )
    own = parser.parse_args()

    warnings.simplefilter("ignore", sb.StepWarning)  # the table shows what coarse steps cost
    model = Bench().model("tables", **REFINED)
    print(model)
    seconds = reduced(model, own.repeats)
    if own.full:
        full(model, seconds, own.full)
    model.destroy()


if __name__ == "__main__":
    main()
