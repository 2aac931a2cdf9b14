"""Newton's method, the continuation and its events on equations whose solutions are known."""

import math

import numpy as np
import pytest

from sbfem_petsc.continuation.events import (
    Way,
    between,
    find_zero,
    folds,
    furthest,
    insert,
    refine,
    turns_twice,
)
from sbfem_petsc.continuation.follow import CLOSED, Follower, Line, Settings, follow
from sbfem_petsc.continuation.newton import ITERATIONS, correct
from sbfem_petsc.continuation.problem import Lost, Metric, Point, Range
from sbfem_petsc.errors import PetscFailure

from .problems import ByProducts, Duffing, Equations, circle, kinked, pitchfork


def at(problem, *u):
    """The solution with the last of some unknowns."""
    u = np.array(u, dtype=float)
    return correct(problem, u, Metric(problem, u).level(u, u[-1]))


def test_newton_converges_to_the_root():
    """sqrt(2), with fewer derivatives than iterations."""
    problem = Equations(lambda u: u[0] ** 2 - u[1], lambda u: [2.0 * u[0], -1.0])
    point = at(problem, 1.5, 2.0)
    assert point.u[0] == pytest.approx(math.sqrt(2.0), rel=1e-11)
    assert point.effort < point.iterations and point.value == 2.0


def test_newton_takes_shorter_steps_where_whole_ones_diverge():
    """From 3 on arctan, whose whole Newton steps grow beyond 1.39."""
    problem = Equations(lambda u: math.atan(u[0]) + u[1], lambda u: [1.0 / (1.0 + u[0] ** 2), 1.0])
    assert abs(at(problem, 3.0, 0.0).u[0]) < 1e-9


def test_newton_says_how_far_it_has_come():
    """Equations without a solution, one that is left, and more iterations than are allowed."""
    none = Equations(lambda u: u[0] ** 2 + 1.0 - u[1], lambda u: [2.0 * u[0], -1.0])
    with pytest.raises(Lost, match="has not converged in .* iterations, at"):
        at(none, 1.3, 0.0)
    with pytest.raises(Lost, match="no number"):
        at(Equations(lambda u: np.nan, lambda u: [1.0, 1.0]), 1.0, 0.0)
    slow = Equations(lambda u: u[0] ** 9 - u[1], lambda u: [9.0 * u[0] ** 8, -1.0])
    u = np.array([1.0, 0.0])
    with pytest.raises(Lost, match="more than 3 iterations"):
        correct(slow, u, Metric(slow, u).level(u, 0.0), most=3)
    assert none.states < 10 * ITERATIONS


def test_a_singular_system_is_no_solution():
    with pytest.raises(Lost, match="not isolated"):
        at(Equations(lambda u: u[1] - 1.0, lambda u: [0.0, 1.0]), 1.0, 0.0)


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_circle_closes(direction):
    """From its lowest point around it, through both folds, back to it."""
    problem = circle()
    line = follow(Line([at(problem, 1.0, 0.0)]), Range(-2.0, 2.0, direction))
    assert line.complete and line.reason == CLOSED
    u = np.array([point.u for point in line.points])
    np.testing.assert_allclose(np.hypot(*u.T), 1.0, atol=1e-10)
    angles = np.unwrap(np.arctan2(u[:, 1], u[:, 0]))
    assert (direction * np.diff(angles) > 0.0).all() and abs(angles[-1]) >= 2.0 * math.pi
    assert abs(angles[-2]) < 2.0 * math.pi


@pytest.mark.parametrize(("places", "between"), [((0.0, 1.0, 1.1), 0.5), ((0.0, 0.1, 1.1), 0.6)])
def test_a_bent_branch_has_gone_through_its_points(places, between):
    """Three points of a circle, unevenly apart: one of its points between them is on what lies behind, one a
    tenth aside is not, nor is one ahead.
    """
    problem = circle()

    def on(angle, radius=1.0):
        u = radius * np.array([np.cos(angle), np.sin(angle)])
        return Point(problem, u, None, u[1])

    follower = Follower(Line([on(angle) for angle in places]), Range(-2.0, 2.0, 1), Settings())
    follower.metric = Metric(problem, follower.points[-1].u)
    assert follower._gone_through(on(between))
    assert not follower._gone_through(on(between, 0.9))
    assert not follower._gone_through(on(2.0 * places[-1] - places[-2]))


