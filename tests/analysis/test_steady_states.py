"""Steady states that exist are found: a closed crack in a beam held at both ends, oscillators at resonance
with hardly any damping, motions of several periods; what a search in vain says.
"""

import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc import reduce_matrices
from sbfem_petsc.continuation import search as steady
from sbfem_petsc.continuation.search import NEWTON_ALONE, Search
from sbfem_petsc.continuation.shooting import Shooting

FREQUENCY, STEPS = 280.0, 891


def held_beam(x, depth, order=5):
    """Steel, 300 x 10 mm, clamped at both ends, a closed crack from the top, the middle of the top edge named
    "M".
    """
    beam = Beam(length=0.300, height=0.010, notches=[VNotch(x=x, depth=depth, opening=0.0)])
    mesh = beam.mesh(order=order, points={"M": (0.150, 0.010)}, corners=("left", "right"))
    return sb.Model(
        mesh, sb.Material(young=210e9, poisson=0.3, density=7850), clamped=("left", "right"), damping=0.005
    )


@pytest.fixture(scope="module")
def deep():
    """The crack of 6 mm and the motion that 240 periods of a history from rest settle on."""
    model = held_beam(0.13143, 0.006)
    orbit = sb.periodic(model, sb.PointForce("M", fy=100.0), FREQUENCY, modes=40, steps=STEPS)
    return model, orbit, settled(orbit.reduced, 240)


def settled(reduction, periods):
    """u_y of M over one period behind a history from rest."""
    load = sb.PointForce("M", fy=sb.Harmonic(100.0, FREQUENCY))
    step = 1.0 / (FREQUENCY * STEPS)
    options = {"step": step}
    long = sb.transient(reduction, load, periods / FREQUENCY, decimation=STEPS, **options)
    state = long.states.q[-1], long.states.v[-1]
    last = sb.transient(reduction, load, 1.0 / FREQUENCY, initial=state, **options)
    return last.displacement("M")[:-1, 1]


@pytest.mark.long
def test_where_newton_fails_a_history_leads_on(deep):
    """A motion that `transient` settles on by 0.86 s: with the same steps, which take the load as linear over
    a step, within 1e-4 of the peak; the slowest multiplier leaves 0.94^240 = 3e-7. A2/A1 = 1.291.
    """
    _, orbit, history = deep
    assert orbit.path == "history" and orbit.stable and len(orbit.time) == STEPS
    u = orbit.displacement("M")[:, 1]
    assert np.abs(u - history).max() < 1e-4 * np.abs(history).max()
    harmonics = np.abs(orbit.harmonics("M"))
    assert harmonics[2] / harmonics[1] == pytest.approx(1.291, abs=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    "search, path",
    [
        (Search(settling=(), neighbours=()), "ramp of the damping"),
        (Search(settling=(), dampings=()), "neighbouring frequency"),
    ],
)
def test_other_ways_lead_to_the_same_motion(deep, search, path):
    """Larger damping and neighbouring frequencies end at the motion of the history, to Newton's tolerance.
    30 modes suffice.
    """
    model, _, _ = deep
    load = sb.PointForce("M", fy=100.0)
    orbit = sb.periodic(model, load, FREQUENCY, modes=30, stability=False)
    other = sb.periodic(orbit.reduced, load, FREQUENCY, stability=False, search=search)
    assert orbit.path == "history" and other.path == path
    assert np.linalg.norm(other.state - orbit.state) < 1e-9 * np.linalg.norm(orbit.state)


@pytest.mark.long
@pytest.mark.parametrize("x, depth", [(0.16857, 0.006), (0.020, 0.008), (0.24286, 0.003)])
def test_other_cracks(x, depth):
    """The mirrored beam moves as the first one does; cracks where Newton's method needs no help."""
    orbit = sb.periodic(held_beam(x, depth), sb.PointForce("M", fy=100.0), FREQUENCY, modes=30)
    assert orbit.stable
    assert (orbit.path == "history") == (depth == 0.006)
    if depth == 0.006:
        harmonics = np.abs(orbit.harmonics("M"))
        assert harmonics[2] / harmonics[1] == pytest.approx(1.291, abs=2e-3)


