"""Compiled repetition of a period of steps until a motion repeats itself or comes near one that is known."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .compiled import compiled_loops
from .law import FREE
from .marching import Room, _march, begun
from .step_data import StepConstants, StepHistory, StepLoads, StepState

# What a motion has come to; from 0 on the number of a known one.
UNSOLVED, UNSETTLED, REPEATS = -3, -2, -1


class Patience(NamedTuple):
    """When a history is told to have settled.

    Attributes
    ----------
    longest : int
        Most of the loads' periods after which a motion may repeat itself.
    tolerance : float
        Change of the state, relative to the linear steady state, below which it has.
    limit : int
        Of the loads' periods that a history is followed.
    """

    longest: int
    tolerance: float
    limit: int


class Known(NamedTuple):
    """Motions that are known.

    Attributes
    ----------
    weights : (m,) array
        Of q in the norm of states, rad/s.
    units : (s,) array
        Of slips there, m; (0,) where nothing rubs.
    states : (k, 2 m + s) array
        (weights q, v, slip / units) at the beginning of a period, slips of the instant before.
    radii : (k,) array
        Distance at which each is reached.
    size : float
        Norm of the linear steady state.
    """

    weights: np.ndarray
    units: np.ndarray
    states: np.ndarray
    radii: np.ndarray
    size: float


class _Repetition(NamedTuple):
    """Room for what the last periods began with (longest + 1, 2 m + s), and for the steps of one."""

    recent: np.ndarray
    history: StepHistory
    steps: Room


def settle(
    step: StepConstants,
    free_gap: np.ndarray,
    state: tuple[np.ndarray, np.ndarray, np.ndarray],
    known: Known,
    patience: Patience,
) -> tuple[int, int, int]:
    """Repeat a period from a state.

    Parameters
    ----------
    step : StepConstants
    free_gap : (n + 1, pairs) array
        Over the period.
    state : ((m,), (m,), (s,)) arrays
        q, v and the slips of the instant before; advanced in place.
    known : Known
    patience : Patience

    Returns
    -------
    outcome, periods, repeats : int
        Number of the known state that is reached, or REPEATS, UNSETTLED, UNSOLVED (a contact problem);
        periods done; periods after which the motion repeats itself, 0 unless it does.
    """
    steps, pairs, m, slips = len(free_gap) - 1, step.left.shape[1], len(known.weights), len(known.units)
    told = np.empty((steps + 1, m)), np.empty((steps + 1, m)), np.empty((steps + 1, pairs)), np.empty(steps)
    stepping, forces_of = begun(step)
    room = _Repetition(
        np.zeros((patience.longest + 1, 2 * m + slips)),
        StepHistory(*told, kept=np.empty(slips)),
        stepping,
    )
    moving = StepState(*state[:2], np.zeros(pairs), np.zeros(pairs, dtype=np.int8), state[2])
    loads = StepLoads(np.zeros((0, m)), np.ascontiguousarray(free_gap), np.zeros(steps, dtype=np.int8))
    return _settle(step, loads, moving, (known, patience), room, forces_of)


@compiled_loops
def _settle(
    step: StepConstants,
    loads: StepLoads,
    state: StepState,
    until: tuple[Known, Patience],
    room: _Repetition,
    forces_of: Callable[..., int],
) -> tuple[int, int, int]:
    """See `settle`."""
    (q, v, _, rows, slip), (known, patience), recent = state, until, room.recent
    steps, m, (kept, size) = loads.free_gap.shape[0] - 1, q.size, recent.shape
    change_allowed = (patience.tolerance * known.size) ** 2
    for done in range(patience.limit + 1):
        place = done % kept
        for j in range(m):
            recent[place, j] = known.weights[j] * q[j]
            recent[place, m + j] = v[j]
        for k in range(slip.size):
            recent[place, 2 * m + k] = slip[k] / known.units[k]
        for k in range(known.radii.size):
            distance = 0.0
            for j in range(size):
                distance += (recent[place, j] - known.states[k, j]) ** 2
            if distance <= known.radii[k] ** 2:
                return k, done, 0
        for n in range(1, min(done, kept - 1) + 1):
            change, other = 0.0, (done - n) % kept
            for j in range(size):
                change += (recent[place, j] - recent[other, j]) ** 2
            if change <= change_allowed:
                return REPEATS, done, n
        if done == patience.limit:
            break
        for i in range(rows.size):
            rows[i] = FREE
        reached, _, _, _ = _march(step, loads, state, room.history, room.steps, forces_of)
        if reached < steps:
            return UNSOLVED, done, 0
        for k in range(slip.size):
            slip[k] = room.history.kept[k]
    return UNSETTLED, patience.limit, 0
