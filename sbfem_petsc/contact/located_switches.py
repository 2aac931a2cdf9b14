"""The variational equation of a history of time steps, each switch located inside its step.

Steps tell a switch to an instant of their grid, so that multipliers jump where one passes it. Here a row
touches where its gap without its own force, linear over the step, reaches the one that is kept; where rows
rub (of periodic histories) one sticks until its friction, carried on, is above its bound, and slips until
the slip turns about, up to half a step before or behind the instant at which it was last seen to slip. From
a switch to the next one contact acts by what `closed_sets` makes of the set, and a row begins to keep the
slip that it has at its switch. Sets act at an instant by their shares of the steps beside it, where rows
rub weighted by its hat function: the slip at a switch is interpolated between the instants beside it. What
is left of the jumps is of second order in the step. What lands does so later where its gap is more, and has
slid on by then.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import sparse

from .closed_sets import ClosedSets
from .friction import ALONG, STICKS
from .law import FREE, PRESSED, PULLED
from .step_data import StepConstants
from .step_tangent import LEAST, directions
from .tangent import Contacts, repeated, thin_axes

# Numbers that several instants may take at a time.
_ROOM = 1 << 22

Gaps = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Switches(NamedTuple):
    """Of all rows, in the order of time.

    Attributes
    ----------
    time : (s,) array
        In steps, in [0, n].
    rows, states : (s, 2) int arrays
        Rows that switch, the second one -1 where it is one alone, and the states that they go on to.
    begins : (s,) int array
        Which slip is kept from then on, -1: none.
    slope : (s,) array
        By how much that is more for each metre by which the gap is, for the row lands later.
    """

    time: np.ndarray
    rows: np.ndarray
    states: np.ndarray
    begins: np.ndarray
    slope: np.ndarray


class _Segments(NamedTuple):
    """What holds from time 0 and each switch on: (s + 1,) times, numbers of the sets, slips that begin to be
    kept and slopes, and the states of tangential rows at the end, (k,).
    """

    time: np.ndarray
    number: np.ndarray
    begins: np.ndarray
    slope: np.ndarray
    last: np.ndarray


def located_contacts(
    step: StepConstants,
    history: tuple[np.ndarray, np.ndarray, np.ndarray],
    gaps: Gaps,
    units: np.ndarray,
    sets: ClosedSets,
) -> Contacts:
    """Of a history, with rows that rub of a periodic one.

    Parameters
    ----------
    step : StepConstants
    history : (n + 1, c + k) int8 and float arrays, (n, k, 3) array
        States of the rows at the steps' ends, their forces, and where they land (`step_data.StepHistory`).
    gaps : callable
        Gaps and slips of rows at instants, (k,) and (k,) int arrays.
    units : (k,) array
        Those of the slips in the state, m.
    sets : ClosedSets
    """
    steps, k = len(history[0]) - 1, len(units)
    segments, states = _segments(step, history[0], switches(step, history, gaps, sets))
    scaled, unscaled = thin_axes(step.right, step.coefficients[0, 4])
    known = [sets[state] for state in states]
    position, memory, slips, kept = (np.array([item[n] for item in known]) for n in range(4))
    acting = np.concatenate([scaled.T @ position @ scaled, scaled.T @ memory * units], axis=2)
    operators = acting, np.concatenate([slips @ scaled, kept * units], axis=2)
    # an instant beside which one segment lies is like all others of its set, but the first and the last one
    instants = np.arange(steps + 1)
    first = np.maximum(np.searchsorted(segments.time, instants - 1, side="right") - 1, 0)
    count = np.searchsorted(segments.time, instants + 1, side="left") - first
    alike = (count == 1) & (instants < steps)
    key = np.where(alike, 2 * segments.number[first] + (instants == 0), 2 * len(states) + instants)
    _, kinds, which = np.unique(key, return_index=True, return_inverse=True)
    size = max(_ROOM // ((len(scaled) + k) ** 2 + 1), 1)
    parts = [
        _rows(kinds[a : a + size], (first, count), segments, operators, units)
        for a in range(0, len(kinds), size)
    ]
    of = np.concatenate([part[0] + a * size for a, part in enumerate(parts)])
    factors, pushes, reads, writes = (np.concatenate(part) for part in list(zip(*parts))[1:])
    sizes = np.bincount(of, minlength=len(kinds))
    order = np.argsort(of, kind="stable")[repeated(sizes, which)]
    thin, counts = unscaled.T @ step.right, sizes[which]
    factors, pushes = ((part @ thin)[order] for part in (factors, pushes))
    acts = counts > 0
    return Contacts(instants[acts], counts[acts], factors, pushes, reads[order], writes[order])


# ---------------------------------------------------------------------- where rows switch
def switches(
    step: StepConstants,
    history: tuple[np.ndarray, np.ndarray, np.ndarray],
    gaps: Gaps,
    sets: ClosedSets,
) -> Switches:
    """See `located_contacts`."""
    (states, forces, landings), rubbing = history, step.rubbing
    count, steps = rubbing.beside.size, len(states) - 1
    touching = states[:, :count] != FREE
    n, i = np.nonzero(touching[1:] != touching[:-1])
    opens, beside = touching[n, i], rubbing.beside[i]
    at, other = np.where(opens, n, n + 1), np.where(opens, n + 1, n)
    acting = forces[at, i]
    overlap = np.abs(acting) / np.abs([sets[state].stiffness[row] for state, row in zip(states[at], i)])
    pulled = acting < 0.0
    place = step.laws.place[np.where(pulled, PULLED, PRESSED), i]
    apart = np.maximum((gaps(other, i) - place) * np.where(pulled, -1.0, 1.0), 0.0)
    time = n + np.where(opens, overlap, apart) / np.maximum(overlap + apart, 1e-300)
    after = states[n + 1]
    rows = np.column_stack([i, beside])
    gone = np.column_stack([after[np.arange(len(n)), row] for row in rows.T])
    begins = np.where((beside >= 0) & (gone[:, 1] == STICKS), beside - count, -1)
    slope, lands = np.zeros(len(n)), np.flatnonzero(begins >= 0)
    share, _, more = landings[n[lands], begins[lands]].T
    slope[lands] = np.where(share > 0.0, more / np.where(share > 0.0, share, 1.0), 0.0)
    slipped = [item for k in range(len(rubbing.rows)) for item in _slips(step, history, gaps, (sets, k))]
    if slipped:
        own, row, state, kept = (np.array(part) for part in zip(*slipped))
        time, begins = np.append(time, own), np.append(begins, kept)
        rows = np.concatenate([rows, np.column_stack([row, np.full(len(row), -1)])])
        gone = np.concatenate([gone, np.column_stack([state, state])])
        slope = np.append(slope, np.zeros(len(row)))
        time[time < 0.0] += steps
    order = np.argsort(time, kind="stable")
    return Switches(time[order], rows[order], gone[order], begins[order], slope[order])


def _slips(
    step: StepConstants,
    history: tuple[np.ndarray, np.ndarray, np.ndarray],
    gaps: Gaps,
    of: tuple[ClosedSets, int],
) -> list[tuple[float, int, int, int]]:
    """Times, the row, states and the slip that begins, -1, of a tangential row in steps between whose ends it
    stays pressed.
    """
    (states, forces, _), (sets, k), found = history, of, list[tuple[float, int, int, int]]()
    row, normal, bound = step.rubbing.beside.size + k, step.rubbing.rows[k], step.rubbing.kinetic[k]
    held = states[:, normal] != FREE
    changed = np.flatnonzero((states[1:, row] != states[:-1, row]) & held[1:] & held[:-1])
    places = np.stack([(changed - 1) % (len(states) - 1), changed, changed + 1])
    slips = gaps(places.ravel(), np.full(places.size, row)).reshape(places.shape)
    begun = 0.0
    for n, former, now, later in zip(changed.tolist(), *slips.tolist()):
        before, after = int(states[n, row]), int(states[n + 1, row])
        trial = states[n + 1].copy()
        trial[row] = STICKS
        closed = sets[trial]
        sense = 1.0 if (after if before == STICKS else before) == ALONG else -1.0
        # of the bound less the friction, N/m, with the slip to either side
        along, against = np.abs(
            bound * closed.pressing[k] - np.array([sense, -sense]) * closed.stiffness[row]
        )
        margins = np.maximum(bound * forces[n : n + 2, normal] - sense * forces[n : n + 2, row], 0.0)
        moved = abs(later - now)
        if before == STICKS:
            begun = n + margins[0] / max(margins[0] + along * moved, 1e-300)
            found.append((begun, row, after, -1))
            continue
        since = max(begun, n - 1.0) if n else n - 1.0
        speed = max(-sense * (now - former), 0.0) / max(n - since, 1e-3)
        back = margins[1] / along if after == STICKS else moved
        middle = 0.5 * (n + since)
        begun = middle + (n + 0.5 - middle) * speed / max(speed + back, 1e-300)
        found.append((begun, row, STICKS, k))
        if after != STICKS:
            whole = 2.0 * bound * forces[n + 1, normal]
            # from where it turns about the way grows with the square of the time
            begun += (n + 1 - begun) * math.sqrt(whole / max(whole + against * moved, 1e-300))
            found.append((begun, row, after, -1))
    return found


def _segments(step: StepConstants, states: np.ndarray, found: Switches) -> tuple[_Segments, np.ndarray]:
    """And the states of the sets, each once. What sticks at the end has begun to do so before the start."""
    rubbing, rows = step.rubbing, states.shape[1]
    count, later = rubbing.beside.size, np.arange(1, len(found.time) + 1)
    table = np.full((len(later) + 1, rows), -1, dtype=np.int8)
    table[0] = states[0]
    for row, state in zip(found.rows.T, found.states.T):
        table[later[row >= 0], row[row >= 0]] = state[row >= 0]
    shown = np.maximum.accumulate(np.where(table >= 0, np.arange(len(table))[:, None], 0))
    last = table[shown[-1], np.arange(rows)][count:]
    table[0, count:] = np.where(states[0, rubbing.rows] != FREE, last, table[0, count:])
    table = table[shown, np.arange(rows)]
    along, apart = table[:, count:], table[:, rubbing.rows] == FREE
    along[apart] = FREE
    along[~apart & (along == FREE) & (rubbing.static > 0.0)] = STICKS
    known: dict[bytes, int] = {}
    number = np.array([known.setdefault(state.tobytes(), len(known)) for state in table])
    _, once = np.unique(number, return_index=True)
    time, begins, slope = (
        np.append(value, of) for value, of in ((0.0, found.time), (-1, found.begins), (0.0, found.slope))
    )
    return _Segments(time, number, begins, slope, along[-1]), table[once]


# ---------------------------------------------------------------------- what they do at the instants
def _rows(
    instants: np.ndarray,
    within: tuple[np.ndarray, np.ndarray],
    segments: _Segments,
    operators: tuple[np.ndarray, np.ndarray],
    units: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """To which of the instants each row belongs, factors and pushes in the thin space, reads and writes.

    With the directions C that contact has at an instant, of P = C C^T P and L, thin forces behind it are
    C (1 + C^T P C)^-1 C^T (P y + L m), but at the first one, that no step comes before.
    """
    rank, k, steps = operators[0].shape[1], len(units), len(within[0]) - 1
    acting, begun, counted = _acting(instants, within, segments, operators, units)
    gone = segments.last != STICKS  # is forgotten there
    columns = acting.swapaxes(1, 2).copy()
    base, counts = np.zeros((len(instants), rank, rank)), np.zeros(len(instants), dtype=np.int64)
    directions(columns, LEAST, base, counts)
    base = base[:, : counts.max(initial=0)]
    forces = base @ acting
    moved = np.where(instants[:, None, None] > 0, forces[:, :, :rank] @ base.swapaxes(1, 2), 0.0)
    forces = np.linalg.solve(moved + np.eye(base.shape[1]), forces)
    own, direction = np.nonzero(np.arange(base.shape[1]) < counts[:, None])
    of, t = np.nonzero((counted > 0.0) | (instants == steps)[:, None] & gone)
    counted[instants == steps] *= ~gone
    memory = counted[of, t, None] * begun[of, t]
    behind = (memory[:, None, :rank] @ base[of].swapaxes(1, 2) @ forces[of])[:, 0]
    memory -= np.where(instants[of, None] > 0, behind, 0.0)
    unit, drawn, nothing = np.eye(k)[t], forces[own, direction], np.zeros((len(own), k))
    return (
        np.append(own, of),
        np.concatenate([drawn[:, :rank], -memory[:, :rank]]),
        np.concatenate([base[own, direction], np.zeros((len(of), rank))]),
        np.concatenate([drawn[:, rank:], unit - memory[:, rank:]]),
        np.concatenate([nothing, unit]),
    )


def _acting(
    instants: np.ndarray,
    within: tuple[np.ndarray, np.ndarray],
    segments: _Segments,
    operators: tuple[np.ndarray, np.ndarray],
    units: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P and L of the instants side by side, (n, r, r + k), what slips that are kept from there on are of
    position and memory, (n, k, r + k), and by how much these count, (n, k), 0 where none begins.

    Operators are K and L of the sets side by side, (s, r, r + k), and S and N of slips and gaps beside them,
    (s, 2 k, r + k), in the scaled thin space and units of the memory.
    """
    (table, seen), k, steps = operators, len(units), len(within[0]) - 1
    rank, count = table.shape[1], within[1][instants]
    owner = np.repeat(np.arange(len(instants)), count)
    later = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    segment, n = within[0][instants][owner] + later, instants[owner]
    time, of = segments.time[segment], segments.number[segment]
    least, most = np.maximum(n - 1, 0), np.minimum(n + 1, steps)
    until = np.append(segments.time[1:], steps)[segment]
    begin, end = (np.clip(at, least, most) - n for at in (time, until))
    if k:  # by hat functions, as slips are interpolated
        begin, end = (2.0 * at - at * np.abs(at) for at in (begin, end))
    weight = (end - begin) / (most - least)
    ends = np.append(0, np.cumsum(count))
    shares = sparse.csr_array((weight, of, ends), shape=(len(instants), len(table)))
    acting = (shares @ table.reshape(len(table), -1)).reshape(len(instants), rank, rank + k)
    changed, counts = np.zeros((len(instants), k, rank + k)), np.zeros((len(instants), k))
    if not k:
        return acting, changed, counts
    # where slips begin to be kept, beside what the memory has: one segment after the other
    place = np.floor(time)
    new = (later > 0) & (segments.begins[segment] >= 0) & (n - 1 <= place) & (place <= n)
    some = np.isin(owner, owner[new])
    for j in range(1, later[some].max(initial=0) + 1):
        at = np.flatnonzero(some & (later == j))
        begins = at[new[at]]
        kind, item = owner[begins], segment[begins]
        t, former, slope = segments.begins[item], segments.number[item - 1], segments.slope[item, None]
        slid = seen[former, t] + slope * seen[former, k + t]
        slid += (slid[:, None, rank:] @ changed[kind])[:, 0]
        here, share = place[begins] == n[begins], time[begins] - place[begins]
        counts[kind, t] = np.where(here, 1.0 - share, 1.0)
        changed[kind, t] = (np.where(here, 1.0, share) / units[t])[:, None] * slid
        changed[kind, t, rank + t] -= here
        acting[owner[at]] += weight[at, None, None] * (table[of[at], :, rank:] @ changed[owner[at]])
    changed[:, :, rank:] += np.eye(k)
    return acting, changed, counts
