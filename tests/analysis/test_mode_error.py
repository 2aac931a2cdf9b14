"""What is told of the harmonics' error by left-out modes and steps, beside their true error."""

import functools
from dataclasses import replace

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from sbfem_petsc.continuation.harmonic_errors import FAINT, harmonic_error_estimates, in_modes, lowest
from sbfem_petsc.continuation.orbit import run_again
from sbfem_petsc.motion.preparation import PeriodSettings, prepare
from sbfem_petsc.motion.steps import free_motion
from sbfem_petsc.reduction.build import wider
from tests.systems import ALUMINIUM, chain, coarse_beam

TURN = 2.0 * np.pi


def rod(modes: int | None = None, viscosity: float = 0.0) -> sb.ReducedModel:
    """60 masses on a wall, 1 kg and a wave's way of 1 s in all, a crack in a third of it and a stop at the
    free end: blows whose waves modes carry badly; with Rayleigh's b.
    """
    n, rows = 60, np.zeros((2, 60))
    stiffness = n * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[-1, -1] = n
    rows[0, [20, 21]], rows[1, -1] = (-1.0, 1.0), -1.0
    return sb.reduce_matrices(
        np.eye(n) / n,
        stiffness,
        rows,
        np.array([0.0, 0.05]),
        loads=np.eye(n)[:, [-1]],
        sensors={"tip": n - 1, "middle": n // 2},
        modes=modes,
        damping=0.02,
        rayleigh=(0.0, viscosity),
        compliance=np.array([1e-3, 1e-2]),
    )


def true_error(found: sb.Orbit, exact: sb.Orbit) -> np.ndarray:
    """(5,): that of harmonics 0 to 4 of all points and of the resultant, the larger one, each beside itself
    or 1e-3 of the largest that oscillates.
    """
    errors = []
    for parts in zip(*map(_lowest, (found, exact))):
        size = np.linalg.norm(parts[1], axis=1)
        least = max(FAINT * size[1:].max(), np.finfo(float).tiny)
        errors.append(np.linalg.norm(parts[0] - parts[1], axis=1) / np.maximum(size, least))
    return np.max(errors, axis=0)


def _lowest(orbit: sb.Orbit) -> tuple[np.ndarray, np.ndarray]:
    """(5, ...) each: harmonics of all points, and of the resultant."""
    resultant = np.fft.rfft(orbit.contact_resultant)[: 4 * orbit.periods + 1 : orbit.periods, None]
    points = np.stack([orbit.harmonics(point)[:5].ravel() for point in orbit.points], axis=1)
    return points, resultant / len(orbit.time) * np.array([[1.0], *4 * [[2.0]]])


@functools.cache
def waves(frequency: float) -> sb.Orbit:
    """All modes of the rod, whose top one has 14 of these steps or more a period."""
    return sb.periodic(rod(), [0.1], frequency / TURN, steps=2048, stability=False)


@pytest.mark.parametrize(
    ("modes", "frequency"),
    [(6, 0.5), (20, 1.1), *(pytest.param(*case, marks=pytest.mark.long) for case in ((6, 1.1), (20, 0.5)))],
)
def test_told_beside_true_in_a_rod(modes, frequency):
    """No harmonic is told less than a third of its error, nor the largest ten times too much."""
    found = sb.periodic(rod(modes), [0.1], frequency / TURN, steps=2048, stability=False)
    true, told = true_error(found, waves(frequency)), found.mode_error
    assert true[1:].max() > 1e-3 and (true <= 3.0 * told).all(), (true, told)
    assert told[1:].max() <= 10.0 * true[1:].max(), (true, told)


def test_told_beside_true_of_a_model_in_few_modes():
    """Of a cracked plate whose fourth mode is at twice the third: no harmonic is told less than a third of
    its error; by the fourth alone it is told a fourth to a fifth.
    """
    outline = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.03), (0.0, 0.03)]
    mesh = Plate(outline, cracks=[CrackLine([(0.04, 0.03), (0.04, 0.012)])]).mesh(order=2)
    load = sb.EdgeLoad("edge1", pressure=1e4)
    with sb.Model(mesh, ALUMINIUM, damping=0.01, clamped="edge4") as plate:
        found, exact = (
            sb.periodic(plate, load, 525.4, steps=512, modes=modes, stability=False) for modes in (3, 32)
        )
    true = true_error(found, exact)
    assert (true <= 3.0 * found.mode_error).all(), (true, found.mode_error)


