"""Integration of a reduced model with contact (`contact.marching`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..contact.complementarity import Complementarity
from ..contact.friction import Memory
from ..contact.instant import solve_contact
from ..contact.marching import march
from ..contact.step_data import Marched, StepConstants, StepHistory, StepLoads, StepState
from ..errors import wrong_input
from ..reduction.reduced_model import ReducedModel
from ..signals.rate import rate_of
from ..signals.signal import Signal
from .drive import Drive, Piece
from .energy import Energy, Ledger, guard
from .history import History
from .integration import Steps, Told
from .rest import Rest
from .states import ModalStates, Rows
from .steps import DEEPEST, HALVING, constants_of, step_coefficients

CHUNK = 4096


class ReducedIntegrator:
    """A reduced model on its way; an `integration.Integrator`.

    Steps in which contact does work are taken in halves, quarters .. (`steps.HALVING`); what is kept are the
    ends of the equal steps. Whether a step is halved depends on the state before it alone, so that a history
    that goes on from a checkpoint is the same.

    Parameters
    ----------
    reduced : ReducedModel
    signals : sequence of Signal
        One for each unit load.
    steps : Steps
        Their scheme is "exact" or "newmark".
    initial : "rest", "equilibrium", (q, v) or (q, v, slips)
        Zero; static equilibrium, contact included, under the loads at t = 0; or modal coordinates and rates,
        and what faces that rub had slipped (m) just before. Default: they have never been loaded.

    Attributes
    ----------
    exchanges : int
        Of active sets so far.
    unresolved : int
        Parts of steps so far that could not be halved again though contact does work.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        signals: Sequence[Signal],
        steps: Steps,
        initial: str | Sequence[np.ndarray],
    ):
        r = self.reduced = reduced
        self.comm, self.chunk, self.steps = r.comm, CHUNK, steps
        # rates and accelerations of prescribed displacements stand behind the loads
        rates = [rate_of(signals[k], steps.step) for k in r.edges]
        accelerations = [rate_of(rate, steps.step) for rate in rates]
        self.drive = Drive(r.comm, [*signals, *rates, *accelerations], steps.step)
        self.loads = r.load_modes.shape[1]
        self.load_modes = np.concatenate([r.load_modes, r.rate_modes, np.zeros(r.rate_modes.shape)], axis=1)
        self.acting = r if steps.contact else r.open
        self.size, self.rows = len(r.initial_gap), len(self.acting.initial_gap)
        # of steps and their halves, one where no row can change sides
        self.levels = 1 if self.acting.contact_laws.fixed.all() else DEEPEST + 1
        self.constants = self._constants(steps.step, self.levels)
        self.amplitude = self.drive(np.zeros(1))[0]
        self.state = _start(r, self.amplitude[: self.loads], steps.contact, initial)
        self.ledger = Ledger(r, smooth=steps.scheme != "newmark")
        self.exchanges = self.unresolved = 0
        # written anew in each chunk, for fresh memory takes longer than what is computed in it: states,
        # velocities and contact forces; modal forces and free gaps, which begin a step earlier
        modes, most = len(r.omega), min(CHUNK, steps.count) + 1
        self._room = [np.empty((most, size)) for size in (modes, modes, self.rows, modes, self.rows)]
        self._work, self._lost = np.empty(most), np.empty(most if len(self.state.slip) else 0)
        self.begun = initial if isinstance(initial, str) else "modal"

    def told(self) -> Told:
        """See `integration.Integrator`."""
        norms = (np.linalg.norm(self.reduced.omega * self.state.q), np.linalg.norm(self.state.v))
        told = {"initial": self.begun, "initial_norms": np.array(norms if self.begun == "modal" else ())}
        return Told({**vars(self.steps), **told, "chunk": self.chunk})

    def _driven(self, amplitudes: np.ndarray) -> StepLoads:
        """Of load amplitudes (n + 1, loads); by `dot`, for `@` of one column is slow."""
        r = self.acting
        external, gaps = (room[: len(amplitudes)] for room in self._room[3:])
        levels = np.zeros(len(amplitudes) - 1, dtype=np.int8)
        if not amplitudes.any():
            gaps[:] = r.initial_gap
            return StepLoads(external[:0], gaps, levels)
        np.dot(amplitudes[:, : self.loads], r.gap.loads.T, out=gaps)
        gaps += r.initial_gap
        return StepLoads(np.dot(amplitudes, self.load_modes.T, out=external), gaps, levels)

    def _padded(self, forces: np.ndarray) -> np.ndarray:
        """(n, c): zero forces where contact is switched off."""
        return forces if self.rows == self.size else np.zeros((len(forces), self.size))

    def first(self) -> History:
        """See `integration.Integrator`."""
        r, amplitude, (q, v, force, _, _) = self.reduced, self.amplitude[None], self.state
        force = self._padded(force[None].copy())
        energies = self.ledger.start(q, v, self.amplitude, force[0])
        loads, rates = self._parted(amplitude)
        states = ModalStates(q[None].copy(), v[None].copy(), loads, force, r, rates)
        return History(np.zeros(1), states, Energy(*energies), self.steps.step, 0, len(r.omega))

    def _parted(self, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """(n, loads) amplitudes, and rates and accelerations of prescribed displacements if there are any."""
        loads, rates = np.split(amplitude, [self.loads], axis=1)
        return loads, rates if len(self.reduced.edges) else None

    def advance(self, done: int, steps: int, decimation: int) -> Rows:
        """Take some steps; the rows of those that are kept, until the next ones are taken.

        Raises
        ------
        SolveError
            If a contact problem is not solved, or the energy runs away.
        """
        time = (done + np.arange(steps + 1)) * self.steps.step
        amplitude, pieces = self.drive.pieces(done, steps)
        self.amplitude = amplitude[0]
        states, velocities, forces = (room[:steps] for room in self._room[:3])
        energies = np.empty((2 + len(self.ledger.work), steps))
        for piece in pieces:
            rows = slice(piece.first, piece.first + piece.steps)
            self._jump(piece.amplitudes[0])
            work, lost = self._work[: piece.steps], self._lost[: piece.steps]
            history = StepHistory(states[rows], velocities[rows], forces[rows], work, lost=lost)
            marched = self._march(piece, history)
            if marched.steps < piece.steps:
                failed = time[piece.first + marched.steps + 1]
                what = f"transient: the contact problem at t = {failed:.6g} s"
                raise self.acting.closed_sets.unsolved(what)
            self.exchanges += marched.exchanges
            self.unresolved += marched.unresolved
            energies[:, rows] = self.ledger.account(
                history._replace(forces=self._padded(forces[rows])), piece.amplitudes, piece.length
            )
            self.amplitude = piece.amplitudes[-1]
            if piece.complete and (energy := self._jump(amplitude[rows.stop])) is not None:
                forces[rows.stop - 1], energies[:, rows.stop - 1] = self.state.force, energy
        forces = self._padded(forces)
        guard(energies, self.ledger, time)
        kept = slice(-(done + 1) % decimation, None, decimation)
        loads, rates = self._parted(amplitude[1:])
        found = ModalStates(states, velocities, loads, forces, self.reduced, rates)
        every = {"time": time[1:], **found.instants(), "energies": energies.T}
        return {name: values[kept] for name, values in every.items()}

    def _march(self, piece: Piece, history: StepHistory) -> Marched:
        """Take the steps of a piece; a part of a step, of its own length, is tried whole first."""
        loads = self._driven(piece.amplitudes)
        if piece.length == self.steps.step:
            return march(self.constants, loads, self.state, history)
        before = [part.copy() for part in self.state]
        marched = march(self._constants(piece.length, 1), loads, self.state, history)
        if marched.unresolved:
            for part, former in zip(self.state, before):
                part[:] = former
            marched = march(self._constants(piece.length, self.levels), loads, self.state, history)
        return marched

    def _constants(self, length: float, count: int) -> StepConstants:
        """Of steps of a length (s), of their halves ..: so many."""
        r, scheme, parts = self.acting, self.steps.scheme, length / 2.0 ** np.arange(count)
        return constants_of(r, [step_coefficients(r.omega, r.damping, h, scheme) for h in parts], HALVING)

    def _jump(self, amplitude: np.ndarray) -> np.ndarray | None:
        """Let loads jump, and with them contact and the residual flexibility; the energies then, or None if
        they do not.
        """
        if (amplitude == self.amplitude).all():
            return None
        q, v, force, rows, slip = self.state
        self.amplitude, before, lost = amplitude, force.copy(), 0.0
        if self.rows:
            friction, gaps = self.reduced.friction, self.reduced.gaps
            states = rows[:gaps], rows[gaps:]
            former = Memory(slip, before[gaps:], before[:gaps], *states, np.zeros(gaps), slip)
            found = _contact_at(self.reduced, q, amplitude[: self.loads], former)
            if friction is not None:
                lost = Memory.of(found, gaps).lost_since(former, friction)
            force[:], rows[:], slip[:] = found.force, found.state, found.gap[gaps:]
        return self.ledger.jump(q, v, amplitude, *self._padded(np.array([before, force])), lost=lost)

    def _kept(self) -> list[np.ndarray]:
        """What further steps depend on, but for three numbers: state, states of the rows, slips, account."""
        return [self.ledger.work, *self.state, *self.ledger.last]

    def checkpoint(self) -> list[Any]:
        """See `integration.Integrator`."""
        return [self.exchanges, self.unresolved, self.ledger.supplied, *self._kept()]

    def restore(self, checkpoint: Sequence[Any]) -> None:
        """Go on from a checkpoint, behind `first`."""
        self.exchanges, self.unresolved, self.ledger.supplied, *parts = checkpoint
        for part, values in zip(self._kept(), parts):
            part[...] = values


def row_size(reduced: ReducedModel) -> int:
    """Bytes of an instant."""
    modes, loads = reduced.load_modes.shape
    energies = 5 if reduced.friction is None else 6
    return 8 * (1 + 2 * modes + loads + 2 * len(reduced.edges) + len(reduced.initial_gap) + energies)


def _start(
    r: ReducedModel, amplitude: np.ndarray, contact: bool, initial: str | Sequence[np.ndarray]
) -> StepState:
    """The state at t = 0; faces that rub have never been loaded."""
    q, v = np.zeros(len(r.omega)), np.zeros(len(r.omega))
    found = None
    if not isinstance(initial, str):
        q, v = (np.array(part, dtype=float) for part in initial[:2])
        if q.shape != r.omega.shape or v.shape != r.omega.shape or not np.isfinite([q, v]).all():
            raise wrong_input(
                f"transient: initial must be two finite arrays of {len(r.omega)} modal values, not of "
                f"shapes {q.shape} and {v.shape}"
            )
    elif initial == "equilibrium":
        q, found = Rest(r, contact)(amplitude)
    if not contact:
        return StepState(q, v, np.zeros(0), np.zeros(0, dtype=np.int8))
    if found is None:
        former = None
        if r.friction is not None and not isinstance(initial, str) and len(initial) == 3:
            former = Memory.none(r.contact_laws, r.friction)._replace(slip=initial[2])
        found = _contact_at(r, q, amplitude, former)
    return StepState(q, v, found.force.copy(), found.state.copy(), found.gap[r.gaps :].copy())


def _contact_at(
    r: ReducedModel, q: np.ndarray, amplitude: np.ndarray, former: Memory | None = None
) -> Complementarity:
    """Contact of a state to which no step leads."""
    gap = r.gap.loads @ amplitude + r.gap.modes @ q + r.initial_gap
    return solve_contact(r.gap.contact, gap, r.contact_laws, r.friction, former)
