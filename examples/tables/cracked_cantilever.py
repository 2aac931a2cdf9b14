"""The mesh and the deck of `examples/cracked_cantilever.py`: gmsh's tetrahedra in CalculiX's format."""

from __future__ import annotations

import pathlib
import shutil
import subprocess

import numpy as np

LENGTH, WIDTH, HEIGHT, PLACE, DEPTH = 200.0, 20.0, 10.0, 80.0, 5.0  # mm
DECK = """*MATERIAL, NAME=STEEL
*ELASTIC
210000., .3
*DENSITY
7.85E-9
*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL
*BOUNDARY
CLAMP, 1, 3
"""
STORE = "*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n1\n*END STEP\n"


def mesh(size: float, fine: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) in mm and ten nodes of each tetrahedron, in gmsh's order; the crack's nodes are two."""
    import gmsh

    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Verbosity", 2)
        geometry, tiny = gmsh.model.occ, 1e-4
        beam = geometry.addBox(0, 0, 0, LENGTH, WIDTH, HEIGHT)
        face = geometry.addRectangle(0, 0, 0, DEPTH, WIDTH)
        geometry.rotate([(2, face)], 0, 0, 0, 0, 1, 0, -np.pi / 2)
        geometry.translate([(2, face)], PLACE, 0, HEIGHT - DEPTH)
        geometry.fragment([(3, beam)], [(2, face)])
        geometry.synchronize()

        def within(top: float, dimension: int) -> list[int]:
            low = PLACE - tiny, -tiny, HEIGHT - DEPTH - tiny
            box = (*low, PLACE + tiny, WIDTH + tiny, top + tiny)
            return [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*box, dimension)]

        crack, front = within(HEIGHT, 2), within(HEIGHT - DEPTH, 1)
        mouth = [line for line in within(HEIGHT, 1) if line not in front]
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)])
        faces, ends = gmsh.model.addPhysicalGroup(2, crack), gmsh.model.addPhysicalGroup(1, mouth)
        field = gmsh.model.mesh.field
        near, sizes = field.add("Distance"), field.add("Threshold")
        field.setNumbers(near, "CurvesList", front)
        field.setNumbers(near, "SurfacesList", crack)
        given = {"InField": near, "SizeMin": fine, "SizeMax": size, "DistMin": 1, "DistMax": 15}
        for name, value in given.items():
            field.setNumber(sizes, name, value)
        field.setAsBackgroundMesh(sizes)
        for name in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints"):
            gmsh.option.setNumber(f"Mesh.{name}", 0)
        gmsh.option.setNumber("Mesh.Algorithm3D", 1)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        opening = {"Dimension": 2, "PhysicalGroup": faces, "OpenBoundaryPhysicalGroup": ends}
        for name, value in opening.items():
            gmsh.plugin.setNumber("Crack", name, value)
        gmsh.plugin.run("Crack")
        tags, places, _ = gmsh.model.mesh.getNodes()
        _, _, (corners,) = gmsh.model.mesh.getElements(3)
    finally:
        gmsh.finalize()
    used, tets = np.unique(corners, return_inverse=True)
    row = dict(zip(tags.tolist(), range(len(tags))))
    return places.reshape(-1, 3)[[row[tag] for tag in used.tolist()]], tets.reshape(-1, 10)


def faces(places: np.ndarray, tets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the crack's left and right face, each with its partner; the front's are one, and no pair."""
    from scipy.spatial import cKDTree

    left = np.zeros(len(places), dtype=bool)
    left[tets[places[tets[:, :4], 0].mean(axis=1) < PLACE]] = True
    pairs = cKDTree(places).query_pairs(1e-6, output_type="ndarray")
    one = np.where(left[pairs[:, 0]], pairs[:, 0], pairs[:, 1])
    return one, pairs.sum(axis=1) - one


def write_deck(file: pathlib.Path, places: np.ndarray, tets: np.ndarray, step: str = STORE) -> None:
    """A deck of CalculiX in N, mm and t; its last two nodes of a tetrahedron are gmsh's exchanged."""
    left, right = faces(places, tets)
    held = np.flatnonzero(places[:, 0] < 1e-6)
    sets = {"CLAMP": held, "LEFT": left, "RIGHT": right}
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{k},{x:.12g},{y:.12g},{z:.12g}" for k, (x, y, z) in enumerate(places, 1)]
    lines.append("*ELEMENT, TYPE=C3D10, ELSET=EALL")
    turned = tets[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]] + 1
    lines += [f"{k}," + ",".join(map(str, nodes)) for k, nodes in enumerate(turned.tolist(), 1)]
    for name, nodes in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{node + 1}," for node in nodes.tolist())]
    file.write_text("\n".join(lines) + "\n" + DECK + step)


def calculix(file: pathlib.Path) -> None:
    """Run a deck."""
    if shutil.which("ccx") is None:
        raise SystemExit(
            "cracked_cantilever: ccx, CalculiX's solver, is not found; apt-get install calculix-ccx"
        )
    subprocess.run(["ccx", file.stem], cwd=file.parent, check=True, stdout=subprocess.DEVNULL)