@pytest.mark.parametrize("seed", [1, 2, 5, 7])
def test_left_out_modes_near_the_harmonics(seed):
    """Of chains of masses with two stops in so few modes that harmonics 1 to 4 lie among those that are left
    out, beside all modes: none is told less than a third of its error.
    """
    random = np.random.default_rng(seed)
    n, modes = int(random.integers(8, 13)), int(random.integers(3, 6))
    springs, masses = random.uniform(0.5, 2.0, n + 1), random.uniform(0.5, 2.0, n)
    stiffness = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    stops, gap = np.zeros((2, n)), random.uniform(0.0, 0.3, 2)
    stops[[0, 1], random.choice(n, 2, replace=False)] = -1.0, 1.0
    few, whole = (
        sb.reduce_matrices(
            np.diag(masses),
            stiffness,
            stops,
            gap,
            loads=np.eye(n)[:, [n // 2]],
            sensors={"middle": n // 2, "end": n - 1},
            modes=kept,
            damping=0.02,
            compliance=np.array([0.1, 0.3]),
        )
        for kept in (modes, None)
    )
    frequency = few.frequencies[-1] / random.uniform(2.0, 4.0)
    found, exact = (
        sb.periodic(system, [0.5], frequency, steps=512, stability=False) for system in (few, whole)
    )
    true, told = true_error(found, exact), found.mode_error
    assert true[1:].max() > 1e-2 and (true <= 3.0 * told).all(), (true, told)


@pytest.mark.parametrize("modes", [12, 40])
def test_told_beside_true_in_a_beam(modes):
    """The same of a beam with a crack at 433 Hz beside 120 modes."""
    push, beam = sb.PointForce("A", fy=300.0), coarse_beam(0.002)
    exact, found = (
        sb.periodic(beam, push, 433.0, modes=count, steps=768, stability=False) for count in (120, modes)
    )
    true, told = true_error(found, exact), found.mode_error
    assert (true <= 3.0 * told).all() and told[1:].max() <= 10.0 * true[1:].max(), (true, told)


@pytest.mark.parametrize(("modes", "frequency"), [(40, 1.1), pytest.param(30, 0.5, marks=pytest.mark.long)])
def test_told_of_viscosity(modes, frequency):
    """What is left out follows its forces later under Rayleigh's damping, by b, which is nearly all of the
    error here: told as it is beside all modes.
    """
    found, exact = (
        sb.periodic(rod(count, 0.01), [0.1], frequency / TURN, steps=2048, stability=False)
        for count in (modes, None)
    )
    true, told = true_error(found, exact), found.mode_error
    assert true[2] > 3e-3 and (true[1:] <= 1.02 * told[1:]).all() and (told[1:] <= 1.2 * true[1:]).all(), (
        true,
        told,
    )


@pytest.mark.long
def test_told_of_viscosity_of_two_tones():
    """The same of their lines, beside all modes: of those of each order the largest error."""
    fast, slow = 0.5 / TURN, 0.11 / TURN
    load = [sb.Harmonic(0.1, fast) + sb.Harmonic(0.03, slow)]
    asked = dict(samples=15, steps=512, stability=False, accuracy=0.1)
    found, exact = (sb.quasi_periodic(rod(count, 0.01), load, (fast, slow), **asked) for count in (30, None))
    true = np.zeros(5)
    lines = [(m, n) for m in range(5) for n in range(-4, 5) if 0 < m + abs(n) < 5 and (m, n) > (0, 0)]
    sizes = {line: [abs(exact.line(*line, point)) for point in exact.points] for line in lines}
    for (m, n), size in sizes.items():
        off = [abs(found.line(m, n, p) - exact.line(m, n, p)) for p in exact.points]
        off = np.linalg.norm(off) / max(np.linalg.norm(size), FAINT * np.max(list(sizes.values())))
        true[m + abs(n)] = max(true[m + abs(n)], off)
    told = found.mode_error
    assert true[1:].max() > 3e-3 and (true[1:] <= 1.1 * told[1:]).all(), (true, told)
    assert (told[1:] <= 2.0 * true[1:]).all(), (true, told)


def test_harmonics_that_are_told_of():
    """Those of the orbit, without a delay, in whose second there is no whole number of periods."""
    push, frequency = sb.PointForce("A", fy=300.0), 433.3
    r = sb.reduce(coarse_beam(0.002), push, modes=6)
    found = sb.periodic(r, push, frequency, steps=128, stability=False)
    driven = prepare("periodic", r, push, frequency, settings=PeriodSettings(steps=128)).at(frequency)
    points, _ = lowest(run_again(driven, found.state))
    expected = np.stack([found.harmonics(name)[:5] for name in found.points], axis=1)
    np.testing.assert_allclose(points[:, :, 1], expected, atol=1e-12 * np.abs(expected).max())


def test_told_of_viscosity_of_a_model():
    """Of a beam with a tied crack what R / (1 + i omega b) does in closed form; b grows with the damping."""
    b, frequency = 2.7e-6, 1350.0
    beam = sb.Model(
        Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.0)]).mesh(order=3, tip_size=5e-4),
        ALUMINIUM,
        rayleigh=(40.0, b),
        contact_laws=sb.Tied(compliance=1e-14),
    )
    r, omega = sb.reduce(beam, sb.PointForce("A", fy=1.0), modes=12), TURN * frequency
    push = sb.PointForce("A", fy=1.0)
    found = sb.periodic(r, push, frequency, steps=512, stability=False)
    driven = prepare("periodic", r, push, frequency, settings=PeriodSettings(steps=512)).at(frequency)
    told = harmonic_error_estimates(run_again(driven, found.state))
    np.testing.assert_allclose(told.sum(axis=0), found.mode_error, rtol=1e-6)
    assert r.delay == pytest.approx(b) and replace(r, damping=3.0 * r.damping).delay == pytest.approx(3.0 * b)
    layers = np.diag(beam.contact.flexibility.diagonal())

    def response(late: complex) -> list[np.ndarray]:
        """Of each point, and the resultant."""
        moved = 1.0 / (r.omega**2 - omega**2 + 2j * r.damping * r.omega * omega)
        gap, load = r.gap.modes, r.load_modes[:, 0]
        slack = (gap * moved) @ gap.T + late * (r.gap.contact - layers) + layers
        force = -np.linalg.solve(slack, (gap * moved) @ load + late * r.gap.loads[:, 0])
        own = (r.points.modes * moved) @ load + late * r.points.loads[..., 0]
        own += ((r.points.modes * moved) @ gap.T + late * r.points.contact) @ force
        return [*own, force.sum(keepdims=True)]

    pairs = list(zip(response(1.0), response(1.0 / (1.0 + 1j * omega * b))))
    own = pairs[r.points.names.index("A")][0][1]
    assert abs(found.harmonics("A")[1]) == pytest.approx(abs(own), rel=1e-3)
    changed = max(np.linalg.norm(one - other) / np.linalg.norm(one) for one, other in pairs)
    assert told[2, 1] == pytest.approx(changed, rel=0.05)
    # few modes do not do by default, and vectors have a part of it; 2e-4 cannot be had in modes alone
    grown = sb.periodic(beam, push, frequency, stability=False)
    assert grown.largest_mode_error <= 1e-3 and grown.reduced.natural > 80
    with pytest.warns(
        sb.AccuracyWarning, match="viscous by Rayleigh's b of what is left out beyond 80 modes"
    ):
        sb.periodic(beam, push, frequency, modes=80, accuracy=2e-4, stability=False)


