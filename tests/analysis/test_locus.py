"""Loci of bifurcations: ends on curves of one parameter, the scaling that contact without friction has."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import sbfem_petsc as sb
from meshing.warnings import BranchWarning
from sbfem_petsc.analysis.locus import _passes
from sbfem_petsc.continuation.follow import Follower, Line, Settings
from sbfem_petsc.continuation.problem import Point, Problem, Range
from sbfem_petsc.continuation.problems import locus as locus_module
from sbfem_petsc.continuation.search import NEWTON_ALONE
from sbfem_petsc.plot import plot_loci
from tests.systems import case_p, one_mass, two_masses

TURN = 2.0 * np.pi
START, STOP = 0.5 / TURN, 0.9 / TURN
STEPS = 1024


def response(factor=1.0, damping=0.02):
    system = two_masses(damping, compliance=0.1)
    return sb.frequency_response(system, [0.1 * factor], START, STOP, steps=STEPS)


@pytest.fixture(scope="module")
def curve():
    return response()


def of_kind(branch, kind):
    """Those that a multiplier on the unit circle belongs to."""
    return [b for b in branch.bifurcations if b.kind == kind and abs(abs(b.multiplier) - 1.0) < 0.02]


@pytest.mark.long
def test_predictions_far_out_of_range():
    """Steps of a hundredth of 1e5 would run to factors at which damping is negative; lines turn back where
    they do over a range of 3, and end at its lower end.
    """
    system = two_masses(0.02, compliance=0.1)
    curve = sb.frequency_response(system, [0.1], 0.092, 0.0932, steps=128, points=40)
    (bifurcation,) = curve.bifurcations
    turns = []
    for start, stop in ((1.0, 4.0), (0.0, 1e5)):
        line = sb.locus(curve, bifurcation, start, stop, parameter="damping")
        assert (line.value >= start).all() and np.isfinite(line.frequency).all()
        assert line.reasons == (2 * (f"end of the range at {start:g}",))
        turns.append((line.value.max(), line.frequency[np.argmax(line.value)]))
    assert turns[0][0] == pytest.approx(3.2243, abs=1e-4)
    np.testing.assert_allclose(turns[1:], [turns[0]], rtol=1e-5)


def excess(branch, line, k, apart):
    """By how much the line's multiplier is off its place in the steady state at a frequency a share `apart`
    beside a point of the line, at the point's own load; nan where Newton's method finds none.
    """
    frequency = float(line.frequency[k]) * (1.0 + apart)
    amplitude = float(line.value[k]) * branch.period.excitation.amplitudes[0, 0]
    load = sb.Harmonic(abs(amplitude), frequency, np.angle(amplitude) + 0.5 * np.pi)
    start = replace(branch.orbit(0), state=line.states[k])
    steps = branch.period.steps
    try:
        orbit = sb.periodic(branch.reduced, [load], frequency, steps=steps, search=NEWTON_ALONE, guess=start)
    except sb.SolveError:
        return np.nan
    if line.kind == "Neimark-Sacker":
        return abs(orbit.multipliers[np.argmin(np.abs(orbit.multipliers - line.multiplier[k]))]) - 1.0
    target = 1.0 if line.kind == "fold" else -1.0
    return orbit.multipliers[np.argmin(np.abs(orbit.multipliers - target))].real - target


def within(branch, line, k):
    """Least share of the frequency, 1e-6 or less, to whose either side the multiplier of steady states is on
    either side of its place; inf where there is none. A fold of time steps is jagged: there a motion may be
    missing at a given distance.
    """
    for apart in (1e-9, 1e-8, 1e-7, 1e-6):
        if excess(branch, line, k, -apart) * excess(branch, line, k, apart) < 0.0:
            return apart
    return np.inf


@pytest.mark.long
@pytest.mark.parametrize("kind", ["fold", "period doubling", "Neimark-Sacker"])
def test_every_point_stands_on_a_curve_of_one_parameter(curve, kind):
    """Steady states at the points' own loads, which know nothing of the line, have the bifurcation at the
    same frequency to 1e-6; a whole curve at one of the loads has it as far as curves locate it (5e-3 of a
    step).
    """
    line = sb.locus(curve, of_kind(curve, kind)[0], 0.93, 1.4, points=8)
    assert len(line) >= 12 and np.ptp(line.value) > 0.1
    assert np.abs(line.multiplier) == pytest.approx(np.ones(len(line)), abs=1e-5)
    assert [within(curve, line, k) <= 1e-6 for k in range(len(line))] == len(line) * [True]
    found = [item.own_value for item in of_kind(response(float(line.value[-1])), kind)]
    assert np.abs(np.array(found) / line.frequency[-1] - 1.0).min() < (1e-4 if kind == "fold" else 2e-5)


@pytest.mark.long
@pytest.mark.parametrize(
    "kind, damping, force, window",
    [("Neimark-Sacker", 0.002, 700.0, (14235.0, 14228.0)), ("fold", 0.001, 1500.0, (14100.0, 14135.0))],
)
def test_paper_beam(kind, damping, force, window):
    """Fig. 11 of the paper: points of loci over frequency and force against steady states, to 1e-6.
    Multipliers jump by some 1e-7 where pairs switch in other steps, which does not stop the line of folds.
    """
    reduced = sb.reduce(case_p(damping), sb.PointForce("A", fy=1.0), modes=80)
    branch = sb.frequency_response(reduced, [force], *window, steps=256)
    first = next(item for item in branch.bifurcations if item.kind == kind)
    line = sb.locus(branch, first, 0.9, 1.1, points=8)
    if kind == "fold":
        assert line.reasons == ("end of the range at 0.9", "end of the range at 1.1")
    assert len(line) >= 9
    assert [within(branch, line, k) <= 1e-6 for k in (0, len(line) // 3, -1)] == 3 * [True]


@pytest.mark.long
def test_a_multiplier_that_hardly_leaves_the_circle():
    """Fig. 11 again: a pair at an angle of 0.6 degrees changes its modulus by 1e-5 in a Hz, and by 2e-7 from
    one switch within the steps to the next. Its line is followed through: forces at which it ended before,
    and between, on curves of one parameter, to what that scatter is in frequency at half
    as many steps, 0.03 Hz.
    """
    reduced = sb.reduce(case_p(0.002), sb.PointForce("A", fy=1.0), modes=80)
    branch = sb.frequency_response(reduced, [700.0], 14205.0, 14215.0, steps=512)
    (first,) = (item for item in branch.bifurcations if abs(item.multiplier - 1.0) < 0.02)
    line = sb.locus(branch, first, 600.0 / 700.0, 1000.0 / 700.0, points=40)
    assert all(reason.startswith("end of the range") for reason in line.reasons)
    assert all(within(branch, line, k) <= 1e-6 for k in range(0, len(line), 3))
    order = np.argsort(line.value)
    frequency = CubicSpline(700.0 * line.value[order], line.frequency[order])
    for force in (650.0, 900.0):
        expected = float(frequency(force))
        curve = sb.frequency_response(
            reduced, [force], expected - 4.0, expected + 4.0, steps=512, largest_step=0.5
        )
        found = [item.own_value for item in curve.bifurcations if abs(item.multiplier - 1.0) < 0.02]
        assert np.abs(np.array(found) - expected).min() < 0.03


@pytest.mark.long
def test_each_line_once_and_its_ends(curve):
    """With the branch's own conditions at an end of the range, which a line meets to rounding, both doublings
    of an island are still one line; an end inside the range is told.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", BranchWarning)
        (line,) = sb.loci(curve, 0.5, 1.0, kinds=("period doubling",))
    assert line.value.max() == pytest.approx(1.0, abs=1e-8)
    doublings = of_kind(curve, "period doubling")
    for shift in (-1e-9, 1e-9):
        other = replace(line, value=line.value * (1.0 + shift))
        assert [_passes(other, item, curve) for item in doublings] == [True, True]
    assert line.value.min() == pytest.approx(0.894, abs=1e-3)
    with pytest.warns(BranchWarning, match=r"ends inside the range, at .* Hz and the factor .*: 1 point\b"):
        sb.loci(curve, 0.5, 1.1, kinds=("period doubling",), points=1)


