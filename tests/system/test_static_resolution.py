"""Errors of displacements at rest estimated cell by cell, and the warnings, against scikit-fem and beams."""

import functools
import re
import warnings

import numpy as np
import pytest
from skfem import Basis, BilinearForm, ElementQuadP, ElementVector, LinearForm, MeshQuad, condense, solve
from skfem.helpers import ddot, eye, sym_grad, trace

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate
from sbfem_petsc.analysis.static import at_rest
from sbfem_petsc.system.fields import static_resolution
from sbfem_petsc.system.fields.static_resolution import WARNED, static_error, warn_of_rest
from tests.parallel import alone, answer, on_ranks
from tests.systems import ALUMINIUM

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
RUBBER = sb.Material(1e9, 0.4999, 1000.0, plane="strain")
MATERIALS = {"aluminium": ALUMINIUM, "rubber": RUBBER}
SHEAR, WEIGHT = sb.EdgeLoad("edge3", tx=1e6), sb.SupportMotion(ay=9.81)
LIFTED = sb.EdgeMotion("edge3", uy=1e-4)


@functools.cache
def block(material: str, load: sb.EdgeLoad | sb.SupportMotion | sb.EdgeMotion) -> float:
    """Strain energy, J, of the unit square on a clamped edge by scikit-fem: elements of order 4, halved
    nine times towards the corners, whose stresses are singular.
    """
    given, fine = MATERIALS[material], 0.25 * 0.5 ** np.arange(9, 0, -1)
    places = np.concatenate([[0.0], fine, [0.25, 0.5, 0.75], 1.0 - fine[::-1], [1.0]])
    basis = Basis(MeshQuad.init_tensor(places, places), ElementVector(ElementQuadP(4)), intorder=9)
    nu, shear = given.poisson, given.young / (2 * (1 + given.poisson))
    first = given.young * nu / (1 - nu**2 if given.plane == "stress" else (1 + nu) * (1 - 2 * nu))

    @BilinearForm
    def stiffness(u, v, w):
        return ddot(2 * shear * sym_grad(u) + eye(first * trace(sym_grad(u)), 2), sym_grad(v))

    k, force, values = stiffness.assemble(basis), np.zeros(basis.N), np.zeros(basis.N)
    held = basis.get_dofs(lambda at: at[1] < 1e-12).all()
    if isinstance(load, sb.EdgeMotion):
        top = basis.get_dofs(lambda at: at[1] > 1 - 1e-12).all()
        held = np.concatenate([held, top])
        uniform = basis.project(lambda at: np.stack([0 * at[0], load.uy + 0 * at[0]]))
        values[top] = uniform[top]
    elif isinstance(load, sb.EdgeLoad):
        edge = basis.boundary(lambda at: at[1] > 1 - 1e-12)
        force = LinearForm(lambda v, w: load.tx * v[0]).assemble(edge)
    else:
        force = LinearForm(lambda v, w: -given.density * load.ay * v[1]).assemble(basis)
    u = solve(*condense(k, force, x=values, D=held))
    return 0.5 * float(u @ (k @ u))


def told_of(found: sb.Static) -> float:
    return static_error(found.model.statics, at_rest("static", found))


def solved(mesh, load, material=ALUMINIUM, **options) -> tuple[sb.Static, list[str]]:
    """A static solution and what is said of it."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = sb.static(sb.Model(mesh, material, **options), load)
    ours = [str(one.message) for one in said if "under the loads is too small" in str(one.message)]
    return found, ours


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
@pytest.mark.parametrize(
    ("material", "load"),
    [("aluminium", SHEAR), ("rubber", SHEAR), ("aluminium", WEIGHT), ("aluminium", LIFTED)],
    ids=["shear", "rubber", "weight", "motion"],
)
def test_errors_of_a_block(material, load, order):
    """Within a factor of 2 of scikit-fem's, from 11 % to 1e-5, and told where it is above a thousandth."""
    options = {"clamped": "edge1"}
    if load is LIFTED:
        held = [sb.Support(edge, x=True, y=True) for edge in ("edge1", "edge3")]
        options = {"clamped": None, "supports": held}
    found, said = solved(Plate(SQUARE).mesh(order=order, size=0.3), load, MATERIALS[material], **options)
    share = found.strain_energy / block(material, load)
    error = share - 1.0 if load is LIFTED else 1.0 - share
    told = told_of(found)
    assert error / 2 < told < 2 * error
    assert len(said) == (told > WARNED)


CANTILEVER = [(1, {}), (1, {"size": 0.005}), (1, {"size": 0.0025}), (2, {"size": 0.04})]


