"""Exact derivative of the time steps (`marching.march`) with the contact sets of a history.

Where no row changes sides a step is linear: with the set A of rows that keep their gaps at its end, the thin
contact forces p = U^T force obey dp = -K (V^T dq + ...) with the position dq before they act and
K = U_A^T W_AA^-1 U_A. With K_R = U_A^T R_AA^-1 U_A, which knows nothing of the step's length and is kept for
every set that has occurred, and M = V^T diag(cq) V, K = (K_R^-1 + M)^-1.

The modal forces of contact are then -B B^T dq. The columns of B are few: what moves the state by less than
rounding is left out, and of some twenty rows in contact about six directions remain.

Contact at consecutive instants is condensed into blocks: the B^T dq of a block's instants are rows of the
state at its beginning, coupled by a small triangular matrix, so that many columns are carried through a block
by a few products of large matrices. The free motion of the modes between is not computed at all: the state is
kept as what it was at an earlier instant but for contact (a frame), and the rows take the free motion up to
their own instants.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import linalg

# Directions of contact that change the position by less than this share in a step are left out.
LEAST = 1e-14
# Rows that are condensed into one block.
BLOCK = 48
# Longest frame, and what it may not exceed: condition of a mode's free motion over its length, decades by
# which areas in its phase plane shrink. The decay itself costs no digits, each mode only changes its unit.
FRAME, WORST, DECAY = 2048, 1e6, 40.0


class ClosedSet:
    """Rows that keep their gaps, condensed.

    Parameters
    ----------
    left : (c, r) array
        U.
    residual : (c, c) array
        R.
    closed : (c,) bool array

    Attributes
    ----------
    operator : (r, r) array
        K_R.

    Raises
    ------
    LinAlgError
        If R is not definite in these rows.
    """

    def __init__(self, left: np.ndarray, residual: np.ndarray, closed: np.ndarray):
        self.rows, self.count = np.flatnonzero(closed), len(closed)
        block = residual[self.rows[:, None], self.rows]
        with np.errstate(divide="ignore", invalid="ignore"):
            self._weight = 1.0 / np.sqrt(np.diagonal(block))
            scaled = self._weight[:, None] * block * self._weight
        # LAPACK itself: of matrices this small, the checks of its wrappers take most of the time
        self._factor, failed = linalg.lapack.dpotrf(scaled.T, lower=1) if len(scaled) else (scaled, 0)
        if failed:
            raise np.linalg.LinAlgError(
                "the residual flexibility of the rows in contact is not positive definite"
            )
        self._half = self._weight[:, None] * left[self.rows]
        if len(scaled):
            self._half, _ = linalg.lapack.dtrtrs(self._factor, self._half, lower=1)
        self.operator = self._half.T @ self._half

    @functools.cached_property
    def spread(self) -> np.ndarray:
        """(r, c): U_A^T R_AA^-1 over all rows."""
        result = np.zeros((self._half.shape[1], self.count))
        if len(self.rows):
            solved, _ = linalg.lapack.dtrtrs(self._factor, self._half, lower=1, trans=1)
            result[:, self.rows] = solved.T * self._weight
        return result

    def stiffness(self, row: int) -> float:
        """Diagonal of R_AA^-1 at one of its rows, N/m."""
        unit = np.zeros(len(self.rows))
        place = int(np.searchsorted(self.rows, row))
        unit[place] = self._weight[place]
        solved, _ = linalg.lapack.dtrtrs(self._factor, unit, lower=1)
        return float(solved @ solved)


class ClosedSets:
    """The closed sets that occur, each condensed once.

    Parameters
    ----------
    left : (c, r) array
        U.
    residual : (c, c) array
        R.
    """

    def __init__(self, left: np.ndarray, residual: np.ndarray):
        self.left, self.residual = left, residual
        self._known: dict[bytes, ClosedSet] = {}

    def __getitem__(self, closed: np.ndarray) -> ClosedSet:
        key = closed.tobytes()
        found = self._known.get(key)
        if found is None:
            if len(self._known) > 4096:
                self._known.clear()
            found = self._known[key] = ClosedSet(self.left, self.residual, closed)
        return found


@dataclass(frozen=True, eq=False)
class Contacts:
    """What contact does to a small disturbance at the instants 0 .. n of a history.

    Attributes
    ----------
    instants : (k,) int array
        Those at which it does something.
    counts : (k,) int array
        How many rows of the next arrays belong to each.
    factors : (s, m) array
        The rows of B^T of all instants, one instant after the other.
    shifts : (s, e) array
        B^T dq is added to by so much for each of e parameters.
    """

    instants: np.ndarray
    counts: np.ndarray
    factors: np.ndarray
    shifts: np.ndarray


def exact_contacts(
    sets: ClosedSets,
    right: np.ndarray,
    coefficients: np.ndarray,
    *,
    closed: np.ndarray,
    gap_rates: np.ndarray,
) -> Contacts:
    """Of the steps as they are.

    Parameters
    ----------
    sets : ClosedSets
    right : (m, r) array
        V.
    coefficients : (10, m) array
        See `marching`.
    closed : (n + 1, c) bool array
        Rows that keep their gaps at the steps' ends.
    gap_rates : (n + 1, c, e) array
        Rates of the free gaps with e parameters.
    """
    instants = np.flatnonzero(closed.any(axis=1))
    changed = np.ones(len(instants), dtype=bool)
    changed[1:] = (closed[instants[1:]] != closed[instants[:-1]]).any(axis=1)
    # the first instant has no step before it: the force there follows from the position through R alone
    changed[1:2] |= instants[:1] == 0
    which = np.cumsum(changed) - 1
    found = [sets[closed[n]] for n in instants[changed]]
    operators = np.array([item.operator for item in found]).reshape(len(found), *[right.shape[1]] * 2)
    thin = _Thin(operators, right, coefficients[4], instants[changed] == 0)
    parameters = gap_rates.shape[2]
    pressed = np.zeros((len(instants), right.shape[1], parameters))
    if parameters:
        ends = np.append(np.flatnonzero(changed), len(instants))
        for item, first, last in zip(found, ends[:-1], ends[1:]):
            pressed[first:last] = item.spread @ gap_rates[instants[first:last]]
    return thin.contacts(instants, which, pressed)


def located_contacts(
    sets: ClosedSets,
    right: np.ndarray,
    coefficients: np.ndarray,
    *,
    closed: np.ndarray,
    gaps: np.ndarray,
    forces: np.ndarray,
) -> Contacts:
    """As `exact_contacts` without parameters, for the variational equation with each switch located inside
    its step.

    The steps hold a row's force at the mean of their ends, so a row acts over whole steps, and multipliers
    jump where a switch passes an instant of the grid. Here a switch stands where the gap without the row's
    own force, linear over the step, vanishes; a step acts by the mean of K_R over the sets that it passes
    through, an instant by the mean of the steps beside it. What is left of the jumps is of second order in
    the step.

    Parameters
    ----------
    gaps, forces : (n + 1, c) arrays
    """
    steps = len(closed) - 1
    switched, switching = np.nonzero(closed[1:] != closed[:-1])
    switches, first = np.unique(switched, return_index=True)
    # the sets between the switches, and where in its step each row switches
    between = [sets[closed[0]], *(sets[closed[n + 1]] for n in switches)]
    number = np.repeat(np.arange(len(switches)), np.diff(first, append=len(switched)))
    opens = closed[switched, switching]
    at = np.where(opens, switched, switched + 1)
    holding = number + ~opens
    stiffness = np.array([between[k].stiffness(row) for k, row in zip(holding, switching)])
    overlap = forces[at, switching] / stiffness
    gap = np.maximum(gaps[2 * switched + 1 - at, switching], 0.0)
    moments = np.where(opens, overlap, gap) / (overlap + gap)
    # operators of the sets and of the steps with a switch by turns, and the number that acts in each step
    table = np.zeros((2 * len(switches) + 1, right.shape[1], right.shape[1]))
    table[::2] = [item.operator for item in between]
    bounds = np.append(first, len(switched))
    for k, (one, other) in enumerate(zip(bounds[:-1], bounds[1:])):
        touching, passed = closed[switches[k]].copy(), 0.0
        order = one + np.argsort(moments[one:other], kind="stable")
        for place in order[:-1]:
            table[2 * k + 1] += (moments[place] - passed) * sets[touching].operator
            passed = moments[place]
            touching[switching[place]] = ~touching[switching[place]]
        last = moments[order[-1]]
        before = sets[touching] if len(order) > 1 else between[k]
        table[2 * k + 1] += (last - passed) * before.operator + (1.0 - last) * between[k + 1].operator
    acting = 2 * np.searchsorted(switches, np.arange(steps))
    acting[switches] += 1
    pairs = np.stack([np.append(acting[:1], acting), np.append(acting, acting[-1:])], axis=1)
    instants = np.flatnonzero(table.any(axis=(1, 2))[pairs].any(axis=1))
    # two neighbours follow each other along the table: their numbers and their sum tell the pair
    key = 2 * pairs[instants].sum(axis=1) + (instants == 0)
    _, kinds, which = np.unique(key, return_index=True, return_inverse=True)
    kinds = instants[kinds]
    means = 0.5 * (table[pairs[kinds, 0]] + table[pairs[kinds, 1]])
    thin = _Thin(means, right, coefficients[4], kinds == 0)
    return thin.contacts(instants, which.ravel(), np.zeros((len(instants), right.shape[1], 0)))


class _Thin:
    """B^T of operators K_R (k, r, r). Where `fixed`, K_R itself acts and not (K_R^-1 + M)^-1.

    With S^T K_R S = F F^T by Cholesky with pivots, up to columns that move the state by less than rounding,
    and 1 + F^T F = C C^T, B^T = C^-1 F^T S^-1 V^T.
    """

    def __init__(self, operators: np.ndarray, right: np.ndarray, gain: np.ndarray, fixed: np.ndarray):
        values, axes = np.linalg.eigh((right.T * gain) @ right)
        root = np.sqrt(np.maximum(values, 1e-15 * values[-1:]))
        self.scaled = axes * root  # S
        self.columns, self.pivots, self.ranks = pivoted_cholesky(self.scaled.T @ operators @ self.scaled)
        rank = self.columns.shape[2]
        transposed = np.swapaxes(self.columns, 1, 2)
        moved = np.where(fixed[:, None, None], 0.0, transposed @ self.columns) + np.eye(rank)
        self.held = np.linalg.cholesky(moved)  # C
        self.factors = np.linalg.solve(self.held, transposed) @ ((axes / root).T @ right.T)

    def contacts(self, instants: np.ndarray, which: np.ndarray, pressed: np.ndarray) -> Contacts:
        """Of instants with these operators; `pressed` (k, r, e) are U_A^T R_AA^-1 times changes of the
        gaps.
        """
        counts = self.ranks[which]
        owner = np.repeat(np.arange(len(instants)), counts)
        place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        shifts = np.zeros((len(owner), pressed.shape[2]))
        if shifts.size:
            # in the range of F: its coordinates follow from the rows of the pivots, which are triangular
            known = np.take_along_axis(self.columns, self.pivots[:, :, None], axis=1)
            empty = np.arange(known.shape[1]) >= self.ranks[:, None]
            known[empty] = np.eye(known.shape[1])[np.nonzero(empty)[1]]
            maps = np.linalg.solve(self.held, np.linalg.solve(known, self.scaled.T[self.pivots]))
            shifts = (maps[which] @ pressed)[owner, place]
        return Contacts(instants, counts, self.factors[which[owner], place], shifts)


def pivoted_cholesky(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F (k, r, n) with F F^T = the semidefinite matrices (k, r, r) but for what is below `LEAST`, the rows of
    the pivots (k, n), and the number of columns of each (k,); the columns beyond are zero.
    """
    count, size = matrices.shape[:2]
    every = np.arange(count)
    left = np.einsum("kii->ki", matrices).copy()
    least = LEAST * np.maximum(left.max(axis=1, initial=0.0), 1.0)
    columns, pivots = np.zeros((count, size, size)), np.zeros((count, size), dtype=int)
    ranks = np.zeros(count, dtype=int)
    for n in range(size):
        pivot = left.argmax(axis=1)
        largest = left[every, pivot]
        more = largest > least
        if not more.any():
            break
        column = matrices[every, :, pivot]
        column -= (columns[:, :, :n] @ columns[every, pivot, :n, None])[:, :, 0]
        column *= np.where(more, 1.0 / np.sqrt(np.where(more, largest, 1.0)), 0.0)[:, None]
        columns[:, :, n], pivots[:, n] = column, pivot
        # what has been a pivot is used up, and zero above the later ones
        left -= column**2
        left[every, pivot] = -1.0
        columns[every[:, None], pivots[:, :n], n] = 0.0
        ranks += more
    rank = int(ranks.max(initial=0))
    return columns[:, :, :rank], pivots[:, :rank], ranks


