"""Curves of quasi-periodic motions with a tone of their own, over the branch's parameter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..checks import instance
from ..continuation.problems.own_tone_branch import QuasiPeriodicBranch, follow_circles
from ..continuation.problems.tones import QuasiPeriodic, own_circle, own_motion
from ..errors import SolveError, on_all_ranks
from ..parallel import collective
from ..progress import progress_bar
from .analysis import analysis
from .options import QuasiPeriodicResponseOptions

# A parameter is the same to this relative difference.
SAME = 1e-12


@analysis(QuasiPeriodicResponseOptions)
def quasi_periodic_response(
    guess: QuasiPeriodic,
    stop: float,
    *,
    points: int = 60,
    largest_step: float | None = None,
    stability: bool = True,
    progress: Callable[[float], None] | str | None = "auto",
) -> QuasiPeriodicBranch:
    """Follow quasi-periodic motions with a tone of their own from one of them on.

    The parameter is that of the branch they have left. The curve first goes where the motion's own tone
    grows; it ends at `stop`, where the motion shrinks onto a periodic one, or where no further invariant
    curve is found that its samples resolve, as where the tone locks: `reason` says which. Where the first
    motion's samples no longer resolve it (`QuasiPeriodic.tail`) it goes on with twice, and four times, as
    many, if there is memory. With `stability` a history from each motion that attracts others must stay with
    it; behind stable ones the curve ends before the first from which it does not.

    Parameters
    ----------
    guess : QuasiPeriodic
        The motion to begin from: from `switch_branch` at a Neimark-Sacker point, or of such a curve.
    stop : float
        Forcing frequency (Hz) or load factor.
    points : int
        Points at most.
    largest_step : float, optional
        Largest change of the parameter from a point to the next one.
    stability : bool
        Compute the largest Lyapunov exponents.
    progress : callable, "auto" or None
        As for `transient`.

    Raises
    ------
    ValueError, TypeError
        For input that makes no sense.
    SolveError
        If the first motion cannot be found again, or if more samples do not resolve it either.
    """
    what = "quasi_periodic_response"
    instance(what, "guess", guess, QuasiPeriodic, "a QuasiPeriodic")
    own = guess.own
    if own is None:
        raise ValueError(
            f"{what}: guess = {guess!r} has no tone of its own; give one that switch_branch has found at a "
            "Neimark-Sacker point"
        )
    with collective(own.comm):
        known = own_circle(guess)
        if abs(stop - known.value) <= SAME * stop:
            raise ValueError(f"{what}: stop = {stop:g} is where guess is; give another end")
    plane = np.eye(1, known.states.size + 2, known.states.size + 1)[0]
    try:
        begin = own.near(known, plane)
        with progress_bar(own.comm, "quasi-periodic response", progress) as report:
            found, reason = follow_circles(
                own.finer(what),
                begin,
                stop,
                points=points,
                largest_step=largest_step or math.inf,
                report=report,
            )
    except SolveError as error:
        raise on_all_ranks(error) from None
    motions = [own_motion(replace(own, samples=len(item.states)), item, stability) for item in found]
    stands = np.array([motion.stable is True for motion in motions])
    refuted = [k for k, motion in enumerate(motions) if not motion.resolved and stands[:k].any()]
    if refuted:
        del motions[refuted[0] :]
        reason = (
            f"no further curve at {found[len(motions) - 1].value:.8g}: histories from the next one leave it, "
            "though its exponents are negative: the tone locks, or more samples or steps are needed"
        )
    return QuasiPeriodicBranch(
        own.parameter,
        np.array([circle.value for circle in found[: len(motions)]]),
        tuple(motions),
        reason,
        len(motions) == len(found) and found[-1].value == stop,
    )
