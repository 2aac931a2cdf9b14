"""Invariant curves: CPU seconds of motions of two tones and of branches of motions with a tone of their own,
and beside those of another checkout.

Two masses and a stop (docs/quasi_periodic.md, 1024 steps): a branch of tori up to 0.603 and 0.6025 rad/s,
without the exponents and with them, and to where the tone locks. The paper's beam, 80 modes: the motion under
two tones of `benchmarks/torus.py` without exponents, and the tori of the eight Neimark-Sacker points from
13.9 to 14.6 kHz at 1500 N. Seconds are the least of several repeats on one core, compiled before; checkouts
take turns.

    ./run python benchmarks/tori.py
    ./run python benchmarks/tori.py --beside ../other      a checkout with the same functions
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import subprocess
import sys
import time
import warnings

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
ROOT = pathlib.Path(__file__).resolve().parents[1]

import numpy as np

TURN, ASKED = 2.0 * np.pi, 1.05
STOPS, LOCKED = (0.603, 0.6025), 0.6


def cases():
    """Names and calls; each returns how many motions it has found."""
    import sbfem_petsc as sb
    from tests.systems import case_p, two_masses

    def point_of(curve):
        return [item for item in curve.bifurcations if item.kind == "Neimark-Sacker"]

    curve = sb.frequency_response(
        two_masses(0.02, compliance=0.1), [0.1], 0.607 / TURN, 0.602 / TURN, steps=1024
    )
    first = sb.switch_branch(curve, point_of(curve)[0])

    def tori(stop, stability):
        return lambda: len(sb.quasi_periodic_response(first, stop / TURN, stability=stability, progress=None))

    for stop in STOPS:
        yield f"tori to {stop:g} rad/s", tori(stop, False)
        yield f"tori to {stop:g} rad/s, exponents", tori(stop, True)
    yield "tori until they lock", tori(LOCKED, False)
    pump = 50.0 * 2.0**0.5
    load = sb.PointForce("A", fy=sb.Harmonic(300.0, 3000.0) + sb.Harmonic(100.0, pump))
    reduced = sb.reduce(case_p(0.002), load, modes=80)
    tones = {"samples": 21, "steps": 512, "stability": False}
    yield (
        "beam, two tones",
        lambda: len(sb.quasi_periodic(reduced, load, (3000.0, pump), **tones).residuals),
    )
    push = sb.PointForce("A", fy=1500.0)
    beam = sb.frequency_response(case_p(0.002), push, 13900.0, 14600.0, modes=80)
    yield "beam, tori at its points", lambda: len([sb.switch_branch(beam, item) for item in point_of(beam)])


def once(repeats: int, wanted: str) -> None:
    """Print seconds and counts as JSON."""
    warnings.simplefilter("ignore")
    found = {}
    for name, work in cases():
        if wanted not in name:
            continue
        work()  # compiles
        spent = []
        for _ in range(repeats):
            began = time.process_time()
            count = work()
            spent.append(time.process_time() - began)
        found[name] = (min(spent), count)
    print(json.dumps(found))


def of(checkout: pathlib.Path, own: argparse.Namespace) -> dict[str, tuple[float, int]]:
    """What a checkout takes, in a process of its own."""
    program = [sys.executable, __file__, "--once", str(checkout.resolve())]
    program += ["--repeats", str(own.repeats), "--only", own.only]
    done = subprocess.run(program, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--beside", type=pathlib.Path, help="another checkout")
    parser.add_argument("--pairs", type=int, default=2, help="turns of either checkout (default 2)")
    parser.add_argument("--repeats", type=int, default=2, help="in each turn, the fastest counts (default 2)")
    parser.add_argument("--only", default="", help="cases whose names hold this")
    parser.add_argument("--once", metavar="CHECKOUT", help="of a checkout alone, as JSON")
    own = parser.parse_args()
    if own.once:
        sys.path[0] = own.once
        once(own.repeats, own.only)
        return
    best: list[dict[str, tuple[float, int]]] = [{}, {}]
    checkouts = [ROOT] if own.beside is None else [ROOT, own.beside]
    for _ in range(own.pairs):
        for known, checkout in zip(best, checkouts):
            for name, (seconds, count) in of(checkout, own).items():
                known[name] = min(known.get(name, (np.inf, 0)), (seconds, count))
    for name, (seconds, count) in best[0].items():
        told = f"{name:36s} {seconds:7.2f} s, {count} motions or iterates"
        if name in best[1]:
            other, there = best[1][name]
            told += f"; beside {other:7.2f} s, {there}: {seconds / other:.2f} (asked {ASKED})"
        print(told)


if __name__ == "__main__":
    main()
