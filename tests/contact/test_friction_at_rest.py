"""Friction at rest: reduced models against all states tried, bodies against published and closed forms."""

import math

import numpy as np
import pytest
from scipy import sparse
from scipy.interpolate import CubicSpline

import sbfem_petsc as sb
from meshing import CrackLine, Plate
from sbfem_petsc.bodies.rows import Row
from sbfem_petsc.contact.friction import Friction, Memory
from sbfem_petsc.contact.law import RowLaws
from tests.contact.test_friction import enumerated


def pressed(rng, coefficients, modes):
    """A random system with rows that rub; its matrices, rows and loads."""
    n, count = 9, len(coefficients)
    root = rng.normal(size=(n, n))
    stiffness, rows = root @ root.T + np.eye(n), rng.normal(size=(2 * count, n))
    loads = rng.normal(size=(n, 2))
    reduced = sb.reduce_matrices(
        np.eye(n),
        stiffness,
        rows[:count],
        np.full(count, 0.05),
        loads=loads,
        sensors={"x": 0, "y": 5, "first": loads[:, 0], "second": loads[:, 1]},
        modes=modes,
        compliance=np.full(count, 0.02),
        tangent_rows=rows[count:],
        tangent_compliance=np.full(count, 0.03),
        contact_laws=[sb.Coulomb(mu) for mu in coefficients],
    )
    return reduced, stiffness, rows, loads


@pytest.mark.parametrize("modes", [9, 4])
def test_histories_against_all_states_tried(modes, monkeypatch):
    """Each state of a history follows from the one before; displacements, energies and losses are those of
    the matrices themselves, whatever number of modes is kept. Rows stick where they stood before.
    """
    of = Memory.of
    monkeypatch.setattr(Memory, "of", lambda found, count: of(found, count)._replace(gap=np.zeros(count)))
    rng, seen = np.random.default_rng(modes), set()
    for _ in range(12):
        coefficients = rng.uniform(0.1, 0.8, 2)
        reduced, stiffness, rows, loads = pressed(rng, coefficients, modes)
        values = rng.normal(size=(7, 2))
        time = np.arange(7.0)
        found = sb.load_history(reduced, [sb.Samples(time, value) for value in values.T], time)
        friction, flexibility = (
            Friction(np.arange(2), coefficients, coefficients),
            np.diag([0.02] * 2 + [0.03] * 2),
        )
        w = rows @ np.linalg.solve(stiffness, rows.T) + flexibility
        memory, lost = Memory.none(RowLaws.unilateral(2), friction), 0.0
        for k, value in enumerate(values):
            free = rows @ np.linalg.solve(stiffness, loads @ value) + [0.05, 0.05, 0.0, 0.0]
            force = enumerated(w, free, friction, memory)
            assert len(force) == 1
            gaps = w @ force[0] + free
            u = np.linalg.solve(stiffness, loads @ value + rows.T @ force[0])
            scale = 1e-9 * np.abs(values).max()
            assert found.contact_force[k] == pytest.approx(force[0][:2], abs=scale)
            assert found.friction_force[k] == pytest.approx(force[0][2:], abs=scale)
            assert found.gap[k] == pytest.approx(gaps[:2], abs=scale)
            assert found.slip[k] == pytest.approx(gaps[2:], abs=scale)
            assert found.point_displacements[k, :2] == pytest.approx(u[[0, 5]], abs=scale)
            energy = 0.5 * (u @ stiffness @ u + force[0] @ flexibility @ force[0])
            assert found.strain_energy[k] == pytest.approx(energy, abs=scale)
            begun = np.maximum(coefficients * memory.pressing, np.abs(memory.force))
            moved = np.abs(gaps[2:] - memory.slip)
            lost += 0.5 * (begun + np.abs(force[0][2:])) @ moved
            assert found.friction_loss[k] == pytest.approx(lost, abs=scale)
            seen.update(zip(force[0][:2] > 0.0, moved > 1e-12))
            memory = memory._replace(slip=gaps[2:], force=force[0][2:], pressing=force[0][:2])
        first = sb.static(reduced, list(values[0]))
        # slips of several states come out of one product, which is rounded otherwise
        assert first.slip == pytest.approx(found.slip[0], rel=1e-13)
        assert first.friction_loss == found.friction_loss[0]
        assert np.array_equal(first.friction_force, found.friction_force[0])
    assert seen == {(False, True), (True, True), (True, False)}