class Propagation:
    """The free motion of the modes over the steps of a history, and what forces do in it.

    D^n is the exponential of n steps of q'' + 2 zeta omega q' + omega^2 q = 0, its rows (a_n, b_n) and
    (-omega^2 b_n, a_n - 2 zeta omega b_n), its determinant exp(-2 zeta omega n h).

    Parameters
    ----------
    coefficients : (10, m) array
        See `marching`.
    omega, damping : (m,) arrays
        rad/s and damping ratios.
    step : float
        s.
    steps : int

    Attributes
    ----------
    push : (2, m) array
        What a contact force adds to q and q' in a step.
    reach : int
        Most steps over which the free motion is inverted, at their cost in digits; 0: none.
    rows : (reach + 2, 2, m) array
        a_n, b_n.
    pushes : (reach + 2, 2, m) array
        The inverses of D^n applied to `push`.
    """

    def __init__(
        self, coefficients: np.ndarray, omega: np.ndarray, damping: np.ndarray, step: float, steps: int
    ):
        aqq, aqv, _, _, cq, avq, avv, _, _, cv = coefficients
        self.step, self.push = np.array([[aqq, aqv], [avq, avv]]), np.array([cq, cv])
        self._squared, self._friction = omega**2, 2.0 * damping * omega
        length = min(steps, FRAME) + 1
        rows = np.empty((length + 1, 2, len(omega)))
        rows[0, 0], rows[0, 1] = 1.0, 0.0
        done, jump = 1, self.step
        while done <= length:
            more = min(done, length + 1 - done)
            a, b = rows[:more, 0], rows[:more, 1]
            np.multiply(a, jump[0, 0], out=rows[done : done + more, 0])
            rows[done : done + more, 0] += b * jump[1, 0]
            np.multiply(a, jump[0, 1], out=rows[done : done + more, 1])
            rows[done : done + more, 1] += b * jump[1, 1]
            done, jump = done + more, _product(jump, jump)
        growth = self._friction * step
        self.reach = self._reach(rows, growth, np.where(omega > 0.0, omega, omega.max(initial=1.0)))
        self.rows = rows[: self.reach + 2 if self.reach else 1]
        self._inverse_determinant = np.exp(np.arange(len(self.rows))[:, None] * growth)
        self.pushes = np.empty_like(self.rows)
        self._invert(np.arange(len(self.rows)), cq, cv, self.pushes)

    def _reach(self, rows: np.ndarray, growth: np.ndarray, weights: np.ndarray) -> int:
        """Looked for at every power up to 8 and at every eighth one: WORST leaves room for those between."""
        length = len(rows) - 1
        tried = np.unique(np.append(np.arange(8, length, 8), [*range(2, min(8, length)), length]))
        a, b = rows[tried, 0], rows[tried, 1]
        c, d = self._squared * b / weights, a - self._friction * b
        decades = tried[:, None] * growth / np.log(10.0)
        size = a**2 + d**2 + (b * weights) ** 2 + c**2
        fine = (np.abs(decades) <= DECAY) & (size <= 10.0**DECAY)
        fine &= size * 10.0 ** np.minimum(decades, 2.0 * DECAY) <= WORST
        fit = fine.all(axis=1)
        if fit.all():
            return length - 1
        worse = int(np.argmin(fit))
        return int(tried[worse - 1]) - 1 if worse else 0

    def _invert(self, powers: np.ndarray, q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
        """D^-n of (q, v) for each of the powers n, into (n, 2, m)."""
        whole = len(powers) == len(self.rows)
        a, b = (
            self.rows[:, 0] if whole else self.rows[powers, 0],
            (self.rows[:, 1] if whole else self.rows[powers, 1]),
        )
        np.subtract((a - self._friction * b) * q, b * v, out=out[:, 0])
        np.add(self._squared * b * q, a * v, out=out[:, 1])
        out *= (self._inverse_determinant if whole else self._inverse_determinant[powers])[:, None]

    def inverted(self, powers: np.ndarray, states: np.ndarray) -> np.ndarray:
        """D^-n of (k, 2 m, e) states, each with its own n."""
        result = np.empty_like(states)
        m = states.shape[1] // 2
        for column in range(states.shape[2]):
            found = np.empty((len(states), 2, m))
            self._invert(powers, states[:, :m, column], states[:, m:, column], found)
            result[:, :, column] = found.reshape(len(states), 2 * m)
        return result

    def power(self, steps: int) -> np.ndarray:
        """D^steps, (2, 2, m)."""
        if steps < len(self.rows):
            a, b = self.rows[steps]
            return np.array([[a, b], [-self._squared * b, a - self._friction * b]])
        return np.moveaxis(np.linalg.matrix_power(np.moveaxis(self.step, 2, 0), steps), 0, 2)


class Derivative:
    """The linearised motion over all steps.

    The contacts of a block, P = B^T dq at each of its instants, obey coupling P = rows y + shifts with the
    state y in the frame before the block, and y - effects^T P is the state behind it.

    Parameters
    ----------
    propagation : Propagation
    contacts : Contacts
    steps : int
    """

    def __init__(self, propagation: Propagation, contacts: Contacts, steps: int):
        self.propagation, self.contacts, self.steps = propagation, contacts, steps
        instants, counts = contacts.instants, contacts.counts
        self._first, self._begin, self._onward = self._frames()
        self._frame = np.repeat(np.arange(len(self._first)), np.diff(self._first, append=len(instants)))
        # steps from the frame's beginning
        self._late = instants - self._begin[self._frame]
        pushes = propagation.pushes
        # a force acts at the end of one step and at the start of the next; at the first and the last instant
        # in one step alone
        if propagation.reach:
            effect = (pushes[:-1] + pushes[1:])[np.minimum(self._late, propagation.reach)]
            effect[instants == 0] = pushes[1]
            at_end = instants == steps
            effect[at_end] = pushes[self._late[at_end]]
        else:
            both = np.einsum("ijm,jm->im", propagation.step, propagation.push) + propagation.push
            effect = np.where(((instants == 0) | (instants == steps))[:, None, None], propagation.push, both)
        owner = np.repeat(np.arange(len(instants)), counts)
        modes = contacts.factors.shape[1]
        self._rows = np.empty((len(owner), 2, modes))
        np.multiply(contacts.factors[:, None], propagation.rows[self._late][owner], out=self._rows)
        self._effects = np.empty_like(self._rows)
        np.multiply(contacts.factors[:, None], effect[owner], out=self._effects)
        self._rows = self._rows.reshape(len(owner), 2 * modes)
        self._effects = self._effects.reshape(len(owner), 2 * modes)
        self._owner = owner
        self._blocks = [self._blocks_of(frame) for frame in range(len(self._first))]

    def _frames(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Number of the first contact and instant of the beginning of each frame, and whether the state is
        moved on by a step before contact acts on it: where free motion cannot be inverted a frame holds one
        instant.
        """
        instants, reach = self.contacts.instants, self.propagation.reach
        if not reach:
            return np.arange(len(instants)), instants, instants < self.steps
        first, place = [], 0
        while place < len(instants):
            first.append(place)
            place = int(np.searchsorted(instants, instants[place] + reach, side="right"))
        numbers = np.array(first, dtype=int)
        return numbers, instants[numbers], np.zeros(len(numbers), dtype=bool)

    def _blocks_of(self, frame: int) -> list[tuple[int, int, np.ndarray]]:
        """Rows from .. to, and the coupling, of the blocks of a frame."""
        last = self._first[frame + 1] if frame + 1 < len(self._first) else len(self.contacts.instants)
        counts = self.contacts.counts
        place = int(counts[: self._first[frame]].sum())
        result, begin = [], place
        for count in [*counts[self._first[frame] : last].tolist(), None]:
            if count is None or (place + count - begin > BLOCK and place > begin):
                if place > begin:
                    owner = self._owner[begin:place]
                    coupling = self._rows[begin:place] @ self._effects[begin:place].T
                    # an instant does not act on itself
                    coupling[owner[:, None] == owner] = 0.0
                    result.append((begin, place, coupling))
                begin = place
            place += count or 0
        return result

    def __call__(self, q: np.ndarray, v: np.ndarray, sources: Callable | None = None) -> np.ndarray:
        """Columns of dq above those of dv after the last step, (2 m, k).

        Parameters
        ----------
        q, v : (m, k) arrays
            At the start. The last e columns are derivatives with the e parameters of the contacts, the others
            with the initial state.
        sources : callable, optional
            What the parameters themselves add to q and v over moves from one instant to another without
            contact between: (starts, ends) -> (n, 2 m, e).
        """
        columns = q.shape[1]
        x = np.concatenate([q, v])
        first = columns - self.contacts.shifts.shape[1]
        shifts, added = self._of_parameters(sources)
        now = 0
        for frame, begin in enumerate(self._begin.tolist()):
            x = self._moved(x, begin - now)
            now = begin
            for one, other, coupling in self._blocks[frame]:
                forces = self._rows[one:other] @ x
                forces[:, first:] += shifts[one:other]
                # the diagonal, ones, is not referred to; transposed, these are LAPACK's own layout
                linalg.blas.dtrsm(1.0, coupling.T, forces.T, side=1, lower=0, diag=1, overwrite_b=1)
                if self._onward[frame]:
                    x, now = self._moved(x, 1), begin + 1
                x -= self._effects[one:other].T @ forces
            if added is not None:
                x[:, first:] += added[frame]
        x = self._moved(x, self.steps - now)
        if added is not None:
            x[:, first:] += added[-1]
        return x

    def _moved(self, x: np.ndarray, steps: int) -> np.ndarray:
        """D^steps x."""
        m = len(x) // 2
        power = self.propagation.power(steps)
        result, other = np.empty_like(x), np.empty_like(x[:m])
        for k in (0, 1):
            part = result[k * m : (k + 1) * m]
            np.multiply(x[:m], power[k, 0][:, None], out=part)
            np.multiply(x[m:], power[k, 1][:, None], out=other)
            part += other
        return result

    def _of_parameters(self, sources: Callable | None) -> tuple[np.ndarray, np.ndarray | None]:
        """What parameters add to the P of each contact and to the state at the end of each frame; the last
        row is for the end of the last step.
        """
        shifts, instants = self.contacts.shifts, self.contacts.instants
        if sources is None or shifts.shape[1] == 0:
            return shifts, None
        taken = instants[instants < self.steps]
        begin, end = np.append(0, taken + 1), np.append(taken, self.steps)
        longer = begin < end
        starts, ends = np.concatenate([taken, begin[longer]]), np.concatenate([taken + 1, end[longer]])
        order = np.argsort(ends)
        starts, ends = starts[order], ends[order]
        found = sources(starts, ends)
        # each belongs to the last frame that begins before it ends or there, and what comes with the end of
        # the last step to that
        frame = np.searchsorted(self._begin, ends, side="right") - 1
        final = len(self._begin)
        frame[(ends == self.steps) & ~np.isin(self.steps, instants)] = final
        frame[frame < 0] = final
        inside = frame < final
        late = ends[inside] - self._begin[frame[inside]]
        late -= self._onward[frame[inside]] & (late > 0)
        found[inside] = self.propagation.inverted(late, found[inside])
        total = np.concatenate([np.zeros((1, *found.shape[1:])), np.cumsum(found, axis=0)])
        edges = np.searchsorted(frame, np.arange(final + 2))
        added = total[edges[1:]] - total[edges[:-1]]
        before = total[np.searchsorted(ends, instants, side="right")] - total[edges[self._frame]]
        return shifts + np.einsum("sj,sje->se", self._rows, before[self._owner]), added


def _product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Products of (2, 2, m) matrices of each mode."""
    return np.einsum("ijm,jkm->ikm", one, other)
