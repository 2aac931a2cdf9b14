"""What a time step does: the work of contact, what friction takes, and the energy of the modes at its end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compiled import inner_loops, inner_sums
from .friction import Rubbing
from .law import FREE


class End(NamedTuple):
    """One end of a step: q and v (m,), modal forces of contact (m,), its forces, gaps, states of its rows."""

    q: np.ndarray
    v: np.ndarray
    pull: np.ndarray
    force: np.ndarray
    gap: np.ndarray
    rows: np.ndarray


@inner_sums
def work_of_contact(before: End, after: End) -> float:
    """Of contact in a step: mean of the forces times change of the gaps."""
    total = 0.0
    for i in range(before.gap.size):
        total += (before.force[i] + after.force[i]) * (after.gap[i] - before.gap[i])
    return 0.5 * total


@inner_sums
def _lost_partly(flexibility: np.ndarray, before: End, after: End, rows: tuple[int, int]) -> float:
    """To friction in a step in which a normal and a tangential row part: gap and slip go linearly from what
    the forces keep them from; while the gap of that way is closed, friction goes linearly with the slip.
    """
    i, j = rows
    overlap, held = 0.0, 0.0
    for k in range(before.force.size):
        overlap += flexibility[i, k] * before.force[k]
        held += flexibility[j, k] * before.force[k]
    share = max(overlap, 0.0) / max(max(overlap, 0.0) + max(after.gap[i], 0.0), 1e-300)
    slipped = share * (after.gap[j] - before.gap[j]) - (1.0 - share) * held
    return max(-0.5 * before.force[j] * slipped, 0.0)


@inner_loops
def lost_to_friction(
    flexibility: np.ndarray, rubbing: Rubbing, kept: np.ndarray, before: End, after: End
) -> float:
    """To friction in a step: the slips' changes times the mean of what the pressure allows at its end and as
    the slip begins. What slips before does so from the step's beginning, what sticks as its friction reaches
    what a pressure that goes linearly allows, or of static friction, which is more, what held it.
    """
    total, count = 0.0, rubbing.beside.size
    for k in range(rubbing.rows.size):
        i, j = rubbing.rows[k], count + k
        if before.rows[i] != FREE and after.rows[i] == FREE:
            total += _lost_partly(flexibility, before, after, (i, j))
            continue
        slipped = abs(after.gap[j] - kept[j])
        if slipped == 0.0:
            continue
        begun = rubbing.kinetic[k] * max(before.force[i], 0.0)
        ended, held = rubbing.kinetic[k] * max(after.force[i], 0.0), abs(before.force[j])
        left = max(begun - held, 0.0) * flexibility[j, j]
        begun = max(begun, held) + left / max(left + slipped, 1e-300) * (ended - begun)
        total += 0.5 * (begun + ended) * slipped
    return total


@inner_sums
def energy_of_modes(stiffness: np.ndarray, end: End) -> float:
    """Of the modes."""
    total = 0.0
    for j in range(stiffness.size):
        total += end.v[j] * end.v[j] + stiffness[j] * end.q[j] * end.q[j]
    return 0.5 * total
