"""Files of every kind, read back: results that were saved, what runs keep, cases' folders."""

from __future__ import annotations

import os
from typing import Any

from ..checks import flag
from ..checks import path as checked_path
from ..record import journal
from ..record.about import each
from ..record.files import MODEL, WHAT, from_image, opened, sentences
from ..record.layout import records_in

# What runs keep: a history's instants one after the other, the rest as a result in the journal's state.
KEPT = ("history", "branch", "result")


def read(path: Any, *, in_memory: bool = True) -> Any:
    """Read what `save` wrote, what a run keeps, or has left, in its `file`, or the results of a case.

    Parameters
    ----------
    path : str
        Of a case the folder of its run or sweep, or results.h5 or sweep.h5 in it.
    in_memory : bool
        False: the arrays of a history that a run has kept are left on the disk until they are used.

    Returns
    -------
    Record, tuple or dict of them
        Of a case `RunResults`, whose `value("push", "displacement", "A")` is a number or array, or `Sweep`,
        whose `inputs` and `values` are arrays over the rows.

    Raises
    ------
    TypeError, ValueError
        If the file is missing, truncated, damaged, of another kind or another version: one sentence.

    Warns
    -----
    IncompleteHistory, IncompleteBranch
        If the run that wrote it has not come to its end. Of a curve, what its last two seconds found may be
        missing; a run that goes on with it has it.
    """
    from .revive import read_any

    name = checked_path(WHAT, "path", path)
    flag("read", "in_memory", in_memory)
    if journal.is_journal(name):
        return _kept(name, in_memory)
    if os.path.isdir(name):
        return read_any(name)
    with opened(name) as file:
        if "holds" in file.attrs:
            return read_any(name)
        found = records_in(file)
    for part in each(found):
        part._warn_incomplete(name)
    return found


def _kept(path: str, in_memory: bool) -> Any:
    """The result of a journal, as far as it has come."""
    from ..motion.files.history_file import result_of

    with sentences(path):
        journaled = journal.read(os.path.realpath(path))
        kind, head, state = journaled.head.get("kept"), journaled.head, journaled.state
        if kind not in KEPT:
            raise ValueError(f"it is of another kind of run than {', '.join(KEPT)}")
        if kind != "history" and "result" not in state:
            raise ValueError(
                f"{path!r} holds no result: its run has not come to one, or the file beside it, "
                f"{f'{path}.state'!r}, in which it stands, is missing; both belong together"
            )
        beside = {MODEL: from_image(head["model"])} if "model" in head else {}
        found = (
            result_of(journaled, beside, in_memory)
            if kind == "history"
            else from_image(state["result"], beside)
        )
    found._warn_incomplete(path)
    return found
