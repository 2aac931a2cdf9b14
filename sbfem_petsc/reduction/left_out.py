"""What the modes of a structure that are left out do: a few vectors stand for all of them.

They span K^-1 f, K^-1 M K^-1 f, .. of what loads and contact rows do to the modes that are there, less these:
a block Krylov space, in which the further modes that loads and contact move come up first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import linalg

from ..loads import Load, SupportMotion
from ..petsc import summed
from ..system.model import Model, counted_pencil
from ..system.solve.demand import require_modes
from ..system.solve.modes import TOLERANCE
from ..system.solve.pencil import Pencil
from .reduced_model import ReducedModel

# What of the largest pattern of loads and contact rows in the upper half of the modes still counts, as many
# of the residual flexibility's largest ones beside each, and most of all.
PATTERN, BESIDE, MOST = 0.01, 0.5, 16
# So many vectors at least: beyond a few modes frequencies lie far apart.
LEAST = 3
# Least damping ratio of vectors where faces rub, at the highest mode's frequency, further ones in proportion
# to theirs: a few of them ring where the ever more modes that they stand for run apart, and each change
# between stick and slip sets them off.
RUBBED = 0.02
# Behind fewer modes than these that damping is felt in the harmonics, and hardly in what is told of them.
FEW = 20
# What is rounding in a flexibility, and in a basis.
ROUNDING = 1e-10


class Space(NamedTuple):
    """How far vectors go.

    Attributes
    ----------
    blocks : int
        Of the Krylov space.
    top : float
        Frequencies up to this multiple of the highest mode's have vectors; what lies beyond moves with the
        load.
    """

    blocks: int
    top: float


# What tells the error of modes alone, which steps that are halved carry; what stands behind modes, and what
# tells the error of both, which halved steps carry, too.
OF_MODES, BEHIND, OF_BOTH = Space(3, 2.0), Space(4, 3.0), Space(6, 5.0)


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Vectors in the place of left-out modes, mass-normalised and of no part in those that are there: what
    they are in a `ReducedModel`. Those that tell errors alone have no shapes, and forces of supports where
    these move.
    """

    frequencies: np.ndarray
    gap: np.ndarray
    points: np.ndarray
    tips: np.ndarray
    load_modes: np.ndarray
    translation: np.ndarray
    inertia: np.ndarray | None
    shapes: np.ndarray | None

    def beside(self, own: ReducedModel) -> ReducedModel:
        """The model with these vectors behind its modes, damped as its last one is; behind many, where
        faces rub, more.
        """
        omega, count = 2.0 * np.pi * self.frequencies, len(own.omega)
        model = own.model
        assert model is not None  # whose vectors these are
        ratios = model.damping_ratios(np.append(own.omega, omega))
        top = ratios[count - 1]
        further = ratios[count:] * (own.damping[-1] / top) if top else np.full(len(omega), own.damping[-1])
        if own.friction is not None and count >= FEW:
            further = np.maximum(further, RUBBED * omega / own.omega.max())

        still = self.load_modes / omega[:, None] ** 2, self.gap.T / omega[:, None] ** 2
        supports = None
        if own.supports is not None and self.inertia is not None:
            supports = own.supports.with_modes(self.inertia)
        work = self.load_modes.T @ still[0]
        work[np.ix_(own.edges, own.edges)] = 0.0  # these are no forces
        return replace(
            own,
            frequencies=np.append(own.frequencies, self.frequencies),
            damping=np.append(own.damping, further),
            gap=own.gap.with_modes(self.gap, *still),
            points=own.points.with_modes(self.points, *still),
            tips=own.tips.with_modes(self.tips, *still),
            load_modes=np.concatenate([own.load_modes, self.load_modes]),
            load_flexibility=own.load_flexibility - work,
            translation=np.concatenate([own.translation, self.translation]),
            supports=supports,
            lag=None if own.lag is None else own.lag.beyond(own.delay, float(omega[-1]), float(further[-1])),
            modal=None if self.shapes is None else own.modal,
            vectors=len(omega),
            vector_shapes=self.shapes,
        )


