"""Gaps of the contact as linear forms of the displacements: node pairs, then the pressure modes of tip
elements.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ...contact.law import ContactLaw, RowLaws, Unilateral
from ...petsc import MPI
from ..layout.rows import Rows
from ..solve.assembly import Triples


@dataclass(frozen=True, eq=False)
class GapOperator:
    """Contact rows: gap = rows u + initial + flexibility force.

    The first `pairs` rows are those of the node pairs, whose forces are nodal forces (N). The others belong
    to the faces inside tip elements: a row is the mean opening weighted with a pressure mode, its force the
    resultant of that mode (N), and its own flexibility that of the tip element under a pressure that its
    boundary does not see.

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
    """

    rows: Rows
    initial: np.ndarray
    flexibility: sparse.csr_array
    pairs: int
    laws: RowLaws

    def __len__(self) -> int:
        return len(self.initial)

    def flexible(self) -> np.ndarray:
        """(c,): rows that a force moves: not those of pairs that are held fixed. Collective."""
        return self.rows.lengths() + np.abs(self.flexibility.diagonal()) > 0.0


def gap_operator(model) -> GapOperator:
    """The contact rows of a model. Collective."""
    pairs, count = len(model.pairs), int(model.tip_rows[-1])
    laws, entries = list(_laws(model)), []
    compliance = np.array([law.compliance for law in laws])
    if model.comm.rank == 0:  # known to all: one rank gives them
        entries.append(_entries(np.arange(pairs), model.pair_unknowns.reshape(pairs, 4), _pair_rows(model)))
    initial, blocks = np.zeros(count), []
    for faces in model.tip_faces:
        modes, numbers = faces.modes, np.arange(count)[faces.contact]
        unknowns = model.part.unknowns[faces.group.nodes[faces.member]].ravel()
        entries.append(_entries(numbers, np.tile(unknowns, (modes, 1)), faces.rows[:modes]))
        initial[numbers] = faces.initial_gap()
        block = faces.flexibility[:modes, :modes] + compliance[faces.first] * faces.layer(model.thickness)
        blocks.append(_entries(numbers, np.tile(numbers, (modes, 1)), block))
    model.comm.Allreduce(MPI.IN_PLACE, initial)
    initial[:pairs] = model.pairs.gap
    every, layers = np.arange(pairs), compliance[:pairs] / (model.pairs.weight * model.thickness)
    own = [(every, every, layers), *(block for part in model.comm.allgather(blocks) for block in part)]
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
        row_laws.rest(initial),
        sparse.csr_array(sparse.coo_array((flexibility, (at, across)), shape=(count, count))),
        pairs,
        row_laws,
    )


def _pair_rows(model) -> np.ndarray:
    """(pairs, 4): what the displacements of each pair's nodes add to its gap; zero where they are held fixed,
    and where rounding of the normal alone is left of them.
    """
    signed = np.stack([model.pairs.normal, -model.pairs.normal], axis=1).reshape(-1, 4)
    return np.where((model.pair_unknowns.reshape(-1, 4) >= 0) & (np.abs(signed) > _ROUND_OFF), signed, 0.0)


# Components of a unit normal below this are those of rounding.
_ROUND_OFF = 1e-9
_NOTHING = (np.empty(0, dtype=np.int64), np.empty((0, 1), dtype=np.int64), np.empty((0, 1)))


def _entries(numbers: np.ndarray, unknowns: np.ndarray, values: np.ndarray) -> Triples:
    """Flat entries of rows (k,) with unknowns and coefficients (k, n)."""
    return np.repeat(numbers, unknowns.shape[1]), unknowns.ravel(), values.ravel()


def _laws(model) -> Iterator[ContactLaw]:
    """The law of each contact row: its crack's."""
    for crack, moves in zip(model.pairs.crack, _pair_rows(model).any(axis=1)):
        # a pair whose two nodes are held fixed has no flexibility, and nothing for a law to do
        yield model.contact_laws[model.cracks[crack].name] if moves else Unilateral()
    for tip, count in zip(model.tip_elements, np.diff(model.tip_rows)):
        yield from [model.contact_laws[model.cracks[tip.crack].name]] * int(count)
