"""The active set against problems with known answers, brute force and hard starts."""

import itertools

import numpy as np
import pytest

from sbfem_petsc.contact.complementarity import one_pass_tie, solve_complementarity


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


@pytest.mark.parametrize("maximum", [1, 200])
@pytest.mark.parametrize("unit", [1e-16, 1e16])
def test_scaling_of_units(unit, maximum):
    """The unit of length takes no part, not in the fallback either: its tolerance is relative to the gaps."""
    w, q = random_problem(20, 5)
    base = solve_complementarity(w, q)
    scaled = solve_complementarity(unit * w, unit * q, maximum=maximum)
    assert np.array_equal(base.active, scaled.active) and 0 < base.active.sum() < 20
    np.testing.assert_allclose(scaled.force, base.force, rtol=1e-9, atol=1e-9 * base.force.max())


def test_pair_without_flexibility_has_no_say():
    """Both of its nodes are held fixed: it may overlap as it does, and the others are as without it."""
    w, q = random_problem(6, 2)
    held = np.zeros((7, 7))
    held[np.ix_(range(1, 7), range(1, 7))] = w
    for gap in (-0.5, 0.5):
        result = solve_complementarity(held, np.append(gap, q))
        np.testing.assert_allclose(
            result.force, np.append(0.0, solve_complementarity(w, q).force), atol=1e-12
        )


def test_no_contact_and_no_pairs():
    w, q = random_problem(5, 1)
    free = solve_complementarity(w, np.abs(q) + 0.1)
    assert not free.active.any() and not free.force.any()
    assert len(solve_complementarity(np.empty((0, 0)), np.empty(0)).force) == 0


def test_one_pass_tie_admits_tension():
    """A pair that the others pull open stays tied: its force is tension and its gap zero."""
    w = np.array([[2.0, 1.5], [1.5, 2.0]])
    q = np.array([-1.0, -0.1])
    tied = one_pass_tie(w, q)
    assert tied.force[1] < 0
    np.testing.assert_allclose(tied.gap, 0, atol=1e-15)
    assert solve_complementarity(w, q).force[1] == 0
