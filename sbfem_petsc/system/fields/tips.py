"""Tips of a structure's cracks: their contact rows, the faces inside their S-elements, their K and T."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from meshing.mesh_arrays import Tip

from ...contact.law import ContactLaw
from ...errors import warn_of_mesh
from ...petsc import summed
from ...ranks.parallel import collective
from ...selement.face_tractions import GAP_POWERS, FaceTractions
from ..elements.elements import Elements
from .intensities import TipIntensities, tip_intensities
from .t_stress import TStressForm, t_stress_forms
from .tip_faces import TipElement, TipFaces, drawn_gap, given_gap, tip_elements, tractions_of

# Errors of stress intensity factors in units of those of their exact singular modes, which others add to, and
# the error beyond which the user is warned. Edge and inclined cracks in plates and beams, isotropic ones
# up to nu = .4999 and of E_1 / E_2 = 3, 14 and 40 at 0, 30 and 75 degrees, orders 2 to 7, from 14 % to 5e-8:
# .3 to 4 of it is told of nine in ten. Order 1: .2 (beams) to 10 (where two errors all but cancel).
OTHERS, WARNED_FACTOR = 2.0, 1e-3


class Tips:
    """Tips that have an S-element around them; what is told of them is made when it is first asked for.

    Parameters
    ----------
    elements : Elements
    laws : mapping of str to ContactLaw
        Of the cracks, by their names.
    modes : int
        Polynomials of the pressure on the faces inside each tip element.
    """

    def __init__(self, elements: Elements, laws: Mapping[str, ContactLaw], modes: int):
        self.elements, self.layout, self.laws, self.modes = elements, elements.layout, laws, modes

    def law_of(self, tip: Tip) -> ContactLaw:
        """Of its crack."""
        return self.laws[self.layout.cracks[tip.crack].name]

    @property
    def names(self) -> tuple[str, ...]:
        """In order."""
        return tuple(tip.name for tip in self.layout.tip_elements)

    @property
    def rub(self) -> bool:
        """Whether any faces do."""
        return any(law.rubs for law in self.laws.values())

    @functools.cached_property
    def places(self) -> list[TipElement]:
        """Those that this rank holds."""
        return tip_elements(self.elements)

    def told(self, of: Callable[[TipElement], float]) -> dict[str, float]:
        """A number of each tip by its name, from the rank that holds it. Collective."""
        values = np.zeros(len(self.layout.tip_elements))
        for place in self.places:
            values[place.number] = of(place)
        return dict(zip(self.names, summed(self.layout.comm, values).tolist()))

    @functools.cached_property
    def gaps(self) -> np.ndarray:
        """(tips, 4): factors of the powers `GAP_POWERS` in the initial gap inside each tip's S-element, m.
        Collective.
        """
        gaps = np.zeros((len(self.layout.tip_elements), len(GAP_POWERS)))
        for place in self.places:
            drawn, given = drawn_gap(place), given_gap(self.layout.pairs, place.tip)
            gaps[place.number, 2] = drawn
            if given is not None and abs(given.sum() - drawn) > 1e-6 * max(given.sum(), drawn):
                gaps[place.number] = given
        return summed(self.layout.comm, gaps)

    @property
    def wedges(self) -> np.ndarray:
        """(tips,): whether the undeformed faces close a wedge at each. Collective."""
        return ~self.gaps[:, :2].any(axis=1) & (self.gaps[:, 2] > 0.0)

    # ------------------------------------------------------------------ contact rows
    @functools.cached_property
    def first_rows(self) -> np.ndarray:
        """(tips + 1,): first contact row of each tip element, and the number of all rows that are gaps:
        behind the pairs, one for each polynomial, and one for the logarithm where faces that come apart close
        a wedge. Collective.
        """
        parts = [self.law_of(tip).parts for tip in self.layout.tip_elements]
        counts = (self.modes + self.wedges * np.array(parts, dtype=bool)) * (self.modes > 0)
        return len(self.layout.pairs) + np.concatenate([[0], np.cumsum(counts)])

    @functools.cached_property
    def tangential_rows(self) -> np.ndarray:
        """(tips,): tangential row of the first mode of each tip element, -1 where its faces do not rub;
        behind the rows that are gaps stands one for each pair, then those of the tips. Collective.
        """
        counts, pairs = self._tangential_counts, len(self.layout.pairs)
        behind = self.first_rows[-1] + pairs + np.cumsum(counts) - counts
        return np.where(counts > 0, behind, -1)

    @property
    def _tangential_counts(self) -> np.ndarray:
        rubs = np.array([self.law_of(tip).rubs for tip in self.layout.tip_elements], dtype=bool)
        return np.diff(self.first_rows) * rubs

    @property
    def count(self) -> int:
        """Number of contact rows: gaps, then slips where faces rub. Collective."""
        slips = len(self.layout.pairs) + int(self._tangential_counts.sum()) if self.rub else 0
        return int(self.first_rows[-1]) + slips

    @functools.cached_property
    def faces(self) -> dict[int, TipFaces]:
        """Traction modes on the faces inside the tip elements that this rank holds, by their numbers.
        Collective.
        """
        found: dict[int, TipFaces] = {}
        first, gaps, rubbing = self.first_rows, self.gaps, self.tangential_rows
        known: dict[tuple, FaceTractions] = {}
        with collective(self.layout.comm):
            for place in self.places if self.modes else ():
                number, reflected = place.number, np.linalg.det(place.rotation) < 0.0
                found[number] = TipFaces(
                    **vars(place),
                    first=int(first[number]),
                    rubbing=int(rubbing[number]),
                    modes=int(first[number + 1] - first[number]),
                    tractions=place.shared(known, partial(tractions_of, place, self.modes)),
                    stiffness=place.material.modulus * self.elements.thickness,
                    # a reflected shape runs through the element's chain backwards
                    sets=place.tip.faces[::-1] if reflected else place.tip.faces,
                    gap=gaps[number],
                )
        return found

    # ------------------------------------------------------------------ what is told of them
    @functools.cached_property
    def intensities(self) -> TipIntensities:
        """Their stress intensity factors. Collective."""
        return tip_intensities(self.elements, self.places, self.faces, self.first_rows, self.count)

    @functools.cached_property
    def t_stress_forms(self) -> dict[int, TStressForm]:
        """T-stress of those that this rank holds and that have one. Collective."""
        return t_stress_forms(self.places, self.faces, self.elements.thickness)


def warn_of_tips(owner: str, tips: Tips, states: Sequence[dict[str, tuple[float, float]]] = ()) -> None:
    """Warn if edges around a tip do not carry its singular stresses, by more than `WARNED_FACTOR`, as in
    a low order, an anisotropic material or one that all but keeps its volume. Collective.

    Parameters
    ----------
    states : sequence of dict of str to (float, float)
        K_I and K_II of each tip, Pa m^(1/2); none: any.
    """
    carried, errors = tips.intensities, OTHERS * tips.intensities.errors
    if errors.max(initial=0.0) <= WARNED_FACTOR:
        return
    shares = np.eye(2)[:, None]
    if states:
        factors = np.nan_to_num([list(state.values()) for state in states])
        shares = factors / np.maximum(np.linalg.norm(factors, axis=2, keepdims=True), np.finfo(float).tiny)
    errors = np.minimum(np.linalg.norm(errors * shares, axis=2).max(axis=0), 1.0)
    worst = int(np.argmax(errors))
    if errors[worst] <= WARNED_FACTOR:
        return
    order = tips.layout.order
    warn_of_mesh(
        f"{owner}: around the tip {carried.names[worst]} the stresses change too fast for edges of "
        f"order {order}: K_I and K_II are off by about {errors[worst]:.1g} of themselves, stresses next to "
        f"the tip by more; take a higher order (order={order + 2} or more in mesh), or accuracy= of static"
    )
