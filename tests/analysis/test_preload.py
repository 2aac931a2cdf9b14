"""Motions about a place at rest that a constant load holds far from where the structure is without loads:
they are the same as without it.
"""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.motion.period_map import Period

# Newton's method ends at 1e-12 of the whole displacement, here 1e-7 of the motion. The lengths of steps
# depend on how many iterations it takes, and the highest point on these.
SAME, ALIKE, HIGHEST = 1e-6, 1e-3, 1e-5


def displaced(preload: float) -> sb.ReducedModel:
    """One mass on a spring 1 whose stop is 1 from where the constant load, the second one, holds it."""
    return sb.reduce_matrices(
        np.eye(1),
        np.eye(1),
        np.array([[-1.0]]),
        np.array([preload + 1.0]),
        loads=np.ones((1, 2)),
        sensors={"1": 0},
        damping=0.034 * np.eye(1),
        compliance=np.array([1.0]),
    )


def pressed(preload: float) -> sb.ReducedModel:
    """Two masses on springs 1 with 0.1 between. The constant load presses the second one onto its stop of
    stiffness 1 and so moves the first one, whose stop is 1 from where it then is.
    """
    second = preload / (1.1 - 0.01 / 1.1 + 1.0)
    return sb.reduce_matrices(
        np.eye(2),
        np.array([[1.1, -0.1], [-0.1, 1.1]]),
        -np.eye(2),
        np.array([1.0 + 0.1 / 1.1 * second, 0.0]),
        loads=np.eye(2),
        sensors={"1": 0, "2": 1},
        damping=0.034 * np.eye(2),
        compliance=np.array([1.0, 1.0]),
    )


@pytest.mark.long
@pytest.mark.parametrize("system, little", [(displaced, 0.0), (pressed, 10.0)])
def test_a_curve_does_not_depend_on_the_preload(system, little):
    """Peak, folds and number of points, with a displacement 1e5 times the motion and without."""
    one, other = (
        sb.frequency_response(system(preload), [0.15, sb.Constant(preload)], 0.13, 0.19, steps=256)
        for preload in (little, 1e5)
    )
    assert [item.kind for item in one.bifurcations] == ["fold", "fold"]
    assert [item.kind for item in other.bifurcations] == ["fold", "fold"]
    np.testing.assert_allclose(
        [item.value for item in other.bifurcations], [item.value for item in one.bifurcations], rtol=SAME
    )
    assert len(other.value) == len(one.value)
    np.testing.assert_allclose(other.value, one.value, rtol=ALIKE)
    assert other.amplitude("1").max() == pytest.approx(one.amplitude("1").max(), rel=HIGHEST)


@pytest.mark.parametrize("preload", [10.0, 1e5])
def test_at_rest(preload):
    """Both masses are where the springs and the stop hold them, by hand."""
    model = pressed(preload)
    excitation = Excitation.of([sb.Harmonic(0.15, 0.15), sb.Constant(preload)], 0.15, None, 1)
    period = Period(model, excitation, 64)
    second = preload / (1.1 - 0.01 / 1.1 + 1.0)
    # the gaps' rows are the displacements against them
    np.testing.assert_allclose(
        model.gap.modes @ (period.rest[:2] / period.weights), [-0.1 / 1.1 * second, -second], rtol=1e-12
    )
    assert not period.rest[2:].any()


@pytest.mark.long
def test_held_by_stops_alone():
    """A mass without spring between two stops that press it to a place: its rest is there, and the curve of
    the mass beside it, which does not know of it, is the same wherever that is.
    """
    folds = []
    for place in (0.0, 1e4):
        system = sb.reduce_matrices(
            np.eye(2),
            np.diag([1.0, 0.0]),
            np.array([[0.0, 1.0], [0.0, -1.0], [-1.0, 0.0]]),
            np.array([-0.5 - place, -0.5 + place, 1.0]),
            loads=np.array([[1.0], [0.02]]),
            sensors={"1": 0, "2": 1},
            damping=np.diag([0.034, 0.0]),
            compliance=np.ones(3),
        )
        period = Period(system, Excitation.of([sb.Harmonic(0.15, 0.15)], 0.15, None, 1), 64)
        moved = system.gap.modes[0] @ (period.rest[:2] / period.weights)
        assert moved == pytest.approx(place, rel=1e-7, abs=1e-7)
        curve = sb.frequency_response(system, [0.15], 0.13, 0.19, steps=256)
        assert curve.complete
        folds.append([item.value for item in curve.bifurcations if item.kind == "fold"])
    np.testing.assert_allclose(*folds, rtol=SAME)
    assert len(folds[0]) == 2


def unsprung():
    """Two masses, the second one held by nothing but a stop of stiffness 10 that it touches; a force that
    presses it onto the stop.
    """
    return sb.reduce_matrices(
        np.eye(2),
        np.diag([1.0, 0.0]),
        np.array([[0.0, 1.0]]),
        np.zeros(1),
        loads=np.array([[0.0], [-1.0]]),
        sensors={"A": 1},
        compliance=np.array([0.1]),
    )


def test_equilibrium_of_a_mass_on_a_stop():
    """It stays where the stop carries the force."""
    history = sb.transient(unsprung(), [sb.Constant(2.0)], 3.0, step=0.01, initial="equilibrium")
    np.testing.assert_allclose(history.displacement("A")[:, 1], -0.2, rtol=1e-6)
    np.testing.assert_allclose(history.contact_resultant, 2.0, rtol=1e-6)


