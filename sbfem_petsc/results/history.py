"""Reading histories from files that a run has recorded, or still records."""

from __future__ import annotations

import os
import warnings

import h5py

from meshing.warnings import IncompleteHistory

from ..capacity import SHARE, available_memory, in_bytes
from ..checks import flag
from ..errors import caller_level
from ..motion.history import History
from ..motion.reduced_history import recorded_exchanges, reduced_columns, reduced_history
from ..motion.unreduced.history import SampledRun, sampled_columns, unreduced_history
from ..recording.hdf5 import opened
from ..recording.history_layout import FORM, VERSION, WHAT, Contents, newest, verified
from ..recording.reduced_models import read_reduced_model
from ..recording.sound import number, whole
from ..reduction.reduced_model import ReducedModel


def read_history(path: str, *, in_memory: bool = True) -> History:
    """Read a history, reduced or not, also one whose run has not ended, or was killed.

    Parameters
    ----------
    path : str
    in_memory : bool
        False: the arrays are read from the file as they are used.

    Raises
    ------
    TypeError, ValueError
        If the file is missing, truncated, damaged or of another kind; one sentence.

    Warns
    -----
    IncompleteHistory
        If the run that wrote it has not ended, or the checkpoint behind its last rows is damaged; what is
        recorded before is returned.
    """
    flag("read_history", "in_memory", in_memory)
    with opened(path, WHAT, {FORM: VERSION}) as file:
        contents = Contents.read(file)
        head, states, lost = newest(file, contents)
        reduced = read_reduced_model(file["reduced_model"]) if contents.kind == "reduced" else None
        _require_columns(file, contents, reduced)
    rows = verified(os.fspath(path), contents, head)
    if in_memory:
        size = 8.0 * sum(values.size for values in rows.values())
        if size > SHARE * available_memory():
            raise ValueError(
                f"{WHAT} {os.fspath(path)!r} would take {in_bytes(size)} of memory, "
                f"{in_bytes(SHARE * available_memory())} are free; read it with in_memory = False"
            )
        rows = {name: values[...].copy() for name, values in rows.items()}
    settings = contents.settings
    complete = head.done == settings["count"]
    if not complete:
        why = f"incomplete: its run has recorded {head.done} of {settings['count']} steps"
        if lost:
            why = (
                f"damaged: what vouches for the last {lost} of its {head.rows + lost} instants has been "
                f"changed, and only those up to step {head.done} are read"
            )
        warnings.warn(
            f"{WHAT} {os.fspath(path)!r} is {why}; resume=True continues from there",
            IncompleteHistory,
            stacklevel=caller_level(),
        )
    if reduced is not None:
        return reduced_history(rows, reduced, settings["step"], recorded_exchanges(states), complete)
    assert contents.tips is not None  # by `_require_columns`
    return unreduced_history(
        rows,
        SampledRun(
            tuple(contents.texts["points"]),
            contents.tips,
            settings["pairs"],
            settings["step"],
            settings["damped_modes"],
        ),
        complete,
    )


def _require_columns(file: h5py.File, contents: Contents, reduced: ReducedModel | None) -> None:
    """Raise ValueError unless the rows are those of the model."""
    if reduced is not None:
        wanted = reduced_columns(reduced)
    else:
        settings = file["settings"]
        points, tips = contents.texts.get("points"), contents.tips
        if points is None or tips is None:
            raise ValueError("the names of points or tips are missing")
        number(settings, "damping", least=0.0)
        whole(settings, "damped_modes")
        rows = contents.columns["contact_force"].shape[0]
        whole(settings, "pairs", most=rows)
        wanted = sampled_columns(len(points), len(tips.names), rows)
    found = {name: tuple(column.shape) for name, column in contents.columns.items()}
    if found != {name: column.shape for name, column in wanted.items()}:
        raise ValueError(f"its rows are {found}, which is not what the model has")
