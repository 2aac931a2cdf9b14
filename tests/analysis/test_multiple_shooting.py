"""Multiple shooting: single shooting where both work, powers of known multipliers, an independent integration
of each segment, and products of matrices whose eigenvalues are given.
"""

import contextlib
from fractions import Fraction

import numpy as np
import pytest
from scipy import sparse
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag

import sbfem_petsc as sb
from sbfem_petsc.continuation.linear import Sparse
from sbfem_petsc.continuation.problems import segments as segment_module
from sbfem_petsc.continuation.problems.segments import (
    at_segments,
    product_eigenvalues,
    segmented_stability,
    shoot_segments,
)
from sbfem_petsc.continuation.search import NEWTON_ALONE
from tests.systems import coarse_beam, one_mass, two_masses

TURN = 2.0 * np.pi
KINDS = "fold", "period doubling"
DAMPING, STEPS = 0.02, 64
# twice the frequency of a mass whose spring is four times as stiff on one side
FAST = 2.0 * (4.0 / 3.0) / TURN


@pytest.fixture(scope="module")
def mass():
    return one_mass(0.0, DAMPING, stiffness=3.0, towards=1.0)


@pytest.fixture(scope="module")
def fast(mass):
    """The motion of one period, which is unstable."""
    return sb.periodic(mass, [1.0], FAST, steps=STEPS, periods=1)


def given(values, count, seed=0):
    """Factors of a product with given real eigenvalues, from one well conditioned basis to the next."""
    random, size = np.random.default_rng(seed), len(values)

    def turned():
        return np.linalg.qr(random.normal(size=(size, size)))[0]

    bases = [turned() @ np.diag(random.uniform(0.5, 2.0, size)) @ turned() for _ in range(count)]
    growth = np.abs(values) ** (1.0 / count)
    return np.array(
        [
            bases[(k + 1) % count]
            @ np.diag(growth * (np.sign(values) if k == 0 else 1.0))
            @ np.linalg.inv(bases[k])
            for k in range(count)
        ]
    )


def test_subspaces_that_part_late(monkeypatch):
    """They have as many rounds again as they took to part, whatever the number that they may take."""
    basis = np.array([[1.0, 0.9, 0.3], [0.2, 1.0, -0.8], [-0.6, 0.4, 1.0]])
    values = np.array([1.0, 1e-3, 1e-8])
    factor = basis @ np.diag(values) @ np.linalg.inv(basis)
    least = 0
    for rounds in range(1, 9):
        monkeypatch.setattr(segment_module, "ROUNDS", rounds)
        with contextlib.suppress(sb.SolveError):
            assert product_eigenvalues(factor[None]) == pytest.approx(values, rel=1e-6)
            least = least or rounds
    assert 1 < least <= 4