@pytest.mark.long
def test_all_depths_and_positions():
    """32 cracks, each depth at every other position, at 260, 280 and 300 Hz: a steady state each, on coarse
    meshes.
    """
    load = sb.PointForce("M", fy=100.0)
    for k, depth in enumerate(np.linspace(0.001, 0.008, 8)):
        for n, x in list(enumerate(np.linspace(0.020, 0.280, 8)))[k % 2 :: 2]:
            frequency = (260.0, 280.0, 300.0)[(k + n) % 3]
            orbit = sb.periodic(held_beam(x, depth, 3), load, frequency, modes=40, stability=False)
            assert orbit.converged and orbit.periods == 1


def bilinear(damping):
    """A mass with a spring that the closed side makes ten times as stiff, at its free frequency."""
    reduction = reduce_matrices(
        np.eye(1),
        np.array([[0.01]]),
        np.array([[1.0]]),
        np.zeros(1),
        loads=np.ones((1, 1)),
        sensors={"x": 0},
        damping=damping,
        compliance=np.array([1.0 / 0.99]),
    )
    return reduction, 2.0 * 0.1 / 1.1 / (2.0 * np.pi)


@pytest.mark.long
def test_resonance_with_hardly_any_damping():
    """Newton's method alone fails; the motion found is stable, and its power balance holds: what the load
    gives, the damper takes, within 1 %, for the steps' own power (of second order in the step) is not small
    beside so little damping.
    """
    reduction, frequency = bilinear(1e-4)
    with pytest.raises(sb.SolveError, match="did not converge"):
        sb.periodic(reduction, 1.0, frequency, steps=2048, search=NEWTON_ALONE)
    orbit = sb.periodic(reduction, 1.0, frequency, steps=2048)
    assert orbit.path == "history" and orbit.stable
    velocity = orbit.states.v[:, 0]
    given = np.mean(np.sin(2.0 * np.pi * frequency * orbit.time) * velocity)
    assert given == pytest.approx(np.mean(2.0 * 1e-4 * 0.1 * velocity**2), rel=1e-2)


def test_exact_derivatives_are_made_once(monkeypatch):
    """Newton's method that has failed with the exact derivative in each iteration is not tried again with
    that in each iteration.
    """
    kinds, solve = [], Shooting.solve
    monkeypatch.setattr(Shooting, "solve", lambda self, x: (kinds.append(self), solve(self, x))[1])
    reduction, frequency = bilinear(1e-4)
    with pytest.raises(sb.SolveError, match="after 30 iterations"):
        sb.periodic(reduction, 1.0, frequency, steps=2048, search=NEWTON_ALONE)
    assert [each.jacobian for each in kinds] == ["updated"] and kinds[0].made == 30


@pytest.mark.parametrize("periods", [5, 54])
def test_what_a_search_in_vain_says(periods):
    """The residual, what was tried, and how far it came, in one message. A tenth of 54 periods, which the
    first history may have, is no whole number: that history never ended.
    """
    reduction, frequency = bilinear(1e-4)
    search = Search(settling=(1, 3), work=512.0 * periods, dampings=(1.5,), neighbours=(1e-3,), attempt=2)
    with pytest.raises(
        sb.SolveError,
        match=r"did not converge \(.*\): x\(T\) - x\(0\) is at .* Tried in vain as well: continuation over "
        r"the damping \(no motion at 1.5\); continuation over the frequency \(no motion at 0.0.*\); "
        rf"a history of {periods} periods, after which x\(T\) - x\(0\) is at",
    ):
        sb.periodic(reduction, 1.0, frequency, search=search)


def test_progress_of_a_search():
    """It rises to 1, in vain here; Newton's method alone tells nothing."""
    told: list[float] = []
    reduction, frequency = bilinear(1e-4)
    search = Search(settling=(1, 3), work=512.0 * 54, dampings=(1.5, 2.0), neighbours=(1e-3,), attempt=2)
    with pytest.raises(sb.SolveError):
        sb.periodic(reduction, 1.0, frequency, search=search, progress=told.append)
    assert len(told) > 50 and told == sorted(told) and 0.0 < told[0] < 0.2 and told[-1] == 1.0
    told.clear()
    sb.periodic(bilinear(0.03)[0], 1.0, 2.0 * frequency, progress=told.append)
    assert not told
    with pytest.raises(TypeError, match="periodic: progress = 3"):
        sb.periodic(reduction, 1.0, frequency, progress=3)


