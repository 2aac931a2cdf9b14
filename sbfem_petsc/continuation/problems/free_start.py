"""The first free motion of a branch, at an energy at which the faces may already be at work."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...errors import SolveError
from ..follow import Line, Settings, follow
from ..problem import Point, Range
from .free import ADDED, FreeMotions, FreeSystem

# Additional gaps fall by this factor at first and at most, and no slower than by the second one; relative to
# those between which the mode moves freely they are left out from the third number on.
FALL, SLOWEST, LEAVE_OUT = 3.0, 1.01, 1e-4
# Relative opening of a pair by the mode below which it is not notes from those at the tip.
NEAR_TIP = 1e-3
# Gaps between which the mode moves freely, relative to its own opening: rounding does not touch them.
AJAR = 1.001
# How the branch is followed: lengths and turns of steps, and points at most on the way to its first energy.
PACE = Settings(points=400, first=0.05, largest=0.4, smallest=1e-6, turn=0.25)


def first_motion(system: FreeSystem, energy: float) -> Point:
    """The free motion of the followed mode at an energy, J.

    Below the energy at which faces touch it is the mode itself. Above it the branch is followed up to there;
    where faces touch at rest, as those of a closed crack do, gaps are opened until the mode moves freely and
    brought down again.

    Raises
    ------
    SolveError
        If the way there ends before.
    """
    r, k = system.reduced, system.mode
    sign, touching = system.open_side()
    guess = float(r.frequencies[k]), 2.0 * float(r.damping[k]) * r.omega[k]
    low = energy if energy < touching or system.pairs == 0 else 0.9 * touching
    if not low > 0.9e-12 * energy:
        return _from_opened_gaps(system, energy, sign, guess)
    first = system.motion(system.linear(low, sign), *guess, low)
    if low == energy:
        return first
    first.problem = FreeMotions(system, (0.5 * low, energy), interactions=False)
    line = follow(Line([first]), Range(0.5 * low, energy, 1), PACE)
    if line.points[-1].value == energy:
        return line.points[-1]
    raise SolveError(
        f"backbone: the branch of mode {k + 1} could not be followed from {low:.4g} J, where nothing "
        f"touches, to {energy:.4g} J: {line.reason}"
    )


def _from_opened_gaps(system: FreeSystem, energy: float, sign: float, guess: tuple[float, float]) -> Point:
    """From gaps between which the mode moves freely, lowered to the given ones, with damping that is taken
    away thereafter; the self-excitation makes up for it all the way.
    """
    r, k = system.reduced, system.mode
    moved = np.abs(r.gap.modes[:, k]) / system.weights[k]
    largest = float(moved.max(initial=0.0))
    if largest == 0.0:
        return system.motion(system.linear(energy, sign), *guess, energy)
    # a crack's opening grows with the root of the distance from its tip: its square is a notch's
    shape = math.sqrt(2.0 * energy) * moved * np.maximum(moved / largest, NEAR_TIP)

    def opened(share: float) -> FreeSystem:
        """With damping besides, lest multiples of the frequency meet those of high modes."""
        other = replace(r, initial_gap=r.initial_gap + share * shape, damping=r.damping + ADDED)
        return FreeSystem(other, k, system.steps)

    share, fall = AJAR / max(float(moved.min()) / largest, NEAR_TIP), FALL
    there = opened(share)
    guess = guess[0], guess[1] + 2.0 * ADDED * r.omega[k]
    point = there.motion(there.linear(energy, sign), *guess, energy)
    while share > 0.0:
        lower = share / fall if share / fall >= LEAVE_OUT else 0.0
        try:
            point = opened(lower).again(point, energy)
        except SolveError:
            fall = math.sqrt(fall)
            if fall < SLOWEST:
                raise SolveError(
                    f"backbone: mode {k + 1} could not be followed from an opened crack to the given one "
                    f"beyond {share:.3g} of the opening in which it moves freely; try more steps or modes"
                ) from None
            continue
        share, fall = lower, min(FALL, fall**1.5)
    try:
        return system.without(point, ADDED)
    except SolveError as error:
        said = str(error).removeprefix("backbone: ")
        raise SolveError(
            f"backbone: mode {k + 1} is found at {point.state.frequency:.6g} Hz with a damping ratio of "
            f"{ADDED:g} added, but not without it ({said}), as where multiples of its frequency meet those "
            "of high modes; take damping=True, or other modes or steps"
        ) from None
