"""Tables of a case file for parts of a structure: what their classes say of themselves."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from meshing.shapes import features

from ... import material, supports
from ...options import Pair
from .tables import Name, table_of

_NAMES = {str: Name, str | None: Name | None}
Notch = table_of(features.VNotch, "Notch")
Hole = table_of(features.Hole, "Hole")
CrackLine = table_of(
    features.CrackLine,
    "CrackLine",
    types=_NAMES | {"points": Annotated[list[Pair], Field(min_length=2)]},
)
Isotropic = table_of(material.Material, "Isotropic", ("isotropic", "isotropic"), "the same in all directions")
Orthotropic = table_of(material.OrthotropicMaterial, "Orthotropic", "orthotropic", "different along two axes")
Support = table_of(supports.Support, "Support", types=_NAMES)
