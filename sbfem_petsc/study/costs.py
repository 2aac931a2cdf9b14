"""What analyses cost, by fitted rules; see `estimates`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

# Modes of a reduction, steps of a period, and points of a curve, where a case does not say.
FEWEST_MODES, STEPS, CURVE_POINTS = 80, 512, 60
# Bytes of the figures of a row of a sweep.
ROW = 3e3
# Directions of contact that the derivative keeps at an instant.
_DIRECTIONS = 6


@dataclass(frozen=True)
class Size:
    """What the cost of an analysis depends on: unknowns of the model, contact pairs, points that are kept;
    the case for its loads; of a Model `expected`, see `motion.preparation`.
    """

    case: Any
    unknowns: int
    pairs: int
    points: int
    expected: Callable[[float, float, float | None, bool], tuple[int, int]] | None = None

    def modes(self, asked: int | None) -> int:
        """Modes of a reduction."""
        return asked or min(FEWEST_MODES, max(1, self.unknowns // 4))

    def highest(self, table: Any) -> float:
        """Highest frequency of an analysis' loads, Hz; 0 where they name none."""
        loads = [self.case.tables.loads[name].model_dump().values() for name in table.load]
        signals = [value for values in loads for value in values if isinstance(value, dict)]
        keys = ("frequency", "start", "stop")
        return max((signal.get(key) or 0.0 for signal in signals for key in keys), default=0.0)

    def steady(self, table: Any, frequency: float, highest: float, vectors: bool = True) -> tuple[int, int]:
        """Modes of a steady state, with vectors behind them or without, and steps a forcing period, its
        frequency and the loads' highest in Hz.
        """
        given = ("modes", "steps", "tolerance", "guess")
        ruled = any(getattr(table, name, None) is not None for name in given)
        ruled = ruled or getattr(table, "segments", 1) > 1 or not getattr(table, "reduced", True)
        if self.expected is None or ruled:
            return self.modes(table.modes), table.steps or STEPS
        return self.expected(frequency, max(frequency, highest), table.accuracy, vectors)

    def period(self, modes: int, steps: int, contact: bool = True) -> float:
        """Bytes of so many steps of a steady state; see `motion.preparation.period_memory`."""
        pairs = self.pairs if contact else 0
        return 8.0 * steps * (6 * modes + 6 * pairs + 3.5 * min(pairs, _DIRECTIONS) * modes)

    def motion(self, table: Any, taken: tuple[int, int], periods: int) -> Cost:
        """Of one motion of so many forcing periods, in so many modes and steps a forcing period."""
        modes, steps = taken
        disk = 8.0 * periods * steps * (3 * modes + self.pairs + 2 * self.points)
        return Cost(self.period(modes, periods * steps, table.contact), disk, modes, steps)

    def curve(self, table: Any, taken: tuple[int, int], periods: int = 1) -> Cost:
        """Of a curve of motions of so many forcing periods, in so many modes and steps a forcing period."""
        modes, steps = taken
        disk = 400.0 * min(table.points, CURVE_POINTS) * (modes + self.points * 60)
        return Cost(self.period(modes, steps * periods), disk, modes, steps)


@dataclass(frozen=True)
class Cost:
    """Bytes of memory beside the model's, and on the disk; modes, and steps a forcing period, where these are
    told.
    """

    memory: float = 0.0
    disk: float = 0.0
    modes: int = 0
    steps: int = 0