def test_told_where_updates_hardly_gain():
    """Of a plate with tied cracks, beside its response in 100 modes in closed form, 5e-6 from that in 200: a
    derivative of another number of steps did not lead to the motion in more of them, which was told as not
    found.
    """
    lines = [
        [(0.0225, 0.0302), (0.0463, 0.0377), (0.0649, 0.0619)],
        [(0.0787, 0.0369), (0.0561, 0.0467), (0.0266, 0.0406)],
    ]
    corners, frequency = [(0.0, 0.0), (0.1, 0.0), (0.0955, 0.1185), (0.0007, 0.1079)], 3200.0
    plate = Plate(corners, cracks=[CrackLine(points) for points in lines])
    mesh = plate.mesh(order=2, size=0.035, points={"S": corners[2]})
    laws = sb.Tied(compliance=1e-12)
    with sb.Model(mesh, ALUMINIUM, clamped="edge1", damping=0.02, contact_laws=laws) as model:

        def late(size, phase):
            return sb.Harmonic(size, frequency, phase)

        load = [
            sb.EdgeLoad(
                "edge3", tx=late(1.2e6, 0.0) + late(-0.23e6, 0.7), ty=late(1.2e6, 0.0) + late(-0.18e6, 0.7)
            ),
            sb.PointForce("S", fx=late(-1.3e4, 0.0), fy=late(-2.7e4, 0.0)),
        ]
        found = sb.periodic(model, load, frequency, modes=10, steps=160, stability=False)
        r, omega = sb.reduce(model, load, modes=100), TURN * frequency
    sizes = {
        "tx": 1.2e6 - 0.23e6 * np.exp(0.7j),
        "ty": 1.2e6 - 0.18e6 * np.exp(0.7j),
        "fx": -1.3e4,
        "fy": -2.7e4,
    }
    forces = np.array(list(sizes.values()))
    moved = 1.0 / (r.omega**2 - omega**2 + 2j * r.damping * r.omega * omega)
    gap, load_modes = r.gap.modes, r.load_modes @ forces
    force = np.linalg.solve(
        (gap * moved) @ gap.T + r.gap.contact, -((gap * moved) @ load_modes + r.gap.loads @ forces)
    )
    exact = (r.points.modes * moved) @ (load_modes + gap.T @ force)
    exact = exact + r.points.loads @ forces + r.points.contact @ force
    own = found.harmonics("S", "x")[1], found.harmonics("S", "y")[1]
    exact = -1j * exact.reshape(-1, 2)[r.points.names.index("S")]
    true, told = np.linalg.norm(own - exact) / np.linalg.norm(exact), found.mode_error
    assert true < 1.5 * told[1] and told[1] < 10.0 * true, (true, told)


