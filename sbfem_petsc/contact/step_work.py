"""What a time step does: the work of contact, what friction takes, and the energy of the modes at its end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compiled import inner_loops, inner_sums
from .held_rows import Rubbing
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
    """To friction in a step of a normal and a tangential row that touch at one end alone: gap and slip go
    linearly between what they are where the rows are apart and what the forces where they touch keep them
    from; while the gap of that way is closed, friction goes linearly with the slip.
    """
    (i, j), lands = rows, before.rows[rows[0]] == FREE
    apart, touching = (before, after) if lands else (after, before)
    overlap, held = 0.0, 0.0
    for k in range(touching.force.size):
        overlap += flexibility[i, k] * touching.force[k]
        held += flexibility[j, k] * touching.force[k]
    share = max(overlap, 0.0) / max(max(overlap, 0.0) + max(apart.gap[i], 0.0), 1e-300)
    slipped = share * (after.gap[j] - before.gap[j]) + (1.0 - share) * (held if lands else -held)
    return max(-0.5 * touching.force[j] * slipped, 0.0)


@inner_loops
def lost_to_friction(flexibility: np.ndarray, rubbing: Rubbing, before: End, after: End) -> float:
    """To friction in a step: the slips' changes times the mean of what the pressure allows at its end and as
    the slip begins. What slips before does so from the step's beginning, what sticks as its friction reaches
    what a pressure that goes linearly allows, or of static friction, which is more, what held it.
    """
    total, count = 0.0, rubbing.beside.size
    for k in range(rubbing.rows.size):
        i, j = rubbing.rows[k], count + k
        slipped = abs(after.gap[j] - before.gap[j])
        if slipped == 0.0:
            continue
        if (before.rows[i] == FREE) != (after.rows[i] == FREE):
            total += _lost_partly(flexibility, before, after, (i, j))
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
