"""The contact problem of a step of the unreduced model, condensed onto the contact rows."""

from __future__ import annotations

import numpy as np

from ...contact.complementarity import solve_complementarity
from ...contact.friction import Friction, Memory, rubbing_of
from ...contact.friction_solve import solve_friction
from ...contact.law import FREE, RowLaws
from ...contact.pivoting import contact_forces
from ...contact.problem import Problem, empty_sets


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
    gap : (c,) array
        At the step's beginning, m, of faces that rub: where they land, and the slips that they remember.
    kept : (k,) array
        Slips that rows stuck to or slid from in the last step, m.
    """

    def __init__(self, flexibility: np.ndarray, laws: RowLaws, friction: Friction | None = None):
        self.flexibility, self.laws, self.friction = flexibility, laws, friction
        count = len(flexibility)
        rubs = count if friction is not None else 0
        self.state, self.gap = np.zeros(count, dtype=np.int8), np.zeros(rubs)
        self.kept = self.slip
        self._sets, self._smooth = empty_sets(count), rubbing_of(None, flexibility, count)

    @property
    def slip(self) -> np.ndarray:
        """(k,): of `gap`."""
        return self.gap[len(self.laws) :]

    def forget(self) -> None:
        """Factorise anew in the next step: a history that goes on depends on its motion and `state` alone."""
        self._sets.members[-1] = -1

    def open(self, gap: np.ndarray) -> None:
        """No row is in contact."""
        self.state[:] = FREE
        if self.friction is not None:
            self.gap, self.kept = gap, gap[len(self.laws) :]

    def solve(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces and gaps (c,) from the gaps without forces."""
        if self.friction is not None:
            return self._rubbed(free, self.friction)
        force = np.zeros(len(free))
        known = self.laws.table, self._smooth, self.state, self._sets
        if contact_forces(Problem(self.flexibility, free, free, *known, force)) < 0:
            found = solve_complementarity(self.flexibility, free, self.laws)
            self.state, self._sets.members[-1] = found.state.copy(), -1
            return found.force, found.gap
        return force, self.laws.placed(self.state, self.flexibility @ force + free)

    def _rubbed(self, free: np.ndarray, friction: Friction) -> tuple[np.ndarray, np.ndarray]:
        """The same where faces rub; what they remember goes on."""
        c, state = len(self.laws), self.state
        memory = Memory.none(self.laws, friction)._replace(
            slip=self.slip, gap=self.gap[:c], normal=state[:c], tangential=state[c:]
        )
        found = solve_friction(self.flexibility, free, self.laws, friction, memory, self._sets)
        self.state, self.gap, self.kept = found.state, found.gap, found.kept
        return found.force, found.gap

    def held(self, free: np.ndarray, acting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces that keep the gaps of the rows `acting` (c,), and all gaps."""
        force = np.zeros(len(free))
        force[acting] = np.linalg.solve(self.flexibility[np.ix_(acting, acting)], -free[acting])
        return force, self.flexibility @ force + free
