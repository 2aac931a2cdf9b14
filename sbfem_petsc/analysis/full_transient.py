"""Time histories of the unreduced model: Newmark's average acceleration on PETSc (prefix ``newmark_``), contact implicit in each step.

With w = u0 + u1, a step solves (4/h^2 M + 2/h C + K) w = M ((8/h^2 + 4 a/h) u0 + 4/h v0) + 4 b/h K u0 + f0 + f1 + 2 G^T force for Rayleigh damping
C = a M + b K: one product with M and one linear solve with a matrix factorised once. Nodes on crack faces have mass here. The contact force is
that of the step alone (Kane et al. 1999; Deuflhard, Krause and Ertel 2008): it is not carried into the next step's acceleration, so contact
dissipates and never feeds energy in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..contact.complementarity import one_pass_tie, solve_complementarity
from ..contact.delassus import ContactRows
from ..errors import SolveError, at_point, on_all_ranks
from ..loads import separate
from ..petsc import MPI
from ..system.model import Model
from ..system.pencil import CondensedSolve, Pencil
from .modal import modal

# The paper's scheme is stopped when its energy exceeds what was supplied by this factor.
RUNAWAY = 1.1


@dataclass(frozen=True, eq=False)
class FullTransient:
    """A time history of the unreduced model.

    Attributes
    ----------
    time : (n,) array
        s, from 0.
    point_displacements, point_velocities : dict of str to (n, 2) array
        m and m/s, on all ranks.
    contact_force, gap : (n, pairs) arrays
        N and m.
    kinetic, strain, external : (n,) arrays
        Energies and the loads' work, J.
    step : float
        s.
    rayleigh : (float, float)
        a (1/s) and b (s) of C = a M + b K.
    """

    time: np.ndarray
    point_displacements: dict[str, np.ndarray]
    point_velocities: dict[str, np.ndarray]
    contact_force: np.ndarray
    gap: np.ndarray
    kinetic: np.ndarray
    strain: np.ndarray
    external: np.ndarray
    step: float
    rayleigh: tuple[float, float]

    def displacement(self, point: str) -> np.ndarray:
        """(n, 2): displacement of a named point, m."""
        return at_point(self.point_displacements, point)

    def velocity(self, point: str) -> np.ndarray:
        """(n, 2): velocity of a named point, m/s."""
        return at_point(self.point_velocities, point)

    @property
    def contact_resultant(self) -> np.ndarray:
        """(n,): sum of the contact forces, N."""
        return self.contact_force.sum(axis=1)

    def __repr__(self) -> str:
        return f"FullTransient({len(self.time)} instants to {self.time[-1]:.6g} s, step {self.step:.3g} s, peak contact resultant {self.contact_resultant.max(initial=0.0):.6g} N)"


def rayleigh_factors(model: Model, highest: float) -> tuple[float, float]:
    """Factors a, b of C = a M + b K that give the model's damping ratio at its first natural frequency and at the loads' highest.

    Between the two the ratio is lower, outside it is higher: Rayleigh damping has two factors only.
    """
    if model.damping == 0.0:
        return 0.0, 0.0
    low = 2.0 * math.pi * float(modal(model, 1).frequencies[0])
    high = max(2.0 * math.pi * highest, 2.0 * low)
    return 2.0 * model.damping * low * high / (low + high), 2.0 * model.damping / (low + high)


def full_transient(model: Model, load, count: int, step: float, contact: bool = True, scheme: str = "implicit", decimation: int = 1) -> FullTransient:
    """Integrate the unreduced model over `count` steps from rest.

    Parameters
    ----------
    model : Model
        Its damping ratio is met at two frequencies, see `rayleigh_factors`.
    load : loads with numbers or signals
    count : int
    step : float
        s.
    contact : bool
    scheme : {"implicit", "paper"}
        "paper": eqs. (28)-(34) of Sepehry et al.: pairs that penetrate are tied in one pass, tension allowed, and the multiplier
        is carried in the acceleration. It is there to be compared with: contact feeds energy in (on the default mesh of the paper's
        beam, 300 N burst, 2 us: 1.4 % by 33 ms with a peak resultant 1.5 times too high; 25 % and 2.7 times without continued fraction).
    decimation : int

    Raises
    ------
    SolveError
        If a linear or contact solve fails, or the energy of the paper's scheme has run away.
    """
    model.require_support("the transient analysis")
    units, signals = separate(load)
    a, b = rayleigh_factors(model, max((s.highest_frequency or 0.0 for s in signals), default=0.0))
    time = np.arange(count + 1) * step
    amplitudes = np.stack([s(time) for s in signals], axis=-1) if signals else np.zeros((count + 1, 0))
    pencil = Pencil(model, 1.0, 0.0)
    stretch = 1.0 + 2.0 * b / step
    inertia = 4.0 / step**2 + 2.0 * a / step
    solve = CondensedSolve(pencil, -inertia / stretch, prefix="newmark_", what="transient")
    marcher = _March(model, pencil, solve, units, stretch, contact, scheme)
    try:
        return marcher.run(time, amplitudes, step, (a, b), decimation)
    finally:
        marcher.release()
        solve.release()
        pencil.destroy()


class _March:
    """Vectors and the condensed contact problem of one run."""

    def __init__(self, model: Model, pencil: Pencil, solve: CondensedSolve, units, stretch: float, contact: bool, scheme: str):
        self.model, self.pencil, self.solve, self.stretch, self.scheme = model, pencil, solve, stretch, scheme
        self.rows = ContactRows(model)
        self.pairs = len(self.rows.rows) if contact else 0
        self.u, self.v, self.w, self.right, self.work = (pencil.stiffness.createVecRight() for _ in range(5))
        for vector in (self.u, self.v, self.w):
            vector.set(0.0)
        owned = pencil.owned
        self.loads = np.zeros((self.right.getLocalSize(), len(units)))
        for k, unit in enumerate(units):
            vector = model.load_vector(unit)
            self.loads[:owned, k] = vector.array_r
            vector.destroy()
        # response of a step to each pair's unit force: what a contact correction adds
        self.responses = np.empty((self.right.getLocalSize(), self.pairs))
        for k in range(self.pairs):
            self.right.set(0.0)
            array = self.right.array
            numbers, values = self.rows.rows[k]
            array[numbers] = values
            self.solve.apply(None, self.right, self.w)
            self.responses[:, k] = self.w.array_r / stretch
        self.w.set(0.0)
        self.flexibility = self._gaps(self.responses)
        self.flexibility = 0.5 * (self.flexibility + self.flexibility.T)

    def _gaps(self, array: np.ndarray) -> np.ndarray:
        gaps = self.rows.local(array[: self.pencil.owned])[: self.pairs]
        self.model.comm.Allreduce(MPI.IN_PLACE, gaps)
        return gaps

    def run(self, time: np.ndarray, amplitudes: np.ndarray, step: float, rayleigh: tuple[float, float], decimation: int) -> FullTransient:
        """All steps."""
        a, b = rayleigh
        model, gap0 = self.model, self.model.pairs.gap[: self.pairs]
        record = {name: [] for name in ("displacement", "velocity", "force", "gap", "energy")}
        force, active, external, before = np.zeros(self.pairs), None, 0.0, np.zeros(amplitudes.shape[1])
        kept = [0]
        self._record(record, force, gap0, external)
        carried = np.zeros(self.pairs)
        for k in range(len(time) - 1):
            # right side in w = u0 + u1
            self.work.array = (8.0 / step**2 + 4.0 * a / step) * self.u.array_r + (4.0 / step) * self.v.array_r
            self.pencil.mass.mult(self.work, self.right)
            if b:
                self.pencil.stiffness.mult(self.u, self.work)
                self.right.axpy(4.0 * b / step, self.work)
            self.right.array += self.loads @ (amplitudes[k] + amplitudes[k + 1])
            self.solve.apply(None, self.right, self.w)
            if self.stretch != 1.0:
                self.w.scale(1.0 / self.stretch)
            # the paper carries half of the step's contact force over from the step before
            if self.scheme == "paper" and carried.any():
                self.w.array += self.responses @ carried
            force = np.zeros(self.pairs)
            gap = gap0
            if self.pairs:
                free = self._gaps((self.w.array_r - self.u.array_r)[:, None])[:, 0] + gap0
                share = 1.0 if self.scheme == "paper" else 2.0
                if (free < 0.0).any():
                    found = one_pass_tie(share * self.flexibility, free) if self.scheme == "paper" else solve_complementarity(share * self.flexibility, free, active)
                    force, active = found.force, found.active
                    self.w.array += share * (self.responses @ force)
                    gap = found.gap
                else:
                    gap, active = free, None
            carried = force
            u, v = self.u.array, self.v.array
            u1 = self.w.array_r - u
            v[:] = 2.0 / step * (u1 - u) - v
            u[:] = u1
            moved = self.loads.T @ u
            model.comm.Allreduce(MPI.IN_PLACE, moved)
            external += float(0.5 * (amplitudes[k] + amplitudes[k + 1]) @ (moved - before))
            before = moved
            if (k + 1) % decimation == 0 or self.scheme == "paper":
                energy = self._energy()
                if self.scheme == "paper" and k > 20 and sum(energy) > RUNAWAY * (abs(external) + 1e-300):
                    raise on_all_ranks(SolveError(f'transient: the energy of scheme "paper" has run away at t = {time[k + 1]:.6g} s ({sum(energy):.3g} J for {external:.3g} J of work done): the multiplier carried in the acceleration of contact nodes with mass feeds energy in; use the default scheme'))
                if (k + 1) % decimation == 0:
                    kept.append(k + 1)
                    self._record(record, force, gap, external, energy)
        energies = np.array(record["energy"])
        points = list(model.points)
        fields = {name: {p: np.array([row[p] for row in record[name]]) for p in points} for name in ("displacement", "velocity")}
        shape = (len(kept), self.pairs)
        return FullTransient(time[kept], fields["displacement"], fields["velocity"], np.array(record["force"]).reshape(shape), np.array(record["gap"]).reshape(shape),
                             energies[:, 0], energies[:, 1], energies[:, 2], step, rayleigh)

    def _energy(self) -> tuple[float, float]:
        self.pencil.mass.mult(self.v, self.work)
        kinetic = 0.5 * self.work.dot(self.v)
        self.pencil.stiffness.mult(self.u, self.work)
        return kinetic, 0.5 * self.work.dot(self.u)

    def _record(self, record: dict, force: np.ndarray, gap: np.ndarray, external: float, energy: tuple[float, float] | None = None) -> None:
        owned = self.pencil.owned
        record["displacement"].append(self.model.at_points(self.u.array_r[:owned]))
        record["velocity"].append(self.model.at_points(self.v.array_r[:owned]))
        record["force"].append(force)
        record["gap"].append(gap)
        record["energy"].append((*(energy or self._energy()), external))

    def release(self) -> None:
        """Free the vectors."""
        for vector in (self.u, self.v, self.w, self.right, self.work):
            vector.destroy()
