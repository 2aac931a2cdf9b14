"""What results of the map of one period have in common, in memory and in files."""

from __future__ import annotations

from typing import Any

from ..ranks.capacity import available_memory
from ..record.record import Record, derived
from ..reduction.reduced_model import ReducedModel
from .excitation import LINES, Excitation
from .period_map import Period

# Bytes that a map takes an instant and line of its loads.
WAVES = 64


class OfPeriod(Record):
    """A record of motions of a map, with what the map is made of."""

    @property
    def _map(self) -> Period | None:
        """None for an unreduced model."""
        raise NotImplementedError

    @derived(text="the reduced model", part="ReducedModel", back=True, detail=True)
    def reduced_model(self) -> ReducedModel | None:
        """None for an unreduced one."""
        return None if self._map is None else self._map.reduced

    @derived(text="the loads", part="Excitation", back=True, detail=True)
    def excitation(self) -> Excitation | None:
        """None for an unreduced model."""
        return None if self._map is None else self._map.excitation

    @derived("1", "time steps a period of the motion", back=True, detail=True, least=1)
    def steps(self) -> int | None:
        """None for an unreduced model."""
        return None if self._map is None else self._map.steps

    @derived("1", "whether it is computed with contact", back=True, detail=True)
    def contact(self) -> bool:
        """Whether it is computed with contact."""
        return self._map is None or self._map.pairs > 0

    @staticmethod
    def _map_of(found: dict[str, Any]) -> Period | None:
        """The map anew from what was read, where it is taken out.

        Raises
        ------
        ValueError
            If a part is missing, or the map would not fit into memory.
        """
        parts = reduced, excitation, steps = [found.pop(n) for n in ("reduced_model", "excitation", "steps")]
        contact = found.pop("contact")
        if reduced is None:
            return None
        if any(part is None for part in parts):
            raise ValueError("the loads or the steps are missing")
        require_waves(steps, len(excitation.orders))
        return Period(reduced, excitation, steps, contact)


def require_waves(steps: int, lines: int) -> None:
    """Raise ValueError if a map of so many steps, from a file, would not fit into memory."""
    if WAVES * steps * min(lines, LINES) > available_memory():
        raise ValueError(f"{steps} steps a period need more memory than is free")
