"""How many steps a history takes, how long they are, which of them are kept, and whether there is room."""

from __future__ import annotations

import math

from meshing.warnings import StepWarning

from ..errors import warn, wrong_input
from ..petsc import MPI
from ..ranks.capacity import PlannedFile, default_decimation, require_disk, require_memory
from ..reduction.reduced_model import ReducedModel
from ..signals.signal import STEPS_A_PERIOD
from .integration import Steps

# With contact, the default step is at most this share of the highest mode's period: pairs that open and close
# excite all modes, however slow the load is. Measured on beams of several proportions, cracks open and
# closed, 40 to 160 modes: up to 0.9 the errors of displacement and contact resultant are below 1e-5 and 1e-3;
# from 1 on, where modes go through whole periods in a step, up to 1e-3 and 1e-2.
CONTACT_STEP = 0.8
# Fewer steps a period of the loads' highest frequency than this, and the user is warned.
COARSE = 20
# More steps than this are refused.
MOST_STEPS = 1e9


def default_step(duration: float, highest: float, top: float) -> float:
    """Time step for the highest frequencies of the loads and of the modes, Hz."""
    step = 1.0 / (STEPS_A_PERIOD * highest) if highest > 0.0 else duration / 2000.0
    return min(step, CONTACT_STEP / top) if top > 0.0 else step


def contact_steps(reduced: ReducedModel, frequency: float) -> int:
    """Steps in a period of a frequency (Hz) that are no longer than this share of the shortest modal one."""
    return math.ceil(float(reduced.frequencies.max(initial=0.0)) / (CONTACT_STEP * frequency))


def warn_if_coarse(owner: str, steps: int, frequency: float, fastest: float, *, period: str) -> None:
    """Warn of few steps a period of the loads' highest frequency, of so many in one of `frequency`, Hz."""
    if steps * frequency < COARSE * fastest * (1.0 - 1e-9):  # a frequency that rounding has moved is no other
        warn(
            f"{owner}: {steps} steps a {period} are {steps * frequency / fastest:.1f} a period of the "
            f"highest load frequency {fastest:g} Hz; at least {COARSE} are advisable",
            StepWarning,
        )


def plan_steps(
    duration: float, step: float | None, decimation: int | None, row: int, former: Steps | None
) -> tuple[int, float, int]:
    """Number of steps, the step, and every how many are kept: with those of the file that is to be continued
    if none or the same were asked for, otherwise such that they divide `duration`.
    """
    if former is not None:
        decimation = former.decimation if decimation is None else decimation
        if step is None or multiple(former.count * former.step / step, decimation) == former.count:
            return multiple(duration / former.step, decimation), former.step, decimation
    assert step is not None
    if not duration / step < MOST_STEPS:
        raise wrong_input(
            f"transient: {duration / step:.3g} steps of {step:.3g} s, at a microsecond or more each, "
            f"would take at least {duration / step / 3.6e9:.3g} hours; give a shorter duration, a "
            "larger step or loads of lower frequency"
        )
    count = multiple(duration / step, 1)
    if decimation is not None and decimation > count:
        raise wrong_input(
            f"transient: decimation = {decimation} is more than the {count} steps there are; give fewer"
        )
    decimation = default_decimation(count, row) if decimation is None else decimation
    count = multiple(count, decimation)
    return count, duration / count, decimation


def multiple(steps: float, divisor: int) -> int:
    """The least multiple of a divisor that reaches a number of steps."""
    return divisor * max(1, math.ceil(steps / divisor * (1.0 - 1e-9)))


def require_room(
    comm: MPI.Comm, steps: Steps, row: int, file: str | None, *, in_memory: bool, former: Steps | None
) -> None:
    """Refuse a history that would take more memory or disk than is free."""
    needed, what = float(steps.kept * row), f"{steps.kept:,d} instants of {row:,d} bytes"

    def fewer(share: float) -> str:
        return f"keep every {math.ceil(steps.decimation / share)}th step or fewer (decimation)"

    if in_memory:
        require_memory(
            "transient",
            comm,
            needed,
            what,
            lambda share: (
                f"{fewer(share)}, or leave them in a file (file = 'history.journal', in_memory = False)"
            ),
        )
    if file is not None:
        continued = former is not None and former.count == steps.count
        require_disk("transient", comm, PlannedFile(file, needed, continued), what=what, remedy=fewer)
