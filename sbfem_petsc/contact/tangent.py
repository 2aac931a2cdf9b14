"""Exact derivative of the time steps (`marching.march`) with the contact sets of a history (`step_tangent`,
`located_switches`).

Contact at consecutive instants is condensed into blocks: the B^T dq of a block's instants are rows of the
state at its beginning, coupled by a small triangular matrix, so that many columns are carried through a block
by a few products of large matrices. The free motion of the modes between is not computed at all: the state is
kept as what it was at an earlier instant but for contact (a frame), and the rows take the free motion up to
their own instants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dgemm, dtrsm

# Rows that are condensed into one block.
BLOCK = 48
# Longest frame, and what it may not exceed: condition of a mode's free motion over its length, decades by
# which areas in its phase plane shrink. The decay itself costs no digits, each mode only changes its unit.
FRAME, WORST, DECAY = 2048, 1e6, 40.0


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
    pushes : (s, m) array
        What the rows' forces push; where nothing rubs, the factors themselves.
    reads, writes : (s, k) arrays
        Factors on what rows that rub remember, and what is taken off that; see `step_tangent`.
    """

    instants: np.ndarray
    counts: np.ndarray
    factors: np.ndarray
    pushes: np.ndarray
    reads: np.ndarray
    writes: np.ndarray


