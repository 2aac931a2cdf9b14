"""Steady states with `accuracy=1e-3` beside those of 320 modes and of the defaults, in one run on one core.

Of each motion: modes and steps that were taken, the error of harmonics 1 to 4 that is told, of all named
points and of the resultant, the true one of the points beside 320 modes (or all that the mesh is good for, or
that 6,000 steps carry) in twice the most steps of all, each divided by its order; that of the contact
resultant's; CPU seconds of the first call with a new model and of a second one. Harmonics are beside
themselves, or 1e-3 of the largest. Compiling is not counted.

    ./run python benchmarks/accuracy.py
    ./run python benchmarks/accuracy.py plate          those whose names hold a word
"""

from __future__ import annotations

import os
import pathlib
import sys
import tempfile
import time
import warnings

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np

import sbfem_petsc as sb
from benchmarks.meshing import PLATE
from meshing import Beam, CrackLine, VNotch
from tests.validation.interface_cases import BODIES, FIRST, SECOND, read_gmsh

ACCURACY, MODES, FAINT, STEPS = 1e-3, 320, 1e-3, 6000
ALUMINIUM = sb.Material(70e9, 0.33, 2700.0)


def paper(**options) -> sb.Model:
    """The paper's beam."""
    mesh = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0458366)]).mesh(order=5)
    return sb.Model(mesh, ALUMINIUM, **{"damping": 0.002, **options})


def cut(length: float, height: float, at: float, depth: float, damping: float = 0.01) -> sb.Model:
    """A beam with one crack from its upper edge."""
    return sb.Model(Beam(length, height, [VNotch(at, depth, 0.0)]).mesh(order=5), ALUMINIUM, damping=damping)


def thick() -> sb.Model:
    """A beam half as high as it is long."""
    return cut(0.1, 0.05, 0.04, 0.02)


def slender() -> sb.Model:
    """2 m long, 10 mm high, two cracks."""
    mesh = Beam(2.0, 0.01, [VNotch(0.3, 0.004, 0.0), VNotch(1.1, 0.005, 0.0)]).mesh(order=5)
    return sb.Model(mesh, ALUMINIUM, damping=0.01)


def layers(law, crack: str = "crack2") -> sb.Model:
    """Two cracks, one of which a layer fills."""
    mesh = Beam(0.2, 0.006, [VNotch(0.04, 0.003, 0.0), VNotch(0.1, 0.003, 0.0)]).mesh(order=5)
    return sb.Model(mesh, ALUMINIUM, damping=0.005, contact_laws={crack: law})


def inner() -> sb.Model:
    """An inclined crack inside."""
    return sb.Model(
        Beam(0.2, 0.01, cracks=[CrackLine([(0.06, 0.003), (0.066, 0.008)])]).mesh(order=5),
        ALUMINIUM,
        damping=0.01,
    )


