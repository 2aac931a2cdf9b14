"""CPU seconds of a few programs beside those of another commit, in one run: processes of both take turns, the
first and the best of each are told. ``python benchmarks/beside.py COMMIT [--pairs N] [PROGRAM ...]``; kernels
are compiled before, by what each commit has for that, into a folder of its own.
"""

from __future__ import annotations

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).parents[1]
TIMED = """
import sys, time
import numpy as np
begun = time.process_time()
import sbfem_petsc as sb
from meshing import Beam, VNotch
print("import", time.process_time() - begun)
notches = [VNotch(x=0.080, depth=0.0025, opening=0.0458366)]
aluminium = sb.Material(young=70e9, poisson=0.33, density=2700)

def body(**options):
    beam = Beam(length=0.400, height=0.005, notches=notches).mesh(**options)
    return sb.Model(beam, aluminium, clamped="left", continued_fraction=1, damping=0.002)

def told(name, work, repeats=1):
    best = np.inf
    for _ in range(repeats):
        begun = time.process_time()
        work()
        best = min(best, time.process_time() - begun)
    print(name.replace(" ", "_"), best)

push = sb.PointForce("A", fy=300.0)
"""
PROGRAMS = {
    "orbit": """
model = body(order=5)
told("first orbit of a process", lambda: sb.periodic(model, push, 3000.0, progress=None))
told("orbit again", lambda: sb.periodic(model, push, 3000.0, progress=None), 3)
""",
    "kernels": """
reduced = sb.reduce(body(order=3), push, modes=24)
rest = np.zeros((1, len(reduced.omega)))
told("first basins", lambda: sb.basins(reduced, push, 3000.0, (rest, rest), steps=64, limit=3, progress=None))
told("first unreduced history", lambda: sb.transient(
    body(order=3), sb.PointForce("A", fy=1.0), 2e-5, 2e-6, reduction=None, progress=None))
""",
    "modes": """
beam = Beam(length=0.400, height=0.005, notches=notches)
for order, size, corner in ((3, 0.008, None), (4, 0.010, 0.002), (5, 0.0115, 0.001)):
    corners = ("left",) if corner else ()
    mesh = beam.mesh(order=order, size=size, tip_size=0.0012, corner_size=corner, corners=corners)

    def modes():
        model = sb.Model(mesh, aluminium)
        sb.modal(model, 46, auxiliary_tolerance=1e-3, verify=False)
        model.destroy()

    told(f"46 modes, order {order}", modes, 7)
""",
    "statics": """
mesh = Beam(length=0.400, height=0.005, notches=notches).mesh(order=5)

def three():
    model = sb.Model(mesh, aluminium)
    for force in (100.0, -100.0, 300.0):
        sb.static(model, sb.PointForce("A", fy=force))
told("three statics", three, 7)
""",
    "contact": """
from benchmarks.plate import plate, plate_mesh
mesh = plate_mesh(plate(10, 0, 0), 25_000, 5)

def ready():
    model = sb.Model(mesh, aluminium, clamped="edge1")
    model.stiffness, model.contact, model.tips.intensities
    return model

for name, pressure, shear in (("pressed", 1e6, 2e5), ("sheared", 0.0, 1e6), ("pulled open", -1e6, 0.0)):
    models = [ready() for _ in range(3)]
    load = sb.EdgeLoad("edge3", pressure=pressure, tx=shear)
    told(f"static contact, {name}", lambda: sb.static(models.pop(), load), len(models))
""",
    "plate": """
from benchmarks.plate import plate, plate_mesh
mesh = plate_mesh(plate(10, 0, 0), 124_552, 5)
for name, pressure in (("pressed", 1e6), ("pulled open", -1e6)):
    begun = time.process_time()
    model = sb.Model(mesh, aluminium, clamped="edge1")
    model.stiffness
    print("build_of_a_large_plate", time.process_time() - begun)
    load = sb.EdgeLoad("edge3", pressure=pressure, tx=2e5)
    told(f"static contact of it, {name}", lambda: sb.static(model, load))
told("20 modes of it", lambda: sb.modal(model, 20))
""",
}


def environment(root: pathlib.Path, compiled: str) -> dict[str, str]:
    given = {"PYTHONPATH": str(root), "NUMBA_CACHE_DIR": compiled, "OMP_NUM_THREADS": "1"}
    return os.environ | given


def compile_kernels(root: pathlib.Path, compiled: str) -> None:
    names = ("cli", "contact")
    name = next(n for n in names if (root / "sbfem_petsc" / n / "precompile.py").exists())
    command = [sys.executable, "-m", f"sbfem_petsc.{name}.precompile"]
    subprocess.run(command, cwd=root, env=environment(root, compiled), check=True)


def seconds(root: pathlib.Path, compiled: str, program: str) -> dict[str, float]:
    command = [sys.executable, "-W", "ignore", "-c", TIMED + PROGRAMS[program]]
    done = subprocess.run(
        command, cwd=root, env=environment(root, compiled), check=True, capture_output=True, text=True
    )
    return {name: float(spent) for name, spent in map(str.split, done.stdout.splitlines())}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("commit")
    parser.add_argument("programs", nargs="*", metavar="PROGRAM", help=", ".join(PROGRAMS))
    parser.add_argument("--pairs", type=int, default=5)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        other = pathlib.Path(folder) / "other"
        other.mkdir()
        archive = subprocess.run(["git", "archive", asked.commit], cwd=ROOT, check=True, capture_output=True)
        subprocess.run(["tar", "-x", "-C", str(other)], input=archive.stdout, check=True)
        sides = [(other, f"{folder}/before"), (ROOT, f"{folder}/now")]
        for side in sides:
            compile_kernels(*side)
        print(f"{'CPU s, first and best':28} {asked.commit[:9]:>17} {'now':>17} {'ratio of best':>14}")
        for program in asked.programs or PROGRAMS:
            rounds = [[seconds(*side, program) for side in sides] for _ in range(asked.pairs)]
            for name in rounds[0][0]:
                spent = [[pair[i][name] for pair in rounds] for i in range(2)]
                before, now = (f"{side[0]:8.3f} {min(side):8.3f}" for side in spent)
                ratio = min(spent[1]) / min(spent[0])
                print(f"{name.replace('_', ' '):28} {before} {now} {ratio:14.2f}", flush=True)


if __name__ == "__main__":
    main()
