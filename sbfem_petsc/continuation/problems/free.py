"""Free periodic motions of a reduced model over their energy.

Unknowns are the state x(0) = (Omega q, q'), the logarithm of the frequency f and a self-excitation xi: every
mode is driven by xi times its own velocity (Krack's extended periodic motion). A free motion of a system
without damping has xi = 0 to the precision of the steps; with damping xi is what keeps the motion going.
Equations are x(T) = x(0) and a vanishing velocity of the followed mode at t = 0 (the phase); the energy,
which is no unknown, is what the range is over. They are regular although a conservative system conserves it.
"""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg

from ...contact.complementarity import solve_complementarity
from ...motion.excitation import Excitation
from ...motion.period_map import DrivenPeriod, FixedPoint, Period
from ...reduction.reduced_model import ReducedModel
from ..linear import Dense, DenseBorder
from ..newton import attempt, correct
from ..problem import Linear, Lost, Metric, Point, Problem
from .driven_orbits import OrbitState

# Difference of xi, relative to the frequency in rad/s, by which a motion's rate with it is found: the map is
# piecewise linear in the state and smooth in xi. The same of the frequency's logarithm.
DIFFERENCE, FASTER = 1e-5, 1e-7
# Arc length: change of the state relative to its size and SPAN times the relative change of the frequency.
SPAN = 10.0
# Logarithm of the frequency beyond which it has no meaning.
FURTHEST = 50.0
# Multipliers this far from the unit circle are not on it. Without damping all have modulus one; what the
# steps and their eigenvalues add to it.
OFF, UNCERTAIN = 1e-2, 1e-5
# Velocity relative to the state that is none.
AT_REST = 1e-7
# Times that added damping is halved before it is left out.
HALVINGS = 7
# A step below which the branch is taken to meet an interaction with a higher mode; the damping ratio with
# which it is passed, and energies at which a motion beyond it is looked for, in units of that before it. Its
# branch goes mostly along the state itself, by this cosine.
NARROW, ADDED, LEAPS, MOSTLY = 0.004, 0.01, (1.01, 1.02, 1.05, 1.1, 1.2, 1.4, 1.7, 2.0), 0.5


