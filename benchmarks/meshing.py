"""What meshes of beams and plates cost.

CPU seconds of `mesh`, gmsh's session with it, the least of several repeats on one thread. Beside them the
same on the machine for which times are asked: times are divided by that of NumPy's eigenvalues of a random
matrix of 160 x 160, taken between the repeats, and multiplied by the 9.6 ms that these take there.

    ./run python benchmarks/meshing.py [--repeats N]
"""

from __future__ import annotations

import argparse
import os
import pathlib
import sys
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np

from meshing import Beam, CrackLine, Hole, Plate, VNotch

OPENING, HOLE = 0.0458366, Hole(0.065, 0.0025, 0.0025)
EIGENVALUES = 9.6e-3  # s, on the machine of reference


def beam(*notches, **features) -> Beam:
    """0.4 m long and 5 mm high."""
    return Beam(0.4, 0.005, notches, **features)


PLATE = Plate(
    [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)],
    holes=[Hole(0.05, 0.05, 0.02)],
    cracks=[
        CrackLine([(0, 0.03), (0.02, 0.03)]),
        CrackLine([(0.06, 0.05), (0.085, 0.06)]),
        CrackLine([(0.03, 0.075), (0.06, 0.085)]),
        CrackLine([(0.075, 0.02), (0.09, 0.035)]),
        CrackLine([(0.045, 0.1), (0.04, 0.09)]),
    ],
)
BODIES = {
    "the paper's beam": (beam(VNotch(0.08, 0.0025, OPENING)), {}),
    "tilted notch": (beam(VNotch(0.08, 0.0025, OPENING, tilt=30.0)), {}),
    "two notches": (beam(VNotch(0.08, 0.0025, OPENING), VNotch(0.2, 0.002, 5.0)), {}),
    "hole": (beam(holes=[HOLE]), {}),
    "hole apart from a notch": (beam(VNotch(0.08, 0.0015, OPENING), holes=[HOLE]), {}),
    "hole close to a notch": (beam(VNotch(0.068, 0.0015, OPENING), holes=[HOLE]), {}),
    "bottom notch": (beam(VNotch(0.08, 0.0025, OPENING, edge="bottom")), {}),
    "inner crack": (beam(cracks=[CrackLine([(0.08, 0.0015), (0.0825, 0.0035)])]), {}),
    "plate, 5 cracks, a hole": (PLATE, {}),
    "1,100 cells": (beam(VNotch(0.068, 0.0015, OPENING), holes=[HOLE]), {"size": 0.0015}),
}


def seconds(work, *given, **options) -> float:
    """CPU seconds of one call."""
    began = time.process_time()
    work(*given, **options)
    return time.process_time() - began


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--repeats", type=int, default=12)
    repeats = parser.parse_args().repeats
    square = np.random.default_rng(0).random((160, 160))
    print(f"{'':26s}{'S-elements':>11s}{'CPU ms':>9s}{'scaled ms':>11s}")
    for name, (body, options) in BODIES.items():
        elements = body.mesh(**options).elements
        units, spent = [], []
        for _ in range(repeats):
            units += [seconds(np.linalg.eigvals, square) for _ in range(3)]
            spent.append(seconds(body.mesh, **options))
        scaled = min(spent) / min(units) * EIGENVALUES
        print(f"{name:26s}{elements:11d}{1e3 * min(spent):9.1f}{1e3 * scaled:11.1f}", flush=True)


if __name__ == "__main__":
    main()
