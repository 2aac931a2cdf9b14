"""Tables of a case file for loads."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar, Literal

from ... import loads
from ...options import item
from .signals import Component
from .tables import Name, Table, by_kind

_VALUE = "number or signal table"


class _Load(Table):
    @property
    def components(self) -> dict[str, Any]:
        """Numbers and tables of signals by name."""
        own = type(self).model_fields.keys() - set(loads.PLACES)  # volumes have further ones
        names = (f.name for f in dataclasses.fields(self.made) if f.name in own)
        return {name: getattr(self, name) for name in names}


class PointForce(_Load):
    """A force on a named point."""

    made: ClassVar = loads.PointForce

    kind: Literal["point_force"] = item(text="a force on a point")
    point: Name = item(text="named point")
    fx: Component = item(0.0, text=f"component along x, {_VALUE}", unit="N")
    fy: Component = item(0.0, text=f"component along y, {_VALUE}", unit="N")


class Force(_Load):
    """A force on a body of another code, along the direction of a named point."""

    kind: Literal["force"] = item(text="a force on a point of a [body]")
    point: Name = item(text="named point of the body")
    force: Component = item(text=f"along the point's direction, {_VALUE}", unit="N")

    @property
    def components(self) -> dict[str, Any]:
        return {"force": self.force}


class EdgeLoad(_Load):
    """A uniform traction or pressure on an edge set."""

    made: ClassVar = loads.EdgeLoad

    kind: Literal["edge_load"] = item(text="a traction on edges")
    edge_set: Name = item(text="edge set")
    tx: Component = item(0.0, text=f"traction along x, {_VALUE}", unit="Pa")
    ty: Component = item(0.0, text=f"traction along y, {_VALUE}", unit="Pa")
    pressure: Component = item(0.0, text=f"pressure towards the body, {_VALUE}", unit="Pa")


class SupportMotion(_Load):
    """Acceleration of all supports; a constant one is a weight."""

    made: ClassVar = loads.SupportMotion

    kind: Literal["support_motion"] = item(text="acceleration of the supports")
    ax: Component = item(0.0, text=f"along x, {_VALUE}", unit="m/s^2")
    ay: Component = item(0.0, text=f"along y, {_VALUE}", unit="m/s^2")
    az: Component = item(0.0, text=f"along z, of a [body] alone, {_VALUE}", unit="m/s^2")


class EdgeMotion(_Load):
    """A prescribed displacement of what a support holds."""

    made: ClassVar = loads.EdgeMotion

    kind: Literal["edge_motion"] = item(text="a displacement of supported edges or a supported point")
    where: Name = item(text="edge set or point, that of a support")
    ux: Component = item(0.0, text=f"along x, {_VALUE}", unit="m")
    uy: Component = item(0.0, text=f"along y, {_VALUE}", unit="m")


Load = by_kind(PointForce, EdgeLoad, SupportMotion, EdgeMotion, Force)