def test_eigenvalues_of_a_product():
    """From 1e12 to 1e-12, of either sign: to 1e-12, where the product itself loses those below 1; of many
    large factors as well, and where one factor is large and another one small.
    """
    values = np.array([1e12, -1e6, 3.0, -0.5, 1e-6, -1e-12])
    factors = given(values, 8)
    assert product_eigenvalues(factors) == pytest.approx(values, rel=1e-12)
    lost = np.linalg.eigvals(np.linalg.multi_dot(factors[::-1]))
    assert np.abs(lost - -1e-12).min() > 1e-9
    factors[2], factors[5] = 1e9 * factors[2], 1e-9 * factors[5]
    assert product_eigenvalues(factors) == pytest.approx(values, rel=1e-12)
    spread = 10.0 ** np.linspace(40.0, -40.0, 120) * np.where(np.arange(120) % 3 == 1, -1.0, 1.0)
    assert product_eigenvalues(given(spread, 16)) == pytest.approx(spread, rel=1e-11)
    # many of nearly one modulus, in pairs at angles that leave no gap
    random = np.random.default_rng(4)
    many = random.normal(size=(4, 160, 160)) / np.sqrt(160.0)
    direct = np.linalg.eigvals(np.linalg.multi_dot(many[::-1]))
    found = product_eigenvalues(many)
    assert len(found) == 160 and np.isin(found.conj(), found).all()
    assert np.abs(found[:, None] - direct).min(axis=0).max() < 1e-10 * np.abs(direct).max()
    # a pair of one modulus, and one factor alone
    turn = 1.1 * np.array([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]])
    found = product_eigenvalues(np.array(5 * [turn]))
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(1.1**5 * np.exp([-5j, 5j])), rel=1e-13)
    one = random.normal(size=(1, 4, 4))
    expected = np.linalg.eigvals(one[0]).astype(complex)
    assert np.abs(np.sort_complex(product_eigenvalues(one)) - np.sort_complex(expected)).max() < 1e-13
    # factors without full rank, and one that is nothing
    thin = product_eigenvalues(np.array([np.diag([1.0, 0.0, 2.0]), random.normal(size=(3, 3))]))
    assert thin[2] == pytest.approx(0.0, abs=1e-14) and abs(thin[1]) > 0.0
    assert not product_eigenvalues(np.array([np.zeros((2, 2)), np.eye(2)])).any()
    with pytest.raises(sb.SolveError, match="derivative of a segment is not finite"):
        product_eigenvalues(np.full((2, 2, 2), np.nan))


def exact_factors(powers, seed=1):
    """Factors of a product whose eigenvalues are powers of two, by rational arithmetic, each number rounded
    once: integer bases of determinant one, and powers (n, s) between them.
    """
    random, (count, size) = np.random.default_rng(seed), np.shape(powers)

    def triangle():
        """A unit lower triangular matrix of integers and its inverse, as exact numbers."""
        lower = np.tril(random.integers(-2, 3, (size, size)), -1).astype(object) + np.eye(size, dtype=int)
        inverse = np.eye(size, dtype=int).astype(object)
        for row in range(size):
            inverse[row] -= lower[row, :row] @ inverse[:row]
        return lower, inverse

    pairs = [(triangle(), triangle()) for _ in range(count)]
    bases = [one @ other.T for (one, _), (other, _) in pairs]
    inverses = [other.T @ one for (_, one), (_, other) in pairs]
    return np.array(
        [
            bases[(k + 1) % count] @ np.diag([Fraction(2) ** int(p) for p in powers[k]]) @ inverses[k]
            for k in range(count)
        ],
        dtype=float,
    )


@pytest.mark.parametrize("count", [8, 64])
def test_known_powers_of_two(count):
    """From 2^(4 n) to 2^(-4 n), 1e77 to 1e-77 for 64 factors: to what rounding does to the factors."""
    powers = np.tile([4, 2, 0, -2, -4], (count, 1))
    found = product_eigenvalues(exact_factors(powers))
    assert found == pytest.approx(2.0 ** powers.sum(axis=0), rel=1e-8)


@pytest.mark.parametrize("count", [1, 2, 8])
def test_cyclic_systems(count):
    """The solution satisfies the bordered equations of segments whose product grows by 1e12, to rounding."""
    random = np.random.default_rng(2)
    factors, column = (
        given(np.array([1e12, 1e6, 3.0, 1e-12]), count, seed=1),
        random.normal(size=(4 * count, 1)),
    )
    right, row = random.normal(size=4 * count + 1), random.normal(size=4 * count + 1)
    following = np.kron(np.roll(np.eye(count), 1, axis=1), np.eye(4))
    matrix = sparse.csr_array(np.hstack([block_diag(*factors) - following, column]))
    found = Sparse(matrix).bordered(row).solve(right)
    scale = np.abs(factors).max() * np.abs(found).max()
    assert np.abs(matrix @ found - right[:-1]).max() < 1e-12 * scale
    assert abs(row @ found - right[-1]) < 1e-12 * scale
    with pytest.raises(sb.SolveError, match="not isolated"):
        Sparse(0.0 * matrix).bordered(row)


