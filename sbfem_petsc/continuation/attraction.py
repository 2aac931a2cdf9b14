"""Which steady state a history settles on, for many histories.

At multiples of the loads' period T a history is a sequence of states x, P(x), P(P(x)), ... that is followed
until it repeats itself or comes so near to a stable orbit that is known that it will not leave it again. What
repeats itself and is not known yet is made an orbit by Newton's method, so that each steady state has its
multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..contact.repeating import REPEATS, UNSOLVED, Known, Patience, settle
from ..errors import SolveError
from ..motion.period_map import Period
from ..petsc import MPI
from ..progress import silent
from .newton import attempt
from .orbit import Orbit, make_orbit, orbit_stability
from .problems.driven_orbits import minimal_periods
from .shooting import shoot

# Of an orbit's size, and of the distance to the nearest other known orbit: the distance at which a stable
# orbit counts as reached.
CAPTURED, APART = 1e-3, 0.1
# Of the state's size: how near to an orbit a history that repeats itself is one with it.
SAME = 1e-4
# The same of an orbit in other steps and in those of the map.
NEAR = 0.05
# Initial states from which orbits are looked for before the others are followed.
SCOUTS = 8


class Attraction:
    """The histories of a period map and the orbits they are known to settle on.

    Parameters
    ----------
    period : Period
    frequency : float
        Hz.
    patience : Patience
    comm : MPI.Comm
        Ranks that share the histories.
    """

    def __init__(self, period: Period, frequency: float, patience: Patience, comm: MPI.Comm):
        self.period, self.frequency, self.patience, self.comm = period, frequency, patience, comm
        self.driven = period.at(frequency)
        self.orbits: list[Orbit] = []
        self._cycles: list[np.ndarray] = []
        # the linear steady state without slips, which are not counted from those at rest
        self._linear = self.driven.linear_state.copy()
        self._linear[2 * period.modes :] = 0.0

    def add(self, orbit: Orbit) -> None:
        """Make an orbit known; one in other steps is found again in those of the map.

        Raises
        ------
        ValueError
            If it is none of this map.
        """
        count, rest = divmod(orbit.periods, self.period.excitation.periods)
        given = None if rest else self._in_steps(orbit, count)
        cycle = []
        if given is not None:
            state = given.state
            for _ in range(count):
                cycle.append(state)
                state = state + self.driven.run(state).residual
        if given is None or np.linalg.norm(state - given.state) > SAME * self._size(given.state):
            raise ValueError(
                f"basins: {orbit!r} is no motion of this model under this load; give orbits of the same "
                "model, load and frequency"
            )
        self.orbits.append(given)
        self._cycles.append(np.array(cycle))

    def _in_steps(self, orbit: Orbit, count: int) -> Orbit | None:
        """An orbit over so many periods of the map in its steps; None if there is none nearby."""
        if len(orbit.time) == count * self.period.steps:
            return orbit
        period = self.period.repeated(count)
        fixed = attempt(lambda: shoot(period.at(self.frequency), orbit.state), SolveError)
        if fixed is None or np.linalg.norm(fixed.state - orbit.state) > NEAR * self._size(orbit.state):
            return None
        return make_orbit(fixed, orbit.path, orbit_stability(fixed))

    def follow(
        self, starts: np.ndarray, report: Callable[[float], None] = silent
    ) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the orbits that (n, 2 m) states lead to, and the loads' periods until that was known.

        Some are followed first, so that the orbits they find are known to the others.
        """
        reached, periods = np.full(len(starts), -1), np.zeros(len(starts), dtype=int)
        scouts = np.zeros(len(starts), dtype=bool)
        scouts[:: math.ceil(len(starts) / SCOUTS)] = True
        reached[scouts], periods[scouts] = self._group(starts[scouts], silent)
        reached[~scouts], periods[~scouts] = self._group(starts[~scouts], report)
        return reached, periods

    def _size(self, state: np.ndarray) -> float:
        return max(self.period.size(state), self.driven.oscillation)

    def _group(self, starts: np.ndarray, report: Callable[[float], None]) -> tuple[np.ndarray, np.ndarray]:
        outcome, periods, repeats = (np.zeros(len(starts), dtype=np.int64) for _ in range(3))
        ends = np.zeros_like(starts)
        known, radii, owners = self._targets()
        mine = range(self.comm.rank, len(starts), self.comm.size)
        for count, i in enumerate(mine):
            outcome[i], periods[i], repeats[i], ends[i] = self._history(starts[i], known, radii)
            report((count + 1) / len(mine))
        for array in (outcome, periods, repeats, ends):
            self.comm.Allreduce(MPI.IN_PLACE, array)
        if (outcome == UNSOLVED).any():
            first = int(np.flatnonzero(outcome == UNSOLVED)[0])
            raise self.period.sets.unsolved(
                f"basins: a contact problem in period {periods[first] + 1} of a history"
            )
        reached = np.full(len(starts), -1)
        captured = outcome >= 0
        reached[captured] = owners[outcome[captured]]
        for i in np.flatnonzero(outcome == REPEATS):
            reached[i] = self._identified(ends[i], int(repeats[i]))
        return reached, periods

    def _history(
        self, start: np.ndarray, known: np.ndarray, radii: np.ndarray
    ) -> tuple[int, int, int, np.ndarray]:
        """Outcome, periods, repeats and last state of the history from one state."""
        d, p, m = self.driven, self.period, self.period.modes
        q, v, slip = np.split(start - self._linear, [m, 2 * m])
        q, slip = q / p.weights, p.slip_units * slip
        targets = Known(p.weights, p.slip_units, known, radii, d.oscillation)
        outcome, periods, repeats = settle(d.constants, d.free_gap, (q, v, slip), targets, self.patience)
        end = np.concatenate([p.weights * q, v, slip / p.slip_units])
        return outcome, periods, repeats, self._linear + end

    def _targets(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States of the stable orbits, relative to the linear one, how near they capture, and whose they
        are.
        """
        states, radii, owners = [], [], []
        for k, (orbit, cycle) in enumerate(zip(self.orbits, self._cycles)):
            if not orbit.stable:
                continue
            others = [other for number, other in enumerate(self._cycles) if number != k]
            for state in cycle:
                nearest = min(
                    (float(np.linalg.norm(other - state, axis=1).min()) for other in others), default=math.inf
                )
                states.append(state - self._linear)
                radii.append(min(CAPTURED * self._size(state), APART * nearest))
                owners.append(k)
        known = np.array(states).reshape(-1, self.period.unknowns)
        return known, np.array(radii), np.array(owners, dtype=int)

    def _identified(self, state: np.ndarray, repeats: int) -> int:
        """The number of the orbit that a history has settled on, a new one where it is not known; -1 if
        Newton's method finds none there.
        """
        for k, cycle in enumerate(self._cycles):
            if np.linalg.norm(cycle - state, axis=1).min() <= SAME * self._size(state):
                return k
        if repeats == 1 and (like := self._alike(state)) >= 0:
            return like
        own = self.period.excitation.periods
        period = self.period.repeated(repeats)
        try:
            fixed = shoot(period.at(self.frequency), state)
            # a disturbance changes least over the periods in which it makes a whole turn, so that histories
            # seem to repeat themselves after these, whatever the period of the motion
            times = math.lcm(minimal_periods(fixed), own) // own
            if times < repeats:
                period = self.period.repeated(times)
                fixed = shoot(period.at(self.frequency), fixed.state)
        except SolveError:
            return -1
        if np.linalg.norm(fixed.state - state) > SAME * self._size(state):
            return -1
        if times == 1 < repeats and (like := self._alike(fixed.state)) >= 0:
            return like
        self.add(make_orbit(fixed, "history", orbit_stability(fixed)))
        return len(self.orbits) - 1

    def _alike(self, state: np.ndarray) -> int:
        """The known orbit with rows that stick throughout from which a motion of one period differs, but for
        where both rest, by no more than such rows' slips: these stay wherever they are, and such motions are
        no finite number. -1 without one.
        """
        for k, (orbit, cycle) in enumerate(zip(self.orbits, self._cycles)):
            if orbit.sticking and len(cycle) == 1:
                one, other = (self.driven.run(item).states for item in (state, cycle[0]))
                apart = self.period.weights * (one - other)
                if np.abs(apart - apart.mean(axis=0)).max() <= NEAR * self.driven.oscillation:
                    return k
        return -1
