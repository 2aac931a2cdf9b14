"""Forces of supports that share nodes: the flexibility of a structure without the support is the oracle."""

import os
import tempfile

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, Plate, VNotch, read_gmsh
from tests.parallel import answer, on_ranks

STEEL = sb.Material(210e9, 0.3, 7800)
SPRING = {"x": 3e11, "y": 5e11}  # N/m^3: they and the plate give way alike
LOAD = sb.EdgeLoad("edge3", tx=2e6, ty=-5e6)
APPLIED = np.array([2e6, -5e6]) * 0.4  # N
PROGRAM = """
import json
from mpi4py import MPI
from tests.analysis.test_reactions import held_faces, moved, shared, sprung
found = held_faces() | moved() | shared() | sprung(0.02)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


def mesh():
    outline = [(0.0, 0.0), (0.4, 0.0), (0.4, 0.3), (0.0, 0.3)]
    points = {"corner": (0.0, 0.0), "middle": (0.15, 0.0), "apart": (0.4, 0.12)}
    return Plate(outline).mesh(order=4, points=points)


def static(*supports, load=LOAD):
    return sb.static(sb.Model(mesh(), STEEL, clamped=None, supports=supports), load)


@pytest.mark.parametrize("point", ["corner", "middle"])
@pytest.mark.parametrize("directions", [(True, True), (True, False), (False, True)])
def test_fixed_point_on_elastic_edge(point, directions):
    """A point of an elastic edge that is held fixed: its force is that which brings the point of the
    structure on springs alone back, ``-C^-1 u``, and the springs' is what they have under both.
    """
    elastic = sb.Support("edge1", **SPRING)
    alone = static(elastic)
    held = np.flatnonzero(directions)
    units = [static(elastic, load=sb.PointForce(point, **{f"f{'xy'[k]}": 1.0})) for k in held]
    flexibility = np.array([unit.displacement(point)[held] for unit in units])
    forces = -np.linalg.solve(flexibility.T, alone.displacement(point)[held])
    on_springs = alone.reactions["edge1"] + sum(f * u.reactions["edge1"] for f, u in zip(forces, units))
    found = static(elastic, sb.Support(point, *directions)).reactions
    scale = np.abs(APPLIED).max()
    exact = np.zeros(2)
    exact[held] = forces
    assert np.abs(exact).max() > 0.05 * scale  # there is something to tell
    assert np.abs(found[point] - exact).max() < 1e-10 * scale
    assert np.abs(found["edge1"] - on_springs).max() < 1e-10 * scale
    assert np.abs(found[point] + found["edge1"] + APPLIED).max() < 1e-10 * scale


def test_springs_on_a_point_of_an_edge():
    """An elastic point on an elastic edge: the springs stand side by side, each with its own force."""
    spring = sb.Support("middle", x=2e10, y=4e10)
    found = static(sb.Support("edge1", **SPRING), spring)
    own = -np.array([2e10, 4e10]) * found.displacement("middle")
    assert found.reactions["middle"] == pytest.approx(own, rel=1e-12)
    assert found.reactions["middle"] + found.reactions["edge1"] == pytest.approx(-APPLIED, rel=1e-10)


def shared():
    """Reactions of supports that share nodes, of edges and a point, fixed and elastic."""
    found = static(
        sb.Support("edge1", x=True, **{"y": SPRING["y"]}),
        sb.Support("edge4", x=True, y=True),
        sb.Support("corner", x=False, y=True),
        sb.Support("edge2", x=SPRING["x"], y=False),
        sb.Support("apart", x=True, y=True),
    ).reactions
    return {name: force.tolist() for name, force in found.items()}


def held_faces():
    """Reactions where the clamped end and one face of a closed notch are held."""
    mesh = Beam(0.1, 0.01, [VNotch(0.07, 0.004, 0.02)]).mesh(order=3)
    found = {}
    for face in ("crack1_right", "crack1_left"):
        model = sb.Model(mesh, STEEL, clamped=["left", face])
        state = sb.static(model, sb.PointForce("A", fy=3000.0))
        assert state.contact_resultant > 500.0
        found |= {f"{name} beside {face}": force.tolist() for name, force in state.reactions.items()}
    return found


def moved():
    """Force of an end that is moved, of a beam that each rank has read from a gmsh model."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "beam.geo_unrolled")
        Beam(0.1, 0.005).write(path)
        read = read_gmsh(path, order=3)
    model = sb.Model(read, STEEL, clamped="left", supports=[sb.Support("right", x=False)])
    return {"moved": sb.static(model, sb.EdgeMotion("right", uy=1e-5)).reactions["right"].tolist()}