@pytest.mark.parametrize("name", ["up", "down"])
def test_ends_of_a_range_are_met_exactly(name):
    start, stop = (0.1, 2.3) if name == "up" else (2.3, 0.1)
    problem = Equations(lambda u: u[0] - math.sin(u[1]), lambda u: [1.0, -math.cos(u[1])])
    line = follow(Line([at(problem, 0.0, start)]), Range(0.1, 2.3, 1 if name == "up" else -1))
    assert line.complete and line.points[-1].value == line.points[-1].u[-1] == stop
    assert line.reason == f"end of the range at {stop:g}" and Range(0.1, 2.3, 1).extent == 2.3 - 0.1


def test_folds_of_an_s_shape():
    """x^3 - x = v turns at x = -+1 / sqrt 3: v = +-2 / sqrt 27."""
    problem = Equations(lambda u: u[0] ** 3 - u[0] - u[1], lambda u: [3.0 * u[0] ** 2 - 1.0, -1.0])
    line = follow(Line([at(problem, -2.0, -3.0)]), Range(-3.0, 3.0, 1))
    found = folds(line)
    assert line.complete and len(found) == 2
    values = [point.value for _, point in found]
    assert values == pytest.approx([2.0 / math.sqrt(27.0), -2.0 / math.sqrt(27.0)], rel=1e-7)
    assert [k for k, _ in found] == sorted(k for k, _ in found)


@pytest.mark.parametrize("start, stop", [(0.5, 2.5), (2.5, 0.5)])
def test_folds_of_a_duffing_oscillator(start, stop):
    """Both folds where the discriminant of the amplitude's cubic equation vanishes, and every point on it."""
    problem = Duffing(0.1, 0.5, 0.4)
    lower, upper = problem.folds()
    first = at(problem, math.sqrt(problem.amplitudes(start)[0]) * (1.0 if start < 1.0 else -1.0), 0.0, start)
    line = follow(Line([first]), Range(0.5, 2.5, 1 if stop > start else -1))
    assert line.complete and line.points[-1].value == stop
    for point in line.points:
        squared = float(point.u[:2] @ point.u[:2])
        assert np.abs(problem.amplitudes(point.value) - squared).min() < 1e-7 * squared
    found = [point.value for _, point in folds(line)]
    assert sorted(found) == pytest.approx([lower, upper], rel=1e-7)


def test_without_a_matrix():
    """The same curve by products and GMRES, which know no determinant."""
    dense = Duffing(0.1, 0.5, 0.4)
    products = ByProducts(dense.function, dense.derivative)
    lines = [follow(Line([at(problem, 0.5, 0.0, 0.5)]), Range(0.5, 2.5, 1)) for problem in (dense, products)]
    assert lines[1].complete and lines[1].sign is None
    ends = [line.points[-1].u for line in lines]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-8)
    assert max(lines[0].values) == pytest.approx(max(lines[1].values), rel=1e-2)


def test_through_a_pitchfork():
    """On x = 0 the determinant changes its sign at v = 0, and the line goes on as it went."""
    line = follow(Line([at(pitchfork(), 0.0, -1.0)]), Range(-1.0, 1.0, 1))
    assert line.complete and (np.diff(line.values) > 0.0).all() and not any(p.u[0] for p in line.points)
    imperfect = follow(Line([at(pitchfork(0.05), -1.0, -1.0)]), Range(-1.0, 1.0, 1))
    assert imperfect.complete and abs(imperfect.points[-1].u[0]) > 0.9