def test_told_of_steps():
    """Where all modes are kept the steps' error is what is told."""
    found = sb.periodic(rod(), [0.1], 1.1 / TURN, steps=256, stability=False)
    true, told = true_error(found, waves(1.1)), found.mode_error
    assert true.max() > 5e-4 and (true <= 1.5 * told).all() and (told <= 2.0 * true).all(), (true, told)


def test_where_nothing_is_told():
    """Of motions found in segments, which are not in what is told beside themselves."""
    segments = sb.periodic(chain(3), [0.1, 0.0], 0.45 / TURN, steps=512, segments=2)
    assert np.isnan(segments.mode_error).all() and "error of harmonics" not in repr(segments)
    lost = replace(segments, mode_error=np.full(5, np.inf))
    assert "error of harmonics not found, as twice the steps or more modes lead elsewhere" in repr(lost)


@pytest.mark.parametrize(
    ("parameter", "stop"), [pytest.param("gap", 0.5, marks=pytest.mark.long), ("damping", 3.0)]
)
def test_along_gaps_and_damping(parameter, stop):
    """More modes have the gaps and the damping of the motion whose error is told."""
    curve = sb.load_response(
        rod(20), [0.1], 1.1 / TURN, 1.0, stop=stop, parameter=parameter, steps=512, stability=False
    )
    exact = rod()
    changed = {"gap": {"initial_gap": stop * exact.initial_gap}, "damping": {"damping": stop * exact.damping}}
    exact = sb.periodic(replace(exact, **changed[parameter]), [0.1], 1.1 / TURN, steps=512, stability=False)
    true, told = true_error(curve.orbit(len(curve.value) - 1), exact), curve.mode_error
    assert curve.value[-1] == pytest.approx(stop) and (true <= 3.0 * told).all(), (true, told)
    assert told[1:].max() <= 30.0 * true[1:].max(), (true, told)


