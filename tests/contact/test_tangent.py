"""The derivative of a period against differences of the period itself."""

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy import linalg

import sbfem_petsc as sb
from sbfem_petsc.contact.tangent import Propagation
from sbfem_petsc.continuation.search import find_steady_state
from sbfem_petsc.continuation.shooting import shoot
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.motion.period_map import Period
from sbfem_petsc.motion.steps import step_coefficients
from tests.parallel import ROOT


def chain(masses=6, damping=0.02, gap=0.05, stops=(0, 2, 5), compliance=0.05):
    """Masses on springs with elastic stops, four of six modes kept: the stops' flexibility is a full
    matrix.
    """
    k = np.diag(np.full(masses, 2.0)) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    rows = np.eye(masses)[list(stops)]
    return sb.reduce_matrices(
        np.eye(masses),
        k,
        rows,
        np.full(len(stops), gap),
        loads=np.eye(masses)[:, [1, 4]],
        sensors={"first": 0, "last": masses - 1},
        modes=4,
        damping=damping,
        compliance=np.full(len(stops), compliance),
    )


def driven_chain(frequency=0.09, steps=1024):
    """A period under a preload and two tones, and a state whose motion opens and closes all stops."""
    signals = [sb.Harmonic(0.3, frequency) + 0.02, sb.Harmonic(0.2, 2 * frequency, 0.4)]
    period = Period(chain(), Excitation.of(signals, frequency, None, 8), steps)
    driven = period.at(frequency)
    return period, driven, driven.linear_state.copy()


@pytest.fixture(scope="module")
def chain_motion():
    """13 switches in the period; the second stop touches at t = 0."""
    period, driven, state = driven_chain()
    state[:4] -= (
        0.3
        * np.linalg.norm(state)
        * period.reduced.gap.modes[1]
        / np.linalg.norm(period.reduced.gap.modes[1])
    )
    motion = driven.run(state)
    touching = motion.forces > 0
    assert (
        touching[0].any()
        and not touching[0].all()
        and (np.diff(touching.astype(int), axis=0) != 0).sum() >= 10
    )
    return period, driven, state, motion


def same_sets(*motions):
    return all(np.array_equal(m.forces > 0, motions[0].forces > 0) for m in motions)


def test_two_stops_at_one_mass():
    """Two hard stops beside each other are one of half their compliance: their flexibility is that of one
    but for 1e-12, by which rounding is divided.
    """
    found = []
    for stops, compliance in (((0, 0), 2e-12), ((0,), 1e-12)):
        reduced = chain(gap=0.0, stops=stops, compliance=compliance)
        signals = [sb.Harmonic(0.4, 0.09) + 0.02] * 2
        driven = Period(reduced, Excitation.of(signals, 0.09, None, 8), 256).at(0.09)
        motion = driven.run(driven.linear_state)
        assert 0 < (motion.forces > 0).any(axis=1).sum() < 256
        found.append(driven.carried(motion, np.eye(8)))
    assert found[0] == pytest.approx(found[1], abs=1e-8 * np.abs(found[1]).max())


def end(driven, state):
    return driven.run(state).residual + state


def test_derivative_with_the_state(chain_motion):
    """Central differences by 1e-7: with the same contact sets the period is linear but for round-off of 1e-16
    / 1e-7; 1e-6 is asked for, 1e-8 is met.
    """
    _, driven, state, motion = chain_motion
    exact = driven.carried(motion, np.eye(len(state)))
    step = 1e-7 * np.linalg.norm(state)
    for k, unit in enumerate(np.eye(len(state))):
        ahead, behind = state + step * unit, state - step * unit
        assert same_sets(motion, driven.run(ahead), driven.run(behind))
        np.testing.assert_allclose(
            exact[:, k],
            (end(driven, ahead) - end(driven, behind)) / (2 * step),
            atol=1e-8 * np.linalg.norm(exact, 2),
        )


