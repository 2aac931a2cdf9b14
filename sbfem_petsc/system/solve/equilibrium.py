"""Static equilibrium with contact: one or two linear solves and a small complementarity problem, or, where
many rows may close, one factorisation with those that are expected to.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...contact.complementarity import Complementarity, active_set, solve_complementarity
from ...contact.friction import Memory
from ...contact.instant import solve_contact
from ...petsc import stage, summed
from ..contact import bordered_contact, dual_contact
from ..contact.expected_contact import expected_contact
from ..contact.rows import Contact
from ..fields.tips import Tips
from ..loads import LoadColumns
from .pencil import products
from .stiffness import Stiffness


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
    stiffness: Stiffness,
    contact: Contact,
    tips: Tips,
    load: LoadColumns,
    *,
    touching: bool = True,
    memory: Memory | None = None,
) -> Equilibrium:
    """Displacements under one column of loads. Collective.

    Parameters
    ----------
    stiffness : Stiffness
        Of a structure that is held against every rigid-body motion.
    contact : Contact
    tips : Tips
    load : LoadColumns
        Of one column.
    touching : bool
        False: faces may overlap.
    memory : Memory, optional
        Of the state before; default: faces that have never been loaded.
    """
    found = None
    if touching and contact.friction is None:
        found = _at_once(stiffness, contact, load)
    if found is None:
        found = _from_free_gaps((stiffness, contact, tips), load, touching, memory)
    owned, result = found.owned, found.result
    factors = tips.intensities
    intensities = factors.evaluate(owned, load.tips[:, 0] + factors.contact @ result.force)
    return Equilibrium(
        owned,
        result.force,
        result.gap,
        result.active,
        intensities,
        result.iterations,
        _imbalance(stiffness, contact, load, found),
        found.memory,
        found.lost,
    )


class _Found(NamedTuple):
    """Displacements, contact, whether the solves were refined where they had to be, and of friction what it
    leaves to the next state and has lost, J.
    """

    owned: np.ndarray
    result: Complementarity
    refined: bool
    memory: Memory | None = None
    lost: float = 0.0


def _from_free_gaps(
    owners: tuple[Stiffness, Contact, Tips], load: LoadColumns, closing: bool, memory: Memory | None
) -> _Found:
    """The linear solution, what contact does to its gaps, and the solution with the contact forces."""
    stiffness, operator, tips = owners
    solver = stiffness.solver
    right = load.forces[:, 0]
    owned = solver.of_load(right)
    gap = operator.rows(owned) + load.gaps[:, 0] + operator.initial
    result: Complementarity | None = None
    laws, friction, lost = operator.laws, operator.friction, 0.0
    touching = closing and laws.touched(gap[: len(laws)]).any()
    if friction is not None:
        former = Memory.none(laws, friction) if memory is None else memory
        if touching:
            result = solve_contact(operator.compliance(stiffness, tips).gaps, gap, laws, friction, former)
    elif touching:
        # bordered matrices have the round-off of the assembled stiffness
        refined = stiffness.refinement.needed_by(right, owned)
        if not refined:
            result = _without_flexibility(stiffness, operator, gap)
        if result is None:
            result = solve_complementarity(operator.compliance(stiffness, tips).gaps, gap, laws)
    if result is None:
        slip = np.empty(0) if friction is None else former.slip
        result = Complementarity(np.zeros(len(gap)), gap, np.zeros(len(gap), dtype=np.int8), 0, slip)
    else:
        owned = solver.of_contact(right, owned, operator.rows.forces(result.force))
    if friction is not None:
        memory = Memory.of(result, len(laws))
        lost = memory.lost_since(former, friction)
    return _Found(owned, result, True, None if friction is None else memory, lost)


@stage("Contact")
def _at_once(stiffness: Stiffness, contact: Contact, load: LoadColumns) -> _Found | None:
    """By the stiffness bordered with the rows that are expected to close, itself not factorised; None where
    that costs more, nothing is expected to close, or it is not solved to round-off.
    """
    if stiffness.solver.factorised or _backend(stiffness, contact) is not bordered_contact.Bordered:
        return None
    forces, rest = load.forces[:, 0], load.gaps[:, 0] + contact.initial
    start = expected_contact(stiffness, contact, forces, rest)
    if start is None:
        return None
    with closing(bordered_contact.Bordered(stiffness, contact, forces)) as backend:
        result = active_set(backend, rest, contact.laws, start)[0]
        if result is None:
            return None
        owned = backend.displacements(result.active, result.force, result.gap - rest)
    return _Found(owned, result, False)


def _imbalance(stiffness: Stiffness, contact: Contact, load: LoadColumns, found: _Found) -> float:
    """How well forces are in balance, see `Equilibrium.residual`."""
    right, comm = load.forces[:, 0], stiffness.layout.comm
    forces = right + contact.rows.forces(found.result.force)
    missed = products(stiffness.matrix, found.owned[:, None])[:, 0] - forces
    vectors = np.stack([right, forces, found.owned, missed])
    scale, given, moved, left = np.sqrt(summed(comm, (vectors * vectors).sum(axis=1))).tolist()
    if found.refined and stiffness.refinement.needed(given, moved):
        # the product with the assembled stiffness is round-off; what refinement still moves tells
        return stiffness.refinement.correction
    return left / scale if scale > 0.0 else 0.0


@stage("Contact")
def _without_flexibility(
    stiffness: Stiffness, contact: Contact, free_gap: np.ndarray
) -> Complementarity | None:
    """Contact of so many rows that their flexibility costs more than the forces; None where it does not, and
    where the active set runs into a cycle or is not solved to round-off.
    """
    kind = _backend(stiffness, contact)
    if kind is None:
        return None
    with closing(kind(stiffness, contact)) as backend:
        return active_set(backend, free_gap, contact.laws)[0]


def _backend(
    stiffness: Stiffness, contact: Contact
) -> type[dual_contact.Dual] | type[bordered_contact.Bordered] | None:
    """What solves contact of so many rows without their flexibility; None where that costs more."""
    for kind in (dual_contact.Dual, bordered_contact.Bordered):
        if kind.worthwhile(stiffness, contact):
            return kind
    return None
