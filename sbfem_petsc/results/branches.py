"""Branches of periodic motions in files."""

from __future__ import annotations

import os
import warnings

from ..checks import shown
from ..dynamics.bifurcations import Bifurcation
from ..dynamics.branch import Branch
from ..dynamics.excitation import Excitation
from ..dynamics.period_map import Period
from ..recording.branch_file import FORM, VERSION, WHAT, read_arrays, write_branch
from ..recording.hdf5 import opened
from ..recording.reduced_models import read_reduced_model


class IncompleteBranch(UserWarning):
    """The run that wrote the file has not reached the end of its range."""


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
        attrs = file.attrs
        periods = int(attrs["periods"])
        excitation = Excitation(file["excitation/orders"][()], file["excitation/amplitudes"][()], periods)
        period = Period(
            read_reduced_model(file["reduced_model"]), excitation, int(attrs["steps"]), bool(attrs["contact"])
        )
        groups = [file["bifurcations"][name] for name in sorted(file.get("bifurcations", ()))]
        found = tuple(
            Bifurcation(
                str(group.attrs["kind"]),
                float(group.attrs["value"]),
                complex(group.attrs["multiplier"]),
                group["state"][()],
                group["direction"][()],
                int(group.attrs["after"]),
                int(group.attrs["row"]) if "row" in group.attrs else None,
            )
            for group in groups
        )
        branch = Branch(
            parameter=str(attrs["parameter"]),
            **read_arrays(file),
            bifurcations=found,
            reason=str(attrs["reason"]),
            complete=bool(attrs["complete"]),
            periods=periods,
            period=period,
            fixed_frequency=float(attrs["fixed_frequency"]) or None,
        )
        stop = float(attrs["stop"])
    if not branch.complete:
        warnings.warn(
            f"{WHAT} {os.fspath(path)!r} is incomplete: it ends at {branch.value[-1]:.8g} of {stop:.8g}; "
            "resume=True continues it",
            IncompleteBranch,
            stacklevel=2,
        )
    return branch