@pytest.mark.parametrize("segments", [2, 8])
def test_single_shooting(mass, fast, segments):
    """The same steps: the same motion and multipliers, from the linear response."""
    found = sb.periodic(mass, [1.0], FAST, steps=STEPS, periods=1, segments=segments)
    u = fast.displacement("A")
    assert np.abs(found.displacement("A") - u).max() < 1e-8 * np.abs(u).max() and found.iterations > 0
    assert found.multipliers == pytest.approx(fast.multipliers, rel=1e-8)
    assert found.multiplier_error == pytest.approx(fast.multiplier_error, rel=1e-4)
    assert found.path == "multiple shooting"


def test_several_contact_rows_and_modes():
    """Two masses against a stiff stop, in contact."""
    system = two_masses()
    one = sb.periodic(system, [0.1], 0.65 / TURN, steps=256)
    many = sb.periodic(system, [0.1], 0.65 / TURN, steps=256, segments=4, guess=one)
    assert one.contact_force.max() > 0.0 and many.iterations == 0
    # the order within a pair is rounding's
    assert np.abs(many.multipliers) == pytest.approx(np.abs(one.multipliers), rel=1e-8)
    assert np.sort(many.multipliers.imag) == pytest.approx(np.sort(one.multipliers.imag), rel=1e-8)
    # from a neighbour
    near = sb.periodic(system, [0.1], 0.66 / TURN, steps=256, segments=4, guess=one)
    again = sb.periodic(system, [0.1], 0.66 / TURN, steps=256, guess=one)
    assert near.iterations > 1 and np.abs(near.state - again.state).max() < 1e-8 * np.abs(again.state).max()


def test_from_the_linear_response():
    """Where pairs switch, Newton's steps lead up before they lead down: the motion of single shooting."""
    single = sb.periodic(two_masses(), [1.0], 0.6 / TURN, steps=512)
    found = sb.periodic(two_masses(), [1.0], 0.6 / TURN, steps=512, segments=4)
    assert np.abs(found.state - single.state).max() < 1e-8 * np.abs(single.state).max()


def test_a_start_of_several_periods():
    """A motion of two forcing periods is cut into segments where it stands: nothing is left to do."""
    one = sb.periodic(one_mass(0.0, 0.02, stiffness=50.0), 1.0, 0.41, steps=512, periods=2)
    assert np.abs(one.subharmonics("A")[1]) > 0.1
    many = sb.periodic(one.reduced, 1.0, 0.41, steps=512, periods=2, segments=4, guess=one)
    assert many.iterations == 0 and many.periods == 2


def test_a_start_in_other_modes():
    """From fewer and from more modes the motion of single shooting; without stability no uncertainty of it is
    told (0, as if multipliers were known exactly, before).
    """
    beam, push = coarse_beam(0.002), sb.PointForce("A", fy=300.0)
    few, more = (
        sb.periodic(beam, push, 433.0, modes=modes, steps=256, stability=False) for modes in (20, 30)
    )
    for start, end in ((few, more), (more, few)):
        asked = dict(modes=len(end.reduced.omega), steps=256, stability=False)
        found = sb.periodic(beam, push, 433.0, guess=start, segments=4, **asked)
        np.testing.assert_allclose(found.state, end.state, atol=1e-8 * np.linalg.norm(end.state))
        assert found.iterations < 10  # which it takes from the linear response
        assert not len(found.multipliers) and np.isnan(found.multiplier_error)


def test_powers_of_multipliers(mass, fast):
    """64 periods of an unstable motion: its multipliers to the power of 64, 6e17 and 4e-21."""
    found = sb.periodic(mass, [1.0], FAST, steps=STEPS, periods=64, segments=64, guess=fast)
    assert np.abs(fast.multipliers[0]) ** 64 > 1e17
    assert found.multipliers == pytest.approx(fast.multipliers**64, rel=1e-10)


