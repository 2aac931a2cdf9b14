"""The active set against problems with known answers, brute force and hard starts."""

import itertools

import numpy as np
import pytest

import sbfem_petsc as sb
from examples.paper.time_scheme import tied_in_one_pass
from sbfem_petsc.contact.complementarity import Condensed, active_set, solve_complementarity
from sbfem_petsc.contact.law import FREE, PRESSED, RowLaws


def random_problem(n, seed):
    generator = np.random.default_rng(seed)
    factor = generator.standard_normal((n, n + 2))
    return factor @ factor.T, generator.standard_normal(n)


def brute_force(w, q):
    """All 2^n active sets."""
    n = len(q)
    for active in itertools.product([False, True], repeat=n):
        a = np.flatnonzero(active)
        force = np.zeros(n)
        if len(a):
            force[a] = np.linalg.solve(w[np.ix_(a, a)], -q[a])
        if (force >= 0).all() and (np.delete(w @ force + q, a) >= 0).all():
            return force
    raise AssertionError("no solution")


@pytest.mark.parametrize("seed", range(40))
def test_against_brute_force(seed):
    w, q = random_problem(8, seed)
    result = solve_complementarity(w, q)
    np.testing.assert_allclose(result.force, brute_force(w, q), atol=1e-9)
    assert (result.gap >= -1e-9).all() and (result.force >= 0).all()


@pytest.mark.parametrize("seed", range(10))
def test_any_start_gives_the_same_answer(seed):
    """A warm start changes the work, not the answer; large random problems make the plain iteration cycle at
    times.
    """
    w, q = random_problem(60, seed)
    expected = solve_complementarity(w, q)
    generator = np.random.default_rng(seed)
    for _ in range(5):
        result = solve_complementarity(w, q, start=generator.random(60) < 0.5)
        np.testing.assert_allclose(result.force, expected.force, atol=1e-9 * np.abs(expected.force).max())


def test_fallback_ends_where_the_iteration_cycles():
    """With one iteration allowed the principal pivoting does the work."""
    w, q = random_problem(30, 3)
    expected = solve_complementarity(w, q)
    result = solve_complementarity(w, q, maximum=1)
    np.testing.assert_allclose(result.force, expected.force, atol=1e-9 * expected.force.max())


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("maximum", [200, 1])
def test_rows_of_any_size(maximum):
    """Rows of other units, by factors of 1e-12 to 1e12 each: the same rows touch, in the iteration and in the
    fallback, and the solves are as well conditioned; a tolerance in the unit of another row would let
    overlapping rows pass.
    """
    for seed in range(20):
        w, q = random_problem(12, seed)
        unit = 10.0 ** np.random.default_rng(seed).uniform(-12, 12, 12)
        base = solve_complementarity(w, q)
        scaled = solve_complementarity(unit[:, None] * w * unit, unit * q, maximum=maximum)
        assert np.array_equal(base.active, scaled.active)
        np.testing.assert_allclose(scaled.force * unit, base.force, atol=1e-9 * base.force.max())
        np.testing.assert_allclose(scaled.gap / unit, base.gap, atol=1e-9 * np.abs(base.gap).max())


@pytest.mark.parametrize("maximum", [200, 1])
def test_signs(maximum):
    """By hand: of two rows that both overlap, the first one's force opens the second by more than its
    overlap; compression is positive, and a row that would have to pull comes apart.
    """
    w = np.array([[2.0, 1.5], [1.5, 2.0]])
    found = solve_complementarity(w, np.array([-1.0, -0.1]), maximum=maximum)
    np.testing.assert_allclose(found.force, [0.5, 0.0], atol=1e-15)
    np.testing.assert_allclose(found.gap, [0.0, 0.65], atol=1e-15)
    assert found.active.tolist() == [True, False]
    # both press
    found = solve_complementarity(w, np.array([-1.0, -1.0]), maximum=maximum)
    np.testing.assert_allclose(found.force, [1 / 3.5, 1 / 3.5], rtol=1e-14)
    # an active row of a warm start whose gap is open lets go
    found = solve_complementarity(w, np.array([1.0, 2.0]), start=np.ones(2, dtype=bool), maximum=maximum)
    assert not found.force.any() and not found.active.any()


@pytest.mark.parametrize("maximum", [200, 1])
def test_rows_without_flexibility(maximum):
    """Pairs of which both nodes are held fixed: no force can close them, and they take no part."""
    w, q = random_problem(6, 2)
    held = np.zeros((8, 8))
    held[np.ix_([0, 1, 3, 4, 6, 7], [0, 1, 3, 4, 6, 7])] = w
    gap = np.insert(q, [2, 4], [0.0, -1e-3])
    found = solve_complementarity(held, gap, maximum=maximum)
    assert not found.force[[2, 5]].any() and not found.active[[2, 5]].any()
    expected = solve_complementarity(w, q)
    np.testing.assert_allclose(np.delete(found.force, [2, 5]), expected.force, atol=1e-12)


def test_no_contact_and_no_pairs():
    w, q = random_problem(5, 1)
    free = solve_complementarity(w, np.abs(q) + 0.1)
    assert not free.active.any() and not free.force.any()
    assert len(solve_complementarity(np.empty((0, 0)), np.empty(0)).force) == 0


def test_a_pair_that_others_open():
    """Tied in one pass, as the paper does, it pulls: its force is tension; without that it is free."""
    w = np.array([[2.0, 1.5], [1.5, 2.0]])
    q = np.array([-1.0, -0.1])
    tied = tied_in_one_pass(w, q)
    assert tied[1] < 0
    np.testing.assert_allclose(q + w @ tied, 0, atol=1e-15)
    assert solve_complementarity(w, q).force[1] == 0


@pytest.mark.parametrize("touching", [FREE, PRESSED])
def test_a_solution_is_seen_at_once(touching):
    """From its own states in the one iteration that is allowed, by hand; a row that touches without a force
    may be in either.
    """
    start = np.array([touching, PRESSED, FREE], dtype=np.int8)
    found = solve_complementarity(
        np.diag([2.0, 4.0, 1.0]), np.array([0.0, -1.0, 3.0]), start=start, maximum=1
    )
    assert found.iterations == 1 and found.state.tolist() == start.tolist()
    assert found.force.tolist() == [0.0, 0.25, 0.0] and found.gap.tolist() == [0.0, 0.0, 3.0]


def test_what_rounding_may_have_done_opens_no_row():
    """Of solves that are right to a hundredth of the largest force: by hand, a row that pulls by a thousandth
    of it stays closed, without force, and one that pulls by a twentieth opens.
    """

    class Loose(Condensed):
        rounding = 0.01

    start = np.full(3, PRESSED, dtype=np.int8)
    found, _ = active_set(Loose(np.eye(3), 10), np.array([-1.0, 0.001, 0.05]), RowLaws.unilateral(3), start)
    assert found.state.tolist() == [PRESSED, PRESSED, FREE]
    assert found.force.tolist() == [1.0, 0.0, 0.0]


def test_rows_that_depend_on_each_other_are_told_alike():
    """Of statics and of a derivative, which had been a bare error of NumPy."""
    stiffness = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    twice = sb.reduce_matrices(
        np.eye(3),
        stiffness,
        np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        np.zeros(2),
        loads=np.array([[0.0], [0.0], [1.0]]),
        sensors={"3": 2},
        modes=2,
        contact_laws=sb.Tied(),
    )
    for call in (lambda: sb.static(twice, 1.0), lambda: twice.closed_sets[np.ones(2, dtype=bool)]):
        with pytest.raises(sb.SolveError, match="closed depend on each other; is a pair given twice"):
            call()
