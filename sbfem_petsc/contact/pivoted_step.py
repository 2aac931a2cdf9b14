"""Contact on the host: of an instant, and by Lemke's method of a time step or an instant that kernels find no
solution of.
"""

from __future__ import annotations

import numpy as np

from ..errors import SolveError
from .complementarity import Complementarity
from .friction import Friction, Memory
from .friction_solve import solve_friction
from .held_rows import Sets
from .law import RowLaws
from .rubbing import Problem, smooth_forces
from .step_data import StepConstants, StepHistory, StepLoads, StepState


def pivoted_step(step: StepConstants, loads: StepLoads, state: StepState, history: StepHistory) -> bool:
    """Take one step, of which kernels find no solution, by Lemke's method; whether there is one. What lands
    is held where it stood before.
    """
    level, count, (q, v, force, rows, slip) = loads.levels[0], step.rubbing.beside.size, state
    a, pull = step.coefficients[level], step.left @ force @ step.right
    ends = [a[n] * q + a[n + 1] * v + a[n + 4] * pull for n in (0, 5)]
    for n, end in zip((2, 7), ends if len(loads.external) else []):
        end += a[n] * loads.external[0] + a[n + 1] * loads.external[1]
    gap = loads.free_gap[0] + (step.right @ q) @ step.left + step.residual @ force
    gap[count:] = slip
    free = loads.free_gap[1] + (step.right @ ends[0]) @ step.left
    memory = Memory(slip, force[count:], force[:count], rows[:count], rows[count:], np.zeros(count), slip)
    friction, found = _pivoted(step, step.flexibility[level], free, memory)
    if found is None:
        return False
    lost = Memory.of(found, count).lost_since(memory, friction)
    history.work[0] = 0.5 * (force + found.force) @ (found.gap - gap) + lost
    pull = step.left @ found.force @ step.right
    told = [ends[0] + a[4] * pull, ends[1] + a[9] * pull, found.force, found.state, found.gap[count:]]
    history.states[0], history.velocities[0], history.forces[0] = told[:3]
    history.rows[:1] = found.state if history.rows.size else 0
    history.kept[:], history.lost[:1], history.parts[:1] = slip[: len(history.kept)], lost, level
    for part, value in zip(state, told):
        part[:] = value
    return True


def touch(step: StepConstants, free_gap: np.ndarray, state: StepState, sets: Sets) -> bool:
    """Contact at an instant from which no step leads back, under the gaps without forces (pairs,), from the
    slips and states before: forces, states and slips of `state` are written, and room for what solves it;
    whether there is a solution.
    """
    count, (_, _, force, rows, slip), laws = step.rubbing.beside.size, state, (step.laws, step.rubbing)
    sets.members[-1] = -1
    if not len(slip):
        rows[:] = RowLaws(step.laws).touched(free_gap)
        problem = Problem(step.residual, free_gap, free_gap, *laws, rows, sets, force)
        return not rows.any() or smooth_forces(problem) >= 0
    nothing, along = np.zeros(count), np.zeros(len(slip))
    memory = Memory(slip, along, nothing, rows[:count], rows[count:], nothing, slip)
    _, found = _pivoted(step, step.residual, free_gap, memory, sets)
    if found is None:
        return False
    force[:], rows[:], slip[:] = found.force, found.state, found.gap[count:]
    return True


def _pivoted(
    step: StepConstants,
    flexibility: np.ndarray,
    free_gap: np.ndarray,
    memory: Memory,
    sets: Sets | None = None,
) -> tuple[Friction, Complementarity | None]:
    """What rubs, and the solution, None where there is none."""
    friction = Friction(step.rubbing.rows, step.rubbing.kinetic, step.rubbing.static)
    try:
        return friction, solve_friction(flexibility, free_gap, RowLaws(step.laws), friction, memory, sets)
    except SolveError:
        return friction, None
