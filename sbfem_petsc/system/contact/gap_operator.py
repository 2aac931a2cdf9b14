"""Gaps of the contact as linear forms of the displacements: node pairs, then the pressure modes of tip
elements, and where faces rub, their slips behind them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from ...contact.friction import Friction
from ...contact.law import ContactLaw, Coulomb, RowLaws, Unilateral
from ...petsc import MPI
from ..layout.rows import Rows
from ..solve.assembly import Triples

if TYPE_CHECKING:
    from ..structure import Structure


@dataclass(frozen=True, eq=False)
class GapOperator:
    """Contact rows: gap = rows u + initial + flexibility force.

    The first `pairs` rows are those of the node pairs, whose forces are nodal forces (N). The others belong
    to the faces inside tip elements: a row is the mean opening weighted with a pressure mode, its force the
    resultant of that mode (N), and its own flexibility that of the tip element under a pressure that its
    boundary does not see. In a model with friction the slips of all pairs stand behind these, right face
    against left one along the normal turned clockwise, then those of the tip elements that rub.

    Attributes
    ----------
    rows : Rows
        G.
    initial : (c,) array
        Gaps of the undeformed faces, m; zero for tied rows.
    flexibility : (c, c) sparse array
        m/N, block-diagonal: of elastic layers, by each row's area of face, and of the faces inside tip
        elements.
    pairs : int
    laws : RowLaws
        Of the rows that are gaps.
    friction : Friction or None
        Of the slips.
    """

    rows: Rows
    initial: np.ndarray
    flexibility: sparse.csr_array
    pairs: int
    laws: RowLaws
    friction: Friction | None

    def __len__(self) -> int:
        return len(self.initial)

    def flexible(self) -> np.ndarray:
        """(c,): rows that a force moves: not those of pairs that are held fixed. Collective."""
        return self.rows.lengths() + np.abs(self.flexibility.diagonal()) > 0.0


def gap_operator(model: Structure) -> GapOperator:
    """The contact rows of a model. Collective."""
    pairs, gaps = len(model.pairs), int(model.tip_rows[-1])
    laws, entries = list(_laws(model)), []
    friction = _friction(model, laws)
    count = gaps + (0 if friction is None else len(friction.rows))
    compliance = np.array([law.compliance for law in laws])
    if model.comm.rank == 0:  # known to all: one rank gives them
        entries.append(_entries(np.arange(pairs), model.pair_unknowns.reshape(pairs, 4), _pair_rows(model)))
        if friction is not None:
            entries.append(
                _entries(gaps + np.arange(pairs), model.pair_unknowns.reshape(pairs, 4), _slip_rows(model))
            )
    initial, blocks = np.zeros(count), []
    for faces in model.tip_faces:
        modes, numbers = faces.modes, np.arange(count)[faces.contact]
        unknowns = model.part.unknowns[faces.group.nodes[faces.member]].ravel()
        entries.append(_entries(numbers, np.tile(unknowns, (modes, 1)), faces.rows[:modes]))
        initial[numbers] = faces.initial_gap()
        block = faces.flexibility[:modes, :modes] + compliance[faces.first] * faces.layer(model.thickness)
        blocks.append(_entries(numbers, np.tile(numbers, (modes, 1)), block))
        if faces.rubbing >= 0:
            sliding, behind = faces.sliding, np.arange(count)[faces.tangential]
            entries.append(_entries(behind, np.tile(unknowns, (modes, 1)), sliding.T @ faces.rows))
            across = (faces.flexibility @ sliding)[:modes]
            own = sliding.T @ faces.flexibility @ sliding
            law = laws[faces.first]
            assert isinstance(law, Coulomb)  # for it rubs
            own += law.tangential_compliance * faces.layer(model.thickness)
            blocks += [
                _entries(numbers, np.tile(behind, (modes, 1)), across),
                _entries(behind, np.tile(numbers, (modes, 1)), across.T),
                _entries(behind, np.tile(behind, (modes, 1)), 0.5 * (own + own.T)),
            ]
    model.comm.Allreduce(MPI.IN_PLACE, initial)
    initial[:pairs] = model.pairs.gap
    every, layers = np.arange(pairs), compliance[:pairs] / (model.pairs.weight * model.thickness)
    layered = [(every, every, layers)]
    if friction is not None:
        along = np.array([getattr(law, "tangential_compliance", 0.0) for law in laws[:pairs]])
        along = along / (model.pairs.weight * model.thickness) + _slack(model)
        layered.append((gaps + every, gaps + every, along))
    own = [*layered, *(block for part in model.comm.allgather(blocks) for block in part)]
    at, across, flexibility = (np.concatenate(parts) for parts in zip(*own))
    row_laws = RowLaws.of(laws)
    rows, unknowns, coefficients = (np.concatenate(parts) for parts in zip(_entries(*_NOTHING), *entries))
    return GapOperator(
        Rows.gathered(
            model.comm,
            model.ranges,
            (rows, unknowns, coefficients),
            count,
        ),
        np.concatenate([row_laws.rest(initial[:gaps]), initial[gaps:]]),
        sparse.csr_array(sparse.coo_array((flexibility, (at, across)), shape=(count, count))),
        pairs,
        row_laws,
        friction,
    )


def _pair_rows(model: Structure) -> np.ndarray:
    """(pairs, 4): what the displacements of each pair's nodes add to its gap; zero where they are held fixed,
    and where rounding of the normal alone is left of them.
    """
    return _signed(model, model.pairs.normal)


def _slip_rows(model: Structure) -> np.ndarray:
    """(pairs, 4): the same of its slip, along the normal turned clockwise."""
    return _signed(model, model.pairs.normal[:, ::-1] * [1.0, -1.0])


def _slack(model: Structure) -> np.ndarray:
    """(pairs,): flexibility along the faces, m/N, of pairs whose rows depend on each other: at a node of
    several pairs, where cracks meet, gaps and slips all around it are more than there are motions; where a
    support holds one, gap and slip may be one motion.
    """
    _, which, counts = np.unique(model.pairs.nodes, return_inverse=True, return_counts=True)
    shared = (counts[which] > 1).reshape(-1, 2).any(axis=1)
    held = (model.pair_unknowns.reshape(-1, 4) < 0).any(axis=1)
    stiffness = max(material.modulus for material in model.materials) * model.thickness
    return np.where(shared | held, _SLACK / stiffness, 0.0)


def _signed(model: Structure, directions: np.ndarray) -> np.ndarray:
    signed = np.stack([directions, -directions], axis=1).reshape(-1, 4)
    return np.where((model.pair_unknowns.reshape(-1, 4) >= 0) & (np.abs(signed) > _ROUND_OFF), signed, 0.0)


# Components of a unit normal below this are those of rounding.
_ROUND_OFF = 1e-9
# Slack of rows that depend on each other, in units of what the body gives way.
_SLACK = 1e-9
_NOTHING = (np.empty(0, dtype=np.int64), np.empty((0, 1), dtype=np.int64), np.empty((0, 1)))


def _entries(numbers: np.ndarray, unknowns: np.ndarray, values: np.ndarray) -> Triples:
    """Flat entries of rows (k,) with unknowns and coefficients (k, n)."""
    return np.repeat(numbers, unknowns.shape[1]), unknowns.ravel(), values.ravel()


def tangential_rows(model: Structure) -> np.ndarray:
    """(tips,): tangential row of the first mode of each tip element, -1 where its faces do not rub; behind
    the other contact rows stands one for each pair, then those of the tips. Collective.
    """
    first, laws = model.tip_rows, model.contact_laws
    if not any(law.rubs for law in laws.values()):
        return np.full(len(model.tip_elements), -1)
    rubs = np.array([laws[model.cracks[tip.crack].name].rubs for tip in model.tip_elements], dtype=bool)
    counts = np.diff(first) * rubs
    return np.where(counts > 0, first[-1] + len(model.pairs) + np.cumsum(counts) - counts, -1)


def _friction(model: Structure, laws: list[ContactLaw]) -> Friction | None:
    """Of the pairs and of the tip elements that rub; None where nothing does."""
    if not any(law.rubs for law in model.contact_laws.values()):
        return None
    rubbing = [number for number, row in enumerate(tangential_rows(model)) if row >= 0]
    behind = [np.arange(*model.tip_rows[number : number + 2]) for number in rubbing]
    rows = np.concatenate([np.arange(len(model.pairs)), *behind])
    return Friction.of(laws, rows)


def _laws(model: Structure) -> Iterator[ContactLaw]:
    """The law of each contact row: its crack's."""
    for crack, moves in zip(model.pairs.crack, _pair_rows(model).any(axis=1)):
        # a pair whose two nodes are held fixed has no flexibility, and nothing for a law to do
        yield model.contact_laws[model.cracks[crack].name] if moves else Unilateral()
    for tip, count in zip(model.tip_elements, np.diff(model.tip_rows)):
        yield from [model.contact_laws[model.cracks[tip.crack].name]] * int(count)
