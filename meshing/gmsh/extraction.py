"""gmsh opens, meshes and describes a user's model; what its log tells: what a script has read, and what it
was kept from; runs in the child process only.

The answer of `extract` is a `FileModel`, packed.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from meshing.geometry.planar import find_crossing
from meshing.gmsh import describe
from meshing.gmsh.confined import Refusal
from meshing.gmsh.discretise import mesh_surfaces
from meshing.gmsh.files import CAD, IGES, NASTRAN, SCRIPTS, STEP
from meshing.gmsh.size_guard import Guard
from meshing.gmsh_session import initialize
from meshing.vectors import cross

_NAMES_TRIED = 1000  # tags beyond the highest group's at which a name may be left of a group that is empty
_TELLS_FILES = 4  # verbosity from which on gmsh tells what it reads
_READING = re.compile(r"Info: Reading '(.*)'\.\.\.")
_NAMED = re.compile(r"(?:Unable to open file|Could not open file|Could not read file|File) '(.*)'")
_SHAPES = re.compile(rb"""ShapeFromFile\s*\(\s*["']([^"']*)["']""")  # not in the log
_TRUST = (
    "or pass trust=True to read_gmsh if you know the script, which may then start programs and read and "
    "write files as you may"
)
# A last line that holds one statement at most.
_ONE_STATEMENT = re.compile(rb"\s*(?!(?:If|ElseIf|For|Macro|Function)\b)[^;]*;?\s*(?://.*)?", re.DOTALL)
_BEFORE_ANOTHER = re.compile(rb"\s*(?:Else|EndIf|EndFor|Return)\s+[^\s/]")
_TAIL = 65536  # bytes, in which a last line is looked for


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
            _check_whole(gmsh.logger.get())
            _refuse_programs(gmsh, trusted)
            geometry = not gmsh.model.mesh.getElements(2)[1]  # it may name groups of a mesh that it merges
        if suffix in CAD and len(gmsh.model.getEntities(2)) > 1:
            # These formats keep every part by itself; parts that touch are one body.
            gmsh.model.occ.removeAllDuplicates()
            gmsh.model.occ.synchronize()
        solids = len(gmsh.model.getEntities(3))
        if solids:
            raise Refusal(_of_volumes(gmsh, solids))
        numbered = suffix in (*CAD, *NASTRAN)
        groups = _numbered_entities(gmsh, suffix) if numbered else describe.physical_groups(gmsh)
        if geometry:
            _mesh(gmsh, describe.whole_surfaces(groups), size, guard)
    found = describe.described(gmsh, groups, order, geometry)
    guard.check_cells(found)
    empty = [] if numbered else _empty_groups(gmsh)
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
        raise _refused(said, script) from error


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
        "merged_step": _step_read(log) if in_metres else None,
    }


def _refuse_programs(gmsh, trusted: bool) -> None:
    """Sizes that another program would give, which gmsh leaves out where it cannot start it."""
    for tag in () if trusted else gmsh.model.mesh.field.list():
        if gmsh.model.mesh.field.getType(tag) == "ExternalProcess":
            raise _refused("system call", script=True)


def _of_volumes(gmsh, solids: int) -> str:
    cells = sum(map(len, gmsh.model.mesh.getElements(3)[1]))
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
    area = sum(_area(gmsh, tag) for tag in filled)
    largest = gmsh.option.getNumber("Mesh.MeshSizeMax")
    guard.check_area(area, size, largest if largest < describe.NO_SIZE else None)
    for _, tag in gmsh.model.getEntities(1):
        length = float(np.linalg.norm(np.diff(_samples(gmsh, tag), axis=0), axis=1).sum())
        guard.check_curve(tag, length, _point_sizes(gmsh, tag), largest)
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


def _point_sizes(gmsh, curve: int) -> list[float]:
    points = gmsh.model.getBoundary([(1, curve)], combined=False, oriented=False)
    return [s for s in gmsh.model.mesh.getSizes(points) if 0 < s < describe.NO_SIZE] if points else []


def _area(gmsh, surface: int) -> float:
    """Area within the curves around a surface; holes go round the other way."""
    curves = describe.signed_curves(gmsh, surface)
    outline = [_samples(gmsh, abs(tag))[:: 1 if tag > 0 else -1] for tag in curves]
    return 0.5 * abs(sum(float(cross(points[:-1], points[1:]).sum()) for points in outline))


def _refuse_crossing_outlines(gmsh, surfaces: list[int]) -> None:
    """Surfaces whose outline and embedded curves cross each other, on which gmsh may work for ever, or have
    closed lines of one or two edges, holes that gmsh fills; needs the mesh of the curves.
    """
    where = describe.node_positions(gmsh)
    for surface in surfaces:
        curves = gmsh.model.getBoundary([(2, surface)], oriented=False)
        curves += gmsh.model.mesh.getEmbedded(2, surface)
        own = {
            tag for dimension, tag in curves if dimension == 1
        }  # some are embedded twice, or in the outline
        tags = np.vstack([describe.line_ends(gmsh, tag) for tag in sorted(own)])
        if not len(tags):
            continue
        segments = where[tags]
        if np.ptp(segments[..., 2]) > 1e-9 * np.ptp(segments.reshape(-1, 3), axis=0).max():
            continue  # not plane: refused with its cells
        pairs, first, times = np.unique(np.sort(tags, axis=1), axis=0, return_index=True, return_counts=True)
        for x, y, _ in segments[first[(times > 1) | (pairs[:, 0] == pairs[:, 1])]].mean(axis=1):
            raise Refusal(
                f"on the curves of surface {surface} one or two edges make a closed line near ({x:.6g}, "
                f"{y:.6g}) (in the file's unit), and gmsh fills what is inside; give smaller sizes there, or "
                "more nodes where Transfinite Curve says how many."
            )
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
    groups = [[d, f"{describe.KIND[d]}{tag}", [tag]] for d in (0, 1) for tag in entities[d]]
    if suffix in NASTRAN and len(entities[2]) > 1:
        return groups + [[2, f"{describe.MATERIAL}{tag}", [tag]] for tag in entities[2]]
    return groups + ([[2, describe.MATERIAL, entities[2]]] if entities[2] else [])


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
            dimension, tag = describe.KIND.index(found[1]), int(found[3])
            name = gmsh.model.getPhysicalName(dimension, tag) or f"{found[1]}{tag}"
            skipped.append([dimension, int(found[2]), name])
    return skipped


def _check_whole(log: list[str]) -> None:
    """Refuse what gmsh leaves out without a word.

    Raises
    ------
    Refusal
        Errors after which a script has gone on (General.AbortOnError); statements that follow others in a
        last line without its end; shapes from a file that gmsh cannot read.
    """
    for line in log:
        if line.startswith("Error: "):
            raise _refused(line.removeprefix("Error: "), script=True)
    for name in _files_read(log):
        with open(name, "rb") as stream:
            stream.seek(max(stream.seek(0, os.SEEK_END) - _TAIL, 0))
            last = stream.read().rpartition(b"\n")[2]
        if not _ONE_STATEMENT.fullmatch(last) or _BEFORE_ANOTHER.match(last):
            raise Refusal(
                f"the last line of {name!r} holds several statements and no line break at its end, and gmsh "
                "reads the first of them only; add a line break at the end of the file."
            )
    for name in _shapes_read(log):
        try:
            open(name, "rb").close()
        except OSError:
            raise _not_opened(name) from None


def _step_read(log: list[str]) -> str | None:
    """A STEP file that a script merges or takes shapes from; None without one."""
    names = (*_files_read(log), *_shapes_read(log))
    return next((name for name in names if name.lower().endswith(STEP)), None)


def _refused(said: str, script: bool) -> Refusal:
    """What gmsh says that it could not do, as a refusal.

    Parameters
    ----------
    said : str
        gmsh's error.
    script : bool
        A script is read, which may have been kept from something.
    """
    if script and ("system call" in said or "socket" in said):
        return Refusal(f"it starts a program, which a script may not; remove the statement, {_TRUST}.")
    named = _NAMED.search(said)
    if script and named:
        return _not_opened(named[1])
    return Refusal(f"gmsh cannot read or mesh it ({said}); mend the file there.")


def _not_opened(place: str) -> Refusal:
    folder = os.path.realpath(os.curdir)
    where = "" if os.path.exists(place) else ", which is not there"
    if os.path.commonpath([os.path.realpath(place), folder]) != folder:
        where = ", which is outside the model's folder"
    return Refusal(
        f"it opens {place!r}{where}, and a script may only read files in its folder and below; put the file "
        f"there, remove the statement (read_gmsh meshes by itself and writes nothing), {_TRUST}."
    )


def _files_read(log: list[str]) -> list[str]:
    """The files that gmsh has read or tried to read, the script first, as it names them."""
    return [found[1] for found in map(_READING.fullmatch, log) if found]


def _shapes_read(log: list[str]) -> Iterator[str]:
    """Files from which scripts take shapes, where their names are written out."""
    for name in _files_read(log):
        if name.lower().endswith(SCRIPTS):
            with open(name, "rb") as stream:
                for found in _SHAPES.finditer(stream.read()):
                    yield os.path.join(os.path.dirname(name), os.fsdecode(found[1]))