def test_a_history_of_two_periods(monkeypatch):
    """Where no motion of one period is found, the one of two that a history settles on is the answer, unless
    one period was asked for: the message then says what to ask for. The bilinear oscillator, driven at twice
    its own frequency.
    """
    reduction, frequency = bilinear(0.03)
    found = steady.shoot

    def of_two_periods(driven, *rest, **more):
        if driven.period.excitation.periods == 1:
            raise sb.SolveError("none of one period")
        return found(driven, *rest, **more)

    monkeypatch.setattr(steady, "shoot", of_two_periods)
    told: list[float] = []
    orbit = sb.periodic(reduction, 1.0, 2.0 * frequency, steps=1024, progress=told.append)
    assert told == sorted(told) and told[-1] == 1.0  # as soon as it is found
    assert orbit.periods == 2 and orbit.path == "history" and orbit.stable
    assert np.abs(orbit.subharmonics("x")[1]) > np.abs(orbit.harmonics("x")[1])
    with pytest.raises(sb.SolveError, match="which repeats itself after 2 periods: give periods=2"):
        sb.periodic(reduction, 1.0, 2.0 * frequency, periods=1, steps=1024)


def test_masses_that_stops_alone_hold():
    """Without stiffness, between far stops: F / (m omega^2); the search had ended in nan."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        free = reduce_matrices(
            np.diag([1.0, 2.0]),
            np.zeros((2, 2)),
            np.array([[-1.0, 1.0]]),
            np.array([0.5]),
            loads=np.array([[1.0], [0.0]]),
            sensors={"first": 0, "second": 1},
            compliance=np.array([0.01]),
        )
    for load, frequency in ((0.01, 0.4), (1e6, 4000.0)):
        orbit = sb.periodic(free, load, frequency)
        # sin(t) is -i in front of exp(i t): rounding alone
        expected = 1j * load / (2.0 * np.pi * frequency) ** 2
        np.testing.assert_allclose(orbit.harmonics("first")[1], expected, rtol=1e-13)
        assert np.abs(orbit.harmonics("second")).max() < 1e-13 * abs(expected)


@pytest.mark.parametrize("jacobian", ["auto", "dense", "matrix-free"])
def test_free_masses_that_meet(jacobian):
    """Two masses that nothing else holds, their spring and their stop: the distance is that of one mass
    m1 m2 / (m1 + m2), the place that of F / ((m1 + m2) omega^2). Newton's method had no steps.
    """

    def of(mass, row):
        row = np.array([row])
        return reduce_matrices(
            mass,
            row.T @ row,
            row,
            np.array([0.0]),
            loads=np.eye(len(mass))[:, -1:],
            sensors={str(k): k for k in range(len(mass))},
            damping=0.05,
            compliance=np.array([0.5]),
        )

    free, held = of(np.diag([1.0, 2.0]), [-1.0, 1.0]), of(np.array([[2.0 / 3.0]]), [1.0])
    for frequency in (0.1, 0.25):
        orbit = sb.periodic(free, 1.0, frequency, jacobian=jacobian, search=NEWTON_ALONE)
        apart = sb.periodic(held, 1.0 / 3.0, frequency)
        first, second = (orbit.harmonics(name)[:6] for name in "01")
        expected, size = apart.harmonics("0")[:6], apart.amplitude("0")
        np.testing.assert_allclose(second - first, expected, atol=1e-8 * size)
        middle = np.append(1j / (3.0 * (2.0 * np.pi * frequency) ** 2), np.zeros(4))
        np.testing.assert_allclose(((first + 2.0 * second) / 3.0)[1:], middle, atol=1e-8 * size)
        assert abs(first[0]) < 2.0 * size
