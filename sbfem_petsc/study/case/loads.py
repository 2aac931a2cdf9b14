"""Tables of a case file for loads."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, Literal

from ... import loads
from ...options import item
from ...signals.signal import Signal
from .signals import Component
from .tables import Name, Table, by_kind, table_of


class _Load(Table):
    @property
    def components(self) -> dict[str, Any]:
        """Numbers and tables of signals by name."""
        own = type(self).model_fields.keys() - set(loads.PLACES)  # volumes have further ones
        names = (f.name for f in dataclasses.fields(self.made) if f.name in own)
        return {name: getattr(self, name) for name in names}


class Force(_Load):
    """A force on a body of another code, along the direction of a named point."""

    kind: Literal["force"] = item(text="a force on a point of a [body]")
    point: Name = item(text="named point of the body")
    force: Component = item(text="along the point's direction, number or signal table", unit="N")

    @property
    def components(self) -> dict[str, Any]:
        return {"force": self.force}


_loaded = functools.partial(table_of, base=_Load, types={str: Name, float | Signal: Component})
PointForce = _loaded(loads.PointForce, "PointForce", "point_force", "a force on a point")
EdgeLoad = _loaded(loads.EdgeLoad, "EdgeLoad", "edge_load", "a traction on edges")
SupportMotion = _loaded(
    loads.SupportMotion, "SupportMotion", "support_motion", "acceleration of the supports"
)
EdgeMotion = _loaded(
    loads.EdgeMotion, "EdgeMotion", "edge_motion", "a displacement of supported edges or a supported point"
)
Load = by_kind(PointForce, EdgeLoad, SupportMotion, EdgeMotion, Force)
