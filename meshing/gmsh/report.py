"""What reading a user's model tells: warnings, names that look like cracks, the extent."""

from __future__ import annotations

import difflib
import inspect
import re
import warnings

import numpy as np

from meshing.gmsh.model import FileModel
from meshing.warnings import GmshWarning

_KIND = ("point", "curve", "surface")
_IDLE = ("not found in the Brep",)  # of boundaries in a .msh file, which are not used
# Parts that are analysed here are seldom larger; a drawing in mm of anything above 20 mm is.
LARGEST_IN_METRES = 20.0


def warn(origin: str, sentence: str) -> None:
    """A warning that names the file, shown at the line outside this package that asked for it."""
    frame, level = inspect.currentframe(), 1
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] == "meshing":
        frame, level = frame.f_back, level + 1
    warnings.warn(f"{origin}: {sentence}", GmshWarning, stacklevel=level)


def refuse_empty_groups(model: FileModel, origin: str) -> None:
    """ValueError for a physical group that names curves, points or surfaces that do not exist."""
    for dimension, entity, name in model.skipped:
        raise ValueError(
            f"{origin}: physical {_KIND[dimension]} {name!r} names {_KIND[dimension]} {entity}, which does "
            "not exist; a Boolean operation gives new numbers, look them up after it, or take them by place "
            "(Curve In BoundingBox{...})."
        )
    for dimension, name in model.empty:
        raise ValueError(
            f"{origin}: physical {_KIND[dimension]} {name!r} holds no {_KIND[dimension]} of the model; give "
            "it one, or remove it."
        )


def pass_on(model: FileModel, origin: str) -> None:
    """gmsh's own warnings as ours."""
    for line in dict.fromkeys(model.log):
        kind, _, text = line.partition(": ")
        if kind == "Warning" and not any(word in text for word in _IDLE):
            warn(origin, f"gmsh warns: {' '.join(text.split())}")


def check_extent(model: FileModel, origin: str, scale: float | None, used: list[int]) -> None:
    """A warning if the model is so large that it was probably drawn in mm.

    Parameters
    ----------
    scale : float or None
        As the user gave it; None leaves the unit to us.
    used : list of int
        Nodes of the cells.
    """
    if scale is not None or model.unnamed or not used:
        return
    width, height = np.ptp([model.where[node][:2] for node in used], axis=0)
    if max(width, height) > LARGEST_IN_METRES:
        warn(
            origin,
            f"it is {width:g} m wide and {height:g} m high, as its coordinates are taken for metres; pass "
            "scale=1e-3 if it was drawn in millimetres, scale=1.0 if it is that large.",
        )


def right_spelling(name: str) -> str | None:
    """How the name of a crack's curve should be written, if `name` looks like one and is not.

    Parameters
    ----------
    name : str
        Of a physical group.
    """
    if name.startswith("crack:"):
        parts = [part.strip() for part in name.split(":")]
        return None if parts == name.split(":") else ":".join(parts)
    head, mark, rest = name.strip().partition(":")
    head = head.strip().casefold()
    if mark and (head == "crack" or difflib.SequenceMatcher(None, head, "crack").ratio() >= 0.75):
        return "crack:" + ":".join(part.strip() for part in rest.split(":")) if rest.strip() else "crack:NAME"
    whole = re.fullmatch(r"cracks?(?:[\s_.-]*(\w.*))?", name.strip().casefold())
    if whole:
        return f"crack:{whole[1]}" if whole[1] else "crack:1"
    return None
