"""Pictures of response curves, harmonics, orbits and multipliers; how curves are split into stable and
unstable parts.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib import image

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.motion.factors import FACTORS
from sbfem_petsc.plot import (
    plot_branches,
    plot_harmonics,
    plot_history,
    plot_multipliers,
    plot_orbit,
    save_picture,
)
from sbfem_petsc.plot.branches import BETWEEN, Height, abscissa, smooth, split
from sbfem_petsc.plot.drawing import GREY


@pytest.fixture(scope="module")
def oscillator():
    """Two masses and an elastic stop: folds and period doublings within one resonance."""
    stiffness = np.array([[1.0, -1.0], [-1.0, 2.0]])
    return sb.reduce_matrices(
        np.eye(2),
        stiffness,
        np.array([[-1.0, 0.0]]),
        np.ones(1),
        loads=np.array([[0.0], [1.0]]),
        sensors={"one": 0, "two": 1},
        damping=0.03 * stiffness,
        compliance=np.array([0.01]),
    )


@pytest.fixture(scope="module")
def curves(oscillator):
    start, stop = 0.55 / (2.0 * math.pi), 0.95 / (2.0 * math.pi)
    return {
        "stop": sb.frequency_response(oscillator, (0.1,), start, stop, steps=512, progress=None),
        "no stop": sb.frequency_response(oscillator, (0.1,), start, stop, contact=False, progress=None),
    }


@pytest.fixture(scope="module")
def orbits(oscillator):
    return {
        name: sb.periodic(oscillator, (force,), 0.63 / (2.0 * math.pi), steps=1024)
        for name, force in (("open", 0.01), ("touching", 0.1))
    }


def drawn(axes, path):
    """A picture of journal width that is not empty."""
    save_picture(axes, path)
    picture = image.imread(path)[..., :3]
    assert picture.shape[1] == 1440 and picture.shape[0] > 400
    assert picture.std() > 0.03
    return picture


# ---------------------------------------------------------------------- parts of a curve
VALUE, HEIGHT = np.arange(6.0), np.array([1.0, 3.0, 4.0, 3.5, 2.0, 1.0])


def test_without_bifurcations_the_verdict_changes_half_way():
    parts = split(VALUE, HEIGHT, np.array([True, True, False, False, True, True]), between=1)
    assert [stable for stable, _, _ in parts] == [True, False, True]
    np.testing.assert_array_equal(parts[0][1], [0.0, 1.0, 1.5])
    np.testing.assert_array_equal(parts[1][1], [1.5, 2.0, 3.0, 3.5])
    np.testing.assert_array_equal(parts[2][1], [3.5, 4.0, 5.0])
    np.testing.assert_array_equal(parts[1][2], [3.5, 4.0, 3.5, 2.75])


def test_the_verdict_changes_at_bifurcations():
    parts = split(
        VALUE, HEIGHT, np.array([True, True, False, False, True, True]), [(2, 1.8, 3.9), (4, 3.1, 3.3)], 1
    )
    assert [list(part[1]) for part in parts] == [[0.0, 1.0, 1.8], [1.8, 2.0, 3.0, 3.1], [3.1, 4.0, 5.0]]
    assert parts[0][2][-1] == parts[1][2][0] == 3.9 and parts[1][2][-1] == parts[2][2][0] == 3.3


def test_bifurcations_of_unstable_parts_are_vertices_only():
    stable = np.array([False, False, False, True, True, True])
    parts = split(VALUE, HEIGHT, stable, [(1, 0.4, 2.2), (3, 2.2, 4.1), (3, 2.6, 3.9)], 1)
    assert [part[0] for part in parts] == [False, True]
    # of two between the same points stability is won at the second
    assert list(parts[0][1]) == [0.0, 0.4, 1.0, 2.0, 2.2, 2.6] and list(parts[1][1]) == [2.6, 3.0, 4.0, 5.0]


def test_one_verdict_is_one_part():
    for verdict in (True, False):
        (part,) = split(VALUE, HEIGHT, np.full(6, verdict), between=1)
        assert part[0] is verdict
        np.testing.assert_array_equal(part[1], VALUE)


def test_smooth_lines_pass_through_the_points_without_overshoot():
    stable = np.array([True, True, True, False, False, False])
    parts, lines = (split(VALUE, HEIGHT, stable, [(3, 2.4, 3.9)], between) for between in (1, BETWEEN))
    assert [line[0] for line in lines] == [True, False]
    for (_, x, y), (_, fine_x, fine_y) in zip(parts, lines):
        assert len(fine_x) > 5 * len(x)
        for point in zip(x, y):
            assert np.hypot(fine_x - point[0], fine_y - point[1]).min() < 1e-12
        assert fine_y.max() <= HEIGHT.max() + 1e-12 and (np.diff(fine_x) > 0.0).all()
    assert lines[0][1][-1] == pytest.approx(2.4) and lines[1][1][0] == pytest.approx(2.4)


def test_smooth_lines_through_equal_points():
    """A bifurcation on a point of the curve."""
    (line,) = split(VALUE, HEIGHT, np.ones(6, dtype=bool), [(2, 2.0, 4.0)])
    assert np.isfinite(line[1]).all() and np.isfinite(line[2]).all() and line[1][-1] == 5.0


@pytest.mark.long
# ---------------------------------------------------------------------- pictures
@pytest.mark.slow
def test_lines_follow_the_verdict(curves):
    """Solid where stable, broken where not; the parts hang together and hold all points; a grey line without
    contact.
    """
    curve = curves["stop"]
    kinds = [item.kind for item in curve.bifurcations]
    assert kinds.count("fold") == 2 and "period doubling" in kinds and not curve.stable.all()
    axes = plot_branches(curves, "two")
    lines = [line for line in axes.get_lines() if len(line.get_xdata()) > 2]
    grey = [line for line in lines if line.get_color() == GREY]
    assert len(grey) == 1 and len(grey[0].get_xdata()) == len(curves["no stop"].value)
    parts = [line for line in lines if line not in grey]
    changes = np.flatnonzero(np.diff(curve.stable.astype(int)))
    assert len(parts) == len(changes) + 1
    expected = bool(curve.stable[0])
    for line in parts:
        assert (line.get_linestyle() == "-") is expected
        expected = not expected
    x, y = (
        np.concatenate([line.get_xdata() for line in parts]),
        np.concatenate([line.get_ydata() for line in parts]),
    )
    for value, height in zip(curve.value, curve.amplitude("two")):
        assert np.hypot((x - value) / 0.1, y / y.max() - height / curve.amplitude("two").max()).min() < 1e-9
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels[:2] == ["stop", "no stop"] and {"unstable", "fold", "period doubling"} <= set(labels)


@pytest.mark.slow
def test_amplitude_at_a_fold(curves):
    """Between those of the points beside it; bifurcations come in order of the arc."""
    curve = curves["stop"]
    for item in curve.bifurcations:
        if item.kind == "fold":
            beside = curve.amplitude("two")[item.after - 1 : item.after + 1]
            assert (
                beside.min() * (1.0 - 1e-2)
                <= Height("two").of(curve.orbit(item))
                <= beside.max() * (1.0 + 1e-2)
            )
    chords = {
        item.after: np.diff(curve.states[item.after - 1 : item.after + 1], axis=0)[0]
        for item in curve.bifurcations
    }
    places = [
        item.after
        + (item.state - curve.states[item.after - 1]) @ chords[item.after] / (chords[item.after] ** 2).sum()
        for item in curve.bifurcations
    ]
    assert places == sorted(places) and len(places) > 2


@pytest.mark.long
def test_pictures(curves, orbits, tmp_path):
    pictures = [
        plot_branches(curves, "two", forces={"stop": 0.1, "no stop": 0.1}, title="oscillator", every=True),
        plot_harmonics(orbits, "two", forces={"open": 0.01, "touching": 0.1}),
        plot_orbit(orbits["touching"], "two", pairs={"stop": 0}),
        plot_orbit(orbits["touching"], "one"),
        plot_multipliers(orbits["touching"]),
        plot_multipliers(curves["stop"], title="through folds"),
        plot_history(orbits["touching"], "two"),
    ]
    shown = [drawn(axes, tmp_path / f"{k}.png") for k, axes in enumerate(pictures)]
    assert all(
        np.abs(a - b).max() > 0.5 for k, a in enumerate(shown) for b in shown[:k] if a.shape == b.shape
    )


@pytest.mark.slow
def test_stems_stand_on_the_least_harmonic_shown(orbits):
    """Not on 1e-14 where the harmonics end at 1e-6: the axis begins at the power of ten below the least
    one.
    """
    levels = np.abs(orbits["touching"].harmonics("two")[:11])
    axes = plot_harmonics(orbits["touching"], "two", decades=3.0)
    least = levels[levels > 1e-3 * levels.max()].min()
    low, high = axes.get_ylim()
    assert low <= least < 20.0 * low and high > levels.max()


@pytest.mark.slow
def test_harmonics_drawn_are_those_above_rounding(orbits):
    """The motion that does not touch has the first alone."""
    assert orbits["open"].contact_resultant.max() == 0.0 < orbits["touching"].contact_resultant.max()
    axes = plot_harmonics(orbits, "two", decades=8.0)
    heads = {line.get_label(): line.get_xdata() for line in axes.get_lines()}
    assert len(heads["open"]) == 1 and round(float(heads["open"][0])) == 1 and len(heads["touching"]) > 5


@pytest.mark.slow
def test_a_motion_of_two_periods(curves, tmp_path):
    """One mark each forcing period; time counts forcing periods."""
    curve = curves["stop"]
    item = next(item for item in curve.bifurcations if item.kind == "period doubling")
    orbit = sb.switch_branch(curve, item)
    axes = plot_orbit(orbit, "two")
    marks = [line for line in axes[0].get_lines() if line.get_marker() == "o"]
    assert len(marks[0].get_xdata()) == 2 and axes[-1].get_xlim() == (0.0, 2.0)
    drawn(axes, tmp_path / "doubled.png")


@pytest.mark.long
def test_a_curve_over_the_load(oscillator, tmp_path):
    curve = sb.load_response(oscillator, (0.1,), 0.63 / (2.0 * math.pi), 0.1, steps=512, progress=None)
    drawn(plot_branches(curve, "two"), tmp_path / "load.png")
    assert abscissa("plot_branches", {"0.1 N": curve}).label == "factor on the load"
    with pytest.raises(ValueError, match="over the frequency and some over the load"):
        plot_branches({"load": curve, "frequency": replace(curve, parameter="frequency")}, "two")


def test_what_curves_are_over():
    """Factors on the damping and on the gaps were drawn as frequencies, in Hz."""
    curves = {name: SimpleNamespace(parameter=name, value=np.array([0.5, 1.0])) for name in FACTORS}
    for name, curve in curves.items():
        over = abscissa("plot_branches", {"": curve})
        assert over.label == f"factor on the {name}" and over(0.5) == 0.5
    with pytest.raises(ValueError, match="some branches are over the gap and some over the load"):
        abscissa("plot_branches", {name: curves[name] for name in ("load", "gap")})


@pytest.mark.slow
def test_bad_requests(curves, orbits):
    with pytest.raises(ValueError, match="branches is empty; give one Branch"):
        plot_branches({})
    with pytest.raises(ValueError, match="no positive force for 'no stop'"):
        plot_branches(curves, "two", forces={"stop": 0.1})
    with pytest.raises(KeyError, match="point 'A' does not exist"):
        plot_branches(curves)
    with pytest.raises(ValueError, match="orbits is empty; give one Orbit"):
        plot_harmonics({})
    with pytest.raises(ValueError, match="is a row along a direction of its own"):
        plot_harmonics(orbits, "two", "x")
    with pytest.raises(ValueError, match="pair 'mouth' is number 3, the model has 1"):
        plot_orbit(orbits["open"], "two", pairs={"mouth": 3})
    with pytest.raises(ValueError, match="there are no multipliers"):
        plot_multipliers(curves["no stop"])


def test_what_cannot_be_drawn():
    with pytest.raises(TypeError, match="5 cannot be drawn; give one Branch"):
        plot_branches(5, "A")


@pytest.mark.long
def test_smooth_lines_are_the_curve():
    """Cubics through the default points lie within a tenth of a line's width of a curve of many more."""
    mesh = Beam(0.3, 0.01, [VNotch(0.1, 0.004, 1e-3)]).mesh(order=3)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700.0), damping=0.005)
    load, ends = sb.PointForce("A", fy=5.0), (82.0, 97.0)
    options = {"modes": 6, "steps": 256, "stability": False}
    curve = sb.frequency_response(model, load, *ends, **options)
    finer = sb.frequency_response(model, load, *ends, largest_step=0.05, points=2000, **options)
    assert len(finer.value) > 6 * len(curve.value)
    size = np.ptp(finer.value), np.ptp(finer.amplitude("A"))
    exact = np.column_stack([finer.value, finer.amplitude("A")]) / size

    def furthest(x, y):
        line = np.column_stack([x, y]) / size
        begin, way = line[:-1], np.diff(line, axis=0)
        apart = exact[:, None] - begin
        share = np.clip((apart * way).sum(axis=2) / (way**2).sum(axis=1), 0.0, 1.0)
        return np.linalg.norm(apart - share[..., None] * way, axis=2).min(axis=1).max()

    drawn = smooth(curve.value, curve.amplitude("A"))
    assert furthest(*drawn) < 3e-4 < furthest(curve.value, curve.amplitude("A"))
