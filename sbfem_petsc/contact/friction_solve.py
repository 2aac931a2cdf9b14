"""Contact with friction, solved: by exchanges of states, and by Lemke's method.

States are exchanged as those of the normal rows are (`complementarity`), each set a linear system that the
bound's dependence on the pressure makes unsymmetric. Where sets repeat, sweeps of Gauss-Seidel lead to other
ones: compiled, in `rubbing`. Where these do not help Lemke's method takes over, here: the problem in
pressures, friction of either sense and speeds of slip is copositive for every mu >= 0, so that it ends in a
solution (Stewart and Trinkle 1996) wherever W is positive definite. For large mu there may be several: it is
then one of them. Who imports this imports numba, which bodies at rest do without where nothing rubs.
"""

from __future__ import annotations

import numpy as np

from ..errors import SolveError, on_all_ranks
from .complementarity import Complementarity
from .friction import AGAINST, ALONG, STICKS, Friction, Memory
from .held_rows import Rubbing, Sets, empty_sets, rubbing_of
from .law import FREE, PRESSED, PULLED, RowLaws
from .rubbing import Problem, rubbing_forces

# Smallest pivot of Lemke's tableau, whose rows are scaled.
_LEAST = 1e-11


def solve_friction(
    flexibility: np.ndarray,
    free_gap: np.ndarray,
    laws: RowLaws,
    friction: Friction,
    memory: Memory,
    sets: Sets | None = None,
) -> Complementarity:
    """Contact with friction of normal rows (c) and tangential ones (k) behind them, by the compiled exchanges
    of states (`rubbing`), and where these find none from the states of Lemke's method.

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
    for _ in range(2):  # without the rows that wait, and with them
        if exchanges >= 0:
            break
        sets.members[-1] = -1
        if not sets.waits.any():  # it is told where rows land
            before[:count], before[count:] = 0.0, sets.kept[count:]
        basic = pivoted(flexibility, free_gap, laws, rubbing, before[count:], sets.waits[:count] != 0)
        if basic is None:
            break
        state[:] = basic
        exchanges = rubbing_forces(problem)
    if exchanges < 0:
        sets.members[-1] = -1
        raise on_all_ranks(
            SolveError(
                "friction: neither exchanges of states and Gauss-Seidel nor Lemke's method ended for "
                f"{count} contact rows with coefficients up to {friction.static.max():g}; take smaller load "
                "steps or smaller coefficients"
            )
        )
    gap, kept = flexibility @ force + free_gap, sets.kept[count:].copy()
    slip = np.where(state[count:] == STICKS, kept, gap[count:])
    gap = np.append(laws.placed(state[:count], gap[:count]), slip)
    return Complementarity(force, gap, state, exchanges + 1, kept)


def pivoted(
    flexibility: np.ndarray,
    free_gap: np.ndarray,
    laws: RowLaws,
    rubbing: Rubbing,
    slip: np.ndarray,
    apart: np.ndarray,
) -> np.ndarray | None:
    """States (c + k,) after slips (k,) by Lemke's method, of some normal rows (c,) FREE: unknowns are what
    presses rows, what pulls those that may be pulled, friction along and against t, and speeds of slip, under
    what holds rows that are never free. None where it does not end.
    """
    c, table, own = len(laws), laws.table, np.diag(flexibility)
    with np.errstate(divide="ignore"):
        weight = np.where(own > 0.0, 1.0 / np.sqrt(own), 0.0)
    moves, held = (own[:c] > 0.0) & ~laws.fixed & ~apart, np.flatnonzero(laws.fixed & (own[:c] > 0.0))
    pressed, pulled = np.flatnonzero(moves), np.flatnonzero(moves & np.isfinite(table.most[FREE]))
    holding = np.linalg.lstsq(flexibility[np.ix_(held, held)], flexibility[held], rcond=None)[0].T
    w = flexibility - holding @ flexibility[held]
    free = free_gap + holding @ (table.place[PRESSED, held] - free_gap[held])
    rubs = np.flatnonzero((rubbing.static > 0.0) & ~apart[rubbing.rows])
    rows = np.concatenate([pressed, pulled, c + rubs, c + rubs])
    sign = np.repeat([1.0, -1.0, 1.0, -1.0], [len(pressed), len(pulled), len(rubs), len(rubs)])
    place = np.concatenate([table.place[PRESSED, pressed], table.place[PULLED, pulled], *[slip[rubs]] * 2])
    size, count = len(rows), len(rubs)
    first, every = size - 2 * count, np.arange(count)
    scale = np.concatenate([weight[rows], 1.0 / weight[c + rubs]])
    matrix, right = np.zeros((size + count, size + count)), np.zeros(size + count)
    matrix[:size, :size] = np.outer(sign, sign) * w[np.ix_(rows, rows)]
    right[:size] = sign * (free[rows] - place)
    for part in (first + every, first + count + every):
        matrix[part, size + every], matrix[size + every, part] = 1.0, -1.0
    matrix[size + every, np.searchsorted(pressed, rubbing.rows[rubs])] = rubbing.kinetic[rubs]
    basic = _lemke(scale[:, None] * matrix * scale, scale * right)
    if basic is None:
        return None
    state = np.zeros(len(free_gap), dtype=np.int8)
    state[pulled[basic[len(pressed) : first]]] = PULLED
    state[np.append(pressed[basic[: len(pressed)]], held)] = PRESSED
    along, against, slips = basic[first : first + count], basic[first + count : size], basic[size:]
    # of friction of both senses, which takes up the whole bound, the difference holds a row that sticks
    slides = slips & ~(along & against)
    sliding = np.where(slides, np.where(along, ALONG, AGAINST), STICKS)
    state[c + rubs] = np.where(state[rubbing.rows[rubs]] == FREE, FREE, sliding)
    return state


def _lemke(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Which unknowns z of w = M z + q, 0 <= w _|_ z >= 0, are basic at a solution; None without one.

    Ties are broken lexicographically by the columns of w, which are the inverse of the basis.
    """
    n = len(right)
    basis, artificial = np.arange(n), 2 * n
    right = right / max(np.abs(right).max(initial=0.0), 1e-300)
    table = np.concatenate([np.eye(n), -matrix, -np.ones((n, 1)), right[:, None]], axis=1)
    if not (right < 0.0).any():
        return np.zeros(n, dtype=bool)
    entering, row = artificial, int(np.argmin(right))
    for _ in range(100 + 50 * n):
        table[row] /= table[row, entering]
        column = table[:, entering].copy()
        column[row] = 0.0
        table -= np.outer(column, table[row])
        leaving, basis[row] = basis[row], entering
        if leaving == artificial:
            result = np.zeros(n, dtype=bool)
            result[basis[basis >= n] - n] = True
            return result
        entering = leaving + n if leaving < n else leaving - n
        found = _leaving(table, entering, basis, artificial)
        if found is None:
            return None
        row = found
    return None


def _leaving(table: np.ndarray, entering: int, basis: np.ndarray, artificial: int) -> int | None:
    """Row of the unknown that leaves the basis: that of the lexicographically least ratio."""
    rows = np.flatnonzero(table[:, entering] > _LEAST)
    if not len(rows):
        return None
    for column in (-1, *range(len(table))):
        ratio = table[rows, column] / table[rows, entering]
        rows = rows[ratio <= ratio.min() + 1e-13 * max(1.0, abs(ratio.min()))]
        if (last := rows[basis[rows] == artificial]).size and column == -1:
            return int(last[0])
        if len(rows) == 1:
            break
    return int(rows[0])