def test_a_cusp():
    """x^3 = v^2, without a tangent at v = 0, which steps of points off it pass."""
    problem = Equations(lambda u: u[0] ** 3 - u[1] ** 2, lambda u: [3.0 * u[0] ** 2, -2.0 * u[1]])
    line = follow(Line([at(problem, 1.0, -1.0)]), Range(-1.0, 1.0, 1), Settings(points=200))
    assert line.complete and line.points[-1].value == 1.0 and (np.diff(line.values) > 0.0).all()
    assert all(abs(p.u[0] ** 3 - p.value**2) < 1e-9 for p in line.points)


def test_a_corner_at_which_the_branch_turns():
    """v = x up to 1 and 3 - 2 x beyond: passed with a look at the linearised equations there alone."""
    line = follow(Line([at(kinked(), 0.0, 0.0)]), Range(-1.0, 1.5, 1))
    assert (
        line.complete and line.points[-1].value == -1.0 and max(line.values) == pytest.approx(1.0, abs=0.01)
    )
    smooth = kinked()
    smooth.corners = False
    other = follow(Line([at(smooth, 0.0, 0.0)]), Range(-1.0, 1.5, 1))
    assert not other.complete and "no further point within a step of 1e-05 at 0.99999" in other.reason


def test_largest_step_and_points():
    problem = Equations(lambda u: u[0] - u[1], lambda u: [1.0, -1.0])
    line = follow(Line([at(problem, 0.0, 0.0)]), Range(0.0, 1.0, 1), Settings(largest_step=0.02))
    assert np.diff(line.values).max() <= 0.02 + 1e-12 and line.complete
    line = follow(Line([at(problem, 0.0, 0.0)]), Range(0.0, 1.0, 1), Settings(points=5))
    assert len(line.points) == 5 and line.reason == "5 points" and not line.complete


