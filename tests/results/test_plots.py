"""Pictures: the data behind them, that they are drawn, and that two ranks draw what one draws."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from matplotlib import image

import sbfem_petsc as sb
from meshing import Plate
from sbfem_petsc import plot
from sbfem_petsc.plot import (
    plot_contact,
    plot_crack,
    plot_discretisation,
    plot_field,
    plot_modes,
    save_picture,
)
from sbfem_petsc.record import units
from sbfem_petsc.system.fields.outlines import gather_outline, gather_region, loops

PICTURES = ("mesh.png", "modes.png", "crack.png", "contact.png", "field.png")


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


@pytest.mark.long
@pytest.mark.parametrize("name", PICTURES)
def test_pictures_of_one_and_two_ranks_agree(serial_files, parallel_files, name):
    one, two = (image.imread(folder / name)[..., :3] for folder in (serial_files, parallel_files))
    assert one.shape == two.shape and one.shape[1] == 1440 and one.shape[0] > 400
    assert one.std() > 0.05
    assert (np.abs(one - two).max(axis=2) > 0.1).mean() < 1e-3


@pytest.mark.slow
def test_colours_by_displacement_and_given_magnification(solved, tmp_path):
    _, model, _, cases = solved
    axes = plot_crack(model, {"opening": cases["opening"].field}, colour="displacement", magnification=50.0)
    assert [a.get_xlabel() for a in axes[:2]] == ["x from the tip (mm)", "x from the tip (µm)"]
    assert image.imread(save_picture(axes, tmp_path / "crack.png")).shape[1] == 1440


@pytest.mark.long
def test_a_pulled_bar_as_a_whole(tmp_path):
    """E u / L in one colour everywhere, the sides where they are moved to; compression is the other end of
    the scale.
    """
    mesh = Plate([(0.0, 0.0), (0.2, 0.0), (0.2, 0.05), (0.0, 0.05)]).mesh(order=2)
    ends = [sb.Support("edge4", y=False), sb.Support("edge2", y=False)]
    steel = sb.Material(210e9, 0.0, 7800)
    with sb.Model(mesh, steel, clamped=None, supports=[*ends, sb.Support("edge1", x=False)]) as model:
        pulls = {
            name: sb.static(model, sb.EdgeMotion("edge2", ux=u)) for name, u in (("+", 1e-4), ("-", -2e-4))
        }
        panels = plot_field(model, pulls, colour="stress_xx", magnification=100.0)
        for axes, strain in zip(panels, (5e-4, -1e-3)):
            (painted,) = axes.collections
            np.testing.assert_allclose(painted.get_array(), 210e3 * strain, rtol=1e-9)  # MPa
            assert painted.get_clim() == pytest.approx((-210.0, 210.0), rel=1e-9)
            x = np.concatenate([line.get_xdata() for line in axes.lines])
            assert (x.min(), x.max()) == pytest.approx((0.0, 200.0 * (1.0 + 100.0 * strain)), abs=1e-9)
        assert [axes.get_title() for axes in panels] == ["+, displacement × 100", "-, displacement × 100"]
        assert image.imread(save_picture(panels, tmp_path / "field.png")).std() > 0.05
        (alone,) = plot_field(model, {"": pulls["+"]}, colour="displacement")
        assert alone.get_title() == "displacement × 100"  # a twentieth of the length, but for round-off
        (painted,) = alone.collections
        assert painted.get_array().max() == pytest.approx(100.0, rel=1e-9)  # µm
        with pytest.raises(ValueError, match="colour = 'heat' must be one of"):
            plot_field(model, pulls, colour="heat")
        with pytest.raises(TypeError, match="must be a dict by name"):
            plot_field(model, pulls["+"])


def test_what_all_pictures_take():
    """Axes of the caller's own by name; of a point's motion the direction, if both are known."""
    for name in (name for name in plot.__all__ if name.startswith("plot_")):
        takes = inspect.signature(getattr(plot, name)).parameters
        assert takes["ax"].default is None and takes["ax"].kind is inspect.Parameter.KEYWORD_ONLY
        if "point" in takes:
            assert takes["point"].default == "A" and takes["direction"].default in ("y", None)
    assert "harmonic" in inspect.signature(plot.plot_branches).parameters


def test_bad_requests(solved, tmp_path):
    mesh, model, modes, cases = solved
    with pytest.raises(ValueError, match=r"modes\[1\] = 9 must be between 0 and 3"):
        plot_modes(modes, [0, 9])
    with pytest.raises(ValueError, match="colour = 'heat' must be one of"):
        plot_crack(model, {"u": cases["opening"].field}, colour="heat")
    with pytest.raises(ValueError, match="crack = 3 does not exist"):
        plot_contact(cases, crack=3)
    with pytest.raises(ValueError, match="'kept' was read from a file, which keeps no model"):
        sb.save(str(tmp_path / "static.h5"), cases["opening"])
        plot_contact({"kept": sb.read(str(tmp_path / "static.h5"))})
    with pytest.raises(TypeError, match="mesh = None must be a BoundaryMesh"):
        plot_discretisation(None)
    with pytest.raises(ValueError, match="picture .* cannot be written: No such file"):
        save_picture(plot_discretisation(mesh), str(tmp_path / "none" / "a.png"))


@pytest.mark.parametrize("ending, start", [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_kinds_of_files(solved, tmp_path, ending, start):
    _, _, modes, _ = solved
    path = save_picture(plot_modes(modes, [0])[0], tmp_path / f"mode.{ending}")
    assert open(path, "rb").read().startswith(start)
    assert save_picture(None, tmp_path / "none.png") is None and len(list(tmp_path.iterdir())) == 1


def test_what_is_no_picture(solved, tmp_path):
    axes = plot_modes(solved[2], [0])
    with pytest.raises(ValueError, match=r"must end in one of .png, .svg, .pdf"):
        save_picture(axes, tmp_path / "mode.bmp")
    for wrong in (3, "axes", []):
        with pytest.raises(TypeError, match="neither axes nor a figure"):
            save_picture(wrong, tmp_path / "a.png")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(ValueError, match="is a folder"):
        save_picture(axes, tmp_path / "folder.png")


def test_units_by_magnitude(solved):
    """Frequencies of one picture share a unit; a beam of 50 mm is drawn in millimetres."""
    modes = solved[2]
    axes = plot_modes(modes)
    assert modes.frequencies[-1] > 1e4 > modes.frequencies[0]
    assert [a.get_title() for a in axes] == [
        f"mode {k + 1}:  {float(f'{f:.5g}') / 1e3:#.5g} kHz" for k, f in enumerate(modes.frequencies)
    ]
    assert axes[-1].get_xlabel() == "x (mm)"
    for top, of, unit in (
        (0.3, "m", "mm"),
        (4e-7, "m", "nm"),
        (999.0, "Hz", "Hz"),
        (2500.0, "N", "kN"),
        (3e-4, "s", "µs"),
        (3.0, "place", "m"),
        (2e6, "Pa", "MPa"),
    ):
        assert units.suited(of, top)[1] == unit
    assert (units.place_unit(0.0)[1], units.frequency_unit(999.0)[1]) == ("µm", "Hz")