def test_overdamped_modes():
    """Free motion that decays by 1e5 or more in two steps is not inverted: every instant stands alone. Two
    masses, the first held to an elastic stop by a preload: the exponential of the linear system with the stop
    as a spring. The stop's force is held over each step, which takes a share of the order of a step; the
    steps themselves are linear.
    """
    stiffness, drag, stop = np.array([[2.0, -1.0], [-1.0, 2.0]]), 200.0 * np.eye(2), 0.5
    reduced = sb.reduce_matrices(
        np.eye(2),
        stiffness,
        [[1.0, 0.0]],
        [0.0],
        loads=np.eye(2)[:, :1],
        sensors={"first": 0},
        modes=2,
        damping=drag,
        compliance=[stop],
    )
    rows, omega, frequency, errors = reduced.gap.modes, reduced.omega, 0.02, []
    for steps in (64, 128):
        period = Period(
            reduced, Excitation.of([sb.Harmonic(0.01, frequency) - 1.0], frequency, None, 1), steps
        )
        driven = period.at(frequency)
        motion = driven.run(driven.linear_state)
        assert (motion.forces > 0.0).all() and period.length(driven.step).propagation.reach == 0
        found = driven.carried(motion, np.eye(4))
        base = end(driven, driven.linear_state)
        units = np.array([end(driven, driven.linear_state + 1e-3 * unit) - base for unit in np.eye(4)])
        # round-off of states of 1, by 1e-3
        np.testing.assert_allclose(found, 1e3 * units.T, atol=1e-11)
        system = np.zeros((4, 4))
        system[:2, 2:], system[2:, :2] = np.eye(2), -np.diag(omega**2) - rows.T @ rows / stop
        system[2:, 2:] = -drag
        weights = np.append(period.weights, [1.0, 1.0])
        exact = weights[:, None] * linalg.expm(system / frequency) / weights
        errors.append(np.abs(found - exact).max())
    assert errors[0] < 2e-5 and 1.8 < errors[0] / errors[1] < 2.2


def test_frames_change_nothing(chain_motion, monkeypatch):
    """The free motion inverted or moved on step by step: the same derivative."""
    period, driven, state, motion = chain_motion
    frames = driven.carried(motion, np.eye(len(state)))
    assert period.length(driven.step).propagation.reach > 8
    monkeypatch.setattr(Propagation, "_reach", lambda *_: 0)
    period = Period(period.reduced, period.excitation, period.steps)
    alone = period.at(driven.frequency)
    assert period.length(driven.step).propagation.reach == 0
    found = alone.carried(alone.run(state), np.eye(len(state)))
    # frames may lose six digits: the condition `WORST`
    np.testing.assert_allclose(found, frames, atol=1e-10 * np.abs(found).max())


@pytest.mark.parametrize(
    "omega, damping, step, steps, ends",
    [
        ([1.0, 3.0], [0.4, 0.1], 0.2, 2000, "decades"),
        ([1.0, 2.0], [0.8, 0.02], 0.2, 2000, "decades"),
        ([1.0, 2.0], [1.5, 0.02], 0.05, 2000, "condition"),
        ([1.0, 0.5], [1.5, 0.02], 1.2, 2000, "condition"),
        ([1.0, 0.5], [1.5, 0.02], 2.5, 2000, "condition"),
        ([4.0, 0.5], [1.5, 0.02], 0.0125, 2000, "condition"),
        ([1.0, 2.0], [1.5, 0.02], 0.05, 118, "condition"),
        ([0.0, 2.0], [0.0, 0.02], 0.5, 2000, "condition"),
        ([1.0, 2.0], [50.0, 0.02], 1.0, 2000, "nothing"),
        ([1.0, 2.0], [0.8, 0.02], 0.2, 100, "steps"),
        ([1.0, 3.0], [0.4, 0.1], 0.2, 100, "steps"),
    ],
)
def test_reach_of_frames(omega, damping, step, steps, ends):
    """How many steps of the free motion, by SciPy's exponential, may be inverted: to a condition of 1e6 and
    40 decades, of which every eighth power beyond 8 is looked at.
    """
    omega, damping = np.array(omega), np.array(damping)
    coefficients = step_coefficients(omega, damping, step, "exact")
    propagation = Propagation(coefficients, omega, damping, step, steps)

    def allowed(power):
        for w, zeta in zip(omega, damping):
            unit = np.array([w or omega.max(), 1.0])
            free = linalg.expm(power * step * np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]))
            decades = 2.0 * zeta * w * power * step / np.log(10.0)
            condition = np.linalg.norm(unit[:, None] * free / unit) ** 2 * 10.0 ** min(decades, 80.0)
            if decades > 40.0 or condition > 1e6:
                return False
        return True

    last = propagation.reach + 1
    assert (last == 1) == (ends == "nothing") and (last == steps + 1) == (ends == "steps")
    assert last == 1 or all(allowed(power) for power in range(1, last + 1))
    if last <= steps:
        further = last + 1 if 1 < last < 8 else 2 if last == 1 else last + 8
        assert not allowed(further)