@pytest.mark.long
def test_gap_and_load_scale_each_other(curve):
    """All gaps times c under all loads times c: the same motion times c, so that the locus over the gap at
    1 / c is the one over the load at c.
    """
    fold = of_kind(curve, "fold")[0]
    by_load = sb.locus(curve, fold, 1.0, 1.25)
    by_gap = sb.locus(curve, fold, 0.8, 1.0, parameter="gap")
    one, other = np.argmax(by_load.value), np.argmin(by_gap.value)
    assert (by_load.value[one], by_gap.value[other]) == pytest.approx((1.25, 0.8), rel=1e-9)
    assert by_gap.frequency[other] == pytest.approx(by_load.frequency[one], rel=1e-8)
    assert by_gap.states[other] == pytest.approx(0.8 * by_load.states[one], rel=1e-5)


@pytest.mark.long
def test_damping(curve):
    fold = of_kind(curve, "fold")[0]
    line = sb.locus(curve, fold, 1.0, 1.2, parameter="damping")
    end = int(np.argmax(line.value))
    found = [b.value for b in of_kind(response(damping=1.2 * 0.02), "fold")]
    assert np.abs(np.array(found) / line.frequency[end] - 1.0).min() < 1e-4


@pytest.mark.long
def test_convergence_with_the_steps():
    """The end of a line of folds at 512, 1024 and 2048 steps: 4e-6 and 2e-7 of it apart."""
    ends = []
    for steps in (512, 1024, 2048):
        branch = sb.frequency_response(two_masses(0.02, compliance=0.1), [0.1], START, STOP, steps=steps)
        line = sb.locus(branch, of_kind(branch, "fold")[0], 1.0, 1.2)
        ends.append(line.frequency[np.argmax(line.value)])
    first, second = np.abs(np.diff(ends)) / ends[-1]
    assert second < 0.5 * first and second < 1e-6


