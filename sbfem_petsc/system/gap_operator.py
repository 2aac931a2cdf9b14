"""Gaps of the contact as linear forms of the displacements: node pairs, then the pressure modes of tip elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..contact.law import RowLaws, Unilateral
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
    """The contact rows of a model."""
    rows = []
    for unknowns, normal in zip(model.pair_unknowns, model.pairs.normal):
        numbers, values = unknowns.ravel(), np.concatenate([normal, -normal])
        keep = (numbers >= 0) & (values != 0.0)
        rows.append((numbers[keep], values[keep]))
    # a pair whose two nodes are held fixed has no flexibility, and nothing for a law to do
    free = np.array([len(numbers) > 0 for numbers, _ in rows], dtype=bool)
    laws = RowLaws.of(
        model.contact_laws[model.cracks[crack].name] if moves else Unilateral()
        for crack, moves in zip(model.pairs.crack, free)
    )
    return GapOperator(
        Rows.of(model.comm, model.ranges, rows),
        laws.rest(model.pairs.gap),
        np.diag(laws.compliance),
        len(rows),
        laws,
    )
