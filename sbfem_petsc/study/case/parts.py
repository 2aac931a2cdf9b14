"""Tables of a case file for what a person draws or gives: shapes, materials, supports, laws, signals, loads.
Of most of them all is said by their classes.
"""

from __future__ import annotations

import functools
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from meshing.shapes import features

from ... import loads, material, supports
from ...contact import law
from ...options import Pair, item
from ...signals import samples, signal, waves
from .tables import Name, Table, by_kind, table_of

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


class _Law(Table):
    @property
    def rubs(self) -> bool:
        """Whether friction resists the faces' sliding: a coefficient is not zero."""
        return any(getattr(self, name, None) for name in ("friction", "static_friction"))


LAWS = (
    table_of(law.Unilateral, "UnilateralLaw", "unilateral", "they press or come apart", base=_Law),
    table_of(law.Tied, "TiedLaw", "tied", "they stay together", base=_Law),
    table_of(law.Clearance, "ClearanceLaw", "clearance", "they have play between stops", base=_Law),
    table_of(law.Coulomb, "CoulombLaw", "coulomb", "they rub", base=_Law),
)
Law = by_kind(*LAWS)


class SampledSignal(Table):
    """Samples from a text file of two columns, time and value."""

    made: ClassVar = samples.Samples.from_csv

    kind: Literal["samples"] = item(text="samples from a file")
    file: Name = item(text="path of the file, relative to the case file")
    interpolation: Literal["linear", "cubic"] = item("linear", text="between the samples")
    time_scale: float = item(1.0, text="factor on the times: 1e-3 for ms", gt=0)
    value_scale: float = item(1.0, text="factor on the values")


SIGNALS = (
    table_of(waves.Harmonic, "HarmonicSignal", "harmonic", "a sine"),
    table_of(waves.ToneBurst, "ToneBurstSignal", "tone_burst", "a windowed sine"),
    table_of(waves.Chirp, "ChirpSignal", "chirp", "a sine of running frequency"),
    table_of(waves.Step, "StepSignal", "step", "a jump, or a smooth rise"),
    table_of(signal.Constant, "ConstantSignal", "constant", "a constant, a preload"),
    SampledSignal,
)
Component: Any = float | by_kind(*SIGNALS)


class _Load(Table):
    @property
    def components(self) -> dict[str, Any]:
        """Numbers and tables of signals by name."""
        names = (name for name in type(self).model_fields if name not in ("kind", *loads.PLACES))
        return {name: getattr(self, name) for name in names}


class Force(_Load):
    """A force on a body of another code, along the direction of a named point."""

    kind: Literal["force"] = item(text="a force on a point of a [body]")
    point: Name = item(text="named point of the body")
    force: Component = item(text="along the point's direction, number or signal table", unit="N")


_loaded = functools.partial(table_of, base=_Load, types={str: Name, float | signal.Signal: Component})
PointForce = _loaded(loads.PointForce, "PointForce", "point_force", "a force on a point")
EdgeLoad = _loaded(loads.EdgeLoad, "EdgeLoad", "edge_load", "a traction on edges")
SupportMotion = _loaded(
    loads.SupportMotion, "SupportMotion", "support_motion", "acceleration of the supports"
)
EdgeMotion = _loaded(
    loads.EdgeMotion, "EdgeMotion", "edge_motion", "a displacement of supported edges or a supported point"
)
Load = by_kind(PointForce, EdgeLoad, SupportMotion, EdgeMotion, Force)
