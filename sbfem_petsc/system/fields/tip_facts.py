"""What kind of tips there are: what stress intensity factors alone do not tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ...errors import listed
from ...record.record import Record, described, quantity

# How near to 1/2 the exponents of a crack's tip are.
CRACK = 1e-6


@described
class TipFacts(Record):
    """Kinds of the crack tips with a tip element, by their `names`.

    The unit of K is Pa m^(1 - exponent), Pa m^(1/2) at a crack.
    """

    labels: ClassVar = {"tip": "names"}

    names: tuple[str, ...]
    exponents: np.ndarray = quantity("1", "exponents of the displacement modes", "tip component")
    interfaces: np.ndarray = quantity("1", "whether several materials meet at the tip", "tip", kinds="b")
    contact_rows: np.ndarray = quantity(
        "1",
        "first contact row of each tip element, and how many rows there are",
        "tip_end",
        kinds="iu",
        least=0,
    )

    def check(self) -> None:
        """Raise ValueError unless the rows are those of the tips."""
        if len(self.contact_rows) != len(self.names) + 1 or (np.diff(self.contact_rows) < 0).any():
            raise ValueError(f"'contact_rows' are not those of {len(self.names)} tips")

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
        """Of K_I and K_II of a tip, "none" of one that is not there."""
        powers = 1.0 - self.exponents[self.names.index(tip)]
        one, two = ("Pa m^(1/2)" if abs(p - 0.5) <= CRACK else f"Pa m^{p:.6g}" for p in powers)
        return one, "none" if np.isnan(powers[1]) else two

    @property
    def common(self) -> str:
        """Unit of K_I and K_II of all tips."""
        units = {unit for name in self.names for unit in self.units(name)}
        return units.pop() if len(units) == 1 else "Pa m^(1 - exponent)"

    @property
    def by_tip(self) -> dict[str, str]:
        """Unit of K_I and K_II by the tips' names, that of all by ""."""
        return {"": self.common} | {name: self.unit(name) for name in self.names}

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
            told = f"K_I and K_II of {listed(alike)} are in {units[0]} and {units[1]}"
            if units[1] == "none":
                told = (
                    f"K_I of {listed(alike)} is in {units[0]}, a K_II is not there and stands as 0, for "
                    "under shear stresses hardly grow towards so wide a notch"
                )
            found.append(
                f"{told}, and there is no energy release rate: stresses at a notch, or a crack that ends at "
                "an interface, do not go with r^(-1/2)"
            )
        return tuple(found)


def together(notes: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Each note once."""
    return tuple(dict.fromkeys(note for some in notes for note in some))