@pytest.mark.parametrize("states", [2, 3, 8])
@pytest.mark.parametrize("pull", [0.5, 0.8, 1.5])
def test_where_rows_land(pull, states):
    """A point that comes down aslant on layers, in closed form: in however many states it does so, it sticks
    where it lands, beyond the coefficient of slips too, or has slid from there.
    """
    body = sb.reduce_matrices(
        np.eye(2),
        np.eye(2),
        [[1.0, 0.0]],
        [0.3],
        loads=np.eye(2),
        sensors={"x": 0, "y": 1},
        compliance=[0.1],
        contact_laws=sb.Coulomb(0.6, 0.9),
        tangent_rows=[[0.0, 1.0]],
        tangent_compliance=[0.1],
    )
    time = np.linspace(0.0, 1.0, states)
    found = sb.load_history(body, [sb.Samples(time, -time), sb.Samples(time, pull * time)], time)
    pressure = (1.0 - 0.3) / 1.1
    friction = pull * pressure if pull <= 0.9 else 0.6 * pressure
    assert found.contact_force[-1, 0] == pytest.approx(pressure)
    assert found.friction_force[-1, 0] == pytest.approx(-friction)
    slip = pull - 1.1 * friction
    assert found.slip[-1, 0] == pytest.approx(slip)
    lost = 0.5 * friction * (slip - 0.3 * pull) if pull > 0.9 else 0.0
    assert found.friction_loss[-1] == pytest.approx(lost)


def test_results_are_kept(tmp_path):
    """Slips, friction and losses in files and tables; a system without friction has none."""
    reduced, *_ = pressed(np.random.default_rng(3), np.array([0.3, 0.5]), 9)
    found = sb.load_history(reduced, [sb.Samples([0.0, 1.0], [1.0, -2.0]), 2.0], [0.0, 0.5, 1.0])
    sb.save(tmp_path / "results.h5", {"history": found, "state": sb.static(reduced, [1.0, 2.0])})
    read = sb.read(tmp_path / "results.h5")
    for name in ("slip", "friction_force", "friction_loss"):
        assert np.array_equal(getattr(read["history"], name), getattr(found, name)), name
    assert read["state"].slip == pytest.approx(found.slip[0], rel=1e-12)
    apart = sb.static(reduced, [1.0, 2.0], contact=False)
    assert not apart.friction_force.any() and apart.friction_loss == 0.0 and apart.slip.any()


def test_work_of_slow_loads():
    """What loads do and what is not stored is lost to friction, the better the closer the states."""
    errors = []
    for count in (100, 800):
        rng = np.random.default_rng(3)
        reduced, _, _, loads = pressed(rng, rng.uniform(0.1, 0.8, 2), 5)
        time = np.linspace(0.0, 6.0, count + 1)
        path = CubicSpline(np.arange(7.0), 4.0 * rng.normal(size=(7, 2)))(time)
        path -= path[0] * np.exp(-5.0 * time)[:, None]
        found = sb.load_history(reduced, [sb.Samples(time, values) for values in path.T], time)
        moved = np.stack([found.displacement(name) for name in ("first", "second")], axis=1)
        work = (0.5 * (path[1:] + path[:-1]) * np.diff(moved, axis=0)).sum()
        stored, lost = found.strain_energy[-1] - found.strain_energy[0], found.friction_loss
        assert (np.diff(lost) >= 0.0).all() and lost[-1] > 0.05 * work
        errors.append(abs(work - stored - (lost[-1] - lost[0])) / lost[-1])
    assert errors[1] < 1e-3 and errors[1] < 0.3 * errors[0]


# ---------------------------------------------------------------------- bodies
def block(cells):
    """SSNV128's plate by scikit-fem: the body, whose foot stands on a plane, and its load."""
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    line = np.linspace(0.0, 0.04, cells + 1)
    mesh = skfem.MeshQuad.init_tensor(line, line)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad1()))
    stiffness = linear_elasticity(*lame_parameters(130e9, 0.2)).assemble(basis).tocsr()
    mass = skfem.BilinearForm(lambda u, v, _: 7800.0 * dot(u, v)).assemble(basis).tocsr()

    def on(axis, place):
        return skfem.FacetBasis(
            mesh, basis.elem, facets=mesh.facets_satisfying(lambda x: np.isclose(x[axis], place))
        )

    load = skfem.LinearForm(lambda v, w: -50e6 * v[1]).assemble(on(1, 0.04))
    load += skfem.LinearForm(lambda v, w: 150e6 * v[0]).assemble(on(0, 0.0))
    place = np.zeros((basis.N, 2), int)
    for d in range(2):
        place[basis.nodal_dofs[d]] = np.stack([np.arange(mesh.p.shape[1]), np.full(mesh.p.shape[1], d)], 1)
    held = np.isclose(mesh.p[0], 0.04)
    free = np.flatnonzero(~(held[place[:, 0]] & (place[:, 1] == 0)))
    # a spring that holds it until the plane does
    corner = np.flatnonzero((place[:, 1] == 1) & held[place[:, 0]])[-1]
    stiffness[corner, corner] += 1e5
    body = sb.FiniteElementModel(
        mass[free][:, free],
        stiffness[free][:, free],
        place[free],
        {k: (*x, 0.0) for k, x in enumerate(mesh.p.T)},
        sets={"foot": np.flatnonzero(np.isclose(mesh.p[1], 0.0))},
        fixed=[(int(k), 0) for k in np.flatnonzero(held)],
    )
    return body, Row(sparse.csr_matrix(load[free][None]))


