"""Exact derivative of the time steps (`marching.march`) with the contact sets of a history.

Where no row changes sides a step is linear: with the set A of rows that keep their gaps at its end, the thin
contact forces p = U^T force obey dp = -K (V^T dq + ...) with the position dq before they act and
K = U_A^T W_AA^-1 U_A. With K_R = U_A^T R_AA^-1 U_A, which knows nothing of the step's length and is kept for
every set that has occurred, and M = V^T diag(cq) V, K = (K_R^-1 + M)^-1.

In coordinates in which M = S S^T is one, S^T K_R S = E diag(l) E^T, the modal forces of contact are
-B B^T dq with B = V S^-T E diag(l / (1 + l))^(1/2). Its columns are few: what l tells to move the state by
less than rounding is left out, and of some twenty rows in contact about six directions remain.

Contact at consecutive instants is condensed into blocks: the B^T dq of a block's instants are rows of the
state at its beginning, coupled by a small triangular matrix, so that many columns are carried through a block
by a few products of large matrices. Between the blocks the modes move freely, closed form.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import linalg

# Directions of contact that change the position by less than this share in a step are left out.
LEAST = 1e-14
# Consecutive instants with contact that are condensed into one.
BLOCK = 8


@dataclass(frozen=True, eq=False)
class ClosedSet:
    """Rows that keep their gaps, condensed.

    Attributes
    ----------
    spread : (r, c) array
        U_A^T R_AA^-1 over all rows.
    operator : (r, r) array
        K_R.
    stiffness : (c,) array
        Diagonal of R_AA^-1, zero for the other rows, N/m.
    """

    spread: np.ndarray
    operator: np.ndarray
    stiffness: np.ndarray


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
        if key not in self._known:
            if len(self._known) > 4096:
                self._known.clear()
            self._known[key] = self._condense(np.flatnonzero(closed))
        return self._known[key]

    def _condense(self, rows: np.ndarray) -> ClosedSet:
        count, rank = self.left.shape
        spread, stiffness = np.zeros((rank, count)), np.zeros(count)
        if len(rows):
            block = self.residual[np.ix_(rows, rows)]
            weight = 1.0 / np.sqrt(np.diag(block))
            factor = linalg.cho_factor(weight[:, None] * block * weight, check_finite=False)
            inverse = weight[:, None] * linalg.cho_solve(factor, np.diag(weight), check_finite=False)
            spread[:, rows] = self.left[rows].T @ inverse
            stiffness[rows] = np.diag(inverse)
        operator = spread @ self.left
        return ClosedSet(spread, 0.5 * (operator + operator.T), stiffness)


@dataclass(frozen=True, eq=False)
class Contacts:
    """What contact does to a small disturbance at the instants 0 .. n of a history.

    Attributes
    ----------
    instants : (k,) int array
        Those at which it does something.
    factors : (k, r', m) array
        B^T of each.
    shifts : (k, r', e) array
        B^T dq is added to by so much for each of e parameters.
    """

    instants: np.ndarray
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
    factors, maps = _factors(operators, right, coefficients[4], instants[changed] == 0)
    shifts = np.zeros((len(instants), factors.shape[1], gap_rates.shape[2]))
    if gap_rates.shape[2]:
        for k, item in enumerate(found):
            here = which == k
            shifts[here] = (maps[k] @ item.spread) @ gap_rates[instants[here]]
    return Contacts(instants, factors[which], shifts)


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
    switches = np.flatnonzero((closed[1:] != closed[:-1]).any(axis=1))
    touching = closed[0].copy()
    before = sets[touching].operator
    # operators by number, and the number that acts in each step
    operators, acting, done = [before], np.zeros(steps, dtype=int), 0
    for n in switches:
        acting[done:n] = len(operators) - 1
        rows = np.flatnonzero(closed[n] != closed[n + 1])
        opens = closed[n, rows]
        at = np.where(opens, n, n + 1)
        stiffness = np.where(opens, sets[closed[n]].stiffness[rows], sets[closed[n + 1]].stiffness[rows])
        overlap, gap = forces[at, rows] / stiffness, np.maximum(gaps[2 * n + 1 - at, rows], 0.0)
        moments = np.where(opens, overlap, gap) / (overlap + gap)
        mean, passed = np.zeros_like(before), 0.0
        for k in np.argsort(moments, kind="stable"):
            mean += (moments[k] - passed) * sets[touching].operator
            passed = moments[k]
            touching[rows[k]] = ~touching[rows[k]]
        after = sets[touching].operator
        operators += [mean + (1.0 - passed) * after, after]
        acting[n], done = len(operators) - 2, n + 1
    acting[done:] = len(operators) - 1
    pairs = np.stack([np.append(acting[:1], acting), np.append(acting, acting[-1:])], axis=1)
    table = np.array(operators)
    instants = np.flatnonzero(table.any(axis=(1, 2))[pairs].any(axis=1))
    fixed = instants == 0
    kinds, which = np.unique(
        np.concatenate([pairs[instants], fixed[:, None]], axis=1), axis=0, return_inverse=True
    )
    means = 0.5 * (table[kinds[:, 0]] + table[kinds[:, 1]])
    factors, _ = _factors(means, right, coefficients[4], kinds[:, 2].astype(bool))
    factors = factors[which.ravel()]
    return Contacts(instants, factors, np.zeros((*factors.shape[:2], 0)))


def _factors(
    operators: np.ndarray, right: np.ndarray, gain: np.ndarray, fixed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """B^T (k, r', m) of operators K_R (k, r, r), and the (k, r', r) matrices that take U_A^T R_AA^-1 times a
    change of the gaps to the same coordinates. Where `fixed`, K_R itself acts and not (K_R^-1 + M)^-1.
    """
    if not operators.size:
        return np.zeros((len(operators), 0, len(right))), np.zeros((len(operators), 0, right.shape[1]))
    values, axes = linalg.eigh((right.T * gain) @ right)
    root = np.sqrt(np.maximum(values, 1e-15 * values[-1:]))
    scaled = axes * root  # S
    inverse = axes / root  # S^-T
    size, turn = np.linalg.eigh(scaled.T @ operators @ scaled)
    size, turn = np.maximum(size[:, ::-1], 0.0), turn[:, :, ::-1]
    acts = np.where(fixed[:, None], size, size / (1.0 + size))
    rank = int((acts > LEAST).sum(axis=1).max(initial=0))
    size, turn, acts = size[:, :rank], turn[:, :, :rank], acts[:, :rank]
    thin = np.swapaxes((inverse @ turn) * np.sqrt(acts)[:, None, :], 1, 2)
    # (I + K_R M)^-1 = S^-T E (1 + l)^-1 E^T S^T, or 1 where fixed
    held = np.where(fixed[:, None], 1.0, 1.0 + size)
    weight = np.divide(1.0, held * np.sqrt(acts), out=np.zeros_like(acts), where=acts > LEAST)
    maps = np.swapaxes((scaled @ turn) * weight[:, None, :], 1, 2)
    return thin @ right.T, maps


class Derivative:
    """The linearised motion over all steps.

    Contacts at consecutive instants make a block: the P = B^T dq of all of them obey coupling P = rows x +
    shifts with the state x at the first one, and the state after the block is D^length x - effects^T P.

    Parameters
    ----------
    coefficients : (10, m) array
        See `marching`.
    contacts : Contacts
    steps : int
    """

    def __init__(self, coefficients: np.ndarray, contacts: Contacts, steps: int):
        aqq, aqv, _, _, cq, avq, avv, _, _, cv = coefficients
        self.contacts, self.steps = contacts, steps
        # D^0 .. D^BLOCK of each mode, (., 2, 2, m), and the state so many steps after a force
        step, push = np.array([[aqq, aqv], [avq, avv]]), np.array([cq, cv])
        powers = [np.broadcast_to(np.eye(2)[..., None], step.shape)]
        for _ in range(BLOCK):
            powers.append(_product(step, powers[-1]))
        self._step, self._powers = step, np.array(powers)
        done = np.einsum("nijm,jm->nim", self._powers, push)
        # a force acts at the end of one step and at the start of the next
        effect = done[1:] + done[:-1]
        instants, factors = contacts.instants, contacts.factors
        first = self._first_of_blocks()
        self._blocks = np.append(first, len(instants))
        length = np.diff(self._blocks)
        self._place = np.arange(len(instants)) - np.repeat(first, length)
        after = np.repeat(length, length) - 1 - self._place
        effects = effect[after]
        # at the first and the last instant it acts in one step alone
        effects[np.isin(instants, (0, steps))] = push
        self._rows = factors[:, :, None, :] * self._powers[self._place, 0][:, None]
        self._effects = factors[:, :, None, :] * effects[:, None]
        count, rank, _ = factors.shape
        self._couplings = np.zeros((count, rank, BLOCK, rank))
        for d in range(1, int(length.max(initial=0))):
            here = np.flatnonzero(self._place >= d)
            products = (factors[here] * effect[d - 1, 0]) @ np.swapaxes(factors[here - d], 1, 2)
            self._couplings[here, :, self._place[here] - d] = products

    def _first_of_blocks(self) -> np.ndarray:
        """Numbers of the contacts that begin a block; the first and the last instant are by themselves."""
        first: list[int] = []
        instants = self.contacts.instants.tolist()
        for k, instant in enumerate(instants):
            if (
                k == 0
                or k - first[-1] == BLOCK
                or instant != instants[k - 1] + 1
                or instants[k - 1] == 0
                or instant == self.steps
            ):
                first.append(k)
        return np.array(first, dtype=int)

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
        m, columns = q.shape
        x, rank = np.concatenate([q, v]), self.contacts.factors.shape[1]
        first = columns - self.contacts.shifts.shape[2]
        shifts, ends, between = self._of_parameters(sources)
        now = 0
        for block, (one, other) in enumerate(zip(self._blocks[:-1], self._blocks[1:])):
            start, length = int(self.contacts.instants[one]), other - one
            if start > now:
                x = self._moved(x, start - now)
                x[:, first:] += between.get(now, 0.0)
            size = length * rank
            forces = self._rows[one:other].reshape(size, 2 * m) @ x
            forces[:, first:] += shifts[one:other].reshape(size, columns - first)
            if length > 1:
                coupling = self._couplings[one:other, :, :length].reshape(size, size)
                # the diagonal, ones, is not referred to
                forces = linalg.blas.dtrsm(1.0, coupling, forces, lower=1, diag=1)
            now = start
            if start < self.steps:
                x = self._moved(x, length)
                now += length
            x -= self._effects[one:other].reshape(size, 2 * m).T @ forces
            x[:, first:] += ends[block]
        if self.steps > now:
            x = self._moved(x, self.steps - now)
            x[:, first:] += between.get(now, 0.0)
        return x

    def _moved(self, x: np.ndarray, steps: int) -> np.ndarray:
        """D^steps x."""
        m = len(x) // 2
        power = self._powers[steps] if steps <= BLOCK else _power(self._step, steps)
        result, other = np.empty_like(x), np.empty_like(x[:m])
        for k in (0, 1):
            part = result[k * m : (k + 1) * m]
            np.multiply(x[:m], power[k, 0][:, None], out=part)
            np.multiply(x[m:], power[k, 1][:, None], out=other)
            part += other
        return result

    def _of_parameters(
        self, sources: Callable | None
    ) -> tuple[np.ndarray, np.ndarray, dict[int, np.ndarray]]:
        """What parameters add to the P of each contact, to the state at the end of each block, and over each
        move between the blocks, by its start.
        """
        shifts, instants, m = self.contacts.shifts, self.contacts.instants, self._step.shape[2]
        parameters = shifts.shape[2]
        ends = np.zeros((len(self._blocks) - 1, 2 * m, parameters))
        if sources is None or parameters == 0:
            return shifts, ends, {}
        taken = instants[instants < self.steps]
        begin, end = np.append(0, taken + 1), np.append(taken, self.steps)
        longer = begin < end
        begin, end = begin[longer], end[longer]
        added = sources(np.concatenate([taken, begin]), np.concatenate([taken + 1, end]))
        of_steps = np.zeros((len(instants), 2 * m, parameters))
        of_steps[: len(taken)] = added[: len(taken)]
        # within a block, the motion without contact that the sources cause
        motion = np.zeros_like(of_steps)
        for place in range(1, BLOCK):
            here = np.flatnonzero(self._place == place)
            motion[here] = self._stepped(motion[here - 1]) + of_steps[here - 1]
        last = self._blocks[1:] - 1
        ends = self._stepped(motion[last]) + of_steps[last]
        ends[instants[last] == self.steps] = 0.0
        return (
            shifts + self.contacts.factors @ motion[:, :m],
            ends,
            dict(zip(begin.tolist(), added[len(taken) :])),
        )

    def _stepped(self, states: np.ndarray) -> np.ndarray:
        """D of (n, 2 m, e) states."""
        m = states.shape[1] // 2
        halves = states.reshape(len(states), 2, m, states.shape[2])
        return np.einsum("ijm,njme->nime", self._step, halves).reshape(states.shape)


def _product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Products of (2, 2, m) matrices of each mode."""
    return np.einsum("ijm,jkm->ikm", one, other)


def _power(matrix: np.ndarray, exponent: int) -> np.ndarray:
    return np.moveaxis(np.linalg.matrix_power(np.moveaxis(matrix, 2, 0), exponent), 0, 2)
