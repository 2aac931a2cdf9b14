"""Gaps of the contact as linear forms of the displacements: node pairs, then the pressure modes of tip elements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..contact.law import ContactLaw, RowLaws, Unilateral
from .rows import Rows


@dataclass(frozen=True, eq=False)
class GapOperator:
    """Contact rows: gap = rows u + initial + flexibility force.

    The first `pairs` rows are those of the node pairs, whose forces are nodal forces (N). The others belong to
    the faces inside tip elements: a row is the mean opening weighted with a pressure mode, its force the
    resultant of that mode (N), and its own flexibility that of the tip element under a pressure that its
    boundary does not see.

    Attributes
    ----------
    rows : Rows
        G.
    initial : (c,) array
        Gaps of the undeformed faces, m; zero for tied rows.
    flexibility : (c, c) array
        m/N, the laws' compliance included; for node pairs there is no other.
    pairs : int
    laws : RowLaws
    """

    rows: Rows
    initial: np.ndarray
    flexibility: np.ndarray
    pairs: int
    laws: RowLaws

    def __len__(self) -> int:
        return len(self.initial)


def gap_operator(model) -> GapOperator:
    """The contact rows of a model. Collective."""
    pairs, modes = len(model.pairs), model.tip_modes
    count = pairs + modes * len(model.tip_elements)
    rows = {}
    if model.comm.rank == 0:  # known to all: one rank gives them
        for k, (unknowns, normal) in enumerate(zip(model.pair_unknowns, model.pairs.normal)):
            rows[k] = (unknowns.ravel(), np.concatenate([normal, -normal]))
    initial, flexibility = np.zeros(count), np.zeros((count, count))
    for faces in model.tip_faces:
        first = pairs + modes * faces.number
        unknowns = model.part.unknowns[faces.group.nodes[faces.member]].ravel()
        rows |= {first + k: (unknowns, row) for k, row in enumerate(faces.rows[:modes])}
        initial[first : first + modes] = faces.initial_gap()
        flexibility[first : first + modes, first : first + modes] = faces.flexibility[:modes, :modes]
    initial, flexibility = (model.comm.allreduce(array) for array in (initial, flexibility))
    initial[:pairs] = model.pairs.gap
    laws = RowLaws.of(_laws(model))
    return GapOperator(
        Rows.gathered(model.comm, model.ranges, rows, count),
        laws.rest(initial),
        flexibility + np.diag(laws.compliance),
        pairs,
        laws,
    )


def _laws(model) -> Iterator[ContactLaw]:
    """The law of each contact row: its crack's."""
    for crack, unknowns in zip(model.pairs.crack, model.pair_unknowns):
        # a pair whose two nodes are held fixed has no flexibility, and nothing for a law to do
        yield model.contact_laws[model.cracks[crack].name] if (unknowns >= 0).any() else Unilateral()
    for tip in model.tip_elements:
        yield from [model.contact_laws[model.cracks[tip.crack].name]] * model.tip_modes
