"""Static equilibrium with contact: one or two linear solves and a small complementarity problem."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from ...contact.complementarity import Complementarity, active_set, solve_complementarity
from ...contact.friction import Memory, solve_friction
from ...contact.law import RowLaws
from ...petsc import free, stage
from ..boundary import LoadColumns
from ..contact import bordered_contact, dual_contact
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
    gap_operator, solver = model.gap_operator, model.solver
    forces = model.stiffness.createVecRight()
    forces.array = load.forces[:, 0]
    solution, right, residual = forces.duplicate(), forces.copy(), forces.duplicate()
    try:
        solver.solve(forces, solution, "static")
        gap = gap_operator.rows(solution.array_r) + load.gaps[:, 0] + gap_operator.initial
        force, active, iterations = np.zeros(len(gap)), np.zeros(len(gap), dtype=bool), 0
        result: Complementarity | None
        laws, friction, lost = gap_operator.laws, gap_operator.friction, 0.0
        touching = contact and laws.touched(gap[: len(laws)]).any()
        if friction is not None:
            memory = Memory.none(laws, friction) if memory is None else memory
            result = Complementarity(force, gap, active.astype(np.int8), 0)
            if touching:
                result = solve_friction(model.compliance.gaps, gap, laws, friction, memory)
            force, gap, active, iterations = result.force, result.gap, result.active, result.iterations
            former, memory = memory, Memory.of(result, len(laws))
            lost = memory.lost_since(former, friction)
        elif touching:
            result = _without_flexibility(model, gap) if solve is solve_complementarity else None
            if result is None:
                result = solve(model.compliance.gaps, gap, laws)
            force, gap, active, iterations = result.force, result.gap, result.active, result.iterations
        if touching:
            gap_operator.rows.add_to(right, force)
            solver.solve(right, solution, "static")
        model.stiffness.mult(solution, residual)
        residual.axpy(-1.0, right)
        scale = forces.norm()
        relative = residual.norm() / scale if scale > 0 else 0.0
        if solver.refinement.needed(right.norm(), solution.norm()):
            # the product with the assembled stiffness is round-off; what refinement still moves tells
            relative = solver.refinement.correction
        owned = solution.array_r.copy()
        intensities = model.tips.evaluate(owned, load.tips[:, 0] + model.tips.contact @ force)
        return Equilibrium(owned, force, gap, active, intensities, iterations, relative, memory, lost)
    finally:
        free(model.comm, forces, solution, right, residual)


@stage("Contact")
def _without_flexibility(model: Model, free_gap: np.ndarray) -> Complementarity | None:
    """Contact of so many rows that their flexibility costs more than the forces; None where it does not, and
    where the active set runs into a cycle or is not solved to round-off.
    """
    for kind in (dual_contact.Dual, bordered_contact.Bordered):
        if kind.worthwhile(model, len(free_gap)):
            with closing(kind(model)) as backend:
                return active_set(backend, free_gap, model.gap_operator.laws)[0]
    return None
