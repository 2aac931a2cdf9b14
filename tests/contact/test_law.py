"""Contact laws by crack and by row: tied faces and springs beside unilateral contact, in every analysis."""

import math

import numpy as np
import pytest
from scipy import linalg, optimize, special

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from sbfem_petsc.contact.complementarity import solve_complementarity
from sbfem_petsc.contact.law import ContactLaw, RowLaws
from sbfem_petsc.motion.energy import guard
from sbfem_petsc.system.fields.fracture import unresolved_contact

ALUMINIUM = sb.Material(70e9, 0.33, 2700)


def two_notches(**options):
    """A short beam with a notch from each side, 3 mm deep and 2 micrometres wide at the mouth."""
    notches = [VNotch(0.04, 0.003, 0.0382), VNotch(0.1, 0.003, 0.0382)]
    mesh = Beam(length=0.2, height=0.006, notches=notches).mesh(order=3)
    return sb.Model(mesh, ALUMINIUM, **{"tip_modes": 0, **options})


def array_of(matrix):
    """A PETSc matrix as an array; `convert` alone would change the matrix itself."""
    copied = matrix.copy()
    result = copied.convert("dense").getDenseArray().copy()
    copied.destroy()
    return result


def dense(model):
    """K, G, and the initial gaps of the undeformed faces as plain arrays."""
    return (
        array_of(model.stiffness),
        model.contact.rows.matrix.toarray(),
        model.pairs.gap,
    )


# ---------------------------------------------------------------------- statics
# of a layer that gives way as much as the faces of `two_notches` do, m^3/N: 2e-9 m/N on the share of a pair
LAYER = 4e-13


def rows_of_layer(model, compliance):
    """C: what a layer (m^3/N) is to the pairs, m/N, by the length of face and the thickness of each."""
    return np.diag(compliance / (model.pairs.weight * model.thickness))


@pytest.mark.parametrize("compliance", [0.0, LAYER])
@pytest.mark.parametrize("fy", [2e3, -2e3])
def test_tied_statics(fy, compliance):
    """Against the bordered system [K, -G^T; G, C], solved whole: forces of both signs."""
    model = two_notches(contact_laws=sb.Tied(compliance))
    found = sb.static(model, sb.PointForce("A", fy=fy))
    stiffness, gaps, _ = dense(model)
    n, c = len(stiffness), len(gaps)
    bordered = np.block([[stiffness, -gaps.T], [gaps, rows_of_layer(model, compliance)]])
    force = model.load_columns([sb.PointForce("A", fy=fy)]).forces[:, 0]
    # the two blocks are brought to one size for the solve
    scale = np.append(np.ones(n), np.full(c, np.abs(stiffness).max()))
    solved = scale * np.linalg.solve(bordered * scale, np.append(force, np.zeros(c)))
    # the condition of K, 1e8, times round-off
    np.testing.assert_allclose(found.contact_force, solved[n:], atol=1e-7 * np.abs(solved[n:]).max())
    np.testing.assert_allclose(
        found.displacement("A"),
        model.layout.point_rows(solved[:n]).reshape(-1, 2)[list(model.points).index("A")],
        rtol=1e-7,
    )
    assert (np.sign(found.contact_force) == np.sign(fy)).all() and found.active.all()
    np.testing.assert_allclose(found.gap, 0.0, atol=1e-18)


