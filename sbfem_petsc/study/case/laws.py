"""Tables of a case file for what the faces of a crack do to each other."""

from __future__ import annotations

from typing import ClassVar, Literal

from ...contact import law
from ...options import item
from .tables import Table, by_kind, table_of

_ACROSS, _ALONG = (f"of an elastic layer on the faces, {way} them" for way in ("across", "along"))


class _Law(Table):
    @property
    def rubs(self) -> bool:
        """Whether friction resists the faces' sliding."""
        return False


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


LAWS = (
    table_of(law.Unilateral, "UnilateralLaw", "unilateral", "they press or come apart", base=_Law),
    table_of(law.Tied, "TiedLaw", "tied", "they stay together", base=_Law),
    table_of(law.Clearance, "ClearanceLaw", "clearance", "they have play between stops", base=_Law),
    CoulombLaw,
)
Law = by_kind(*LAWS)
