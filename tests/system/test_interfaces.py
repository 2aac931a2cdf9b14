"""Crack tips where two materials meet: what the mesh hands over, and what the model makes of it."""

import re
from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy import optimize

import sbfem_petsc as sb
from meshing import Beam, BoundaryMesh, VNotch, read_gmsh
from sbfem_petsc.results.vtu import write_vtu
from sbfem_petsc.selement.fracture import dundurs
from tests.numbers.bodies import grid
from tests.validation.interface_cases import BODIES, FIRST, PULL, SECOND, exponent, model

MATERIALS = {"first": FIRST, "second": SECOND}
HELD = [sb.Support("O"), sb.Support("X", x=False, y=True)]


@pytest.fixture(scope="module")
def ending(tmp_path_factory):
    return model(tmp_path_factory.mktemp("ending"), "ending", order=4)


@pytest.mark.slow
def test_tip_that_ends_at_an_interface(ending, tmp_path):
    """Zak and Williams' exponent; no G and no T; both materials in the picture."""
    np.testing.assert_allclose(ending.tips.intensities.exponents, exponent(), atol=1e-5)
    pulled = sb.static(ending, PULL)
    first, second = pulled.stress_intensity["c"]
    assert first > 0.0 and abs(second) < 1e-5 * first  # symmetric
    assert np.isnan(pulled.energy_release_rate["c"]) and np.isnan(pulled.t_stress["c"])
    # ahead of the tip on its line: sigma_yy r^(1 - lambda) sqrt(2 pi) -> K
    r = 1e-6
    assert pulled.stress((0.4 + r, 0.0))[1] == pytest.approx(
        first / np.sqrt(2 * np.pi) * r ** (exponent() - 1.0), rel=1e-2
    )
    write_vtu(str(tmp_path / "pulled.vtu"), ending, {"u": pulled})


def test_closed_crack_that_ends_at_an_interface(ending, tmp_path):
    """Pressed along y a crack on the body's line of symmetry is none: displacements of the body without it;
    their difference is that of two meshes at the ends of the interface.
    """
    pressed = sb.static(ending, [sb.EdgeLoad("bottom", pressure=1.0), sb.EdgeLoad("top", pressure=1.0)])
    path = tmp_path / "whole.geo"
    path.write_text(re.sub(r'Physical Curve\("crack:c"\).*\n', "", BODIES["ending"]))
    whole = sb.Model(read_gmsh(path, order=4), MATERIALS, clamped=None, supports=HELD)
    exact = sb.static(whole, [sb.EdgeLoad("bottom", pressure=1.0), sb.EdgeLoad("top", pressure=1.0)])
    for point in ("P", "Q"):
        np.testing.assert_allclose(pressed.displacement(point), exact.displacement(point), atol=2e-4)
    assert abs(pressed.stress_intensity["c"][0]) < 1e-3
    (note,) = pressed.notes
    power = 1.0 - exponent()
    assert f"K_I and K_II of 'c' are in Pa m^{power:.4f}"[:-1] in note and note in repr(pressed)
    assert pressed.contact_resultant == pytest.approx(pressed_half(exact), rel=2e-3)


def pressed_half(whole: sb.Static) -> float:
    """Resultant of sigma_yy over the line of the crack."""
    at, weight = np.polynomial.legendre.leggauss(40)
    return float(sum(-0.2 * w * whole.stress((0.2 + 0.2 * x, 1e-9))[1] for x, w in zip(at, weight)))


def test_materials_of_two_names_and_equal_values(tmp_path):
    """A crack between them is one in a single material: K, G and T are that one's, also where it is pressed.

    G is (K_I^2 + K_II^2) / E' of the values themselves.
    """
    (tmp_path / "along.geo").write_text(BODIES["along"])
    mesh, same = read_gmsh(tmp_path / "along.geo", order=4), sb.Material(2.0, 0.3, 1.0)
    named = {"first": same, "second": sb.Material(young=2.0, poisson=0.3, density=1.0)}
    pressed = [sb.EdgeLoad("bottom", pressure=1.0), sb.EdgeLoad("top", pressure=1.0)]
    for load in (PULL, pressed):
        one, two = (
            sb.static(sb.Model(mesh, given, clamped=None, supports=HELD), load) for given in (same, named)
        )
        for name in ("stress_intensity", "energy_release_rate", "t_stress"):  # products of two runs
            found, expected = getattr(two, name), getattr(one, name)
            assert found == {
                tip: pytest.approx(values, rel=1e-9, abs=1e-9) for tip, values in expected.items()
            }
    # the last one pressed, its crack closed: K_I is rounding
    assert abs(two.stress_intensity["c"][0]) < 1e-9
    pulled = sb.static(sb.Model(mesh, named, clamped=None, supports=HELD), PULL)
    first, second = pulled.stress_intensity["c"]
    assert pulled.energy_release_rate["c"] == pytest.approx((first**2 + second**2) / 2.0, rel=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["closed", "open"])
