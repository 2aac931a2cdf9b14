"""The contact problem of a step of the unreduced model, condensed onto the contact rows."""

from __future__ import annotations

import numpy as np

from ...contact.friction import SMOOTH, Friction, Memory
from ...contact.friction_solve import solve_friction
from ...contact.held_rows import empty_sets
from ...contact.law import FREE, RowLaws


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
        self.state, self.gap = np.zeros(count, dtype=np.int8), np.zeros(0 if friction is None else count)
        self.kept, self._sets = self.slip, empty_sets(count)

    @property
    def slip(self) -> np.ndarray:
        """(k,): of `gap`."""
        return self.gap[len(self.laws) :]

    def forget(self) -> None:
        """Begin anew in the next step: a history that goes on depends on its motion and `state` alone."""
        self._sets.members[-1] = -1

    def open(self, gap: np.ndarray) -> None:
        """No row is in contact."""
        self.state[:] = FREE
        self._remember(gap, gap[len(self.laws) :])

    def _remember(self, gap: np.ndarray, kept: np.ndarray) -> None:
        if self.friction is not None:
            self.gap, self.kept = gap, kept

    def solve(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces and gaps (c,) from the gaps without forces; what faces that rub remember goes on."""
        c, friction = len(self.laws), SMOOTH if self.friction is None else self.friction
        memory = Memory.none(self.laws, friction)
        memory = memory._replace(normal=self.state[:c], tangential=self.state[c:])
        if self.friction is not None:
            memory = memory._replace(slip=self.slip, gap=self.gap[:c])
        found = solve_friction(self.flexibility, free, self.laws, friction, memory, self._sets)
        self.state = found.state
        self._remember(found.gap, found.kept)
        return found.force, found.gap

    def held(self, free: np.ndarray, acting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces that keep the gaps of the rows `acting` (c,), and all gaps."""
        force = np.zeros(len(free))
        force[acting] = np.linalg.solve(self.flexibility[np.ix_(acting, acting)], -free[acting])
        return force, self.flexibility @ force + free