def test_a_law_for_each_crack():
    """One crack tied, the other unilateral, against bounded least squares on W = L L^T."""
    model = two_notches(contact_laws={"crack2": sb.Tied()})
    tied = np.array([model.cracks[k].name == "crack2" for k in model.pairs.crack])
    load = sb.PointForce("A", fy=3e3) + sb.EdgeLoad("right", tx=2e7)
    stiffness, gaps, opening = dense(model)
    factor = linalg.cho_factor(stiffness)
    flexibility = gaps @ linalg.cho_solve(factor, gaps.T)
    free = gaps @ linalg.cho_solve(factor, model.load_columns([load]).forces[:, 0]) + np.where(
        tied, 0.0, opening
    )
    lower = np.linalg.cholesky(0.5 * (flexibility + flexibility.T))
    expected = optimize.lsq_linear(
        lower.T,
        -linalg.solve_triangular(lower, free, lower=True),
        bounds=(np.where(tied, -np.inf, 0.0), np.inf),
        method="bvls",
        tol=1e-14,
    ).x
    found = sb.static(model, load)
    np.testing.assert_allclose(found.contact_force, expected, atol=1e-6 * np.abs(expected).max())
    assert found.contact_force[tied].min() < 0.0 <= found.contact_force[~tied].min()
    assert 0 < found.active[~tied].sum() < (~tied).sum() and found.active[tied].all()
    # and the other way round it is another structure
    other = sb.static(two_notches(contact_laws={"crack1": sb.Tied()}), load)
    assert abs(other.contact_resultant / found.contact_resultant - 1.0) > 1e-2


def test_compliance_of_unilateral_contact():
    """Softer faces carry less, and overlap by compliance times pressure."""
    load = sb.PointForce("A", fy=3e3)
    hard, soft = (sb.static(two_notches(contact_laws=sb.Unilateral(c)), load) for c in (0.0, LAYER))
    assert 0.0 < soft.contact_resultant < 0.99 * hard.contact_resultant
    stiffness, gaps, opening = dense(soft.model)
    u = np.linalg.solve(stiffness, soft.model.load_columns([load]).forces[:, 0] + gaps.T @ soft.contact_force)
    overlap = gaps @ u + opening
    expected = -rows_of_layer(soft.model, LAYER) @ soft.contact_force
    np.testing.assert_allclose(overlap[soft.active], expected[soft.active], atol=1e-7 * np.abs(overlap).max())
    assert (soft.contact_force >= 0.0).all()


def block(face_edges, law, thickness=1.0, order=3):
    """A block of 0.1 m that a joint cuts through at half its height, held at its sides against bending."""
    corners = [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)]
    mesh = Plate(corners, cracks=[CrackLine([(0, 0.05), (0.1, 0.05)])]).mesh(
        order=order, face_edges=face_edges, points={"P": (0.04, 0.1)}
    )
    sides = [sb.Support("edge2", y=False), sb.Support("edge4", y=False), sb.Support("edge3", x=False, y=1.0)]
    return sb.Model(
        mesh, sb.Material(5e6, 0.0, 1.0), "edge1", contact_laws=law, thickness=thickness, supports=sides
    )


def stretch(face_edges, law, sign, **options):
    """m, of the block under 50 Pa, a force of 5 N for each m of thickness."""
    with block(face_edges, law, **options) as model:
        return sb.static(model, sb.EdgeLoad("edge3", ty=50.0 * sign)).displacement("P")[1]


@pytest.mark.parametrize("law, sign", [(sb.Tied, 1.0), (sb.Tied, -1.0), (sb.Unilateral, -1.0)])
@pytest.mark.parametrize("thickness", [1.0, 0.02])
def test_a_layer_is_the_joints_not_the_meshs(law, sign, thickness):
    """A layer adds its compliance times F / (thickness length) = 1e-7 m, whatever the pairs on the faces.

    The springs that hold the upper half, 1 N/m^3 for its modulus over its height of 5e7, and their digits
    are seen in 1e-5 of it.
    """
    added = [
        stretch(n, law(2e-9), sign, thickness=thickness) - stretch(n, law(), sign, thickness=thickness)
        for n in (6, 12)
    ]
    np.testing.assert_allclose(added, sign * 1e-7, rtol=2e-5)


@pytest.mark.slow
def test_estimate_of_a_layer():
    """Refined meshes find the same joint: sigma (height / E + compliance) of the block."""
    found = sb.estimate(
        block(6, sb.Tied(2e-8)),
        lambda model: sb.static(model, sb.EdgeLoad("edge3", ty=50.0)).displacement("P")[1],
        accuracy=1e-5,
    )
    exact = 50.0 * (0.1 / 5e6 + 2e-8)
    assert found.converged and abs(found.value - exact) < 1e-5 * exact