@pytest.mark.parametrize("located", [False, True])
def test_products_are_the_matrix(chain_motion, located):
    _, driven, state, motion = chain_motion
    matrix = driven.carried(motion, np.eye(len(state)), located=located)
    vectors = np.random.default_rng(1).standard_normal((len(state), 3))
    for vector in vectors.T:
        np.testing.assert_allclose(
            driven.carried(motion, vector[:, None], located=located)[:, 0],
            matrix @ vector,
            atol=1e-12 * np.abs(matrix).max() * np.linalg.norm(vector),
        )


def test_fixed_point_nearby():
    """With the derivative of the motion itself from a state beside it: the same fixed point in few
    iterations, for which none is made; with one that has nothing to do with it the same one too.
    """
    period, driven, state = driven_chain()
    found, _ = find_steady_state(driven, state)
    derivative = driven.monodromy(found.motion)
    size = np.linalg.norm(driven.linear_state)
    start = found.state + 1e-4 * size * np.cos(np.arange(len(state)))
    for factor, most in ((1.0, 8), (0.8, 14), (-3.0, 14)):
        nearby = shoot(driven, start, near=factor * derivative)
        assert 2 <= len(nearby.residuals) <= most
        assert np.linalg.norm(nearby.motion.residual) <= 1e-8 * size
        # residual and error differ by |(Phi - 1)^-1|, about 10
        np.testing.assert_allclose(nearby.state, found.state, atol=1e-6 * size)


def test_linear_resolvent(chain_motion):
    """(Phi - 1)^-1 of the structure whose stops are away is what it is called."""
    period, driven, state, _ = chain_motion
    free = Period(period.reduced, period.excitation, period.steps, contact=False).at(driven.frequency)
    matrix = free.carried(free.run(state), np.eye(len(state))) - np.eye(len(state))
    vector = np.cos(np.arange(len(state)))
    np.testing.assert_allclose(matrix @ driven.linear_resolvent(vector), vector, atol=1e-11)


@pytest.mark.slow
def test_located_switches_do_not_jump():
    """Motions along a line of states, on which switches pass instants of the grid 13 times: the steps' own
    derivative jumps by up to 0.5 (of a matrix of norm 5) there.
    """
    _, driven, state = driven_chain(steps=256)
    direction = np.sin(1 + np.arange(len(state)))
    direction *= 0.03 * np.linalg.norm(state) / np.linalg.norm(direction)
    whole, located, motions = [], [], []
    for part in np.linspace(0.0, 1.0, 400):
        motions.append(driven.run(state + part * direction))
        whole.append(driven.carried(motions[-1], np.eye(len(state))))
        located.append(driven.monodromy(motions[-1]))
    changes = [k for k in range(1, len(motions)) if not same_sets(motions[k - 1], motions[k])]
    assert len(changes) >= 10

    def jumps(matrices):
        """Changes of the matrix where a set changes, beyond its drift between."""
        sizes = np.array([np.linalg.norm(matrices[k] - matrices[k - 1]) for k in range(1, len(matrices))])
        return np.array([sizes[k - 1] for k in changes]) - np.median(sizes)

    # what the steps' own derivative is off by at a switch is of the order of a step; 1e-4 is left where it is
    # located
    assert jumps(whole).max() > 0.2 and jumps(located).max() < 2e-3 * jumps(whole).max()


@pytest.mark.long
def test_jacobian_test_of_petsc():
    """-shooting_snes_test_jacobian, PETSc's own differences, on a notched beam: every ratio it prints is
    below 1e-6.
    """
    program = """
import sys
import petsc4py
petsc4py.init([sys.argv[0], "-shooting_snes_test_jacobian", "-options_left"])
import sbfem_petsc as sb
from tests.reference import paper_beam
model = sb.Model(paper_beam().mesh(order=3, tip_size=2e-4), sb.Material(70e9, 0.33, 2700), damping=0.002)
force = sb.PointForce("A", fy=300.0)
print(sb.periodic(model, force, 3000.0, modes=12, steps=256, jacobian="dense", stability=False).iterations)
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if "||J - Jfd||_F/||J||_F = " in line]
    ratios = [float(line.split("||J - Jfd||_F/||J||_F = ")[1].split(",")[0]) for line in lines]
    assert len(ratios) >= 2 and max(ratios) < 1e-6, ratios
    assert "snes_test_jacobian (no value)" not in done.stdout
