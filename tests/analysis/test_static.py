"""Static contact against the independent reference, and the active set against PETSc's variational inequality
solver.
"""

import re
import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from examples.paper.time_scheme import at_rest
from meshing import Beam, CrackLine, Hole, Plate, VNotch
from meshing.warnings import RoundOffWarning
from sbfem_petsc.system.solve import static_solver
from tests.reference import paper_beam, statics

ALUMINIUM = sb.Material(70e9, 0.33, 2700)
CASES = {"x80_mouth2um_nu33": (0.0458366, ALUMINIUM), "x80_total_nu30": (0.06, sb.Material(70e9, 0.30, 2700))}


def errors(solution, reference):
    """Relative errors of u_y(A), u_x(B), u_x(C)."""
    u = reference["u"]
    return (
        np.array(
            [
                solution.displacement("A")[1] / u["A"]["uy"],
                solution.displacement("B")[0] / u["B"]["ux"],
                solution.displacement("C")[0] / u["C"]["ux"],
            ]
        )
        - 1.0
    )


@pytest.fixture(scope="module", params=CASES)
def case(request):
    opening, material = CASES[request.param]
    return request.param, sb.Model(paper_beam(opening).mesh(), material)


@pytest.mark.parametrize(
    "force, tolerance", [(1, 1e-4), (100, 2e-4), (300, 2e-4), (1000, 2e-4), (-100, 1e-4)]
)
def test_displacements(case, force, tolerance):
    """Default mesh, five loads, two openings; the tolerances are those of the project's statement of
    accuracy.
    """
    name, model = case
    solution = sb.static(model, sb.PointForce("A", fy=float(force)))
    assert np.abs(errors(solution, statics(name, f"{force} N"))).max() < tolerance
    if force < 0:
        assert not solution.active.any()


@pytest.mark.parametrize("force", [100, 300])
def test_default_resultant(case, force):
    """Part of the notch and all of it closed: the contact resultant within 3e-5 on the default mesh (1e-4
    where the contact ends between two pairs), and no stress intensity of the closed tip.
    """
    name, model = case
    solution = sb.static(model, sb.PointForce("A", fy=float(force)))
    exact = statics(name, f"{force} N")["cracks"][0]["resultant"]
    assert solution.contact_resultant == pytest.approx(exact, rel=1e-4 if name == "x80_total_nu30" else 3e-5)
    if name == "x80_mouth2um_nu33":
        assert abs(solution.stress_intensity["crack1"][0]) < 10.0
    assert solution.active.all() == (force == 300)


@pytest.mark.slow
@pytest.mark.parametrize("force", [100, pytest.param(300, marks=pytest.mark.long)])
def test_resultant_of_any_tip(force):
    """Tip elements of 50, 20, 5, 2 and .05 micrometres: the resultant is the same, K_I is none."""
    exact = statics("x80_mouth2um_nu33", f"{force} N")["cracks"][0]["resultant"]
    for tip_size in (5e-5, 2e-5, 5e-6, 2e-6, 5e-8):
        model = sb.Model(paper_beam().mesh(tip_size=tip_size), ALUMINIUM)
        found = sb.static(model, sb.PointForce("A", fy=float(force)))
        assert found.contact_resultant == pytest.approx(exact, rel=3e-5)
        assert abs(found.stress_intensity["crack1"][0]) < 10.0
        model.destroy()


def test_one_pass_tie(case):
    """The paper's scheme ties every penetrating pair and admits tension; the reference has its
    displacements.
    """
    name, model = case
    tied = statics(name, "100 N")["one_shot_tied_u"]
    solution = at_rest(sb.reduce(model, sb.PointForce("A", fy=1.0), modes=10), 100.0)
    assert (solution.force < 0).any()
    assert solution.displacements["A"][1] == pytest.approx(tied["A"][1], rel=2e-4)
    assert solution.displacements["B"][0] == pytest.approx(tied["B"][0], rel=3e-4)