@pytest.mark.parametrize("face_edges, tip_modes, most", [(6, 4, 1e-3), (24, 4, 1e-3), (12, 8, 2e-4)])
def test_a_layer_up_to_the_tip(face_edges, tip_modes, most):
    """A long strip under uniform tension, half of it cut along its middle and joined by a layer: as the tip
    goes on by da the halves move apart by sigma c, of whose work the layer keeps half, so that G = sigma^2 c
    / 2 and K_I = sigma sqrt(E c / 2).

    The faces inside the tip element carry the layer too, whose traction rises there as sqrt(r): more modes
    follow it better. Without them K_I is 3e-2 off.
    """
    compliance = 1.0
    mesh = Plate([(-4, -1), (4, -1), (4, 1), (-4, 1)], cracks=[CrackLine([(-4, 0), (0, 0)])]).mesh(
        order=4, face_edges=face_edges
    )
    weak = [sb.Support("edge1", x=1e-4, y=1e-4)]
    model = sb.Model(
        mesh,
        sb.Material(1.0, 0.3, 1.0),
        None,
        contact_laws=sb.Tied(compliance),
        supports=weak,
        tip_modes=tip_modes,
        thickness=0.3,
    )
    found = sb.static(model, sb.EdgeLoad("edge3", ty=1.0) + sb.EdgeLoad("edge1", ty=-1.0))
    first, second = found.stress_intensity["crack1"]
    assert abs(first / np.sqrt(compliance / 2.0) - 1.0) < most
    # the weak springs below pull at the strip by so much
    assert abs(second) < 3e-4


@pytest.mark.parametrize(
    "law, fy", [(sb.Tied(), -2e3), (sb.Tied(LAYER), 2e3), (sb.Unilateral(LAYER), 2e3), (sb.Unilateral(), 2e3)]
)
@pytest.mark.filterwarnings("ignore::sbfem_petsc.MeshWarning")
def test_what_a_closing_wedge_leaves_is_one_of_rigid_faces_that_come_apart(law, fy):
    """Tied faces close no wedge, and under a layer a negative K_I is no overlap."""
    found = sb.static(two_notches(contact_laws=law, tip_modes=1), sb.PointForce("A", fy=fy))
    assert min(first for first, _ in found.stress_intensity.values()) < 0.0
    assert any(found.unresolved_contact.values()) == (law == sb.Unilateral())


def test_each_tip_is_told_of_its_own_contact():
    """K_I^2 / (E alpha) of the thickness, counted as negative where K_I > 0 and some of the tip's own modes
    press; nothing where all do, or none. K_I < 0 counts whatever they do.
    """
    tips = two_notches(tip_modes=1, thickness=0.3).tips
    openings = 2.0 * np.tan(np.radians([0.0382, 0.0382]) / 2.0)
    expected = 0.3 * 50.0**2 / (70e9 * openings)
    for number in (0, 1):
        own = slice(*tips.first_rows[number : number + 2])
        for first, pressing, factor in (
            (50.0, [1.0, 0.0], -1.0),
            (50.0, [1.0, 1.0], 0.0),
            (50.0, [0.0, 0.0], 0.0),
            (-50.0, [0.0, 0.0], 1.0),
        ):
            force = np.zeros(tips.count)
            force[own] = pressing
            factors = {f"crack{k + 1}": (first if k == number else 80.0, 7.0) for k in (0, 1)}
            told = [*unresolved_contact(tips, factors, force).values()]
            assert told[1 - number] == 0.0
            assert told[number] == pytest.approx(factor * expected[number], rel=2e-3, abs=0.0)


