"""The contact problem of a step of the unreduced model, condensed onto the contact rows."""

from __future__ import annotations

import numpy as np

from ...contact.complementarity import solve_complementarity
from ...contact.friction import STICKS, Friction, Memory, solve_friction
from ...contact.held_rows import empty_sets, rubbing_of
from ...contact.law import FREE, RowLaws
from ...contact.pivoting import contact_forces, empty_factor
from ...contact.rubbing import rubbing_forces


class StepContact:
    """Contact forces from the gaps that a step would have without them.

    Parameters
    ----------
    flexibility : (c, c) array
        What forces over a step do to the gaps at its end, m/N.
    laws : RowLaws
    friction : Friction or None
        Of the rows behind those with laws.

    Attributes
    ----------
    state : (c,) int8 array
        Of the rows, from which the next step begins, see `contact.law`.
    slip : (k,) array
        Slips at the step's beginning, m: what faces that rub remember.
    """

    def __init__(self, flexibility: np.ndarray, laws: RowLaws, friction: Friction | None = None):
        self.flexibility, self.laws, self.friction = flexibility, laws, friction
        count = len(flexibility)
        self.state, self.slip = np.zeros(count, dtype=np.int8), np.zeros(count - len(laws))
        self._factor, self._sets = empty_factor(count), empty_sets(len(self.slip) and count)
        if friction is not None:
            self._rubbing = rubbing_of(friction, flexibility, len(laws))

    def forget(self) -> None:
        """Factorise anew in the next step: a history that goes on depends on its motion and `state` alone."""
        self._factor.members[-1] = self._sets.members[-1] = -1

    def open(self, gap: np.ndarray) -> None:
        """No row is in contact."""
        self.state[:], self._factor.members[-1], self.slip = FREE, 0, gap[len(self.laws) :]

    def solve(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces and gaps (c,) from the gaps without forces."""
        if self.friction is not None:
            return self._rubbed(free, self.friction)
        force = np.zeros(len(free))
        exchanges = contact_forces(self.flexibility, free, self.laws.table, self.state, self._factor, force)
        if exchanges < 0:
            found = solve_complementarity(self.flexibility, free, self.laws)
            self.state, self._factor.members[-1] = found.state.copy(), -1
            return found.force, found.gap
        return force, self.laws.placed(self.state, self.flexibility @ force + free)

    def _rubbed(self, free: np.ndarray, friction: Friction) -> tuple[np.ndarray, np.ndarray]:
        """The same where faces rub; what they remember goes on."""
        force, c, state = np.zeros(len(free)), len(self.laws), self.state.copy()
        gaps, held = (free, np.append(np.zeros(c), self.slip)), (self.laws.table, self._rubbing, state)
        if rubbing_forces(self.flexibility, gaps, held, self._sets, force) < 0:
            memory = Memory.none(self.laws, friction)._replace(slip=self.slip)
            found = solve_friction(self.flexibility, free, self.laws, friction, memory)
            self._sets.members[-1], force, state = -1, found.force, found.state
        gap, self.state = self.flexibility @ force + free, state
        self.slip = np.where(state[c:] == STICKS, self.slip, gap[c:])
        return force, np.append(self.laws.placed(state[:c], gap[:c]), self.slip)

    def kept(self, free: np.ndarray, acting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces that keep the gaps of the rows `acting` (c,), and all gaps."""
        force = np.zeros(len(free))
        force[acting] = np.linalg.solve(self.flexibility[np.ix_(acting, acting)], -free[acting])
        return force, self.flexibility @ force + free
