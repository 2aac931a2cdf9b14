"""Loads in the plane, per unit thickness of 1 m."""

from __future__ import annotations

from dataclasses import dataclass, fields
from numbers import Real

from .signals import Signal, as_signal


@dataclass(frozen=True)
class PointForce:
    """Concentrated force on a named point.

    Parameters
    ----------
    point : str
        Name of a point of the mesh.
    fx, fy : float or Signal
        Components, N (of the whole thickness).
    """

    point: str
    fx: float | Signal = 0.0
    fy: float | Signal = 0.0

    def __add__(self, other: Load | Loads) -> Loads:
        return Loads((self,)) + other

    def __radd__(self, other: int) -> Loads:
        return Loads((self,)) if other == 0 else NotImplemented  # sum([...]) starts with 0


@dataclass(frozen=True)
class EdgeLoad:
    """Uniform traction on a named set of edges.

    Parameters
    ----------
    edge_set : str
        Name of an edge set of the mesh.
    tx, ty : float or Signal
        Components along x and y, Pa.
    pressure : float or Signal
        Normal traction towards the material, Pa.
    """

    edge_set: str
    tx: float | Signal = 0.0
    ty: float | Signal = 0.0
    pressure: float | Signal = 0.0

    def __add__(self, other: Load | Loads) -> Loads:
        return Loads((self,)) + other

    def __radd__(self, other: int) -> Loads:
        return Loads((self,)) if other == 0 else NotImplemented  # sum([...]) starts with 0


@dataclass(frozen=True)
class SupportMotion:
    """Acceleration of all supports together: the structure rides on them, and displacements are relative to
    them.

    It acts as the inertia force -density * acceleration on the whole structure; a constant one is a weight
    (`SupportMotion(ay=9.81)` for gravity in -y).

    Parameters
    ----------
    ax, ay : float or Signal
        m/s^2.
    """

    ax: float | Signal = 0.0
    ay: float | Signal = 0.0

    def __add__(self, other: Load | Loads) -> Loads:
        return Loads((self,)) + other

    def __radd__(self, other: int) -> Loads:
        return Loads((self,)) if other == 0 else NotImplemented  # sum([...]) starts with 0


Load = PointForce | EdgeLoad | SupportMotion


@dataclass(frozen=True)
class Loads:
    """Several loads acting together; made by adding loads."""

    parts: tuple[Load, ...] = ()

    def __add__(self, other: Load | Loads) -> Loads:
        return Loads(self.parts + as_loads(other).parts)


def as_loads(load) -> Loads:
    """A load, a sum of loads or a sequence of loads as `Loads`.

    Raises
    ------
    TypeError
        If an item is no load.
    """
    if isinstance(load, Loads):
        return load
    items = tuple(load) if isinstance(load, (list, tuple)) else (load,)
    for item in items:
        if not isinstance(item, (PointForce, EdgeLoad, SupportMotion)):
            raise TypeError(f"load {item!r} is neither a PointForce nor an EdgeLoad nor a SupportMotion")
    return Loads(items)


def separate(load, number=as_signal) -> tuple[list[Load], list[Signal]]:
    """Unit loads and the signals of their amplitudes: one of each for every component that is not zero;
    `number` makes a signal of a plain number.
    """
    units, signals = [], []
    for item in as_loads(load).parts:
        names = [f.name for f in fields(item)]
        place = {} if isinstance(item, SupportMotion) else {names[0]: getattr(item, names.pop(0))}
        for name in names:
            value = getattr(item, name)
            if isinstance(value, Real) and value == 0:
                continue
            units.append(type(item)(**place, **{name: 1.0}))
            signals.append(number(value) if isinstance(value, Real) else as_signal(value))
    return units, signals
