"""Compiled time steps of a reduced model with contact.

One step is linear in the modal forces: with per-mode coefficients the state advances as
q1 = aqq q + aqv v + bq p0 + dq p1 + cq (r0 + r1), v1 = avq q + avv v + bv p0 + dv p1 + cv (r0 + r1), where p
are the modal forces of the loads at both ends and r = C^T force those of contact. The gap at the step's end
is W force + free gap with the constant W = C diag(cq) C^T + R, its contact problem is solved by `pivoting`,
where it is told how kernels are written, with friction by `rubbing`: there tangential rows stand behind the
normal ones, and of the step before their slips count too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .compiled import compiled_loops, inner_loops, typeof, typeof_impl, types
from .friction import STICKS, Rubbing
from .law import FREE, RowLaws
from .pivoting import add_rows, caught, contact_forces, products
from .problem import Problem, Sets, rubbing_room
from .rubbing import rubbing_forces
from .step_data import NEVER, Halving, Marched, StepConstants, StepHistory, StepLoads, StepState
from .step_work import End, energy_of_modes, lost_to_friction, work_of_contact


class Room(NamedTuple):
    """Room for steps: the inverses of each level, their members, states and places, with which `sets` are
    those of a level; both ends of a step and gaps in the thin space (r,).
    """

    inverses: np.ndarray
    members: np.ndarray
    known: np.ndarray
    places: np.ndarray
    sets: Sets
    before: End
    after: End
    thin: np.ndarray


def step_constants(
    coefficients: Sequence[np.ndarray],
    factors: tuple[np.ndarray, np.ndarray],
    residual: np.ndarray,
    rows: tuple[RowLaws, Rubbing],
    omega: np.ndarray,
    halving: Halving = NEVER,
) -> StepConstants:
    """`StepConstants` from coefficients (10, m) of a step and of its halves, quarters .. and arrays in any
    layout: the factors U (pairs, r) and V (m, r), see `closed_sets.thin_factors`, and R, and what the normal
    and the tangential rows are.
    """
    (left, right), (laws, rubbing) = factors, rows
    flexibility = [left @ ((right.T * each[4]) @ right) @ left.T + residual for each in coefficients]
    return StepConstants(
        coefficients=np.ascontiguousarray(coefficients),
        left=np.ascontiguousarray(left.T),
        right=np.ascontiguousarray(right.T),
        flexibility=np.ascontiguousarray(flexibility),
        residual=np.ascontiguousarray(residual),
        laws=laws.table,
        rubbing=rubbing,
        stiffness=omega**2,
        halving=halving,
    )


def empty_room(step: StepConstants) -> Room:
    """Room for steps with these constants."""
    rank, pairs = step.left.shape
    levels, _, modes = step.coefficients.shape

    def end() -> End:
        q, v, pull, force, gap = (np.empty(size) for size in (modes, modes, modes, pairs, pairs))
        return End(q, v, pull, force, gap, np.empty(pairs, dtype=np.int8))

    members, inverses = np.full((levels, pairs + 1), -1), np.empty((levels, pairs, pairs))
    known, places = np.zeros((levels, pairs), dtype=np.int8), np.zeros((levels, pairs), dtype=np.int64)
    sets = Sets(False, inverses[0], known[0], members[0], places[0], *rubbing_room(pairs))
    return Room(inverses, members, known, places, sets, end(), end(), np.empty(rank))


def march(
    step: StepConstants,
    loads: StepLoads,
    state: StepState,
    history: StepHistory,
    kept: tuple[Room, Address] | None = None,
) -> Marched:
    """Advance a reduced model over several steps; the state and the history are written in place. What is
    `kept` from call to call is `begun` of these constants.
    """
    external = loads.external if loads.external.any() else loads.external[:0]
    loads, kept = StepLoads(*map(np.ascontiguousarray, (external, *loads[1:]))), kept or begun(step)
    return Marched(*_march(step, loads, state, history, *kept))


def begun(step: StepConstants) -> tuple[Room, Address]:
    """What steps with these constants need beside them: room, and what solves their contact problems."""
    room = empty_room(step)
    return room, contact_kernel(step, room)


@inner_loops
def _begin(step: StepConstants, loads: StepLoads, state: StepState, room: Room) -> None:
    """The first end of the first step."""
    rank, pairs = step.left.shape
    every, end = room.sets.every, room.before
    count = step.rubbing.beside.size
    for level in range(room.members.shape[0]):
        room.members[level, pairs] = -1
    for j in range(end.q.size):
        end.q[j], end.v[j], end.pull[j] = state.q[j], state.v[j], 0.0
    for i in range(pairs):
        end.force[i], end.rows[i], end.gap[i] = state.force[i], state.rows[i], loads.free_gap[0, i]
    products(step.left, end.force, rank, (pairs, pairs), room.thin)
    add_rows(step.right, every, room.thin, rank, (end.q.size, end.q.size), end.pull)
    products(step.right, end.q, rank, (end.q.size, end.q.size), room.thin)
    add_rows(step.left, every, room.thin, rank, (pairs, pairs), end.gap)
    add_rows(step.residual, every, end.force, pairs, (pairs, pairs), end.gap)
    for i in range(count):
        if end.rows[i] != FREE:
            end.gap[i] = step.laws.place[end.rows[i], i]
    for i in range(count, pairs):
        end.gap[i] = state.slip[i - count]


# numba looks for the kind of arguments for a millisecond, which is as long as a period.
_addresses: dict[tuple, Address] = {}


class Address(types.WrapperAddressProtocol):
    """Where the code of a kernel for arguments as those given stands; kernels take it for a function."""

    def __init__(self, kernel: Any, *arguments: object):
        kinds = tuple(map(typeof, arguments))
        kernel.compile(kinds)
        found = kernel.overloads[kinds]
        self._signature = found.signature
        self.kind = types.FunctionType(found.signature)
        self._place = found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name)

    def __wrapper_address__(self) -> int:
        return int(self._place)

    def signature(self) -> Any:
        """What numba calls it with."""
        return self._signature


# numba would make it for each call of a kernel, which is as long as half of a short period.
typeof_impl.register(Address, lambda address, context: address.kind)


def contact_kernel(step: StepConstants, room: Room) -> Address:
    """What solves the contact problems of steps."""
    end, rubs = room.before, step.rubbing.rows.size > 0
    laws, gaps = (step.laws, step.rubbing), (end.gap, room.after.gap)
    given = Problem(step.flexibility[0], *gaps, *laws, end.rows, room.sets, end.force)
    layout = (rubs, _layout_of(given))
    if layout not in _addresses:
        _addresses[layout] = Address(rubbing_forces if rubs else contact_forces, given)
    return _addresses[layout]


def _layout_of(given: Any) -> object:
    """What tells kinds of arguments apart: of arrays dimensions, numbers and places in memory."""
    if isinstance(given, tuple):
        return tuple(map(_layout_of, given))
    return (given.ndim, given.dtype.char, given.flags.num) if isinstance(given, np.ndarray) else type(given)


@inner_loops
def _sets(room: Room, level: int) -> Sets:
    """Those of a level."""
    of, inverse, known = room.sets, room.inverses[level], room.known[level]
    found = of.sharp, inverse, known, room.members[level], room.places[level], of.right, of.solved, of.free
    return Sets(*found, of.following, of.rates, of.kept, of.landed, of.waits, of.told, of.seen, of.every)


@inner_loops
def _touch(
    step: StepConstants, free_gap: np.ndarray, state: StepState, room: Room, forces_of: Callable[..., int]
) -> bool:
    """Contact at an instant from which no step leads back, where the modes are, under the free gaps (pairs,),
    from the slips and states before: forces, states and slips of `state` are written; whether there is a
    solution.
    """
    (q, _, force, rows, slip), gap, former = state, room.before.gap, room.after.gap
    pairs, count, m, rank, touches = gap.size, gap.size - slip.size, q.size, room.thin.size, False
    for i in range(pairs):
        gap[i], force[i] = free_gap[i], 0.0
    products(step.right, q, rank, (m, m), room.thin)
    add_rows(step.left, room.sets.every, room.thin, rank, (pairs, pairs), gap)
    for i in range(count):
        former[i] = 0.0
        if slip.size == 0:
            rows[i] = caught(step.laws, i, gap[i])
        touches |= rows[i] != FREE or caught(step.laws, i, gap[i]) != FREE
    for k in range(slip.size):
        former[count + k] = slip[k]
    sets = _sets(room, 0)
    if touches:
        sets.members[pairs] = -1
        given = Problem(step.residual, gap, former, step.laws, step.rubbing, rows, sets, force)
        if forces_of(given) < 0:
            return False
    for k in range(slip.size):
        if rows[count + k] != STICKS:
            slip[k] = sets.free[count + k] if touches else gap[count + k]
    return True


@inner_loops
def _take(step: StepConstants, loads: StepLoads, place: tuple[int, int, float, float], room: Room) -> bool:
    """A step of a level without the contact at its end, from one share of a given step to another; whether
    there is any.
    """
    (level, done, begin, end), before, after = place, room.before, room.after
    coefficients, left, right = step.coefficients[level], step.left, step.right
    external, free_gap, _ = loads
    q, v, pull = after.q, after.v, after.pull
    rank, pairs = left.shape
    m, every, count = q.size, room.sets.every, step.rubbing.beside.size
    for j in range(m):
        q[j] = (
            coefficients[0, j] * before.q[j]
            + coefficients[1, j] * before.v[j]
            + coefficients[4, j] * before.pull[j]
        )
        v[j] = (
            coefficients[5, j] * before.q[j]
            + coefficients[6, j] * before.v[j]
            + coefficients[9, j] * before.pull[j]
        )
    if external.shape[0] > 0:
        for j in range(m):
            first, last = external[done, j], external[done + 1, j]
            former, following = (1.0 - begin) * first + begin * last, (1.0 - end) * first + end * last
            q[j] += coefficients[2, j] * former + coefficients[3, j] * following
            v[j] += coefficients[7, j] * former + coefficients[8, j] * following
    products(right, q, rank, (m, m), room.thin)
    for i in range(pairs):
        after.gap[i] = (1.0 - end) * free_gap[done, i] + end * free_gap[done + 1, i]
    add_rows(left, every, room.thin, rank, (pairs, pairs), after.gap)
    pulled = False
    for i in range(pairs):
        after.rows[i] = before.rows[i]
    for i in range(count):
        pulled |= (before.rows[i] != FREE) | (caught(step.laws, i, after.gap[i]) != FREE)
    for j in range(m):
        pull[j] = 0.0
    if not pulled:
        for i in range(pairs):
            after.force[i] = 0.0
        for i in range(count, pairs):
            room.sets.kept[i] = before.gap[i]
        room.sets.told[room.sets.told.size - 1] = 0
    return pulled


@inner_loops
def _push(step: StepConstants, level: int, room: Room) -> None:
    """Let contact at the end of a step act in it, and put gaps of held rows in their place."""
    coefficients, left, right, after = step.coefficients[level], step.left, step.right, room.after
    q, v, pull, free = after.q, after.v, after.pull, room.sets.free
    rank, pairs = left.shape
    m, every, count = q.size, room.sets.every, step.rubbing.beside.size
    for i in range(count):
        rest = after.rows[i]
        after.gap[i] = free[i] if rest == FREE else step.laws.place[rest, i]
    for i in range(count, pairs):
        after.gap[i] = room.sets.kept[i] if after.rows[i] == STICKS else free[i]
    products(left, after.force, rank, (pairs, pairs), room.thin)
    add_rows(right, every, room.thin, rank, (m, m), pull)
    for j in range(m):
        q[j] += coefficients[4, j] * pull[j]
        v[j] += coefficients[9, j] * pull[j]


@inner_loops
def _follow(before: End, after: End) -> None:
    """The next step begins where this one ends: structures of arrays that change places take longer."""
    for j in range(after.q.size):
        before.q[j], before.v[j], before.pull[j] = after.q[j], after.v[j], after.pull[j]
    for i in range(after.gap.size):
        before.force[i], before.rows[i], before.gap[i] = after.force[i], after.rows[i], after.gap[i]


@inner_loops
def _tell(history: StepHistory, place: int, end: End) -> None:
    """What the motion is at an end of a step."""
    for j in range(end.q.size):
        history.states[place, j] = end.q[j]
        history.velocities[place, j] = end.v[j]
    for i in range(end.force.size):
        history.forces[place, i] = end.force[i]
    for i in range(history.rows.shape[1]):
        history.rows[place, i] = end.rows[i]


@inner_loops
def _tell_landings(history: StepHistory, done: int, pairs: int, sets: Sets) -> None:
    """Where rows land in a step."""
    count = pairs - history.landings.shape[1]
    for k in range(history.landings.shape[1] if sets.told[sets.told.size - 1] != 0 else 0):
        for n in range(3):
            history.landings[done, k, n] = sets.landed[count + k, n]
    for i in range(history.told.shape[1]):
        history.told[done, i] = sets.told[i]


@compiled_loops
def _march(
    step: StepConstants,
    loads: StepLoads,
    state: StepState,
    history: StepHistory,
    room: Room,
    forces_of: Callable[..., int],
) -> tuple[int, int, int, int]:
    works, parts, losses, kept = history.work, history.parts, history.lost, history.kept
    halving, levels, rubbing = step.halving, loads.levels, step.rubbing
    steps, m, pairs, last = levels.size, state.q.size, state.force.size, step.coefficients.shape[0] - 1
    exchanges = unresolved = taken = 0
    touched = history.states.shape[0] - steps
    if touched > 0 and not _touch(step, loads.free_gap[0], state, room, forces_of):
        return 0, 0, 0, 0
    _begin(step, loads, state, room)
    before, after = room.before, room.after
    if touched > 0:
        _tell(history, 0, before)
    for done in range(steps):
        works[done] = 0.0
        if losses.size > 0:
            losses[done] = 0.0
        first: int = np.int64(levels[done])  # type: ignore[assignment]  # to numba no int8
        level, place, whole = first, 0, 1 << (last - first)
        while place < whole:
            size = 1 << (last - level)
            exchange = 0
            if _take(step, loads, (level, done, place / whole, (place + size) / whole), room):
                flexibility, sets = step.flexibility[level], _sets(room, level)
                given = Problem(
                    flexibility, after.gap, before.gap, step.laws, rubbing, after.rows, sets, after.force
                )
                exchange = forces_of(given)
                if exchange < 0:
                    return done, exchanges, unresolved, taken
                _push(step, level, room)
            exchanges += exchange
            lost = lost_to_friction(step.flexibility[level], rubbing, room.sets.kept, before, after)
            if exchange > 0:  # where no row changes sides there is no work
                work = work_of_contact(before, after) + lost
                if abs(work) > halving.tolerance * (energy_of_modes(step.stiffness, after) + halving.floor):
                    if level < last:
                        level += 1
                        continue
                    unresolved += 1
                works[done] += work
            if losses.size > 0:
                losses[done] += lost
            _follow(before, after)
            place += size
            if parts.size > 0:
                parts[taken] = level
            taken += 1
            # a second half is done, and with it what it is a half of
            while level > first and place % (1 << (last - level + 1)) == 0:
                level -= 1
        _tell(history, touched + done, before)
        _tell_landings(history, done, pairs, room.sets)
    for j in range(m):
        state.q[j], state.v[j] = before.q[j], before.v[j]
    for i in range(pairs):
        state.force[i], state.rows[i] = before.force[i], before.rows[i]
    for k in range(rubbing.rows.size):
        state.slip[k] = before.gap[rubbing.beside.size + k]
    for k in range(kept.size):
        kept[k] = room.sets.kept[rubbing.beside.size + k]
    return steps, exchanges, unresolved, taken
