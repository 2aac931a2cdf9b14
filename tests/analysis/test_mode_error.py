"""What is told of the harmonics' error by left-out modes and steps, beside their true error."""

import functools
from dataclasses import replace

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.continuation.orbit import FAINT
from tests.systems import chain, coarse_beam

TURN = 2.0 * np.pi


def rod(modes: int | None = None) -> sb.ReducedModel:
    """60 masses on a wall, 1 kg and a wave's way of 1 s in all, a crack in a third of it and a stop at the
    free end: blows whose waves modes carry badly.
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
        compliance=np.array([1e-3, 1e-2]),
    )


def true_error(found: sb.Orbit, exact: sb.Orbit) -> np.ndarray:
    """(5,): that of harmonics 0 to 4 of all points, beside itself or 1e-3 of the largest that oscillates."""
    own, true = (
        np.stack([orbit.harmonics(point)[:5].ravel() for point in orbit.points], axis=1)
        for orbit in (found, exact)
    )
    size = np.linalg.norm(true, axis=1)
    return np.linalg.norm(own - true, axis=1) / np.maximum(size, FAINT * size[1:].max())


@functools.cache
def waves(frequency: float) -> sb.Orbit:
    """All modes of the rod, whose top one has 14 of these steps or more a period."""
    return sb.periodic(rod(), [0.1], frequency / TURN, steps=2048, stability=False)


@pytest.mark.parametrize("frequency", [0.5, 1.1])
@pytest.mark.parametrize("modes", [6, 10, 20])
def test_told_beside_true_in_a_rod(modes, frequency):
    """No harmonic is told less than a third of its error, nor the largest ten times too much."""
    found = sb.periodic(rod(modes), [0.1], frequency / TURN, steps=2048, stability=False)
    true, told = true_error(found, waves(frequency)), found.mode_error
    assert true[1:].max() > 1e-3 and (true <= 3.0 * told).all(), (true, told)
    assert told[1:].max() <= 10.0 * true[1:].max(), (true, told)


@pytest.mark.parametrize("modes", [12, 20, 40])
def test_told_beside_true_in_a_beam(modes):
    """The same of a beam with a crack at 433 Hz beside 120 modes."""
    push, beam = sb.PointForce("A", fy=300.0), coarse_beam(0.002)
    exact, found = (
        sb.periodic(beam, push, 433.0, modes=count, steps=768, stability=False) for count in (120, modes)
    )
    true, told = true_error(found, exact), found.mode_error
    assert (true <= 3.0 * told).all() and told[1:].max() <= 10.0 * true[1:].max(), (true, told)


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
    assert "error of harmonics not found, as twice the steps or left-out modes lead elsewhere" in repr(lost)


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
