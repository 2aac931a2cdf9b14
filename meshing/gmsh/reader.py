"""A user's gmsh model (.msh, .geo, .step ...) to a boundary mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshing.boundary_mesh import BoundaryMesh
from meshing.cells.complex import CellComplex, Curve, edge_key
from meshing.cells.crack_meshing import CrackMeshing
from meshing.cells.crack_splitting import add_cracks
from meshing.cells.planar import find_crossing, find_meeting, polygon_area
from meshing.cells.s_elements import build_mesh
from meshing.gll import gll_nodes, lagrange_values
from meshing.gmsh_session import drain_parser, gmsh_session
from meshing.input_checks import checked_order, positive

_GEOMETRY = (".geo", ".geo_unrolled", ".step", ".stp", ".brep", ".iges", ".igs")
_UNNAMED_GEOMETRY = _GEOMETRY[2:]  # these formats carry no physical groups
_STRAIGHT = 1e-9  # deviation from the chord, relative to it


def read_gmsh(
    path: str | Path,
    order: int = 5,
    size: float | None = None,
    tip_element: bool = True,
    *,
    tip_size: float | None = None,
    grading: float = 2.5,
    face_size: float | None = None,
    face_edges: int = 12,
) -> BoundaryMesh:
    """Read a gmsh model; each triangle or quadrilateral becomes an S-element.

    Physical groups say what is what. Physical surfaces are materials, physical curves edge sets, physical
    points named points (groups without a name are called "surface1", "curve1", "point1" ... by their tags). A
    crack is

    - one physical curve ``crack:NAME``: lines along cell edges inside the material; its two faces are made
      here. An end inside is a tip, one on the outline a mouth; it may branch, cross other cracks, end at a
      hole or cut the body; or
    - two physical curves ``crack:NAME:right`` and ``crack:NAME:left``: two existing faces that share the
      tip's node and match, e.g. the flanks of a notch, or a line along which gmsh's Crack plugin has
      duplicated the nodes.

    The right face is at the right hand of somebody who looks from the tip to the mouth. The faces become the
    edge sets ``NAME_right`` and ``NAME_left``, the mouth's corners the points ``NAME_right`` and
    ``NAME_left`` where there is one mouth; a physical point on an embedded crack line belongs to the left
    face. The cells around each tip, sharp kink and junction are divided anew into rings.

    Parameters
    ----------
    path : path
        ``.msh`` of any version gmsh reads, straight or curved elements. ``.geo``, ``.step``, ``.brep`` are
        meshed here, GLL nodes on the true curves; step, brep and iges carry no groups: all surfaces are one
        material, parts that touch are joined, every curve and point has its number in its name ("curve5",
        "point2"); to name them, write a .geo file that merges the file and adds physical groups. SI units;
        lengths in step and iges files are converted to m.
    order : int
        Polynomial order of the S-elements' edges, 1 to 20.
    size : float, optional
        Largest cell size when a geometry is meshed, m.
    tip_element : bool
        A small open S-element with its scaling centre on each crack tip, and rings around it.
    tip_size : float, optional
        Half-size of that S-element, m. Default: 0.02 of the crack's length, or 0.03 of the reach of the cells
        around the tip if that is less.
    grading : float
        Largest size ratio of neighbouring rings, 1.1 to 10.
    face_size : float, optional
        Longest edge on the faces of cracks, m. Default: the crack's length divided by `face_edges`.
    face_edges : int
        See `face_size`.

    Returns
    -------
    BoundaryMesh

    Raises
    ------
    ValueError
        One sentence that names the file and the item: missing, truncated or not understood, no physical
        groups, no cells, not plane, inverted, degenerate or not star-convex cells, crack lines that do not
        lie on cell edges, faces that do not match.
    """
    order = checked_order(order)
    if size is not None:
        size = positive("read_gmsh", "size", size)
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file.")
    with gmsh_session("user") as gmsh:
        model = _extract(gmsh, path, order, size)
    origin = str(path)
    extent = float(np.ptp(np.array(model.cells.vertices), axis=0).max())
    meshing = CrackMeshing.checked(extent, tip_element, tip_size, grading, face_size, face_edges)
    add_cracks(model.cells, model.crack_lines, meshing, origin)
    return build_mesh(model.cells, order, model.materials, origin)


@dataclass
class _Model:
    """What is taken from gmsh: cells, crack lines as edges by group name, material names."""

    cells: CellComplex
    crack_lines: dict[str, list[tuple[int, int]]]
    materials: tuple[str, ...]


def _extract(gmsh, path: Path, order: int, size: float | None) -> _Model:
    suffix = path.suffix.lower()
    if suffix in (".geo", ".geo_unrolled") and not path.read_bytes().endswith((b"\n", b"\r")):
        raise ValueError(
            f"{path}: its last line does not end with a newline, and gmsh may leave out what stands on it; "
            "add one."
        )
    try:
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")  # of a step file that a .geo file merges, too
        gmsh.merge(str(path))
        if suffix in _UNNAMED_GEOMETRY and len(gmsh.model.getEntities(2)) > 1:
            # These formats keep every part by itself; parts that touch are one body.
            gmsh.model.occ.removeAllDuplicates()
            gmsh.model.occ.synchronize()
        if suffix in _GEOMETRY:
            if size is not None:
                gmsh.option.setNumber("Mesh.MeshSizeMax", size)
            gmsh.model.mesh.generate(1)
            _refuse_crossing_outlines(gmsh, path)
            gmsh.model.mesh.generate(2)
    except ValueError:
        raise
    except Exception as error:  # gmsh raises nothing more precise
        drain_parser(gmsh)
        raise ValueError(
            f"{path}: gmsh cannot read or mesh it ({error}); the file may be truncated or corrupt."
        ) from error
    groups = {dimension: _groups(gmsh, dimension, suffix in _UNNAMED_GEOMETRY) for dimension in (0, 1, 2)}
    if not groups[2] and suffix in _UNNAMED_GEOMETRY:
        raise ValueError(
            f"{path}: it has no surfaces; export the plane area as a face, and check that the file is "
            "complete."
        )
    if not groups[2]:
        raise ValueError(
            f"{path}: it has no physical surfaces; put every surface in a physical group, its name is the "
            "material's."
        )
    named = {entity for entities in groups[2].values() for entity in entities}
    nameless = [
        tag
        for _, tag in gmsh.model.getEntities(2)
        if tag not in named and len(gmsh.model.mesh.getElements(2, tag)[0])
    ]
    if nameless:
        raise ValueError(
            f"{path}: surface {nameless[0]} belongs to no physical group and would be left out; add it to "
            "one, or delete it."
        )
    cells, vertex_of = CellComplex(), {}
    tags, positions, _ = gmsh.model.mesh.getNodes()
    positions = positions.reshape(-1, 3)
    if len(positions):  # z from round-off, e.g. of a rotation, is none
        positions[np.abs(positions[:, 2]) <= 1e-9 * np.ptp(positions, axis=0).max(), 2] = 0.0
    where = {int(tag): position for tag, position in zip(tags, positions)}
    for material, (name, entities) in enumerate(groups[2].items()):
        count = len(cells.cells)
        for entity in entities:
            _add_surface(gmsh, path, entity, material, cells, vertex_of, where)
        if len(cells.cells) == count:
            raise ValueError(
                f"{path}: physical surface {name!r} has no triangles or quadrilaterals; mesh it, or check "
                "that the file is complete."
            )
    if suffix in _GEOMETRY:
        _put_on_true_curves(gmsh, cells, vertex_of, order)
    uses = cells.edge_uses()
    crack_lines = {}
    for name, entities in groups[1].items():
        edges = [
            edge for entity in entities for edge in _line_edges(gmsh, path, name, entity, vertex_of, uses)
        ]
        if name.startswith("crack:"):
            crack_lines[name] = edges
        elif edges:
            cells.edge_sets[name] = edges
    for name, entities in groups[0].items():
        nodes = [int(tag) for entity in entities for tag in gmsh.model.mesh.getNodes(0, entity)[0]]
        if len(nodes) != 1 or nodes[0] not in vertex_of:
            if suffix in _UNNAMED_GEOMETRY:
                continue
            raise ValueError(
                f"{path}: physical point {name!r} is not one vertex of a cell; give one point on the mesh "
                "per name."
            )
        cells.points[name] = vertex_of[nodes[0]]
    return _Model(cells, crack_lines, tuple(groups[2]))


def _refuse_crossing_outlines(gmsh, path: Path) -> None:
    """Surfaces whose outline and embedded curves cross each other, on which gmsh may work for ever; needs the
    mesh of the curves.
    """
    for _, surface in gmsh.model.getEntities(2):
        segments, ends = [], []
        embedded = [
            (dimension, tag) for dimension, tag in gmsh.model.mesh.getEmbedded(2, surface) if dimension == 1
        ]
        for _, curve in gmsh.model.getBoundary([(2, surface)], oriented=False) + embedded:
            for kind, _, nodes in zip(*gmsh.model.mesh.getElements(1, curve)):
                count = gmsh.model.mesh.getElementProperties(kind)[3]
                for element in np.asarray(nodes).reshape(-1, count):
                    segments.append([gmsh.model.mesh.getNode(tag)[0] for tag in element[:2]])
                    ends.append(element[:2])
        segments = np.array(segments).reshape(-1, 2, 3)
        if (
            not len(segments)
            or np.ptp(segments[..., 2]) > 1e-9 * np.ptp(segments.reshape(-1, 3), axis=0).max()
        ):
            continue  # not plane: refused with its cells
        crossing = find_crossing(segments[..., :2])
        if crossing is None:
            crossing = find_meeting(segments[..., :2], np.array(ends))
        if crossing is not None:
            raise ValueError(
                f"{path}: the curves of surface {surface} cross each other near ({crossing[0]:.6g}, "
                f"{crossing[1]:.6g}) m; mend the geometry."
            )


def _groups(gmsh, dimension: int, unnamed: bool) -> dict[str, list[int]]:
    """Entities of each physical group by its name."""
    kind = ("point", "curve", "surface")[dimension]
    if unnamed:
        tags = [tag for _, tag in gmsh.model.getEntities(dimension)]
        return {"material": tags} if dimension == 2 and tags else {f"{kind}{tag}": [tag] for tag in tags}
    groups: dict[str, list[int]] = {}
    for _, tag in gmsh.model.getPhysicalGroups(dimension):
        name = gmsh.model.getPhysicalName(dimension, tag) or f"{kind}{tag}"
        groups.setdefault(name, []).extend(
            int(e) for e in gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)
        )
    return groups


def _add_surface(
    gmsh,
    path,
    entity: int,
    material: int,
    cells: CellComplex,
    vertex_of: dict[int, int],
    where: dict[int, np.ndarray],
) -> None:
    """Cells of one surface; curved edges by interpolation through the elements' own nodes."""
    new = []
    for kind, _, nodes in zip(*gmsh.model.mesh.getElements(2, entity)):
        name, _, element_order, count, _, corners = gmsh.model.mesh.getElementProperties(kind)
        if corners not in (3, 4):
            raise ValueError(
                f"{path}: surface {entity} contains elements of type {name!r}; only triangles and "
                "quadrilaterals become S-elements."
            )
        for element in np.asarray(nodes).reshape(-1, count):
            element = [int(tag) for tag in element]
            new.append(
                (
                    [_vertex(path, tag, cells, vertex_of, where) for tag in element[:corners]],
                    element,
                    corners,
                    element_order,
                )
            )
    areas = [polygon_area(np.array([cells.vertices[v] for v in loop])) for loop, *_ in new]
    # A surface may be oriented downwards as a whole; single cells against the others are inverted.
    downwards = sum(areas) < 0
    for (loop, element, corners, element_order), area in zip(new, areas):
        extent = np.ptp([cells.vertices[v] for v in loop], axis=0).max()
        if (-area if downwards else area) <= 1e-12 * extent**2:
            x, y = np.mean([cells.vertices[v] for v in loop], axis=0)
            raise ValueError(
                f"{path}: the cell near ({x:.6g}, {y:.6g}) m in surface {entity} is inverted or degenerate; "
                "mend the mesh there."
            )
        cells.add_cell(loop[::-1] if downwards else loop, material=material)
        for i in range(corners if element_order > 1 else 0):
            first, last = loop[i], loop[(i + 1) % corners]
            inner = element[corners + i * (element_order - 1) : corners + (i + 1) * (element_order - 1)]
            points = np.array([where[tag][:2] for tag in (element[i], *inner, element[(i + 1) % corners])])
            _add_curve(cells, first, last, np.linspace(0, 1, element_order + 1), points)


