"""Loads, supports and materials of the assembled structure against closed forms and a second code."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from sbfem_petsc.system.layout.partition import Parts, number_unknowns

STEEL = sb.Material(200e9, 0.3, 7800)
BAR = Beam(0.1, 0.02)


def roller(mesh_points=("origin",)):
    """Left edge held along x, one point along y: uniform stress states are exact."""
    return [sb.Support("left", x=True, y=False), sb.Support("origin", x=False, y=True)]


def bar_mesh(order=3):
    return BAR.mesh(order=order, points={"origin": (0.0, 0.0)}, corners=())


@pytest.mark.parametrize(
    "material",
    [
        STEEL,
        sb.Material(200e9, 0.3, 7800, "strain"),
        sb.OrthotropicMaterial(150e9, 10e9, 0.3, 5e9, 1600),
        sb.OrthotropicMaterial(150e9, 10e9, 0.3, 5e9, 1600, angle=90),
    ],
)
@pytest.mark.parametrize("thickness", [1.0, 0.01])
def test_uniform_tension(material, thickness):
    """Traction on the right edge: the elasticity's own uniaxial strain, whatever the thickness."""
    model = sb.Model(bar_mesh(), material, clamped=None, supports=roller(), thickness=thickness)
    u = sb.static(model, sb.EdgeLoad("right", tx=1e6)).displacement("A")
    strain = np.linalg.solve(material.modulus * material.elasticity, [1e6, 0.0, 0.0])
    np.testing.assert_allclose(u, [strain[0] * 0.1, strain[1] * 0.02], rtol=1e-9)


def test_pressure_and_point_force_agree_with_traction():
    model = sb.Model(bar_mesh(), STEEL, clamped=None, supports=roller(), thickness=0.5)
    pulled = sb.static(model, sb.EdgeLoad("right", tx=-1e6)).displacement("A")
    pressed = sb.static(model, sb.EdgeLoad("right", pressure=1e6)).displacement("A")
    np.testing.assert_allclose(pressed, pulled, rtol=1e-9)
    both = sb.static(model, sb.EdgeLoad("right", tx=-1e6) + sb.EdgeLoad("right", pressure=-1e6)).displacement(
        "A"
    )
    assert np.abs(both).max() < 1e-9 * np.abs(pulled).max()


def test_loads_add_and_scale():
    model = sb.Model(Beam(0.4, 0.005).mesh(order=3), STEEL)
    one, two = sb.PointForce("A", fx=2.0), sb.EdgeLoad("top", pressure=3.0)
    separate = sb.static(model, one).displacement("A") + sb.static(model, two).displacement("A")
    for load in (one + two, [one, two], sb.Loads((one, two))):
        np.testing.assert_allclose(sb.static(model, load).displacement("A"), separate, rtol=1e-7)


def test_spring_on_a_point():
    """A stiff point spring at the tip of a cantilever: u = F / (k_beam + k)."""
    mesh = Beam(0.4, 0.005).mesh(order=4)
    free = 1.0 / sb.static(sb.Model(mesh, STEEL), sb.PointForce("A", fy=1.0)).displacement("A")[1]
    held = sb.Model(mesh, STEEL, supports=[sb.Support("A", x=False, y=3.0 * free)])
    assert sb.static(held, sb.PointForce("A", fy=1.0)).displacement("A")[1] == pytest.approx(
        0.25 / free, rel=1e-6
    )


def test_spring_on_an_edge():
    """A bar on a distributed elastic support: the support's shortening is stress / stiffness."""
    supports = [sb.Support("left", x=1e13, y=False), sb.Support("origin", x=False, y=True)]
    model = sb.Model(bar_mesh(), STEEL, clamped=None, supports=supports, thickness=0.3)
    u = sb.static(model, sb.EdgeLoad("right", tx=1e6)).displacement("A")[0]
    assert u == pytest.approx(1e6 / 200e9 * 0.1 + 1e6 / 1e13, rel=1e-9)


def test_one_direction_supports():
    """A beam simply supported at two points bends as Euler and Timoshenko say (slender: shear is 0.1 %)."""
    length, height = 1.0, 0.02
    mesh = Beam(length, height).mesh(
        order=4, points={"L": (0, 0), "R": (length, 0), "M": (length / 2, height)}, corners=()
    )
    model = sb.Model(mesh, STEEL, clamped=None, supports=[sb.Support("L"), sb.Support("R", x=False)])
    found = sb.static(model, sb.EdgeLoad("top", pressure=1e3)).displacement("M")[1]
    inertia = height**3 / 12
    euler = 5 * 1e3 * length**4 / (384 * 200e9 * inertia)
    assert -found == pytest.approx(euler, rel=4e-3)


