"""From a period doubling to the motions of twice the period that leave the branch there."""

from __future__ import annotations

import numpy as np

from ..checks import instance, positive
from ..dynamics.bifurcations import Bifurcation
from ..dynamics.branch import Branch
from ..dynamics.orbit import Orbit, make_orbit, orbit_stability
from ..dynamics.period_map import Period
from ..dynamics.shooting import shoot_along
from ..errors import SolveError, on_all_ranks
from ..parallel import agree, collective

# Sizes, relative to the state, at which a motion off the branch is looked for.
SIZES = (0.02, 0.05, 0.1, 0.01, 0.2)
# A motion found is of twice the period if its halves differ by at least this share of the size asked for.
TRULY = 0.5


def switch_branch(branch: Branch, bifurcation: Bifurcation, *, size: float | None = None) -> Orbit:
    """A motion of twice the period near a period doubling.

    It is looked for at a given distance from the branch along the critical Floquet direction, with the
    branch's parameter free. `frequency_response(..., start=orbit.frequency, first=orbit)` follows its branch.

    Parameters
    ----------
    branch : Branch
    bifurcation : Bifurcation
        One of the branch's, of kind "period doubling".
    size : float, optional
        Distance relative to the state's norm. Default: several are tried, the first that is found counts.

    Raises
    ------
    ValueError
        If the bifurcation is of another kind.
    SolveError
        If no motion of twice the period is found at any size.
    """
    instance("switch_branch", "branch", branch, Branch, "a Branch")
    comm = branch.reduced.comm
    with collective(comm):
        instance("switch_branch", "bifurcation", bifurcation, Bifurcation, "a Bifurcation of the branch")
        if size is not None:
            positive("switch_branch", "size", size, "relative")
        if bifurcation.kind != "period doubling":
            raise ValueError(
                f"switch_branch: {bifurcation!r} is no period doubling; motions of twice the period leave a "
                "branch only there"
            )
    agree(comm, "switch_branch", branch=branch.value, bifurcation=bifurcation.value, size=size)
    old = branch.period
    period = Period(old.reduced, old.excitation.repeated(2), 2 * old.steps, old.pairs > 0)
    direction = bifurcation.direction.real / np.linalg.norm(bifurcation.direction.real)
    norm = np.linalg.norm(bifurcation.state)

    def conditions(value: float) -> tuple[float, float]:
        return branch.conditions(value)

    for share in SIZES if size is None else (size,):
        target = direction @ bifurcation.state + share * norm

        def condition(state, change, target=target):
            return float(direction @ state - target), direction, 0.0

        try:
            fixed = shoot_along(
                period,
                bifurcation.state + share * norm * direction,
                bifurcation.value,
                lambda value: period.at(*conditions(value)),
                branch.parameter,
                condition,
            )
        except (SolveError, ValueError):
            continue
        motion = fixed.driven.run(fixed.state)
        half = period.steps // 2
        apart = np.linalg.norm(period.weights * (motion.states[half] - motion.states[0]))
        if apart > TRULY * share * norm:
            at = conditions(float(fixed.parameters[0]))
            return make_orbit(fixed, *orbit_stability(period, fixed, *at), "period doubling")
    raise on_all_ranks(
        SolveError(
            f"switch_branch: no motion of twice the period was found near {bifurcation!r}; give another size"
        )
    )