def test_modes_of_other_parts_tell_nothing():
    """40 light oscillators that hardly hang on a rod stand between its second and its third frequency: 6 of
    them more have next to nothing of what is left out, of which the error is a tenth.
    """
    n, sides = 30, 40
    stiffness = np.zeros((n + sides, n + sides))
    stiffness[:n, :n] = n * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[n - 1, n - 1] = n
    mass = np.diag([1.0 / n] * n + [1e-3] * sides)
    own = np.sqrt(np.linalg.eigvalsh(n * stiffness[:n, :n]))
    tuned = 1e-3 * np.linspace(1.2 * own[1], 0.8 * own[2], sides) ** 2
    for k, spring in enumerate(tuned):
        at, side = n - 1 - k % 10, n + k
        stiffness[side, side] += spring
        stiffness[[at, side], [at, side]] += 1e-4 * spring
        stiffness[[at, side], [side, at]] -= 1e-4 * spring
    row = np.zeros((1, n + sides))
    row[0, n - 1] = -1.0
    few, whole = (
        sb.reduce_matrices(
            mass,
            stiffness,
            row,
            np.array([0.02]),
            loads=np.eye(n + sides)[:, [n - 1]],
            sensors={"tip": n - 1},
            modes=modes,
            damping=0.02,
            compliance=np.array([1e-2]),
        )
        for modes in (12, None)
    )
    found, exact = (
        sb.periodic(system, [0.1], 1.1 / TURN, steps=1024, stability=False) for system in (few, whole)
    )
    true, told = true_error(found, exact), found.mode_error
    assert true[1:].max() > 1e-2 and np.isinf(told).all(), (true, told)


def test_a_model_in_all_its_modes():
    """Has no error by modes: what is told is that of the steps."""
    model = sb.Model(Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.0)]).mesh(order=1), ALUMINIUM, damping=0.02)
    push, modes = sb.PointForce("A", fy=300.0), model.boundary_unknowns // 2
    found, fine = (
        sb.periodic(model, push, 300.0, modes=modes, steps=steps, stability=False) for steps in (2048, 8192)
    )
    true, told = true_error(found, fine), found.mode_error
    assert (true <= 3.0 * told + 1e-12).all() and (told <= 10.0 * true + 1e-9).all(), (true, told)


def test_curves_tell_the_largest(tmp_path):
    """Of both ends and the peak; in the print, and in a file."""
    system = rod(6)
    curve = sb.frequency_response(system, [0.1], 0.5 / TURN, 0.502 / TURN, steps=256, stability=False)
    ends = [curve.orbit(k) for k in (0, len(curve.value) - 1)]
    again = [sb.periodic(system, [0.1], o.frequency, steps=256, guess=o, stability=False) for o in ends]
    assert all((curve.mode_error >= (1.0 - 1e-3) * o.mode_error).all() for o in again)
    assert "error of harmonics" in repr(curve)
    sb.save(str(tmp_path / "curve.h5"), curve)
    np.testing.assert_array_equal(sb.read(str(tmp_path / "curve.h5")).mode_error, curve.mode_error)


def test_a_body_at_rest_has_no_error():
    """Its harmonics are rounding, and no share of them is told."""
    resting = sb.periodic(rod(6), [0.0], 0.45 / TURN, steps=256, stability=False)
    pressed = sb.periodic(rod(6), [sb.Constant(0.1)], 0.45 / TURN, steps=256, stability=False)
    for orbit in (resting, pressed):
        assert orbit.mode_error[1:].max() < 1e-6, orbit.mode_error


@pytest.mark.parametrize("preload", [1e8, 1e10])
def test_told_about_a_far_place_at_rest(preload):
    """A linear vibration's error is the same whatever constant load it is beside, to the rounding of its
    displacement.
    """
    tones = [sb.Harmonic(1.0, 0.9) + sb.Constant(load) for load in (0.0, preload)]
    alone, beside = (sb.periodic(rod(8), [tone], 0.9, contact=False).mode_error[1] for tone in tones)
    assert 1e-4 < alone < 1.0
    assert beside == pytest.approx(alone, rel=1e-2)


