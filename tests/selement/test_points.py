"""Point evaluation against exact fields: location, displacement, stress, turned copies, loaded faces."""

import numpy as np
import pytest

from meshing.gll import gll_nodes, shape_functions
from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement.congruence import placements
from sbfem_petsc.selement.face_tractions import face_tractions, single_face_directions
from sbfem_petsc.selement.points import locate, point_operators
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement
from tests.selement.test_solution import polygon

ISOTROPIC = Material(1.0, 0.3, 1.0)
ORTHOTROPIC = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=30.0)
PENTAGON = np.array([[-1.0, -0.7], [0.9, -1.0], [1.2, 0.3], [0.2, 1.1], [-0.8, 0.9]]) / 1.3
TIP = np.array([[1, 0], [1, 0.8], [-0.4, 1.1], [-1.2, -0.3], [-0.2, -0.9], [0.9, -0.8], [1, 0]]) / 1.3
NOTCH = TIP.copy()
NOTCH[[0, -1], 1] = np.tan(np.radians(20.0)) * NOTCH[0, 0] * np.array([1.0, -1.0])
GRADIENT = np.array([[1.0, 0.4], [-0.2, -0.3]])


def disc(order):
    angles = np.concatenate(
        [a + 0.25 * np.pi * (1 + gll_nodes(order)[:-1]) for a in 0.5 * np.pi * np.arange(4)]
    )
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * 0.8 + [0.1, 0.05]


@pytest.mark.slow
@pytest.mark.parametrize(
    "shape, order, closed",
    [(polygon(PENTAGON, 3), 3, True), (disc(6), 6, True), (polygon(NOTCH, 4, False), 4, False)],
    ids=["pentagon", "disc", "notch"],
)
def test_location(shape, order, closed):
    """Scaled boundary coordinates give the points back; points outside, or in the notch, are told."""
    generator = np.random.default_rng(2)
    points = generator.uniform(-1.2, 1.2, (300, 2))
    found = locate(shape, order, closed, points)
    inside = found.edge >= 0
    assert 60 < inside.sum() < 290
    nodes = (np.arange(order + 1) + order * found.edge[:, None]) % len(shape)
    for point, chain, eta, level, ok in zip(points, nodes, found.eta, found.level, inside):
        if ok:
            at = level * shape_functions(order, [eta])[0][0] @ shape[chain]
            assert np.abs(at - point).max() < 1e-12 and 0.0 <= level <= 1.0
        else:
            angle = abs(np.degrees(np.arctan2(point[1], point[0])))
            beyond = locate(shape, order, closed, (point / 3.0)[None]).edge[0] >= 0
            assert beyond or (not closed and angle < 20.0)


def test_vertices_and_centre():
    shape = polygon(PENTAGON, 4)
    found = locate(
        shape, 4, True, np.concatenate([shape, np.zeros((1, 2)), shape * (1 + 1e-10), shape * 1.01])
    )
    n = len(shape)
    np.testing.assert_allclose(found.level[:n], 1.0, atol=1e-12)
    assert found.level[n] == 0.0 and found.edge[n] >= 0
    assert (found.edge[: 2 * n + 1] >= 0).all() and (found.edge[2 * n + 1 :] == -1).all()


def test_faces_of_a_closed_crack():
    shape = polygon(TIP, 3, closed=False)
    on = np.array([[0.3, 0.0]])
    assert locate(shape, 3, False, on).edge[0] == 0
    assert locate(shape, 3, False, np.array([[0.3, -1e-6]])).edge[0] == 5


@pytest.mark.parametrize("material", [ISOTROPIC, ORTHOTROPIC], ids=["isotropic", "orthotropic"])
@pytest.mark.parametrize("shape, order", [(polygon(PENTAGON, 3), 3), (disc(6), 6)], ids=["pentagon", "disc"])
def test_linear_field(shape, order, material):
    """A linear displacement and its stress, centre and boundary included."""
    element = solve_selement(Sectors(shape, order, material.elasticity), True)
    points = np.concatenate([0.4 * np.random.default_rng(0).uniform(-1, 1, (70, 2)), [[0.0, 0.0]], shape[:2]])
    rows = point_operators(
        element.radial,
        Sectors(shape, order, material.elasticity),
        located=locate(shape, order, True, points),
        closed=True,
    )
    u = (shape @ GRADIENT.T + [0.5, -2.0]).ravel()
    np.testing.assert_allclose(rows.displacement @ u, points @ GRADIENT.T + [0.5, -2.0], atol=1e-12)
    strain = [GRADIENT[0, 0], GRADIENT[1, 1], GRADIENT[0, 1] + GRADIENT[1, 0]]
    exact = np.tile(material.elasticity @ strain, (len(points), 1))
    np.testing.assert_allclose(rows.stress @ u, exact, atol=1e-9)
    with pytest.raises(ValueError, match="lies outside"):
        point_operators(
            element.radial,
            Sectors(shape, order, material.elasticity),
            located=locate(shape, order, True, np.array([[3.0, 0.0]])),
            closed=True,
        )


