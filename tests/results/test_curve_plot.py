"""Pictures of response curves, harmonics, orbits and multipliers; how curves are split into stable and
unstable parts.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib import image
from sbfem_petsc.plot.curves import (
    amplitude_at,
    in_order,
    plot_curves,
    plot_harmonics,
    plot_multipliers,
    plot_orbit,
    smooth,
    split,
)

import sbfem_petsc as sb
from sbfem_petsc.plot import curves as curve_plot
from tests.systems import two_masses


@pytest.fixture(scope="module")
def oscillator():
    """Two masses and an elastic stop: folds and period doublings within one resonance."""
    return two_masses()


@pytest.fixture(scope="module")
def curves(oscillator):
    start, stop = 0.55 / (2.0 * math.pi), 0.95 / (2.0 * math.pi)
    return {
        "stop": sb.frequency_response(oscillator, (0.1,), start, stop, steps=2048, progress=None),
        "no stop": sb.frequency_response(oscillator, (0.1,), start, stop, contact=False, progress=None),
    }


@pytest.fixture(scope="module")
def orbits(oscillator):
    return {
        name: sb.periodic(oscillator, (force,), 0.63 / (2.0 * math.pi), steps=1024)
        for name, force in (("open", 0.01), ("touching", 0.1))
    }


def drawn(path):
    """A picture of journal width that is not empty."""
    picture = image.imread(path)[..., :3]
    assert picture.shape[1] == 1440 and picture.shape[0] > 400
    assert picture.std() > 0.03
    return picture


# ---------------------------------------------------------------------- parts of a curve
VALUE, HEIGHT = np.arange(6.0), np.array([1.0, 3.0, 4.0, 3.5, 2.0, 1.0])


def test_without_bifurcations_the_verdict_changes_half_way():
    parts = split(VALUE, HEIGHT, np.array([True, True, False, False, True, True]))
    assert [stable for stable, _, _ in parts] == [True, False, True]
    np.testing.assert_array_equal(parts[0][1], [0.0, 1.0, 1.5])
    np.testing.assert_array_equal(parts[1][1], [1.5, 2.0, 3.0, 3.5])
    np.testing.assert_array_equal(parts[2][1], [3.5, 4.0, 5.0])
    np.testing.assert_array_equal(parts[1][2], [3.5, 4.0, 3.5, 2.75])


def test_the_verdict_changes_at_bifurcations():
    parts = split(
        VALUE, HEIGHT, np.array([True, True, False, False, True, True]), [(2, 1.8, 3.9), (4, 3.1, 3.3)]
    )
    assert [list(part[1]) for part in parts] == [[0.0, 1.0, 1.8], [1.8, 2.0, 3.0, 3.1], [3.1, 4.0, 5.0]]
    assert parts[0][2][-1] == parts[1][2][0] == 3.9 and parts[1][2][-1] == parts[2][2][0] == 3.3


def test_bifurcations_of_unstable_parts_are_vertices_only():
    stable = np.array([False, False, False, True, True, True])
    parts = split(VALUE, HEIGHT, stable, [(1, 0.4, 2.2), (3, 2.2, 4.1), (3, 2.6, 3.9)])
    assert [part[0] for part in parts] == [False, True]
    # of two between the same points stability is won at the second
    assert list(parts[0][1]) == [0.0, 0.4, 1.0, 2.0, 2.2, 2.6] and list(parts[1][1]) == [2.6, 3.0, 4.0, 5.0]


def test_one_verdict_is_one_part():
    for verdict in (True, False):
        (part,) = split(VALUE, HEIGHT, np.full(6, verdict))
        assert part[0] is verdict
        np.testing.assert_array_equal(part[1], VALUE)


def test_smooth_lines_pass_through_the_points_without_overshoot():
    parts = split(VALUE, HEIGHT, np.array([True, True, True, False, False, False]), [(3, 2.4, 3.9)])
    lines = smooth(parts)
    assert [line[0] for line in lines] == [True, False]
    for (_, x, y), (_, fine_x, fine_y) in zip(parts, lines):
        assert len(fine_x) > 5 * len(x)
        for point in zip(x, y):
            assert np.hypot(fine_x - point[0], fine_y - point[1]).min() < 1e-12
        assert fine_y.max() <= HEIGHT.max() + 1e-12 and (np.diff(fine_x) > 0.0).all()
    assert lines[0][1][-1] == pytest.approx(2.4) and lines[1][1][0] == pytest.approx(2.4)


def test_smooth_lines_through_equal_points():
    """A bifurcation on a point of the curve."""
    (line,) = smooth(split(VALUE, HEIGHT, np.ones(6, dtype=bool), [(2, 2.0, 4.0)]))
    assert np.isfinite(line[1]).all() and np.isfinite(line[2]).all() and line[1][-1] == 5.0


# ---------------------------------------------------------------------- pictures
def test_lines_follow_the_verdict(curves):
    """Solid where stable, broken where not; the parts hang together and hold all points; a grey line without
    contact.
    """
    curve = curves["stop"]
    kinds = [item.kind for item in curve.bifurcations]
    assert kinds.count("fold") == 2 and "period doubling" in kinds and not curve.stable.all()
    drawing = curve_plot._draw_curves(curves, "2", None, None, "", False)
    (axes,) = drawing.axes
    lines = [line for line in axes.get_lines() if len(line.get_xdata()) > 2]
    grey = [line for line in lines if line.get_color() == curve_plot.GREY]
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
    for value, height in zip(curve.value, curve.amplitude("2")):
        assert np.hypot((x - value) / 0.1, y / y.max() - height / curve.amplitude("2").max()).min() < 1e-9
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels[:2] == ["stop", "no stop"] and {"unstable", "fold", "period doubling"} <= set(labels)


def test_amplitude_at_a_fold(curves):
    """Between those of the points beside it; bifurcations come in order of the arc."""
    curve = curves["stop"]
    for item in curve.bifurcations:
        if item.kind == "fold":
            beside = curve.amplitude("2")[item.after - 1 : item.after + 1]
            assert (
                beside.min() * (1.0 - 1e-2) <= amplitude_at(curve, item, "2") <= beside.max() * (1.0 + 1e-2)
            )
    assert [item.after for item in in_order(curve)] == sorted(item.after for item in curve.bifurcations)


def test_pictures(curves, orbits, tmp_path):
    paths = [
        plot_curves(
            curves,
            str(tmp_path / "curves.png"),
            "2",
            forces={"stop": 0.1, "no stop": 0.1},
            title="oscillator",
            every=True,
        ),
        plot_harmonics(orbits, str(tmp_path / "harmonics.png"), "2", forces={"open": 0.01, "touching": 0.1}),
        plot_orbit(orbits["touching"], str(tmp_path / "orbit.png"), "2", {"stop": 0}),
        plot_orbit(orbits["touching"], str(tmp_path / "orbit_default.png"), "1"),
        plot_multipliers(orbits["touching"], str(tmp_path / "multipliers.png")),
        plot_multipliers(curves["stop"], str(tmp_path / "multipliers_curve.png"), "through folds"),
    ]
    pictures = [drawn(path) for path in paths]
    assert all(
        np.abs(a - b).max() > 0.5 for k, a in enumerate(pictures) for b in pictures[:k] if a.shape == b.shape
    )


def test_harmonics_drawn_are_those_above_rounding(orbits):
    """The motion that does not touch has the first alone."""
    assert orbits["open"].contact_resultant.max() == 0.0 < orbits["touching"].contact_resultant.max()
    (axes,) = curve_plot._draw_harmonics(orbits, "2", "y", 10, 8.0, None, "").axes
    heads = {line.get_label(): line.get_xdata() for line in axes.get_lines()}
    assert len(heads["open"]) == 1 and round(float(heads["open"][0])) == 1 and len(heads["touching"]) > 5


def test_a_motion_of_two_periods(curves, tmp_path):
    """One mark each forcing period; time counts forcing periods."""
    curve = curves["stop"]
    item = next(item for item in curve.bifurcations if item.kind == "period doubling")
    orbit = sb.doubled(curve, item)
    drawing = curve_plot._draw_orbit(orbit, "2", None, "")
    marks = [line for line in drawing.axes[0].get_lines() if line.get_marker() == "o"]
    assert len(marks[0].get_xdata()) == 2 and drawing.axes[-1].get_xlim() == (0.0, 2.0)
    drawn(plot_orbit(orbit, str(tmp_path / "doubled.png"), "2"))


def test_a_curve_over_the_load(oscillator, tmp_path):
    curve = sb.load_response(oscillator, (0.1,), 0.63 / (2.0 * math.pi), 0.1, 1.0, steps=512, progress=None)
    drawn(plot_curves({"0.1 N": curve}, str(tmp_path / "load.png"), "2"))
    assert curve_plot._abscissa({"0.1 N": curve})[1] == "factor on the load"
    with pytest.raises(ValueError, match="over the frequency and some over the load"):
        plot_curves(
            {"load": curve, "frequency": curve_plot.replace(curve, parameter="frequency")},
            str(tmp_path / "a.png"),
            "2",
        )


def test_bad_requests(curves, orbits, tmp_path):
    path = str(tmp_path / "a.png")
    with pytest.raises(ValueError, match="no curve is given"):
        plot_curves({}, path)
    with pytest.raises(ValueError, match="no positive force for 'no stop'"):
        plot_curves(curves, path, "2", forces={"stop": 0.1})
    with pytest.raises(KeyError, match="point 'A' does not exist"):
        plot_curves(curves, path)
    with pytest.raises(ValueError, match="no orbit is given"):
        plot_harmonics({}, path)
    with pytest.raises(ValueError, match="does not move in x"):
        plot_harmonics(orbits, path, "2", "x")
    with pytest.raises(ValueError, match="pair 'mouth' is number 3, the model has 1"):
        plot_orbit(orbits["open"], path, "2", {"mouth": 3})
    with pytest.raises(ValueError, match="there are no multipliers"):
        plot_multipliers(curves["no stop"], path)
    with pytest.raises(ValueError, match="cannot be written"):
        plot_harmonics(orbits, str(tmp_path / "none" / "a.png"), "2")
    assert not list(tmp_path.iterdir())
