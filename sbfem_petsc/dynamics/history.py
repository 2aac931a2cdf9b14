"""What every history in modal coordinates can be asked: motion of points, gaps, forces, stress intensity
factors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import UnknownName
from ..reduction.reduced_model import Reduction


@dataclass(frozen=True, eq=False)
class ModalHistory:
    """Instants of a reduced model's motion.

    Attributes
    ----------
    time : (n,) array
        s.
    modal_displacement, modal_velocity : (n, m) arrays
        q and its derivative.
    amplitudes : (n, loads) array
        Values of the load signals.
    contact_force : (n, pairs) array
        N, compression positive.
    reduction : Reduction
    """

    time: np.ndarray
    modal_displacement: np.ndarray
    modal_velocity: np.ndarray
    amplitudes: np.ndarray
    contact_force: np.ndarray
    reduction: Reduction

    @property
    def modal_acceleration(self) -> np.ndarray:
        """(n, m): second derivative of q, from the equations of motion."""
        r = self.reduction
        return (
            self.amplitudes @ r.load_modes.T
            + self.contact_force @ r.gap_modes
            - 2.0 * r.damping * r.omega * self.modal_velocity
            - r.omega**2 * self.modal_displacement
        )

    @property
    def contact_resultant(self) -> np.ndarray:
        """(n,): sum of the contact forces, N."""
        return self.contact_force.sum(axis=1)

    @property
    def gap(self) -> np.ndarray:
        """(n, pairs): gaps, m."""
        r = self.reduction
        return (
            self.modal_displacement @ r.gap_modes.T
            + self.contact_force @ r.gap_flexibility.T
            + self.amplitudes @ r.gap_loads.T
            + r.initial_gap
        )

    def displacement(self, point: str) -> np.ndarray:
        """(n, 2): displacement of a named point, m."""
        k, r = self._index(point), self.reduction
        return (
            self.modal_displacement @ r.sensor_modes[k].T
            + self.amplitudes @ r.sensor_loads[k].T
            + self.contact_force @ r.sensor_pairs[k].T
        )

    def velocity(self, point: str) -> np.ndarray:
        """(n, 2): velocity of a named point, m/s, of the modes (the residual flexibility moves without
        inertia and is left out).
        """
        return self.modal_velocity @ self.reduction.sensor_modes[self._index(point)].T

    def acceleration(self, point: str) -> np.ndarray:
        """(n, 2): acceleration of a named point, m/s^2, of the modes (see `velocity`)."""
        return self.modal_acceleration @ self.reduction.sensor_modes[self._index(point)].T

    def stress_intensity(self, crack: str = "crack1") -> np.ndarray:
        """(n, 2): K_I and K_II of a tip, Pa m^(1/2)."""
        r = self.reduction
        if crack not in r.tips:
            raise UnknownName(
                f"crack {crack!r} does not exist; the model has {', '.join(map(repr, r.tips)) or 'none'}"
            )
        k = r.tips.index(crack)
        return (
            self.modal_displacement @ r.tip_modes[k].T
            + self.amplitudes @ r.tip_loads[k].T
            + self.contact_force @ r.tip_pairs[k].T
        )

    def _index(self, point: str) -> int:
        if point not in self.reduction.points:
            raise UnknownName(
                f"point {point!r} does not exist; the model has {', '.join(map(repr, self.reduction.points))}"
            )
        return self.reduction.points.index(point)