def test_two_materials():
    """A steel and an aluminium half in series: displacements add."""
    mesh = Beam(0.1, 0.02).mesh(order=3, size=0.025, points={"origin": (0.0, 0.0)}, corners=())
    from dataclasses import replace

    half = (mesh.scaling_centres[:, 0] > 0.05).astype(int)
    mesh = replace(mesh, materials=half, material_names=("steel", "aluminium"))
    zero = {"steel": sb.Material(200e9, 0.0, 7800), "aluminium": sb.Material(70e9, 0.0, 2700)}
    model = sb.Model(mesh, zero, clamped=None, supports=roller())
    u = sb.static(model, sb.EdgeLoad("right", tx=1e6)).displacement("A")[0]
    assert u == pytest.approx(1e6 * 0.05 * (1 / 200e9 + 1 / 70e9), rel=1e-9)


def test_mesh_without_corners_of_another_order():
    """Orders 2 to 12 of an uncracked cantilever under a tip load converge from below, towards one value."""
    values = [
        sb.static(
            sb.Model(Beam(0.2, 0.02).mesh(order=order), STEEL), sb.EdgeLoad("right", ty=1e4)
        ).displacement("A")[1]
        for order in (2, 3, 5, 8, 12)
    ]
    assert (np.diff(values) > 0).all()
    # what is left between orders 8 and 12 is the clamped corners' singularity, graded to 0.2 of the height
    assert values[-1] / values[-2] - 1 < 2e-5


@pytest.mark.slow
def test_vertex_layout():
    """The paper's layout (tip as a corner of four closed S-elements) is too stiff, the more so the coarser it
    is; the tip-centred one is not.
    """
    beam = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0458366)])
    material = sb.Material(70e9, 0.33, 2700)
    exact = 24.5939399

    def error(**options):
        return sb.modal(sb.Model(beam.mesh(**options), material), 1).frequencies[0] / exact - 1

    coarse, fine = (error(layout="vertex", tip_size=size, face_edges=1) for size in (1e-3, 5e-5))
    assert coarse > 5 * fine > 0
    assert abs(error(tip_size=1e-3)) < 0.1 * fine


def test_repr_and_properties():
    model = sb.Model(
        Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0458366)]).mesh(),
        sb.Material(70e9, 0.33, 2700),
        damping=0.002,
    )
    assert (
        str(model.boundary_unknowns) in repr(model)
        and str(model.unknowns) in repr(model)
        and "\n" not in repr(model)
    )
    assert model.area == pytest.approx(0.4 * 0.005 - 0.5 * 0.0025 * 2e-6, rel=1e-12)
    assert model.perimeter == pytest.approx(
        2 * (0.4 + 0.005) + 2 * 0.0025, rel=2e-4
    )  # less the tip element's faces
    assert model.shapes <= 12


@pytest.mark.parametrize("ranks", [1, 3, 200])
def test_parts_hold_the_outlines(ranks):
    """Each S-element, open ones too, is in one part, with its nodes in the mesh's order; there may be more
    parts than S-elements.
    """
    mesh = Beam(0.1, 0.02, notches=[VNotch(x=0.03, depth=0.01, opening=0.0)]).mesh(order=3)
    assert (~mesh.closed).any() and mesh.element_reversed.any()
    fixed = np.zeros((len(mesh.nodes), 2), dtype=bool)
    parts = Parts(mesh, number_unknowns(mesh, fixed, ranks))
    found = []
    for part in (parts.of(rank) for rank in range(ranks)):
        assert len(part.chains) == len(part.elements)
        for element, chain in zip(part.elements, part.chains):
            np.testing.assert_array_equal(part.nodes[chain], mesh.element_nodes(element))
        found.extend(part.elements)
    assert sorted(found) == list(range(mesh.elements))


@pytest.mark.parametrize("order, says", [(2, "S-element"), (8, "tip crack1")])
def test_all_but_incompressible_material(order, says):
    """An error that comes of Poisson's ratio names it, and what it names works."""
    plate = Plate(
        [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)],
        cracks=[CrackLine([(0.05, 0.1), (0.05, 0.07), (0.065, 0.045)])],
    )
    mesh = plate.mesh(order=order, size=0.03)

    def sheared(poisson):
        model = sb.Model(mesh, sb.Material(70e9, poisson, 2700, "strain"), clamped="edge1")
        return sb.static(model, sb.EdgeLoad("edge3", tx=1e5)).stress_intensity["crack1"]

    with pytest.raises(
        ValueError, match=f"{says}.*; or give a poisson of at most 0.49999: with 0.499999 the"
    ):
        sheared(0.499999)
    assert sheared(0.49999) == pytest.approx(sheared(0.4999), rel=5e-3)