def test_one_factorisation_for_all_loads(monkeypatch):
    """Three loads: the stiffness is factorised once, and solved with once for each contact row."""
    made, solved = [], []
    factorise, of_rows = static_solver.make_ksp, static_solver.LinearSolver.of_rows

    def counted(self, rows, chosen, what):
        found = of_rows(self, rows, chosen, what)
        solved.append(found.shape[1])
        return found

    monkeypatch.setattr(static_solver, "make_ksp", lambda *a, **k: made.append(1) or factorise(*a, **k))
    monkeypatch.setattr(static_solver.LinearSolver, "of_rows", counted)
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.02)]).mesh(order=2)
    with sb.Model(mesh, sb.Material(70e9, 0.33, 2700)) as model:
        for force in (1e3, 1e4, 3e4):
            assert sb.static(model, sb.PointForce("A", fy=force)).contact_resultant > 0.0
        assert made == [1] and sum(solved) == len(model.contact)


def test_complementarity_and_equilibrium(case):
    """Forces >= 0, gaps >= 0, their product zero; the residual of K u = f + G' force at round-off."""
    _, model = case
    solution = sb.static(model, sb.PointForce("A", fy=100.0))
    assert (solution.contact_force >= 0).all() and (solution.gap >= -1e-18).all()
    assert np.abs(solution.contact_force * solution.gap).max() <= 1e-15 * solution.contact_force.max()
    assert 0 < solution.active.sum() < len(solution.gap)
    # K has a condition number of 1e12 here; its residual is relative to the point force
    assert solution.residual < 1e-6


def test_linear_solution_overlaps(case):
    """Without contact the response is linear: 300 N gives 300 times 1 N, and the faces overlap."""
    _, model = case
    one = sb.static(model, sb.PointForce("A", fy=1.0), contact=False)
    many = sb.static(model, sb.PointForce("A", fy=300.0), contact=False)
    np.testing.assert_allclose(many.displacement("A"), 300 * one.displacement("A"), rtol=1e-7)
    assert (many.gap < 0).any() and not many.contact_force.any()


def test_against_snes_variational_inequality(case):
    """The whole problem by SNES VINEWTONRSLS: minimise energy over the gaps' coordinates with gap >= 0."""
    from petsc4py import PETSc

    _, model = case
    load = sb.PointForce("A", fy=100.0)
    active_set = sb.static(model, load)
    free_gap = model.equilibrium(model.load_columns([load]), touching=False).gap
    flexibility = model.compliance.gaps
    count = len(free_gap)
    scale = np.abs(flexibility).max()

    snes = PETSc.SNES().create(PETSc.COMM_SELF)
    jacobian = PETSc.Mat().createDense(
        (count, count), array=(flexibility / scale).copy(), comm=PETSc.COMM_SELF
    )
    jacobian.assemble()
    unit = np.abs(free_gap).max() / scale

    def residual(snes, x, f):
        f.array = flexibility / scale @ x.array_r + free_gap / (scale * unit)

    snes.setType(PETSc.SNES.Type.VINEWTONRSLS)
    snes.setFunction(residual, jacobian.createVecLeft())
    snes.setJacobian(lambda snes, x, j, p: None, jacobian)
    lower, upper = jacobian.createVecRight(), jacobian.createVecRight()
    lower.set(0.0)
    upper.set(1e20)
    snes.setVariableBounds(lower, upper)
    snes.setTolerances(rtol=1e-14, atol=1e-13, max_it=200)
    snes.getKSP().setType("preonly")
    snes.getKSP().getPC().setType("lu")
    x = jacobian.createVecRight()
    snes.solve(None, x)
    assert snes.getConvergedReason() > 0
    found = x.array * unit
    np.testing.assert_allclose(
        found[: len(active_set.contact_force)],
        active_set.contact_force,
        atol=1e-8 * active_set.contact_force.max(),
    )
    assert found.sum() == pytest.approx(active_set.contact_resultant, rel=1e-8)


