"""Tables of a case file for what the faces of a crack do to each other."""

from __future__ import annotations

from typing import ClassVar, Literal

from ...contact import law
from ...options import item
from .tables import Table, by_kind

_ACROSS, _ALONG = (f"of an elastic layer on the faces, {way} them" for way in ("across", "along"))


class _Law(Table):
    @property
    def rubs(self) -> bool:
        """Whether friction resists the faces' sliding."""
        return False


class UnilateralLaw(_Law):
    """Faces that press on each other and come apart freely, as those of cracks without a law do."""

    made: ClassVar = law.Unilateral

    kind: Literal["unilateral"] = item(text="they press or come apart")
    compliance: float = item(0.0, text=_ACROSS, unit="m^3/N", ge=0)


class TiedLaw(_Law):
    """Faces that neither come apart nor overlap."""

    made: ClassVar = law.Tied

    kind: Literal["tied"] = item(text="they stay together")
    compliance: float = item(0.0, text=_ACROSS, unit="m^3/N", ge=0)


class ClearanceLaw(_Law):
    """Faces with play between two stops."""

    made: ClassVar = law.Clearance

    kind: Literal["clearance"] = item(text="they have play between stops")
    compliance: float = item(0.0, text=_ACROSS, unit="m^3/N", ge=0)
    width: float = item(text="play", unit="m", ge=0)


class CoulombLaw(_Law):
    """Faces that rub where they press on each other, in static and load_history."""

    made: ClassVar = law.Coulomb

    kind: Literal["coulomb"] = item(text="they rub")
    friction: float = item(text="coefficient of faces that slip", ge=0)
    static_friction: float | None = item(
        None, text="coefficient up to which they stick; default: the same", ge=0
    )
    compliance: float = item(0.0, text=_ACROSS, unit="m^3/N", ge=0)
    tangential_compliance: float = item(0.0, text=_ALONG, unit="m^3/N", ge=0)

    @property
    def rubs(self) -> bool:
        """Unless both coefficients are zero."""
        return self.friction > 0.0 or bool(self.static_friction)


LAWS = (UnilateralLaw, TiedLaw, ClearanceLaw, CoulombLaw)
Law = by_kind(*LAWS)
