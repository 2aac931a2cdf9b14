"""What the integration of one period leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..contact.friction import STICKS


@dataclass(frozen=True, eq=False)
class PeriodMotion:
    """One period from a given state.

    Attributes
    ----------
    residual : (2 m + k,) array
        x(T) - x(0).
    states, velocities : (n + 1, m) arrays
        Difference z of modal displacement and velocity to the linear steady state.
    forces : (n + 1, pairs) array
        Of slips behind those of gaps.
    work : (n,) array
        Of the contact forces in each step beside what friction takes, J; none in the exact motion.
    rows : (n + 1, pairs) int8 array
        States of the rows, see `contact.friction`; empty where nothing rubs.
    lost : (n,) array
        To friction in each step, J; empty where nothing rubs.
    landings : (n, k, 3) array
        Where tangential rows land in each step, see `contact.held_rows.Sets`; empty where nothing rubs.
    told : (n, pairs) int8 array
        States of the rows from which it is told where they land.
    """

    residual: np.ndarray
    states: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray
    work: np.ndarray
    rows: np.ndarray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int8))
    lost: np.ndarray = field(default_factory=lambda: np.empty(0))
    landings: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 3)))
    told: np.ndarray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int8))

    def stays(self, count: int) -> np.ndarray:
        """(k,): the slips, behind `count` normal rows, that stick throughout the period."""
        found: np.ndarray = (self.rows[:, count:] == STICKS).all(axis=0)
        return found