class FreeSystem:
    """A reduced model without loads.

    Parameters
    ----------
    reduction : ReducedModel
        With the damping ratios that count; zeros for a conservative system.
    mode : int
        The followed one, counted from 0.
    steps : int
        A period.
    """

    def __init__(self, reduction: ReducedModel, mode: int, steps: int):
        self.reduced, self.mode, self.steps = reduction, mode, steps
        excitation = Excitation(np.zeros(1, dtype=int), np.zeros((1, reduction.load_modes.shape[1])), 1)
        self.period = Period(reduction, excitation, steps)
        self.weights = self.period.weights
        self.modes, self.pairs = len(reduction.omega), len(reduction.initial_gap)

    @property
    def conservative(self) -> bool:
        """Whether nothing takes energy from it."""
        return not self.reduced.damping.any()

    def at(self, frequency: float, excitation: float) -> DrivenPeriod:
        """The map over 1 / frequency."""
        r = self.reduced
        omega = np.where(r.omega > 0.0, r.omega, 1.0)
        ratios = np.where(r.omega > 0.0, r.damping - 0.5 * excitation / omega, 0.0)
        return self.period.with_damping(ratios).at(frequency)

    def energy(self, state: np.ndarray) -> tuple[float, np.ndarray]:
        """J, and its derivative with the state: kinetic and modal strain energy and that of the contact,
        whose derivative with the gaps is the contact forces.
        """
        r, m = self.reduced, self.modes
        value, slope = 0.5 * float(state @ state), state.copy()
        gap = r.gap.modes @ (state[:m] / self.weights) + r.initial_gap
        if r.contact_laws.touched(gap).any():
            force = solve_complementarity(r.gap.contact, gap, r.contact_laws).force
            value += 0.5 * float(force @ r.gap.contact @ force)
            slope[:m] -= (force @ r.gap.modes) / self.weights
        return value, slope

    def velocity(self, state: np.ndarray, excitation: float) -> np.ndarray:
        """(2 m,): dx/dt at a state; what contact adds to the force is in the slope of the energy."""
        r, m = self.reduced, self.modes
        displacement, velocity = state[:m], state[m:]
        decay = np.where(r.omega > 0.0, 2.0 * r.damping * r.omega - excitation, 0.0)
        contact = self.weights * (displacement - self.energy(state)[1][:m])
        return np.concatenate([self.weights * velocity, contact - r.omega * displacement - decay * velocity])

    def turned(self, vectors: np.ndarray) -> np.ndarray:
        """The symplectic form's matrix times vectors (2 m, k), in the coordinates of the state."""
        weights = self.weights[:, None]
        return np.concatenate([vectors[self.modes :] / weights, -vectors[: self.modes] / weights])

    def linear(self, energy: float, sign: float = 1.0) -> np.ndarray:
        """(2 m,): the followed mode at its largest displacement."""
        state = np.zeros(2 * self.modes)
        state[self.mode] = sign * math.sqrt(2.0 * energy)
        return state

    def open_side(self) -> tuple[float, float]:
        """Sign of the followed mode that leaves the faces free, and the energy at which the other one brings
        the first pair into contact, inf if none.
        """
        r = self.reduced
        moved = r.gap.modes[:, self.mode] / self.weights[self.mode]

        def reach(direction: np.ndarray) -> float:
            moves = np.abs(direction) > 1e-9 * np.abs(moved).max(initial=0.0)
            room = r.contact_laws.reach(r.initial_gap, direction)[moves] / np.abs(direction[moves])
            return float(room.min(initial=math.inf))

        up, down = reach(moved), reach(-moved)
        # of closed faces the side on which more of them part
        freer = moved.sum() if up == down else up - down
        return 1.0 if freer >= 0.0 else -1.0, 0.5 * min(up, down) ** 2

    # ------------------------------------------------------------------ motions of given energies
    def motion(self, state: np.ndarray, frequency: float, excitation: float, energy: float) -> Point:
        """The motion of an energy near a guess. Raises `Lost` if there is none."""
        return FreeMotions(self).of_energy(np.append(state, [math.log(frequency), excitation]), energy)

    def damped(self, added: float) -> FreeSystem:
        """The same with more damping, a ratio for all modes."""
        if added == 0.0:
            return self
        return FreeSystem(replace(self.reduced, damping=self.reduced.damping + added), self.mode, self.steps)

    def again(self, point: Point, energy: float, added: float = 0.0) -> Point:
        """The motion at an energy near one of a neighbouring system; `added` is how much larger the damping
        ratios are here.
        """
        u = point.u.copy()
        u[:-2] *= math.sqrt(energy / point.value)
        u[-1] += 4.0 * math.pi * math.exp(u[-2]) * added
        return FreeMotions(self).of_energy(u, energy)

    def without(self, point: Point, added: float) -> Point:
        """The motion at the same energy from that of `damped(added)`, in halves of what was added."""
        for lower in (*(added / 2.0**n for n in range(1, HALVINGS + 1)), 0.0):
            point, added = self.damped(lower).again(point, point.value, lower - added), lower
        return point

    def around(self, point: Point, added: float) -> Point:
        """The motion at the energy of one of a neighbouring system, by way of damped ones."""
        return self.without(self.damped(added).again(point, point.value, added), added)


