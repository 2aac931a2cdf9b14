"""Energies of a history, their account for a reduced model, and the guard that refuses a history in which
contact does work.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import failed_solve
from ..record.record import Record, described, quantity
from ..reduction.reduced_model import ReducedModel

if TYPE_CHECKING:  # its kernels take a third of a second and 60 MB, and reading a history does not need them
    from ..contact.step_data import StepHistory

# Work of the contact forces, relative to the energy supplied, beyond which a history is refused.
WORK_LIMIT = 0.01
# Share of the energy that a displacement would have without the supports', that rounding is at most.
ROUND_OFF = 1e-12
# Which loads and which rows of contact.
Acting = tuple[np.ndarray, np.ndarray]


@described
class Energy(Record):
    """Energies and work since the start. Contact works, beside what friction takes, in the steps alone in
    which pairs change sides, where it is the integrator's error, summed over the parts of halved steps.
    """

    kinetic: np.ndarray = quantity("J", "kinetic energy, that of a reduced model's modes", "time")
    strain: np.ndarray = quantity(
        "J", "strain energy, a reduced model's residual flexibility included", "time"
    )
    external: np.ndarray = quantity("J", "work of the loads", "time")
    damping: np.ndarray = quantity("J", "energy dissipated by damping", "time")
    contact: np.ndarray = quantity("J", "work of the contact forces, beside what is lost to friction", "time")
    friction: np.ndarray | None = quantity(
        "J", "energy lost to friction, where faces rub", "time", kinds="f", default=None
    )

    def instants(self) -> np.ndarray:
        """(n, 5) or (n, 6): all of them."""
        return np.stack([part for part in vars(self).values() if part is not None], axis=1)

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
    """Energies and work, carried from chunk to chunk; that of contact is what the steps themselves tell.

    Where supports are moved, what they bear works on their displacements: amplitudes are those of the unit
    loads, then rates and accelerations of the prescribed displacements.
    """

    def __init__(self, reduction: ReducedModel, smooth: bool):
        # average acceleration moves by the mean of the ends' forces, so the plain trapezoidal rule is its own
        # work
        self.r, self.smooth = reduction, smooth
        self.loads, self.edges, supports = reduction.load_modes.shape[1], reduction.edges, reduction.supports
        # external, damping, contact, and friction
        self.work = np.zeros(3 if reduction.friction is None else 4)
        self.stiffness, self.friction = reduction.omega**2, 2.0 * reduction.damping * reduction.omega
        self.ones, self._squares = np.ones(len(reduction.omega)), np.empty((0, len(reduction.omega)))
        self.flexibility = reduction.flexibility
        if supports is not None and len(self.edges):
            self.inertia = supports.of_edges("inertia")
            self.mass, self.damping = (supports.of_edges(name)[:, self.edges] for name in ("mass", "damping"))
            self.static = np.concatenate([supports.of_edges("loads"), supports.of_edges("contact")], axis=1)
            self.stiff = self.static[:, self.edges]

    def start(self, q: np.ndarray, v: np.ndarray, amplitude: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(5, 1) energies and work at t = 0; (6, 1) where faces rub, and so of the others."""
        self.work[:] = 0.0
        self.last = self._instants(q[None], v[None], amplitude[None], force[None])
        self.supplied = float(self.last[2].sum())
        if len(self.edges):  # what rides along without strain has rounding of its displacement
            self.supplied += ROUND_OFF * float(q**2 @ self.stiffness)
        return np.concatenate([self.last[2].T, self.work[:, None]])

    def account(self, history: StepHistory, amplitudes: np.ndarray, step: float) -> np.ndarray:
        """(5, n): kinetic, strain, external, damping, contact after each step of a length (s); `amplitudes`
        (n + 1, loads) begins with the step before.
        """
        states, velocities, forces, contact, _, lost, *_ = history
        acting, last = None, self.last
        loaded: np.ndarray | slice = slice(None)
        if not len(self.edges):  # mostly few act meanwhile
            acting = loaded, _ = (amplitudes != 0.0).any(axis=0), (forces != 0.0).any(axis=0)
        drive, moved, stored, loss, rate = self._instants(states, velocities, amplitudes[1:], forces, acting)
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
        pushed, further = [self.last[0][0], amplitude], 0.0
        if len(self.edges):
            former, after = self.last[4][0, self.edges], np.split(amplitude[self.loads :], 2)[0]
            further = 0.5 * float((after + former) @ self.mass @ (after - former))
            pushed = [self._pushing(part) for part in pushed]
        drives = np.concatenate([pushed, [before, force]], axis=1)
        work = drives.mean(axis=0) * (self.flexibility @ (drives[1] - drives[0]))
        done = np.array([work[: self.loads].sum() + further, 0.0, work[self.loads :].sum() + lost, lost])
        self.work = self.work + done[: len(self.work)]
        self.last = self._instants(q[None], v[None], amplitude[None], force[None])
        return np.concatenate([self.last[2][0], self.work])

    def _pushing(self, amplitudes: np.ndarray) -> np.ndarray:
        """(..., loads): forces alone."""
        result = amplitudes[..., : self.loads].copy()
        result[..., self.edges] = 0.0
        return result

    def _instants(
        self,
        q: np.ndarray,
        v: np.ndarray,
        amplitudes: np.ndarray,
        forces: np.ndarray,
        acting: Acting | None = None,
    ) -> tuple[np.ndarray, ...]:
        """Loads, the displacements they work on, stored energies (n, 2), dissipated power (n,), velocities at
        the loads; of all loads and rows of contact, or of some of them that alone act.
        """
        if not len(self.edges):
            return self._held(q, v, amplitudes, forces, acting)
        r, edges, loads = self.r, self.edges, amplitudes[:, : self.loads]
        w = amplitudes[:, edges]
        rate, acceleration = np.split(amplitudes[:, self.loads :], 2, axis=1)
        drives, moved, stored, lost, rates = self._held(
            q - w @ self.inertia, v - rate @ self.inertia, self._pushing(amplitudes), forces
        )
        follows = -self.static[:, : self.loads]  # by reciprocity, what is held where loads act included
        moved += w @ follows
        rates += rate @ follows
        stored[:, 0] = 0.5 * ((v**2).sum(axis=1) + np.einsum("ni,ij,nj->n", rate, self.mass, rate))
        lost += np.einsum("ni,ij,nj->n", rate, self.damping, rate)
        stored[:, 1] += 0.5 * np.einsum("ni,ij,nj->n", w, self.stiff, w)
        pushed = loads @ r.load_modes.T + rate @ r.rate_modes.T + forces @ r.gap.modes
        inertia = pushed - self.friction * v - self.stiffness * q
        drives[:, edges] = (
            np.concatenate([loads, forces], axis=1) @ self.static.T
            + inertia @ self.inertia.T
            + rate @ self.damping.T
            + acceleration @ self.mass.T
        )
        moved[:, edges], rates[:, edges] = w, rate
        return drives, moved, stored, lost, rates

    def _held(
        self,
        q: np.ndarray,
        v: np.ndarray,
        amplitudes: np.ndarray,
        forces: np.ndarray,
        acting: Acting | None = None,
    ) -> tuple[np.ndarray, ...]:
        """The same under forces alone, of motions against supports that are held."""
        modes, flexibility = self.r.load_modes.T, self.flexibility
        if acting is not None:
            places = np.flatnonzero(np.concatenate(acting))
            modes, flexibility = modes[acting[0]], flexibility[places][:, places]
            amplitudes, forces = (
                np.compress(chosen, part, axis=1) for chosen, part in zip(acting, (amplitudes, forces))
            )
        loads = amplitudes.shape[1]
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
    """Stop where contact has fed or taken energy beside what is lost to friction: what it does in steps that
    switch is the integration's error.
    """
    external, contact = np.abs(chunk[2]), np.abs(chunk[4])
    ledger.supplied = max(ledger.supplied, float(external.max()))
    if not np.isfinite(chunk[:2]).all() or contact[-1] > WORK_LIMIT * ledger.supplied:
        raise failed_solve(
            f"transient: by t = {time[-1]:.6g} s the contact forces have done work of {chunk[4, -1]:.3g} "
            f"J beside {ledger.supplied:.3g} J supplied: "
            "the history is wrong; use a smaller step, or fewer modes if hardly any flexibility is left "
            "to the contact"
        )