def test_closed_crack_under_pressure_is_no_crack():
    """opening = 0 in compression along the beam: the crack carries the uniform stress as if it were not
    there, to the tip: pressure, displacement and K_I = 0, whatever the size of the tip element.
    """
    free_y = [sb.Support("left", x=True, y=False), sb.Support("origin", x=False, y=True)]
    for tip_size in (8e-4, 2e-4):
        mesh = Beam(0.1, 0.02, [VNotch(0.05, 0.01, 0.0)]).mesh(
            order=7, tip_size=tip_size, points={"origin": (0.0, 0.0)}
        )
        model = sb.Model(mesh, ALUMINIUM, clamped=None, supports=free_y)
        pressed = sb.static(model, sb.EdgeLoad("right", pressure=1e6))
        assert pressed.active.all()
        assert pressed.contact_resultant == pytest.approx(1e6 * 0.01, rel=1e-9)
        assert pressed.displacement("A")[0] == pytest.approx(-1e6 / 70e9 * 0.1, rel=1e-9)
        open_crack = sb.static(model, sb.EdgeLoad("right", pressure=-1e6))
        assert abs(pressed.stress_intensity["crack1"][0]) < 1e-9 * open_crack.stress_intensity["crack1"][0]


@pytest.mark.slow
def test_point_forces_have_no_limit():
    """Halving the edges moves the loaded point by ln 2 times Flamant's and Michell's logarithm: 2 F / (pi E)
    on a straight edge, F (1 / (a + sin a) + 1 / (a - sin a)) / E at the corner of a = pi / 2. With edges of
    5 mm 6 and 0.3 % are left of what the rest of the plate adds. A load on edges has a limit.
    """
    found = []
    for size in (0.01, 0.005):
        mesh = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)]).mesh(
            3, size, {"M": (0.05, 0.1), "C": (0.1, 0.1)}
        )
        model = sb.Model(mesh, ALUMINIUM, clamped="edge1")
        points = [sb.static(model, sb.PointForce(name, fy=1.0)).displacement(name)[1] for name in "MC"]
        found.append([*points, sb.static(model, sb.EdgeLoad("edge3", ty=10.0)).displacement("M")[1]])
    slopes = np.diff(found, axis=0)[0] * 70e9 / np.log(2.0)
    right = 0.5 * np.pi
    assert slopes[0] == pytest.approx(2.0 / np.pi, rel=0.08)
    assert slopes[1] == pytest.approx(1.0 / (right + 1.0) + 1.0 / (right - 1.0), rel=0.01)
    assert abs(slopes[2]) < 1e-3


@pytest.mark.slow
def test_two_notches_act_apart():
    """Notches 24 heights apart in a cantilever, which is statically determinate: each has the contact forces
    and the opening that it has alone, and what the notches add to the deflection adds up. The default meshes,
    good to 1e-4, differ around a notch: resultants meet 2e-5, openings 4e-4, the pair at the front 3e-4.
    """
    notches = (VNotch(0.08, 0.0025, 0.0458366), VNotch(0.2, 0.0015, 0.02, tilt=10))
    first, second, both, none = (
        sb.static(sb.Model(Beam(0.4, 0.005, held).mesh(), ALUMINIUM), sb.PointForce("A", fy=100.0))
        for held in (notches[:1], notches[1:], notches, ())
    )
    crack = both.model.pairs.crack
    for number, alone, suffix in ((0, first, ""), (1, second, "2")):
        force, own = both.contact_force[crack == number], alone.contact_force
        assert 0 < alone.active.sum() and (both.active[crack == number] == alone.active).all()
        np.testing.assert_allclose(force, own, atol=1e-3 * own.max())
        assert force.sum() == pytest.approx(own.sum(), rel=1e-4)
        opening, own = (
            solution.displacement(right) - solution.displacement(left)
            for solution, right, left in ((both, "B" + suffix, "C" + suffix), (alone, "B", "C"))
        )
        assert np.linalg.norm(opening - own) < 1e-3 * np.linalg.norm(own)
    added = [solution.displacement("A")[1] - none.displacement("A")[1] for solution in (first, second, both)]
    assert min(added) > 0.0 and added[2] == pytest.approx(added[0] + added[1], rel=1e-4)
    # the first notch is not closed along its whole depth: contact, and not geometry alone, decides
    assert not first.active.all()


