"""The contact problem of a step of the unreduced model, condensed onto the contact rows."""

from __future__ import annotations

import numpy as np

from ...contact.complementarity import one_pass_tie, solve_complementarity
from ...contact.law import FREE, RowLaws
from ...contact.pivoting import contact_forces, empty_factor


class StepContact:
    """Contact forces from the gaps that a step would have without them.

    Parameters
    ----------
    flexibility : (c, c) array
        What forces over a step do to the gaps at its end, m/N.
    laws : RowLaws
    scheme : {"implicit", "paper"}

    Attributes
    ----------
    state : (c,) int8 array
        Of the rows, from which the next step begins, see `contact.law`.
    """

    def __init__(self, flexibility: np.ndarray, laws: RowLaws, scheme: str):
        self.flexibility, self.laws, self.scheme = flexibility, laws, scheme
        count = len(flexibility)
        self.state = np.zeros(count, dtype=np.int8)
        self._factor = empty_factor(count)

    def forget(self) -> None:
        """Factorise anew in the next step: a history that goes on depends on its motion and `state` alone."""
        self._factor.members[-1] = -1

    def open(self) -> None:
        """No row is in contact."""
        self.state[:], self._factor.members[-1] = FREE, 0

    def solve(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces and gaps (c,) from the gaps without forces."""
        if self.scheme == "paper":
            found = one_pass_tie(self.flexibility, free, self.laws)
            return found.force, found.gap
        force = np.zeros(len(free))
        exchanges = contact_forces(self.flexibility, free, self.laws.table, self.state, self._factor, force)
        if exchanges < 0:
            found = solve_complementarity(self.flexibility, free, self.laws)
            self.state, self._factor.members[-1] = found.state.copy(), -1
            return found.force, found.gap
        return force, self.laws.placed(self.state, self.flexibility @ force + free)

    def kept(self, free: np.ndarray, acting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces that keep the gaps of the rows `acting` (c,), and all gaps."""
        force = np.zeros(len(free))
        force[acting] = np.linalg.solve(self.flexibility[np.ix_(acting, acting)], -free[acting])
        return force, self.flexibility @ force + free