def test_plate_on_a_rough_plane():
    """F3, SSNV128: published to 1 %, converged values to 1e-3; the node that is held along the plane slides
    nowhere.
    """
    body, load = block(32)
    foot = body.contact("foot", normal=(0, -1, 0), law=sb.Coulomb(1.0))
    assert [law.rubs for law in foot.laws].count(False) == 1
    reduced = sb.reduce(
        body, contact=foot, loads={"push": load}, points={"end": body.at((0, 0, 0), "x")}, modes=4
    )
    found = sb.static(reduced, 1.0)
    x = np.array([body.places[body._node[label], 0] for label in body.sets["foot"]])
    # the plane's slip against the body, along the normal turned clockwise, -x, is the body's along x
    slip = np.interp([0.0, 1.25e-3, 5e-3, 7.5e-3, 11.25e-3], np.sort(x), found.slip[np.argsort(x)])
    assert slip == pytest.approx([28.603e-6, 27.226e-6, 22.868e-6, 19.808e-6, 15.414e-6], rel=1e-3)
    assert found.displacement("end") == pytest.approx(28.603e-6, rel=1e-3)
    assert found.contact_resultant == pytest.approx(2.0e6, rel=1e-3)
    assert found.friction_force.sum() == pytest.approx(-1.40538e6, rel=1e-3)
    assert found.friction_loss > 0.0


def test_bodies_that_do_not_rub_by_rows():
    """Faces that slide in two directions, laws with layers, nodes held across the faces, and no laws."""
    unknowns = [(node, d) for node in (1, 2, 3) for d in range(3)]
    nodes = {1: (0, 0, 0), 2: (1, 0, 0), 3: (0, 0, 1)}

    def body(fixed=()):
        held = [pair for pair in unknowns if pair not in fixed]
        return sb.FiniteElementModel(
            sparse.eye(len(held), format="csr"),
            1e6 * sparse.eye(len(held), format="csr"),
            held,
            nodes,
            sets={"foot": [1, 2]},
            fixed=list(fixed),
        )

    wall = dict(normal=(0, -1, 0))
    with pytest.raises(ValueError, match=r"Coulomb\(.*\) rubs, and its faces slide in two directions"):
        body().contact("foot", **wall, law=sb.Coulomb(0.3))
    with pytest.raises(ValueError, match="is a layer in m.3/N"):
        body().contact("foot", **wall, law=sb.Coulomb(0.3, compliance=1e-9))
    with pytest.raises(TypeError, match="contact: law = 0.3 must be a contact law"):
        body().contact("foot", **wall, law=0.3)
    plane = [(1, 2), (2, 2)]
    with pytest.raises(ValueError, match="node 2 is held across the faces but slides"):
        body([*plane, (2, 1)]).contact("foot", **wall, law=sb.Coulomb(0.3))
    found = body(plane).contact("foot", **wall, law=sb.Coulomb(0.3))
    assert found.slips.toarray()[0] @ np.arange(7.0) == 0.0 and abs(found.slips).sum() == 2.0
    # held along x instead, they slide along z; laws stay with their pairs
    along = body([(1, 0), (2, 0)]).contact("foot", **wall, law=sb.Coulomb(0.3))
    tied = body([(1, 0), (2, 0)]).contact([3], normal=(0, 0, -1), law=sb.Tied())
    both = along + tied
    assert both.laws == (sb.Coulomb(0.3), sb.Coulomb(0.3), sb.Tied()) and both.slips.shape == (3, 7)
    assert sb.reduce(
        body([(1, 0), (2, 0)]),
        contact=both,
        loads={"p": body([(1, 0), (2, 0)]).at(1, "y")},
        points={"p": body([(1, 0), (2, 0)]).at(1, "y")},
        modes=5,
    ).friction.kinetic.tolist() == [0.3, 0.3, 0.0]


