"""Loads over the steps of a history, whose jumps stand where they are."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..petsc import MPI
from ..ranks.parallel import collective
from ..signals.signal import Signal

# Instants nearer to each other than this share of a step are one.
SAME = 1e-9


# A step and the share of it that is done; amplitudes before and behind a jump there.
Place = tuple[int, float]
Sides = tuple[np.ndarray, np.ndarray]


class Piece(NamedTuple):
    """Equal steps over which the loads have no jump, or a part of one step.

    Attributes
    ----------
    first, steps : int
        Steps before it in its chunk, and those that it takes or is a part of.
    length : float
        Of one of them, s.
    amplitudes : (steps + 1, loads) array
        Behind a jump at its begin, before one at its end.
    complete : bool
        Whether it ends where a step does.
    """

    first: int
    steps: int
    length: float
    amplitudes: np.ndarray
    complete: bool


class Drive:
    """Amplitudes of the unit loads over equal steps.

    Parameters
    ----------
    comm : MPI.Comm
    signals : sequence of Signal
        One for each unit load.
    step : float
        s.
    """

    def __init__(self, comm: MPI.Comm, signals: Sequence[Signal], step: float):
        self._comm, self._signals, self._step = comm, signals, step
        breaks = [np.asarray(signal.breaks, dtype=float) for signal in signals]
        self._breaks = np.unique(np.concatenate([np.zeros(0), *breaks]))

    def __call__(self, time: np.ndarray) -> np.ndarray:
        """(n, loads) at instants (n,), s. Collective."""
        return self._values(time, "__call__")

    def _values(self, time: np.ndarray, which: str) -> np.ndarray:
        if not self._signals:
            return np.zeros((len(time), 0))
        with collective(self._comm):  # a user's function may fail on one rank alone
            values = np.stack([getattr(signal, which)(time) for signal in self._signals], axis=-1)
        return values

    def pieces(self, done: int, steps: int) -> tuple[np.ndarray, list[Piece]]:
        """Amplitudes (steps + 1, loads) at the instants of some steps behind `done` ones, and the pieces that
        the steps fall into where loads jump. Collective.
        """
        h, time = self._step, (done + np.arange(steps + 1)) * self._step
        at = self(time)
        slack = SAME * h + 4.0 * np.spacing(time[-1])
        inside = self._breaks[(self._breaks >= time[0] - slack) & (self._breaks <= time[-1] + slack)]
        if not len(inside):
            return at, [Piece(0, steps, h, at, True)]
        cuts = self._cuts(inside, at, time[0], slack)
        pieces = []
        for begin, end in pairwise(sorted(cuts)):
            whole = begin[1] == end[1] == 0.0
            count = end[0] - begin[0] if whole else 1
            amplitudes = at[begin[0] : begin[0] + count + 1].copy()
            amplitudes[0], amplitudes[-1] = cuts[begin][1], cuts[end][0]
            length = h if whole else (end[0] - begin[0] + end[1] - begin[1]) * h
            pieces.append(Piece(begin[0], count, length, amplitudes, end[1] == 0.0))
        return at, pieces

    def _cuts(self, inside: np.ndarray, at: np.ndarray, start: float, slack: float) -> dict[Place, Sides]:
        """Where pieces begin and end: amplitudes on either side."""
        before, after = self._values(inside, "before"), self._values(inside, "after")
        steps = len(at) - 1
        cuts: dict[Place, Sides] = {(k, 0.0): (at[k], at[k]) for k in (0, steps)}
        for group in np.split(np.arange(len(inside)), np.flatnonzero(np.diff(inside) > slack) + 1):
            where = (inside[group[0]] - start) / self._step
            sides = before[group[0]], after[group[-1]]
            nearest = min(round(where), steps)
            if abs(where - nearest) * self._step <= slack:
                if any((side != at[nearest]).any() for side in sides):
                    cuts[nearest, 0.0] = sides
                continue
            step = int(where)
            cuts[step, where - step] = sides
            for k in (step, step + 1):
                cuts.setdefault((k, 0.0), (at[k], at[k]))
        return cuts

    def sums(self, done: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes at the instants as `pieces` gives them, and twice their means (steps, loads) over each
        step. Collective.
        """
        at, pieces = self.pieces(done, steps)
        sums = np.zeros((steps, at.shape[1]))
        for first, count, length, amplitudes, _ in pieces:
            sums[first : first + count] += (amplitudes[:-1] + amplitudes[1:]) * (length / self._step)
        return at, sums
