"""Numbers by name, their file of one line each, and what has moved."""

from __future__ import annotations

import math
import pathlib
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

STORED = pathlib.Path(__file__).parent / "stored"


@dataclass(frozen=True)
class Number:
    """A value and how far it may move.

    Parameters
    ----------
    name : str
    value : float
        nan where there is none.
    tolerance : float
        Of the value itself, or in its unit where `absolute`.
    absolute : bool
    """

    name: str
    value: float
    tolerance: float
    absolute: bool = False

    def moved(self, other: float) -> float:
        """How far another value is from this one, in tolerances."""
        if math.isnan(self.value) and math.isnan(other):
            return 0.0
        distance = abs(other - self.value)
        allowed = self.tolerance * (1.0 if self.absolute else abs(self.value))
        return (
            0.0 if distance <= 0.0 else distance / allowed if allowed and distance == distance else math.inf
        )

    def line(self, width: int) -> str:
        kind = "absolute" if self.absolute else "relative"
        return f"{self.name:{width}}  {self.value!r:>24}  {kind} {self.tolerance:.0e}"

    @classmethod
    def of_line(cls, line: str) -> Number:
        name, value, kind, tolerance = line.split()
        return cls(name, float(value), float(tolerance), kind == "absolute")


@dataclass
class Group:
    """Cases of one kind of analysis, which share a tolerance and its reason.

    Parameters
    ----------
    name : str
        Of its file too.
    tolerance : float
        Relative; of vectors relative to their largest entry.
    reason : str
        Why so much: a sentence that stands above the numbers.
    ranks : bool
        Whether it is also computed on several ranks, to the same tolerances.
    """

    name: str
    tolerance: float
    reason: str
    ranks: bool = False
    cases: dict[str, Callable[[], Iterable]] = field(default_factory=dict)

    def case(self, function: Callable[[], Iterable]) -> Callable[[], Iterable]:
        """Register a function that yields a name and a number, a sequence of them, or a verdict, and a
        tolerance where it is not the group's.
        """
        self.cases[function.__name__] = function
        return function

    def compute(self) -> Iterator[Number | str]:
        """The numbers of all cases; the sentence of a case that failed."""
        for case, function in self.cases.items():
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    for name, value, *more in function():
                        yield from _numbers(f"{case}.{name}", value, more[0] if more else self.tolerance)
            except Exception as error:  # a case that fails must not hide the others
                yield f"{self.name}: {case} failed: {type(error).__name__}: {error}"

    @property
    def file(self) -> pathlib.Path:
        return STORED / f"{self.name}.txt"

    def stored(self) -> dict[str, Number]:
        lines = self.file.read_text(encoding="utf-8").splitlines() if self.file.exists() else []
        found = [Number.of_line(line) for line in lines if line and not line.startswith("#")]
        return {number.name: number for number in found}

    def write(self, numbers: Iterable[Number]) -> None:
        """Store them; a value within its tolerance keeps the digits that it has, so that files change by what
        has moved alone.
        """
        old = self.stored()
        kept = [
            Number(new.name, old[new.name].value, new.tolerance, new.absolute)
            if new.name in old and old[new.name].moved(new.value) <= 1.0
            else new
            for new in numbers
        ]
        width = max(len(number.name) for number in kept)
        lines = [f"# {line}" for line in self.reason.splitlines()] + [number.line(width) for number in kept]
        self.file.parent.mkdir(exist_ok=True)
        self.file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _numbers(name: str, value: Any, tolerance: float) -> Iterator[Number]:
    """One number, or one for each entry: then relative to the largest, as zeros among them are known no
    better. None is nan, a verdict 0 or 1, a complex number its parts.
    """
    if value is None or np.ndim(value) == 0 and not np.iscomplexobj(value):
        yield Number(name, math.nan if value is None else float(value), tolerance)
        return
    values = np.asarray(value)
    if np.iscomplexobj(values):
        values = np.stack([values.real, values.imag], axis=-1)
    largest = np.nanmax(np.abs(values)) if np.isfinite(values).any() else 0.0
    allowed = float(f"{tolerance * largest:.0e}")
    for index, entry in np.ndenumerate(values):
        place = ".".join(str(i + 1) for i in index)
        yield Number(f"{name}.{place}", float(entry), allowed or tolerance, absolute=True)


def compare(group: Group, numbers: Iterable[Number | str]) -> list[tuple[float, str]]:
    """How far each number of a group is from the stored one, in tolerances, with what to print of it; inf for
    those that are new, gone or failed.
    """
    stored, found = group.stored(), []
    for number in numbers:
        if isinstance(number, str):
            found.append((math.inf, number))
        elif number.name not in stored:
            found.append((math.inf, f"{group.name}: {number.name} is new: {number.value:.10g}"))
        else:
            old = stored.pop(number.name)
            moved = old.moved(number.value)
            change = abs(number.value - old.value) / abs(old.value) if old.value else math.nan
            values = f"{old.value:.10g} -> {number.value:.10g}"
            found.append(
                (moved, f"{group.name}: {number.name} {values}, {change:.1e} of it, {moved:.3g} tolerances")
            )
    found += [(math.inf, f"{group.name}: {name} is gone") for name in stored]
    return found
