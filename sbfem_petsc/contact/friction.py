"""Coulomb friction of some contact rows: a tangential row beside each normal one that rubs.

The rows obey (gap, slip) = W (n, t) + free, n pressure and t friction. With the slip s_old of the state
before, a tangential row is in one of four states: apart, t = 0; sticking, s = s_old and |t| <= mu n; slipping
either way, t = +-mu n against the change of s. States are exchanged as those of the normal rows are
(`complementarity`), each set a linear system that the bound's dependence on n makes unsymmetric. Where sets
repeat, sweeps of Gauss-Seidel lead to other ones, and where these do not help Lemke's method takes over: the
problem in pressures, friction of either sense and speeds of slip is copositive for every mu >= 0, so that it
ends in a solution (Stewart and Trinkle 1996) wherever W is positive definite. For large mu there may be
several: it is then one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import SolveError, on_all_ranks
from ..record.record import Record, described, quantity
from .complementarity import Complementarity, solve_complementarity
from .law import FREE, PRESSED, PULLED, ROUND_OFF, ContactLaw, RowLaws

# States of a tangential row: apart as FREE, sticking, slipping under friction along t and against it.
STICKS, ALONG, AGAINST = 1, 2, 3
# Here and in kernels (`rubbing`): exchanges before other methods; rounding of forces, of the largest.
MAXIMUM, ROUNDING = 40, 1e-12
# Sweeps of Gauss-Seidel before the next exchanges, and how often.
SWEEPS, ROUNDS = 20, 20
# What held rows may miss of their places, of what forces move them.
MISSED = 1e-6
# How often it is told where rows land, from the states that this leads to.
LANDINGS = 3
# Smallest pivot of Lemke's tableau, whose rows are scaled.
_LEAST = 1e-11


@described
class Friction(Record):
    """The tangential rows, which stand behind the normal ones."""

    rows: np.ndarray = quantity(
        "1", "number of the normal row of each", "tangential_row", kinds="iu", least=0
    )
    kinetic: np.ndarray = quantity("1", "coefficients of rows that slip", "tangential_row", least=0.0)
    static: np.ndarray = quantity("1", "coefficients up to which rows stick", "tangential_row", least=0.0)

    @classmethod
    def of(cls, laws: Sequence[ContactLaw], rows: np.ndarray) -> Friction:
        """Of normal rows with these laws, those that rub and others."""
        found = [[getattr(laws[k], name, 0.0) for k in rows] for name in ("friction", "static_friction")]
        return cls(rows, *np.array(found, dtype=float).reshape(2, len(rows)))

    @property
    def falls(self) -> bool:
        """Whether it falls where a slip begins."""
        return bool((self.static > self.kinetic).any())

    def same(self, other: Friction | None) -> bool:
        """Whether these are the same rows and coefficients."""
        mine = (self.rows, self.kinetic, self.static)
        return other is not None and all(map(np.array_equal, mine, (other.rows, other.kinetic, other.static)))


def refuse_friction(owner: str, rubs: str, why: str) -> None:
    """Raise ValueError, on all ranks, for what rubs, in an analysis with a reason why it cannot."""
    raise on_all_ranks(
        ValueError(
            f"{owner} {why}, and {rubs}; use transient, periodic, quasi_periodic, swept_response, "
            "frequency_response or load_response in modes, static or load_history, or contact_laws = "
            "Unilateral()"
        )
    )


class Memory(NamedTuple):
    """What a state leaves to the next one.

    Attributes
    ----------
    slip, force : (k,) arrays
        Of the tangential rows, m and N.
    pressing : (c,) array
        Of the normal rows, N.
    normal, tangential : int8 arrays
        States.
    gap : (c,) array
        Of the normal rows, m: where those that are apart land; zero where the next state is one of the same
        instant, or the first one.
    kept : (k,) array
        Slips that the tangential rows have stuck to or slid from, m.
    """

    slip: np.ndarray
    force: np.ndarray
    pressing: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray
    gap: np.ndarray
    kept: np.ndarray

    @classmethod
    def none(cls, laws: RowLaws, friction: Friction) -> Memory:
        """Of faces that have never been loaded."""
        normal, along = np.zeros(len(laws)), np.zeros(len(friction.rows))
        return cls(along, along, normal, normal.astype(np.int8), along.astype(np.int8), normal, along)

    def lost_since(self, former: Memory, friction: Friction) -> float:
        """Work lost to friction on the way from a former state, J: each row slips one way, against a friction
        that goes linearly from what the former pressure allows, or from what held it if that is more, to what
        it is now. Exact where the pressure stays or changes with the slip, also where the slip turns.
        """
        allowed = friction.kinetic * np.maximum(former.pressing[friction.rows], 0.0)
        begun = np.maximum(allowed, np.abs(former.force))
        return float((0.5 * (begun + np.abs(self.force)) * np.abs(self.slip - self.kept)).sum())

    @classmethod
    def of(cls, found: Complementarity, count: int) -> Memory:
        """Of a solution with so many normal rows."""
        state = found.state
        normal, along, gap = found.force[:count], found.force[count:], found.gap
        return cls(gap[count:], along, normal, state[:count], state[count:], gap[:count], found.kept)


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
    memory = Memory.none(laws, friction) if memory is None else memory
    return solve_friction(flexibility, free_gap, laws, friction, memory)


def solve_friction(
    flexibility: np.ndarray, free_gap: np.ndarray, laws: RowLaws, friction: Friction, memory: Memory
) -> Complementarity:
    """Contact with friction of normal rows (c) and tangential ones (k) behind them.

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

    Raises
    ------
    SolveError
        If neither method ends.
    """
    problem = _Problem(flexibility, free_gap, laws, friction, memory.slip)
    states, exchanges = (laws.following(memory.normal, *problem.nothing), memory.tangential), 0
    for left in reversed(range(LANDINGS + 1)):
        (force, gap, state), more = problem.solved(*problem.joined(*states))
        exchanges += more
        landed = problem.landed(memory, state) if left else None
        if landed is None:
            break
        states = landed
    return Complementarity(force, gap, state, exchanges, problem.slip)


class _Problem:
    """One problem; arguments are those of `solve_friction`, with the slips (k,) of the state before."""

    def __init__(
        self,
        flexibility: np.ndarray,
        free_gap: np.ndarray,
        laws: RowLaws,
        friction: Friction,
        slip: np.ndarray,
    ):
        self.w, self.free, self.laws, self.friction, self.slip = flexibility, free_gap, laws, friction, slip
        self.count = len(laws)
        moves = np.diag(flexibility) > 0.0
        self.flexible = moves[: self.count]
        self.rubs = moves[self.count :] & self.flexible[friction.rows] & (friction.static > 0.0)
        with np.errstate(divide="ignore"):
            self.weight = np.where(moves, 1.0 / np.sqrt(np.diag(flexibility)), 0.0)
        self.nothing = np.zeros(self.count), free_gap[: self.count]
        self._lands = np.zeros(len(slip), dtype=bool)

    def solved(
        self, normal: np.ndarray, tangential: np.ndarray
    ) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], int]:
        """Forces, gaps and states that fit together, from some, and the exchanges."""
        found, exchanges = self.exchanged(normal, tangential)
        force = np.zeros(len(self.free))
        for _ in range(ROUNDS):
            if found is not None:
                break
            found, more = self.exchanged(*self.swept(force))
            exchanges += more
        if found is None and (states := self.pivoted()) is not None:
            found, more = self.exchanged(*states)
            exchanges += more
        if found is None:
            raise on_all_ranks(
                SolveError(
                    f"friction: neither exchanges of states nor Gauss-Seidel or Lemke's method ended for "
                    f"{self.count} contact rows with coefficients up to {self.friction.static.max():g}; take "
                    "smaller load steps or smaller coefficients"
                )
            )
        return found, exchanges

    def landed(self, memory: Memory, state: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """States to go on from where rows that were apart touch, None where what they keep is told: gap and
        slip go linearly from those before to those without the forces of these rows, and stick where they
        land.
        """
        rows, (normal, tangential) = self.friction.rows, np.split(state, [self.count])
        lands = self.rubs & (memory.normal[rows] == FREE) & (memory.gap[rows] > 0.0) & (normal[rows] != FREE)
        apart = normal.copy()
        apart[rows[lands]] = FREE
        found = self._solved(apart, np.where(lands, FREE, tangential)) if lands.any() else None
        if found is None:
            return None
        gap, former = found[1], self.slip
        share = memory.gap[rows] / np.maximum(memory.gap[rows] - np.minimum(gap[rows], 0.0), 1e-300)
        self.slip = np.where(lands, memory.slip + share * (gap[self.count :] - memory.slip), memory.slip)
        if np.array_equal(self.slip, former):
            return None
        begins, self._lands = lands & ~self._lands, lands
        return normal, np.where(begins, STICKS, tangential)

    def joined(self, normal: np.ndarray, tangential: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States that fit together: what has just closed begins by sticking."""
        normal = np.where(self.flexible, normal, FREE).astype(np.int8)
        closed = self.rubs & (normal[self.friction.rows] != FREE)
        begun = np.where(tangential == FREE, STICKS, tangential)
        return normal, np.where(closed, begun, FREE).astype(np.int8)

    def _solved(self, normal: np.ndarray, tangential: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Forces and gaps of all rows in these states; None where they are not determined."""
        c, rows = self.count, self.friction.rows
        pull = self.friction.kinetic * ((tangential == ALONG) * 1.0 - (tangential == AGAINST))
        slipping, sticking = np.flatnonzero(pull), np.flatnonzero(tangential == STICKS)
        pressing = self.w[:, :c].copy()
        pressing[:, rows[slipping]] += pull[slipping] * self.w[:, c + slipping]
        held = np.flatnonzero(normal != FREE)
        index = np.concatenate([held, c + sticking])
        kept = np.concatenate([self.laws.places(normal)[held], self.slip[sticking]])
        force, weight = np.zeros(len(self.free)), self.weight[index]
        matrix = np.concatenate([pressing[index][:, held], self.w[np.ix_(index, c + sticking)]], axis=1)
        try:
            right = weight * (kept - self.free[index])
            force[index] = weight * np.linalg.solve(weight[:, None] * matrix * weight, right)
        except np.linalg.LinAlgError:
            return None
        force[c + slipping] = pull[slipping] * force[rows[slipping]]
        gap = self.w @ force + self.free
        # rows of less rank than there are held ones, without a common solution: their forces are rounding
        if np.abs(weight * (gap[index] - kept)).max(initial=0.0) > MISSED * np.abs(right).max(initial=0.0):
            return None
        gap[index] = kept
        return force, gap

    def _following(
        self, states: tuple[np.ndarray, np.ndarray], force: np.ndarray, gap: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """States that rows go on to. What both sticking and slipping meet by rounding stays as it is."""
        (normal, tangential), c = states, self.count
        pull = ROUNDING * np.abs(force).max(initial=0.0)
        rounding = 10.0 * ROUND_OFF * (np.abs(self.w) @ np.abs(force) + np.abs(self.free))
        following = self.laws.following(normal, force[:c], gap[:c], pull, rounding[:c])
        bound = self.friction.static * np.maximum(force[self.friction.rows], 0.0) + pull
        friction, moved = force[c:], gap[c:] - self.slip
        begins = np.where(friction > bound, ALONG, np.where(friction < -bound, AGAINST, STICKS))
        off = np.where(tangential == ALONG, moved, -moved) > rounding[c:]
        slipping = np.where(off, STICKS, tangential)
        return self.joined(following, np.where(tangential == STICKS, begins, slipping))

    def exchanged(
        self, normal: np.ndarray, tangential: np.ndarray
    ) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray] | None, int]:
        """Forces, gaps and states, None where sets repeat, and the exchanges."""
        states, seen = (normal, tangential), set[bytes]()
        for exchange in range(1, MAXIMUM + 1):
            found = self._solved(*states)
            if found is None:
                return None, exchange
            former, states = states, self._following(states, *found)
            if all(map(np.array_equal, former, states)):
                force, gap = found
                force[: self.count] = self.laws.admissible(states[0], force[: self.count])
                return (force, gap, np.concatenate(states)), exchange
            key = b"".join(state.tobytes() for state in states)
            if key in seen:
                break
            seen.add(key)
        return None, exchange

    def swept(self, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States after sweeps of nonsmooth Gauss-Seidel from forces, which are changed: each row, with its
        tangential one, exactly under the forces of the others.
        """
        c, w, table = self.count, self.w, self.laws.table
        beside = dict(zip(self.friction.rows[self.rubs], np.flatnonzero(self.rubs)))
        normal, tangential = np.zeros(c, dtype=np.int8), np.zeros(len(self.slip), dtype=np.int8)
        gap = w @ force + self.free
        for _ in range(SWEEPS):
            for i in np.flatnonzero(self.flexible):
                k = beside.get(i)
                rows = [i] if k is None else [i, c + k]
                own = w[np.ix_(rows, rows)]
                rest = gap[rows] - own @ force[rows]
                if k is not None:
                    rest[1] -= self.slip[k]
                    bounds = float(self.friction.kinetic[k]), float(self.friction.static[k])
                    new, tangential[k] = _alone(own, rest, *bounds)
                    normal[i] = PRESSED if tangential[k] else FREE
                elif rest[0] < table.least[FREE, i]:
                    new, normal[i] = (table.place[PRESSED, i] - rest) / own[0], PRESSED
                elif rest[0] > table.most[FREE, i]:
                    new, normal[i] = (table.place[PULLED, i] - rest) / own[0], PULLED
                else:
                    new, normal[i] = np.zeros(1), FREE
                gap += w[:, rows] @ (new - force[rows])
                force[rows] = new
        return normal, tangential

    def pivoted(self) -> tuple[np.ndarray, np.ndarray] | None:
        """States by Lemke's method: unknowns are what presses rows, what pulls those that may be pulled,
        friction along and against t, and speeds of slip, under what holds rows that are never free.
        """
        c, table, fixed = self.count, self.laws.table, self.laws.fixed & self.flexible
        moves, held = self.flexible & ~fixed, np.flatnonzero(fixed)
        pressed, pulled = np.flatnonzero(moves), np.flatnonzero(moves & np.isfinite(table.most[FREE]))
        holding = np.linalg.lstsq(self.w[np.ix_(held, held)], self.w[held], rcond=None)[0].T
        w = self.w - holding @ self.w[held]
        free = self.free + holding @ (table.place[PRESSED, held] - self.free[held])
        rubs = np.flatnonzero(self.rubs)
        rows = np.concatenate([pressed, pulled, c + rubs, c + rubs])
        sign = np.repeat([1.0, -1.0, 1.0, -1.0], [len(pressed), len(pulled), len(rubs), len(rubs)])
        along = self.slip[rubs]
        place = np.concatenate([table.place[PRESSED, pressed], table.place[PULLED, pulled], along, along])
        size, count = len(rows), len(rubs)
        first = size - 2 * count
        scale = np.concatenate([self.weight[rows], 1.0 / self.weight[c + rubs]])
        matrix, right = np.zeros((size + count, size + count)), np.zeros(size + count)
        matrix[:size, :size] = np.outer(sign, sign) * w[np.ix_(rows, rows)]
        right[:size] = sign * (free[rows] - place)
        every = np.arange(count)
        for part in (first + every, first + count + every):
            matrix[part, size + every], matrix[size + every, part] = 1.0, -1.0
        at = np.searchsorted(pressed, self.friction.rows[rubs])
        matrix[size + every, at] = self.friction.kinetic[rubs]
        basic = _lemke(scale[:, None] * matrix * scale, scale * right)
        if basic is None:
            return None
        normal, tangential = np.zeros(c, dtype=np.int8), np.zeros(len(self.slip), dtype=np.int8)
        normal[pulled[basic[len(pressed) : first]]] = PULLED
        normal[pressed[basic[: len(pressed)]]] = PRESSED
        normal[fixed] = PRESSED
        along, slips = basic[first : first + count], basic[size:]
        tangential[rubs] = np.where(slips, np.where(along, ALONG, AGAINST), STICKS)
        return self.joined(normal, tangential)


def _alone(own: np.ndarray, rest: np.ndarray, kinetic: float, static: float) -> tuple[np.ndarray, int]:
    """Pressure and friction of one pair of rows with flexibility `own` whose gap and change of slip are
    `rest` without them, and the state of the second.
    """
    if rest[0] >= 0.0:
        return np.zeros(2), FREE
    (a, b), (_, d) = own
    determinant = a * d - b * b
    pressure, along = (b * rest[1] - d * rest[0]), (b * rest[0] - a * rest[1])
    if determinant > 0.0 and abs(along) <= static * pressure:
        return np.array([pressure, along]) / determinant, STICKS
    sign = 1.0 if along > 0.0 else -1.0
    # beyond the coefficient that a pair alone has one solution for, as if its rows were independent
    pressure = -rest[0] / max(a + sign * kinetic * b, 0.1 * a)
    return np.array([pressure, sign * kinetic * pressure]), ALONG if sign > 0.0 else AGAINST


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
