"""gmsh opens, meshes and describes a user's model; runs in the child process only.

The answer of `extract` is what `meshing.gmsh.model` reads: facts in a dictionary, numbers in arrays.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from meshing.cells.planar import find_crossing, find_meeting
from meshing.gll import gll_nodes
from meshing.gmsh.confined import Refusal
from meshing.gmsh.files import CAD, IGES, SCRIPTS
from meshing.gmsh.script_log import check_whole, refused, step_read
from meshing.gmsh.size_guard import Guard

_KIND = ("point", "curve", "surface", "volume")
_NAMES_TRIED = 1000  # tags beyond the highest group's at which a name may be left of a group that is empty
_WIDEST = 1e21  # gmsh's "no size given" is 1e22


def load() -> None:
    """Load gmsh's library, while this process may still do so."""
    import gmsh

    # Without interruptible=False gmsh takes SIGINT for good; with configuration files the result would depend
    # on the user's home.
    gmsh.initialize([], readConfigFiles=False, interruptible=False)


def extract(
    *, file: str, order: int, size: float | None, most_unknowns: int, trusted: bool = False
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Open a file and describe what it holds.

    Parameters
    ----------
    file : str
        In this process's folder.
    order : int
        Order of the S-elements' edges.
    size : float, optional
        Largest cell size when a geometry is meshed, in the file's unit of length.
    most_unknowns : int
    trusted : bool
        It may start programs.

    Raises
    ------
    Refusal
        gmsh cannot read or mesh it, or the mesh would be too large.
    """
    import gmsh

    suffix = file[file.rindex(".") :].lower()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    if suffix not in IGES:  # gmsh cannot set OpenCASCADE's unit before a first step file: these stay in mm
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")  # of a step file that a .geo file merges, too
    gmsh.logger.start()
    script = suffix in SCRIPTS
    geometry = script or suffix in CAD
    guard = Guard(order, most_unknowns)
    try:
        gmsh.merge(file)
        if script:
            check_whole(gmsh.logger.get())
            _refuse_programs(gmsh, trusted)
        if suffix in CAD and len(gmsh.model.getEntities(2)) > 1:
            # These formats keep every part by itself; parts that touch are one body.
            gmsh.model.occ.removeAllDuplicates()
            gmsh.model.occ.synchronize()
        solids = len(gmsh.model.getEntities(3))
        if solids:
            raise Refusal(_of_volumes(gmsh, solids))
        if geometry:
            _mesh(gmsh, size, guard)
    except (Refusal, MemoryError):
        raise
    except Exception as error:  # gmsh raises nothing more precise
        said = " ".join(str(error).split()).rstrip(".")
        if not said or "bad_alloc" in said:
            raise Refusal(
                "gmsh stopped without a reason, as it does when its memory runs out; give larger cell sizes "
                "or a larger memory_limit."
            ) from error
        raise refused(said, script) from error
    told: dict[str, Any] = {
        "geometry": geometry,
        "unnamed": suffix in CAD,
        "groups": _groups(gmsh, suffix in CAD),
        "empty": [] if suffix in CAD else _empty_groups(gmsh),
        "log": [line for line in gmsh.logger.get() if line.startswith("Warning")],
    }
    own_unit = gmsh.option.getString("Geometry.OCCTargetUnit") != "M"
    told["merged_step"] = step_read(gmsh.logger.get()) if script and not own_unit else None
    told["skipped"] = _skipped_entities(gmsh, told["log"])
    arrays: dict[str, np.ndarray] = {}
    _describe_mesh(gmsh, told, arrays, guard)
    if geometry:
        _true_curves(gmsh, order, told, arrays)
    return told, arrays


def _refuse_programs(gmsh, trusted: bool) -> None:
    """Sizes that another program would give, which gmsh leaves out where it cannot start it."""
    for tag in () if trusted else gmsh.model.mesh.field.list():
        if gmsh.model.mesh.field.getType(tag) == "ExternalProcess":
            raise refused("system call", script=True)


def _of_volumes(gmsh, solids: int) -> str:
    cells = sum(
        len(tags) for _, tag in gmsh.model.getEntities(3) for tags in gmsh.model.mesh.getElements(3, tag)[1]
    )
    what = f"a volume mesh of {cells} cells" if cells else f"{solids} volume{'s' if solids > 1 else ''}"
    return (
        f"it holds {what}, a plane model was expected; draw the section as surfaces in the plane z = 0 and "
        "give those physical groups."
    )


def _mesh(gmsh, size: float | None, guard: Guard) -> None:
    if size is not None:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeMin", min(size, gmsh.option.getNumber("Mesh.MeshSizeMin")))
    outlines = {tag: _outline(gmsh, tag) for _, tag in gmsh.model.getEntities(2)}
    area = sum(abs(_swept(outline)) for outline in outlines.values())
    largest = gmsh.option.getNumber("Mesh.MeshSizeMax")
    guard.check_area(area, size, largest if largest < _WIDEST else None)
    for _, tag in gmsh.model.getEntities(1):
        guard.check_curve(tag, _length(gmsh, tag), _point_sizes(gmsh, tag), largest)
    gmsh.model.mesh.generate(1)
    guard.check_lines(sum(len(tags) for tags in gmsh.model.mesh.getElements(1)[1]))
    _refuse_crossing_outlines(gmsh)
    gmsh.model.mesh.generate(2)


def _samples(gmsh, curve: int) -> np.ndarray:
    """Points along a curve, (n, 3)."""
    if gmsh.model.getType(1, curve) == "Discrete curve":
        return np.zeros((0, 3))
    low, high = (float(bound[0]) for bound in gmsh.model.getParametrizationBounds(1, curve))
    return np.array(gmsh.model.getValue(1, curve, np.linspace(low, high, 65))).reshape(-1, 3)


def _length(gmsh, curve: int) -> float:
    return float(np.linalg.norm(np.diff(_samples(gmsh, curve), axis=0), axis=1).sum())


def _point_sizes(gmsh, curve: int) -> list[float]:
    points = gmsh.model.getBoundary([(1, curve)], combined=False, oriented=False)
    return [s for s in gmsh.model.mesh.getSizes(points) if 0 < s < _WIDEST] if points else []


def _outline(gmsh, surface: int) -> list[np.ndarray]:
    """Points along the curves around a surface, in the sense of going round."""
    curves = gmsh.model.getBoundary([(2, surface)], combined=False, oriented=True)
    return [_samples(gmsh, abs(tag))[:: 1 if tag > 0 else -1] for _, tag in curves]


def _swept(outline: list[np.ndarray]) -> float:
    """Area within an outline; holes go round the other way."""
    return sum(
        0.5 * float((p[:-1, 0] * p[1:, 1] - p[1:, 0] * p[:-1, 1]).sum()) for p in outline if len(p) > 1
    )


def _refuse_crossing_outlines(gmsh) -> None:
    """Surfaces whose outline and embedded curves cross each other, on which gmsh may work for ever; needs the
    mesh of the curves.
    """
    where = _node_positions(gmsh)
    for _, surface in gmsh.model.getEntities(2):
        ends: list[np.ndarray] = []
        embedded = [
            (dimension, tag) for dimension, tag in gmsh.model.mesh.getEmbedded(2, surface) if dimension == 1
        ]
        for _, curve in gmsh.model.getBoundary([(2, surface)], oriented=False) + embedded:
            for kind, _, nodes in zip(*gmsh.model.mesh.getElements(1, curve)):
                count = gmsh.model.mesh.getElementProperties(kind)[3]
                ends.append(np.asarray(nodes, np.int64).reshape(-1, count)[:, :2])
        if not ends:
            continue
        tags = np.vstack(ends)
        segments = where[tags]
        if np.ptp(segments[..., 2]) > 1e-9 * np.ptp(segments.reshape(-1, 3), axis=0).max():
            continue  # not plane: refused with its cells
        crossing = find_crossing(segments[..., :2])
        if crossing is None:
            crossing = find_meeting(segments[..., :2], tags)
        if crossing is not None:
            raise Refusal(
                f"the curves of surface {surface} cross each other near ({crossing[0]:.6g}, "
                f"{crossing[1]:.6g}) (in the file's unit); mend the geometry."
            )


def _node_positions(gmsh) -> np.ndarray:
    """Positions by node tag, (highest tag + 1, 3)."""
    tags, positions, _ = gmsh.model.mesh.getNodes()
    where = np.full((int(max(tags, default=0)) + 1, 3), math.nan)
    where[np.asarray(tags, np.int64)] = np.reshape(positions, (-1, 3))
    return where


def _groups(gmsh, unnamed: bool) -> list[list]:
    """[dimension, name, entities] of each physical group; a group without a name is called by its tag."""
    groups = []
    for dimension in (0, 1, 2):
        if unnamed:
            tags = [tag for _, tag in gmsh.model.getEntities(dimension)]
            if dimension == 2:
                groups += [[2, "material", tags]] if tags else []
            else:
                groups += [[dimension, f"{_KIND[dimension]}{tag}", [tag]] for tag in tags]
            continue
        for _, tag in gmsh.model.getPhysicalGroups(dimension):
            name = gmsh.model.getPhysicalName(dimension, tag) or f"{_KIND[dimension]}{tag}"
            entities = [abs(int(e)) for e in gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)]
            groups.append([dimension, name, sorted(set(entities))])
    return groups


def _empty_groups(gmsh) -> list[list]:
    """[dimension, name] of groups whose entities do not exist: gmsh forgets them but for their names."""
    known = {(d, t) for d, t in gmsh.model.getPhysicalGroups()}
    highest = max((t for _, t in known), default=0) + _NAMES_TRIED
    names = ((d, t, gmsh.model.getPhysicalName(d, t)) for d in (0, 1, 2) for t in range(1, highest))
    return [[d, name] for d, t, name in names if name and (d, t) not in known]


def _skipped_entities(gmsh, log: list[str]) -> list[list]:
    """[dimension, entity, name] of entities that a group names and that do not exist."""
    skipped = []
    for line in log:
        found = re.search(r"Skipping unknown (point|curve|surface) (\d+) in physical \w+ (\d+)", line)
        if found:
            dimension, tag = _KIND.index(found[1]), int(found[3])
            name = gmsh.model.getPhysicalName(dimension, tag) or f"{found[1]}{tag}"
            skipped.append([dimension, int(found[2]), name])
    return skipped


def _describe_mesh(gmsh, told: dict[str, Any], arrays: dict[str, np.ndarray], guard: Guard) -> None:
    tags, positions, _ = gmsh.model.mesh.getNodes()
    arrays["node_tags"] = np.asarray(tags, np.int64)
    arrays["node_positions"] = np.reshape(positions, (-1, 3))
    told["blocks"] = []
    cells = {3: 0, 4: 0}
    for dimension in (1, 2):
        for _, entity in gmsh.model.getEntities(dimension):
            for kind, _, nodes in zip(*gmsh.model.mesh.getElements(dimension, entity)):
                name, _, order, count, _, corners = gmsh.model.mesh.getElementProperties(kind)
                if dimension == 2 and corners in cells:
                    cells[corners] += len(nodes) // count
                arrays[f"block{len(told['blocks'])}"] = np.asarray(nodes, np.int64).reshape(-1, count)
                told["blocks"].append([dimension, entity, name, order, corners])
    guard.check_cells(cells[3], cells[4])
    told["surfaces"] = [tag for _, tag in gmsh.model.getEntities(2)]
    told["points"] = {
        str(tag): [int(node) for node in gmsh.model.mesh.getNodes(0, tag)[0]]
        for _, tag in gmsh.model.getEntities(0)
    }


def _true_curves(gmsh, order: int, told: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """GLL nodes of the line elements on curved geometry by its parametrisation."""
    at = 0.5 * (gll_nodes(order) + 1.0)
    ends_of, points_of = [np.zeros((0, 2), np.int64)], [np.zeros((0, order + 1, 2))]
    for _, curve in gmsh.model.getEntities(1):
        if gmsh.model.getType(1, curve) in ("Line", "Discrete curve"):
            continue
        low, high = (float(bound[0]) for bound in gmsh.model.getParametrizationBounds(1, curve))
        tags, _, parameters = gmsh.model.mesh.getNodes(
            1, curve, includeBoundary=True, returnParametricCoord=True
        )
        parameter_of: dict[int, list[float]] = {}
        for tag, parameter in zip(tags, parameters):
            parameter_of.setdefault(int(tag), []).append(float(parameter))
        # Not combined: gmsh would leave out the point at which a closed curve starts and ends.
        bounds = gmsh.model.getBoundary([(1, curve)], combined=False, oriented=False)
        seam = {int(tag) for _, point in bounds for tag in gmsh.model.mesh.getNodes(0, point)[0]}
        if len(seam) < 2:  # a closed curve: its seam has two parameters
            for tag in seam:
                parameter_of[tag] = [low, high]
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(1, curve)):
            count = gmsh.model.mesh.getElementProperties(kind)[3]
            ends = np.asarray(nodes, np.int64).reshape(-1, count)[:, :2]
            spans = [
                min(
                    ((a, b) for a in parameter_of[int(first)] for b in parameter_of[int(last)]),
                    key=lambda pair: abs(pair[1] - pair[0]),
                )
                for first, last in ends
            ]
            where = np.array([start + at * (stop - start) for start, stop in spans])
            values = np.array(gmsh.model.getValue(1, curve, where.ravel()))
            ends_of.append(ends)
            points_of.append(values.reshape(len(ends), order + 1, 3)[..., :2])
    arrays["curved_ends"], arrays["curved_points"] = np.vstack(ends_of), np.concatenate(points_of)
