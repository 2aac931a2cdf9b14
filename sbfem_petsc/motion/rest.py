"""Where a reduced model rests under constant loads."""

from __future__ import annotations

import numpy as np

from ..contact.complementarity import Complementarity
from ..contact.friction import Memory
from ..contact.instant import solve_contact
from ..errors import failed_solve
from ..reduction.reduced_model import ReducedModel

# A rigid-body motion is held by contact alone. A spring stands for nothing that gives the mode this share of
# the lowest frequency; where it carries more than this share of the forces, nothing holds the motion. Loads
# below this share of the largest one are rounding.
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
        self.rigid, rows = omega == 0.0, reduced.gap.modes
        soft = SOFT * min(omega[~self.rigid], default=1.0)
        self.stiffness = np.where(self.rigid, soft, omega) ** 2
        self.flexibility = (rows / self.stiffness) @ rows.T + reduced.gap.contact

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
        r, rows = self.reduced, self.reduced.gap.modes
        loads = r.load_modes @ amplitudes
        gap = (rows / self.stiffness) @ loads + r.gap.loads @ amplitudes + r.initial_gap
        slip = np.empty(0) if former is None else former.slip
        found = Complementarity(np.zeros(len(gap)), gap, np.zeros(len(gap), dtype=np.int8), 0, slip)
        if self.contact and r.contact_laws.touched(gap[: r.gaps]).any():
            found = solve_contact(self.flexibility, gap, r.contact_laws, r.friction, former)
        q = (loads + rows.T @ found.force) / self.stiffness
        forces = np.abs(loads) + np.abs(rows).T @ np.abs(found.force)
        held = np.maximum(HELD * forces, ROUND_OFF * forces.max(initial=0.0))
        loose = self.rigid & (np.abs(self.stiffness * q) > held)
        if loose.any():
            raise failed_solve(
                f"equilibrium: the loads push the rigid-body motion of mode {int(np.argmax(loose)) + 1}, "
                "which nothing holds: there is no place at rest; hold the structure, or leave the loads out"
            )
        return q, found