def test_a_layer_on_the_modes_of_a_tip():
    """Integrals of two Bernstein polynomials, and of 2 (x - 1 - ln x) with them and itself, in closed form:
    the layer's energy of a tip's pressures.
    """
    model = two_notches(tip_modes=4, contact_laws={"crack1": sb.Unilateral(LAYER)}, thickness=0.01)
    bare = two_notches(tip_modes=4, thickness=0.01).contact.flexibility.toarray()
    added = model.contact.flexibility.toarray() - bare
    first = len(model.pairs)
    faces = next(
        faces
        for faces in model.tips.faces.values()
        if model.layout.tip_elements[faces.number].name == "crack1"
    )
    area = faces.size * faces.tractions.lengths[0] * 0.01
    both = np.empty((5, 5))
    for j in range(4):
        for k in range(4):
            both[j, k] = 16.0 * math.comb(3, j) * math.comb(3, k) / math.comb(6, j + k) / 7.0
        both[4, j] = both[j, 4] = 8.0 * sum(
            math.comb(3, t) * math.comb(t, j) * (-1.0) ** (t - j) * (1 / (t + 2) - t / (t + 1) ** 2)
            for t in range(j, 4)
        )
    both[4, 4] = 10.0 / 3.0
    block = slice(first + 5 * faces.number, first + 5 * faces.number + 5)
    # a difference of numbers 1e3 times as large
    np.testing.assert_allclose(added[block, block], LAYER / area * both, rtol=1e-9)
    added[block, block] = 0.0
    mine = np.flatnonzero([model.cracks[k].name == "crack1" for k in model.pairs.crack])
    np.testing.assert_allclose(added[mine, mine], LAYER / (model.pairs.weight[mine] * 0.01), rtol=1e-12)
    added[mine, mine] = 0.0
    assert not added.any()


def test_mixed_problems_against_enumeration():
    """Random problems with tied rows, against all sets of the others."""
    for seed in range(20):
        generator = np.random.default_rng(seed)
        factor = generator.standard_normal((7, 9))
        w, q = factor @ factor.T, generator.standard_normal(7)
        laws = RowLaws.of([sb.Tied(), *[sb.Unilateral()] * 5, sb.Tied()])
        matches = []
        for chosen in np.ndindex(*[2] * 5):
            active = np.flatnonzero([1, *chosen, 1])
            force = np.zeros(7)
            force[active] = np.linalg.solve(w[np.ix_(active, active)], -q[active])
            gap = w @ force + q
            if (force[1:6] >= 0.0).all() and (np.delete(gap, active) >= 0.0).all():
                matches.append(force)
        assert len(matches) == 1
        for options in ({}, {"maximum": 1}, {"start": np.ones(7, dtype=np.int8)}):
            found = solve_complementarity(w, q, laws, **options)
            np.testing.assert_allclose(found.force, matches[0], atol=1e-10 * np.abs(matches[0]).max())


def bridged(layer):
    """K_I over that of the free crack, and the force in the layer, of a crack [-1, 1] with E' = 1 and a
    stress of 1 around it: the integral equation of the opening, in Chebyshev's U times (1 - x^2)^(1/2).
    """
    x, weight = np.polynomial.legendre.leggauss(400)
    even = np.arange(0, 200, 2)
    opening = np.sqrt(1.0 - x**2)[:, None] * special.eval_chebyu(even, x[:, None])
    crack = 0.25 * (even + 1) * special.eval_chebyu(even, x[:, None])
    factors = np.linalg.lstsq(crack + opening / layer, np.ones(len(x)), rcond=None)[0]
    return 0.25 * (even + 1) @ factors, weight @ opening @ factors / layer


