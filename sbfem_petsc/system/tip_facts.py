"""What kind of tips there are: what stress intensity factors alone do not tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import listed

# How near to 1/2 the exponents of a crack's tip are.
CRACK = 1e-6


@dataclass(frozen=True, eq=False)
class TipFacts:
    """Kinds of the crack tips with a tip element.

    Attributes
    ----------
    names : tuple of str
    exponents : (tips, 2) array
        Exponents lambda of the displacement modes; the unit of K is Pa m^(1 - lambda), Pa m^(1/2) at a crack.
    interfaces : (tips,) bool array
        Whether several materials meet at the tip.
    contact_rows : (tips + 1,) int array
        First contact row of each tip element, and the number of all contact rows.
    """

    names: tuple[str, ...]
    exponents: np.ndarray
    interfaces: np.ndarray
    contact_rows: np.ndarray

    @classmethod
    def none(cls) -> TipFacts:
        """Of a system without tips."""
        return cls((), np.zeros((0, 2)), np.zeros(0, dtype=bool), np.zeros(1, dtype=int))

    @property
    def cracks(self) -> np.ndarray:
        """(tips,): whether stresses go with r^(-1/2), as at a crack, so that there is an energy release
        rate.
        """
        return (np.abs(self.exponents - 0.5) <= CRACK).all(axis=1)

    def units(self, tip: str) -> tuple[str, str]:
        """Of K_I and K_II of a tip."""
        powers = 1.0 - self.exponents[self.names.index(tip)]
        one, two = ("Pa m^(1/2)" if abs(p - 0.5) <= CRACK else f"Pa m^{p:.6g}" for p in powers)
        return one, two

    def unit(self, tip: str) -> str:
        """Of both, "K_I in ..., K_II in ..." where they differ."""
        one, two = self.units(tip)
        return one if one == two else f"{one} and {two}"

    def touching(self, contact: np.ndarray) -> np.ndarray:
        """(tips,): whether there is contact inside the tip's element under forces (c,), or at one of the
        instants (n, c).
        """
        rows = self.contact_rows
        return np.array([(contact[..., a:b] != 0.0).any() for a, b in zip(rows, rows[1:])], dtype=bool)

    def notes(self, contact: np.ndarray) -> tuple[str, ...]:
        """What K_I and K_II of the tips do not tell by themselves under forces of the contact rows, as of
        `touching`, in sentences.
        """
        names, found = np.array(self.names, dtype=object), []
        closed = self.interfaces & self.cracks
        if closed.any():
            closed &= self.touching(contact)
        if closed.any():
            found.append(
                f"of {listed(names[closed])}, closed along an interface, K_I and K_II are of no field, only "
                "the energy release rate is"
            )
        for units in dict.fromkeys(self.units(name) for name in names[~self.cracks]):
            alike = [name for name in names[~self.cracks] if self.units(name) == units]
            found.append(
                f"K_I and K_II of {listed(alike)} are in {units[0]} and {units[1]}, and there is no energy "
                "release rate: stresses at a notch, or a crack that ends at an interface, do not go with "
                "r^(-1/2)"
            )
        return tuple(found)


def together(notes: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Each note once."""
    return tuple(dict.fromkeys(note for some in notes for note in some))
