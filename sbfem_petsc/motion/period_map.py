"""One period of a reduced model as a map, with its exact derivative along the state.

The unknowns are the state x = (Omega q, q') at t = 0, whose norm is that of energy. The linear steady state
is subtracted in closed form: what is integrated is the difference z, driven by contact alone, so that a
motion without contact is exact whatever the step. Where faces rub, the slips at the instant before t = 0, in
units of energy, stand behind: what the faces remember (`contact.step_tangent`).
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from ..contact.friction import STICKS
from ..contact.located_switches import located_contacts
from ..contact.marching import Address, Room, begun, march
from ..contact.step_data import StepConstants, StepHistory, StepLoads, StepState
from ..contact.step_tangent import LEAST, ROUGH, step_contacts
from ..contact.tangent import Derivative
from ..errors import called
from ..petsc import MPI
from ..ranks.capacity import available_memory
from ..record.record import quantity
from ..reduction.reduced_model import OfReduced, ReducedModel
from .excitation import LINES, Excitation, modal_forces
from .period_motion import PeriodMotion
from .rest import Rest
from .steps import StepLength, free_resolvent

Key = TypeVar("Key")
Value = TypeVar("Value")
# Bytes that a map takes an instant and line of its loads.
WAVES = 64
# How often a period is integrated again, for the states that rows begin in.
_AGAIN = 4
# Rows up to which switches of those that rub are located wherever those of others are: of more it costs
# several times what the steps do, and is done for loci alone.
FEW = 16


@dataclass(eq=False, repr=False)
class Period(OfReduced):
    """The period of a driven reduced model, in equal steps.

    Attributes
    ----------
    reduced : ReducedModel
    excitation : Excitation
    steps : int
        Steps in the common period of the loads.
    contact : bool
    """

    reduced: ReducedModel = quantity(text="the reduced model", part="ReducedModel")
    excitation: Excitation = quantity(text="the loads", part="Excitation")
    steps: int = quantity("1", "time steps in the common period of the loads", least=1)
    contact: bool = quantity("1", "whether it is computed with contact", default=True)

    def __post_init__(self) -> None:
        r = self._acting = self.reduced if self.contact else self.reduced.open
        self.pairs, self.modes = len(r.initial_gap), len(r.omega)
        self.contact = self.pairs > 0
        self.laws, self.friction = r.contact_laws, r.friction
        self.slip_units = r.slip_units if self.friction is not None else np.zeros(0)
        (self.left, self.right), self.sets = r.thin_gaps, r.closed_sets
        self.residual_flexibility = self.sets.residual
        # a rigid-body motion has no frequency of its own to be weighed with, nor has one that only stops hold
        self.weights = np.where(r.omega > 0.0, r.omega, 2.0 * np.pi * r.frequencies.max() or 1.0)
        self._load()
        self._lengths: dict[float, StepLength] = {}
        self._kept: tuple[Room, Address] | None = None

    @classmethod
    def _revived(cls, found: dict[str, Any]) -> Period:
        """From a file, if it would fit into memory."""
        require_waves(found["steps"], len(found["excitation"].orders))
        return cls(**found)

    def __getstate__(self) -> dict[str, Any]:
        """Of what is kept no other process knows the places."""
        return {**self.__dict__, "_kept": None}

    def _fingerprint(self) -> object:
        """What tells it from others, the same on all ranks."""
        return self.reduced, self.excitation, self.steps, self.pairs

    @property
    def told_steps(self) -> int:
        """Steps a forcing period."""
        return self.steps // self.excitation.periods

    @property
    def unknowns(self) -> int:
        """Of a state."""
        return 2 * self.modes + len(self.slip_units)

    @property
    def jumps(self) -> bool:
        """Whether friction falls where a slip begins."""
        return self.friction is not None and self.friction.falls

    @property
    def comm(self) -> MPI.Comm:
        """Ranks that have the model."""
        return self.reduced.comm

    def in_steps(self, steps: int) -> Period:
        """The same period in so many steps."""
        result = copy.copy(self)
        result.steps, result._lengths = steps, {}
        result._load()
        return result

    def repeated(self, times: int) -> Period:
        """The map over several of its periods; itself for one."""
        if times == 1:
            return self
        return Period(self.reduced, self.excitation.repeated(times), times * self.steps, self.pairs > 0)

    def _load(self) -> None:
        self._waves = None
        if len(self.excitation.orders) <= LINES:
            phases = self.excitation.phases(self.steps)
            self._waves = np.concatenate([phases.real, -phases.imag], axis=1)
        self._prepared: dict[tuple[float, float], DrivenPeriod] = {}
        self._scaled: dict[tuple[float, float], Period] = {}
        self._rest: np.ndarray | None = None
        self._loaded: dict[float, tuple[Excitation, np.ndarray, np.ndarray]] = {}

    def over_time(self, amplitudes: np.ndarray) -> np.ndarray:
        """(n + 1, ...) real values of complex amplitudes (k, ...)."""
        if self._waves is None:
            return self.excitation.over_time(amplitudes, self.steps)
        return self._waves @ np.concatenate([amplitudes.real, amplitudes.imag])

    def loaded(self, factor: float) -> tuple[Excitation, np.ndarray, np.ndarray]:
        """Loads with a factor on those that oscillate, their amplitudes over time, and the gaps under them of
        which the modes know nothing.
        """

        def made() -> tuple[Excitation, np.ndarray, np.ndarray]:
            r, scaled = self._acting, self.excitation.scaled(factor)
            loads = self.over_time(scaled.smooth) + scaled.further_values(self.steps)
            return scaled, loads, loads @ r.gap.loads.T + r.initial_gap

        return _recent(self._loaded, factor, made)

    @property
    def rest(self) -> np.ndarray:
        """State at rest under the constant loads, contact included: what motions are about, and may be far
        larger than they are. Faces that rub are loaded in one step.
        """
        if self._rest is None:
            constant = self.excitation.amplitudes[self.excitation.orders == 0].real.sum(axis=0)
            q, found = Rest(self.reduced, self.pairs > 0)(constant)
            slip = found.gap[len(found.gap) - len(self.slip_units) :] / self.slip_units
            self._rest = np.concatenate([self.weights * q, np.zeros(self.modes), slip])
        return self._rest

    def begun(self, state: np.ndarray) -> np.ndarray:
        """A state of a motion with or without friction as one of this period: faces that have not rubbed are
        as at rest.
        """
        moving = 2 * self.modes
        slips = self.rest if len(state) == moving < self.unknowns else state
        return np.concatenate([state[:moving], slips[moving : self.unknowns]])

    def size(self, state: np.ndarray) -> float:
        """How far a state is from rest: what changes of it are compared with."""
        return float(np.linalg.norm(state - self.rest))

    def length(self, step: float) -> StepLength:
        """What the length of a step (s) alone determines."""
        given = self._acting, self.reduced.damping, step, self.steps
        return _recent(self._lengths, step, lambda: StepLength(*given))

    def kept(self, constants: StepConstants) -> tuple[Room, Address]:
        """For `march`: room that its steps of any length need beside them."""
        if self._kept is None:
            self._kept = begun(constants)
        return self._kept

    def with_damping(self, ratios: np.ndarray) -> Period:
        """The same period of the model with other damping ratios, under loads that do not depend on them."""
        result = copy.copy(self)
        result.reduced = replace(self.reduced, damping=ratios)
        result._lengths, result._prepared, result._scaled, result._rest = {}, {}, {}, None
        return result

    def scaled(self, *, damping: float = 1.0, gap: float = 1.0) -> Period:
        """The same period of the model with factors on its damping ratios and initial gaps."""
        if damping == gap == 1.0:
            return self

        def made() -> Period:
            r = self.reduced
            changed = replace(r, damping=damping * r.damping, initial_gap=gap * r.initial_gap)
            return Period(changed, self.excitation, self.steps, self.pairs > 0)

        return _recent(self._scaled, (damping, gap), made, 0)

    def at(
        self, frequency: float, load: float = 1.0, *, damping: float = 1.0, gap: float = 1.0
    ) -> DrivenPeriod:
        """The period at a forcing frequency (Hz) and factors on the oscillating loads, the damping and the
        initial gaps.
        """
        if not damping == gap == 1.0:
            return self.scaled(damping=damping, gap=gap).at(frequency, load)
        return _recent(self._prepared, (frequency, load), lambda: DrivenPeriod(self, frequency, load))


def require_waves(steps: int, lines: int) -> None:
    """Raise ValueError if a map of so many steps, from a file, would not fit into memory."""
    if WAVES * steps * min(lines, LINES) > available_memory():
        raise ValueError(f"{steps} steps a period need more memory than is free")


def _rubbing(steps: int, pairs: int, slips: int) -> dict[str, np.ndarray]:
    """Room for what a `StepHistory` tells of rows that rub."""
    return {
        "lost": np.empty(steps),
        "rows": np.empty((steps + 1, pairs), dtype=np.int8),
        "kept": np.empty(slips),
        "landings": np.zeros((steps, slips, 3)),
        "told": np.zeros((steps, pairs), dtype=np.int8),
    }


def _recent(known: dict[Key, Value], key: Key, make: Callable[[], Value], others: int = 4) -> Value:
    """What a key stands for, made where it is not known beside a few others."""
    if key not in known:
        if len(known) > others:
            known.clear()
        known[key] = make()
    return known[key]


class DrivenPeriod:
    """A `Period` at one frequency and load: all that its steps need."""

    def __init__(self, period: Period, frequency: float, factor: float):
        self.period, self.frequency, self.factor = period, frequency, factor
        p, r = period, period.reduced
        self.duration = p.excitation.periods / frequency
        self.step = self.duration / p.steps
        length = p.length(self.step)
        self.length, self.coefficients, self.constants = length, length.coefficients, length.constants
        self.excitation, self.loads, static = p.loaded(factor)
        self.amplitudes = self.excitation.response(r, frequency)
        self.speeds = 2j * np.pi * p.excitation.orders[:, None] / self.duration
        self.free_gap = p.over_time((self.amplitudes @ p.right) @ p.left.T) + static
        self._kept: tuple | None = None
        # faces that rub are as at rest
        kept = p.rest[2 * p.modes :] if p.friction is not None else np.zeros(0)
        self.linear_state = self._state(
            self.amplitudes.sum(axis=0).real, (self.speeds * self.amplitudes).sum(axis=0).real, kept
        )

    @property
    def oscillation(self) -> float:
        """Size of the linear steady state without its constant part."""
        moving = self.period.excitation.orders > 0
        q, v = self.amplitudes[moving], (self.speeds * self.amplitudes)[moving]
        return float(np.linalg.norm(self._state(q.sum(axis=0).real, v.sum(axis=0).real)))

    def _state(self, q: np.ndarray, v: np.ndarray, slip: np.ndarray | None = None) -> np.ndarray:
        return np.concatenate([self.period.weights * q, v, np.zeros(0) if slip is None else slip])

    def in_steps(self, steps: int) -> DrivenPeriod:
        """The same in so many steps."""
        return self.period.in_steps(steps).at(self.frequency, self.factor)

    def part(self, short: Period, begin: int) -> DrivenPeriod:
        """The map over the steps of `short` from the instant `begin` on, of states that are differences to
        the linear steady state.
        """
        result = copy.copy(self)
        result.period, result._kept = short, None
        result.free_gap = self.free_gap[begin : begin + short.steps + 1]
        result.linear_state = np.zeros_like(self.linear_state)
        return result

    def run(self, state: np.ndarray) -> PeriodMotion:
        """Integrate one period from a state x. Rows that slip under less than what would hold them slip on
        through t = 0 if they do so at its end: to tell, the period is integrated again.
        """
        motion = self._run(state, np.zeros(self.period.pairs, dtype=np.int8))
        for _ in range(_AGAIN if self.period.jumps else 0):
            before, motion = motion, self._run(state, motion.rows[-2])
            if np.array_equal(before.rows, motion.rows):
                break
        return motion

    def _run(self, state: np.ndarray, former: np.ndarray) -> PeriodMotion:
        """The same where the rows were in `former` states at the instant before."""
        p, m, steps = self.period, self.period.modes, self.period.steps
        difference = state[: 2 * m] - self.linear_state[: 2 * m]
        q, v, slip = difference[:m] / p.weights, difference[m:].copy(), p.slip_units * state[2 * m :]
        begin = StepState(q, v, np.empty(p.pairs), former.copy(), slip.copy())
        told = np.empty((steps + 1, m)), np.empty((steps + 1, m)), np.empty((steps + 1, p.pairs))
        history = StepHistory(*told, np.empty(steps))
        if len(slip):
            history = history._replace(**_rubbing(steps, p.pairs, len(slip)))
        loads = StepLoads(np.empty((0, m)), self.free_gap, np.zeros(steps, dtype=np.int8))
        reached = march(self.constants, loads, begin, history, p.kept(self.constants)).steps
        if reached < steps:
            raise p.sets.unsolved(
                f"{called()}: the contact problem of step {reached} of {steps} at {self.frequency:g} Hz"
            )
        residual = self._state(q, v, (history.kept - slip) / p.slip_units)
        residual[: 2 * m] -= difference
        states, velocities, forces, work, _, lost, rows, _, *landings = history
        return PeriodMotion(residual, states, velocities, forces, work, rows, lost, *landings)

    def oscillations(self) -> tuple[np.ndarray, np.ndarray]:
        """Modal forces of the oscillating loads and velocities of the linear steady state over time,
        (n + 1, m) each.
        """
        p = self.period
        moving = (p.excitation.orders > 0)[:, None]
        forces = modal_forces(p.reduced, moving * self.amplitudes, self.speeds)
        return p.over_time(forces), p.over_time(self.speeds * self.amplitudes)

    def carried(
        self,
        motion: PeriodMotion,
        columns: np.ndarray,
        located: bool = False,
        rubbing: bool = False,
        rough: bool = False,
    ) -> np.ndarray:
        """Derivative of x(T) along columns of x(0), (2 m + k, c).

        Exact for the steps as they are, but that slips which stay what they are over the whole period count
        as if they came to nothing: any others are as periodic. `located` moves closing and opening pairs to
        where they do so inside a step (see `located_switches`); where rows rub it does so with `rubbing`
        alone, of periodic motions, also for what slips and sticks. `rough` leaves out what hardly counts
        where faces rub, which is half of the work: enough for Newton's method.
        """
        p, m = self.period, self.period.modes
        located &= rubbing or p.friction is None
        derivative = self._derivative(motion, located, rough, keep=columns.shape[1] < m)
        columns = columns.copy()
        columns[:m] /= p.weights[:, None]
        # slips that do not stick at t = 0 are forgotten there
        kept = columns[: 2 * m].any(axis=0)
        sticks = motion.rows[:, len(p.laws) :] == STICKS
        kept |= located | columns[2 * m :][sticks[:1].ravel()].any(axis=0)
        result = np.zeros_like(columns)
        if kept.any():
            result[:, kept] = derivative(columns[:, kept])
        result[:m] *= p.weights[:, None]
        result[2 * m :][sticks.all(axis=0)] = 0.0
        return result

    def _derivative(self, motion: PeriodMotion, located: bool, rough: bool, keep: bool) -> Derivative:
        """The linearised motion, which may be kept, for many products with it."""
        p, key = self.period, (located, rough, motion)
        if self._kept is not None and self._kept[0] == key:
            return self._kept[1]

        def gaps(instants: np.ndarray, rows: np.ndarray) -> np.ndarray:
            elastic = np.einsum("kr,kr->k", motion.states[instants] @ p.right, p.left[rows])
            residual = np.einsum("kc,kc->k", motion.forces[instants], p.residual_flexibility[rows])
            return self.free_gap[instants, rows] + elastic + residual

        states, landings, told = self._held(motion)
        if not located:
            left_out = ROUGH if rough and p.friction is not None else LEAST
            contacts = step_contacts(self.constants, (states, landings, told), p.slip_units, left_out)
        else:
            history = states, motion.forces, landings
            contacts = located_contacts(self.constants, history, gaps, p.slip_units, p.sets)
        result = Derivative(p.length(self.step).propagation, contacts, p.steps)
        if keep:
            self._kept = key, result
        return result

    def _held(self, motion: PeriodMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States of the rows, where they land, and from which states that is told."""
        if self.period.friction is not None:
            return motion.rows, motion.landings, motion.told
        states = self.period.laws.acting(motion.forces).astype(np.int8)
        return states, np.zeros((len(states) - 1, 0, 3)), states[1:]

    def monodromy(self, motion: PeriodMotion, rubbing: bool = False) -> np.ndarray:
        """dx(T) / dx(0) of a periodic motion, with switches located inside their steps, see `carried`;
        those of more than a few rows that rub only if asked for.
        """
        rubbing |= self.period.pairs <= FEW
        return self.carried(motion, np.eye(self.period.unknowns), located=True, rubbing=rubbing)

    def linear_resolvent(self, vectors: np.ndarray) -> np.ndarray:
        """(Phi - 1)^-1 of motions without contact, and of slips that are forgotten, on vectors like states:
        the preconditioner of matrix-free shooting. Rigid-body motions, which have none, are held and damped.
        """
        r, weights = self.period.reduced, self.period.weights
        held = np.where(r.omega > 0.0, (r.omega, r.damping), (weights, np.full(len(weights), 0.5)))
        return free_resolvent((held[0], held[1]), self.duration, weights, vectors)


@dataclass(eq=False)
class FixedPoint:
    """A fixed point of a period.

    Attributes
    ----------
    state : (2 m + k,) array
        x(0).
    driven : DrivenPeriod
    motion : PeriodMotion
    residuals : tuple of float
        Norm of x(T) - x(0) at each Newton iterate.
    """

    state: np.ndarray
    driven: DrivenPeriod
    motion: PeriodMotion
    residuals: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        # x(T) - x(0), and the pairs that touch at any time: they are known when the motion is forgotten
        self.residual, self.touching = self.motion.residual, (self.motion.forces != 0.0).any(axis=0)

    @functools.cached_property
    def monodromy(self) -> np.ndarray:
        """dx(T) / dx(0), see `DrivenPeriod.monodromy`."""
        return self.driven.monodromy(self.motion)