def _vertex(
    path, tag: int, cells: CellComplex, vertex_of: dict[int, int], where: dict[int, np.ndarray]
) -> int:
    if tag not in vertex_of:
        x, y, z = where[tag]
        if not (math.isfinite(x) and math.isfinite(y)) or z != 0.0:
            raise ValueError(
                f"{path}: node {tag} at ({x:g}, {y:g}, {z:g}) m is not in the plane z = 0; the model must be "
                "plane."
            )
        vertex_of[tag] = cells.add_vertex(x, y)
    return vertex_of[tag]


def _add_curve(cells: CellComplex, first: int, last: int, parameters: np.ndarray, points: np.ndarray) -> None:
    """Give an edge the shape of the polynomial through points (n, 2) at parameters (n,) in [0, 1], unless it
    is straight.
    """
    chord = points[-1] - points[0]
    straight = points[0] + parameters[:, None] * chord
    if np.abs(points - straight).max() <= _STRAIGHT * np.hypot(*chord):
        return
    if first > last:
        parameters, points = 1.0 - parameters[::-1], points[::-1]
    cells.curves[edge_key((first, last))] = polynomial_curve(parameters, points)


def polynomial_curve(parameters: np.ndarray, points: np.ndarray) -> Curve:
    """The polynomial through points (n, 2) at parameters (n,)."""
    return lambda at: lagrange_values(parameters, at) @ points