@pytest.mark.parametrize("ratio, exact", [(0.2, 1.368040), (0.3, 1.661122), (0.5, 2.825465)])
def test_stress_intensity_of_an_edge_crack(ratio, exact):
    """Edge crack in a strip of half-height W under uniform end traction: K_I / (sigma sqrt(pi a)), K_II =
    0.
    """
    mesh = Beam(2.0, 1.0, [VNotch(1.0, ratio, 0.0)]).mesh(
        order=8, size=0.5, tip_size=0.05 * ratio, points={"L": (0, 0), "R": (2.0, 0)}, corners=()
    )
    model = sb.Model(
        mesh, sb.Material(1.0, 0.3, 1.0), clamped=None, supports=[sb.Support("L"), sb.Support("R", x=False)]
    )
    solution = sb.static(model, sb.EdgeLoad("right", tx=1.0) + sb.EdgeLoad("left", tx=-1.0))
    opening, sliding = solution.stress_intensity["crack1"]
    assert opening / np.sqrt(np.pi * ratio) == pytest.approx(exact, rel=1e-6)
    assert abs(sliding) < 1e-9


@pytest.mark.slow
def test_stress_intensity_by_stress_and_by_displacement():
    """The orthotropic path (stress ahead of the tip) with isotropic constants agrees with Williams' modes."""
    mesh = Beam(2.0, 1.0, [VNotch(1.0, 0.4, 0.0, tilt=20)]).mesh(
        order=12, size=0.5, points={"L": (0, 0), "R": (2.0, 0)}, corners=()
    )
    values = []
    for material in (
        sb.Material(1.0, 0.3, 1.0),
        sb.OrthotropicMaterial(1.0, 1.0, 0.3, 1.0 / 2.6, 1.0, angle=30),
    ):
        model = sb.Model(mesh, material, clamped=None, supports=[sb.Support("L"), sb.Support("R", x=False)])
        values.append(
            sb.static(
                model, sb.EdgeLoad("right", tx=1.0) + sb.EdgeLoad("left", tx=-1.0), contact=False
            ).stress_intensity["crack1"]
        )
    np.testing.assert_allclose(values[1], values[0], rtol=2e-5)
    assert abs(values[0][1]) > 0.01 * values[0][0]


@pytest.mark.parametrize(
    "build, sentence",
    [
        (lambda m: sb.static(m, sb.PointForce("Z", fy=1.0)), "point 'Z' does not exist"),
        (lambda m: sb.static(m, sb.EdgeLoad("roof", tx=1.0)), "edge set 'roof' does not exist"),
        (lambda m: sb.static(m, sb.PointForce("A", fy=float("nan"))), "fy = nan"),
        (lambda m: sb.static(m, 300.0), "neither a PointForce nor an EdgeLoad"),
    ],
)
def test_bad_loads(build, sentence):
    model = sb.Model(Beam(0.4, 0.005).mesh(order=2), ALUMINIUM)
    with pytest.raises((ValueError, KeyError, TypeError), match=sentence):
        build(model)


@pytest.mark.parametrize(
    "clamped, supports",
    [(None, ()), (None, [sb.Support("left", x=True, y=False)]), (None, [sb.Support("A")])],
)
def test_statics_without_support(clamped, supports):
    model = sb.Model(Beam(0.4, 0.005).mesh(order=2), ALUMINIUM, clamped=clamped, supports=supports)
    with pytest.raises(ValueError, match="rigid-body motion"):
        sb.static(model, sb.PointForce("A", fy=1.0))


@pytest.mark.parametrize("stiffness", [1e-4, 1e-2, 1.0, 1e3])
def test_softly_held_structure(stiffness):
    """A body on springs along an edge moves as a rigid one: closed form. The springs are down to 1e-15 of its
    stiffness, and refinement keeps the digits; 1e-9 m is what the body itself gives.
    """
    model = sb.Model(
        Beam(1.0, 0.1).mesh(order=3),
        ALUMINIUM,
        clamped=None,
        supports=[sb.Support("left", stiffness, stiffness)],
    )
    found = sb.static(model, sb.PointForce("A", fx=1.0)).displacement("A")[0]
    assert found == pytest.approx(1.0 / (0.1 * stiffness) + 0.05**2 / (stiffness * 0.1**3 / 12.0), rel=1e-7)


