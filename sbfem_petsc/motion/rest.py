"""Where a reduced model rests under constant loads."""

from __future__ import annotations

import numpy as np

from ..contact.complementarity import Complementarity
from ..contact.friction import solve_contact
from ..errors import failed_solve
from ..reduction.reduced_model import ReducedModel

# A rigid-body motion is held by contact alone. A spring stands for nothing that gives the mode this share of
# the lowest frequency; where it carries more than this share of the forces, nothing holds the motion. Loads
# below this share of the largest one are rounding.
SOFT, HELD, ROUND_OFF = 1e-4, 0.1, 1e-12


def at_rest(
    reduced: ReducedModel, amplitudes: np.ndarray, contact: bool = True
) -> tuple[np.ndarray, Complementarity]:
    """Modal coordinates (m,) of the static equilibrium, those of rigid-body motions to 1e-7, and contact.

    Parameters
    ----------
    reduced : ReducedModel
    amplitudes : (l,) array
        Of the unit loads.
    contact : bool
        False: faces may overlap.

    Raises
    ------
    SolveError
        If the loads push a rigid-body motion that contact does not hold.
    """
    r = reduced
    rigid = r.omega == 0.0
    stiffness = np.where(rigid, SOFT * min(r.omega[~rigid], default=1.0), r.omega) ** 2
    loads = r.load_modes @ amplitudes
    rows = r.gap.modes if contact else r.gap.modes[:0]
    count = len(rows)
    found = solve_contact(
        (rows / stiffness) @ rows.T + r.gap.contact[:count, :count],
        (r.gap.loads @ amplitudes + r.initial_gap)[:count] + (rows / stiffness) @ loads,
        r.contact_laws if contact else r.contact_laws.first(0),
        r.friction if contact else None,
    )
    q = (loads + rows.T @ found.force) / stiffness
    forces = np.abs(loads) + np.abs(rows).T @ np.abs(found.force)
    loose = rigid & (np.abs(stiffness * q) > np.maximum(HELD * forces, ROUND_OFF * forces.max(initial=0.0)))
    if loose.any():
        raise failed_solve(
            f"equilibrium: the loads push the rigid-body motion of mode {int(np.argmax(loose)) + 1}, "
            "which nothing holds: there is no place at rest; hold the structure, or leave the loads out"
        )
    return q, found
