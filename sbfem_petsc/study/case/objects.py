"""Tables of a case to the objects of the Python interface: shapes, meshes, models, loads."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import sbfem_petsc as sb
from meshing.boundary_mesh import BoundaryMesh

from .problems import CaseError, one_of
from .tables import Path, Table

if TYPE_CHECKING:
    from .case import Case


@contextlib.contextmanager
def located(case: Case, *path: str | int) -> Iterator[None]:
    """Errors of user input within become a `CaseError` at a path of the case.

    The path is continued by a key, or by the number of a notch or hole, that the sentence begins with.
    """
    try:
        yield
    except CaseError:
        raise
    except (ValueError, TypeError, KeyError) as error:
        text = str(error).rstrip(".")
        raise case.problem(_continued(case, path, text), f"is refused: {text}") from None


def _continued(case: Case, path: Path, text: str) -> Path:
    part = re.match(r"(notch|hole|crack) (\d+)\b(?:: (\w+))?", text)
    if part is not None:
        tables = {"notch": "notches", "hole": "holes", "crack": "cracks"}
        longer: Path = (*path, tables[part[1]], int(part[2]) - 1)
        for found in ((*longer, part[3]), longer):
            if found in case.lines:
                return found
    key = re.match(r"\w+: (\w+)\b", text)
    if key is not None and (*path, key[1]) in case.lines:
        return (*path, key[1])
    return path


def made(case: Case, table: Table, *path: str | int, **given: Any) -> Any:
    """What a table of a case stands for, made after that of the tables in it.

    Parameters
    ----------
    case : Case
    table : Table
    *path : str or int
        Where it is in the case.
    **given
        Arguments in the place of keys.
    """
    for name in type(table).model_fields:
        value = getattr(table, name)
        if name == "kind" or name in given:
            continue
        if name == "file":  # beside the case's own
            given["path"] = case.resolve(value)
            continue
        if isinstance(value, list):
            value = [
                made(case, entry, *path, name, k)
                if isinstance(entry, Table)
                else tuple(entry)
                if isinstance(entry, list)
                else entry
                for k, entry in enumerate(value)
            ]
        given[name] = value
    with located(case, *path):
        return type(table).made(**given)


def mesh(case: Case) -> BoundaryMesh:
    """The boundary mesh of a case, with the names that the case uses checked against it. On one rank.

    Raises
    ------
    CaseError
        If the geometry cannot be meshed or a point, edge set or region does not exist.
    """
    tables = case.tables
    options = {key: getattr(tables.mesh, key) for key in tables.mesh.model_fields_set}
    if tables.geometry.kind == "gmsh":
        with located(case, "geometry", "file"):
            file, scale = case.resolve(tables.geometry.file), tables.geometry.scale
            found = type(tables.geometry).mesher(file, scale=scale, **options)
    else:
        body = made(case, tables.geometry, "geometry")
        points = {name: (x, y) for name, (x, y) in tables.points.items()}
        place: Path = ("geometry",)
        for name in points:
            with located(case, "points", name):
                if hasattr(body, "check_point"):
                    body.check_point(name, points[name])
        with located(case, *place):
            found = body.mesh(**options, **({"points": points} if points else {}))
    _check_names(case, found)
    return found


def _check_names(case: Case, found: BoundaryMesh) -> None:
    points, sets, regions = tuple(found.points), tuple(found.edge_sets), tuple(found.material_names)
    valid = {
        "neither an edge set nor a point": (*sets, *points),
        "no point": points,
        "no edge set": sets,
    }
    for path, name, what in _named(case):
        if name not in valid[what]:
            raise case.problem(path, f"= {name!r} is {what}; {one_of(valid[what], name)}")
    own = case.tables.materials
    for name in own:
        if name not in regions:
            raise case.problem(("materials", name), f"is no region of the mesh; {one_of(regions, name)}")
    missing = [name for name in regions if own and name not in own]
    if missing:
        raise case.problem(("materials",), f"has no table for the region {missing[0]!r}; add it")


def _named(case: Case) -> Iterator[tuple[Path, str, str]]:
    """Names of places that a case uses: where, which, and what it is not if it does not exist."""
    tables, either = case.tables, "neither an edge set nor a point"
    yield from ((("model", "clamped"), name, either) for name in clamped(case))
    for k, support in enumerate(tables.model.supports):
        yield ("model", "supports", k, "where"), support.where, either
    for name, load in tables.loads.items():
        for key, what in (("point", "no point"), ("edge_set", "no edge set"), ("where", either)):
            if hasattr(load, key):
                yield ("loads", name, key), getattr(load, key), what
    yield from ((("output", "points"), name, "no point") for name in tables.output.points or ())
    for name, analysis in tables.analyses.items():
        yield from ((("analyses", name, *path), point, "no point") for path, point in analysis.places())


def clamped(case: Case) -> tuple[str, ...]:
    """Names of what is held fixed; a beam's default is its left end."""
    names = case.tables.model.clamped
    if names is None:
        return ("left",) if case.tables.geometry.kind == "beam" and not case.tables.model.supports else ()
    return tuple(names)


def materials(case: Case) -> Any:
    """One material, or a dict of them by region."""
    tables = case.tables
    if tables.material is not None:
        return made(case, tables.material, "material")
    return {name: made(case, table, "materials", name) for name, table in tables.materials.items()}


def model(case: Case, comm: Any, found: Any = None) -> sb.Model:
    """The model of a case; the mesh is made on rank 0. Collective.

    Parameters
    ----------
    case : Case
    comm : mpi4py communicator
    found : BoundaryMesh, optional
        The mesh, on rank 0 at least. Default: made here.
    """
    table = case.tables.model
    body = found if found is not None else sb.on_root(comm, lambda: mesh(case))
    supports = [made(case, support, "model", "supports", k) for k, support in enumerate(table.supports)]
    laws = {name: made(case, law, "model", "contact_laws", name) for name, law in table.contact_laws.items()}
    rayleigh = table.rayleigh
    if rayleigh is None:
        factors: Sequence[float] = (0.0, 0.0)
    elif isinstance(rayleigh, list):
        factors = tuple(rayleigh)
    else:
        factors = made(case, rayleigh, "model", "rayleigh")
    damping = table.damping
    if isinstance(damping, Table):
        damping = made(case, damping, "model", "damping")
    with located(case, "model"):
        return sb.Model(
            body,
            materials(case),
            clamped=clamped(case) or None,
            supports=supports,
            continued_fraction=table.continued_fraction,
            damping=damping,
            rayleigh=tuple(factors),
            thickness=table.thickness,
            contact_laws=laws or None,
            comm=comm,
        )


def load(case: Case, names: Sequence[str], factor: float = 1.0, frequency: float | None = None) -> list[Any]:
    """Named loads, which act together.

    Parameters
    ----------
    case : Case
    names : sequence of str
    factor : float
        On all components.
    frequency : float, optional
        Numbers become harmonics of this frequency, Hz.
    """
    parts = []
    for name in names:
        table = case.tables.loads[name]
        values = {
            key: _amplitude(case, ("loads", name, key), value, factor, frequency)
            for key, value in table.components.items()
        }
        parts.append(made(case, table, "loads", name, **values))
    return parts


def _amplitude(case: Case, path: Path, value: Any, factor: float, frequency: float | None) -> Any:
    """A component of a load: a number or a signal."""
    if not isinstance(value, Table):
        number = factor * value
        return number if frequency is None or value == 0.0 else sb.Harmonic(number, frequency)
    signal = made(case, value, *path)
    return signal if factor == 1.0 else factor * signal