def test_friction_on_a_held_face():
    """Pressure and friction on nodes that do not move are the support's: in balance with the load."""
    mesh = Beam(0.1, 0.01, [VNotch(0.07, 0.004, 0.02)]).mesh(order=3)
    for face in ("crack1_right", "crack1_left"):
        model = sb.Model(mesh, STEEL, clamped=["left", face], contact_laws=sb.Coulomb(0.4))
        state = sb.static(model, sb.PointForce("A", fx=-2000.0, fy=3000.0))
        assert np.abs(state.friction_force).max() > 1.0
        carried = np.sum([*state.reactions.values()], axis=0)
        assert carried == pytest.approx([2000.0, -3000.0], abs=1e-8 * 3000.0)


def sprung(thickness):
    """Of a body on an elastic edge and an elastic point in its middle, where two ranks meet: displacement and
    reaction of the point, and how many ranks have it.
    """
    body = Beam(0.4, 0.1).mesh(order=2, size=0.1, points={"middle": (0.2, 0.0)}, corners=())
    supports = [sb.Support("left", y=False), sb.Support("bottom", x=False, y=5e11)]
    supports.append(sb.Support("middle", x=False, y=1e11 * thickness))
    model = sb.Model(body, STEEL, clamped=None, supports=supports, thickness=thickness)
    found = sb.static(model, sb.EdgeLoad("top", ty=-5e6))
    uy, force = found.displacement("middle")[1], found.reactions["middle"][1]
    return {"sprung": [float(uy), float(force)], "holders": len(model.layout.point_holders["middle"])}


@pytest.fixture(scope="module")
def on_two():
    """What two ranks find of `held_faces`, `moved`, `shared` and `sprung`."""
    return answer(on_ranks(2, PROGRAM))


def test_contact_with_a_held_face(on_two):
    """Contact forces on nodes that do not move are the support's, on whatever rank they are: in balance with
    the load, and alike on two ranks.
    """
    one = held_faces()
    for face in ("crack1_right", "crack1_left"):
        forces = [one[f"{name} beside {face}"] for name in ("left", face)]
        assert np.sum(forces, axis=0) == pytest.approx([0.0, -3000.0], abs=1e-8 * 3000.0)
    for name, force in one.items():
        assert on_two[name] == pytest.approx(force, abs=1e-6 * 3000.0)


def test_an_end_that_is_moved(on_two):
    """Timoshenko's beam, u = F (L^3 / 3 E I + L / (5/6 G A)): to the clamp's Poisson effect; alike on two
    ranks.
    """
    one = moved()["moved"]
    bending, shear = 0.1**3 / (3.0 * 210e9 * 0.005**3 / 12.0), 0.1 / (5.0 / 6.0 * 210e9 / 2.6 * 0.005)
    assert one == pytest.approx([0.0, 1e-5 / (bending + shear)], rel=3e-3, abs=1e-9)
    assert on_two["moved"] == pytest.approx(one, rel=1e-9, abs=1e-9)


def test_nodes_of_several_supports(on_two):
    """A node of two supports counts once: together they carry the load. Alike on two ranks."""
    one = shared()
    total = np.sum(list(one.values()), axis=0)
    assert np.abs(total + APPLIED).max() < 1e-10 * np.abs(APPLIED).max()
    for name, force in one.items():
        assert on_two[name] == pytest.approx(force, abs=1e-9 * np.abs(APPLIED).max())


def test_springs_and_thickness(on_two):
    """Stiffnesses of edges are of a unit of thickness, of a point the whole: with that in proportion to the
    thickness displacements are the same. The point's spring is one on two ranks that have it.
    """
    (thin, force), (thick, _) = sprung(0.02)["sprung"], sprung(1.0)["sprung"]
    assert thin == pytest.approx(thick, rel=1e-12) and thin < -1e-6
    assert force == pytest.approx(-1e11 * 0.02 * thin, rel=1e-12)
    assert on_two["sprung"] == pytest.approx([thin, force], rel=1e-9) and on_two["holders"] == 2
