"""VTU files read back by meshio: patch test, geometry, pieces of two ranks."""

from __future__ import annotations

import xml.etree.ElementTree as xml

import meshio
import numpy as np
import pytest
import shapely

from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.results.vtu import write_modes, write_vtu
from sbfem_petsc.system.fields.sampling import normal_stress_row, sample, von_mises
from tests.numbers.bodies import two_halves

GRADIENT = np.array([[1.0e-4, 4.0e-5], [-2.0e-5, -3.0e-5]])


def _split(mesh, kept):
    """Cells of a meshio mesh where `kept`, by blocks."""
    starts = np.cumsum([0] + [len(b.data) for b in mesh.cells])
    return [meshio.CellBlock(b.type, b.data[kept[i:j]]) for b, i, j in zip(mesh.cells, starts, starts[1:])]


def test_patch_test(solved, tmp_path):
    mesh, model, _, _ = solved
    field = model.layout.part.coordinates @ GRADIENT.T + np.array([1e-5, 2e-5])
    found = meshio.read(write_vtu(str(tmp_path / "patch"), model, {"u": field}))
    # the faces of the tip element carry no load, so a linear field is not its solution
    kept = ~np.isin(np.concatenate(found.cell_data["element"]), np.flatnonzero(~mesh.closed))
    inside = np.unique(np.concatenate([b.data.ravel() for b in _split(found, kept)]))
    exact = found.points[:, :2] @ GRADIENT.T + np.array([1e-5, 2e-5])
    np.testing.assert_allclose(
        found.point_data["u (m)"][inside, :2], exact[inside], atol=1e-12 * np.abs(exact).max(), rtol=0.0
    )
    assert not found.point_data["u (m)"][:, 2].any() and found.points.shape[1] == 3
    material = model.materials[0]
    stress = (
        material.modulus
        * material.elasticity
        @ np.array([GRADIENT[0, 0], GRADIENT[1, 1], GRADIENT[0, 1] + GRADIENT[1, 0]])
    )
    mises = np.sqrt(stress[0] ** 2 - stress[0] * stress[1] + stress[1] ** 2 + 3.0 * stress[2] ** 2)
    for name, value in zip(("stress_xx", "stress_yy", "stress_xy", "von_mises"), (*stress, mises)):
        # round-off of the displacement divided by the small elements' size
        np.testing.assert_allclose(
            found.point_data[f"u {name} (Pa)"][inside], value, atol=1e-7 * np.abs(stress).max(), rtol=0.0
        )


def test_contact_inside_the_tip_element_is_part_of_the_field(solved):
    """At points inside the tip element the field is the one that `displacement` and `stress` give by forms of
    their own, and without the forces there it is not.
    """
    _, model, _, cases = solved
    push = cases["closing"]
    with_forces, without = (
        next(patch for patch in sample(model.tips, {"u": state}, keep=~model.layout.part.closed))
        for state in (push, push.field)
    )
    index = 0, 3, 1, 2  # a point inside of an edge's sector
    place = tuple(with_forces.positions[index])
    np.testing.assert_allclose(with_forces.displacements["u"][index], push.displacement(place), rtol=1e-9)
    found, exact = with_forces.stresses["u"][index][:3], push.stress(place)
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-7 * np.abs(exact).max())
    assert np.abs(without.stresses["u"][index][:3] - exact).max() > 1e-3 * np.abs(exact).max()


def test_cells_cover_the_structure(solved, tmp_path):
    mesh, model, _, _ = solved
    found = meshio.read(
        write_vtu(
            str(tmp_path / "cells.vtu"),
            model,
            {"u": np.zeros_like(model.layout.part.coordinates)},
            stress=False,
            subdivisions=4,
        )
    )
    assert list(found.point_data) == ["u (m)"]
    area = 0.0
    for block in found.cells:
        corners = found.points[block.data]
        following = np.roll(corners, -1, axis=1)
        pieces = 0.5 * (corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]).sum(axis=1)
        assert (pieces > 0.0).all()
        area += pieces.sum()
    notch = 0.5 * 0.0025 * np.abs(np.diff([mesh.nodes[mesh.points[p], 0] for p in ("B", "C")]))[0]
    assert area == pytest.approx(0.05 * 0.005 - notch, rel=1e-12)
    elements = np.concatenate(found.cell_data["element"])
    assert set(elements) == set(range(mesh.elements))
    assert (
        not np.concatenate(found.cell_data["rank"]).any()
        and not np.concatenate(found.cell_data["material"]).any()
    )


@pytest.mark.long
def test_pieces_of_two_ranks_hold_what_one_file_holds(serial_files, parallel_files):
    index = xml.parse(parallel_files / "fields.pvtu").getroot()
    pieces = [meshio.read(parallel_files / piece.get("Source")) for piece in index.iter("Piece")]
    one = meshio.read(serial_files / "fields.vtu")
    assert [set(np.concatenate(p.cell_data["rank"])) for p in pieces] == [{0}, {1}]
    announced = {a.get("Name"): int(a.get("NumberOfComponents", 1)) for a in index.find(".//PPointData")}
    assert announced == {name: 3 if values.ndim == 2 else 1 for name, values in one.point_data.items()}
    assert {a.get("Name") for a in index.find(".//PCellData")} == set(one.cell_data)
    for block, kind in enumerate(("quad", "triangle")):
        ordered = []
        for meshes in ([one], pieces):
            elements = np.concatenate([m.cell_data["element"][block] for m in meshes])
            corners = np.concatenate(
                [m.points[m.cells[block].data].reshape(len(m.cells[block].data), -1) for m in meshes]
            )
            values = np.concatenate(
                [m.point_data["closing von_mises (Pa)"][m.cells[block].data] for m in meshes]
            )
            assert all(m.cells[block].type == kind for m in meshes)
            order = np.argsort(elements, kind="stable")
            ordered.append((elements[order], corners[order], values[order]))
        (elements, corners, values), (other_elements, other_corners, other_values) = ordered
        np.testing.assert_array_equal(elements, other_elements)
        np.testing.assert_allclose(corners, other_corners, atol=1e-15)
        np.testing.assert_allclose(values, other_values, atol=1e-5 * values.max())