@pytest.mark.parametrize(("order", "options"), CANTILEVER, ids=str)
def test_errors_of_a_slender_beam(order, options):
    """Within a factor of 2 of Timoshenko's, whose clamped end is right to a few 1e-4 of the whole: 63 % in
    the first order on the default mesh.
    """
    length, height, traction = 0.2, 0.01, 1e5
    force, bending = traction * height, ALUMINIUM.young * height**3 / 12
    shear = 5 / 6 * ALUMINIUM.young / (2 * (1 + ALUMINIUM.poisson)) * height
    exact = force * length**3 / (3 * bending) + force * length / shear
    load = sb.EdgeLoad("right", ty=traction)
    found, said = solved(Beam(length, height).mesh(order=order, **options), load)
    error = 1.0 - found.displacement("A")[1] / exact
    assert error / 2 < told_of(found) < 2 * error
    (told,) = [re.search(r"too small by about (\S+) of itself", one) for one in said]
    assert told and error / 2.2 < float(told[1]) < 2.2 * error  # one digit


def test_pressure_and_order():
    """A uniform load bends a cantilever by q L^4 / 8 EI (and q L^2 / 2 kGA): a part of it acts on the
    further polynomials of the first order.
    """
    length, height, q = 0.2, 0.01, 1e5
    bending, nu = ALUMINIUM.young * height**3 / 12, ALUMINIUM.poisson
    exact = q * length**4 / (8 * bending) + q * length**2 / (5 / 6 * ALUMINIUM.young / (1 + nu) * height)
    mesh = Beam(length, height).mesh(order=1, size=0.004)
    found, _ = solved(mesh, sb.EdgeLoad("top", pressure=q))
    error = 1.0 + found.displacement("A")[1] / exact
    assert 0.01 < error < 0.1 and error / 2 < told_of(found) < 2 * error


@pytest.mark.slow
def test_where_crack_faces_press():
    """A closed crack and an open one in tension, of order 1 to 3, within a factor of 2 of order 9."""
    plate = Plate([(0, 0), (1, 0), (1, 2), (0, 2)], cracks=[CrackLine([(0, 1), (0.4, 1)], name="c")])
    for traction in (1e6, -1e6):
        load, options = sb.EdgeLoad("edge3", ty=traction), {"clamped": "edge1"}
        exact = solved(plate.mesh(order=9, size=0.4), load, **options)[0].strain_energy
        for order in (1, 2, 3):
            found, _ = solved(plate.mesh(order=order, size=0.4), load, **options)
            error = 1.0 - found.strain_energy / exact
            assert error / 2 < told_of(found) < 2 * error
            assert found.active.any() == (traction < 0)


@pytest.mark.parametrize("order", [3, 5])
def test_single_forces_are_not_blamed_on_the_mesh(order):
    """A point force and supports on points have no limit, of which higher orders say nothing."""
    points = {"P": (0, 0), "Q": (1, 0), "T": (0.5, 1)}
    mesh = Plate(SQUARE).mesh(order=order, size=0.3, points=points)
    held = [sb.Support("P", x=True, y=True), sb.Support("Q", y=True)]
    assert not solved(mesh, sb.EdgeLoad("edge3", ty=1e6), clamped=None, supports=held)[1]
    assert not solved(mesh, sb.PointForce("T", fy=1e3), clamped="edge1")[1]


def test_a_single_force_on_an_edge_that_is_pulled():
    """Its S-elements are left out with their loads: no more is told than without it."""
    mesh = Plate(SQUARE).mesh(order=2, size=0.3, points={"T": (0.5, 1)})
    pulled, with_force = (
        told_of(solved(mesh, load, clamped="edge1")[0])
        for load in (SHEAR, SHEAR + sb.PointForce("T", fx=1.0))
    )
    assert 0.5 * pulled < with_force < pulled


@pytest.mark.parametrize("order", [1, 2, 5])
def test_nothing_is_told_of_what_is_not_strained(order):
    """All supports move alike; no load at all."""
    held = [sb.Support(edge, x=True, y=True) for edge in ("edge1", "edge3")]
    moved = sb.EdgeMotion("edge1", ux=1e-4) + sb.EdgeMotion("edge3", ux=1e-4)
    mesh = Plate(SQUARE).mesh(order=order, size=0.3)
    assert not solved(mesh, moved, clamped=None, supports=held)[1]
    assert not solved(mesh, sb.EdgeLoad("edge3", ty=0.0), clamped=None, supports=held)[1]


def test_a_history_is_told_of_its_worst_state():
    """Once, and with its time."""
    model = sb.Model(Beam(0.2, 0.01).mesh(order=1), ALUMINIUM)
    ramp = sb.Samples([0.0, 1.0, 2.0], [0.0, 1e5, 1e5])
    pull = sb.EdgeLoad("right", tx=1e5) + sb.EdgeLoad("right", ty=ramp)
    with pytest.warns(sb.MeshWarning, match="load_history, at 2 s: the displacement") as said:
        found = sb.load_history(model, pull, [0.0, 0.01, 2.0])
    assert len(said) == 1
    assert told_of(found.states[0]) < told_of(found.states[1]) < told_of(found.states[2])


