"""Loops that kernels share, and how kernels are written.

They are plain loops over scalars of contiguous arrays that are given: array expressions, slices,
linear algebra and new arrays in them would take seconds to compile.
"""

from __future__ import annotations

import numpy as np

from .compiled import inner_loops, inner_sums
from .law import FREE, PRESSED, PULLED, Table


@inner_sums
def products(rows: np.ndarray, vector: np.ndarray, count: int, width: int, result: np.ndarray) -> None:
    """The first `count` rows times a vector, as far as a width."""
    for k in range(count):
        total = 0.0
        for i in range(width):
            total += rows[k, i] * vector[i]
        result[k] = total


@inner_loops
def add_rows(
    rows: np.ndarray, chosen: np.ndarray, factors: np.ndarray, count: int, width: int, result: np.ndarray
) -> None:
    """Add `count` chosen rows, as far as a width, each times its factor: four at a time, so that the result
    is read and written less often.
    """
    for k in range(0, count - 3, 4):
        one, two, three, four = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
        a, b, c, d = chosen[k], chosen[k + 1], chosen[k + 2], chosen[k + 3]
        for i in range(width):
            result[i] = (
                result[i] + one * rows[a, i] + two * rows[b, i] + three * rows[c, i] + four * rows[d, i]
            )
    for k in range(count - count % 4, count):
        one, a = factors[k], chosen[k]
        for i in range(width):
            result[i] += one * rows[a, i]


@inner_loops
def caught(laws: Table, row: int, gap: float) -> int:
    """State that a free row with some gap goes on to."""
    if gap < laws.least[FREE, row]:
        return PRESSED
    return PULLED if gap > laws.most[FREE, row] else FREE
