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
    return GapOperator(Rows.gathered(model.comm, model.ranges, rows, count), initial, flexibility, pairs)
