"""Loads in the plane. Each says where it acts and assembles itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import Any, Protocol

import numpy as np

from .checks import real, said, shown, text
from .errors import UnknownName, listed
from .signals.signal import Signal, as_signal
from .supports import Support


class LoadAssembler(Protocol):
    """What a structure offers to a load that assembles itself."""

    edge_sets: tuple[str, ...]
    inner_edges: dict[str, int]  # how many edges of a set have S-elements on both sides
    points: dict[str, Any]
    supports: tuple[Support, ...]

    def point_force(self, point: str, force: tuple[float, float]) -> None:
        """Add a force (N) on a named point."""

    def edge_traction(self, edge_set: str, traction: Callable[[np.ndarray], np.ndarray]) -> None:
        """Add a traction (Pa), a function of the outward normals (..., 2), on the edges of a set."""

    def inertia(self, acceleration: tuple[float, float]) -> None:
        """Add the force -density * acceleration (m/s^2) on the whole body."""

    def motion(self, where: str, displacement: tuple[float, float]) -> None:
        """Move what the supports of a place hold by a displacement (m)."""


class Load:
    """A load that acts at one place; loads add up with ``+`` and ``sum``."""

    def __add__(self, other: Load | Loads) -> Loads:
        return Loads((self,)) + other

    def __radd__(self, other: int) -> Loads:
        return Loads((self,)) if other == 0 else NotImplemented  # sum([...]) starts with 0

    @property
    def components(self) -> dict[str, float | Signal]:
        """Numbers or signals by name."""
        own: Any = self  # each kind of load is a dataclass
        return {f.name: getattr(self, f.name) for f in fields(own) if f.name not in PLACES}

    def units(self) -> list[tuple[Load, float | Signal]]:
        """A unit load and its amplitude for each component that is not zero."""
        names = self.components
        none = {name: 0.0 for name in names}
        return [
            (replace(self, **{**none, name: 1.0}), value)  # type: ignore[type-var]
            for name, value in names.items()
            if not (isinstance(value, Real) and value == 0)
        ]

    def __post_init__(self) -> None:
        for name in PLACES:
            if hasattr(self, name):
                text(type(self).__name__, name, getattr(self, name))
        for name, value in self.components.items():
            if not isinstance(value, Signal):
                real(type(self).__name__, name, value)

    def check(self, structure: LoadAssembler, constant: bool = True) -> None:
        """Raise KeyError or TypeError if the place does not exist or a component is a signal although only
        constants have a meaning.
        """
        self._check_place(structure)
        for name, value in self.components.items():
            if constant and isinstance(value, Signal):
                raise TypeError(
                    f"{type(self).__name__}: {name} = {shown(value)} must be a number (signals are for "
                    "transient and periodic)"
                )

    def _check_place(self, structure: LoadAssembler) -> None:
        """Raise KeyError if the place of the load does not exist."""

    def assemble(self, structure: LoadAssembler) -> None:
        """Add the nodal forces of constant components."""
        raise NotImplementedError


# What says where a load acts; all else are its components.
PLACES = ("point", "edge_set", "where")


def _component(text: str, unit: str) -> Any:
    """A field that is zero, a number or a signal."""
    return field(default=0.0, metadata=said(f"{text}, number or signal table", unit))


@dataclass(frozen=True)
class PointForce(Load):
    """Concentrated force on a named point.

    The displacement under it has no limit: each time that the edges at the point are made e times shorter (or
    the order higher) it grows by 2 F / (pi E') on a straight edge, more at a corner. Displacements elsewhere
    settle, and so do those at the point without their static part. An `EdgeLoad` on a short edge has a limit.

    Parameters
    ----------
    point : str
        Name of a point of the mesh.
    fx, fy : float or Signal
        Components, N (of the whole thickness).
    """

    point: str = field(metadata=said("named point"))
    fx: float | Signal = _component("component along x", "N")
    fy: float | Signal = _component("component along y", "N")

    def _check_place(self, structure: LoadAssembler) -> None:
        if not isinstance(self.point, str) or self.point not in structure.points:
            raise UnknownName(
                f"PointForce: point {self.point!r} does not exist; the mesh has {listed(structure.points)}"
            )

    def assemble(self, structure: LoadAssembler) -> None:
        """Add the force."""
        structure.point_force(self.point, (self.fx, self.fy))  # type: ignore[arg-type]


@dataclass(frozen=True)
class EdgeLoad(Load):
    """Uniform traction on a named set of edges. On those inside the body, as between two materials, it has
    components along x and y alone; a pressure is refused.

    Parameters
    ----------
    edge_set : str
        Name of an edge set of the mesh.
    tx, ty : float or Signal
        Components along x and y, Pa.
    pressure : float or Signal
        Normal traction towards the material, Pa.
    """

    edge_set: str = field(metadata=said("edge set"))
    tx: float | Signal = _component("traction along x", "Pa")
    ty: float | Signal = _component("traction along y", "Pa")
    pressure: float | Signal = _component("pressure towards the body", "Pa")

    def _check_place(self, structure: LoadAssembler) -> None:
        if not isinstance(self.edge_set, str) or self.edge_set not in structure.edge_sets:
            raise UnknownName(
                f"EdgeLoad: edge set {self.edge_set!r} does not exist; the mesh has "
                f"{listed(structure.edge_sets)}"
            )
        inside = structure.inner_edges[self.edge_set]
        if inside and (isinstance(self.pressure, Signal) or self.pressure):
            raise ValueError(
                f"EdgeLoad: pressure on {self.edge_set!r} acts towards the body, which lies on both sides of "
                f"{inside} of its edges; give tx and ty"
            )

    def assemble(self, structure: LoadAssembler) -> None:
        """Add the traction's nodal forces."""
        structure.edge_traction(self.edge_set, self.traction)

    def traction(self, normal: np.ndarray) -> np.ndarray:
        """(..., 2): that of constant components where outward normals (..., 2) are, Pa."""
        return np.array([self.tx, self.ty]) - self.pressure * normal


@dataclass(frozen=True)
class SupportMotion(Load):
    """Acceleration of all supports together: the structure rides on them, and displacements are relative to
    them.

    It acts as the inertia force -density * acceleration on the whole structure; a constant one is a weight
    (`SupportMotion(ay=9.81)` for gravity in -y).

    Parameters
    ----------
    ax, ay, az : float or Signal
        m/s^2; `az` of bodies in space alone (`reduce`).
    """

    ax: float | Signal = _component("along x", "m/s^2")
    ay: float | Signal = _component("along y", "m/s^2")
    az: float | Signal = _component("along z, of a [body] alone", "m/s^2")

    def _check_place(self, structure: LoadAssembler) -> None:
        if isinstance(self.az, Signal) or self.az:
            raise ValueError(
                f"SupportMotion: az = {shown(self.az)} is out of the plane of a Model; a body in space has it"
            )

    def assemble(self, structure: LoadAssembler) -> None:
        """Add the inertia forces."""
        structure.inertia((self.ax, self.ay))  # type: ignore[arg-type]


@dataclass(frozen=True)
class EdgeMotion(Load):
    """Prescribed displacement of a supported edge set or point, in the directions that its support holds
    fixed; other supports stand still. Constant or in time.

    The force that it takes is the support's in `reactions`. A displacement cannot jump: one that sets in has
    a rise, `Step(amplitude, rise=...)`. Where its rate does, as at the corners of linear `Samples`, the force
    has a peak as high as the step is short; cubic ones have none. Modal damping acts on the motion against
    the static displacement that follows the supports, as inside the body: supports that move all together are
    not damped.

    Parameters
    ----------
    where : str
        Name of an edge set or point, that of a `Support` (or of `clamped`) of the model.
    ux, uy : float or Signal
        Components, m.
    """

    where: str = field(metadata=said("edge set or point, that of a support"))
    ux: float | Signal = _component("along x", "m")
    uy: float | Signal = _component("along y", "m")

    def _check_place(self, structure: LoadAssembler) -> None:
        own = [support.fixed for support in structure.supports if support.where == self.where]
        if not own:
            raise UnknownName(
                f"EdgeMotion: {self.where!r} is not supported; give the model Support({self.where!r}), or "
                f"one of {listed(support.where for support in structure.supports)}"
            )
        for k, (name, value) in enumerate(self.components.items()):
            if not any(fixed[k] for fixed in own) and not (isinstance(value, Real) and value == 0):
                raise ValueError(
                    f"EdgeMotion: {name} of {self.where!r} moves what its support does not hold; give the "
                    f"model Support({self.where!r}, {name[1]}=True)"
                )

    def assemble(self, structure: LoadAssembler) -> None:
        """Move the edges."""
        structure.motion(self.where, (self.ux, self.uy))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Loads:
    """Several loads acting together; made by adding loads."""

    parts: tuple[Load, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.parts, (list, tuple)):
            raise TypeError(f"Loads: parts = {shown(self.parts)} must be a sequence of loads")
        for item in self.parts:
            if not isinstance(item, (Load, Loads)):
                raise TypeError(f"Loads: parts has {shown(item)}, which is no load")

    def __add__(self, other: Load | Loads) -> Loads:
        return Loads(self.parts + as_loads(other).parts)

    def __radd__(self, other: int) -> Loads:
        return self if other == 0 else NotImplemented


def as_loads(load: Load | Loads | Iterable[Load]) -> Loads:
    """A load, a sum of loads or a sequence of loads as `Loads`.

    Raises
    ------
    TypeError
        If an item is no load.
    """
    items = (
        load.parts if isinstance(load, Loads) else tuple(load) if isinstance(load, (list, tuple)) else (load,)
    )
    flat: list[Load] = []
    for item in items:
        if isinstance(item, Loads):
            flat += as_loads(item).parts
        elif isinstance(item, Load):
            flat.append(item)
        else:
            raise TypeError(
                f"load = {shown(item)} is neither a PointForce nor an EdgeLoad, a SupportMotion nor an "
                "EdgeMotion"
            )
    return Loads(tuple(flat))


def separate(load, number: Callable[[float], Signal] = as_signal) -> tuple[list[Load], list[Signal]]:
    """Unit loads and the signals of their amplitudes: one of each for every component that is not zero;
    `number` makes a signal of a plain number.
    """
    units, signals = [], []
    for item in as_loads(load).parts:
        for unit, value in item.units():
            units.append(unit)
            signals.append(number(value) if isinstance(value, Real) else as_signal(value))
    return units, signals