def test_block_on_an_incline():
    """F12, NAFEMS CGS-4: the horizontal push that moves a block uphill, (tan a + mu) / (1 - mu tan a) of its
    weight.
    """
    length, height, weight, coefficient, slope = 0.1, 0.01, 1e3, 0.3, 0.1
    cosine, sine = (f(math.atan(slope)) for f in (math.cos, math.sin))
    corners = [(0, -height), (length, -height), (length, 0), (length, height), (0, height), (0, 0)]
    sides = ["base", "right", "right2", "top", "left2", "left"]
    plate = Plate(corners, cracks=[CrackLine([(0, 0), (length, 0)], name="foot")], edge_names=sides)
    held = [sb.Support("base", x=True, y=True), sb.Support("top", x=1e8, y=1e6)]
    steel = sb.Material(210e9, 0.3, 7800)
    ratios, time = np.array([0.0, 0.2, 0.4, 0.412, 0.42, 0.43]), np.arange(6.0)
    push = ratios * weight
    load = sb.EdgeLoad(
        "top",
        tx=sb.Samples(time, (push * cosine - weight * sine) / length),
        pressure=sb.Samples(time, (weight * cosine + push * sine) / length),
    )
    with sb.Model(
        plate.mesh(order=2),
        steel,
        clamped=None,
        supports=held,
        contact_laws={"foot": sb.Coulomb(coefficient)},
    ) as model:
        found = sb.load_history(model, load, time)
    springs = found.reactions[:, list(found.supports).index("top"), 0]
    begun = np.polyfit(springs[-2:], ratios[-2:], 1)[1]
    assert begun == pytest.approx((slope + coefficient) / (1 - coefficient * slope), rel=1e-6)
    assert begun == pytest.approx(0.412371, rel=1e-3)
    moved = np.abs(found.slip.mean(axis=1))
    assert moved[:4].max() < 1e-2 * moved[4]


@pytest.mark.long
def test_cattaneo_and_mindlin():
    """F9: Hertz's parabola pressed, then pushed: half-width of what sticks, from the second moment of the
    friction that is missing to the bound, which is that of a half-ellipse as the pressure's is.
    """
    radius, poisson, side, coefficient = 0.05, 0.3, 0.1, 0.3
    effective = 1.0 / ((1 - poisson**2) * (1 / 210e9 + 1 / 70e9))
    outline = [(-side, -side), (side, -side), (side, 0), (side, side), (-side, side), (-side, 0)]
    ends = [-side, -0.012, 0.012, side]
    lines = [CrackLine([(a, 0), (b, 0)], name=name) for name, a, b in zip("lcr", ends, ends[1:])]
    mesh = Plate(outline, cracks=lines, edge_names=["base", *"abtde"]).mesh(
        size=0.006, face_edges=48, order=3
    )
    for name in "lcr":
        mesh = mesh.with_gap(name, lambda x, y: x**2 / (2 * radius))
    one = sb.Material(2 * effective * (1 - poisson**2), poisson, 7800, plane="strain")
    held = [sb.Support(edge, x=True, y=True) for edge in ("base", "t")]
    laws = {name: sb.Coulomb(coefficient) for name in "lcr"}
    time, shift = np.arange(6.0), 5e-4 * np.array([0.0, 0.0, 0.13, 0.32, 0.62, 1.0])
    press = np.array([0.0, -1.36e-3, *[-1.36e-3] * 4])
    move = sb.EdgeMotion("t", ux=sb.Samples(time, shift), uy=sb.Samples(time, press))
    with sb.Model(mesh, one, clamped=None, supports=held, contact_laws=laws) as model:
        found = sb.load_history(model, move, time)
    x = mesh.nodes[mesh.pairs.nodes].mean(axis=1)[:, 0]
    pushed = []
    for state in found.states[2:]:
        pressure, along = state.contact_force, np.abs(state.friction_force)
        missing, push = coefficient * pressure - along, along.sum() / (coefficient * pressure.sum())
        half_width = 2 * math.sqrt(pressure @ x**2 / pressure.sum())
        assert half_width == pytest.approx(
            math.sqrt(4 * pressure.sum() * radius / (math.pi * effective)), rel=5e-3
        )
        sticks = 2 * math.sqrt(missing @ x**2 / missing.sum())
        assert sticks / half_width == pytest.approx(math.sqrt(1 - push), rel=1e-2)
        pushed.append(push)
    assert pushed[0] < 0.2 and pushed[-1] > 0.7
