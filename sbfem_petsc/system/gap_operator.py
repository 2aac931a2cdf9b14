"""Gaps of the contact as linear forms of the displacements: node pairs, then the pressure modes of tip elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
        Gaps of the undeformed faces, m.
    flexibility : (c, c) array
        m/N; zero for the node pairs.
    pairs : int
    """

    rows: Rows
    initial: np.ndarray
    flexibility: np.ndarray
    pairs: int

    def __len__(self) -> int:
        return len(self.initial)


def gap_operator(model) -> GapOperator:
    """The contact rows of a model."""
    rows = []
    for unknowns, normal in zip(model.pair_unknowns, model.pairs.normal):
        numbers, values = unknowns.ravel(), np.concatenate([normal, -normal])
        keep = (numbers >= 0) & (values != 0.0)
        rows.append((numbers[keep], values[keep]))
    count = len(rows)
    return GapOperator(
        Rows.of(model.comm, model.ranges, rows), model.pairs.gap.copy(), np.zeros((count, count)), count
    )
