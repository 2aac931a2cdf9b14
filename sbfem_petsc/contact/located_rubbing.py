"""The variational equation of a history of time steps with friction, each switch located inside its step.

As `closed_sets.located_contacts`, where rows that rub remember. From a switch to the next one the thin forces
of contact are -(K y + L m) with the position y = V^T dq and the slips m that rows keep; a row begins to keep
the slip S y + N m that it has at its switch. Steps tell a switch to an instant of their grid, so that
multipliers jump where one passes it. Here a row sticks until its friction, carried on, is above its bound,
and slips until the slip turns about, up to half a step before or behind the instant at which it was last seen
to slip. Sets act by their shares of the steps beside an instant, weighted by its hat function; the slip at a
switch is interpolated between the instants beside it. What is left of the jumps is of second order in
the step. What lands does so later where its gap is more, and has slid on by then.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import linalg

from .friction import ALONG, STICKS
from .held_rows import extent_of
from .law import FREE
from .step_data import StepConstants
from .step_tangent import LEAST
from .tangent import Contacts, thin_axes

# Condition of sets of which rows are held twice, which share their forces.
_TWICE = 1e13


class _Operators(NamedTuple):
    """Of a set, in the scaled thin space and units of the memory.

    Attributes
    ----------
    by_position, by_memory : (r, r), (r, k) arrays
        K and L.
    slips, kept : (c + k, r), (c + k, k) arrays
        S and N, of gaps and slips, m.
    inverse : (a, a) array
        Forces of the members under their gaps.
    place : (c + k,) int array
        Of each row among the members, -1 of others.
    """

    by_position: np.ndarray
    by_memory: np.ndarray
    slips: np.ndarray
    kept: np.ndarray
    inverse: np.ndarray
    place: np.ndarray


class _Switch(NamedTuple):
    """Its time in steps, the states that rows go on to, which slip is kept from then on, -1: none, and by how
    much it is more for each metre by which its gap is, for it lands later.
    """

    time: float
    states: tuple[tuple[int, int], ...]
    begins: int
    slope: float = 0.0


def located_rubbing(
    step: StepConstants,
    history: tuple[np.ndarray, np.ndarray, np.ndarray],
    gaps: Callable[[np.ndarray, np.ndarray], np.ndarray],
    units: np.ndarray,
) -> Contacts:
    """Of a periodic history.

    Parameters
    ----------
    step : StepConstants
    history : (n + 1, c + k) int8 and float arrays, (n, k, 3) array
        States of the rows at the steps' ends, their forces, and where they land (`step_data.StepHistory`).
    gaps : callable
        Gaps and slips of rows at instants, (k,) and (k,) int arrays.
    units : (k,) array
        Those of the slips in the state, m.
    """
    return _Located(step, history, gaps, units).contacts()


class _Located:
    """See `located_rubbing`."""

    def __init__(
        self,
        step: StepConstants,
        history: tuple[np.ndarray, np.ndarray, np.ndarray],
        gaps: Callable[[np.ndarray, np.ndarray], np.ndarray],
        units: np.ndarray,
    ):
        (self.states, self.forces, self._landings), self.step, self.units = history, step, units
        self.count, self.steps = step.rubbing.beside.size, len(self.states) - 1
        self._gaps = gaps
        scaled, unscaled = thin_axes(step.right, step.coefficients[0, 4])
        self.scaled, self.thin = scaled.T @ step.left, unscaled.T @ step.right
        self._known: dict[bytes, _Operators] = {}

    def gap(self, n: int, row: int) -> float:
        """Of a row at an instant."""
        return float(self._gaps(np.array([n]), np.array([row]))[0])

    def _of(self, state: np.ndarray) -> _Operators:
        """The set's operators."""
        key = state.tobytes()
        if key in self._known:
            return self._known[key]
        c, units, scaled = self.count, self.units, self.scaled
        sticks = state[c:] == STICKS
        members, extent = extent_of(self.step.rubbing, state)
        place = np.full(len(state), -1)
        place[members] = np.arange(len(members))
        acting = (self.step.residual @ extent)[members]
        try:
            inverse = np.linalg.inv(acting)
        except np.linalg.LinAlgError:
            inverse = np.full_like(acting, np.inf)
        if np.abs(inverse).max(initial=0.0) * np.abs(acting).max(initial=0.0) > _TWICE:
            inverse = np.linalg.pinv(acting, 1.0 / _TWICE)
        held = extent @ inverse
        along = held @ scaled[:, members].T
        memory = np.zeros((len(state), len(units)))
        memory[:, sticks] = held[:, place[c:][sticks]] * units[sticks]
        slack = self.step.residual
        found = _Operators(
            scaled @ along,
            -scaled @ memory,
            scaled.T - slack @ along,
            slack @ memory,
            inverse,
            place,
        )
        self._known[key] = found
        return found

    # ------------------------------------------------------------------ where rows switch
    def _switches(self) -> list[_Switch]:
        """Of all rows, in the order of time, in [0, n)."""
        c, states, found = self.count, self.states, list[_Switch]()
        touching = states[:, :c] != FREE
        for n, i in zip(*np.nonzero(touching[1:] != touching[:-1])):
            beside = int(self.step.rubbing.beside[i])
            rows = (int(i),) if beside < 0 else (int(i), beside)
            after = tuple((row, int(states[n + 1, row])) for row in rows)
            begins = beside - c if len(rows) > 1 and after[1][1] == STICKS else -1
            share, _, slope = self._landings[n, begins] if begins >= 0 else (0.0, 0.0, 0.0)
            slope = slope / share if share > 0.0 else 0.0
            found.append(_Switch(n + self._touches(n, i), after, begins, slope))
        for k, row in enumerate(range(c, states.shape[1])):
            begun = 0.0
            held = touching[:, self.step.rubbing.rows[k]]
            changed = (states[1:, row] != states[:-1, row]) & held[1:] & held[:-1]
            for n in np.flatnonzero(changed):
                more = self._rubs(int(n), row, begun)
                begun = more[-1].time
                found.extend(more)
        return sorted(
            (item._replace(time=item.time % self.steps) for item in found), key=lambda item: item.time
        )

    def _touches(self, n: int, i: int) -> float:
        """Share of a step after which a normal row begins or ceases to touch."""
        opens = self.states[n, i] != FREE
        at, other = (n, n + 1) if opens else (n + 1, n)
        trial = self.states[n + 1].copy()
        if opens:
            trial[i] = self.states[n, i]
            if self.step.rubbing.beside[i] >= 0:
                trial[self.step.rubbing.beside[i]] = self.states[n, self.step.rubbing.beside[i]]
        found = self._of(trial)
        force = self.forces[at, i]
        overlap = abs(force) / abs(found.inverse[found.place[i], found.place[i]])
        place = self.step.laws.place[self.states[at, i], i]
        apart = max((self.gap(other, i) - place) * (1.0 if force >= 0.0 else -1.0), 0.0)
        share = overlap / max(overlap + apart, 1e-300)
        return share if opens else 1.0 - share

    def _rubs(self, n: int, row: int, begun: float) -> list[_Switch]:
        """Those of a tangential row in a step between whose ends it stays pressed."""
        before, after = int(self.states[n, row]), int(self.states[n + 1, row])
        k = row - self.count
        normal = int(self.step.rubbing.rows[k])
        bound = self.step.rubbing.kinetic[k]
        trial = self.states[n + 1].copy()
        trial[row] = STICKS
        found = self._of(trial)
        column = found.inverse[:, found.place[row]]

        def rate(sense: float) -> float:
            """Of the bound less the friction, N/m, with the slip."""
            return abs(bound * column[found.place[normal]] - sense * column[found.place[row]])

        def margin(instant: int, sense: float) -> float:
            return max(bound * self.forces[instant, normal] - sense * self.forces[instant, row], 0.0)

        moved = abs(self.gap(n + 1, row) - self.gap(n, row))
        if before == STICKS:
            sense = 1.0 if after == ALONG else -1.0
            left, lacks = margin(n, sense), rate(sense) * moved
            return [_Switch(n + left / max(left + lacks, 1e-300), ((row, after),), -1)]
        sense = 1.0 if before == ALONG else -1.0
        former = (n - 1) % self.steps
        since = max(begun, n - 1.0) if n else n - 1.0
        speed = max(-sense * (self.gap(n, row) - self.gap(former, row)), 0.0) / max(n - since, 1e-3)
        back = margin(n + 1, sense) / rate(sense) if after == STICKS else moved
        middle = 0.5 * (n + since)
        turns = middle + (n + 0.5 - middle) * speed / max(speed + back, 1e-300)
        switch = _Switch(turns, ((row, STICKS),), k)
        if after == STICKS:
            return [switch]
        whole, lacks = 2.0 * bound * self.forces[n + 1, normal], rate(-sense) * moved
        # from where it turns about the way grows with the square of the time
        leaves = turns + (n + 1 - turns) * math.sqrt(whole / max(whole + lacks, 1e-300))
        return [switch, _Switch(leaves, ((row, after),), -1)]

    def _segments(self) -> list[tuple[_Switch, np.ndarray]]:
        """What holds from time 0 and each switch on. What sticks at the end has begun to do so before it."""
        switches, c = self._switches(), self.count
        state = self.states[0].copy()
        last = {row: new for item in switches for row, new in item.states}
        for row, new in last.items():
            if row >= c and state[self.step.rubbing.rows[row - c]] != FREE:
                state[row] = new
        result = [(_Switch(0.0, (), -1), state)]
        for item in switches:
            state = state.copy()
            for row, new in item.states:
                state[row] = new
            apart = state[self.step.rubbing.rows] == FREE
            shown = state[c:]
            shown[apart] = FREE
            shown[~apart & (shown == FREE) & (self.step.rubbing.static > 0.0)] = STICKS
            result.append((item, state))
        return result

    # ------------------------------------------------------------------ what they do at the instants
    def contacts(self) -> Contacts:
        """See `Contacts`."""
        segments = self._segments()
        times = np.array([item.time for item, _ in segments])
        rows = list[tuple[np.ndarray, ...]]()
        instants, counts, known = [], [], dict[tuple[bool, bytes], tuple[np.ndarray, ...]]()
        for n in range(self.steps + 1):
            first = max(int(np.searchsorted(times, n - 1, side="right")) - 1, 0)
            last = int(np.searchsorted(times, n + 1, side="left"))
            within = segments[first:last]
            if len(within) > 1 or n == self.steps:
                ends = [*times[first + 1 : last], n + 1.0]
                found = self._at(n, within, ends)
            else:
                key = n == 0, within[0][1].tobytes()
                if key not in known:
                    known[key] = self._at(n, within, [n + 1.0])
                found = known[key]
            if len(found[0]):
                instants.append(n)
                counts.append(len(found[0]))
                rows.append(found)
        factors, pushes, reads, writes = (np.concatenate(part) for part in zip(*rows))
        shifts = np.zeros((len(factors), 0))
        return Contacts(np.array(instants), np.array(counts), factors, shifts, pushes, reads, writes)

    def _at(
        self, n: int, within: list[tuple[_Switch, np.ndarray]], ends: list[float]
    ) -> tuple[np.ndarray, ...]:
        """Factors, pushes, reads and writes at an instant beside which these segments lie."""
        rank, k = len(self.scaled), len(self.units)
        by_position, by_memory = np.zeros((rank, rank)), np.zeros((rank, k))
        slips, kept, kinds = np.zeros((k, rank)), np.eye(k), dict[int, float]()
        former = None
        for (item, state), end in zip(within, ends):
            found = self._of(state)
            t, place = item.begins, math.floor(item.time)
            if t >= 0 and former is not None and n - 1 <= place <= n:
                share = item.time - place
                own, normal = self.count + t, self.step.rubbing.rows[t]
                slid = former.kept[own] + item.slope * former.kept[normal]
                along = (former.slips[own] + item.slope * former.slips[normal] + slid @ slips) / self.units[t]
                memory = slid @ kept / self.units[t]
                if place == n:
                    slips[t], kept[t], kinds[t] = along, memory, 1.0 - share
                else:
                    slips[t], kept[t], kinds[t] = share * along, share * memory, 1.0
                    kept[t, t] += 1.0
            weight = self._weight(n, item.time, end)
            by_position += weight * (found.by_position + found.by_memory @ slips)
            by_memory += weight * (found.by_memory @ kept)
            former = found
        moved, carried = np.eye(rank), np.zeros((rank, k))
        drawn, read = by_position, by_memory
        if n:
            both = np.linalg.solve(np.eye(rank) + by_position, np.column_stack([by_position, by_memory]))
            drawn, read = both[:, :rank], both[:, rank:]
            moved, carried = moved - drawn, -read
        axes, triangle, _ = linalg.qr(
            np.column_stack([drawn, read]), mode="economic", pivoting=True, check_finite=False
        )
        size = np.abs(np.diagonal(triangle))
        base = axes.T[size > LEAST * max(1.0, *size[:1])]
        written = list(kinds)
        values = np.array([kinds[t] * slips[t] for t in written]).reshape(-1, rank)
        memory = np.array([kinds[t] * kept[t] for t in written]).reshape(-1, k)
        unit = np.eye(k)[written]
        if n == self.steps:  # what does not stick there is forgotten
            gone = within[-1][1][self.count :] != STICKS
            rest = [t for t in range(k) if gone[t]]
            stay = [a for a, t in enumerate(written) if not gone[t]]
            values = np.concatenate([values[stay], np.zeros((len(rest), rank))])
            memory = np.concatenate([memory[stay], np.zeros((len(rest), k))])
            unit = np.concatenate([unit[stay], np.eye(k)[rest]])
        factors = np.concatenate([base @ drawn, -values @ moved]) @ self.thin
        pushes = np.concatenate([base @ self.thin, np.zeros((len(unit), self.thin.shape[1]))])
        reads = np.concatenate([base @ read, unit - memory - values @ carried])
        writes = np.concatenate([np.zeros((len(base), k)), unit])
        return factors, pushes, reads, writes

    def _weight(self, n: int, begin: float, end: float) -> float:
        """Integral of an instant's hat function between two times; at the first and last one of half of it,
        twice.
        """
        first, last = 0.0 if n == 0 else -1.0, 0.0 if n == self.steps else 1.0
        a, b = (min(max(time - n, first), last) for time in (begin, end))
        return (b - a - 0.5 * (b * abs(b) - a * abs(a))) * (2.0 if n in (0, self.steps) else 1.0)
