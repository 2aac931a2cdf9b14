"""Branches of free periodic motions over their energy, by pseudo-arclength continuation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...errors import SolveError
from .free import SPAN, FreeMotion, FreeSystem

FIRST, LARGEST, SMALLEST = 0.05, 0.4, 1e-6
# The turn (radian) and the Newton iterations of a step that are aimed at, and beyond which it is repeated at
# half its length.
TURN, TOO_SHARP, COMFORT, TOO_MANY = 0.25, 0.8, 4, 8
# A step below which the branch is taken to meet an interaction with a higher mode; the damping ratio with
# which it is passed, energies at which a motion beyond it is looked for, in units of that before it, and the
# step there. Its branch goes mostly along the state itself, by this cosine.
NARROW, ADDED, LEAPS, AFTER, MOSTLY = 0.004, 0.01, (1.01, 1.02, 1.05, 1.1, 1.2, 1.4, 1.7, 2.0), 0.02, 0.5


class Pace(NamedTuple):
    """How a branch is followed: towards higher (1) or lower energies (-1) from its first point, points at
    most, the largest relative change of the state from one to the next, and whether into interactions.
    """

    direction: int = 1
    most: int = 200
    largest_step: float = LARGEST
    interactions: bool = False


class FreeBranch:
    """A branch of free motions between two energies, point by point.

    Iterating goes through the points after the first one, the end of the range included; afterwards `points`
    holds them all and `reason` says why it stopped.

    Interactions with higher modes, where the branch turns back in energy along a narrow tongue, are passed
    over unless they are to be followed; `passed` holds the energies on either side of each.
    """

    def __init__(
        self, system: FreeSystem, first: FreeMotion, limits: tuple[float, float], pace: Pace | None = None
    ):
        pace = pace or Pace()
        self.system, (self.lower, self.upper), self.most = system, limits, pace.most
        self.points, self.length, self.reason = [first], min(FIRST, pace.largest_step), ""
        self.largest_step, self.direction = pace.largest_step, pace.direction
        self.interactions = pace.interactions
        # up to here no pair is at work: a motion is the mode alone, which meets no other
        self.touching = system.open_side()[1]
        self.passed: list[tuple[float, float]] = []
        start = np.zeros(2 * system.modes + 2)
        start[:-2] = self.direction * first.state / np.linalg.norm(first.state)
        self.heading = system.tangent(first, start)

    def __iter__(self) -> Iterator[FreeMotion]:
        tried = 0.0
        while len(self.points) < self.most:
            last = self.points[-1]
            # behind the furthest energy the branch is in a tongue that could not be passed over
            inside = self.interactions or self.direction * (last.energy - self._furthest()) < 0.0
            point = self._next(0.0 if inside else NARROW)
            meets = point is None or self._turned(point)
            if meets and not self.interactions and self.touching < last.energy != tried:
                tried = last.energy
                beyond = self._beyond()
                point = beyond or point
            if point is None:
                point = self._next(0.0)
            if point is None:
                self.reason = f"no further motion beyond {last.energy:.6g} J"
                return
            self.points.append(point)
            yield point
            if not self.lower < point.energy < self.upper:
                self.reason = f"end of the range at {point.energy:.6g} J"
                return
        self.reason = f"{self.most} points"

    def _furthest(self) -> float:
        return self.direction * max(self.direction * point.energy for point in self.points)

    def _turned(self, point: FreeMotion) -> bool:
        return self.direction * (point.energy - self.points[-1].energy) < 0.0

    def _beyond(self) -> FreeMotion | None:
        """A motion on the other side of an interaction: with damping there is none, so the way leads over
        damped motions.
        """
        system, last = self.system, self.points[-1]
        more = system.damped(ADDED)
        try:
            excitation = last.excitation + 4.0 * math.pi * last.frequency * ADDED
            damped = more.again(last, last.energy, excitation)
        except SolveError:
            return None
        for factor in LEAPS:
            energy = min(max(last.energy * factor**self.direction, self.lower), self.upper)
            try:
                damped = more.again(damped, energy, damped.excitation)
                if self.direction * (energy - self._furthest()) <= 0.0:
                    continue
                point = replace(system.without(damped, ADDED), energy=energy)
                start = np.zeros(2 * system.modes + 2)
                start[:-2] = self.direction * point.state / np.linalg.norm(point.state)
                heading = system.tangent(point, start)
            except (SolveError, np.linalg.LinAlgError):
                continue
            if self.direction * heading[:-2] @ point.state < MOSTLY * np.linalg.norm(point.state):
                continue
            self.heading, self.length = heading, AFTER
            self.passed.append((last.energy, energy))
            return point
        return None

    def _next(self, least: float) -> FreeMotion | None:
        """The next motion. In a tongue, from rest if the last one is and there is such a one: near motions of
        another mode the steps make others beside them, which end in corners.
        """
        first, at_rest = self.length, least == 0.0 and self.system.from_rest(self.points[-1])
        for reversible in (True, False) if at_rest else (False,):
            self.length = first
            while self.length >= max(least, SMALLEST):
                point = self._step(self.length, reversible)
                if point is not None:
                    return point
                self.length *= 0.5
        return None

    def _step(self, length: float, reversible: bool) -> FreeMotion | None:
        system, last, heading = self.system, self.points[-1], self.heading
        size, m2 = float(np.linalg.norm(last.state)), 2 * self.system.modes
        guess = last.state + length * size * heading[:m2]
        frequency = last.frequency * math.exp(length * heading[m2] / SPAN)
        excitation = last.excitation + 2.0 * math.pi * last.frequency * length * heading[m2 + 1]

        def across(state: np.ndarray, f: float):
            along = heading[:m2] @ (state - last.state) / size
            along += heading[m2] * SPAN * math.log(f / last.frequency)
            return along - length, heading[:m2] / size, heading[m2] * SPAN / f

        try:
            point = system.solve(guess, frequency, excitation, across, reversible=reversible)
            if not self.lower < point.energy < self.upper:
                end = self.upper if point.energy >= self.upper else self.lower
                at_end = system.at_energy(end)
                point = system.solve(
                    point.state, point.frequency, point.excitation, at_end, reversible=reversible
                )
                point = replace(point, energy=end)
            chord = np.zeros(m2 + 2)
            chord[:m2] = (point.state - last.state) / size
            chord[m2] = SPAN * math.log(point.frequency / last.frequency)
            chord /= np.linalg.norm(chord)
            onward = system.tangent(point, chord, reversible=reversible)
        except (SolveError, np.linalg.LinAlgError):
            return None
        cosine = min(chord[: m2 + 1] @ heading[: m2 + 1], onward[: m2 + 1] @ chord[: m2 + 1])
        turn = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        if length > 100.0 * SMALLEST and (turn > TOO_SHARP or point.iterations > TOO_MANY):
            return None
        self.heading = onward
        grow = min(TURN / max(turn, 1e-3), COMFORT / max(point.iterations, 1) + 0.25)
        self.length = min(self.largest_step, max(0.5, min(2.0, grow)) * length)
        return point
