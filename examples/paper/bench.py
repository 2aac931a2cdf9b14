"""Beams, materials, models and reduced models that the parts share, made when first asked for; reference
data.
"""

from __future__ import annotations

import functools
import json
import pathlib
from typing import Any

import numpy as np
from mpi4py import MPI

import sbfem_petsc as sb
from meshing import Beam, Hole, VNotch

REFERENCE = pathlib.Path(__file__).resolve().parents[1] / "reference"

# Meshes: the default, one that is refined towards the tip for histories, one that is so at 1 N, and one whose
# own error is below the reference's.
REFINED: dict[str, Any] = {"order": 6, "grading": 1.8, "tip_size": 5e-6}
# At 1 N the faces touch over a fraction of a micrometre next to the tip.
NEAR_TIP = {"order": 6, "tip_size": 1e-8}
CONVERGED = {"order": 8, "grading": 1.8, "tip_size": 1e-6}

OPENING = 0.0458366  # degrees, a mouth of 2.000 um over 2.5 mm


def _slender(notches=(), holes=()) -> Beam:
    return Beam(length=0.400, height=0.005, notches=notches, holes=holes)


def _aluminium(poisson: float):
    return sb.Material(young=70e9, poisson=poisson, density=2700)


_STEEL = {"young": 206e9, "poisson": 0.3, "density": 7850}

# Name: beam and material. "tables" is what the paper's tables contain, "printed" what its text says.
CASES = {
    "tables": lambda: (_slender([VNotch(0.080, 0.0025, OPENING)]), _aluminium(0.33)),
    "printed": lambda: (_slender([VNotch(0.100, 0.0025, 0.06)]), _aluminium(0.30)),
    "100 mm": lambda: (_slender([VNotch(0.100, 0.0025, OPENING)]), _aluminium(0.33)),
    "healthy": lambda: (_slender(), _aluminium(0.33)),
    "Long, cracked": lambda: (Beam(0.406, 0.012, [VNotch(0.176, 0.0038, 0.0)]), sb.Material(**_STEEL)),
    "Long, healthy": lambda: (Beam(0.406, 0.012), sb.Material(**_STEEL)),
    "hole, cracked": lambda: (
        _slender([VNotch(0.080, 0.0015, OPENING)], [Hole(0.065, 0.0025, 0.0025)]),
        _aluminium(0.33),
    ),
    "hole, healthy": lambda: (_slender((), [Hole(0.065, 0.0025, 0.0025)]), _aluminium(0.33)),
}


class Bench:
    """Models of this rank alone: parts, not unknowns, are shared out among ranks."""

    comm = MPI.COMM_SELF

    def __init__(self):
        self._models, self._results = {}, {}

    @functools.cached_property
    def reference(self) -> dict:
        """Converged values of an independent hp finite element code, and the paper's tables."""
        return json.loads((REFERENCE / "reference.json").read_text())

    def once(self, key, work):
        """`work()`, or what it gave before under the same key: results that several parts use."""
        if key not in self._results:
            self._results[key] = work()
        return self._results[key]

    def model(self, case: str, damping: float = 0.0, continued_fraction: int = 1, **mesh):
        """The model of a case on a mesh; the keywords are those of `Beam.mesh`."""
        key = (case, damping, continued_fraction, *sorted(mesh.items()))
        if key not in self._models:
            beam, material = CASES[case]()
            self._models[key] = sb.Model(
                beam.mesh(**mesh),
                material,
                clamped="left",
                continued_fraction=continued_fraction,
                damping=damping,
                comm=self.comm,
            )
        return self._models[key]

    def reduced(self, case: str, damping: float = 0.0, modes: int = 80, **mesh) -> sb.ReducedModel:
        """Lowest modes and residual flexibility of a case under a force at A in y; its model keeps it."""
        return sb.reduce(self.model(case, damping, **mesh), push(1.0), modes=modes)

    @staticmethod
    def beam(case: str) -> Beam:
        """The beam of a case."""
        return CASES[case]()[0]

    def other(self, notch: VNotch | None, poisson: float, **mesh):
        """A model of the 400 x 5 mm beam with another notch, not kept."""
        beam = _slender([notch] if notch else ())
        return sb.Model(beam.mesh(**mesh), _aluminium(poisson), clamped="left", comm=self.comm)


def closed_frequencies(reduced: sb.ReducedModel) -> np.ndarray:
    """Natural frequencies with all contact pairs tied along their normal, Hz: the forces that hold the
    gaps at zero are -R^-1 G Phi q.
    """
    gap = reduced.gap
    stiffness = np.diag(reduced.omega**2) + gap.modes.T @ np.linalg.solve(gap.contact, gap.modes)
    return np.sqrt(np.linalg.eigvalsh(stiffness)) / (2.0 * np.pi)


def push(force: float):
    """A constant or harmonic force at A, N."""
    return sb.PointForce("A", fy=force)


def burst(force: float):
    """Eq. (39) at A."""
    return sb.PointForce("A", fy=sb.ToneBurst(force, frequency=3000.0, cycles=100))


@functools.cache
def histories() -> dict[str, np.ndarray]:
    """Reference histories of the tone bursts."""
    return dict(np.load(REFERENCE / "transient_paper.npz"))


def known_burst(force: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and u_y(A) of the reference under the burst of 1 N or 300 N."""
    names = ("t_linear", "uA_y_1N_linear") if force == 1.0 else ("t", "uA_y_300N_contact")
    return histories()[names[0]], histories()[names[1]]


def off_reference(history: sb.History, force: float) -> float:
    """Relative L2 distance of a burst's u_y(A) to the reference, over the time that both have."""
    times, exact = known_burst(force)
    both = times <= history.time[-1] * (1 + 1e-9)
    return distance(np.interp(times[both], history.time, history.displacement("A")[:, 1]), exact[both])


def distance(found, exact) -> float:
    """Relative L2 distance."""
    return float(np.linalg.norm(np.subtract(found, exact)) / np.linalg.norm(exact))