def _put_on_true_curves(gmsh, cells: CellComplex, vertex_of: dict[int, int], order: int) -> None:
    """GLL nodes of the edges on curved geometry by its parametrisation."""
    at = 0.5 * (gll_nodes(order) + 1.0)
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
        ends = {int(tag) for _, point in bounds for tag in gmsh.model.mesh.getNodes(0, point)[0]}
        if len(ends) < 2:  # a closed curve: its seam has two parameters
            for tag in ends:
                parameter_of[tag] = [low, high]
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(1, curve)):
            count = gmsh.model.mesh.getElementProperties(kind)[3]
            for element in np.asarray(nodes).reshape(-1, count):
                first, last = int(element[0]), int(element[1])
                if first not in vertex_of or last not in vertex_of:
                    continue
                start, stop = min(
                    ((a, b) for a in parameter_of[first] for b in parameter_of[last]),
                    key=lambda pair: abs(pair[1] - pair[0]),
                )
                points = np.array(gmsh.model.getValue(1, curve, start + at * (stop - start))).reshape(-1, 3)[
                    :, :2
                ]
                # The ends are vertices that other edges share: they stay as they are.
                points[0], points[-1] = cells.vertices[vertex_of[first]], cells.vertices[vertex_of[last]]
                cells.curves.pop(edge_key((vertex_of[first], vertex_of[last])), None)
                _add_curve(cells, vertex_of[first], vertex_of[last], at, points)


def _line_edges(
    gmsh, path, name: str, entity: int, vertex_of: dict[int, int], uses: dict[tuple[int, int], int]
) -> list[tuple[int, int]]:
    """Edges of cells along a physical curve."""
    edges = []
    for kind, _, nodes in zip(*gmsh.model.mesh.getElements(1, entity)):
        count = gmsh.model.mesh.getElementProperties(kind)[3]
        for element in np.asarray(nodes).reshape(-1, count):
            first, last = (vertex_of.get(int(tag), -1) for tag in element[:2])
            key = edge_key((first, last))
            if key not in uses:
                what = "crack line" if name.startswith("crack:") else "physical curve"
                raise ValueError(
                    f"{path}: {what} {name!r} does not lie on cell edges (curve {entity}); embed the curve "
                    "in the surface or make it part of its outline."
                )
            edges.append(key)
    return edges
