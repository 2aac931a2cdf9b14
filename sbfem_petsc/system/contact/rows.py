"""Contact as its rows: gaps as linear forms of the displacements, node pairs, then the pressure modes of tip
elements, and where faces rub, their slips behind them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ...contact.friction import Friction
from ...contact.law import ContactLaw, Coulomb, RowLaws, Unilateral
from ...petsc import stage, summed
from ..fields.tips import Tips
from ..layout.layout import Layout
from ..layout.rows import Rows, flat
from ..solve.assembly import Triples
from ..solve.static_solver import block_width
from ..solve.stiffness import Stiffness


@dataclass(frozen=True, eq=False)
class Compliance:
    """Static response to unit contact forces: the Delassus operator and what the outputs do.

    Attributes
    ----------
    gaps : (c, c) array
        W = G K^-1 G^T and the rows' own flexibility, symmetric, m/N.
    points : (points, 2, c) array
        m/N.
    tips : (tips, 2, c) array
        K_I and K_II, Pa m^(1/2)/N.
    """

    gaps: np.ndarray
    points: np.ndarray
    tips: np.ndarray


@dataclass(eq=False)
class Contact:
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
    kept_compliance : Compliance or None
        None until it is asked for: larger problems are solved without it.
    """

    rows: Rows
    initial: np.ndarray
    flexibility: sparse.csr_array
    pairs: int
    laws: RowLaws
    friction: Friction | None
    kept_compliance: Compliance | None = None

    def __len__(self) -> int:
        return len(self.initial)

    def flexible(self) -> np.ndarray:
        """(c,): rows that a force moves: not those of pairs that are held fixed. Collective."""
        return self.rows.lengths() + np.abs(self.flexibility.diagonal()) > 0.0

    @stage("Contact")
    def compliance(self, stiffness: Stiffness, tips: Tips) -> Compliance:
        """Response to unit forces of the rows, solved for once, a block of them at a time. Collective."""
        if self.kept_compliance is None:
            self.kept_compliance = self._solved(stiffness, tips)
        return self.kept_compliance

    def _solved(self, stiffness: Stiffness, tips: Tips) -> Compliance:
        layout, count = stiffness.layout, len(self)
        outputs = (self.rows, layout.point_rows, tips.intensities.rows)
        found = [np.empty((len(rows), count)) for rows in outputs]
        width = block_width(layout)
        for first in range(0, count, width):
            block = slice(first, min(first + width, count))
            solved = stiffness.solver.of_rows(self.rows, block, "static contact")
            for target, rows in zip(found, outputs):
                target[:, block] = rows(solved)
        gaps, points, factors = found
        gaps = 0.5 * (gaps + gaps.T) + self.flexibility
        factors += tips.intensities.contact
        return Compliance(
            gaps, points.reshape(len(points) // 2, 2, count), factors.reshape(len(factors) // 2, 2, count)
        )


def contact_of(tips: Tips) -> Contact:
    """The contact rows of a structure with its tips. Collective."""
    layout, thickness = tips.elements.layout, tips.elements.thickness
    pairs, gaps = len(layout.pairs), int(tips.first_rows[-1])
    laws = list(_laws(tips))
    friction = _friction(tips, laws)
    count = gaps + (0 if friction is None else len(friction.rows))
    compliance = np.array([law.compliance for law in laws])
    initial, blocks = np.zeros(count), []
    for faces in tips.faces.values():
        modes, numbers = faces.modes, np.arange(count)[faces.contact]
        initial[numbers] = faces.initial_gap()
        block = faces.flexibility[:modes, :modes] + compliance[faces.first] * faces.layer(thickness)
        blocks.append((numbers, numbers, block))
        if faces.rubbing >= 0:
            sliding, behind = faces.sliding, np.arange(count)[faces.tangential]
            across = (faces.flexibility @ sliding)[:modes]
            own = sliding.T @ faces.flexibility @ sliding
            law = laws[faces.first]
            assert isinstance(law, Coulomb)  # for it rubs
            own += law.tangential_compliance * faces.layer(thickness)
            blocks.append((numbers, behind, across))
            blocks.append((behind, numbers, across.T))
            blocks.append((behind, behind, 0.5 * (own + own.T)))
    initial = summed(layout.comm, initial)
    initial[:pairs] = layout.pairs.gap
    every, layers = np.arange(pairs), compliance[:pairs] / (layout.pairs.weight * thickness)
    layered = [(every, every[:, None], layers[:, None])]
    if friction is not None:
        along = np.array([getattr(law, "tangential_compliance", 0.0) for law in laws[:pairs]])
        along = along / (layout.pairs.weight * thickness) + _slack(layout, tips.elements.modulus * thickness)
        layered.append((gaps + every, gaps + every[:, None], along[:, None]))
    at, across, flexibility = flat(itertools.chain(layered, *layout.comm.allgather(blocks)))
    row_laws = RowLaws.of(laws)
    return Contact(
        rows_on(layout, tips),
        np.concatenate([row_laws.rest(initial[:gaps]), initial[gaps:]]),
        sparse.csr_array(sparse.coo_array((flexibility, (at, across)), shape=(count, count))),
        pairs,
        row_laws,
        friction,
    )


def rows_on(layout: Layout, tips: Tips) -> Rows:
    """G over the unknowns of a layout: those of displacements, or of what supports hold. Collective."""
    pairs, gaps, blocks = len(layout.pairs), int(tips.first_rows[-1]), list[Triples]()
    if layout.comm.rank == 0:  # known to all: one rank gives them
        unknowns = layout.pair_unknowns.reshape(pairs, 4)
        blocks.append((np.arange(pairs), unknowns, _pair_rows(layout)))
        if tips.rub:
            blocks.append((gaps + np.arange(pairs), unknowns, _slip_rows(layout)))
    for faces in tips.faces.values():
        numbers = np.arange(tips.count)
        unknowns = layout.part.unknowns[faces.nodes].ravel()
        blocks.append((numbers[faces.contact], unknowns, faces.rows[: faces.modes]))
        if faces.rubbing >= 0:
            blocks.append((numbers[faces.tangential], unknowns, faces.sliding.T @ faces.rows))
    return Rows.gathered(layout.comm, layout.ranges, blocks, tips.count)


def _pair_rows(layout: Layout) -> np.ndarray:
    """(pairs, 4): what the displacements of each pair's nodes add to its gap; zero where they are held fixed,
    and where rounding of the normal alone is left of them.
    """
    return _signed(layout, layout.pairs.normal)


def _slip_rows(layout: Layout) -> np.ndarray:
    """(pairs, 4): the same of its slip, along the normal turned clockwise."""
    return _signed(layout, layout.pairs.normal[:, ::-1] * [1.0, -1.0])


def _slack(layout: Layout, stiffness: float) -> np.ndarray:
    """(pairs,): flexibility along the faces, m/N, of pairs whose rows depend on each other: at a node of
    several pairs, where cracks meet, gaps and slips all around it are more than there are motions; where a
    support holds one, gap and slip may be one motion; `stiffness` is the body's, N/m.
    """
    _, which, counts = np.unique(layout.pairs.nodes, return_inverse=True, return_counts=True)
    shared = (counts[which] > 1).reshape(-1, 2).any(axis=1)
    held = (layout.pair_unknowns.reshape(-1, 4) < 0).any(axis=1)
    return np.where(shared | held, _SLACK / stiffness, 0.0)


def _signed(layout: Layout, directions: np.ndarray) -> np.ndarray:
    signed = np.stack([directions, -directions], axis=1).reshape(-1, 4)
    return np.where((layout.pair_unknowns.reshape(-1, 4) >= 0) & (np.abs(signed) > _ROUND_OFF), signed, 0.0)


# Components of a unit normal below this are those of rounding.
_ROUND_OFF = 1e-9
# Slack of rows that depend on each other, in units of what the body gives way: rounding is some 1e-14 of it,
# and both are multiplied by its inverse where compiled steps hold such rows one by one.
_SLACK = 1e-7


def _friction(tips: Tips, laws: list[ContactLaw]) -> Friction | None:
    """Of the pairs and of the tip elements that rub; None where nothing does."""
    if not tips.rub:
        return None
    rubbing = [number for number, row in enumerate(tips.tangential_rows) if row >= 0]
    behind = [np.arange(*tips.first_rows[number : number + 2]) for number in rubbing]
    return Friction.of(laws, np.concatenate([np.arange(len(tips.elements.layout.pairs)), *behind]))


def _laws(tips: Tips) -> Iterator[ContactLaw]:
    """The law of each contact row: its crack's."""
    layout = tips.elements.layout
    for crack, moves in zip(layout.pairs.crack, _pair_rows(layout).any(axis=1)):
        # a pair whose two nodes are held fixed has no flexibility, and nothing for a law to do
        yield tips.laws[layout.cracks[crack].name] if moves else Unilateral()
    for tip, count in zip(layout.tip_elements, np.diff(tips.first_rows)):
        yield from [tips.law_of(tip)] * int(count)
