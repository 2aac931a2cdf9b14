"""Whether a period has steps enough, by the work that contact does in them.

Frictionless faces do no work in the exact motion. What they do in the steps, whichever sign it has, beside
the energy that passes between the loads and the modes, tells the error of the displacements: of 36 motions
(masses with stops, beams with cracks, damping ratios from 0.0005 on) in 512, 1024 and 2048 steps, with errors
from 7e-6 to 6e-2, the error was between a tenth and six times as much, of four out of five between 0.3 and
3.4. To halve those steps alone in which it is done cures the work, and not the error, which is of second
order all over the time of contact: beside a resonance of one mass 1.8e-2 became 1.3e-2, in twice the steps
3.7e-3; and along a curve the steps in question change from point to point.
"""

from __future__ import annotations

import numpy as np

from meshing.warnings import StepWarning

from ..errors import warn
from .period_map import DrivenPeriod
from .period_motion import PeriodMotion

# More than this, and default steps are halved; and the user is told of it where they are not.
LARGEST, REPORTED = 1e-3, 1e-2
# Steps that are halved become this many at most.
MOST = 32


class StepsTooLong(Exception):
    """Contact does too much work in the steps of a motion.

    Attributes
    ----------
    times : int
        So many times the steps are to be taken.
    """

    def __init__(self, times: int):
        super().__init__(f"contact does too much work; take {times} times the steps")
        self.times = times


def contact_work(driven: DrivenPeriod, motion: PeriodMotion) -> float:
    """Works of contact in the steps, taken positive, relative to what goes to and fro between the oscillating
    loads and the modes: the sum of what passes, whichever way, in each mode and step.
    """
    total = float(abs(motion.work).sum())
    if not total:
        return 0.0
    forces, velocities = driven.oscillations()
    exchanged = float(np.abs(forces * (velocities + motion.velocities))[:-1].sum()) * driven.step
    return total / exchanged if exchanged else 0.0  # at rest


def times_more(work: float, steps: int, most: int) -> int:
    """Times the steps, a power of two, in which the work, of second order in them, is small enough; as many
    as there may be.
    """
    times = 1
    while work > LARGEST * times**2 and 2 * times * steps <= most:
        times *= 2
    return times


def warn_of_contact_work(owner: str, work: float, steps: int) -> None:
    """Warn the owner's caller of a motion or a branch in whose steps contact does much work."""
    if work > REPORTED:
        warn(
            f"{owner}: contact, which does no work between smooth faces, does {work:.1g} of what the loads "
            f"exchange with the body in {steps} steps a period; displacements may be as much off: give more "
            "steps",
            StepWarning,
        )