@pytest.mark.parametrize(("order", "error"), [(3, 0.15), (5, 6e-3)])
def test_stress_on_a_drawn_circle(order, error):
    """Kirsch's hoop stress at points of the hole's circle, of which two fifths were refused as outside the
    structure. Order 3 is .11 off, order 5 4e-3, of which the plate, 50 diameters wide, has 2e-3 (order 7).
    """
    square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    mesh = Plate(square, holes=[Hole(0.0, 0.0, 0.04)]).mesh(order=order)
    model = sb.Model(mesh, sb.Material(70e9, 0.0, 2700.0), clamped="edge4")
    found = sb.static(model, sb.EdgeLoad("edge2", tx=1.0))
    for angle in np.linspace(0.0, 2.0 * np.pi, 17)[:-1] + 0.1:
        x, y = np.cos(angle), np.sin(angle)
        xx, yy, xy = found.stress((0.02 * x, 0.02 * y))
        hoop = xx * y**2 + yy * x**2 - 2.0 * xy * x * y
        assert hoop == pytest.approx(1.0 - 2.0 * np.cos(2.0 * angle), abs=error)
        with pytest.raises(ValueError, match="lies outside the structure"):
            found.stress((0.0199 * x, 0.0199 * y))


@pytest.mark.parametrize("order", [1, 2])
def test_straight_edges_reach_no_further(order):
    """No point beyond a straight side is taken for one on a curve, as 1 mm below a plate of order 1."""
    mesh = Plate([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]).mesh(order=order)
    found = sb.static(
        sb.Model(mesh, sb.Material(1e9, 0.3, 1000.0), clamped="edge4"), sb.EdgeLoad("edge2", tx=1e6)
    )
    assert found.displacement((0.5, 0.0))[0] > 0.0
    for along in (0.1, 0.3, 0.5, 0.7, 0.9):
        with pytest.raises(ValueError, match="lies outside the structure"):
            found.displacement((along, -0.001))


def test_no_stress_intensity_without_a_tip_element():
    model = sb.Model(paper_beam().mesh(order=3, layout="vertex"), ALUMINIUM)
    assert sb.static(model, sb.PointForce("A", fy=-1.0)).stress_intensity == {}


def test_unknown_point_of_a_solution():
    solution = sb.static(sb.Model(Beam(0.4, 0.005).mesh(order=2), ALUMINIUM), sb.PointForce("A", fy=1.0))
    with pytest.raises(KeyError, match="point 'Z' does not exist; the model has 'A'"):
        solution.displacement("Z")


def test_springs_that_hardly_hold_a_body():
    """Half of a block pressed onto the other half: uniform pressure to the springs' share; where they are too
    soft, round-off within what the warning says.
    """
    plate = Plate([(0, 0), (1, 0), (1, 2), (0, 2)], cracks=[CrackLine([(0, 1), (1, 1)], name="c")])
    mesh = plate.mesh(order=4, face_edges=8)

    def pressures(spring):
        sides = [sb.Support(name, x=True, y=False) for name in ("edge2", "edge4")]
        held = [sb.Support("edge1", x=False, y=True), sb.Support("edge3", x=False, y=spring)]
        model = sb.Model(mesh, sb.Material(70e9, 0.3, 2700), clamped=None, supports=sides + held)
        return sb.static(model, sb.EdgeLoad("edge3", pressure=1e6)).contact_pressure()[1] / 1e6 - 1

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stiff = pressures(1e6)
    assert np.abs(stiff - stiff.mean()).max() < 1e-7 and -1e-4 < stiff.mean() < 0
    with pytest.warns(RoundOffWarning, match="contact pressures may be off by") as said:
        soft = pressures(1.0)
    told = float(re.search(r"off by (\S+) of", str(said[0].message))[1])
    assert told / 100 < np.abs(soft).max() < 3 * told


