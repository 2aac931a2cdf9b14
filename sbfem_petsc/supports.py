"""Supports on named sets of edges or named points."""

from __future__ import annotations

from dataclasses import dataclass, field

from .checks import Bounds, instances, real, said, shown

_HELD = said("true: held, false: free, a number: stiffness", "N/m^3 or N/m")


@dataclass(frozen=True)
class Support:
    """Support of an edge set or a point, direction by direction.

    A point that holds more than the balance of forces needs gives way without limit as edges get shorter:
    frequencies then fall with the logarithm of their length. Hold a short edge instead.

    Parameters
    ----------
    where : str
        Name of an edge set or of a point.
    x, y : bool or float
        True: held fixed; False: free; a positive number: an elastic support, in N/m^3 (stiffness per unit
        area) on an edge set and in N/m on a point.
    """

    where: str = field(metadata=said("edge set or point"))
    x: bool | float = field(default=True, metadata=_HELD)
    y: bool | float = field(default=True, metadata=_HELD)

    def __post_init__(self) -> None:
        if not isinstance(self.where, str):
            raise TypeError(
                f"Support: where = {shown(self.where)} must be the name of an edge set or a point"
            )
        for name in ("x", "y"):
            value = getattr(self, name)
            if type(value).__name__ in ("bool", "bool_"):
                object.__setattr__(self, name, bool(value))
                continue
            try:
                stiffness = real("Support", name, value, within=Bounds(least=0.0))
            except (TypeError, ValueError) as error:
                raise type(error)(
                    f"Support({self.where!r}): {name} = {shown(value)} must be True (fixed), False (free) "
                    "or a stiffness >= 0 (N/m^3 on edges, N/m on a point)"
                ) from None
            object.__setattr__(self, name, stiffness)

    @property
    def fixed(self) -> tuple[bool, bool]:
        """Directions held fixed."""
        return (self.x is True, self.y is True)

    @property
    def springs(self) -> tuple[float, float]:
        """Stiffness in x and y, 0 where free or fixed."""
        x, y = (0.0 if isinstance(v, bool) else float(v) for v in (self.x, self.y))
        return x, y


def as_supports(clamped, supports) -> tuple[Support, ...]:
    """The supports of a model from its `clamped` names (a name, several, or None) and its further
    supports.
    """
    names = () if clamped is None else (clamped,) if isinstance(clamped, str) else clamped
    if not isinstance(names, (tuple, list)) or not all(isinstance(name, str) for name in names):
        raise TypeError(
            f"clamped = {shown(clamped)} must be the name of an edge set or a point, several of them, or "
            "None; further supports go to supports="
        )
    wanted = "a Support or a sequence of them"
    further = () if supports is None else instances("Model", "supports", supports, Support, wanted)
    return tuple(Support(name) for name in names) + further
