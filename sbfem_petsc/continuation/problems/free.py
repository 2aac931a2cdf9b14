"""Free periodic motions of a reduced model, with their energy as the parameter.

Unknowns are the state x(0) = (Omega q, q'), the frequency f and a self-excitation xi: every mode is driven by
xi times its own velocity (Krack's extended periodic motion). A free motion of a system without damping has xi
= 0 to the precision of the steps; with damping xi is what keeps the motion going. Equations are x(T) = x(0),
a vanishing velocity of the followed mode at t = 0 (the phase), and the energy or a step along the branch: as
many as unknowns, and regular although a conservative system conserves its energy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...contact.complementarity import solve_complementarity
from ...errors import SolveError
from ...motion.excitation import Excitation
from ...motion.period_map import DrivenPeriod, Period, PeriodMotion
from ...reduction.reduced_model import ReducedModel

# Newton's method: closing error relative to the state, and iterations.
CLOSED, ITERATIONS = 1e-11, 12
# Step of xi, relative to omega, by which the map is differentiated with respect to it; the map is piecewise
# linear in the state and smooth in xi.
DIFFERENCE = 1e-5
# Arc length: change of the state relative to its size and SPAN times the relative change of the frequency.
SPAN = 10.0
# Velocity relative to the state that is none.
AT_REST = 1e-7
# Times that added damping is halved before it is left out.
HALVINGS = 7


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """A free periodic motion.

    Attributes
    ----------
    state : (2 m,) array
        x(0) = (Omega q, q').
    frequency : float
        Hz.
    excitation : float
        xi, 1/s.
    energy : float
        J, at t = 0.
    driven : DrivenPeriod
    motion : PeriodMotion
    iterations : int
        Newton iterations.
    """

    state: np.ndarray
    frequency: float
    excitation: float
    energy: float
    driven: DrivenPeriod
    motion: PeriodMotion
    iterations: int

    @property
    def damping_ratio(self) -> float:
        """Of a linear system of this frequency whose motions decay at the rate xi / 2."""
        return self.excitation / (4.0 * math.pi * self.frequency)

    @property
    def energy_damping_ratio(self) -> float:
        """What dampers take in a period over 4 pi times the energy: xi gives the motion just that back."""
        speeds = self.motion.velocities[:-1]
        return (
            self.excitation
            * float(np.vdot(speeds, speeds))
            * self.driven.step
            / (4.0 * math.pi * self.energy)
        )


class FreeSystem:
    """A reduced model without loads, and the equations of its free periodic motions.

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
        self.excitation = Excitation(np.zeros(1, dtype=int), np.zeros((1, reduction.load_modes.shape[1])), 1)
        self.weights = Period(reduction, self.excitation, steps).weights
        self.modes, self.pairs = len(reduction.omega), len(reduction.initial_gap)

    def at(self, frequency: float, excitation: float) -> DrivenPeriod:
        """The map over 1 / frequency."""
        r = self.reduced
        omega = np.where(r.omega > 0.0, r.omega, 1.0)
        ratios = np.where(r.omega > 0.0, r.damping - 0.5 * excitation / omega, 0.0)
        return Period(replace(r, damping=ratios), self.excitation, self.steps).at(frequency)

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
        if up == down:
            # closed faces: the side on which more of them part
            sign = 1.0 if moved.sum() >= 0.0 else -1.0
        else:
            sign = 1.0 if up > down else -1.0
        return sign, 0.5 * min(up, down) ** 2

    # ------------------------------------------------------------------ Newton's method
    def solve(
        self,
        state: np.ndarray,
        frequency: float,
        excitation: float,
        condition: Callable[[np.ndarray, float], tuple[float, np.ndarray, float]],
        *,
        reversible: bool = False,
    ) -> FreeMotion:
        """The free motion near a guess.

        `condition` gives for a state and a frequency a value that is to vanish, of order 1, and its
        derivatives with both. `reversible`: among motions from rest without self-excitation, which run back
        after half a period.

        Raises
        ------
        SolveError
            If Newton's method does not converge.
        """
        x, f, xi, m2 = state.copy(), frequency, excitation, 2 * self.modes
        if reversible:
            x[self.modes :], xi = 0.0, 0.0
        free, error = self._unknowns(reversible), math.nan
        for iteration in range(ITERATIONS + 1):
            driven = self.at(f, xi)
            motion = driven.run(x)
            size = float(np.linalg.norm(x))
            value, row, slope = condition(x, f)
            error = float(np.linalg.norm(motion.residual)) / size
            if error < CLOSED and abs(value) < 1e-10 and abs(x[self.modes + self.mode]) < 1e-9 * size:
                return FreeMotion(x, f, xi, self.energy(x)[0], driven, motion, iteration)
            if not np.isfinite(error):
                break
            matrix, right = np.zeros((m2 + 2, m2 + 2)), np.zeros(m2 + 2)
            matrix[:m2] = self._derivative(driven, motion, x, f, xi, size)
            right[:m2] = motion.residual / size
            matrix[m2, self.modes + self.mode], right[m2] = 1.0, x[self.modes + self.mode] / size
            matrix[m2 + 1, :m2], matrix[m2 + 1, m2], right[m2 + 1] = row * size, slope * f, value
            try:
                change = _solved(matrix, right, free)
            except np.linalg.LinAlgError:
                break
            length = np.linalg.norm(change[:m2])
            if not np.isfinite(length) or abs(change[m2]) > 0.5:
                break
            x -= size * change[:m2]
            f -= f * change[m2]
            xi -= 2.0 * math.pi * f * change[m2 + 1]
        raise SolveError(
            f"backbone: Newton's method did not converge at {f:.6g} Hz: x(T) - x(0) is at {error:.1e} of x(0)"
        )

    def _derivative(self, driven, motion, x, f, xi, size) -> np.ndarray:
        """(2 m, 2 m + 2): of (x(T) - x(0)) / size with x / size, ln f and xi / (2 pi f)."""
        m2 = 2 * self.modes
        result = np.empty((m2, m2 + 2))
        result[:, : m2 + 1] = driven.carried(motion, np.eye(m2), ("frequency",))
        result[:, :m2] -= np.eye(m2)
        result[:, m2] *= f / size
        step = DIFFERENCE * 2.0 * math.pi * f
        ahead, behind = (self.at(f, xi + d).run(x).residual for d in (step, -step))
        result[:, m2 + 1] = (ahead - behind) / (2.0 * DIFFERENCE * size)
        return result

    def at_energy(self, energy: float):
        """Condition: the energy, in logarithms."""

        def condition(state: np.ndarray, frequency: float):
            value, slope = self.energy(state)
            return 0.5 * math.log(value / energy), 0.5 * slope / value, 0.0

        return condition

    def damped(self, added: float) -> FreeSystem:
        """The same with more damping, a ratio for all modes."""
        if added == 0.0:
            return self
        return FreeSystem(replace(self.reduced, damping=self.reduced.damping + added), self.mode, self.steps)

    def again(self, point: FreeMotion, energy: float, excitation: float) -> FreeMotion:
        """The motion at an energy near one of a neighbouring system."""
        state = point.state * math.sqrt(energy / point.energy)
        return self.solve(state, point.frequency, excitation, self.at_energy(energy))

    def without(self, point: FreeMotion, added: float) -> FreeMotion:
        """The motion at the same energy from that of `damped(added)`, in halves of what was added."""
        for lower in (*(added / 2.0**n for n in range(1, HALVINGS + 1)), 0.0):
            excitation = point.excitation - 4.0 * math.pi * point.frequency * (added - lower)
            point, added = self.damped(lower).again(point, point.energy, excitation), lower
        return point

    def around(self, point: FreeMotion, added: float) -> FreeMotion:
        """The motion at the energy of one of a neighbouring system, by way of damped ones."""
        excitation = point.excitation + 4.0 * math.pi * point.frequency * added
        return self.without(self.damped(added).again(point, point.energy, excitation), added)

    def from_rest(self, point: FreeMotion) -> bool:
        """Whether a motion begins at rest and runs back along itself after half a period."""
        moving = np.linalg.norm(point.state[self.modes :]) > AT_REST * np.linalg.norm(point.state)
        return not moving and not self.reduced.damping.any()

    def _unknowns(self, reversible: bool) -> np.ndarray:
        """Which of x, f and xi are free."""
        free = np.ones(2 * self.modes + 2, dtype=bool)
        if reversible:
            free[self.modes : 2 * self.modes] = free[-1] = False
        return free

    def tangent(self, point: FreeMotion, near: np.ndarray, *, reversible: bool = False) -> np.ndarray:
        """(2 m + 2,): the branch's direction in x / size and SPAN times ln f, of length 1, on the side of
        `near`; its last entry is that of xi. `reversible` as for `solve`.
        """
        m2, size = 2 * self.modes, float(np.linalg.norm(point.state))
        matrix = np.zeros((m2 + 2, m2 + 2))
        matrix[:m2] = self._derivative(
            point.driven, point.motion, point.state, point.frequency, point.excitation, size
        )
        matrix[:m2, m2] /= SPAN
        matrix[m2, self.modes + self.mode] = 1.0
        matrix[m2 + 1, : m2 + 1] = near[: m2 + 1]
        direction = _solved(matrix, np.eye(m2 + 2)[m2 + 1], self._unknowns(reversible))
        direction /= np.linalg.norm(direction[: m2 + 1])
        return direction


def _solved(matrix: np.ndarray, right: np.ndarray, free: np.ndarray) -> np.ndarray:
    """The free unknowns of a linear system that has a solution in them; zeros for the others."""
    if free.all():
        return np.linalg.solve(matrix, right)
    result = np.zeros(len(right))
    result[free] = np.linalg.lstsq(matrix[:, free], right, rcond=None)[0]
    return result