def test_modes_bear_their_frequencies(solved, tmp_path):
    _, model, modes, _ = solved
    found = meshio.read(write_modes(str(tmp_path / "modes"), modes, [1, 3]))
    names = [f"mode {k + 1}, {modes.frequencies[k]:.6g} Hz (m/sqrt(kg))" for k in (1, 3)]
    assert list(found.point_data) == names
    corner = np.abs(found.points[:, :2] - model.points["A"][0]).max(axis=1) < 1e-9
    for name, k in zip(names, (1, 3)):
        expected = np.tile(modes.displacement("A")[k], (corner.sum(), 1))
        np.testing.assert_allclose(found.point_data[name][corner, :2], expected, rtol=1e-9)
    with pytest.raises(ValueError, match=r"modes\[0\] = 4 must be between 0 and 3"):
        write_modes(str(tmp_path / "modes"), modes, [4])


def test_von_mises_in_plane_strain():
    material = Material(2e11, 0.3, 7800.0, plane="strain")
    assert von_mises(np.array([1.0, 0.0, 0.0]), material) == pytest.approx(np.sqrt(1.0 - 0.3 + 0.09))
    same = OrthotropicMaterial(2e11, 2e11, 0.3, 2e11 / 2.6, 7800.0, angle=30.0, plane="strain")
    np.testing.assert_allclose(normal_stress_row(same), [0.3, 0.3, 0.0], atol=1e-15)
    # a strongly orthotropic one against its own compliance: eps_zz = 0 with the axes turned by 90 degrees
    turned = OrthotropicMaterial(
        1.4e11,
        1.0e10,
        0.3,
        5.0e9,
        1600.0,
        angle=90.0,
        plane="strain",
        young_3=2.0e10,
        poisson_13=0.1,
        poisson_23=0.4,
    )
    np.testing.assert_allclose(
        normal_stress_row(turned), [2.0e10 * 0.4 / 1.0e10, 2.0e10 * 0.1 / 1.4e11, 0.0], atol=1e-15
    )


def test_wrong_fields_and_places(solved, tmp_path):
    model = solved[1]
    with pytest.raises(ValueError, match=r"field 'u' has shape \(3, 2\)"):
        write_vtu(str(tmp_path / "a"), model, {"u": np.zeros((3, 2))})
    with pytest.raises(ValueError, match="cannot be written"):
        write_vtu(str(tmp_path / "none" / "a"), model, {"u": np.zeros_like(model.layout.part.coordinates)})


def test_as_paraviews_own_reader_sees_it(solved, tmp_path):
    """VTK's reader, by pyvista: grid, area, names with their units, and the displacement of a corner."""
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed")
    mesh, model, modes, cases = solved
    grid = pyvista.read(write_vtu(str(tmp_path / "static.vtu"), model, {"closing": cases["closing"]}))
    assert set(grid.point_data) == {
        "closing (m)",
        *(f"closing {name} (Pa)" for name in ("stress_xx", "stress_yy", "stress_xy", "von_mises")),
    }
    assert set(grid.cell_data) == {"element", "material", "rank"}
    assert grid.compute_cell_sizes().cell_data["Area"].sum() == pytest.approx(model.area, rel=1e-9)
    corner = np.append(mesh.nodes[mesh.points["A"]], 0.0)
    found = grid.point_data["closing (m)"][grid.find_closest_point(corner)]
    np.testing.assert_allclose(found[:2], cases["closing"].displacement("A"), rtol=1e-9)
    shapes = pyvista.read(write_modes(str(tmp_path / "modes.vtu"), modes, range(2)))
    assert list(shapes.point_data) == [
        f"mode {k + 1}, {modes.frequencies[k]:.6g} Hz (m/sqrt(kg))" for k in range(2)
    ]


def test_material_of_each_cell(tmp_path):
    """Tip elements in an interface are of two materials: every cell, of several pieces an edge, has
    that of its place.
    """
    model = two_halves()
    found = meshio.read(write_vtu(str(tmp_path / "halves.vtu"), model, {}, subdivisions=3))
    for block, material in zip(found.cells, found.cell_data["material"]):
        height = found.points[block.data, 1].mean(axis=1)
        names = np.array(model.layout.material_names)[material]
        assert (names == np.where(height < 0.5, "low", "high")).all()
    # cells that bear one element's number are one piece of the body
    cells = [found.points[corners, :2] for block in found.cells for corners in block.data]
    numbers = np.concatenate(found.cell_data["element"])
    assert len(set(numbers)) == model.elements > 1
    for number in set(numbers):
        own = [shapely.Polygon(cell).buffer(1e-9) for cell, of in zip(cells, numbers) if of == number]
        assert shapely.union_all(own).geom_type == "Polygon"