@pytest.mark.long
def test_a_line_that_turns_back_and_one_that_is_closed(curve, tmp_path):
    """The doublings on both sides of an island are one line, with a least load; both Neimark-Sacker points of
    the curve lie on one ring.
    """
    doublings = [b.value for b in of_kind(curve, "period doubling")]
    (line,) = sb.loci(curve, 0.5, 1.1, kinds=("period doubling",))
    # the line begins at 1, on either side of it by rounding
    passed = np.flatnonzero(np.diff(line.value > 1.0))
    share = (1.0 - line.value[passed]) / (line.value[passed + 1] - line.value[passed])
    crossings = line.frequency[passed] + share * (line.frequency[passed + 1] - line.frequency[passed])
    assert len(doublings) == 2 and np.sort(crossings) == pytest.approx(np.sort(doublings), rel=1e-3)
    assert line.value.min() == pytest.approx(0.894, abs=1e-3)
    assert line.frequency[0] != pytest.approx(line.frequency[-1], rel=1e-3)
    assert all(reason.startswith("end of the range at 1.1") for reason in line.reasons)
    assert "period doubling" in repr(line)
    line.to_csv(str(tmp_path / "line.csv"))
    assert np.loadtxt(tmp_path / "line.csv", delimiter=",", skiprows=1).shape == (len(line), 4)
    one, other = of_kind(curve, "Neimark-Sacker")[:2]
    ring = sb.locus(curve, one, 0.3, 3.0)
    assert ring.reasons[0] == "it is closed"
    place = np.argmin(np.hypot(ring.frequency / other.value - 1.0, 0.1 * (ring.value - 1.0)))
    assert ring.frequency[place] == pytest.approx(other.value, rel=2e-3)


@pytest.fixture(scope="module")
def with_stops():
    """One mass between a stop at 1 and one at -1.5, where the second is met with the first in contact."""
    system = sb.reduce_matrices(
        np.eye(1),
        np.eye(1),
        np.array([[-1.0], [1.0]]),
        np.array([1.0, 1.5]),
        loads=np.ones((1, 1)),
        sensors={"A": 0},
        damping=0.1,
        compliance=np.ones(2),
    )
    return sb.frequency_response(system, 0.35, 0.8 / TURN, 1.5 / TURN, steps=512)


