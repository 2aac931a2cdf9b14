"""gmsh opens, meshes and describes a user's model; runs in the child process only.

The answer of `extract` is a `FileModel`, packed.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from meshing.geometry.planar import find_crossing
from meshing.gmsh.confined import Refusal
from meshing.gmsh.describe import (
    KIND,
    MATERIAL,
    NO_SIZE,
    describe,
    line_ends,
    node_positions,
    physical_groups,
    whole_surfaces,
)
from meshing.gmsh.discretise import mesh_surfaces
from meshing.gmsh.files import CAD, IGES, NASTRAN, SCRIPTS
from meshing.gmsh.script_log import check_whole, refused, step_read
from meshing.gmsh.size_guard import Guard
from meshing.gmsh_session import initialize

_NAMES_TRIED = 1000  # tags beyond the highest group's at which a name may be left of a group that is empty
NUMBERED = (*CAD, *NASTRAN)
_TELLS_FILES = 4  # verbosity from which on gmsh tells what it reads


def load() -> None:
    """Load gmsh's library, while this process may still do so."""
    import gmsh

    initialize(gmsh)


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
    with _errors_refused(script):
        gmsh.merge(file)
        if script:
            check_whole(gmsh.logger.get())
            _refuse_programs(gmsh, trusted)
            geometry = not gmsh.model.mesh.getElements(2)[1]  # it may name groups of a mesh that it merges
        if suffix in CAD and len(gmsh.model.getEntities(2)) > 1:
            # These formats keep every part by itself; parts that touch are one body.
            gmsh.model.occ.removeAllDuplicates()
            gmsh.model.occ.synchronize()
        solids = len(gmsh.model.getEntities(3))
        if solids:
            raise Refusal(_of_volumes(gmsh, solids))
        groups = _numbered_entities(gmsh, suffix) if suffix in NUMBERED else physical_groups(gmsh)
        if geometry:
            _mesh(gmsh, whole_surfaces(groups), size, guard)
    found = describe(gmsh, groups, order, geometry)
    guard.check_cells(found)
    empty = [] if suffix in NUMBERED else _empty_groups(gmsh)
    return replace(found, unnamed=suffix in CAD, empty=empty, **_said(gmsh, script)).packed()


@contextlib.contextmanager
def _errors_refused(script: bool) -> Iterator[None]:
    """gmsh's errors as refusals."""
    try:
        yield
    except (Refusal, MemoryError, UnicodeDecodeError):
        raise
    except Exception as error:  # gmsh raises nothing more precise
        said = " ".join(str(error).split()).rstrip(".")
        if not said or "bad_alloc" in said:
            raise Refusal(
                "gmsh stopped without a reason, as it does when its memory runs out; give larger cell sizes "
                "or a larger memory_limit."
            ) from error
        raise refused(said, script) from error


def _said(gmsh, script: bool) -> dict[str, Any]:
    """What gmsh's log and options tell."""
    log = gmsh.logger.get()
    warnings = [line for line in log if line.startswith("Warning")]
    verbosity = gmsh.option.getNumber("General.Verbosity")
    if verbosity < _TELLS_FILES:
        warnings.append(f"Warning: General.Verbosity = {verbosity:g} hides errors and what a script reads")
    in_metres = script and gmsh.option.getString("Geometry.OCCTargetUnit") == "M"
    return {
        "log": warnings,
        "skipped": _skipped_entities(gmsh, warnings),
        "merged_step": step_read(log) if in_metres else None,
    }


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


def _mesh(gmsh, whole: list[int], size: float | None, guard: Guard) -> None:
    if size is not None:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeMin", min(size, gmsh.option.getNumber("Mesh.MeshSizeMin")))
    filled = [tag for _, tag in gmsh.model.getEntities(2) if tag not in set(whole)]
    area = sum(abs(_swept(_outline(gmsh, tag))) for tag in filled)
    largest = gmsh.option.getNumber("Mesh.MeshSizeMax")
    guard.check_area(area, size, largest if largest < NO_SIZE else None)
    for _, tag in gmsh.model.getEntities(1):
        guard.check_curve(tag, _length(gmsh, tag), _point_sizes(gmsh, tag), largest)
    gmsh.model.mesh.generate(1)
    guard.check_lines(sum(len(tags) for tags in gmsh.model.mesh.getElements(1)[1]))
    _refuse_crossing_outlines(gmsh, filled)
    mesh_surfaces(gmsh, filled)


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
    return [s for s in gmsh.model.mesh.getSizes(points) if 0 < s < NO_SIZE] if points else []


def _outline(gmsh, surface: int) -> list[np.ndarray]:
    """Points along the curves around a surface, in the sense of going round."""
    curves = gmsh.model.getBoundary([(2, surface)], combined=False, oriented=True)
    return [_samples(gmsh, abs(tag))[:: 1 if tag > 0 else -1] for _, tag in curves]


def _swept(outline: list[np.ndarray]) -> float:
    """Area within an outline; holes go round the other way."""
    return sum(
        0.5 * float((p[:-1, 0] * p[1:, 1] - p[1:, 0] * p[:-1, 1]).sum()) for p in outline if len(p) > 1
    )


def _refuse_crossing_outlines(gmsh, surfaces: list[int]) -> None:
    """Surfaces whose outline and embedded curves cross each other, on which gmsh may work for ever; needs the
    mesh of the curves.
    """
    where = node_positions(gmsh)
    for surface in surfaces:
        curves = gmsh.model.getBoundary([(2, surface)], oriented=False)
        curves += gmsh.model.mesh.getEmbedded(2, surface)
        tags = np.vstack([line_ends(gmsh, tag) for dimension, tag in curves if dimension == 1])
        if not len(tags):
            continue
        segments = where[tags]
        if np.ptp(segments[..., 2]) > 1e-9 * np.ptp(segments.reshape(-1, 3), axis=0).max():
            continue  # not plane: refused with its cells
        crossing = find_crossing(segments[..., :2], tags)
        if crossing is not None:
            raise Refusal(
                f"the curves of surface {surface} cross each other near ({crossing[0]:.6g}, "
                f"{crossing[1]:.6g}) (in the file's unit); mend the geometry."
            )


def _numbered_entities(gmsh, suffix: str) -> list[list]:
    """Groups of a format that has none: curves and points have numbers, and all surfaces are one material;
    numbers of Nastran are those of its properties, of which each is a material.
    """
    entities = [[tag for _, tag in gmsh.model.getEntities(dimension)] for dimension in (0, 1, 2)]
    groups = [[d, f"{KIND[d]}{tag}", [tag]] for d in (0, 1) for tag in entities[d]]
    if suffix in NASTRAN and len(entities[2]) > 1:
        return groups + [[2, f"{MATERIAL}{tag}", [tag]] for tag in entities[2]]
    return groups + ([[2, MATERIAL, entities[2]]] if entities[2] else [])


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
            dimension, tag = KIND.index(found[1]), int(found[3])
            name = gmsh.model.getPhysicalName(dimension, tag) or f"{found[1]}{tag}"
            skipped.append([dimension, int(found[2]), name])
    return skipped