def test_free_motion_over_a_step():
    """Each mode by exp(lambda h), in whatever unit its coordinate is told; of what stands behind nothing."""
    omega, damping, step = np.array([3.0, 50.0]), np.array([0.02, 0.3]), 0.01
    matrix = free_motion((omega, damping), step, np.array([0.5, 7.0]), 5)
    exponents = omega * (-damping + 1j * np.sqrt(1.0 - damping**2))
    expected = np.exp(step * np.concatenate([exponents, exponents.conj()]))
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(matrix[:4, :4])), np.sort_complex(expected))
    step_of = matrix[:4, :4] @ [0.5, 0.0, 0.0, 0.0]  # the first mode at 1
    rate = exponents[0]
    assert step_of[0] / 0.5 == pytest.approx((np.exp(step * rate) * rate.conj()).imag / rate.conj().imag)
    assert step_of[2] == pytest.approx(-3.0 * (3.0 / rate.imag) * np.exp(step * rate).imag)
    assert not matrix[4].any() and not matrix[:, 4].any()


def rubbed(seed: int, modes: int | None) -> sb.ReducedModel:
    """A chain of masses with two stops that rub."""
    random = np.random.default_rng(seed)
    n = int(random.integers(8, 13))
    springs, masses = random.uniform(0.5, 2.0, n + 1), random.uniform(0.5, 2.0, n)
    stops, along = np.zeros((2, n)), np.zeros((2, n))
    places = random.choice(n, 4, replace=False)
    stops[[0, 1], places[:2]], along[[0, 1], places[2:]] = (-1.0, 1.0), 1.0
    return sb.reduce_matrices(
        np.diag(masses),
        np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1),
        stops,
        random.uniform(0.0, 0.1, 2),
        loads=np.eye(n)[:, [n // 2]],
        sensors={"middle": n // 2, "end": n - 1},
        modes=modes,
        damping=0.03,
        compliance=np.array([0.1, 0.3]),
        contact_laws=sb.Coulomb(random.uniform(0.1, 0.6)),
        tangent_rows=along,
        tangent_compliance=np.array([0.2, 0.1]),
    )


def test_where_faces_rub():
    """The same of a chain with stops that rub, beside all modes in four times the steps. What faces remember
    is the same slip, in m, in more modes, though the roots of the compliance that are its unit differ.
    """
    few, whole = (rubbed(3, modes) for modes in (5, None))
    found = sb.periodic(few, [0.5], 0.6 * few.frequencies[1], steps=512, stability=False)
    exact = sb.periodic(whole, [0.5], found.frequency, steps=2048, stability=False)
    true, told = true_error(found, exact), found.mode_error
    assert found.friction_loss > 0.0 and true[1:].max() > 1e-3, (true, told)
    assert (true <= 3.0 * told).all(), (true, told)
    more = wider(few)
    assert more is not None and np.abs(more.slip_units / few.slip_units - 1.0).max() > 1e-2
    slips = in_modes(found.state, few, more)[-2:] * more.slip_units
    np.testing.assert_allclose(slips, found.state[-2:] * few.slip_units, rtol=1e-14)


def test_bifurcations_beside_more_modes():
    """With little damping the two of a beam lie at other places in few modes; beside those in 40 their
    values, which more modes have moved, are off by two fifths of that at most, and by less than is told.
    """
    push, beam = sb.PointForce("A", fy=300.0), coarse_beam(2e-4)
    few, more = (
        sb.frequency_response(beam, push, 435.4, 435.8, modes=modes, steps=512).bifurcations
        for modes in (17, 40)
    )
    assert [item.kind for item in few] == [item.kind for item in more] == 2 * ["Neimark-Sacker"]
    for one, other in zip(few, more):
        own, true = abs(one.own_value - other.value), abs(one.value - other.value)
        assert max(4e-4, 2.5 * true) <= own and true <= one.error <= 2.5 * own, (one, other)