@pytest.mark.parametrize(("end", "closed"), [(2.0 * np.pi, True), (1.9 * np.pi, False)])
def test_where_a_line_is_closed(end, closed):
    """A ring that has come round, or nearly; one that comes through its first point from the other side, or
    passes beside it, is on another strand and goes on.
    """

    class Plane(Problem):
        def units(self, u):
            return np.ones(2), np.ones(2)

    def closes(places):
        points = [Point(Plane(), np.array(place), None, place[1]) for place in places]
        return Follower(Line(points), Range(-2.0, 3.0, 1), Settings())._closes()

    around = np.linspace(0.0, end, 21) + 0.01
    ring = [(np.cos(angle), np.sin(angle)) for angle in around]
    assert closes([(1.0, 0.0), *ring]) is closed
    returning = [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (1.5, 2.0), (1.0, 1.0), (0.5, 0.05)]
    assert not closes([*returning, (-0.5, -0.05)])
    assert not closes([*returning[:-2], (-1.0, 0.0), (-0.6, 0.0)])  # not there yet
    assert not closes([*returning[:-1], (-0.5, 0.6), (0.5, 0.4)])


@pytest.mark.slow
def test_grazing_of_an_open_stop_in_closed_form(with_stops):
    """Where the linear motion's amplitude is the gap: force |H| = gap, over load, gap and damping."""

    def closed(frequency, damping=0.1):
        w = TURN * frequency
        return 0.35 / np.abs(1.0 - w**2 + 2j * damping * w)

    points = sb.grazing_points(with_stops)
    assert [point.kind for point in points] == ["grazing", "grazing"]
    assert [closed(point.value) for point in points] == pytest.approx([1.0, 1.0], rel=1e-9)
    for parameter, amplitude in (
        ("load", lambda line: line.value * closed(line.frequency)),
        ("gap", lambda line: closed(line.frequency) / line.value),
        ("damping", lambda line: closed(line.frequency, 0.1 * line.value)),
    ):
        line = sb.locus(with_stops, points[0], 0.9, 1.1, parameter=parameter)
        assert line.kind == "grazing" and np.isnan(line.multiplier).all()
        assert sorted(line.value[[0, -1]]) == pytest.approx([0.9, 1.1], rel=1e-9) and len(line) >= 4
        assert amplitude(line) == pytest.approx(np.ones(len(line)), rel=1e-7)


def test_grazing_over_the_gap(with_stops):
    """As the stop comes nearer it is met where the linear motion's amplitude, force |H|, is the gap."""
    branch = sb.load_response(
        with_stops.reduced, 0.35, 0.7 / TURN, start=0.7, stop=0.6, parameter="gap", steps=512
    )
    (point,) = sb.grazing_points(branch)
    amplitude = 0.35 / abs(1.0 - 0.7**2 + 2j * 0.1 * 0.7)
    assert point.value == pytest.approx(amplitude, rel=1e-9)


def test_grazing_points_that_are_found_are_kept(with_stops, monkeypatch):
    """One that is not found is told; the others, and lines from them, are there."""
    expected, own = sb.grazing_points(with_stops, every=True), locus_module._grazing

    def lost(branch, k, row, closes):
        if row == 1 and closes:
            raise sb.SolveError("grazing_points: where contact row 1 begins to touch was not found")
        return own(branch, k, row, closes)

    monkeypatch.setattr(locus_module, "_grazing", lost)
    with pytest.warns(BranchWarning, match="contact row 1 begins to touch was not found"):
        found = sb.grazing_points(with_stops, every=True)
    assert len(expected) == 4 and len(found) == 3
    assert {point.value for point in found} < {point.value for point in expected}


