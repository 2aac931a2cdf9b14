"""What modes that a reduced model leaves out add to a periodic motion: the inertia of their flexibility."""

from __future__ import annotations

import numpy as np

from .reduced_model import ReducedModel

# Left-out modes stand together at so many times the highest one that is kept.
BEYOND = 1.5


class LeftOut:
    """Lines that they add to gaps and displacements of periodic motions.

    Below 0.7 of where they stand they follow as one oscillator does, above they move nothing. Of beams with
    cracks and rods with stops the error is at most 2.5 times what this tells; with contact forces up to 0.7
    of the highest mode alone it was up to a hundred times as much, as blows have more.

    Parameters
    ----------
    reduced : ReducedModel
    rows : int
        Contact rows that act, the first ones.
    omega : (k,) array
        Angular frequencies of the lines, rad/s.
    """

    def __init__(self, reduced: ReducedModel, rows: int, omega: np.ndarray):
        r, own = reduced, reduced.massless
        assert own is not None
        self._gap = r.gap.contact[:rows, :rows] - own[:rows, :rows], r.gap.loads[:rows]
        self._points = r.points.contact[..., :rows], r.points.loads
        top = int(np.argmax(r.omega))
        relative = omega / max(BEYOND * r.omega[top], 1e-300)
        # what damps the highest mode goes on beyond it as with Rayleigh's b
        lag = relative**2 - 2j * BEYOND * r.damping[top] * relative
        self._shares = np.where(relative**2 < 0.5, lag / (1.0 - lag), -1.0)

    def gaps(self, force: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """(k, rows) lines of the gaps, of those of contact forces (k, rows) and loads (k, l)."""
        return self._of(self._gap, force, loads)

    def displacements(self, force: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """(k, points, xy) lines of the named points' displacements."""
        return self._of(self._points, force, loads)

    def _of(self, parts: tuple[np.ndarray, np.ndarray], force: np.ndarray, loads: np.ndarray) -> np.ndarray:
        found = np.tensordot(force, parts[0], (1, -1)) + np.tensordot(loads, parts[1], (1, -1))
        result: np.ndarray = self._shares.reshape(-1, *[1] * (found.ndim - 1)) * found
        return result
