"""What reading a user's model tells: warnings, names that look like cracks, the extent."""

from __future__ import annotations

import difflib
import re

import numpy as np

from meshing.extent import check_extent
from meshing.gmsh.length_units import Units
from meshing.gmsh.model import FileModel
from meshing.warnings import UnitWarning, warn

_KIND = ("point", "curve", "surface")
_IDLE = ("not found in the Brep",)  # of boundaries in a .msh file, which are not used


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


def check_units(units: Units, merged_step: str | None, origin: str, where: np.ndarray) -> None:
    """Warnings of a scale that contradicts the file, and of a model so large or small that its unit is
    probably another one.

    Parameters
    ----------
    merged_step : str or None
        A STEP file that a script reads, whose lengths gmsh converts to m.
    where : (n, 2) array
        Vertices of the cells, m.
    """
    scale = units.scale
    if scale is not None and units.file is not None and abs(scale / units.file - 1.0) > 1e-9:
        warn(
            origin,
            f"its unit is {units.file:g} m, as the file says, and scale={scale:g} makes the body "
            f"{scale / units.file:g} times as large; leave scale out, unless the file is wrong.",
            UnitWarning,
        )
    if scale not in (None, 1.0) and merged_step is not None:
        warn(
            origin,
            f"lengths in {merged_step!r}, which it merges, are converted to m, and scale={scale:g} makes "
            'them wrong; leave scale out and draw the rest in m, or set Geometry.OCCTargetUnit = "MM"; '
            "ahead of the Merge to have it all in mm.",
            UnitWarning,
        )
    width, height = np.ptp(where, axis=0)
    taken = "its coordinates are taken for metres" if units.file is None else "the file's unit says so"
    drawn = "scale=1e-3 if it was drawn in millimetres"
    check_extent(
        origin,
        width,
        height,
        if_large=None if scale is not None else f"{taken}: pass {drawn}, scale=1.0 if it is that large",
        if_small=f"{taken}: pass the length of its unit in m as scale if that is another one"
        if scale is None
        else f"scale={scale:g} is the length of the file's unit in m: leave it out if the unit is the metre",
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