@pytest.mark.parametrize("parameter, gap, damping", [("damping", 1.0, 0.0), ("gap", 0.0, 0.1)])
def test_a_factor_on_nothing_is_refused(parameter, gap, damping):
    """All lines over a factor on what is zero are vertical."""
    curve = sb.frequency_response(one_mass(gap, damping), 0.01, 0.05, 0.06, steps=64)
    with pytest.raises(ValueError, match=f"loci: parameter = '{parameter}' has no effect, for all .* are 0"):
        sb.loci(curve, 0.5, 2.0, parameter=parameter)
    assert sb.loci(curve, 0.5, 2.0) == ()
    with pytest.raises(ValueError, match="loci: kinds has 0 entries; at least 1 expected"):
        sb.loci(curve, 0.5, 2.0, kinds=[])


def test_grazing_of_a_stop_while_another_is_in_contact(with_stops):
    """Steady states with a little less and a little more load than the line's are without and with a force at
    the second stop: by 1e-6, and by 5e-5, for contact is at the steps' ends, (pi / 512)^2 / 2 = 2e-5.
    """
    points = sb.grazing_points(with_stops, every=True)
    assert [point.row for point in points] == [0, 1, 1, 0]
    line = sb.locus(with_stops, points[1], 0.9, 1.2, points=3)
    assert len(line) >= 5
    for frequency, factor in zip(line.frequency, line.value):
        below, above = (
            sb.periodic(with_stops.reduced, 0.35 * factor * share, frequency, steps=512, stability=False)
            for share in (1.0 - 1e-6, 1.0 + 5e-5)
        )
        assert below.contact_force[:, 1].max() == 0.0 < above.contact_force[:, 1].max()
        assert below.contact_force[:, 0].max() > 0.0


def test_picture():
    """Each kind in its colour and once in the legend, through all points, in the unit that is asked for."""
    lines = []
    for kind, shift in (("fold", 0.0), ("fold", 5.0), ("grazing", 2.0)):
        value, states = np.array([0.5, 1.0, 0.7]), np.zeros((3, 2))
        frequency = shift + np.array([10.0, 11.0, 12.0])
        lines.append(sb.Locus(kind, "load", frequency, value, states, np.ones(3, complex), ("", "")))
    axes = plot_loci(lines, unit=300.0, label="force, N")
    assert axes.get_ylabel() == "force, N"
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["fold", "grazing"]
    for drawn, line in zip(axes.lines, lines):
        points = drawn.get_xydata()
        for point in np.column_stack([line.frequency, 300.0 * line.value]):
            assert np.abs(points - point).sum(axis=1).min() < 1e-9
    other = sb.Locus("fold", "gap", frequency, value, states, np.ones(3, complex), ("", ""))
    with pytest.raises(ValueError, match="loci over gap, load"):
        plot_loci([lines[0], other])


@pytest.mark.slow
def test_bad_input(curve):
    fold = of_kind(curve, "fold")[0]
    corner, crossing = replace(fold, multiplier=0.6), replace(fold, kind="branch point")
    for arguments, sentence in (
        ((crossing, 0.5, 2.0), "cannot be followed"),
        ((corner, 0.5, 2.0), "corner of the branch"),
        ((replace(corner, state=1.01 * fold.state), 0.5, 2.0), "no motion of the branch"),
        ((fold, 1.5, 2.0), "must lie between start = 1.5 and stop = 2"),
        ((fold, -1.0, 2.0), "start"),
    ):
        with pytest.raises(ValueError, match=sentence):
            sb.locus(curve, *arguments)
    with pytest.raises(ValueError, match="parameter"):
        sb.locus(curve, fold, 0.5, 2.0, parameter="force")
    with pytest.raises(TypeError, match="bifurcation"):
        sb.locus(curve, 3, 0.5, 2.0)


def test_a_line_through_the_same_motion_at_another_frequency():
    """Passes a bifurcation where both are near."""
    item = SimpleNamespace(kind="fold", state=np.ones(2), own_value=1.0)
    branch = SimpleNamespace(value=np.array([0.9, 1.1]), period=SimpleNamespace(size=np.linalg.norm))

    def passes(frequency, state=1.0):
        states = np.full((2, 2), state)
        line = SimpleNamespace(
            kind="fold", value=np.array([0.9, 1.1]), frequency=2 * [frequency], states=states
        )
        return _passes(line, item, branch)

    assert passes(1.0) and not passes(1.05) and not passes(1.0, 2.0)
