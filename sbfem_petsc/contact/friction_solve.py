"""Contact with friction, solved by kernels (`rubbing`). Who imports this imports numba, which bodies at rest
do without where nothing rubs.
"""

from __future__ import annotations

import numpy as np

from ..errors import failed_solve
from .complementarity import Complementarity
from .friction import STICKS, Friction, Memory, rubbing_of
from .law import RowLaws
from .problem import Problem, Sets, empty_sets
from .rubbing import rubbing_forces


def solve_friction(
    flexibility: np.ndarray,
    free_gap: np.ndarray,
    laws: RowLaws,
    friction: Friction,
    memory: Memory,
    sets: Sets | None = None,
) -> Complementarity:
    """Contact with friction of normal rows (c) and tangential ones (k) behind them, see `rubbing`.

    Parameters
    ----------
    flexibility : (c + k, c + k) array
        Symmetric positive definite but for rows of zeros, which take no part, m/N.
    free_gap : (c + k,) array
        Gaps and slips without contact forces, m.
    laws : RowLaws
        Of the normal rows; those that rub are unilateral.
    friction : Friction
    memory : Memory
        Its states are the first guess.
    sets : Sets, optional
        Of the problem before, of the same flexibility.

    Raises
    ------
    SolveError
        If neither method ends.
    """
    count, force = len(laws), np.zeros(len(free_gap))
    flexibility, rubbing = np.ascontiguousarray(flexibility), rubbing_of(friction, flexibility, count)
    sets = empty_sets(len(free_gap)) if sets is None else sets
    state, before = np.append(memory.normal, memory.tangential), np.append(memory.gap, memory.slip)
    problem = Problem(flexibility, free_gap, before, laws.table, rubbing, state, sets, force)
    exchanges = rubbing_forces(problem)
    if exchanges < 0:
        raise failed_solve(
            "friction: neither exchanges of states nor Lemke's method ended for "
            f"{count} contact rows with coefficients up to {friction.static.max():g}; take smaller load "
            "steps or smaller coefficients"
        )
    gap, kept = flexibility @ force + free_gap, sets.kept[count:].copy()
    slip = np.where(state[count:] == STICKS, kept, gap[count:])
    gap = np.append(laws.placed(state[:count], gap[:count]), slip)
    return Complementarity(force, gap, state, exchanges + 1, kept)
