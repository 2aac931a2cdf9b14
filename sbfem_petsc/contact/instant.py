"""Contact at an instant, of faces that rub or do not."""

from __future__ import annotations

import numpy as np

from .complementarity import Complementarity, solve_complementarity
from .friction import Friction, Memory
from .law import RowLaws


def solve_contact(
    flexibility: np.ndarray,
    free_gap: np.ndarray,
    laws: RowLaws,
    friction: Friction | None,
    memory: Memory | None = None,
) -> Complementarity:
    """Contact of rows without or with friction, then from a memory; default: of faces never loaded."""
    if friction is None:
        return solve_complementarity(flexibility, free_gap, laws)
    from .friction_solve import solve_friction  # with it numba, which others at rest do without

    memory = Memory.none(laws, friction) if memory is None else memory
    return solve_friction(flexibility, free_gap, laws, friction, memory)