def test_springs_that_hardly_keep_a_body_from_turning():
    """The other half of a block turns easily too: pressures 75 % off without a word, as neighbouring gaps
    give way much more by that than their faces do.
    """
    plate = Plate([(0, 0), (1, 0), (1, 0.2), (0, 0.2)], cracks=[CrackLine([(0.5, 0), (0.5, 0.2)], name="c")])
    mesh, off = plate.mesh(order=3, face_edges=6), []
    for spring, says in ((1e-2, True), (10.0, True), (1e4, False)):
        support = sb.Support("edge2", x=spring, y=1e9)
        model = sb.Model(mesh, sb.Material(70e9, 0.0, 2700), clamped="edge4", supports=[support])
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            pressure = sb.static(model, sb.EdgeLoad("edge2", tx=-1e6)).contact_pressure()[1]
        off.append(np.abs(pressure / 1e6 - 1.0).max())
        told = [str(item.message) for item in said if item.category is RoundOffWarning]
        assert any("contact pressures may be off by" in text for text in told) == says
    assert off[0] > 1e-2 and off[2] < 1e-5


def test_given_gaps_are_those_of_a_notch():
    """A closed crack with the gap of the paper's notch, inside the tip's S-element as well: the same contact
    but for the wedge of 2 um that is not cut out.
    """
    results, slope = [], 2 * np.tan(np.radians(0.0458366) / 2)
    for opening in (0.0458366, 0.0):
        mesh = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, opening)]).mesh(order=3, tip_size=5e-4)
        if not opening:
            mesh = mesh.with_gap("crack1", lambda x, y: slope * (y - 0.0025))
        model = sb.Model(mesh, ALUMINIUM)
        found = sb.static(model, sb.PointForce("A", fy=100.0))
        gaps = model.tips.faces[0].initial_gap()
        first, second = found.stress_intensity["crack1"]
        assert abs(first) < 2e-3 * abs(second)  # of order 3
        results.append([found.contact_resultant, *gaps])
    drawn, given = np.array(results)
    assert drawn[0] > 9000 and len(gaps) == 5 and (drawn > 0).all()
    assert np.abs(given / drawn - 1).max() < 1e-4


def test_a_wide_notch_has_no_second_intensity():
    """Beyond 102.6 degrees (Williams) there is none: a note says that it stands as 0, and no unit is nan."""
    model = sb.Model(Beam(0.1, 0.04, [VNotch(0.05, 0.015, 105.0)]).mesh(order=3), ALUMINIUM)
    found = sb.static(model, sb.PointForce("A", fy=-1e4))
    assert found.stress_intensity["crack1"][1] == 0.0 and found.tip_facts.units("crack1")[1] == "none"
    (note,) = found.notes
    assert "K_I of 'crack1' is in Pa m^0.426" in note and "a K_II is not there and stands as 0" in note
    assert "nan" not in found.tip_facts.common + found.tip_facts.unit("crack1") + note


def test_multiples_of_a_load_are_solved_for_once(monkeypatch):
    """One solve for the load and one for its contact forces, then the latter alone; to the last digit what a
    model gives that has met no load before.
    """
    solved, solve = [], static_solver.StaticSolver.columns

    def counted(solver, right, what):
        if right.ndim == 2:
            solved.append(what)
        return solve(solver, right, what)

    monkeypatch.setattr(static_solver.StaticSolver, "columns", counted)
    mesh = paper_beam(0.0458366).mesh(order=3)
    counts, found = [], []
    with sb.Model(mesh, ALUMINIUM) as used:
        for load in (
            sb.PointForce("A", fy=100.0),
            sb.PointForce("A", fy=300.0),
            sb.PointForce("A", fx=20.0, fy=300.0),
            sb.PointForce("A", fy=70.0),
        ):
            before = len(solved)
            found.append((load, sb.static(used, load)))
            counts.append(len(solved) - before)
    assert counts == [2, 1, 2, 2]
    for load, former in found:
        with sb.Model(mesh, ALUMINIUM) as fresh:
            alone = sb.static(fresh, load)
            np.testing.assert_array_equal(former.field, alone.field)
            np.testing.assert_array_equal(former.contact_force, alone.contact_force)
            assert former.residual == alone.residual


def test_a_load_below_the_least_normal_number():
    """Displacements are those of the same load in other units, as far as numbers below 2.2e-308 tell them."""
    with sb.Model(paper_beam(0.0458366).mesh(order=1), ALUMINIUM) as model:
        unit, least = (sb.static(model, sb.PointForce("A", fy=-f), contact=False) for f in (1.0, 1e-308))
    np.testing.assert_allclose(least.field, 1e-308 * unit.field, rtol=0.0, atol=1e-320)
