"""Tables of a case to the objects of the Python interface: shapes, meshes, models, loads."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from typing import Any

import sbfem_petsc as sb
from meshing.boundary_mesh import BoundaryMesh

from ...checks import integer, shown
from ...errors import on_all_ranks
from ...loads import separate
from ...options import one_of
from ...signals.signal import as_signal
from .problems import CaseError
from .tables import Path, Table


@contextlib.contextmanager
def located(case: Any, *path: str | int) -> Iterator[None]:
    """Errors of user input within become a `CaseError` at a path of the case.

    The path is continued by a key, or by the number of a notch or hole, that the sentence begins with; one
    that begins with a point, or a key of [mesh], is of that.
    """
    try:
        yield
    except CaseError:
        raise
    except (ValueError, TypeError, KeyError) as error:
        text = str(error).rstrip(".")
        found = case.problem(_continued(case, path, text), f"is refused: {text}")
        raise on_all_ranks(found) if getattr(error, "on_all_ranks", False) else found from None


def _continued(case: Any, path: Path, text: str) -> Path:
    point = next((name for name in case.tables.points if text.startswith(f"point {name!r}")), None)
    if point is not None:
        return "points", point
    part: Any = re.match(r"(?:(notch|hole|crack) (\d+)|(\w*))(?:: (\w+))?", text)
    tables = {"notch": "notches", "hole": "holes", "crack": "cracks"}
    owner = (*path, tables[part[1]], int(part[2]) - 1) if part[1] else path
    places = (*owner, part[4]), (part[3], part[4]), owner
    return next((found for found in places if found in case.lines), path)


def made(case: Any, value: Any, *path: str | int, **given: Any) -> Any:
    """What a table of a case stands for, made after that of the tables in it; those of a list or dict of
    tables; other values as they are.

    Parameters
    ----------
    case : Case
    value
        Of a key.
    *path : str or int
        Where it is in the case.
    **given
        Arguments in the place of a table's keys.
    """
    if isinstance(value, dict):
        return {name: made(case, one, *path, name) for name, one in value.items()}
    if isinstance(value, list):
        return [made(case, one, *path, k) for k, one in enumerate(value)]
    if not isinstance(value, Table):
        return value
    own = value.arguments().items()
    given |= {name: made(case, one, *path, name) for name, one in own if name not in given}
    if "file" in given:  # beside the case's own
        given["path"] = case.resolve(given.pop("file"))
    with located(case, *path):
        return type(value).made(**given)


def mesh(case: Any) -> BoundaryMesh:
    """The boundary mesh of a case, with the names that the case uses checked against it. On one rank.

    Raises
    ------
    CaseError
        If the geometry cannot be meshed or a point, edge set or region does not exist.
    """
    tables = case.tables
    geometry: Any = tables.geometry
    options = {key: getattr(tables.mesh, key) for key in tables.mesh.model_fields_set}
    if geometry.kind == "gmsh":
        found = made(case, geometry, "geometry", "file", **options)
    else:
        body = made(case, geometry, "geometry")
        if tables.points:
            options["points"] = {name: (x, y) for name, (x, y) in tables.points.items()}
        with located(case, "geometry"):
            found = body.mesh(**options)
    _check_names(case, found)
    return found


def _check_names(case: Any, found: BoundaryMesh) -> None:
    points, sets, regions = tuple(found.points), tuple(found.edge_sets), tuple(found.material_names)
    valid = {"neither an edge set nor a point": (*sets, *points), "no point": points, "no edge set": sets}
    for path, name, what in case.tables.named_places():
        if name not in valid[what]:
            raise case.problem(path, f"= {name!r} is {what}; {one_of(valid[what], name)}")
    own = case.tables.materials
    for name in own:
        if name not in regions:
            raise case.problem(("materials", name), f"is no region of the mesh; {one_of(regions, name)}")
    missing = [name for name in regions if own and name not in own]
    if missing:
        raise case.problem(("materials",), f"has no table for the region {missing[0]!r}; add it")


def model(case: Any, comm: Any) -> sb.Model:
    """The model of a case; the mesh is made on rank 0. Collective."""
    body = sb.on_root(comm, lambda: mesh(case))
    given = _said(case, *type(case.tables.model).model_fields) | {"clamped": case.tables.clamped or None}
    # one material, or a dict of them by region
    one, several = case.tables.material, case.tables.materials
    material = made(case, one, "material") or made(case, several, "materials")
    with located(case, "model"):
        return sb.Model(body, material, **given, comm=comm)


def _said(case: Any, *keys: str) -> dict[str, Any]:
    """Arguments for what keys of [model] say."""
    values = {key: getattr(case.tables.model, key) for key in keys}
    return {key: made(case, value, "model", key) for key, value in values.items() if value is not None}


def body(case: Any) -> dict[str, Any]:
    """The body of a case, not reduced yet, with its contact, loads and points by name: arguments of `reduce`.

    Raises
    ------
    CaseError
        If a file is missing or wrong, or a set, place or face is none of the body's.
    """
    table: Any = case.tables.body
    with located(case, "body"):
        found = table.read(case.resolve)
        if table.modes is not None:
            integer("reduce", "modes", table.modes, least=1, most=max(len(found.unknowns) - 1, 1))
    contact: Any = None
    for k, pair in enumerate(table.contacts):
        given = {key: made(case, value, "body", "contacts", k, key) for key, value in pair}
        with located(case, "body", "contacts", k):
            one = found.contact(**given)
            contact = one if contact is None else contact + one
    points = {}
    for name, point in table.points.items():
        with located(case, "body", "points", name):
            points[name] = found.at(point.at, point.direction)
            if point.less is not None:
                points[name] = points[name] - found.at(point.less, point.direction)
                if not points[name].weights.count_nonzero():
                    raise ValueError(f"at: less = {shown(point.less)} moves as at does; choose another place")
    loads = {
        name if key == "force" else f"{name} {key}": points[case.tables.loads[name].point]
        if key == "force"
        else sb.SupportMotion(**{key: 1.0})
        for name, key in _unit_loads(case)
    }
    return {"model": found, "contact": contact, "loads": loads or points, "points": points}


def reduced(case: Any, parts: dict[str, Any], comm: Any) -> sb.ReducedModel:
    """The reduced model of a body. Collective."""
    output, table = case.tables.output, case.tables.body
    assert table is not None
    with located(case, "body"):
        return sb.reduce(
            **parts,
            modes=table.modes,
            **_said(case, "damping", "rayleigh"),
            comm=comm,
            shapes=output.vtu or output.animation,
        )


def _unit_loads(case: Any) -> Iterator[tuple[str, str]]:
    """Load and component of each unit load of a body's model: those that the case gives."""
    for name, table in case.tables.loads.items():
        yield from ((name, key) for key in table.components if key in table.model_fields_set)


