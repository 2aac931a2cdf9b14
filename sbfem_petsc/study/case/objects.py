"""Tables of a case to the objects of the Python interface: shapes, meshes, models, loads."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import sbfem_petsc as sb
from meshing.beam import Beam
from meshing.boundary_mesh import BoundaryMesh
from meshing.gmsh.reader import read_gmsh
from meshing.plate import Plate
from meshing.shapes.features import CrackLine, Hole, VNotch

from .loads import COMPONENTS
from .problems import CaseError, Path, one_of

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


def shape(case: Case) -> Any:
    """The `Beam` or `Plate` of a case; None for a gmsh model."""
    table = case.tables.geometry
    if table.kind == "gmsh":
        return None
    holes = [
        _make(case, ("geometry", "holes", k), Hole, **hole.model_dump()) for k, hole in enumerate(table.holes)
    ]
    cracks = [
        _make(
            case,
            ("geometry", "cracks", k),
            CrackLine,
            **{**crack.model_dump(), "points": [tuple(p) for p in crack.points]},
        )
        for k, crack in enumerate(table.cracks)
    ]
    features: dict[str, Any] = {"holes": holes, "cracks": cracks}
    if table.kind == "plate":
        if table.edge_names is not None:
            features["edge_names"] = table.edge_names
        outline = [tuple(corner) for corner in table.outline]
        return _make(case, ("geometry",), Plate, outline=outline, **features)
    notches = [
        _make(case, ("geometry", "notches", k), VNotch, **notch.model_dump())
        for k, notch in enumerate(table.notches)
    ]
    size = {"length": table.length, "height": table.height}
    return _make(case, ("geometry",), Beam, **size, notches=notches, **features)


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
            found = read_gmsh(file, scale=scale, **options)
    else:
        body = shape(case)
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
    tables, points, sets = case.tables, tuple(found.points), tuple(found.edge_sets)
    places = [("model", "clamped", name) for name in clamped(case)]
    for k, support in enumerate(tables.model.supports):
        places.append(("model", f"supports[{k}]", support.where))
    for table, key, name in places:
        if name not in points and name not in sets:
            path: Path = (table, key)
            if key.startswith("supports"):
                path = (table, "supports", int(key[9:-1]), "where")
            raise case.problem(
                path, f"= {name!r} is neither an edge set nor a point; {one_of((*sets, *points), name)}"
            )
    for name, load in tables.loads.items():
        for key, valid in (("point", points), ("edge_set", sets)):
            place = getattr(load, key, None)
            if place is not None and place not in valid:
                raise case.problem(
                    ("loads", name, key), f"= {place!r} does not exist; {one_of(valid, place)}"
                )
    for name in tables.output.points or ():
        if name not in points:
            raise case.problem(("output", "points"), f"= {name!r} is no point; {one_of(points, name)}")
    for name, analysis in tables.analyses.items():
        asked: dict[Path, Any] = {("point",): getattr(analysis, "point", None)}
        asked |= {("stress_at", place): at for place, at in getattr(analysis, "stress_at", {}).items()}
        asked |= {
            ("starts", k, "point"): axis.point for k, axis in enumerate(getattr(analysis, "starts", ()))
        }
        for keys, point in asked.items():
            if isinstance(point, str) and point not in points:
                raise case.problem(
                    ("analyses", name, *keys), f"= {point!r} is no point; {one_of(points, point)}"
                )
    regions = tuple(found.material_names)
    if tables.materials:
        for name in tables.materials:
            if name not in regions:
                raise case.problem(("materials", name), f"is no region of the mesh; {one_of(regions, name)}")
        missing = [name for name in regions if name not in tables.materials]
        if missing:
            raise case.problem(("materials",), f"has no table for the region {missing[0]!r}; add it")


def clamped(case: Case) -> tuple[str, ...]:
    """Names of what is held fixed; a beam's default is its left end."""
    names = case.tables.model.clamped
    if names is None:
        return ("left",) if case.tables.geometry.kind == "beam" and not case.tables.model.supports else ()
    return tuple(names)


