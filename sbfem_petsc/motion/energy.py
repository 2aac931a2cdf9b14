"""Energies of a history, their account for a reduced model, and the guard that refuses a history in which
contact does work.
"""

from __future__ import annotations

import numpy as np

from ..contact.marching import StepHistory
from ..errors import SolveError, on_all_ranks
from ..record.record import Record, described, quantity
from ..reduction.reduced_model import ReducedModel

# Work of the contact forces, relative to the energy supplied, beyond which a history is refused.
WORK_LIMIT = 0.01


@described
class Energy(Record):
    """Energies and work since the start. Contact works, beside what friction takes, in the steps alone in
    which pairs change sides, where it is the integrator's error, summed over the parts of halved steps.
    """

    kinetic: np.ndarray = quantity("J", "kinetic energy", "time")
    strain: np.ndarray = quantity(
        "J", "strain energy, a reduced model's residual flexibility included", "time"
    )
    external: np.ndarray = quantity("J", "work of the loads", "time")
    damping: np.ndarray = quantity("J", "energy dissipated by damping", "time")
    contact: np.ndarray = quantity("J", "work of the contact forces, beside what is lost to friction", "time")
    friction: np.ndarray | None = quantity(
        "J", "energy lost to friction, where faces rub", "time", kinds="f", default=None
    )

    @property
    def total(self) -> np.ndarray:
        """(n,): kinetic and strain energy."""
        return self.kinetic + self.strain

    @property
    def balance(self) -> np.ndarray:
        """(n,): what kinetic and strain energy gained beyond the work done; zero but for the integrator's
        error.
        """
        gained = self.total - self.total[0]
        lost = self.damping if self.friction is None else self.damping + self.friction
        return gained - (self.external + self.contact - lost)