def left_out(own: ReducedModel, spaces: tuple[Space, ...]) -> dict[Space, LeftOut]:
    """Of a reduced model in modes alone that has its structure, for some spaces of which each holds those
    before it; none where nothing pushes. Collective.

    Raises
    ------
    ValueError
        If there is no memory for them; on all ranks.
    """
    model = own.model
    assert model is not None and own.modal is not None  # the caller has looked
    pushes = _patterns(own, model)
    if not pushes.size:
        return {}
    last = spaces[-1]
    require_modes(model.statics.elements, pushes.shape[1], len(own.omega) + 3 * last.blocks * pushes.shape[1])
    forces = model.load_columns(own.loads).forces
    count, top = len(own.omega), last.top * float(own.omega.max())
    with counted_pencil(model, count, top) or Pencil(model.statics, top, TOLERANCE) as pencil:
        found = _vectors(own, model, pencil, (pushes, forces), spaces)
        return {space: _of(own, pencil, forces, space, *found[space]) for space in spaces}


def _of(
    own: ReducedModel,
    pencil: Pencil,
    forces: np.ndarray,
    space: Space,
    basis: np.ndarray,
    omega: np.ndarray,
) -> LeftOut:
    """What a reduced model knows of vectors; forces are those of its unit loads."""
    model = own.model
    assert model is not None  # see `left_out`
    momentum = basis[pencil.owned :].T @ pencil.auxiliary_translation()
    inertia = _inertia(model, pencil, basis) if space is BEHIND or len(own.edges) else None
    shapes = basis[: pencil.owned]
    translation = summed(model.comm, momentum - shapes.T @ unit_accelerations(model))
    gap, points = model.contact.rows(shapes), model.layout.point_rows(shapes)
    # signs by what moves, whatever the order of the loads
    seen = np.concatenate([gap, points, translation.T])
    signs = np.where((seen / np.arange(1.0, len(seen) + 1.0)[:, None]).sum(axis=0) < 0.0, -1.0, 1.0)
    shapes, gap, points = shapes * signs, gap * signs, points * signs
    inertia = None if inertia is None else inertia * signs
    translation *= signs[:, None]
    load_modes = loads_in_modes(model, own.loads, shapes.T @ forces, translation)
    if len(own.edges):
        assert own.supports is not None and inertia is not None  # which has them
        where = own.supports.moved[own.edges]
        load_modes[:, own.edges] = omega[:, None] ** 2 * inertia[where // 2, where % 2].T
    return LeftOut(
        omega / (2.0 * np.pi),
        gap,
        points.reshape(len(model.points), 2, len(omega)),
        model.tips.intensities.rows(shapes).reshape(len(own.tips.names), 2, len(omega)),
        load_modes,
        translation,
        inertia,
        shapes if space is BEHIND else None,
    )


def unit_accelerations(model: Model) -> np.ndarray:
    """(owned, 2): inertia forces in unit accelerations of the supports along x and y, made once.
    Collective.
    """

    def made() -> np.ndarray:
        layout, elements = model.layout, model.statics.elements
        fields = np.broadcast_to(np.eye(2), (len(layout.part.nodes), 2, 2))
        return -layout.summed(elements.inertia_forces(fields))

    return model.keep("unit accelerations", made)


def loads_in_modes(
    model: Model, units: Sequence[Load], pushed: np.ndarray, translation: np.ndarray
) -> np.ndarray:
    """(k, loads): unit loads in modes, of which this rank's forces have pushed (k, loads); supports that move
    by their accelerations, in which auxiliary unknowns have a share. Collective.
    """
    found = summed(model.comm, pushed)
    for k, unit in enumerate(units):
        if isinstance(unit, SupportMotion):
            found[:, k] = -translation @ np.array([unit.ax, unit.ay])
    return found


def _patterns(own: ReducedModel, model: Model) -> np.ndarray:
    """(l + c, p): unit pushes of loads and contact rows as those of the upper half of the modes, and some of
    what gives way beside them.
    """
    half = len(own.omega) // 2
    seen = np.concatenate([own.load_modes.T, own.gap.modes])[:, half:] / own.omega[half:]
    flexibility, rows = own.flexibility.copy(), len(own.loads)
    flexibility[rows:, rows:] -= model.contact.flexibility.toarray()  # which moves no boundary
    slack = np.diag(flexibility)
    sizes = np.where(slack > ROUNDING * slack.max(initial=0.0), slack, (seen**2).sum(axis=1))
    units = np.where(sizes > 0.0, 1.0 / np.sqrt(np.where(sizes > 0.0, sizes, 1.0)), 0.0)
    patterns, values, _ = np.linalg.svd(units[:, None] * seen, full_matrices=False)
    patterns = patterns[:, values > PATTERN * values.max(initial=0.0)][:, :MOST]
    known, size = patterns.shape[1], len(units)
    count = min(math.ceil(BESIDE * known), MOST - known, size)
    if count > 0:
        rest = units[:, None] * flexibility * units
        rest -= patterns @ (patterns.T @ rest)
        rest -= (rest @ patterns) @ patterns.T
        slacks, others = linalg.eigh(rest, subset_by_index=[size - count, size - 1])
        patterns = np.concatenate([patterns, others[:, slacks > ROUNDING]], axis=1)
    return units[:, None] * patterns


def _vectors(
    own: ReducedModel,
    model: Model,
    pencil: Pencil,
    acting: tuple[np.ndarray, np.ndarray],
    spaces: tuple[Space, ...],
) -> dict[Space, tuple[np.ndarray, np.ndarray]]:
    """This rank's rows of the vectors, auxiliary unknowns behind, and their angular frequencies; pushes on
    unit loads and contact rows, and what the former do, act.
    """
    assert own.modal is not None
    pushes, forces = acting
    owned, stiff, squares = pencil.owned, pencil.auxiliary_diagonal(0.0)[:, None], own.omega**2
    modes = pencil.full_shapes(own.modal.shapes, own.omega)
    right = model.contact.rows.columns(slice(None)) @ pushes[len(own.loads) :]
    right = np.pad(forces @ pushes[: len(own.loads)] + right, ((0, len(stiff)), (0, 0)))
    found, heavy = [], []
    for _ in range(spaces[-1].blocks):
        upper = model.solver.columns(np.asfortranarray(right[:owned]), "reduction")
        block = np.concatenate([upper, right[owned:] / stiff])
        block -= modes @ (summed(model.comm, modes.T @ right) / squares[:, None])
        # what soft modes, of springs, leave of themselves
        block -= modes @ summed(model.comm, modes.T @ pencil.heavy_products(block))
        right = pencil.heavy_products(block)
        found.append(block)
        heavy.append(right)
    basis = np.concatenate(found, axis=1)
    grams = (
        basis.T @ pencil.stiff_products(np.asfortranarray(basis)),
        basis.T @ np.concatenate(heavy, axis=1),
    )
    stiffness, mass = (0.5 * (gram + gram.T) for gram in (summed(model.comm, part) for part in grams))

    def of(space: Space) -> tuple[np.ndarray, np.ndarray]:
        part = slice(space.blocks * pushes.shape[1])
        sizes = np.sqrt(np.diag(stiffness)[part])
        values, axes = np.linalg.eigh(stiffness[part, part] / sizes / sizes[:, None])
        kept = values > ROUNDING * values[-1]
        axes = axes[:, kept] / np.sqrt(values[kept]) / sizes[:, None]
        inverse, turns = np.linalg.eigh(axes.T @ mass[part, part] @ axes)
        first = max(LEAST, int((inverse * (space.top * own.omega.max()) ** 2 > 1.0).sum()))
        omega = 1.0 / np.sqrt(inverse[::-1][:first])
        return basis[:, part] @ (axes @ turns[:, ::-1][:, :first]) * omega, omega

    return {space: of(space) for space in spaces}


def _inertia(model: Model, pencil: Pencil, basis: np.ndarray) -> np.ndarray:
    """(supports, 2, k): see `Supports`, of vectors."""
    shares = pencil.momenta(model.support_forces.following()) @ basis
    return summed(model.comm, shares).reshape(-1, 2, basis.shape[1])
