"""Points where the faces of a crack coincide are two points of the body, which is told."""

import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch

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
