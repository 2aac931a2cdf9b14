"""Cost of periodic motions by shooting, case P at 300 N with a modal damping ratio of 0.002, in one run on
one core.

The refined mesh of `examples/tone_burst.py`, 80 modes, 512 steps a period. Seconds are CPU seconds,
one BLAS thread, the least of several repeats (curves and histories: one run); compiling is not counted, nor
the reduction unless it is said. Beside shooting with the exact derivative stand the paper's finite
differences, matrix-free shooting, and a time history from rest until it is periodic: a part of it is run, and
what it still lacks follows from the slowest Floquet multiplier, whose rate is compared with the measured one.

    ./run python benchmarks/shooting.py
    ./run python benchmarks/shooting.py --periods 80000      the time history whole (some minutes)
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pathlib
import sys
import time
import warnings
from functools import partial
from unittest import mock

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np
from scipy import linalg

import sbfem_petsc as sb
from examples.paper.bench import REFINED, Bench
from sbfem_petsc.contact.marching import march
from sbfem_petsc.contact.tangent import Derivative
from sbfem_petsc.continuation.multipliers import multipliers_of
from sbfem_petsc.continuation.shooting import shoot
from sbfem_petsc.motion import period_map
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.motion.period_map import FixedPoint, Period

DAMPING, FORCE, MODES, STEPS = 0.002, 300.0, 80, 512
FREQUENCIES, FORCES, RANGE = (3000.0, 20140.0), (300.0, 500.0, 700.0, 1500.0), (13900.0, 14600.0)
ACCURACY, SAMPLES = 1e-4, 16
ASKED_ORBIT, ASKED_CURVES, ASKED_JACOBIAN = 0.05, {300.0: 1.0, 1500.0: 2.0}, 15.0


def least(work, repeats):
    """Least CPU seconds of several calls, and the last result."""
    best = np.inf
    for _ in range(repeats):
        began = time.process_time()
        result = work()
        best = min(best, time.process_time() - began)
    return best, result


def push(force):
    """A sine at A."""
    return sb.PointForce("A", fy=force)


def distance(orbit, other, count=7):
    """Distance of the harmonics 0-6 of u_y(A), together, over the first."""
    one, two = (o.harmonics("A")[:count] for o in (orbit, other))
    return float(np.linalg.norm(one - two) / abs(two[1]))


def orbits(reduced, repeats):
    """One orbit with and without its multipliers, and by the other ways to solve Newton's equations."""
    print(
        f"\none orbit: {len(reduced.omega)} modes, {reduced.pairs} pairs, {STEPS} steps\n   Hz   "
        "Jacobian      multipliers  iterations  residual    seconds   distance"
    )
    for frequency in FREQUENCIES:
        exact = None
        for jacobian, stability in (
            ("dense", False),
            ("dense", True),
            ("matrix-free", False),
            ("differences", False),
        ):

            def solve(frequency=frequency, jacobian=jacobian, stability=stability):
                return sb.periodic(
                    reduced,
                    push(FORCE),
                    frequency,
                    steps=STEPS,
                    jacobian=jacobian,
                    stability=stability,
                )

            solve()
            seconds, orbit = least(solve, repeats if jacobian != "differences" else 1)
            exact = exact or orbit
            asked = f"   (asked: at most {ASKED_ORBIT:g} s)" if jacobian == "dense" else ""
            print(
                f"{frequency:6g}  {jacobian:12s}{'yes' if stability else 'no':>12s}{orbit.iterations:12d}"
                f"{orbit.residuals[-1] / orbit.residuals[0]:12.0e}{seconds:10.3f}"
                f"{distance(orbit, exact):12.1e}{asked}"
            )


def jacobian(reduced, repeats, unknowns):
    """Cost of the exact derivative and of the monodromy in integrations of one period."""
    print(
        "\ncost of the Jacobian\n    Hz   one period, ms   Jacobian, ms   in periods   monodromy and "
        "multipliers, ms"
    )
    for frequency in FREQUENCIES:
        period = Period(reduced, Excitation.of([sb.Harmonic(FORCE, frequency)], frequency, 1, 1), STEPS)
        driven = period.at(frequency)
        state = shoot(driven, driven.linear_state).state
        motion = driven.run(state)
        size = len(state)
        seconds = [
            least(work, 10 * repeats)[0]
            for work in (
                partial(driven.run, state),
                lambda driven=driven, motion=motion, size=size: driven.carried(motion, np.eye(size)),
                lambda found=(state, driven, motion): multipliers_of(FixedPoint(*found)),
            )
        ]
        print(
            f"{frequency:6g}{1e3 * seconds[0]:17.2f}{1e3 * seconds[1]:15.2f}{seconds[1] / seconds[0]:13.1f}"
            f"{1e3 * seconds[2]:32.2f}   (asked: at most {ASKED_JACOBIAN:g} periods; "
            f"finite differences take {size + 1})"
        )
    print(f"finite differences on the unreduced model would take {2 * unknowns + 1:,d} integrations")


@contextlib.contextmanager
def kernels():
    """CPU seconds in the compiled steps, in the products of the derivative and in LAPACK's eigenvalues, while
    it is open: what would be left of a curve if everything around them took no time.
    """
    spent = {"steps": 0.0, "products": 0.0, "eigenvalues": 0.0}

    def timed(name, work):
        def call(*arguments, **options):
            began = time.process_time()
            result = work(*arguments, **options)
            spent[name] += time.process_time() - began
            return result

        return call

    with (
        mock.patch.object(period_map, "march", timed("steps", march)),
        mock.patch.object(Derivative, "__call__", timed("products", Derivative.__call__)),
        mock.patch.object(linalg, "eigvals", timed("eigenvalues", linalg.eigvals)),
    ):
        yield spent


