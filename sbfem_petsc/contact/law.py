"""Contact laws: what the two faces of a contact row do to each other, and what every solver needs of it.

A contact row has a gap and a force that presses its faces apart (N, compression positive). Solvers condense a
structure onto its rows, gap = W force + free gap, and leave the rest to the laws, which are data of each row
(`RowLaws`: the compiled steps take arrays, not functions) and a few questions asked on the host:

======================================  ====================================================================
statics, equilibrium                    `RowLaws.touched`, `wrong` (`complementarity.solve_complementarity`)
steps, reduced and not                  `touched`, the mask `tied` of `marching.contact_forces`
derivative of the steps, their replay   `acting`: the rows that keep their gap
gaps of a model                         `rest`, the laws' `compliance` (`system.gap_operator`)
guard of the energy                     `dissipative` (`dynamics.energy.guard`)
======================================  ====================================================================

Coulomb friction would be a law of the same kind with a second, tangential row for each pair. It would have to
say: the tangential rows (their displacements, `system.gap_operator`, beside the normal ones that they belong
to); bounds of their force, the friction coefficient times the force of the normal row, in the place of
"force >= 0"; three states of a row in the place of two, stick (the slip since the step before is zero: `rest`
then moves with the motion) and slip either way (the force is at its bound), in `wrong` and in the exchange
of `contact_forces`; in the derivative the rows that stick as those that act, and for rows that slip the
bound's dependence on the normal force, which makes the condensed operator unsymmetric; and `dissipative`, for
the work of the slip is lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..checks import Bounds, real, shown

# Rounding of a gap, relative to the sum of its terms' moduli.
ROUND_OFF = 1e-14


@dataclass(frozen=True)
class ContactLaw:
    """Base of the laws; not a law itself.

    Attributes
    ----------
    compliance : float
        Of an elastic layer between the faces, m^3/N: they overlap by so much for each pascal of pressure, the
        layer's thickness over its modulus. Each contact row has the share of its own area of face.
    """

    compliance: float = 0.0

    # whether the force holds the faces together too, and whether it may take energy out of the structure
    tied: ClassVar[bool]
    dissipative: ClassVar[bool] = False

    def __post_init__(self) -> None:
        real(type(self).__name__, "compliance", self.compliance, "m^3/N", within=Bounds(least=0.0))


@dataclass(frozen=True)
class Unilateral(ContactLaw):
    """Frictionless contact: faces press on each other and come apart freely, 0 <= force _|_ gap >= 0.

    Attributes
    ----------
    compliance : float
        m^3/N; an elastic layer on the faces if it is not zero.
    """

    tied: ClassVar[bool] = False


@dataclass(frozen=True)
class Tied(ContactLaw):
    """Faces that do not come apart: the gap keeps its initial value under forces of either sign.

    They slide along each other as all faces do: a crack under shear is no intact body. The gap of a tied row
    is counted from its initial value. `modal` knows no contact and leaves these cracks open, too.

    Attributes
    ----------
    compliance : float
        m^3/N; an elastic joint if it is not zero.
    """

    tied: ClassVar[bool] = True


@dataclass(frozen=True, eq=False)
class RowLaws:
    """The laws of some contact rows as arrays.

    Attributes
    ----------
    tied : (c,) bool array
    dissipative : bool
        Whether any of them may take energy out of the structure.
    """

    tied: np.ndarray
    dissipative: bool = False

    @classmethod
    def of(cls, laws: Iterable[ContactLaw]) -> RowLaws:
        """From the law of each row."""
        laws = tuple(laws)
        return cls(
            np.array([law.tied for law in laws], dtype=bool),
            any(law.dissipative for law in laws),
        )

    @classmethod
    def unilateral(cls, count: int) -> RowLaws:
        """Frictionless unilateral contact of so many rows."""
        return cls.of([Unilateral()] * count)

    def __len__(self) -> int:
        return len(self.tied)

    def first(self, count: int) -> RowLaws:
        """Those of the first rows."""
        return RowLaws(self.tied[:count], self.dissipative and count > 0)

    def rest(self, gap: np.ndarray) -> np.ndarray:
        """Gaps at rest, from the distances of the undeformed faces: those of tied rows count from there."""
        return np.where(self.tied, 0.0, gap)

    def touched(self, free_gap: np.ndarray) -> np.ndarray:
        """Rows that cannot do without a force at free gaps; where there are none, no force acts at all."""
        return self.tied | (free_gap < 0.0)

    def wrong(
        self,
        active: np.ndarray,
        force: np.ndarray,
        gap: np.ndarray,
        overlap: np.ndarray | float = 0.0,
        pull: float = 0.0,
    ) -> np.ndarray:
        """Rows on the wrong side: that pull though they must not, or overlap, by more than rounding."""
        return np.where(active, ~self.tied & (force < -pull), gap < -np.asarray(overlap))

    def admissible(self, force: np.ndarray) -> np.ndarray:
        """Forces without what rounding has put on the wrong side."""
        return np.where(self.tied, force, np.maximum(force, 0.0))

    def acting(self, force: np.ndarray) -> np.ndarray:
        """Rows that keep their gap, (..., c) of their forces."""
        return self.tied | (force != 0.0)


def row_laws(laws: ContactLaw | Sequence[ContactLaw] | None, count: int, owner: str) -> RowLaws:
    """The laws of so many rows without faces from one for all, one for each, or None: unilateral contact.

    Raises
    ------
    TypeError, ValueError
        If they are no laws, or not as many as rows, or have a layer, which is one of a face's area.
    """
    if laws is None:
        return RowLaws.unilateral(count)
    given = (laws,) * count if isinstance(laws, ContactLaw) else laws
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise TypeError(
            f"{owner}: contact_laws = {shown(laws)} must be a contact law or one for each row, such as Tied()"
        )
    for k, law in enumerate(given):
        check_law(owner, f"contact_laws[{k}]", law)
        if law.compliance:
            raise ValueError(
                f"{owner}: contact_laws[{k}] = {law!r} is a layer in m^3/N of a face's area, which a row of "
                "matrices has not; give compliance = [...] in m/N of each row"
            )
    if len(given) != count:
        raise ValueError(
            f"{owner}: contact_laws has {len(given)} laws for {count} contact rows; give as many"
        )
    return RowLaws.of(given)


# Solvers read of a law what stands in `RowLaws` alone: any other class would be one of these under its name.
KNOWN = (Unilateral, Tied)


def check_law(owner: str, name: str, law) -> None:
    """Raise TypeError unless it is a contact law that the solvers know."""
    if type(law) in KNOWN:
        return
    if isinstance(law, ContactLaw) and type(law) is not ContactLaw:
        raise TypeError(
            f"{owner}: {name} is a law of its own class, {type(law).__name__}, of which no solver asks its "
            "force; give Unilateral() or Tied()"
        )
    raise TypeError(f"{owner}: {name} = {shown(law)} must be a contact law, Unilateral() or Tied()")
