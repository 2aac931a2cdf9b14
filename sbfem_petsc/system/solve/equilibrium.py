"""Static equilibrium with contact: one or two linear solves and a small complementarity problem, or, where
many rows may close, one factorisation with those that are expected to.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from ...contact.complementarity import Complementarity, active_set, solve_complementarity
from ...contact.friction import Memory, solve_friction
from ...contact.law import RowLaws
from ...petsc import free, stage
from ..boundary import LoadColumns
from ..contact import bordered_contact, dual_contact
from ..contact.expected_contact import expected_contact
from ..model import Model


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Displacements at rest.

    Attributes
    ----------
    owned : (k,) array
        This rank's displacement unknowns, m.
    force, gap : (c,) arrays
        Of the contact rows, N and m.
    active : (c,) bool array
    intensities : dict of str to (float, float)
        K_I and K_II of each tip, Pa m^(1/2).
    iterations : int
        Of the active set.
    memory : Memory or None
        What faces that rub leave to the next state.
    friction_loss : float
        Lost to friction since the state before, J.
    residual : float
        ||K u - f - G' force|| / ||f||; of slender structures, whose solutions are refined, the relative size
        of the last correction.
    """

    owned: np.ndarray
    force: np.ndarray
    gap: np.ndarray
    active: np.ndarray
    intensities: dict[str, tuple[float, float]]
    iterations: int
    residual: float
    memory: Memory | None = None
    friction_loss: float = 0.0


def equilibrium(
    model: Model,
    load: LoadColumns,
    contact: bool = True,
    solve: Callable[[np.ndarray, np.ndarray, RowLaws], Complementarity] = solve_complementarity,
    memory: Memory | None = None,
) -> Equilibrium:
    """Displacements under one column of loads. Collective.

    Parameters
    ----------
    model : Model
        Held against every rigid-body motion.
    load : LoadColumns
        Of one column.
    contact : bool
        False: faces may overlap.
    solve : callable
        Solver of the complementarity problem of flexibility, free gaps and laws, where no faces rub.
    memory : Memory, optional
        Of the state before; default: faces that have never been loaded.
    """
    found = None
    if contact and solve is solve_complementarity and model.gap_operator.friction is None:
        found = _at_once(model, load)
    return _from_free_gaps(model, load, contact, solve, memory) if found is None else found


def _from_free_gaps(
    model: Model,
    load: LoadColumns,
    contact: bool,
    solve: Callable[[np.ndarray, np.ndarray, RowLaws], Complementarity],
    memory: Memory | None,
) -> Equilibrium:
    """The linear solution, what contact does to its gaps, and the solution with the contact forces."""
    gap_operator, solver = model.gap_operator, model.solver
    right, solution = model.stiffness.createVecs()
    try:
        right.array = load.forces[:, 0]
        solver.solve(right, solution, "static")
        gap = gap_operator.rows(solution.array_r) + load.gaps[:, 0] + gap_operator.initial
        result: Complementarity | None = None
        laws, friction, lost = gap_operator.laws, gap_operator.friction, 0.0
        touching = contact and laws.touched(gap[: len(laws)]).any()
        if friction is not None:
            former = Memory.none(laws, friction) if memory is None else memory
            if touching:
                result = solve_friction(model.compliance.gaps, gap, laws, friction, former)
        elif touching:
            # bordered matrices have the round-off of the assembled stiffness
            refined = model.refinement.needed(right.norm(), solution.norm())
            if solve is solve_complementarity and not refined:
                result = _without_flexibility(model, gap)
            if result is None:
                result = solve(model.compliance.gaps, gap, laws)
        if result is None:
            result = Complementarity(np.zeros(len(gap)), gap, np.zeros(len(gap), dtype=np.int8), 0)
        else:
            gap_operator.rows.add_to(right, result.force)
            solver.solve(right, solution, "static")
        if friction is not None:
            memory = Memory.of(result, len(laws))
            lost = memory.lost_since(former, friction)
        owned = solution.array_r.copy()
    finally:
        free(model.comm, right, solution)
    found = _completed(model, load, owned, result, refined=True)
    return found if friction is None else replace(found, memory=memory, friction_loss=lost)


@stage("Contact")
def _at_once(model: Model, load: LoadColumns) -> Equilibrium | None:
    """By the stiffness bordered with the rows that are expected to close, itself not factorised; None where
    that costs more, nothing is expected to close, or it is not solved to round-off.
    """
    gap_operator, forces = model.gap_operator, load.forces[:, 0]
    if model.solver.factorised or _backend(model, len(gap_operator)) is not bordered_contact.Bordered:
        return None
    rest = load.gaps[:, 0] + gap_operator.initial
    start = expected_contact(model, forces, rest)
    if start is None:
        return None
    with closing(bordered_contact.Bordered(model, forces)) as backend:
        result = active_set(backend, rest, gap_operator.laws, start)[0]
        if result is None:
            return None
        owned = backend.displacements(result.active, result.force, result.gap - rest)
    return _completed(model, load, owned, result, refined=False)


def _completed(
    model: Model, load: LoadColumns, owned: np.ndarray, result: Complementarity, *, refined: bool
) -> Equilibrium:
    """With the stress intensity factors, and how well forces are in balance."""
    solution, right = model.stiffness.createVecs()
    residual = right.duplicate()
    try:
        right.array, solution.array = load.forces[:, 0], owned
        scale = right.norm()
        model.gap_operator.rows.add_to(right, result.force)
        model.stiffness.mult(solution, residual)
        residual.axpy(-1.0, right)
        relative = residual.norm() / scale if scale > 0 else 0.0
        if refined and model.refinement.needed(right.norm(), solution.norm()):
            # the product with the assembled stiffness is round-off; what refinement still moves tells
            relative = model.refinement.correction
    finally:
        free(model.comm, solution, right, residual)
    intensities = model.tips.evaluate(owned, load.tips[:, 0] + model.tips.contact @ result.force)
    return Equilibrium(
        owned, result.force, result.gap, result.active, intensities, result.iterations, relative
    )


@stage("Contact")
def _without_flexibility(model: Model, free_gap: np.ndarray) -> Complementarity | None:
    """Contact of so many rows that their flexibility costs more than the forces; None where it does not, and
    where the active set runs into a cycle or is not solved to round-off.
    """
    kind = _backend(model, len(free_gap))
    if kind is None:
        return None
    with closing(kind(model)) as backend:
        return active_set(backend, free_gap, model.gap_operator.laws)[0]


def _backend(model: Model, rows: int) -> type[dual_contact.Dual] | type[bordered_contact.Bordered] | None:
    """What solves contact of so many rows without their flexibility; None where that costs more."""
    for kind in (dual_contact.Dual, bordered_contact.Bordered):
        if kind.worthwhile(model, rows):
            return kind
    return None