@pytest.mark.parametrize("mirrored", [False, True])
def test_turned_copy(mirrored):
    """A placed, scaled and reflected copy: bending of a beam in its own frame, at points of its own."""
    order, size, turn = 3, 0.02, 0.7
    c, s = np.cos(turn), np.sin(turn)
    outline = size * polygon(PENTAGON, order) @ np.array([[c, s], [-s, c]])
    if mirrored:
        outline = np.roll((outline * [-1, 1])[::-1], 1, axis=0)
    placement = placements(outline[None], order, True, True)[0]
    element = solve_selement(Sectors(placement.shape, order, ISOTROPIC.elasticity), True)
    points = 0.35 * size * np.random.default_rng(1).uniform(-1, 1, (20, 2))
    located = locate(placement.shape, order, True, points @ placement.rotation.T / placement.size)
    rows = point_operators(
        element.radial, Sectors(placement.shape, order, ISOTROPIC.elasticity), located=located, closed=True
    ).turned(placement.rotation)

    def bending(x, y):
        return np.stack([-x * y, 0.5 * (x**2 + 0.3 * y**2)], axis=-1)

    u = bending(*outline[placement.permutation].T).ravel()
    np.testing.assert_allclose(rows.displacement @ u, bending(*points.T), atol=1e-15)
    stress = rows.stress @ u / placement.size
    np.testing.assert_allclose(stress[:, 0], -points[:, 1], atol=1e-11)
    np.testing.assert_allclose(stress[:, 1:], 0.0, atol=1e-11)


@pytest.mark.parametrize("corners", [TIP, NOTCH], ids=["crack", "notch"])
@pytest.mark.parametrize("material", [ISOTROPIC, ORTHOTROPIC], ids=["isotropic", "orthotropic"])
def test_loaded_faces(corners, material):
    """A uniform stress with its tractions on the faces is uniform at points next to the tip too."""
    order = 4
    shape = polygon(corners, order, closed=False)
    element = solve_selement(Sectors(shape, order, material.elasticity), False)
    tractions = face_tractions(
        Sectors(shape, order, material.elasticity),
        stiffness=element.stiffness,
        radial=element.radial,
        directions=np.concatenate([single_face_directions(0), single_face_directions(1)]),
        modes=2,
    )
    stress = np.array([0.4, 1.0, 0.7])
    tensor = stress[[[0, 2], [2, 1]]]
    first, last = (shape[i] / np.linalg.norm(shape[i]) for i in (0, -1))
    normals = np.array([[first[1], -first[0]], [-last[1], last[0]]])
    force = tractions.uniform_force((normals @ tensor).ravel())
    strain = np.linalg.solve(material.elasticity, stress)
    gradient = np.array([[strain[0], 0.5 * strain[2]], [0.5 * strain[2], strain[1]]])
    points = np.array([[-0.5, 0.1], [0.1, 0.4], [1e-4, -2e-4], [-1e-5, 0.0], [0.0, 0.0]])
    rows = point_operators(
        element.radial,
        Sectors(shape, order, material.elasticity),
        located=locate(shape, order, False, points),
        closed=False,
        tractions=tractions,
    )
    state = np.concatenate([(shape @ gradient.T).ravel(), force])
    np.testing.assert_allclose(rows.displacement @ state, points @ gradient.T, atol=1e-12)
    # the displacement's round-off is divided by xi = 1e-5
    np.testing.assert_allclose((rows.stress @ state)[:4], np.tile(stress, (4, 1)), atol=1e-7)
    assert np.isnan(rows.stress[4]).all() and not np.isnan(rows.stress[:4]).any()
