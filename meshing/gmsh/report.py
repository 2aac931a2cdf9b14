"""What reading a user's model tells: warnings, names that look like cracks, the extent."""

from __future__ import annotations

import difflib
import re
import warnings

import numpy as np

from meshing.gmsh.model import FileModel

_KIND = ("point", "curve", "surface")
# Parts that are analysed here are seldom larger; a drawing in mm of anything above 20 mm is.
LARGEST_IN_METRES = 20.0


class GmshWarning(UserWarning):
    """Something in a user's model that is read, but may not be what the user meant."""


def warn(origin: str, sentence: str) -> None:
    """A warning that names the file, shown at the line that called `read_gmsh`."""
    warnings.warn(f"{origin}: {sentence}", GmshWarning, stacklevel=4)


def refuse_empty_groups(model: FileModel, origin: str) -> None:
    """ValueError for a physical group that names curves, points or surfaces that do not exist."""
    skipped = [re.search(r"Skipping unknown (\w+) (\d+) in physical (\w+) (\d+)", line) for line in model.log]
    for found in filter(None, skipped):
        kind, entity, of, tag = found.groups()
        name = next((name for d, t, name in model.empty if _KIND[d] == of and t == int(tag)), None)
        which = f"{name!r}" if name else f"number {tag}"
        raise ValueError(
            f"{origin}: physical {of} {which} names {kind} {entity}, which does not exist; a Boolean "
            "operation gives new numbers, look them up after it, or take them by place (Curve In "
            "BoundingBox{...})."
        )
    for dimension, _, name in model.empty:
        raise ValueError(
            f"{origin}: physical {_KIND[dimension]} {name!r} holds no {_KIND[dimension]} of the model; give "
            "it one, or remove it."
        )


def pass_on(model: FileModel, origin: str) -> None:
    """gmsh's own warnings as ours."""
    for line in dict.fromkeys(model.log):
        kind, _, text = line.partition(": ")
        if kind == "Warning":
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
        return None
    head, mark, rest = name.strip().partition(":")
    head = head.strip().casefold()
    if mark and (head == "crack" or difflib.SequenceMatcher(None, head, "crack").ratio() >= 0.75):
        return "crack:" + ":".join(part.strip() for part in rest.split(":")) if rest.strip() else "crack:NAME"
    whole = re.fullmatch(r"cracks?(?:[\s_.-]*(\w.*))?", name.strip().casefold())
    if whole:
        return f"crack:{whole[1]}" if whole[1] else "crack:1"
    return None