def test_what_is_told_of_a_crack_along_an_interface(sign, tmp_path):
    """Closed, its stresses are not those that Rice's K stands for, and the print says so."""
    body = model(tmp_path, "along", order=4)
    found = sb.static(body, [sb.EdgeLoad(edge, pressure=sign) for edge in ("bottom", "top")])
    told = "of 'c', closed along an interface, K_I and K_II are of no field, only the energy release rate is"
    assert found.notes == ((told,) if sign > 0.0 else ()) and (told in repr(found)) == (sign > 0.0)
    assert found.energy_release_rate["c"] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("reduction", ["modes", pytest.param(None, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", ["along", pytest.param("ending", marks=pytest.mark.long)])
def test_what_is_told_of_tips_in_motions(name, reduction, tmp_path):
    """As of static solutions: in the print of histories, steady states and load histories, and in what is
    read back of their files.
    """
    (tmp_path / "body.geo").write_text(BODIES[name])
    mesh, damping = read_gmsh(tmp_path / "body.geo", order=4), {"damping": 0.05, "rayleigh": (0.0, 0.5)}
    body = sb.Model(mesh, MATERIALS, clamped=None, supports=HELD, **damping)
    load = [sb.EdgeLoad(edge, pressure=1.0) for edge in ("bottom", "top")]
    told = sb.static(body, load).notes
    assert len(told) == 1
    path = str(tmp_path / "history.h5")
    options = {"reduction": reduction, "modes": 20}
    history = sb.transient(body, load, 2.0, 0.05, file=path, **options)
    held = [sb.EdgeLoad(edge, pressure=sb.Constant(1.0)) for edge in ("bottom", "top")]
    orbit = sb.periodic(body, [*held, sb.EdgeLoad("top", tx=sb.Harmonic(0.01, 0.05))], 0.05, modes=20)
    if reduction is None:  # its shooting takes half a minute
        orbit = replace(orbit, time=history.time, states=history.states, state=np.zeros(0))
    sb.save(tmp_path / "orbit.h5", orbit)
    found = [history, orbit, sb.read(path), sb.read(tmp_path / "orbit.h5")]
    for motion in [*found, sb.load_history(body, load, [0.0, 1.0])]:
        assert motion.notes == told and told[0] in repr(motion)
    with h5py.File(tmp_path / "orbit.h5") as file:
        assert tuple(note.decode() for note in file["notes"][:]) == told
    through = sb.transient(body, PULL, 0.2, 0.05, contact=False, **options)
    assert through.notes == (() if name == "along" else told)


@pytest.mark.parametrize("opening, unit", [(0.05, "Pa m^0.499861"), (0.0, "Pa m^(1/2)")])
def test_units_of_an_open_notch(opening, unit, tmp_path):
    """Of K_II at 0.05 degrees, Williams' 1 - lambda: the root of sin(lambda w) = lambda sin(w) of a wedge of
    the angle w = 2 pi - opening, antisymmetric.
    """
    wedge = 2.0 * np.pi - np.radians(opening)
    root = optimize.brentq(lambda x: np.sin(x * wedge) - x * np.sin(wedge), 0.5 - 1e-9, 0.55)
    mesh = Beam(0.2, 0.02, [VNotch(0.08, 0.01, opening)]).mesh(order=4)
    body = sb.Model(mesh, sb.Material(70e9, 0.3, 2700))
    assert body.tips.intensities.units("crack1") == ("Pa m^(1/2)", unit)
    assert abs(body.tips.intensities.exponents[0, 1] - root) < 1e-6
    pulled, pushed = (sb.static(body, sb.PointForce("A", fy=force)) for force in (-1e3, 1e5))
    assert any(unit in note for note in pulled.notes) == (opening > 0.0)
    assert np.isnan(pulled.energy_release_rate["crack1"]) == (opening > 0.0)
    pulled.to_csv(str(tmp_path / "pulled.csv"))
    head = (tmp_path / "pulled_tip.csv").read_text().splitlines()[0]
    columns = head.split(",")
    assert columns[2] == f"stress_intensity_II [{'Pa m^(1 - exponent)' if opening else unit}]"
    assert columns[3:] == ["energy_release_rate [J/m^2]", "t_stress [Pa]"]
    told = (
        "t_stress of 'crack1' is sigma_xx, beside the pressure p on the faces; sigma_xx - sigma_yy is T + p"
    )
    assert pushed.notes[-1] == told and told not in pulled.notes


@pytest.mark.slow
def test_mesh_in_a_file(tmp_path):
    (tmp_path / "along.geo").write_text(BODIES["along"])
    mesh = read_gmsh(tmp_path / "along.geo", order=4)
    (element, sectors), *more = mesh.sector_materials.items()
    assert not more and element == mesh.tips[0].element
    assert sorted(set(sectors.tolist())) == [0, 1] and (np.diff(sectors) != 0).sum() == 1
    assert "second and first" in mesh.summary() or "first and second" in mesh.summary()
    mesh.save(tmp_path / "mesh.h5")
    again = BoundaryMesh.load(tmp_path / "mesh.h5")
    np.testing.assert_array_equal(again.sector_materials[element], sectors)
    moved = sb.static(sb.Model(again, MATERIALS, clamped=None, supports=HELD), PULL)
    # mirrored about the crack: each sector the other one's material, K_II changes its sign
    swapped = {"first": SECOND, "second": FIRST}
    other = sb.static(sb.Model(again, swapped, clamped=None, supports=HELD), PULL)
    k, mirrored = moved.stress_intensity["c"], other.stress_intensity["c"]
    np.testing.assert_allclose(mirrored, (k[0], -k[1]), rtol=2e-3)
    assert moved.energy_release_rate["c"] == pytest.approx(7.467473, rel=2e-3)  # by scikit-fem
    with pytest.raises(ValueError, match="not one for each of its edges"):
        replace(mesh, sector_materials={element: sectors[:-1]})


def test_interface_tips_of_other_sizes(tmp_path):
    """A body four times smaller beside one under the same tractions: by dimensions alone K is half of the
    larger one's times 4^(i epsilon), as it is told at 1 m for both.
    """
    x, y = np.array([0.0, 1.5, 2.0, 3.0, 5.0]), np.array([0.0, 1.0, 2.0])
    groups = """
    Physical Surface("second") = {1:4, 101:104}; Physical Surface("first") = {5:8, 105:108};
    Physical Curve("crack:large") = {6, 7}; Physical Curve("crack:small") = {106, 107};
    Physical Curve("wall") = {1:4, 101:104}; Physical Curve("top") = {9:12, 109:112};
    """
    path = tmp_path / "two.geo"
    path.write_text(grid(x, y) + grid(10.0 + x / 4.0, y / 4.0, 101) + groups)
    body = sb.Model(read_gmsh(path, order=3, face_edges=6), MATERIALS, "wall")
    tips = [group for group in body.cells.groups if not group.closed]
    assert [len(group.sizes) for group in tips] == [2, 2]  # a form for both would do but for their sizes
    factors = sb.static(body, sb.EdgeLoad("top", pressure=-1.0)).stress_intensity
    _, beta = dundurs(np.stack([m.young * m.elasticity for m in (FIRST, SECOND)]))
    epsilon = np.log((1.0 - beta) / (1.0 + beta)) / (2.0 * np.pi)
    for tip, above in ((1, -1.0), (2, 1.0)):  # the first material is below the line that points to the left
        large, small = (complex(*factors[f"{name}:{tip}"]) for name in ("large", "small"))
        assert small == pytest.approx(0.5 * 4.0 ** (1j * above * epsilon) * large, rel=1e-9)