class FreeMotions(Problem):
    """u = (x(0), ln f, xi); the value is the energy, J.

    Parameters
    ----------
    system : FreeSystem
    limits : (float, float)
        Energies between which motions beyond interactions with higher modes are looked for.
    interactions : bool
        Follow the narrow tongues in which the branch turns back in energy there; False: leap over them.
    """

    closed, corners = 1e-11, True
    isolated = "free motions are not isolated at {:.8g} J"
    advice = "take more steps a period or fewer modes"

    def __init__(
        self, system: FreeSystem, limits: tuple[float, float] = (0.0, math.inf), interactions: bool = True
    ):
        self.system, self.period, self.limits = system, system.period, limits
        self.narrow = 0.0 if interactions else NARROW
        # of motions from rest, which run back along themselves after half a period: of all motions
        self._of_all: FreeMotions | None = None
        self._finer: dict[int, FreeMotions] = {}

    @property
    def reversible(self) -> bool:
        """Whether these are motions from rest alone."""
        return self._of_all is not None

    @property
    def unrestricted(self) -> FreeMotions:
        """See `Problem`."""
        return self._of_all or self

    def at(self, u: np.ndarray) -> FreeState:
        """See `Problem`."""
        if not abs(u[-2]) < FURTHEST:
            raise Lost("the frequency leads away")
        return FreeState(self, u)

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Problem`: xi, which state and frequency determine, has no length."""
        units = np.full(len(u), max(float(np.linalg.norm(u[:-2])), 1e-300))
        units[-2:] = 1.0 / SPAN, 2.0 * math.pi * math.exp(u[-2])
        weights = np.ones(len(u))
        weights[-1] = 0.0
        return units, weights

    def value(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        """See `Problem`."""
        energy, slope = self.system.energy(u[:-2])
        return energy, np.append(slope, [0.0, 0.0])

    def placed(self, u: np.ndarray, value: float) -> np.ndarray:
        """See `Problem`: the energy is none of the unknowns."""
        return u

    def of_energy(self, u: np.ndarray, energy: float, near: Linear | None = None) -> Point:
        """The motion of an energy near some unknowns. Raises `Lost` if there is none."""
        point = correct(self, u, Metric(self, u).level(u, energy), near)
        point.value = energy
        return point

    def finer(self, times: int) -> FreeMotions:
        """See `Problem`."""
        if times not in self._finer:
            system = self.system
            self._finer[times] = FreeMotions(FreeSystem(system.reduced, system.mode, times * system.steps))
        return self._finer[times]

    def restricted(self, point: Point) -> FreeMotions | None:
        """See `Problem`: motions that begin at rest run back along themselves after half a period. Near
        motions of another mode the steps make others beside these, which end in corners.
        """
        x = point.u[:-2]
        if not self.system.conservative or (
            np.linalg.norm(x[self.system.modes :]) > AT_REST * np.linalg.norm(x)
        ):
            return None
        return self._from_rest

    @functools.cached_property
    def _from_rest(self) -> FreeMotions:
        result = copy.copy(self)
        result._of_all = self
        return result

    @functools.cached_property
    def free(self) -> np.ndarray:
        """(2 m + 2,) bool: which unknowns a motion from rest has."""
        free = np.ones(2 * self.system.modes + 2, dtype=bool)
        free[self.system.modes : -2] = free[-1] = False
        return free

    def projected(self, u: np.ndarray) -> np.ndarray:
        """See `Problem`."""
        return np.where(self.free, u, 0.0) if self.reversible else u

    def leap(self, points: list[Point], direction: int) -> Point | None:
        """See `Problem`: a motion on the other side of an interaction. With damping there is none, so the way
        leads over damped motions.
        """
        system, last = self.system, points[-1]
        # up to there no pair is at work: a motion is the mode alone, which meets no other
        if last.value <= system.open_side()[1]:
            return None
        more = system.damped(ADDED)
        damped = attempt(lambda: more.again(last, last.value, ADDED), Lost)
        if damped is None:
            return None
        for factor in LEAPS:
            energy = min(max(last.value * factor**direction, self.limits[0]), self.limits[1])
            try:
                damped = more.again(damped, energy)
                if not _goes_along(damped):
                    continue
                found = system.without(damped, ADDED)
                if _goes_along(found):
                    return Point(self, found.u, self.at(found.u), energy)
            except Lost:
                continue
        return None

    def memory(self, point: Point) -> list[bool]:
        """See `Problem`: whether it lies beyond a leap, and is one of those from rest."""
        return [point.leapt, point.problem.reversible]

    def recalled(self, u: np.ndarray, value: float, memory: Sequence[bool]) -> Point:
        """See `Problem`."""
        leapt, reversible = memory
        problem = self._from_rest if reversible else self
        return Point(problem, u, problem.at(u), value, leapt=leapt)


def _goes_along(point: Point) -> bool:
    """Whether the branch goes mostly along the state itself."""
    metric = Metric(point.problem, point.u)
    along = metric.unit(np.append(point.u[:-2], [0.0, 0.0]) / metric.units)
    return metric.dot(metric.tangent(point.linear, along)[0], along) >= MOSTLY


class FreeState(OrbitState):
    """A motion over one period, periodic or not."""

    problem: FreeMotions  # type: ignore[assignment]

    def __init__(self, problem: FreeMotions, u: np.ndarray):
        self.problem, self.u, self.system = problem, u, problem.system
        self.frequency, self.excitation = math.exp(u[-2]), float(u[-1])
        FixedPoint.__init__(self, u[:-2], self.driven, self.driven.run(u[:-2]))
        self.closing, self.phase = self.residual, self.system.modes + self.system.mode
        self.residual = np.append(self.closing, self.state[self.phase])
        self.scale = max(float(np.linalg.norm(self.state)), 1e-300)

    @functools.cached_property
    def driven(self) -> DrivenPeriod:  # type: ignore[override]
        """The map over its period."""
        return self.system.at(self.frequency, self.excitation)

    @functools.cached_property
    def rate(self) -> np.ndarray:
        """dx(T) / dxi, (2 m,), as a difference of two periods."""
        step = DIFFERENCE * 2.0 * math.pi * self.frequency
        ahead = self.system.at(self.frequency, self.excitation + step).run(self.state)
        return (ahead.residual - self.closing) / step

    @functools.cached_property
    def moving(self) -> np.ndarray:
        """dx/dt at t = 0, (2 m,)."""
        return self.system.velocity(self.state, self.excitation)

    @functools.cached_property
    def spectrum(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Multipliers (k,) complex of the monodromy and their vectors (2 m, k), without two that every free
        motion has, and the product of these two.

        That along the motion is 1, and so is another one without damping. They lie in one Jordan block, or
        nearly: the steps' error splits them by its root, on the real axis or off it, but not their product,
        which the steps keep. They are told by their share in the velocity along the motion, which the others
        have none in.
        """
        values, vectors = linalg.eig(self.monodromy, check_finite=False)
        share = np.abs(linalg.lstsq(vectors, self.moving.astype(complex), check_finite=False)[0])
        along = int(share.argmax())
        # the real ones are even in number
        partner = values == values[along].conj() if values[along].imag else values.imag == 0.0
        partner[along] = False
        other = int(np.where(partner, share, -1.0).argmax())
        rest = np.ones(len(values), dtype=bool)
        rest[[along, other]] = False
        return values[rest], vectors[:, rest], float((values[along] * values[other]).real)

    @functools.cached_property
    def turning(self) -> tuple[np.ndarray, np.ndarray]:
        """Turns of the multipliers on the unit circle, one of each pair, by the sense of their motion, and
        their vectors, of product 1 with themselves.
        """
        values, vectors, _ = self.spectrum
        sense = np.einsum("ij,ij->j", vectors.conj(), self.system.turned(vectors)).imag
        kept = (np.abs(np.abs(values) - 1.0) < OFF) & (values.imag != 0.0) & (sense > 0.0)
        return np.angle(values[kept]) / (2.0 * math.pi), vectors[:, kept] / np.sqrt(sense[kept])

    def linear(self, smooth: bool = False) -> Dense:
        """See `problem.State`; with the frequency x(T) changes as it does with time."""
        size = len(self.state)
        matrix = np.zeros((size + 1, size + 2))
        if smooth:
            matrix[:size, :size] = self.monodromy
            matrix[:size, size] = -self.moving / self.frequency
        else:
            matrix[:size, :size] = self.driven.carried(self.motion, np.eye(size))
            faster = self.system.at(self.frequency * math.exp(FASTER), self.excitation).run(self.state)
            matrix[:size, size] = (faster.residual - self.closing) / FASTER
        matrix[range(size), range(size)] -= 1.0
        matrix[:size, size + 1] = self.rate
        matrix[size, self.phase] = 1.0
        if self.problem.reversible:
            return FromRest(matrix, self.problem.free, self.problem.units(self.u)[0])
        return Dense(matrix)

    @property
    def damping_ratio(self) -> float:
        """Of a linear system of this frequency whose motions decay at the rate xi / 2."""
        return self.excitation / (4.0 * math.pi * self.frequency)

    @property
    def energy_damping_ratio(self) -> float:
        """What dampers take in a period over 4 pi times the energy: xi gives the motion just that back."""
        speeds, energy = self.motion.velocities[:-1], self.system.energy(self.state)[0]
        taken = self.excitation * float(np.vdot(speeds, speeds)) * self.driven.step
        return taken / (4.0 * math.pi * energy)


class FromRest(Dense):
    """Without velocities and self-excitation among the unknowns: more equations than these, which agree."""

    def __init__(self, matrix: np.ndarray, free: np.ndarray, units: np.ndarray):
        super().__init__(matrix)
        self.free, self.units = free, units

    def bordered(self, row: np.ndarray) -> DenseBorder:
        """See `problem.Linear`."""
        return _FromRestBorder(self, row)

    def mixed(self, others: Sequence[Dense], weights: Sequence[float]) -> FromRest:
        """See `problem.Linear`."""
        return FromRest(super().mixed(others, weights).matrix, self.free, self.units)


class _FromRestBorder(DenseBorder):
    """By the pseudo-inverse; there is no determinant."""

    def __init__(self, linear: FromRest, row: np.ndarray):
        self.free, self.units, self.sign = linear.free, linear.units[linear.free], None
        matrix = linear.matrix[:, linear.free] * self.units
        row = row[linear.free] * self.units
        self.size = float(np.abs(matrix).max()) / max(float(np.abs(row).max()), 1e-300)
        self.inverse = linalg.pinv(np.vstack([matrix, self.size * row]))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`."""
        result = np.zeros(len(self.free))
        result[self.free] = self.units * (self.inverse @ np.append(right[:-1], self.size * right[-1]))
        return result