class Amplitudes(list):
    """Numbers and signals of a body's unit loads, which add."""

    def __add__(self, other: Any) -> Amplitudes:
        return Amplitudes(b if isinstance(a, float) and a == 0.0 else a + b for a, b in zip(self, other))


def signals_of(found: list[Any]) -> list[Any]:
    """Signals of loads, as `load` gives them."""
    if isinstance(found, Amplitudes):
        return [as_signal(value) for value in found if not (isinstance(value, float) and value == 0.0)]
    return separate(found)[1]


def units(case: Any, found: list[Any]) -> list[Any]:
    """Unit loads, in their order, of loads as `load` gives them; of a body all that its model has."""
    return list(_unit_loads(case)) if isinstance(found, Amplitudes) else separate(found)[0]


def load(case: Any, names: Sequence[str], factor: float = 1.0, frequency: float | None = None) -> list[Any]:
    """Named loads, which act together; of a body the amplitudes of all its unit loads.

    Parameters
    ----------
    case : Case
    names : sequence of str
    factor : float
        On all components.
    frequency : float, optional
        Numbers become harmonics of this frequency, Hz.
    """
    tables = case.tables.loads
    values = {
        name: {
            key: _amplitude(case, ("loads", name, key), value, factor, frequency)
            for key, value in tables[name].components.items()
        }
        for name in names
    }
    if case.tables.body is not None:
        return Amplitudes(values.get(name, {}).get(key, 0.0) for name, key in _unit_loads(case))
    return [made(case, tables[name], "loads", name, **values[name]) for name in names]


def _amplitude(case: Any, path: Path, value: Any, factor: float, frequency: float | None) -> Any:
    """A component of a load: a number or a signal."""
    if not isinstance(value, Table):
        number = factor * value
        return number if frequency is None or value == 0.0 else sb.Harmonic(number, frequency)
    signal = made(case, value, *path)
    return signal if factor == 1.0 else factor * signal
