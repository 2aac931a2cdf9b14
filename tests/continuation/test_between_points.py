"""What a branch passes between two of its points is told as if its points were dense: folds of which a step
has passed over both, and stretches without stability that begin and end between two points.
"""

import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.continuation.events import FINE, _arrived
from sbfem_petsc.continuation.extrapolation import _Passage


def stopped_chain(seed: int) -> tuple[sb.ReducedModel, float]:
    """A random chain of masses between walls with elastic stops, and a force's amplitude on the first one."""
    generator = np.random.default_rng(seed)
    n = int(generator.integers(2, 6))
    stops = int(generator.integers(1, min(n, 3) + 1))
    mass, stiffness = np.diag(generator.uniform(0.5, 3.0, n)), np.zeros((n, n))
    for i in range(n):
        stiffness[i, i] += generator.uniform(0.0, 0.5) + (1.0 if i in (0, n - 1) else 0.0)
    for i in range(n - 1):
        spring = generator.uniform(0.5, 2.0)
        stiffness[i : i + 2, i : i + 2] += spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    places = generator.choice(n, stops, replace=False)
    rows = np.eye(n)[places] * np.where(generator.random(stops) < 0.5, 1.0, -1.0)[:, None]
    gap = generator.uniform(0.3, 1.5, stops)
    damping = float(generator.uniform(0.02, 0.06)) * stiffness
    compliance = generator.uniform(0.02, 0.5, stops)
    chain = sb.reduce_matrices(
        mass,
        stiffness,
        rows,
        gap,
        loads=np.eye(n)[:, :1],
        sensors={"last": n - 1},
        damping=damping,
        compliance=compliance,
    )
    return chain, float(generator.uniform(0.05, 0.3))


def passed(chain: sb.ReducedModel, force: float, start: float, stop: float, **asked) -> list[tuple]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        curve = sb.frequency_response(chain, [force], start, stop, **asked)
    return [(item.kind, item.value) for item in curve.bifurcations]


@pytest.mark.parametrize(
    ("seed", "around", "steps", "expected"),
    [
        # two steps of usual length pass over two folds each, and a third one over a doubling and its end
        pytest.param(
            1001, (0.0868, 0.0906), 1024, 2 * ["period doubling"] + 6 * ["fold"], marks=pytest.mark.long
        ),
        # two folds and the end of a doubling between two points whose values are 2e-5 apart
        pytest.param(2028, (0.07944, 0.07979), 256, 2 * ["period doubling", "fold"], marks=pytest.mark.long),
        # .3 % wide, begins where a stop is met once more in a period
        pytest.param(1013, (0.14, 0.157), 256, 2 * ["Neimark-Sacker"], marks=pytest.mark.long),
        # .4 % wide, a pair is 8e-5 inside the unit circle at the point behind it
        pytest.param(1057, (0.0905, 0.0925), 256, 2 * ["Neimark-Sacker"], marks=pytest.mark.long),
        # .7 % wide, at its begin a multiplier jumps from -.7 to -1.3
        pytest.param(1069, (0.0905, 0.0946), 256, 2 * ["period doubling"], marks=pytest.mark.long),
    ],
)
def test_as_of_dense_points(seed, around, steps, expected):
    chain, force = stopped_chain(seed)
    first = chain.frequencies[0]
    whole = passed(chain, force, 0.7 * first, 1.4 * first, steps=steps)
    found = [item for item in whole if item[0] in expected]
    found = [item for item in found if around[0] < item[1] < around[1]]
    dense = passed(chain, force, *around, steps=512, largest_step=(around[1] - around[0]) / 60, points=400)
    assert [kind for kind, _ in dense] == [kind for kind, _ in found] == expected
    # what is left of the error of the steps behind its extrapolation
    np.testing.assert_allclose([value for _, value in found], [value for _, value in dense], rtol=5e-6)


@pytest.mark.long
def test_a_fold_beside_another_one():
    """In the step behind a fold that is told: at the end of an unstable stretch, where a multiplier leaves
    1.013 for .994.
    """
    chain, force = stopped_chain(7023)
    first = chain.frequencies[0]
    told = [passed(chain, force, 0.95 * first, 1.25 * first, steps=steps) for steps in (512, 1024)]
    coarse, fine = ([value for kind, value in found if kind == "fold"] for found in told)
    np.testing.assert_allclose(fine, coarse, rtol=1e-5)
    assert np.min(np.abs(np.array(fine) - 1.168764 * first)) < 1e-5 * first


def test_a_fold_beside_a_corner():
    """Close to where a stop is met once more Newton's method finds no point where the fold is looked for
    first: it has a multiplier of one, and the values of the points beside it are on its side.
    """
    chain, force = stopped_chain(3012)
    first = chain.frequencies[0]
    curve = sb.frequency_response(chain, [force], 0.7 * first, 1.4 * first, steps=256)
    folds = [item for item in curve.bifurcations if item.kind == "fold"]
    np.testing.assert_allclose([item.multiplier for item in folds], np.ones(4), atol=1e-4)
    for item, side in zip(folds, (1.0, -1.0, 1.0, -1.0)):
        assert (side * (item.own_value - curve.value[item.after - 1 : item.after + 1]) >= 0.0).all()


@pytest.mark.parametrize(
    ("heights", "arrived"), [((-10.0, 10.0), True), ((-10.0, 0.0), False), ((0.0, 10.0), False)]
)
def test_a_zero_is_near_where_the_lines_to_either_side_say_so(heights, arrived):
    """Of one that hardly rises from the place on it may be anywhere."""
    expected = {0.0: heights[0], 1.0: 0.1 * FINE, 2.0: heights[1]}
    known = dict.fromkeys(expected)
    assert _arrived(known, dict.fromkeys(known, 1.0), expected, 1.0, lambda *_: True) == arrived


def test_a_pair_is_followed_as_a_pair():
    """In other steps it is none of the real multipliers, however near; where there is none, that is told."""
    passage = object.__new__(_Passage)
    passage.multiplier = 0.95 + 0.05j
    assert passage._excess(np.array([0.95, 0.6 + 0.6j, 0.6 - 0.6j])) == pytest.approx(
        0.6 * np.sqrt(2.0) - 1.0
    )
    with pytest.raises(sb.SolveError, match="the pair has become real"):
        passage._excess(np.array([0.95 + 0.0j, 1.1]))
