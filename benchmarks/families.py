"""CPU time of every family of motions that is followed over a parameter, of this tree and of others, side by
side in one run.

    git worktree add ../other COMMIT
    ./run python benchmarks/families.py --beside ../other

Each family is a program of its own, in a process that has compiled and run it once; the trees take turns, and
the least of several repeats counts. One BLAS thread.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parents[1]
BEGIN = """
import json, time, warnings
import numpy as np
warnings.simplefilter("ignore")
import sbfem_petsc as sb
from tests.systems import one_mass, two_masses
TURN = 2.0 * np.pi
"""
END = """
work()
began = time.process_time()
count = work()
print(json.dumps({"seconds": time.process_time() - began, "points": count}))
"""
CURVE = "sb.frequency_response(two_masses(0.02, compliance=0.1), [0.1], 0.6 / TURN, 0.62 / TURN, steps=128)"
OWN = "next(item for item in curve.bifurcations if item.kind == 'Neimark-Sacker')"
FAMILIES = {
    "over the frequency": """
def work():
    return len(sb.frequency_response(two_masses(), [0.1], 0.5 / TURN, 0.9 / TURN, steps=2048).value)
""",
    "over the frequency, without stability": """
def work():
    asked = {"steps": 2048, "stability": False}
    return len(sb.frequency_response(two_masses(), [0.1], 0.9 / TURN, 0.5 / TURN, **asked).value)
""",
    "over the load": """
def work():
    return len(sb.load_response(two_masses(), [0.1], 0.55 / TURN, steps=1024).value)
""",
    "in segments": """
def work():
    return len([sb.periodic(two_masses(), [0.1], f / TURN, steps=1920, segments=8) for f in (0.6, 0.8)])
""",
    "loci": f"""
curve = {CURVE}
def work():
    return len(sb.locus(curve, {OWN}, 0.9, 1.1, points=10))
""",
    "backbones": """
def work():
    return len(sb.backbone(one_mass(0.1, 0.0), 1, 1e-3, 1.0, steps=512).energy)
""",
    "tori": """
curve = sb.frequency_response(two_masses(0.02, compliance=0.1), [0.1], 0.0962, 0.0959, steps=128, points=40)
motion = sb.switch_branch(curve, curve.bifurcations[0], samples=7)
def work():
    return len(sb.quasi_periodic_response(motion, 0.095, points=4, stability=False).motions)
""",
    "unreduced": """
from tests.numbers.unreduced import body
model = body()
def work():
    return sb.periodic(model, sb.PointForce("A", fy=3e3), 1200.0, steps=65, reduction=None).iterations
""",
}


def measured(tree: pathlib.Path, program: str) -> dict[str, float]:
    """CPU seconds and points of a family in a tree."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    environment = {**os.environ, **threads, "PYTHONPATH": str(tree)}
    command = [sys.executable, "-c", BEGIN + program + END]
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{tree}: {done.stderr.strip().splitlines()[-1]}")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--beside", type=pathlib.Path, action="append", default=[], help="another checkout")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", choices=FAMILIES, help="one family")
    own = parser.parse_args()
    trees = [HERE, *(path.resolve() for path in own.beside)]
    print(f"{'family':40s} " + " ".join(f"{tree.name:>18s}" for tree in trees) + "   ratios")
    for name, program in FAMILIES.items():
        if own.only not in (None, name):
            continue
        rounds = [[measured(tree, program) for tree in trees] for _ in range(own.repeats)]
        best = [min((turn[k] for turn in rounds), key=lambda row: row["seconds"]) for k in range(len(trees))]
        cells = " ".join(f"{row['seconds']:9.2f} s {row['points']:6.0f}" for row in best)
        ratios = " ".join(f"{best[0]['seconds'] / row['seconds']:.2f}" for row in best[1:])
        print(f"{name:40s} {cells}   {ratios}", flush=True)


if __name__ == "__main__":
    main()