def test_a_fast_tone_on_a_slow_one(mass):
    """A thirty-second of the frequency beside it: disturbances grow by 3e8 in the slow period. Each of its
    parts agrees with an independent integration, as the steps allow; single shooting from the same guess ends
    on another motion.
    """
    ratio = 32
    slow, load = FAST / ratio, [sb.Harmonic(1.0, FAST) + sb.Harmonic(0.1, FAST / ratio)]
    found = sb.periodic(mass, load, slow, steps=STEPS * ratio, segments=ratio)
    assert np.abs(found.multipliers[0]) > 1e8 and found.iterations <= 15
    # Liouville's formula, as far as located switches keep volumes
    assert np.prod(found.multipliers) == pytest.approx(np.exp(-2.0 * DAMPING / slow), rel=2e-3)
    states = np.concatenate([found.states.q, found.states.v], axis=1)

    def rates(t, state):
        x, v = state
        force = np.sin(TURN * FAST * t) + 0.1 * np.sin(TURN * slow * t)
        return [v, force - 2.0 * DAMPING * v - x + 3.0 * max(-x, 0.0)]

    for k in (0, 5, 20):
        begin = k * STEPS
        span = found.time[begin], found.time[begin] + 1.0 / FAST
        end = solve_ivp(rates, span, states[begin], rtol=1e-9, atol=1e-12).y[:, -1]
        assert np.abs(end - states[(begin + STEPS) % len(states)]).max() < 1e-3 * np.abs(states).max()
    try:
        single = sb.periodic(mass, load, slow, steps=STEPS * ratio, search=NEWTON_ALONE)
    except sb.SolveError:
        return
    assert np.abs(single.displacement("A") - found.displacement("A")).max() > 0.1


@pytest.mark.parametrize(
    "options, sentence",
    [
        ({"segments": 7}, "64 steps a period are no multiple of segments = 7"),
        ({"segments": 0}, "segments"),
        ({"segments": 4, "jacobian": "dense"}, "jacobian = .dense. is not for segments = 4"),
    ],
)
def test_bad_requests(mass, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        sb.periodic(mass, [1.0], FAST, steps=STEPS, periods=1, **options)


def test_the_default_steps_fit_the_segments(mass):
    """Three segments of 171 steps, the motion of one segment of 512 up to the steps' own difference."""
    found, single = (sb.periodic(mass, [1.0], FAST, periods=1, segments=count) for count in (3, 1))
    assert len(found.time) == 513 and len(single.time) == 512
    assert abs(found.harmonics("A")[1]) == pytest.approx(abs(single.harmonics("A")[1]), rel=1e-4)


COUNTS = 1, 2, 3, 5, 8, 20


@pytest.mark.long
def test_multipliers_do_not_depend_on_the_segments():
    """On either side of a period doubling and of both folds of two masses' curve (the table of
    docs/verification/steady_states.md): the largest of 2 to 20 segments is that of one to 1e-9, or, where a
    pair switches in a step beside the end of a segment, within the error of the steps that is told.
    """
    curve = sb.frequency_response(two_masses(), [0.1], 0.5 / TURN, 0.9 / TURN, steps=1920)
    sides = [k for item in curve.bifurcations if item.kind in KINDS for k in (item.after - 1, item.after)]
    apart, text = [], ""
    for k in sides:
        orbit, found = curve.orbit(k), []
        for count in COUNTS:
            begins = at_segments(orbit, curve.period, orbit.frequency, count)
            _, parts = shoot_segments(curve.period, orbit.frequency, count, begins)
            value = segmented_stability(parts)[0][0]
            found.append(complex(value.real, abs(value.imag)))  # either of a pair
        apart.append(max(abs(value - found[0]) for value in found))
        value = curve.multipliers[k, 0]
        assert abs(found[0] - complex(value.real, abs(value.imag))) < 1e-9
        assert apart[-1] < max(1e-9, orbit.multiplier_error)
        text += f"{TURN * orbit.frequency:.5f} " + " ".join(f"{value:.10f}" for value in found) + "\n"
    assert len(sides) == 8 and sum(value < 1e-9 for value in apart) >= 6, text