def test_the_worst_state_is_not_that_in_most_doubt():
    """Pressure alone is off more than pressure beside shear, whose sum is in thrice as much doubt."""
    model = sb.Model(Plate(SQUARE).mesh(order=2, size=0.3), ALUMINIUM, clamped="edge1")
    shear = sb.EdgeLoad("edge3", tx=sb.Samples([0.0, 1.0], [1e6, 0.0]))
    with pytest.warns(sb.MeshWarning, match="load_history, at 1 s: .* too small by about 0.005") as said:
        found = sb.load_history(model, shear + sb.EdgeLoad("edge2", pressure=1e6), [0.0, 1.0])
    assert len(said) == 1
    assert told_of(found.states[0]) < 0.7 * told_of(found.states[1])


def test_accuracy_is_not_warned_of():
    """`accuracy=` refines until the error is none."""
    model = sb.Model(Beam(0.02, 0.01).mesh(order=2), ALUMINIUM)
    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.MeshWarning)
        found = sb.static(model, sb.EdgeLoad("right", ty=1e5), accuracy=1e-3)
        warn_of_rest(found.model, [at_rest("static", found)])


def test_states_of_one_load_are_looked_at_once(monkeypatch):
    """A large mesh takes seconds for one; another load is another state."""
    looked_at = []
    monkeypatch.setattr(
        static_resolution, "static_error", lambda *given: looked_at.append(1) or static_error(*given)
    )
    model = sb.Model(Beam(0.2, 0.01).mesh(order=1), ALUMINIUM)
    for load in (1e5, 2e5, -1e4):
        with pytest.warns(sb.MeshWarning, match="is too small by about 0.4 of itself"):
            sb.static(model, sb.EdgeLoad("right", ty=load))
    assert len(looked_at) == 1
    sb.static(model, sb.EdgeLoad("right", tx=1e5))
    assert len(looked_at) == 2


def test_another_load_in_as_much_doubt():
    """It is told its own error, not that of the load before it."""
    model = sb.Model(Plate(SQUARE).mesh(order=2, size=0.3), ALUMINIUM, clamped="edge1")
    doubts, errors = [], []
    for beside in (sb.EdgeLoad("edge2", pressure=-1e6), sb.EdgeLoad("edge2", ty=4.98e5)):
        with pytest.warns(sb.MeshWarning, match="too small") as said:
            found = sb.static(model, SHEAR + beside)
        doubts.append(static_resolution._doubts(model.statics, [at_rest("static", found)])[0][0])
        errors.append(told_of(found))
        assert f"by about {errors[-1]:.1g} of itself" in str(said[0].message)
    assert doubts[1] == pytest.approx(doubts[0], rel=0.2 * static_resolution.ALIKE)
    assert errors[1] < 0.7 * errors[0]


def test_forces_on_points_are_said_to_be_left_out():
    """S-elements at them are: an estimate without them is much too small for a body held on two corners."""
    supports = [sb.Support("O", True, True), sb.Support("P", False, True)]
    mesh = Plate(SQUARE).mesh(order=1, size=0.2, points={"O": (0, 0), "P": (1, 0)})
    _, said = solved(mesh, SHEAR, clamped=None, supports=supports)
    assert said[0].endswith("; what forces on points ('O', 'P') add next to these is not in it")


def test_no_element_is_left_to_look_at():
    """All have a single force on them."""
    points = {"P": (0.5, 0.5), "Q": (0, 0), "R": (1, 0), "S": (1, 1), "T": (0, 1)}
    mesh = Plate(SQUARE).mesh(order=2, size=2, points=points)
    forces = [sb.PointForce(name, fx=1e5) for name in points]
    found, _ = solved(mesh, sum(forces, SHEAR), clamped="edge1")
    assert told_of(found) == 0.0


PROGRAM = """
import json, warnings
import sbfem_petsc as sb
from meshing import CrackLine, Plate
from sbfem_petsc.analysis.static import at_rest
from sbfem_petsc.system.fields.static_resolution import static_error

warnings.simplefilter("ignore")
plate = Plate([(0, 0), (1, 0), (1, 2), (0, 2)], cracks=[CrackLine([(0, 1), (0.4, 1)], name="c")])
mesh = plate.mesh(order=1, size=0.3, points={"P": (1, 1.4)})
model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), clamped="edge1")
load = sb.EdgeLoad("edge3", ty=-1e6, tx=3e5) + sb.PointForce("P", fx=1e5) + sb.SupportMotion(ax=9e3)
found = sb.static(model, load)
error = static_error(model.statics, at_rest("static", found))
if model.comm.rank == 0:
    print(json.dumps({"error": error, "touching": int(found.active.sum())}))
"""


@pytest.mark.slow
def test_edges_between_ranks():
    one, three = alone(PROGRAM), answer(on_ranks(3, PROGRAM))
    assert one["touching"] == three["touching"] > 0
    assert three["error"] == pytest.approx(one["error"], rel=1e-6) and one["error"] > WARNED
