"""The contact problem of a step of the unreduced model, condensed onto the contact rows."""

from __future__ import annotations

import numpy as np

from ..contact.complementarity import one_pass_tie, solve_complementarity
from ..contact.law import RowLaws
from ..contact.marching import contact_forces, empty_factor


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
    active : (c,) bool array
        Rows in contact, from which the next step begins.
    """

    def __init__(self, flexibility: np.ndarray, laws: RowLaws, scheme: str):
        self.flexibility, self.laws, self.scheme = flexibility, laws, scheme
        count = len(flexibility)
        self.active = np.zeros(count, dtype=bool)
        self._factor = empty_factor(count)

    def forget(self) -> None:
        """Factorise anew in the next step: a history that goes on depends on its state and `active` alone."""
        self._factor.members[-1] = -1

    def open(self) -> None:
        """No row is in contact."""
        self.active[:], self._factor.members[-1] = False, 0

    def solve(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces and gaps (c,) from the gaps without forces."""
        if self.scheme == "paper":
            found = one_pass_tie(self.flexibility, free, self.laws)
            return found.force, found.gap
        force = np.zeros(len(free))
        self.active |= self.laws.tied
        exchanges = contact_forces(self.flexibility, free, self.laws.tied, self.active, self._factor, force)
        if exchanges < 0:
            found = solve_complementarity(self.flexibility, free, self.laws)
            self.active, self._factor.members[-1] = found.active.copy(), -1
            return found.force, found.gap
        gap = self.flexibility @ force + free
        gap[self.active] = 0.0
        return force, gap

    def kept(self, free: np.ndarray, acting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces that keep the gaps of the rows `acting` (c,), and all gaps."""
        force = np.zeros(len(free))
        force[acting] = np.linalg.solve(self.flexibility[np.ix_(acting, acting)], -free[acting])
        return force, self.flexibility @ force + free
