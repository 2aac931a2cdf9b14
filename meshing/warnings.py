"""Warnings of both packages, each told to the user in one sentence.

This module imports nothing of ours: whoever is told of a warning, such as a test runner's other process, may
import it from any thread.
"""

from __future__ import annotations

import sys
import warnings

# Modules between a line that warns and the user's: both packages, and wrappers of their functions.
INSIDE = ("meshing", "sbfem_petsc", "contextlib", "functools")


class GmshWarning(UserWarning):
    """Something in a user's model that is read, but may not be what the user meant."""


class UnitWarning(UserWarning):
    """A length, or a modulus with its density, is of a size that hints at another unit than SI."""


class LargeDisplacementWarning(UserWarning):
    """Displacements are too large a part of the body for the theory of small displacements."""


class MeshWarning(UserWarning):
    """Cells are large, or their order or terms low, for what a result does in them: waves, bending, tips."""


class LoadWarning(UserWarning):
    """A load, or the contact of two faces, acts on nothing, because a support holds the direction of it."""


class BandWarning(UserWarning):
    """The modes kept, or the mesh behind them, do not reach the band of the loads."""


class AccuracyWarning(UserWarning):
    """A result is told to be less accurate than was asked for, or its error is not told."""


class StepWarning(UserWarning):
    """The time step is coarse for the load's highest frequency or for contact, the phases of a slower tone
    are few for its multiples or do not resolve the motion, or not every step is kept.
    """


class PlaceWarning(UserWarning):
    """A place is that of two points of a body, where the faces of a crack coincide."""


class RoundOffWarning(UserWarning):
    """Round-off limits the digits of a result to less than is usual."""


class SolverWarning(UserWarning):
    """Another linear solver suits the size or the shape of the structure better."""


class OptionWarning(UserWarning):
    """An option of the command line looks like one of PETSc's with a misspelt prefix, or lets a solve end
    before there is a result.
    """


class BranchWarning(UserWarning):
    """A curve has not come to the end of its range, or is not gone on with as it was."""


class IncompleteBranch(UserWarning):
    """The run that wrote the file has not reached the end of its range."""


class IncompleteHistory(UserWarning):
    """The run that wrote the file has not ended, or not yet."""


def warn(origin: str, sentence: str, kind: type[Warning] = GmshWarning) -> None:
    """A warning that names its origin, shown at the line outside of both packages that asked for it."""
    warnings.warn(f"{origin}: {sentence}", kind, stacklevel=caller_level())


def caller_level() -> int:
    """`stacklevel` of the line outside of both packages, for a function that warns itself."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in INSIDE:
        level, frame = level + 1, frame.f_back
    return level


# m; parts that are analysed here are seldom larger or smaller, but those whose mm are taken for m are
LARGEST, SMALLEST = 20.0, 1e-3
IN_METRES = "lengths are in m, so divide those in millimetres by 1000"


def check_extent(
    origin: str, width: float, height: float, *, if_large: str | None = IN_METRES, if_small: str = IN_METRES
) -> None:
    """Warn of a body above 20 m or below 1 mm.

    Parameters
    ----------
    origin : str
        What or which file it is, for the message.
    width, height : float
        m.
    if_large, if_small : str
        How it is mended; None where a large body is known to be meant.

    Warns
    -----
    UnitWarning
    """
    mend = if_large if max(width, height) > LARGEST else if_small if max(width, height) < SMALLEST else None
    if mend is not None:
        warn(origin, f"it is {width:g} m wide and {height:g} m high; {mend}.", UnitWarning)
