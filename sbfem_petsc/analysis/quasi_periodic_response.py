"""Curves of quasi-periodic motions with a tone of their own, over a parameter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..checks import instance
from ..continuation.line_file import LineFile
from ..continuation.problems.curve_branch import PACE, QuasiPeriodicBranch, follow_curves, line_from
from ..continuation.problems.own_tone import Curves, curve_near
from ..continuation.problems.tones import QuasiPeriodic, own_curve
from ..progress import Progress
from ..ranks.parallel import collective
from .analysis import analysis
from .options import QuasiPeriodicResponseOptions

# A parameter is the same to this relative difference.
SAME = 1e-12


@analysis(QuasiPeriodicResponseOptions, rubs=True)
def quasi_periodic_response(
    guess: QuasiPeriodic,
    stop: float,
    *,
    parameter: str | None = None,
    points: int = 60,
    largest_step: float | None = None,
    stability: bool = True,
    file: str | None = None,
    resume: bool = False,
    progress: Progress = "auto",
) -> QuasiPeriodicBranch:
    """Follow quasi-periodic motions with a tone of their own from one of them on.

    The curve first goes where the motion's own tone grows or, over a `parameter` that is given, towards
    `stop`. It ends there, where the motion shrinks onto a periodic one, or where no further invariant curve
    is found that its samples resolve, as where the tone locks: `reason` says which. Where the first motion's
    samples no longer resolve it (`QuasiPeriodic.tail`) it goes on with twice, and four times, as many, if
    there is memory. With `stability` a history from each motion that attracts others must stay with it;
    behind one that it has stayed with the curve ends before the first from which it does not. Between motions
    where the tone's amplitude bends there are further ones.

    Parameters
    ----------
    guess : QuasiPeriodic
        The motion to begin from: from `switch_branch` at a Neimark-Sacker point, or of such a curve.
    stop : float
        Forcing frequency (Hz), or factor on the oscillating loads, all damping ratios or all gaps.
    parameter : {"frequency", "load", "damping", "gap"}, optional
        What changes. Default: the parameter of the branch that `guess` is of. A factor is 1 at `guess` but
        for the load of a `load_response`.
    points : int
        Points at most.
    largest_step : float, optional
        Largest change of the parameter from a point to the next one.
    stability : bool
        Compute the largest Lyapunov exponents.
    file : str, optional
        Journal that is kept up to date (`read`).
    resume : bool
        Continue `file` if it exists, with the same guess and settings.
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
        known = own_curve(guess)
        if parameter is not None:
            own, value = own.over(parameter, float(known[-1]))
            known = np.append(known[:-1], value)
        if abs(stop - known[-1]) <= SAME * stop:
            raise ValueError(f"{what}: stop = {stop:g} is where guess is; give another end")
    growing, pace = parameter is None, replace(PACE, points=points, largest_step=largest_step or np.inf)
    with LineFile(own.comm, file, resume=resume, task="quasi-periodic response", progress=progress) as run:
        told: dict[str, Any] = {"stop": stop, "stability": stability, "growing": growing}
        told |= {"samples": own.samples, "parameter": own.parameter, "frequency": own.frequency or 0.0}
        told |= {"largest_step": largest_step or "none", **own.factors}
        period, known = run.begin_period(own.period, told, known)
        own = replace(own, period=period)
        finer = own.finer(what)
        line = run.line(Curves(own, known, finer))
        line = line or line_from(curve_near(own, known, finer=finer), growing)
        return follow_curves(line, stop, pace, stability=stability, run=run)