class Ledger:
    """Energies and work, carried from chunk to chunk; that of contact is what the steps themselves tell."""

    def __init__(self, reduction: ReducedModel, smooth: bool):
        # average acceleration moves by the mean of the ends' forces, so the plain trapezoidal rule is its own
        # work
        self.r, self.smooth = reduction, smooth
        # external, damping, contact, and friction
        self.work = np.zeros(3 if reduction.friction is None else 4)
        self.stiffness, self.friction = reduction.omega**2, 2.0 * reduction.damping * reduction.omega
        self.ones, self._squares = np.ones(len(reduction.omega)), np.empty((0, len(reduction.omega)))
        # of the displacements of loads and contact under their own forces
        self.flexibility = np.block(
            [
                [reduction.load_flexibility, reduction.gap.loads.T],
                [reduction.gap.loads, reduction.gap.contact],
            ]
        )

    def start(self, q: np.ndarray, v: np.ndarray, amplitude: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(5, 1) energies and work at t = 0; (6, 1) where faces rub, and so of the others."""
        self.work[:] = 0.0
        self.last = self._instants(q[None], v[None], amplitude[None], force[None])
        self.supplied = float(self.last[2].sum())
        return np.concatenate([self.last[2].T, self.work[:, None]])

    def account(self, history: StepHistory, amplitudes: np.ndarray, step: float) -> np.ndarray:
        """(5, n): kinetic, strain, external, damping, contact after each step of a length (s); `amplitudes`
        (n + 1, loads) begins with the step before.
        """
        states, velocities, forces, contact, _, lost, *_ = history
        # of the loads and rows of contact that act meanwhile: mostly few of them
        loaded, touched = (amplitudes != 0.0).any(axis=0), (forces != 0.0).any(axis=0)
        drive, moved, stored, loss, rate = self._instants(
            states,
            velocities,
            np.compress(loaded, amplitudes[1:], axis=1),
            np.compress(touched, forces, axis=1),
            loaded,
            touched,
        )
        last = self.last
        before = (last[0][:, loaded], last[1][:, loaded], last[3], last[4][:, loaded])
        pairs = zip(before, (drive, moved, loss, rate))
        drives, moves, losses, rates = (np.concatenate(pair) for pair in pairs)
        # integral of the force over the displacement: the displacement's mean over a step from its ends and
        # the rates there
        external = 0.5 * (drives[1:] + drives[:-1]) * np.diff(moves, axis=0)
        if self.smooth:
            external += np.diff(drives, axis=0) * np.diff(rates, axis=0) * (step / 12.0)
        parts = [external.sum(axis=1), 0.5 * step * (losses[1:] + losses[:-1]), contact]
        if len(self.work) > len(parts):
            parts.append(lost if len(lost) else np.zeros(len(contact)))
        steps = np.stack(parts)
        work = self.work[:, None] + np.cumsum(steps, axis=1)
        self.work = work[:, -1]
        self.last = self._instants(states[-1:], velocities[-1:], amplitudes[-1:], forces[-1:])
        return np.concatenate([stored.T, work])

    def jump(
        self,
        q: np.ndarray,
        v: np.ndarray,
        amplitude: np.ndarray,
        before: np.ndarray,
        force: np.ndarray,
        *,
        lost: float,
    ) -> np.ndarray:
        """(5,): the same where loads have jumped to `amplitude`, and contact from `before` to `force`: what
        moves with them has no inertia; so much is lost to friction.
        """
        drives = np.concatenate([[self.last[0][0], amplitude], [before, force]], axis=1)
        work = drives.mean(axis=0) * (self.flexibility @ (drives[1] - drives[0]))
        loads = len(amplitude)
        done = np.array([work[:loads].sum(), 0.0, work[loads:].sum() + lost, lost])
        self.work = self.work + done[: len(self.work)]
        self.last = self._instants(q[None], v[None], amplitude[None], force[None])
        return np.concatenate([self.last[2][0], self.work])

    def _instants(
        self,
        q: np.ndarray,
        v: np.ndarray,
        amplitudes: np.ndarray,
        forces: np.ndarray,
        loaded: np.ndarray | slice = np.s_[:],
        touched: np.ndarray | slice = np.s_[:],
    ) -> tuple[np.ndarray, ...]:
        """Loads, the displacements they work on, stored energies (n, 2), dissipated power (n,), velocities at
        the loads; of all loads and rows of contact, or of some of them that alone are given.
        """
        loads, places = amplitudes.shape[1], np.arange(len(self.flexibility))
        count = self.r.load_modes.shape[1]
        places = np.concatenate([places[:count][loaded], places[count:][touched]])
        flexibility, modes = self.flexibility[places][:, places], self.r.load_modes.T[loaded]
        near, drive = forces.any(axis=1), np.concatenate([amplitudes, forces], axis=1)
        flexible = np.zeros_like(drive)
        flexible[:, :loads] = amplitudes @ flexibility[:loads, :loads]
        flexible[near] = drive[near] @ flexibility
        # one product after the other: BLAS is slow in those with two columns
        if len(self._squares) < len(q):
            self._squares = np.empty_like(q)
        squared = np.multiply(v, v, out=self._squares[: len(q)])
        kinetic, lost = 0.5 * (squared @ self.ones), squared @ self.friction
        squared = np.multiply(q, q, out=squared)
        strain = 0.5 * (squared @ self.stiffness + np.einsum("ij,ij->i", drive, flexible))
        moved = q @ modes.T + flexible[:, :loads]
        return amplitudes, moved, np.stack([kinetic, strain], axis=1), lost, v @ modes.T


def guard(chunk: np.ndarray, ledger: Ledger, time: np.ndarray) -> None:
    """Stop where contact has fed energy, or taken it though its laws do not: what it does in steps that
    switch is the integration's error.
    """
    total, external = chunk[0] + chunk[1], np.abs(chunk[2])
    contact = chunk[4] if ledger.r.contact_laws.dissipative else np.abs(chunk[4])
    ledger.supplied = max(ledger.supplied, float(external.max()))
    if not np.isfinite(total).all() or contact[-1] > WORK_LIMIT * ledger.supplied:
        raise on_all_ranks(
            SolveError(
                f"transient: by t = {time[-1]:.6g} s the contact forces have done work of {contact[-1]:.3g} "
                f"J beside {ledger.supplied:.3g} J supplied: "
                "the history is wrong; use a smaller step, or fewer modes if hardly any flexibility is left "
                "to the contact"
            )
        )