def materials(case: Case) -> Any:
    """One material, or a dict of them by region."""
    tables = case.tables

    def made(table: Any, *path: str) -> Any:
        kind = sb.Material if table.kind == "isotropic" else sb.OrthotropicMaterial
        return _make(case, path, kind, **table.model_dump(exclude={"kind"}))

    if tables.material is not None:
        return made(tables.material, "material")
    return {name: made(table, "materials", name) for name, table in tables.materials.items()}


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
    supports = [
        _make(case, ("model", "supports", k), sb.Support, **support.model_dump())
        for k, support in enumerate(table.supports)
    ]
    rayleigh = table.rayleigh
    if rayleigh is None:
        factors: Sequence[float] = (0.0, 0.0)
    elif isinstance(rayleigh, list):
        factors = tuple(rayleigh)
    else:
        factors = sb.rayleigh_factors(rayleigh.ratio, rayleigh.low, rayleigh.high)
    with located(case, "model"):
        return sb.Model(
            body,
            materials(case),
            clamped=clamped(case) or None,
            supports=supports,
            continued_fraction=table.continued_fraction,
            damping=table.damping,
            rayleigh=tuple(factors),
            thickness=table.thickness,
            comm=comm,
        )


def load(case: Case, names: Sequence[str], factor: float = 1.0, frequency: float | None = None) -> Any:
    """Sum of named loads.

    Parameters
    ----------
    case : Case
    names : sequence of str
    factor : float
        On all components.
    frequency : float, optional
        Numbers become harmonics of this frequency, Hz.
    """
    kinds = {"point_force": sb.PointForce, "edge_load": sb.EdgeLoad, "support_motion": sb.SupportMotion}
    parts = []
    for name in names:
        table = case.tables.loads[name]
        place = {key: getattr(table, key) for key in ("point", "edge_set") if hasattr(table, key)}
        values = {}
        for key in COMPONENTS:
            value = getattr(table, key, 0.0)
            if isinstance(value, float) and value == 0.0:
                continue
            values[key] = _signal(case, ("loads", name, key), value, factor, frequency)
        with located(case, "loads", name):
            parts.append(kinds[table.kind](**place, **values))
    return parts[0] if len(parts) == 1 else parts


def _signal(case: Case, path: Path, table: Any, factor: float, frequency: float | None) -> Any:
    if not hasattr(table, "kind"):
        number = factor * table
        return number if frequency is None else sb.Harmonic(number, frequency)
    with located(case, *path):
        options = table.model_dump(exclude={"kind"})
        if table.kind == "samples":
            file = case.resolve(options.pop("file"))
            signal = sb.Samples.from_csv(file, **options)
        else:
            kinds = {
                "harmonic": sb.Harmonic,
                "tone_burst": sb.ToneBurst,
                "chirp": sb.Chirp,
                "step": sb.Step,
                "constant": sb.Constant,
            }
            signal = kinds[table.kind](**options)
        return signal if factor == 1.0 else factor * signal


def analysis_function(case: Case, name: str) -> Any:
    """The function of the Python interface that an analysis calls.

    Raises
    ------
    CaseError
        If the installed package lacks it.
    """
    kind = case.tables.analyses[name].kind
    function = {"modulation": "periodic", "locus": "loci"}.get(kind, kind)
    return installed(case, ("analyses", name, "kind"), sb, function)


def installed(case: Case, path: Path, package: Any, name: str) -> Any:
    """A name of a package, or the error, at a path of the case, that the package lacks it."""
    try:
        return getattr(package, name)
    except AttributeError:
        raise case.problem(
            path,
            f"needs {package.__name__}.{name}, which the installed version {sb.__version__} does not have; "
            "install a newer one",
        ) from None


def _make(case: Case, path: Path, kind: Any, **options: Any) -> Any:
    with located(case, *path):
        return kind(**options)
