"""From a period doubling to the motions of twice the period that leave the branch there, and from a
Neimark-Sacker point to quasi-periodic ones.
"""

from __future__ import annotations

import functools

import numpy as np

from ..checks import instance
from ..continuation.bifurcations import Bifurcation
from ..continuation.branch import Branch
from ..continuation.newton import attempt, correct
from ..continuation.orbit import Orbit, make_orbit, orbit_stability
from ..continuation.problem import Point
from ..continuation.problems.driven_orbits import Orbits, ParameterRange
from ..continuation.problems.own_tone import OwnTone, curve_near, first_curve
from ..continuation.problems.tones import QuasiPeriodic, own_motion, warn_if_unresolved
from ..errors import SolveError, failed_solve
from ..ranks.parallel import collective
from .analysis import analysis
from .options import SwitchOptions

# Sizes, relative to the state, at which a motion off the branch is looked for.
SIZES = (0.02, 0.05, 0.1, 0.01, 0.2)
# A motion found is of twice the period if its halves differ by at least this share of the size asked for.
TRULY = 0.5
# The same of quasi-periodic motions: a small curve is moved by the switches of pairs between steps of time.
QUASI_PERIODIC_SIZES = (0.05, 0.1, 0.02, 0.2, 0.01)


@analysis(SwitchOptions, rubs=True)
def switch_branch(
    branch: Branch, bifurcation: Bifurcation, *, size: float | None = None, samples: int = 21
) -> Orbit | QuasiPeriodic:
    """A motion that leaves a branch at a bifurcation: of twice the period at a period doubling,
    quasi-periodic with a tone of its own at a Neimark-Sacker point.

    It is looked for at a given distance from the branch along the critical Floquet direction, with the
    branch's parameter free. `frequency_response(..., start=orbit.frequency, guess=orbit)` follows the branch
    of an orbit, `quasi_periodic_response(motion, stop)` that of a quasi-periodic motion.

    Parameters
    ----------
    branch : Branch
    bifurcation : Bifurcation
        One of the branch's, of kind "period doubling" or "Neimark-Sacker".
    size : float, optional
        Distance relative to the state's norm. Default: several are tried, the first that is found counts; of
        quasi-periodic motions the first that its samples resolve, if there is one.
    samples : int
        Phases of the motion's own tone, at a Neimark-Sacker point; odd.

    Returns
    -------
    Orbit or QuasiPeriodic

    Raises
    ------
    ValueError
        If the bifurcation is of another kind.
    SolveError
        If no such motion is found at any size.

    Warns
    -----
    StepWarning
        If the samples do not resolve the quasi-periodic motion (`QuasiPeriodic.tail`).
    """
    instance("switch_branch", "branch", branch, Branch, "a Branch")
    comm = branch.period.reduced.comm
    with collective(comm):
        instance("switch_branch", "bifurcation", bifurcation, Bifurcation, "a Bifurcation of the branch")
        if bifurcation.kind not in ("period doubling", "Neimark-Sacker"):
            raise ValueError(
                f"switch_branch: {bifurcation!r} is no period doubling and no Neimark-Sacker point; motions "
                "of another period leave a branch only there"
            )
    if bifurcation.kind == "Neimark-Sacker":
        sizes = QUASI_PERIODIC_SIZES if size is None else (size,)
        found = _quasi_periodic(branch, bifurcation, sizes, samples)
        warn_if_unresolved("switch_branch", found)
        return found
    return _doubled(branch, bifurcation, SIZES if size is None else (size,))


def _quasi_periodic(
    branch: Branch, bifurcation: Bifurcation, sizes: tuple[float, ...], samples: int
) -> QuasiPeriodic:
    """On an invariant curve whose mean square distance from the periodic motion is given."""
    period = branch.period
    own = OwnTone(period, branch.parameter, branch.fixed_frequency, samples, period.comm)
    own.require_room("switch_branch")
    failed, found = list[SolveError](), list[Point]()
    for share in sizes:
        begin = first_curve(own, bifurcation, share)
        point = attempt(functools.partial(curve_near, own, *begin), SolveError, failed)
        found += [] if point is None else [point]
        if point is not None and point.state.resolved:
            return own_motion(point, stability=True)
    if found:
        return own_motion(found[0], stability=True)
    raise failed_solve(
        f"switch_branch: no quasi-periodic motion was found near {bifurcation!r}; give another size "
        f"({failed[-1]})"
    )


def _doubled(branch: Branch, bifurcation: Bifurcation, sizes: tuple[float, ...]) -> Orbit:
    old = branch.period
    period = old.repeated(2)
    value = bifurcation.own_value
    orbits = Orbits(period, ParameterRange(branch.parameter, value, value, branch.fixed_frequency))
    direction = bifurcation.direction.real / np.linalg.norm(bifurcation.direction.real)
    norm = old.size(bifurcation.state)
    row, there = np.append(direction / norm, 0.0), np.append(bifurcation.state, value)

    # the motion passes on both sides of the one of half its period, half a period apart; a pair that begins
    # to touch may leave but one of them in reach
    for share in (side * size for size in sizes for side in (1.0, -1.0)):

        def condition(u: np.ndarray, share: float = share) -> tuple[float, np.ndarray]:
            return float(row @ (u - there)) - share, row

        try:
            point = correct(orbits, there + np.append(share * norm * direction, 0.0), condition)
        except SolveError:
            continue
        motion, half = point.state.motion, period.steps // 2
        apart = np.linalg.norm(period.weights * (motion.states[half] - motion.states[0]))
        if apart > TRULY * abs(share) * norm:
            fixed = point.state
            fixed.residuals = tuple(fixed.scale * missed for missed in point.residuals)
            return make_orbit(fixed, "period doubling", orbit_stability(fixed))
    raise failed_solve(
        f"switch_branch: no motion of twice the period was found near {bifurcation!r}; give another size"
    )
