"""What reading a user's model tells: warnings, names that look like cracks, the extent, surfaces that were
drawn over each other, or beside each other without being joined.
"""

from __future__ import annotations

import difflib
import re

import numpy as np
import shapely

from meshing.cells.complex import CellComplex, edge_key
from meshing.gmsh.describe import KIND
from meshing.gmsh.length_units import Units
from meshing.gmsh.model import FileModel
from meshing.warnings import UnitWarning, check_extent, warn

_IDLE = ("not found in the Brep",)  # of boundaries in a .msh file, which are not used


def refuse_empty_groups(model: FileModel, origin: str) -> None:
    """ValueError for a physical group that names curves, points or surfaces that do not exist."""
    for dimension, entity, name in model.skipped:
        raise ValueError(
            f"{origin}: physical {KIND[dimension]} {name!r} names {KIND[dimension]} {entity}, which does "
            "not exist; a Boolean operation gives new numbers, look them up after it, or take them by place "
            "(Curve In BoundingBox{...})."
        )
    for dimension, name in model.empty:
        raise ValueError(
            f"{origin}: physical {KIND[dimension]} {name!r} holds no {KIND[dimension]} of the model; give "
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
    if scale is None:
        if_large: str | None = f"{taken}: pass {drawn}, scale=1.0 if it is that large"
        if_small = f"{taken}: pass the length of its unit in m as scale if that is another one"
    else:
        if_large, unit = None, f"scale={scale:g} is the length of the file's unit in m"
        if_small = f"{unit}: leave it out if the unit is the metre"
    check_extent(origin, width, height, if_large=if_large, if_small=if_small)


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


_PLACES = np.array([0.25, 0.5, 0.75])  # of an edge, where it is looked for another one
_FINE = np.linspace(0.0, 1.0, 65)
_SAME = 1e-7  # distance of edges that coincide, relative to the model's extent
_SAG = 5e-5  # of the chords between _FINE from a curved edge, relative to its length
_WITHIN = 1e-3  # depth inside a cell that is no round-off, relative to the cell's extent


def check_joined(cells: CellComplex, origin: str) -> None:
    """Refuse surfaces that overlap; warn of outlines that lie on one another and are not joined.

    Parameters
    ----------
    cells : CellComplex
        Before its cracks are made: what lies on one of these is meant.
    origin : str
        For messages.

    Raises
    ------
    ValueError
        A piece of outline lies inside a cell.
    """
    faces = {edge_key(edge) for edges in cells.groups.values() for edge in edges}
    outline = [edge for edge, count in cells.edge_uses().items() if count == 1 and edge not in faces]
    if not outline:
        return
    lines = shapely.linestrings(
        np.concatenate([cells.along(edge, _FINE) for edge in outline]),
        indices=np.repeat(np.arange(len(outline)), len(_FINE)),
    )
    places = shapely.points(np.concatenate([cells.along(edge, _PLACES) for edge in outline]))
    _refuse_overlaps(cells, places, origin)
    extent = float(np.ptp(np.array(cells.vertices), axis=0).max())
    count = len(_PLACES)
    curved = np.array([edge in cells.curves for edge in outline])
    near = np.repeat(np.maximum(_SAME * extent, _SAG * curved * shapely.length(lines)), count)
    place, other = shapely.STRtree(lines).query(places, predicate="dwithin", distance=near)
    beside = np.zeros(len(places), dtype=bool)
    beside[place[place // count != other]] = True
    doubled = beside.reshape(-1, count).all(axis=1)
    if doubled.any():
        x, y = shapely.get_coordinates(places[np.flatnonzero(doubled)[0] * count + 1])[0]
        warn(
            origin,
            f"outlines lie on one another near ({x:.6g}, {y:.6g}) m and are not joined: nothing holds "
            "them together or keeps them from overlapping; join them (BooleanFragments, Coherence), or name "
            "the two sides crack:NAME:right and crack:NAME:left if they are in contact.",
        )


def warn_of_points_on_cracks(cells: CellComplex, origin: str) -> None:
    """Warn of named points that are one of the two that their place is of since its crack was made.

    Parameters
    ----------
    cells : CellComplex
        With its cracks.
    origin : str
        For messages.
    """
    for crack in cells.cracks:
        own = {f"{crack.name}_right", f"{crack.name}_left"}
        for path in crack.paths:
            right, left = ({vertex for edge in face for vertex in edge} for face in path.faces)
            for name, vertex in cells.points.items():
                if path.embedded and vertex in left - right and name not in own:
                    x, y = cells.vertices[vertex]
                    warn(
                        origin,
                        f"point {name!r} at ({x:.6g}, {y:.6g}) m lies on crack {crack.name!r} and is on its "
                        f"left face there, {crack.name}_left, alone; put it into the material, or take the "
                        f"corners {crack.name}_right and {crack.name}_left at a mouth.",
                    )


def _refuse_overlaps(cells: CellComplex, places: np.ndarray, origin: str) -> None:
    corners = [np.array([cells.vertices[vertex] for vertex in cell.vertices]) for cell in cells.cells]
    boxes = shapely.box(*np.array([[*c.min(axis=0), *c.max(axis=0)] for c in corners]).T)
    tree = shapely.STRtree(boxes)
    for number, place in zip(*tree.query(places)[::-1]):
        loop = [cells.along(edge, _FINE[:-1]) for edge in cells.cells[number].edges()]
        polygon = shapely.Polygon(np.concatenate(loop))
        point = places[place]
        depth = _WITHIN * float(np.ptp(corners[number], axis=0).max())
        if polygon.contains(point) and polygon.exterior.distance(point) > depth:
            raise ValueError(
                f"{origin}: surfaces overlap near ({point.x:.6g}, {point.y:.6g}) m, where area would "
                "count twice; cut one from the other (BooleanDifference) or join them (Coherence)."
            )