def test_a_line_is_gone_on_with():
    """From what a recorder keeps, the unknowns, the next length and the sign, bit for bit; a complete one
    stays as it is.
    """
    problem = Duffing(0.1, 0.5, 0.4)
    first, within, kept = at(problem, 0.5, 0.0, 0.5), Range(0.5, 2.5, 1), []

    def recorder(line):
        kept.append(([point.u for point in line.points], line.length, line.sign))

    whole = follow(Line([first]), within, recorder=recorder)
    for stopped in (3, len(kept) // 2, len(kept) - 2):
        unknowns, length, sign = kept[stopped]
        line = Line([Point.known(problem, u) for u in unknowns], length, sign)
        follow(line, within)
        np.testing.assert_array_equal([p.u for p in line.points], [p.u for p in whole.points])
    count = len(whole.points)
    assert len(follow(whole, within).points) == count


def test_solutions_that_are_not_isolated():
    problem = Equations(lambda u: [0.0, u[1]], lambda u: [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    line = follow(Line([Point.known(problem, np.array([1.0, 0.0, 0.5]))]), Range(0.0, 1.0, 1))
    assert line.reason == "solutions are not isolated at 0.5" and len(line.points) == 1


def test_a_refusal_ends_the_line():
    problem = Equations(lambda u: u[0] - u[1], lambda u: [1.0, -1.0])
    problem.refuse = lambda last, point: "it falls" if point.value > 0.5 else ""
    line = follow(Line([at(problem, 0.0, 0.0)]), Range(0.0, 1.0, 1))
    assert line.reason == "it falls" and 0.4 < line.points[-1].value <= 0.5


def test_another_discretisation_on_the_way():
    """x = v in one unknown, later in two: the line goes on in them."""
    two = Equations(lambda u: [u[0] - u[2], u[1] - u[2]], lambda u: [[1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
    one = Equations(lambda u: u[0] - u[1], lambda u: [1.0, -1.0])

    def advanced(points):
        last = points[-1]
        if last.value < 0.5:
            return None
        return two, Point.known(two, np.array([last.value, last.value, last.value]))

    one.advanced = advanced
    line = follow(Line([at(one, 0.0, 0.0)]), Range(0.0, 1.0, 1))
    sizes = [len(point.u) for point in line.points]
    assert line.complete and sizes == sorted(sizes) and set(sizes) == {2, 3} and line.problem is two


def test_points_between_two():
    """At their fractions of the way: across the chord, or of the value where the way is mostly that."""
    problem = circle()
    line = follow(Line([at(problem, 1.0, 0.0)]), Range(-2.0, 2.0, 1))
    for k in (1, len(line.points) // 2):
        for fraction in (0.25, 0.5):
            point = between(line, k, fraction)
            assert abs(point.u @ point.u - 1.0) < 1e-10
            assert Way(line, k).place_of(point) == pytest.approx(fraction, abs=1e-9)


def test_a_zero_between_two_points():
    """Where x = y on the circle, at 45 degrees."""
    problem = circle()
    line = follow(Line([at(problem, 1.0, 0.0)]), Range(-2.0, 2.0, 1))

    def test(point):
        return float(point.u[0] - point.u[1])

    k = next(k for k, (a, b) in enumerate(zip(line.points, line.points[1:])) if test(a) * test(b) < 0.0)
    point, one, other = find_zero(line, k, test, (test(line.points[k]), test(line.points[k + 1])))
    assert abs(math.atan2(*point.u[::-1]) - 0.25 * math.pi) < 5e-3 and test(one) * test(other) < 0.0


def test_finer_points_where_heights_bend():
    """A Lorentz curve's peak stands within a hundredth of its width."""
    width = 0.01
    problem = Equations(
        lambda u: u[0] - 1.0 / (1.0 + ((u[1] - 0.437) / width) ** 2),
        lambda u: [
            1.0,
            2.0 * (u[1] - 0.437) / width**2 / (1.0 + ((u[1] - 0.437) / width) ** 2) ** 2,
        ],
    )
    line = follow(Line([at(problem, 0.0, 0.0)]), Range(0.0, 1.0, 1), Settings(largest_step=0.02))
    coarse, told = len(line.points), []
    refine(line, lambda: line.values, lambda: np.array([[point.u[0] for point in line.points]]), told.append)
    heights = [float(point.u[0]) for point in line.points]
    assert len(told) == len(line.points) - coarse and set(told) <= set(line.points)
    assert len(heights) == len(line.points) > coarse and (np.diff(line.values) > 0.0).all()
    assert abs(line.values[np.argmax(heights)] - 0.437) < 0.2 * width and max(heights) > 0.99


def test_a_tongue_is_leapt_over():
    """Below the length at which a way past what stops it is sought, the problem's own leap is taken."""

    def broken(u):
        return np.nan if 0.4 < u[1] < 0.8 else u[0] - u[1]

    problem = Equations(broken, lambda u: [1.0, -1.0])
    line = follow(Line([at(problem, 0.0, 0.0)]), Range(0.0, 1.0, 1))
    assert not line.complete and line.points[-1].value <= 0.4 and "no further point" in line.reason
    problem.narrow = 1e-2
    problem.leap = lambda points, direction: Point.known(problem, np.array([0.9, 0.9]))
    line = follow(Line([at(problem, 0.0, 0.0)]), Range(0.0, 1.0, 1))
    assert line.complete


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("late", [0.0, 0.15, 0.25])
def test_points_that_turn_behind_their_tangents(way, late):
    """As among the teeth of time steps, at a least or a largest value: the fold is where tangents turn."""
    problem = Equations(lambda u: u[1] - 10.0 - way * (u[0] - late) ** 2, lambda u: [-2.0 * way * u[0], 1.0])
    places = 0.1 * np.arange(-6, 7) + 0.03
    line = Line([Point.known(problem, np.array([x, 10.0 + way * (x - late) ** 2])) for x in places])
    ((before, fold),) = folds(line)
    assert before == 5 and fold.u == pytest.approx([0.0, 10.0 + way * late**2], abs=1e-7)


def test_lengths_and_angles_in_units():
    """By hand: of weights 3 and .5 the step (1, 2) is sqrt 10 long; rows say arc length along a tangent."""
    problem = Equations(lambda u: [0.0], lambda u: [[0.0, 0.0]], units=[4.0, 0.1], weights=[3.0, 0.5])
    metric = Metric(problem, np.zeros(2))
    step, tangent = np.array([1.0, 2.0]), np.array([-2.0, 1.0])
    assert metric.length(step) == pytest.approx(math.sqrt(10.0), rel=1e-14)
    assert metric.dot(step, tangent) == pytest.approx(-17.5, rel=1e-14)
    assert metric.row(tangent) @ (step * [4.0, 0.1]) == pytest.approx(-17.5, rel=1e-14)
    assert metric.pace(np.zeros(2)) == pytest.approx(0.1, rel=1e-14)


def test_units_and_origin_change_nothing():
    """Unknowns and the value in units of their own, the value counted from elsewhere: the same points to
    rounding, with as many iterations.
    """
    plain, factors, origin = Duffing(0.1, 0.5, 0.4), np.array([1024.0, 0.25, 4.0]), np.array([0.0, 0.0, 50.0])
    scaled = Equations(
        lambda u: plain.function((u - origin) / factors),
        lambda u: plain.derivative((u - origin) / factors) / factors,
        factors,
    )
    one = follow(Line([at(plain, 0.5, 0.0, 0.5)]), Range(0.5, 2.5, 1))
    start = np.array([512.0, 0.0, 52.0])
    first = correct(scaled, start, Metric(scaled, start).level(start, 52.0))
    other = follow(Line([first]), Range(52.0, 60.0, 1))
    again = [(p.u - origin) / factors for p in other.points]
    np.testing.assert_allclose(again, [p.u for p in one.points], rtol=1e-10)
    assert [p.effort for p in other.points] == [p.effort for p in one.points]


@pytest.mark.parametrize(("within", "expected"), [(0.01, True), (0.5, False)])
def test_turns_between_two_points(within, expected):
    """x^3 - x = v from x = -.8 to .9, where it goes back by .46, over both folds."""
    problem = Equations(lambda u: u[0] ** 3 - u[0] - u[1], lambda u: [3.0 * u[0] ** 2 - 1.0, -1.0])
    places = (-1.6, -1.2, -0.8, 0.9, 1.3, 1.6)
    line = Line([Point.known(problem, np.array([x, x**3 - x])) for x in places])
    assert [turns_twice(line, k, False, within) for k in range(5)] == [False, False, expected, False, False]


@pytest.mark.parametrize(
    ("values", "k", "within", "expected"),
    [
        ([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0], 2, 5.0, 3),
        ([3.0, 2.0, 1.0, 0.0, 1.0, 2.0, 3.0], 4, 5.0, 3),  # a least one
        ([0.0, 2.0, 1.0, 1.5, 0.5, 0.0, -1.0], 3, 5.0, 1),  # a tooth at 3, beyond which 1 goes
        ([0.0, 2.0, 1.0, 1.5, 0.5, 0.0, -1.0], 3, 0.4, None),  # which is not near enough
        ([0.0, 1.0, 0.9, 3.0, 4.0, 5.0, 6.0], 1, 9.0, None),
        # what is more than three points away does not count
        ([0.0, 1.0, 0.5, 0.4, 0.3, 2.0, 3.0], 1, 9.0, 1),
        ([9.0, 0.3, 0.4, 0.5, 1.0, 0.0], 4, 20.0, 4),
    ],
)
def test_where_points_turn(values, k, within, expected):
    line = Line([Point(None, np.array([v]), None, v) for v in values])
    assert furthest(line, k, within) == expected


def test_a_refusal_of_petsc_is_no_point_that_is_not_found(monkeypatch):
    """Another first guess would not change it; a point that is lost is left out."""
    line = follow(Line([at(circle(), 1.0, 0.0)]), Range(-2.0, 2.0, 1), Settings(points=6))
    line.most = 20
    for failure in (Lost("nothing here"), PetscFailure("an option is refused")):

        def at_u(u, failure=failure):
            raise failure

        monkeypatch.setattr(line.points[3].problem, "at", at_u)
        if isinstance(failure, PetscFailure):
            with pytest.raises(PetscFailure, match="refused"):
                insert(line, 2, 0.5, print)
        else:
            insert(line, 2, 0.5, print)
        assert len(line.points) == 6
