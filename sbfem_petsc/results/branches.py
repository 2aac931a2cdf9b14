"""Branches of periodic motions in files."""

from __future__ import annotations

import os
import warnings

from meshing.warnings import IncompleteBranch

from ..checks import shown
from ..continuation.bifurcations import Bifurcation
from ..continuation.branch import Branch
from ..errors import caller_level
from ..motion.excitation import Excitation
from ..motion.period_map import Period
from ..recording.branch_file import FORM, VERSION, WHAT, read_branch_file, write_branch
from ..recording.hdf5 import opened
from ..recording.sound import number, numbers, text, whole


def save_branch(branch: Branch, path: str) -> None:
    """Write a branch; the file takes its name when it is whole.

    Raises
    ------
    TypeError, ValueError
        If it cannot be written.
    """
    if not isinstance(branch, Branch):
        raise TypeError(f"save_branch: branch = {shown(branch)} is not a Branch")
    write_branch(branch, path)


def read_branch(path: str) -> Branch:
    """Read a branch, also one whose run has not ended.

    Raises
    ------
    TypeError, ValueError
        If the file is missing, truncated, damaged or of another kind.

    Warns
    -----
    IncompleteBranch
        If the branch has not reached the end of its range.
    """
    with opened(path, WHAT, {FORM: VERSION}) as file:
        found = read_branch_file(file)
        period, reduced = None, found.pop("reduced")
        if reduced is not None:
            excitation = Excitation.of_file(found["periods"], **found.pop("excitation"))
            period = Period(reduced, excitation, found.pop("steps"), found.pop("contact"))
        count, size = found["states"].shape
        groups = [file["bifurcations"][name] for name in sorted(file.get("bifurcations", ()))]
        bifurcations = tuple(
            Bifurcation(
                text(group, "kind"),
                number(group, "value"),
                complex(group.attrs["multiplier"]),
                numbers(group, "state", size),
                numbers(group, "direction", size, kinds="fc"),
                whole(group, "after", most=count),
                number(group, "own_value"),
                number(group, "error", finite=False),
                whole(group, "row") if "row" in group.attrs else None,
            )
            for group in groups
        )
        branch = Branch(**found, bifurcations=bifurcations, map=period)
        stop = float(file.attrs["stop"])
    if not branch.complete:
        last, reason = float(branch.value[-1]), branch.reason
        where = f"{last:.8g}" if last == stop else f"{last:.8g} of {stop:.8g}"
        if reason == "unfinished":
            why = "resume=True continues it"
        elif reason.endswith(" points"):
            why = f"it was given {reason}; resume=True with more of them continues it"
        else:
            why = f"its run has ended: {reason}"
        warnings.warn(
            f"{WHAT} {os.fspath(path)!r} is incomplete: it ends at {where}; {why}",
            IncompleteBranch,
            stacklevel=caller_level(),
        )
    return branch