def bimaterial() -> sb.Model:
    """A square of two materials with a crack in their interface, held below."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "body.geo"
        path.write_text(BODIES["along"])
        return sb.Model(
            read_gmsh(path, order=5), {"first": FIRST, "second": SECOND}, clamped="bottom", damping=0.02
        )


def plate() -> sb.Model:
    """Five cracks and a hole."""
    mesh = PLATE.mesh(points={"A": (0.1, 0.1), "B": (0.0, 0.1)})
    return sb.Model(mesh, ALUMINIUM, damping=0.01, clamped="edge1")


def push(force: float, point: str = "A") -> sb.PointForce:
    """Along y."""
    return sb.PointForce(point, fy=force)


def pulses(force: float, frequency: float) -> sb.PointForce:
    """A bell of a twentieth of each period."""
    return push(sb.Custom(lambda t: force * np.exp(-((((t * frequency) % 1.0 - 0.3) / 0.02) ** 2))))


TONES = sb.Harmonic(60.0, 500.0) + sb.Harmonic(20.0, 2500.0)
PRESSED = [sb.EdgeLoad("top", pressure=1.0)]
CASES = {
    "slender beam, 3 Hz": (slender, push(5.0), 3.0),
    "paper's beam, 42 Hz": (paper, push(20.0), 42.0),
    "paper's beam, 433 Hz, Rayleigh": (lambda: paper(rayleigh=(5.0, 1e-7)), push(100.0), 433.0),
    "paper's beam, 5 kHz": (paper, push(300.0), 5000.0),
    "paper's beam, 20.14 kHz": (paper, push(300.0), 20140.0),
    "pulses, 200 Hz": (paper, pulses(200.0, 200.0), 200.0),
    "two tones, 500 and 2500 Hz": (paper, push(TONES), 500.0),
    "thick beam, 3 kHz": (thick, push(1e5), 3000.0),
    "inner crack, 700 Hz": (inner, push(100.0), 700.0),
    "tied layer, 900 Hz": (lambda: layers(sb.Tied()), push(50.0), 900.0),
    "elastic layer, 900 Hz": (lambda: layers(sb.Tied(4e-13)), push(50.0), 900.0),
    "interface crack, .02 Hz": (bimaterial, PRESSED, 0.02),
    "cantilever, 8 Hz": (lambda: cut(0.3, 0.01, 0.12, 0.005, 0.005), push(30.0), 8.0),
    "crack near the end, 260 Hz": (lambda: cut(0.25, 0.008, 0.2, 0.003), push(200.0), 260.0),
    "Rayleigh's b alone, 1.2 kHz": (lambda: paper(rayleigh=(0.0, 2e-8)), push(150.0), 1200.0),
    "paper's beam, 9 kHz": (paper, push(3000.0), 9000.0),
    "paper's beam, 19.3 kHz": (paper, push(1500.0), 19300.0),
    "pulses, 90 Hz": (lambda: cut(0.3, 0.01, 0.12, 0.005), pulses(80.0, 90.0), 90.0),
    "two tones, 300 and 2100 Hz": (
        lambda: cut(0.25, 0.008, 0.06, 0.004),
        push(sb.Harmonic(50.0, 300.0) + sb.Harmonic(30.0, 2100.0)),
        300.0,
    ),
    "stout beam, 6 kHz": (lambda: cut(0.12, 0.04, 0.05, 0.02), push(5e4), 6000.0),
    "inner crack, 4.1 kHz": (inner, push(200.0), 4100.0),
    "tied crack at the clamp, 600 Hz": (lambda: layers(sb.Tied(), "crack1"), push(30.0), 600.0),
    "soft layer, 2 kHz": (lambda: layers(sb.Tied(5e-12), "crack1"), push(80.0), 2000.0),
    "interface crack, .05 Hz": (bimaterial, PRESSED, 0.05),
    "plate of 5 cracks, 900 Hz": (plate, push(1e4), 900.0),
    "plate of 5 cracks, 6 kHz": (plate, push(1e4), 6000.0),
}


def harmonics(orbit: sb.Orbit) -> tuple[np.ndarray, np.ndarray]:
    """Harmonics 1 to 4 of all points, and of the contact resultant."""
    turns = slice(orbit.periods, 4 * orbit.periods + 1, orbit.periods)
    resultant = np.fft.rfft(orbit.contact_resultant)[turns, None] / len(orbit.time)
    return np.stack([orbit.harmonics(point)[1:5] for point in orbit.points], axis=1), resultant


def error(found: np.ndarray, true: np.ndarray) -> float:
    """Largest of harmonics 1 to 4, each divided by its order."""
    size = np.linalg.norm(true, axis=1)
    off = np.linalg.norm(found - true, axis=1) / np.maximum(size, max(FAINT * size.max(), 1e-300))
    return float((off / np.arange(1, 5)).max())


def timed(make, load, frequency: float, **options) -> tuple[sb.Orbit, float, float]:
    """A motion from the model, and again of the model that has its modes: CPU seconds of each."""
    spent, model = [], make()
    for _ in range(2):
        began = time.process_time()
        found = sb.periodic(model, load, frequency, stability=False, progress=None, **options)
        spent.append(time.process_time() - began)
    return found, spent[0], spent[1]


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    sb.periodic(paper(), push(1.0), 433.0, progress=None)
    heads = ("modes", "steps", "told", "true", "result.", "s first", "s again")
    print(" " * 32 + "".join(f"{head:>9s}" for head in heads))
    for name, (make, load, frequency) in CASES.items():
        if not all(word in name for word in sys.argv[1:]):
            continue
        model = make()
        most = min(MODES, model.boundary_unknowns // 4)
        # of slow loads those that STEPS carry: what is beyond them moves with the load
        most = min(most, int((0.8 * STEPS * frequency >= model.modes(most).frequencies).sum()))
        runs = [
            (words, *timed(make, load, frequency, **options))
            for words, options in (("accuracy = 1e-3", {"accuracy": ACCURACY}), ("default", {}))
        ]
        coarse = sb.periodic(model, load, frequency, modes=most, stability=False, progress=None)
        count = 2 * max(len(orbit.time) // orbit.periods for orbit in (coarse, *(run[1] for run in runs)))
        exact = sb.periodic(model, load, frequency, steps=count, guess=coarse, stability=False, progress=None)
        print(f"{name:32s}{most:9d}{count:9d}", flush=True)
        for words, found, first, again in runs:
            true, resultant = map(error, harmonics(found), harmonics(exact))
            print(
                f"    {words:28s}{len(found.reduced.omega):9d}{len(found.time) // found.periods:9d}"
                f"{found.largest_mode_error:9.1e}{true:9.1e}{resultant:9.1e}{first:9.2f}{again:9.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
