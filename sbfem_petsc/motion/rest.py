"""Where a reduced model rests under constant loads."""

from __future__ import annotations

import numpy as np

from ..contact.complementarity import Complementarity
from ..contact.friction import Memory
from ..contact.instant import solve_contact
from ..errors import failed_solve
from ..reduction.reduced_model import ReducedModel

# A rigid-body motion is held by contact alone. A spring stands for nothing that gives the mode this share of
# the lowest frequency; where it carries more than this share of the forces, nothing holds the motion. What is
# below this share of a load's or a row's largest mode, or of what cancels to it, is rounding.
SOFT, HELD, ROUND_OFF = 1e-4, 0.1, 1e-12


class Rest:
    """Static equilibria of a reduced model, exact but for rigid-body motions: these to 1e-7.

    Parameters
    ----------
    reduced : ReducedModel
    contact : bool
        False: faces may overlap.
    """

    def __init__(self, reduced: ReducedModel, contact: bool = True):
        self.reduced, self.contact, omega = reduced, contact, reduced.omega
        self.rigid = omega == 0.0
        self.pushes, self.rows = self._clear(reduced.load_modes), self._clear(reduced.gap.modes.T).T
        soft = SOFT * min(omega[~self.rigid], default=1.0)
        self.stiffness = np.where(self.rigid, soft, omega) ** 2
        self.flexibility = (self.rows / self.stiffness) @ self.rows.T + reduced.gap.contact

    def _clear(self, columns: np.ndarray) -> np.ndarray:
        """Forces (m, n) in the modes without what rounding leaves of them in rigid-body motions."""
        rounding = np.abs(columns) <= ROUND_OFF * np.abs(columns).max(axis=0, initial=0.0)
        return np.where(self.rigid[:, None] & rounding, 0.0, columns)

    def __call__(
        self, amplitudes: np.ndarray, former: Memory | None = None
    ) -> tuple[np.ndarray, Complementarity]:
        """Modal coordinates (m,) under amplitudes of the unit loads, and contact; of faces that rub after
        what a former state has left, by default as they have never been loaded.

        Raises
        ------
        SolveError
            If the loads push a rigid-body motion that contact does not hold.
        """
        r, rows = self.reduced, self.rows
        loads = self.pushes @ amplitudes
        gap = (rows / self.stiffness) @ loads + r.gap.loads @ amplitudes + r.initial_gap
        slip = np.empty(0) if former is None else former.slip
        found = Complementarity(np.zeros(len(gap)), gap, np.zeros(len(gap), dtype=np.int8), 0, slip)
        if self.contact and r.contact_laws.touched(gap[: r.gaps]).any():
            found = solve_contact(self.flexibility, gap, r.contact_laws, r.friction, former)
        q = (loads + rows.T @ found.force) / self.stiffness
        pressed = np.abs(rows).T @ np.abs(found.force)
        # of each motion by itself: other loads may be far larger
        rounding = ROUND_OFF * (np.abs(self.pushes) @ np.abs(amplitudes) + pressed)
        held = np.maximum(HELD * (np.abs(loads) + pressed), rounding)
        loose = self.rigid & (np.abs(self.stiffness * q) > held)
        if loose.any():
            raise failed_solve(
                f"equilibrium: the loads push the rigid-body motion of mode {int(np.argmax(loose)) + 1}, "
                "which nothing holds: there is no place at rest; hold the structure, or leave the loads out"
            )
        return q, found
