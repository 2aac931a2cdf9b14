"""Backbones beside those of another copy of the project: points, interactions told, CPU seconds of one core.

Each case runs in either copy in turn, in processes of their own. The other
copy may be a worktree of an earlier commit.

With a loop of their own (commit f458390), and by the one continuation, on two busy cores:

| case | before: points, told, s | now: points, told, s | ratio |
|---|---|---|---|
| one mass | 21, 0, 0.81 | 21, 0, 0.31 | 0.38 |
| one mass, downwards | 24, 0, 1.72 | 19, 0, 0.57 | 0.33 |
| one mass, damped | 21, 0, 0.63 | 21, 0, 0.29 | 0.47 |
| two masses, mode 2 | 28, 0, 3.05 | 22, 0, 0.96 | 0.32 |
| two masses, damped | 35, 0, 5.25 | 27, 0, 1.58 | 0.30 |
| two masses, damped, mode 2 | 33, 0, 2.44 | 27, 0, 1.21 | 0.50 |
| two masses, into tongues | 186, 0, 5.31 | 174, 0, 3.70 | 0.70 |

    ./run python benchmarks/backbones.py [OTHER]
"""

from __future__ import annotations

import json
import os
import pathlib
import subprocess
import sys
import time
import warnings
from typing import Any

ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
os.environ.update(ONE_THREAD)
ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, os.environ.get("BACKBONES_OF", str(ROOT)))

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, VNotch


def one_mass(damping: float) -> sb.ReducedModel:
    """A mass on a spring 10 N/m, with a stop of 50 N/m at 0.01 m."""
    return sb.reduce_matrices(
        np.eye(1),
        np.array([[10.0]]),
        np.array([[1.0]]),
        np.array([0.01]),
        loads=np.ones((1, 1)),
        sensors={"x": 0},
        damping=damping,
        compliance=np.array([0.02]),
    )


def two_masses(damping: float) -> sb.ReducedModel:
    """Unit masses and springs in a chain, stops of stiffness 30 on either side of the first."""
    stiffness = np.array([[2.0, -1.0], [-1.0, 1.0]])
    return sb.reduce_matrices(
        np.eye(2),
        stiffness,
        np.array([[1.0, 0.0], [-1.0, 0.0]]),
        np.ones(2),
        loads=np.zeros((2, 1)),
        sensors={"1": 0, "2": 1},
        compliance=np.full(2, 1.0 / 30.0),
        damping=damping * stiffness,
    )


def beam(opening: float) -> sb.ReducedModel:
    """The paper's beam with one crack, damping ratio .005, 30 modes."""
    shape = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, opening)])
    material = sb.Material(young=70e9, poisson=0.33, density=2700)
    model = sb.Model(shape.mesh(order=4, face_edges=1), material, damping=0.005, tip_modes=0)
    return sb.reduce(model, sb.PointForce("A", fy=1.0), modes=30)


QUICK: dict[str, Any] = {"refine": False, "stability": False}
CASES: dict[str, tuple[Any, int, float, float, dict[str, Any]]] = {
    "one mass": (lambda: one_mass(0.0), 1, 4e-4, 1.0, {}),
    "one mass, downwards": (lambda: one_mass(0.0), 1, 1.0, 1e-4, {"steps": 2048}),
    "one mass, damped": (lambda: one_mass(0.01), 1, 4e-4, 1.0, {"damping": True}),
    "two masses, mode 2": (lambda: two_masses(0.0), 2, 1.7, 4.0, {}),
    "two masses, damped": (lambda: two_masses(0.02), 1, 0.5, 4.0, {"damping": True}),
    "two masses, damped, mode 2": (lambda: two_masses(0.02), 2, 0.5, 4.0, {"damping": True}),
    "two masses, into tongues": (
        lambda: two_masses(0.0),
        1,
        0.5,
        100.0,
        {"interactions": True, "largest_change": 0.1, "points": 400, "refine": False},
    ),
    "two masses, tongues": (lambda: two_masses(0.0), 1, 0.5, 100.0, {"points": 400, **QUICK}),
    "beam, mode 5": (lambda: beam(0.0458366), 5, 1e-4, 20.0, {"refine": False}),
    "beam, damped": (lambda: beam(0.0458366), 1, 1e-4, 20.0, {"damping": True, "refine": False}),
    "beam, over interactions": (lambda: beam(0.0458366), 1, 1e-4, 20.0, QUICK),
    "beam, closed crack": (lambda: beam(0.0), 1, 1e-4, 1.0, {}),
}


def measured(name: str) -> dict[str, float]:
    """Points, interactions told and CPU seconds of a case."""
    make, mode, start, stop, options = CASES[name]
    warnings.simplefilter("ignore")
    system = make()
    sb.backbone(one_mass(0.0), 1, 4e-4, 6e-4, steps=64)  # what is compiled and loaded once
    begin = time.process_time()
    found = sb.backbone(system, mode, start, stop, **options)
    seconds = time.process_time() - begin
    return {"points": len(found.energy), "told": len(found.passed), "seconds": seconds}


def main() -> None:
    """Print the table."""
    others = [pathlib.Path(path).resolve() for path in sys.argv[1:2]]
    print("| case |" + " points, told, s |" * (len(others) + 1) + (" ratio |" if others else ""))
    for name in CASES:
        found = []
        for root in (*others, ROOT):
            environment = {**os.environ, "BACKBONES_OF": str(root), "PYTHONPATH": str(root)}
            run = [sys.executable, __file__, "--case", name]
            done = subprocess.run(run, env=environment, capture_output=True, text=True, check=True, cwd=root)
            found.append(json.loads(done.stdout))
        cells = [f" {item['points']}, {item['told']}, {item['seconds']:.2f} |" for item in found]
        ratio = f" {found[-1]['seconds'] / found[0]['seconds']:.2f} |" if others else ""
        print(f"| {name} |" + "".join(cells) + ratio, flush=True)


if __name__ == "__main__":
    if "--case" in sys.argv:
        print(json.dumps(measured(sys.argv[-1])))
    else:
        main()