@pytest.mark.slow
@pytest.mark.parametrize("layer", [3.0, 0.3, 0.03])
def test_layer_on_a_crack_with_tips(layer):
    """In a plate of 40 half-lengths, whose K is 6e-4 larger, across the faces and along them; K is too small
    by .03 of the tip's S-element over the layer's length, as polynomials follow the root of r.
    """
    outline = [(-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (-40.0, 40.0)]
    plate = Plate(outline, cracks=[CrackLine([(-1.0, 0.0), (1.0, 0.0)], name="c")])
    mesh = plate.mesh(points={"O": outline[0], "X": outline[1]})
    factor, force = bridged(layer)
    nearness, unit = 8e-4 + 0.03 * 0.04 / layer, 1e6 * np.sqrt(np.pi)
    sides = [f"edge{k}" for k in range(1, 5)]
    pulled = [sb.EdgeLoad(side, pressure=-1e6) for side in sides]
    pressed = [
        sb.EdgeLoad(side, pressure=1e7, tx=1e6 * x, ty=1e6 * y)
        for side, (x, y) in zip(sides, [(-1, 0), (0, 1), (1, 0), (0, -1)])
    ]
    for law, load, mode in (
        (sb.Tied(layer / 70e9), pulled, 0),
        (sb.Coulomb(1e3, tangential_compliance=layer / 70e9), pressed, 1),
    ):
        held = [sb.Support("O"), sb.Support("X", x=False)]
        model = sb.Model(mesh, ALUMINIUM, clamped=None, supports=held, contact_laws=law)
        found = sb.static(model, load)
        for own in found.stress_intensity.values():
            assert abs(own[mode]) / unit == pytest.approx(factor, rel=nearness)
        if mode == 0:
            assert found.contact_resultant == pytest.approx(-1e6 * force, rel=1e-3)


# ---------------------------------------------------------------------- motions of a chain
ALPHA, BETA = 0.02, 0.03


def chain(laws, stops=(0, 3), modes=None, compliance=0.2):
    """Five masses on springs, Rayleigh damping, contact rows on two of them."""
    stiffness = np.diag(np.full(5, 2.0)) - np.eye(5, k=1) - np.eye(5, k=-1)
    return sb.reduce_matrices(
        np.eye(5),
        stiffness,
        np.eye(5)[list(stops)],
        np.full(len(stops), 0.3),
        loads=np.eye(5)[:, [1]],
        sensors={"first": 0, "last": 4},
        modes=modes,
        damping=ALPHA * np.eye(5) + BETA * stiffness,
        compliance=np.full(len(stops), compliance),
        contact_laws=laws,
    )


def tied_system(reduced):
    """The chain in modal coordinates with its rows as springs: state matrix and load column."""
    rows, m = reduced.gap.modes, len(reduced.omega)
    stiffness = np.diag(reduced.omega**2) + rows.T @ np.linalg.solve(reduced.gap.contact, rows)
    damping = np.diag(2.0 * reduced.damping * reduced.omega)
    state = np.block([[np.zeros((m, m)), np.eye(m)], [-stiffness, -damping]])
    # a load bends the springs through the residual flexibility too
    load = reduced.load_modes[:, 0] - rows.T @ np.linalg.solve(reduced.gap.contact, reduced.gap.loads[:, 0])
    return state, np.append(np.zeros(m), load)


@pytest.mark.parametrize("modes", [5, 4])
def test_tied_transient(modes):
    """A tied row with a compliance is a linear spring: against the linear system's exponential. Forces are
    the mean of a step's ends, so the error falls with the square of the step.
    """
    reduced = chain(sb.Tied(), modes=modes)
    signal = sb.Harmonic(0.5, 0.11)
    state, load = tied_system(reduced)
    w, end = 2 * np.pi * 0.11, 40.0
    # the forced motion, less the free one that starts it from rest
    forced = np.linalg.solve(1j * w * np.eye(len(state)) - state, 0.5 * load)
    exact = (forced * np.exp(1j * w * end)).imag - linalg.expm(end * state) @ forced.imag
    errors = []
    for step in (0.02, 0.01):
        history = sb.transient(reduced, [signal], end, step=step)
        q = history.states.q[-1]
        errors.append(np.abs(q - exact[: len(q)]).max() / np.abs(exact).max())
    assert errors[1] < 1e-4 and 3.7 < errors[0] / errors[1] < 4.3
    force, gap = history.contact_force, history.gap
    assert force.max() > 0.0 > force.min() and np.abs(gap).max() < 1e-12
    # the springs' energy is strain energy, and contact does no work
    assert np.abs(history.energy.contact).max() < 1e-10 * history.energy.external.max()
    balance = np.abs(history.energy.balance).max()
    assert balance < 1e-3 * history.energy.total.max()


@pytest.mark.parametrize("modes", [5, 4])
def test_tied_orbit(modes):
    """Amplitude, derivative and multipliers of the same spring: resolvent and exponential of the linear
    system; second order in the step.
    """
    frequency = 0.11
    errors = []
    for steps in (256, 512):
        reduced = chain(sb.Tied(), modes=modes)
        orbit = sb.periodic(reduced, [0.5], frequency, steps=steps)
        state, load = tied_system(reduced)
        q = np.linalg.solve(2j * np.pi * frequency * np.eye(len(state)) - state, 0.5 * load)[:modes]
        shape = reduced.points.modes[1, 1] @ q
        force = -np.linalg.solve(reduced.gap.contact, reduced.gap.modes @ q + 0.5 * reduced.gap.loads[:, 0])
        shape = shape + reduced.points.contact[1, 1] @ force + 0.5 * reduced.points.loads[1, 1, 0]
        expected = np.exp(np.linalg.eigvals(state) / frequency)
        found = orbit.multipliers
        distance = max(np.abs(found - value).min() for value in expected)
        errors.append((abs(abs(orbit.harmonics("last")[1]) / abs(shape) - 1.0), distance))
        # the motion is linear: one iteration of Newton's method with the exact derivative
        assert orbit.iterations == 1 and len(found) == len(expected)
    # the stiffest motion turns by 0.04 radian a step, whose multiplier has the larger error
    for coarse, fine, most in zip(*errors, (5e-5, 3e-3)):
        assert fine < most and 3.8 < coarse / fine < 4.2


def test_tied_and_unilateral_orbit():
    """One row tied, one a stop that opens and closes: Newton's derivative against differences, and the same
    motion where the tied row is a spring of the structure instead.
    """
    stiffness = np.diag(np.full(5, 2.0)) - np.eye(5, k=1) - np.eye(5, k=-1)
    rows = np.eye(5)[[0, 3]]

    def orbit(with_spring, jacobian, steps=2048):
        k = stiffness + (np.outer(rows[0], rows[0]) / 0.2 if with_spring else 0.0)
        chosen = slice(1, 2) if with_spring else slice(0, 2)
        reduced = sb.reduce_matrices(
            np.eye(5),
            k,
            rows[chosen],
            np.full(2, 0.1)[chosen],
            loads=np.eye(5)[:, [1]],
            sensors={"last": 4},
            damping=0.05 * np.eye(5),
            compliance=np.array([0.2, 0.05])[chosen],
            contact_laws=[sb.Tied(), sb.Unilateral()][chosen],
        )
        return sb.periodic(reduced, [0.5], 0.2, steps=steps, jacobian=jacobian)

    exact, differences = orbit(False, "dense"), orbit(False, "differences")
    touching = exact.contact_force[:, 1] > 0.0
    assert 0 < touching.sum() < len(touching) and exact.contact_force[:, 0].min() < 0.0
    np.testing.assert_allclose(exact.harmonics("last")[:5], differences.harmonics("last")[:5], atol=1e-9)
    spring = orbit(True, "dense")
    # second order in the step: 1e-5 here
    np.testing.assert_allclose(
        exact.harmonics("last")[:8], spring.harmonics("last")[:8], atol=3e-5 * exact.amplitude("last")
    )
    np.testing.assert_allclose(np.abs(exact.multipliers[0]), np.abs(spring.multipliers[0]), rtol=1e-3)


@pytest.mark.slow
# ---------------------------------------------------------------------- the unreduced model
def test_tied_unreduced_transient():
    """Average acceleration with tied rows, against the same steps with whole matrices and multipliers."""
    step, count = 2e-6, 60
    model = two_notches(contact_laws=sb.Tied(LAYER), continued_fraction=0)
    load, signal = sb.PointForce("A", fy=1.0), sb.ToneBurst(300.0, 2e4, 2)
    history = sb.transient(model, sb.PointForce("A", fy=signal), count * step, reduction=None, step=step)
    stiffness, gaps, _ = dense(model)
    from sbfem_petsc.system.solve.pencil import Pencil

    pencil = Pencil(model.statics, 1.0, 0.0)
    mass = array_of(pencil.mass)
    pencil.destroy()
    n, c = len(stiffness), len(gaps)
    u, v, forces = np.zeros(n), np.zeros(n), [np.zeros(c)]
    unit = model.load_columns([load]).forces[:, 0]
    # u1 = u0 + d, gap G u1 + C force = 0 with the force that acts over the whole step
    inverse = np.linalg.inv(4.0 / step**2 * mass + stiffness)
    bordered = gaps @ inverse @ (2.0 * gaps.T) + rows_of_layer(model, LAYER)
    places = [np.zeros(2)]
    for k in range(count):
        drive = signal(np.array([k * step, (k + 1) * step])).sum()
        free = inverse @ (4.0 / step * mass @ v - 2.0 * stiffness @ u + drive * unit)
        force = -np.linalg.solve(bordered, gaps @ (u + free))
        d = free + inverse @ (2.0 * gaps.T @ force)
        u, v = u + d, 2.0 / step * d - v
        forces.append(force)
        places.append(model.layout.at_points(u)["A"])
    forces, places = np.array(forces), np.array(places)
    np.testing.assert_allclose(history.contact_force, forces, atol=1e-6 * np.abs(forces).max())
    np.testing.assert_allclose(history.displacement("A"), places, atol=1e-8 * np.abs(places).max())
    assert forces.max() > 0.0 > forces.min()
    # energy: what the rows' springs store is strain energy, what contact takes is the steps' own and small
    energy = history.energy
    assert np.abs(energy.balance).max() < 1e-9 * energy.total.max()
    assert -0.05 * energy.external.max() < energy.contact[-1] < 1e-12


@pytest.mark.long
def test_tied_unreduced_orbit():
    """Shooting on the unreduced model against the reduced one, whose 30 modes leave out 1e-3."""
    model = two_notches(contact_laws=sb.Tied(LAYER), rayleigh=sb.rayleigh_factors(500.0, 0.05, 20e3, 0.05))
    load = sb.PointForce("A", fy=100.0)
    whole = sb.periodic(model, load, 900.0, reduction=None, steps=101)
    reduced = sb.periodic(model, load, 900.0, modes=30, steps=512)
    # linear: as many iterations as the linear solves, to 1e-4 each, make necessary for 1e-8
    assert whole.iterations == 2
    one, other = whole.harmonics("A")[1], reduced.harmonics("A")[1]
    assert abs(one - other) < 5e-3 * abs(other)
    assert whole.contact_force.min() < 0.0 < whole.contact_force.max()


# ---------------------------------------------------------------------- the guard, input
def test_guard():
    """Work of contact is refused, fed in or taken, where faces rub too: the loss has its own account."""

    class Ledger:
        supplied = 1.0

    time = np.arange(3.0)

    def chunk(work):
        return np.array([[1.0, 1.0], [0.0, 0.0], [0.5, 1.0], [0.0, 0.0], [0.0, work]])

    for work in (-0.005, 0.005):
        guard(chunk(work), Ledger(), time)
        guard(np.concatenate([chunk(work), [[0.0, 0.9]]]), Ledger(), time)
    for work in (-0.5, 0.5):
        with pytest.raises(sb.SolveError, match=f"contact forces have done work of {work:g} J"):
            guard(chunk(work), Ledger(), time)
    for part in (0, 1):  # motions or stresses beyond the range of numbers
        beyond = chunk(0.0)
        beyond[part, 0] = np.inf
        with pytest.raises(sb.SolveError, match="the history is wrong"):
            guard(beyond, Ledger(), time)


class Cubic(ContactLaw):
    """A law of a user's own: everything that one could be asked, and no solver asks its force."""

    tied = False

    def force(self, gap):
        return np.maximum(-gap, 0.0) ** 3


class Softer(sb.Unilateral):
    """A law derived from a known one."""


class Untold(ContactLaw):
    """A law that does not say whether it is tied."""


class Foreign:
    tied, compliance = False, 0.0


def test_bad_laws():
    mesh = Beam(length=0.2, height=0.006, notches=[VNotch(0.04, 0.003, 0.0382)]).mesh(order=2)
    for laws, error, text in (
        ({"crack7": sb.Tied()}, sb.UnknownName, "'crack7', which is no crack of the mesh; it has 'crack1'"),
        ({"crack1": "tied"}, TypeError, r"contact_laws\['crack1'\] = 'tied' must be a contact law"),
        ("tied", TypeError, "must be a contact law or a dict"),
        (ContactLaw(), TypeError, "must be a contact law, Unilateral"),
        (sb.Tied, TypeError, "must be a contact law or a dict"),
        (Cubic(), TypeError, "contact_laws is a law of its own class, Cubic, of which no solver asks"),
        ({"crack1": Softer(1e-9)}, TypeError, r"contact_laws\['crack1'\] is a law of its own class, Softer"),
        ({"crack1": Untold()}, TypeError, "of its own class, Untold"),
        ({"crack1": Foreign()}, TypeError, "must be a contact law, Unilateral"),
    ):
        with pytest.raises(error, match=text):
            sb.Model(mesh, ALUMINIUM, contact_laws=laws)
    for value in (-1e-9, np.nan, np.inf):
        with pytest.raises(ValueError, match="Tied: compliance = .* must be finite and at least 0"):
            sb.Tied(value)
    with pytest.raises(TypeError, match="Unilateral: compliance = 'soft' must be a number"):
        sb.Unilateral("soft")
    with pytest.raises(ValueError, match="contact_laws has 1 laws for 2 contact rows"):
        chain([sb.Tied()])
    with pytest.raises(ValueError, match=r"contact_laws\[1\] = Tied\(compliance=0.2\) .* give compliance ="):
        chain([sb.Tied(), sb.Tied(0.2)])
    with pytest.raises(TypeError, match="one for each row"):
        chain("tied")
    with pytest.raises(TypeError, match=r"contact_laws\[1\] is a law of its own class, Cubic"):
        chain([sb.Tied(), Cubic()])


# ---------------------------------------------------------------------- faces that supports hold
@pytest.mark.slow
@pytest.mark.parametrize(
    "supports",
    [
        pytest.param([sb.Support("edge1")], id="both", marks=pytest.mark.long),
        pytest.param([sb.Support("edge1", y=False), sb.Support("edge4")], id="x"),
    ],
)
def test_mouth_on_a_support(supports):
    """A crack that begins on a held edge has a pair that cannot open: nothing acts there, whatever the law,
    and a slow motion goes through the static states of the load, to (f / f_1)^2.
    """
    cracks = [CrackLine([(0.02, 0), (0.02, 0.04)]), CrackLine([(0.05, 0.05), (0.07, 0.07)])]
    plate = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=cracks)
    mesh = plate.mesh(order=2, points={"P": (0.1, 0.1)})
    for law in (sb.Tied(), sb.Unilateral()):
        model = sb.Model(mesh, ALUMINIUM, contact_laws=law, damping=0.05, supports=supports)
        (mouth,) = np.flatnonzero((model.pairs.position > 1.0 - 1e-9) & (model.pairs.crack == 0))
        slow = 0.01 * model.modes(1).frequencies[0]
        orbit = sb.periodic(model, sb.EdgeLoad("edge3", tx=1e6), slow, modes=12, steps=64, stability=False)
        assert not orbit.contact_force[:, mouth].any()
        for instant, sign in ((16, 1.0), (48, -1.0)):
            state = sb.static(model, sb.EdgeLoad("edge3", tx=sign * 1e6))
            u = orbit.displacement("P")[instant]
            np.testing.assert_allclose(u, state.displacement("P"), atol=2e-3 * np.abs(u).max())


def test_modes_of_tied_cracks_warn():
    with pytest.warns(UserWarning, match="modal: the cracks 'crack1', 'crack2' are tied"):
        sb.modal(two_notches(contact_laws=sb.Tied()), 1)