def test_no_equilibrium():
    """Pulled away from the stop it is held by nothing."""
    with pytest.raises(sb.SolveError, match="rigid-body motion of mode 1, which nothing holds"):
        sb.transient(unsprung(), [sb.Constant(-2.0)], 3.0, step=0.01, initial="equilibrium")


@pytest.mark.parametrize("left, held", [(1e-13, True), (1e-11, False)])
def test_rounding_of_loads_moves_no_free_body(left, held):
    """Two masses on a spring that are pulled apart by 1000 N, but for a share of it."""
    free = sb.reduce_matrices(
        np.eye(2),
        np.array([[1.0, -1.0], [-1.0, 1.0]]),
        np.array([[1.0, -1.0]]),
        np.array([1e6]),
        loads=np.array([[1e3], [-1e3 * (1.0 + left)]]),
        sensors={"1": 0, "2": 1},
        compliance=np.ones(1),
    )
    if held:
        history = sb.transient(free, [sb.Constant(1.0)], 0.1, step=0.01, initial="equilibrium")
        apart = history.displacement("1")[:, 1] - history.displacement("2")[:, 1]
        np.testing.assert_allclose(apart, 1e3, rtol=1e-9)
    else:
        with pytest.raises(sb.SolveError, match="rigid-body motion of mode 1, which nothing holds"):
            sb.transient(free, [sb.Constant(1.0)], 0.1, step=0.01, initial="equilibrium")


@pytest.mark.parametrize("beside", [0.0, 1e14])
def test_no_equilibrium_beside_a_large_load(beside):
    """A free mass that is pushed by 1 N has none, whatever presses on another body."""
    system = sb.reduce_matrices(
        np.eye(2),
        np.diag([0.0, 1.0]),
        np.array([[0.0, 1.0]]),
        np.array([1e30]),
        loads=np.eye(2),
        sensors={"1": 0},
        compliance=np.ones(1),
    )
    with pytest.raises(sb.SolveError, match="rigid-body motion of mode 1, which nothing holds"):
        sb.transient(system, [sb.Constant(1.0), sb.Constant(beside)], 1.0, step=0.01, initial="equilibrium")


def test_two_tones_on_a_preload():
    """Lines of a quasi-periodic motion are the same."""
    tones = 0.16, 0.02 * np.sqrt(3.0)
    lines = []
    for preload in (10.0, 1e4):
        load = [sb.Harmonic(0.15, tones[0]) + sb.Harmonic(0.1, tones[1]), sb.Constant(preload)]
        found = sb.quasi_periodic(pressed(preload), load, frequencies=tones, steps=256)
        assert found.stable
        lines.append([found.line(m, n, "1") for m, n in ((1, 0), (0, 1), (1, 1), (1, 2), (2, -1))])
    np.testing.assert_allclose(*lines, rtol=SAME, atol=SAME * np.abs(lines[0]).max())


def test_a_number_beside_signals():
    """It is a constant in a history and would be an amplitude in a steady state, which asks what it is; given
    as a constant, both have the same mean resultant.
    """
    frequency = 400.0
    model = sb.Model(
        Beam(0.4, 0.02, [VNotch(0.1, 0.01, 0.0)]).mesh(),
        sb.Material(70e9, 0.33, 2700),
        clamped="left",
        damping=0.1,
    )

    def load(preload):
        return sb.EdgeLoad("right", ty=sb.Harmonic(1e4, frequency)) + sb.EdgeLoad("right", tx=preload)

    wanted = r"tx of EdgeLoad = -5000000.0 is a number beside signals .* give sb.Constant\(-5000000.0\) or "
    for analysis, options in ((sb.periodic, {}), (sb.load_response, {"stop": 2.0})):
        with pytest.raises(ValueError, match=wanted):
            analysis(model, load(-5e6), frequency, **options)
    with pytest.raises(ValueError, match=wanted):
        sb.periodic(model, load(-5e6), frequency, reduction=None)
    with pytest.raises(ValueError, match=r"load\[1\] = 2.0 is a number beside signals"):
        sb.periodic(pressed(0.0), [sb.Harmonic(0.15, 0.15), 2.0], 0.15)
    with pytest.raises(ValueError, match=wanted):
        sb.quasi_periodic(model, load(-5e6), (frequency, 70.0))
    with pytest.raises(ValueError, match=wanted):
        sb.frequency_response(model, load(-5e6), 350.0, 450.0)
    with pytest.raises(ValueError, match=wanted):
        sb.swept_response(model, load(-5e6), 350.0, 450.0, duration=1.0)
    with pytest.raises(ValueError, match="ty of EdgeLoad = Harmonic.* give a number, .* or a Constant"):
        sb.frequency_response(model, load(sb.Constant(-5e6)), 350.0, 450.0)
    orbit = sb.periodic(model, load(sb.Constant(-5e6)), frequency, stability=False)
    history = sb.transient(model, load(-5e6), 100.0 / frequency, initial="equilibrium")
    turn = round(1.0 / (frequency * history.step))
    assert orbit.contact_resultant.min() > 0.0
    mean = orbit.contact_resultant[:-1].mean()
    assert mean == pytest.approx(5e6 * 0.01, rel=1e-5)  # the traction over the depth of the crack
    assert history.contact_resultant[-turn:].mean() == pytest.approx(mean, rel=1e-4)