def thin_axes(right: np.ndarray, gain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """S and S^-T (r, r) of V^T (r, m): S S^T = V^T diag(gain) V, what thin forces do to the thin position."""
    values, axes = np.linalg.eigh((right * gain) @ right.T)
    root = np.sqrt(np.maximum(values, 1e-15 * values[-1:]))
    return axes * root, axes / root


def repeated(sizes: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Places of the rows of kinds one after the other, which have so many, where rows stand kind by kind."""
    counts = sizes[which]
    first = (np.cumsum(sizes) - sizes)[which]
    return np.arange(counts.sum()) + np.repeat(first - np.cumsum(counts) + counts, counts)


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
    rows : (2, reach + 2, m) array
        a_n, b_n.
    """

    def __init__(
        self, coefficients: np.ndarray, omega: np.ndarray, damping: np.ndarray, step: float, steps: int
    ):
        aqq, aqv, _, _, cq, avq, avv, _, _, cv = coefficients
        self.step, self.push = np.array([[aqq, aqv], [avq, avv]]), np.array([cq, cv])
        self._squared, self._friction = omega**2, 2.0 * damping * omega
        length = min(steps, FRAME) + 1
        rows = np.empty((2, length + 1, len(omega)))
        rows[0, 0], rows[1, 0] = 1.0, 0.0
        done, jump, work = 1, self.step, np.empty((length + 1, len(omega)))
        while done <= length:
            more = min(done, length + 1 - done)
            for k in (0, 1):
                part = rows[k, done : done + more]
                np.multiply(rows[0, :more], jump[0, k], out=part)
                part += np.multiply(rows[1, :more], jump[1, k], out=work[:more])
            done, jump = done + more, _product(jump, jump)
        growth = self._friction * step
        self.reach = self._reach(rows, growth, np.where(omega > 0.0, omega, omega.max(initial=1.0)))
        self.rows = rows[:, : self.reach + 2 if self.reach else 1]
        # where nothing is inverted a step may take more decades than numbers have
        self._inverse_determinant = _powers(np.exp(min(self.reach, 1) * growth), self.rows.shape[1])

    def _reach(self, rows: np.ndarray, growth: np.ndarray, weights: np.ndarray) -> int:
        """Looked for at every power up to 8 and at every eighth one: WORST leaves room for those between.

        Of modes below half of the critical damping what is compared with WORST is less than 4 at all times.
        """
        length = rows.shape[1] - 1
        swings = bool((self._friction**2 < self._squared).all())
        if swings and length * np.abs(growth).max(initial=0.0) < DECAY * np.log(10.0):
            return length - 1
        tried = np.unique(np.append(np.arange(8, length, 8), [*range(2, min(8, length)), length]))
        a, b = rows[:, tried]
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

    def _invert(self, powers: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """D^-n of (q, v), (n, m) or (m,) each, for each of the powers n, (n, 2, m)."""
        a, b = self.rows[:, powers] * self._inverse_determinant[powers]
        result = np.empty((len(powers), 2, a.shape[1]))
        np.subtract(a * q, b * (self._friction * q + v), out=result[:, 0])
        np.add(b * (self._squared * q), a * v, out=result[:, 1])
        return result

    def effects(self, instants: np.ndarray, late: np.ndarray, last: int) -> np.ndarray:
        """What contact forces at instants, so many steps late in their frames, add to the states at the
        beginning of these, (k, 2, m).

        A force acts at the end of one step and at the start of the next; at the first and at the last instant
        in one step alone.
        """
        if not self.reach:
            both = np.einsum("ijm,jm->im", self.step, self.push) + self.push
            once = (instants == 0) | (instants == last)
            return np.where(once[:, None, None], self.push, both)
        (before,) = self._invert(np.array([1]), *self.push)
        result = self._invert(late, *(self.push + before))
        for chosen, push in ((instants == 0, before), (instants == last, self.push)):
            result[chosen] = self._invert(late[chosen], *push)
        return result

    def power(self, steps: int) -> np.ndarray:
        """D^steps, (2, 2, m)."""
        if steps < self.rows.shape[1]:
            a, b = self.rows[:, steps]
            return np.array([[a, b], [-self._squared * b, a - self._friction * b]])
        return np.moveaxis(np.linalg.matrix_power(np.moveaxis(self.step, 2, 0), steps), 0, 2)


class Derivative:
    """The linearised motion over all steps.

    The contacts of a block, P = B^T dq at each of its instants, obey coupling P = rows y with the state y in
    the frame before the block, and y - effects^T P is the state behind it. What rows that rub remember stands
    behind the modes and does not move by itself.

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
        owner = np.repeat(np.arange(len(instants)), counts)
        modes = contacts.factors.shape[1]
        self._rows, self._effects = (np.empty((len(owner), 2 * modes)) for _ in range(2))
        effects = propagation.effects(instants, self._late, steps)
        for k in (0, 1):
            part = slice(k * modes, (k + 1) * modes)
            free = propagation.rows[k, self._late][owner]
            np.multiply(contacts.factors, free, out=self._rows[:, part])
            np.multiply(contacts.pushes, effects[owner, k], out=self._effects[:, part])
        self._owner = owner
        self._remember = contacts.reads.any(axis=1) | contacts.writes.any(axis=1)
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

    def _blocks_of(self, frame: int) -> list[tuple[int, int, np.ndarray, bool]]:
        """Rows from .. to, the coupling transposed, and whether they read or write what is remembered, of the
        blocks of a frame.
        """
        last = self._first[frame + 1] if frame + 1 < len(self._first) else len(self.contacts.instants)
        counts, reads, writes = self.contacts.counts, self.contacts.reads, self.contacts.writes
        place = int(counts[: self._first[frame]].sum())
        result, begin = [], place
        for count in [*counts[self._first[frame] : last].tolist(), None]:
            if count is None or (place + count - begin > BLOCK and place > begin):
                if place > begin:
                    part = slice(begin, place)
                    owner, remembers = self._owner[part], bool(self._remember[part].any())
                    coupling = dgemm(1.0, self._effects[part].T, self._rows[part].T, trans_a=1)
                    if remembers:
                        coupling = dgemm(
                            1.0, writes[part].T, reads[part].T, 1.0, coupling, trans_a=1, overwrite_c=1
                        )
                    # an instant does not act on itself
                    coupling[owner[:, None] == owner] = 0.0
                    result.append((begin, place, coupling, remembers))
                begin = place
            place += count or 0
        return result

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Columns of dq above those of dv and the memory, (2 m + k, n): after the last step, of these at the
        start.
        """
        x, moving = x.copy(), 2 * self.contacts.factors.shape[1]
        reads, writes, now = self.contacts.reads, self.contacts.writes, 0
        for frame, begin in enumerate(self._begin.tolist()):
            x = self._moved(x, begin - now)
            now = begin
            for one, other, coupling, remembers in self._blocks[frame]:
                # transposed, these are BLAS' own layout: no copies are made
                forces = dgemm(1.0, x[:moving].T, self._rows[one:other].T)
                if remembers:
                    forces = dgemm(1.0, x[moving:].T, reads[one:other].T, 1.0, forces, overwrite_c=1)
                # the diagonal, ones, is not referred to
                dtrsm(1.0, coupling, forces, side=1, lower=0, diag=1, overwrite_b=1)
                if self._onward[frame]:
                    x, now = self._moved(x, 1), begin + 1
                dgemm(-1.0, forces, self._effects[one:other].T, 1.0, x[:moving].T, trans_b=1, overwrite_c=1)
                if remembers:
                    dgemm(-1.0, forces, writes[one:other].T, 1.0, x[moving:].T, trans_b=1, overwrite_c=1)
        return self._moved(x, self.steps - now)

    def _moved(self, x: np.ndarray, steps: int) -> np.ndarray:
        """D^steps x."""
        m = self.contacts.factors.shape[1]
        power = self.propagation.power(steps)
        result, other = np.empty_like(x), np.empty_like(x[:m])
        for k in (0, 1):
            part = result[k * m : (k + 1) * m]
            np.multiply(x[:m], power[k, 0][:, None], out=part)
            np.multiply(x[m : 2 * m], power[k, 1][:, None], out=other)
            part += other
        result[2 * m :] = x[2 * m :]
        return result


def _powers(base: np.ndarray, count: int) -> np.ndarray:
    """(count, m): powers 0, 1, .. of each number."""
    result = np.ones((count, len(base)))
    done = 1
    while done < count:
        more = min(done, count - done)
        np.multiply(result[:more], result[done - 1] * base, out=result[done : done + more])
        done += more
    return result


def _product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Products of (2, 2, m) matrices of each mode."""
    return np.einsum("ijm,jkm->ikm", one, other)
