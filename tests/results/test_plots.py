"""Pictures: the data behind them, that they are drawn, and that two ranks draw what one draws."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import image

from sbfem_petsc.plot.fields import plot_contact, plot_crack, plot_discretisation, plot_modes
from sbfem_petsc.plot.outlines import contact_lengths, gather_outline, gather_region, loops

PICTURES = ("mesh.png", "modes.png", "crack.png", "contact.png")


def ring_area(points):
    following = np.roll(points, -1, axis=0)
    return 0.5 * (points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]).sum()


def test_the_outline_is_one_loop_around_the_notched_beam(solved):
    mesh, model, _, cases = solved
    pieces = gather_outline(model, [cases["closing"].field])
    order = loops(pieces)
    assert len(order) == 1 and len(order[0]) == len(pieces)
    points = np.concatenate([pieces[i].positions for i in order[0]])
    notch = 0.5 * 0.0025 * np.abs(np.diff([mesh.nodes[mesh.points[p], 0] for p in ("B", "C")]))[0]
    assert ring_area(points) == pytest.approx(0.05 * 0.005 - notch, rel=1e-12)
    moved = np.concatenate([pieces[i].displacements[0] for i in order[0]])
    corner = np.abs(points - np.array([0.05, 0.005])).max(axis=1) < 1e-12
    np.testing.assert_allclose(
        moved[corner], np.tile(cases["closing"].displacement("A"), (corner.sum(), 1)), rtol=1e-9
    )


def test_contact_lengths_sum_to_the_face(solved):
    mesh, model, _, _ = solved
    nodes = mesh.nodes[mesh.pairs.nodes[:, 0]]
    assert contact_lengths(model).sum() == pytest.approx(np.linalg.norm(nodes[-1] - nodes[0]), rel=1e-12)


def test_the_region_of_a_crack(solved):
    mesh, model, _, cases = solved
    tip = np.array(mesh.cracks[0].tip)
    region = gather_region(model, cases["opening"].field, tip, 0.001)
    assert np.abs(region.positions - tip).max() < 0.05 and np.isfinite(region.stress).all()
    corners = region.positions[region.triangles]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0.0).all()
    # stress concentrates at the tip
    peak = region.positions[region.stress[:, 3].argmax()]
    assert np.abs(peak - tip).max() < 1e-5


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_of_one_and_two_ranks_agree(serial_files, parallel_files, name):
    one, two = (image.imread(folder / name)[..., :3] for folder in (serial_files, parallel_files))
    assert one.shape == two.shape and one.shape[1] == 1440 and one.shape[0] > 400
    assert one.std() > 0.05
    assert (np.abs(one - two).max(axis=2) > 0.1).mean() < 1e-3


def test_colours_by_displacement_and_given_magnification(solved, tmp_path):
    _, model, _, cases = solved
    path = plot_crack(
        model,
        {"opening": cases["opening"].field},
        str(tmp_path / "crack.png"),
        colour="displacement",
        magnification=50.0,
    )
    assert image.imread(path).shape[1] == 1440


def test_bad_requests(solved, tmp_path):
    mesh, model, modes, cases = solved
    with pytest.raises(ValueError, match="modes = .* must be numbers from 0 to 3"):
        plot_modes(modes, str(tmp_path / "a.png"), [0, 9])
    with pytest.raises(ValueError, match="colour = 'heat' is unknown"):
        plot_crack(model, {"u": cases["opening"].field}, str(tmp_path / "a.png"), colour="heat")
    with pytest.raises(ValueError, match="crack = 3 does not exist"):
        plot_contact(cases, str(tmp_path / "a.png"), crack=3)
    with pytest.raises(ValueError, match="picture .* cannot be written"):
        plot_discretisation(mesh, str(tmp_path / "none" / "a.png"))