def curves(reduced):
    """Each curve of Fig. 11."""
    print(
        "\nresponse curves, 13.9-14.6 kHz\n  force, N   points   Newton iterations   unstable   bifurcations "
        "  seconds   without stability   in steps, products, eigenvalues"
    )
    for force in FORCES:

        def follow(stability, force=force):
            return sb.frequency_response(
                reduced,
                push(force),
                *RANGE,
                steps=STEPS,
                stability=stability,
                progress=None,
            )

        if force == FORCES[0]:
            seconds, first = least(
                lambda: sb.frequency_response(reduced, push(1.0), *RANGE, contact=False), 1
            )
            print(f"   no contact{len(first.value):6d}{'':44s}{seconds:10.2f}")
        with kernels() as spent:
            seconds, curve = least(lambda: follow(True), 1)
        plain, _ = least(lambda: follow(False), 1)
        asked = f"   (asked: at most {ASKED_CURVES[force]:g} s)" if force in ASKED_CURVES else ""
        print(
            f"{force:10g}{len(curve.value):9d}{int(curve.iterations.sum()):20d}"
            f"{int(curve.unstable.sum()):11d}"
            f"{len(curve.bifurcations):15d}{seconds:10.2f}{plain:12.2f}         "
            f"{', '.join(f'{part:.2f}' for part in spent.values())}{asked}"
        )


def history(reduced, periods, repeats):
    """A time history from rest until it is periodic, beside shooting, at the fewest steps that reach the
    accuracy.
    """
    frequency = FREQUENCIES[0]
    load = push(sb.Harmonic(FORCE, frequency))
    fine = sb.periodic(reduced, push(FORCE), frequency, steps=8 * STEPS, stability=False)
    steps = next(
        n
        for n in (64, 96, 128, 192, 256, STEPS)
        if distance(sb.periodic(reduced, push(FORCE), frequency, steps=n, stability=False), fine)
        < 0.5 * ACCURACY
    )
    print(f"\nuntil periodic at {frequency:g} Hz, to {ACCURACY:g} of the first harmonic")
    for count in dict.fromkeys((steps, STEPS)):
        seconds, orbit = least(
            partial(sb.periodic, reduced, push(FORCE), frequency, steps=count, stability=False),
            3 * repeats,
        )
        orbit = sb.periodic(reduced, push(FORCE), frequency, steps=count)
        run = max(200, periods * steps // count)  # as many steps with either
        began = time.process_time()
        found = sb.transient(
            reduced,
            load,
            run / frequency,
            step=1.0 / (frequency * count),
            decimation=count // SAMPLES,
            progress=None,
        )
        spent = time.process_time() - began
        off = np.abs(
            found.displacement("A")[: SAMPLES * run, 1].reshape(run, SAMPLES)
            - orbit.displacement("A")[:: count // SAMPLES, 1]
        ).max(axis=1) / abs(orbit.harmonics("A")[1])
        # the distance beats with the lowest modes: its largest value in windows of several of their periods
        window = max(1, run // 10)
        worst = off[: run // window * window].reshape(-1, window).max(axis=1)
        middle = (np.arange(len(worst)) + 0.5) * window / frequency
        late = len(worst) // 2
        measured = -np.polyfit(middle[late:], np.log(worst[late:]), 1)[0]
        slowest, linear = -np.log(abs(orbit.multipliers[0])) * frequency, DAMPING * reduced.omega[0]
        if worst[-1] <= ACCURACY:
            reached = (int(np.argmax(worst <= ACCURACY)) + 0.5) * window
            how = "run whole"
        else:
            reached = run + np.log(worst[-1] / ACCURACY) / slowest * frequency
            how = "extrapolated"
        total = reached * spent / run
        print(
            f"{count} steps a period: orbit {seconds:.3f} s, {distance(orbit, fine):.1e} off in the "
            f"harmonics 0-6 from {8 * STEPS} steps"
        )
        print(
            f"  time history: {run:,d} periods ({run / frequency:.3g} s) in {spent:.1f} s, still "
            f"{worst[-1]:.1e} off; decay measured {measured:.3f} 1/s, of the slowest multiplier "
            f"{slowest:.3f}, zeta omega_1 {linear:.3f}"
        )
        print(
            f"  until periodic {reached:,.0f} periods ({reached / frequency:.1f} s), {how}: {total:,.0f} s, "
            f"{total / seconds:,.0f} times the time of shooting"
        )


def main() -> None:
    """Print the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--repeats", type=int, default=3, help="runs of each, the fastest counts (default 3)")
    parser.add_argument(
        "--periods",
        type=int,
        default=9000,
        help="periods of the time history that are run at its coarser steps (default 9000)",
    )
    own = parser.parse_args()

    warnings.simplefilter("ignore", sb.StepWarning)
    model = Bench().model("tables", DAMPING, **REFINED)
    print(model)
    seconds, reduced = least(lambda: sb.reduce(model, push(1.0), modes=MODES), 1)
    print(f"reduction to {MODES} modes: {seconds:.2f} s")
    orbits(reduced, own.repeats)
    jacobian(reduced, own.repeats, model.unknowns)
    curves(reduced)
    history(reduced, own.periods, own.repeats)
    model.destroy()


if __name__ == "__main__":
    main()
