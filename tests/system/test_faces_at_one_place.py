"""Points where the faces of a crack coincide are two points of the body, which is told."""

import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from tests.validation.selement_cases import two_node_mesh

ALUMINIUM = sb.Material(70e9, 0.33, 2700)
SHEAR = [sb.EdgeLoad("edge3", tx=1e3, ty=1e3)]


def cracked(order):
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    crack = CrackLine([(-0.3, 0.0), (0.3, 0.0)], opening=0.0, name="c")
    return sb.Model(Plate(corners, cracks=[crack]).mesh(order=order, size=0.4), ALUMINIUM, clamped="edge1")


def told(found, places):
    """Of how many places it is told."""
    count = 0
    for place in places:
        with warnings.catch_warnings(record=True) as met:
            warnings.simplefilter("always")
            found.stress(place)
        count += any(issubclass(item.category, sb.PlaceWarning) for item in met)
    return count


@pytest.mark.parametrize("order", [1, pytest.param(3, marks=pytest.mark.long)])
def test_points_on_coinciding_faces(order):
    """Between nodes, at them and inside the tips' S-elements; not beside the faces nor before the tips."""
    found = sb.static(cracked(order), SHEAR)
    nodes = found.model.layout.part.coordinates
    on_line = (np.abs(nodes[:, 1]) < 1e-9) & (np.abs(nodes[:, 0]) < 0.3 - 1e-9)
    on = [(x, 0.0) for x in np.linspace(-0.299, 0.299, 14)] + [tuple(at) for at in nodes[on_line]]
    beside = [(x, 3e-7) for x in np.linspace(-0.299, 0.299, 14)] + [(x, 0.0) for x in (-0.9, 0.301, 0.5)]
    beside += [tuple(at) for at in nodes[~on_line]]
    assert (told(found, on), told(found, beside)) == (len(on), 0)


def test_the_sides_differ():
    """What is told matters: along a crack under shear the stresses of its sides have different signs."""
    model = cracked(4)
    found = sb.static(model, SHEAR, contact=False)
    with pytest.warns(
        sb.PlaceWarning, match=r"the point \(0.1, 0\) m lies where both faces of c are: .* one s"
    ):
        value = found.stress((0.1, 0.0))
    sides = np.array([found.stress((0.1, y))[0] for y in (-1e-7, 1e-7)])
    assert np.abs(sides[0] - sides[1]) > 0.5 * np.abs(sides).max()
    assert np.abs(sides - value[0]).min() < 1e-5 * np.abs(sides).max()
    with pytest.warns(sb.PlaceWarning, match=r"and 1[0-9] more lies"):
        found.along((-0.3, 0.0), (0.3, 0.0), 18)
    history = sb.transient(model, SHEAR, 1e-4, 1e-5, modes=4)
    with pytest.warns(sb.PlaceWarning):
        history.stress((0.1, 0.0))


@pytest.mark.long
def test_faces_apart():
    """Of faces with a gap between them each point belongs to one."""
    mesh = Beam(0.2, 0.02, [VNotch(0.08, 0.01, opening=1.0)]).mesh(order=3)
    found = sb.static(sb.Model(mesh, ALUMINIUM), sb.PointForce("A", fy=-1.0))
    assert told(found, [tuple(at) for at in found.model.layout.part.coordinates]) == 0


PRESSED = [
    sb.EdgeLoad("c_left", pressure=sb.Constant(1e3)),
    sb.EdgeLoad("c_right", pressure=sb.Constant(3e3)),
]


@pytest.mark.parametrize("reduction", ["modes", None])
def test_corners_of_a_mouth_by_name(reduction):
    """Each has the stress of its own face, at a free edge -p across it and no other."""
    crack = CrackLine([(0.1, 1.0), (0.1, 0.5)], opening=0.0, name="c")
    mesh = Plate([(-1, -1), (1, -1), (1, 1), (-1, 1)], cracks=[crack]).mesh(order=6, size=0.4)
    model = sb.Model(mesh, ALUMINIUM, clamped="edge1", rayleigh=(0.0, 1e-5))
    options = {"contact": False, "initial": "equilibrium", "reduction": reduction}
    modes = 20 if reduction else None
    rest = [sb.EdgeLoad(part.edge_set, pressure=part.pressure.value) for part in PRESSED]
    found = [
        sb.static(model, rest, contact=False),
        sb.transient(model, PRESSED, 1e-4, 1e-5, modes=modes, **options),
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.PlaceWarning)
        for name, pressure in (("c_left", 1e3), ("c_right", 3e3)):
            for result in found:
                stress = np.atleast_2d(result.stress(name))[-1]
                np.testing.assert_allclose(stress, [-pressure, 0.0, 0.0], atol=30.0)


def test_corners_of_a_mouth_in_the_element_of_a_tip():
    """One S-element has both faces: what is beside them, by coordinates."""
    nodes = [(0, 0), (0, -1), (2, -1), (2, 1), (0, 1), (0, 0)]
    mesh = two_node_mesh(
        nodes, [list(range(6))], [(1, 0)], [False], {"end": [(2, 3)], "top": [(3, 4)]}, {"low": 0, "high": 5}
    )
    found = sb.static(sb.Model(mesh, ALUMINIUM, clamped="end"), sb.EdgeLoad("top", tx=1e3, ty=2e3))
    sides = np.array([found.stress((1e-7, y)) for y in (-1e-7, 1e-7)])
    np.testing.assert_allclose(
        [found.stress("low"), found.stress("high")], sides, atol=1e-4 * abs(sides).max()
    )
    assert np.abs(sides[0] - sides[1]).max() > 0.1 * np.abs(sides).max()
