"""Static load histories against the single static solutions, the linear response and a slow time history."""

import warnings

import numpy as np
import pytest
from scipy import integrate

import sbfem_petsc as sb
from tests.systems import short_beam

TIMES = np.linspace(0.0, 1.0, 6)


@pytest.fixture(scope="module")
def model():
    return short_beam()


@pytest.fixture(scope="module")
def history(model):
    """An opening preload of 20 N and a closing force that grows to 600 N and goes back."""
    ramp = sb.Samples((0.0, 0.6, 1.0), (0.0, 600.0, 0.0))
    return sb.load_history(model, sb.PointForce("A", fx=3.0, fy=ramp - 20.0), TIMES)


def test_states_are_static_solutions(model, history):
    """Each alone, under the force of its time: the same to the last digits."""
    forces = np.interp(TIMES, (0.0, 0.6, 1.0), (0.0, 600.0, 0.0)) - 20.0
    for k, force in enumerate(forces):
        alone = sb.static(model, sb.PointForce("A", fx=3.0, fy=force))
        np.testing.assert_allclose(history.displacement("A")[k], alone.displacement("A"), rtol=1e-12)
        np.testing.assert_allclose(history.contact_force[k], alone.contact_force, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            history.stress_intensity("crack1")[k], alone.stress_intensity["crack1"], rtol=1e-9
        )


def test_forces_and_cracks_over_time(history, tmp_path):
    """Reactions, in balance with the load, and factors of each tip, in tables of the times too."""
    forces = np.interp(TIMES, (0.0, 0.6, 1.0), (0.0, 600.0, 0.0)) - 20.0
    exact = -np.stack([np.full(len(TIMES), 3.0), forces], axis=1)
    assert np.abs(history.reactions[:, history.supports.index("left")] - exact).max() < 1e-7 * 600.0
    for k, state in enumerate(history.states):
        np.testing.assert_equal(history.stress_intensities[k, 0], state.stress_intensity["crack1"])
        np.testing.assert_equal(history.energy_release_rate[k, 0], state.energy_release_rate["crack1"])
        np.testing.assert_equal(history.t_stress[k, 0], state.t_stress["crack1"])
    history.to_csv(str(tmp_path / "history.csv"))
    head = (tmp_path / "history.csv").read_text().splitlines()[0]
    for name in ("reactions_left_y [N]", "energy_release_rate_crack1 [J/m^2]", "t_stress_crack1 [Pa]"):
        assert name in head
    assert "stress_intensity_crack1_II [" in head


@pytest.mark.slow
def test_along_a_line(model, history):
    """Statics, a history of statics, a motion and a steady state give along a line what they give at its
    places, named points among them; the stress through a section is in balance with the load, to 5e-3 on this
    coarse mesh of order 3.
    """
    low, high = (0.035, 0.0), (0.035, 0.005)
    push = sb.PointForce("A", fy=sb.Harmonic(20.0, 300.0))
    moving = sb.transient(model, push, 1e-3, 1e-4, modes=3)
    steady = sb.periodic(model, push, 300.0, modes=3, steps=64, stability=False)
    for result in (history.states[2], history, moving, steady):
        places, u, stress = result.along(low, high, 3)
        assert places.tolist() == [[0.035, 0.0], [0.035, 0.0025], [0.035, 0.005]]
        for k, place in enumerate(map(tuple, places)):
            for found, alone in ((u, result.displacement(place)), (stress, result.stress(place))):
                np.testing.assert_allclose(found[..., k, :], alone, atol=1e-9 * np.abs(found).max())
    np.testing.assert_allclose(
        moving.along((0.05, 0.0), (0.05, 0.005), 2)[1][:, 1], moving.displacement("A"), rtol=1e-7
    )
    places, _, stress = history.along(low, high, 201)
    shear = integrate.trapezoid(stress[..., 2], places[:, 1], axis=1)
    forces = np.interp(TIMES, (0.0, 0.6, 1.0), (0.0, 600.0, 0.0)) - 20.0
    np.testing.assert_allclose(shear, forces, rtol=1e-2)


def test_the_notch_closes_and_opens(history):
    """No force while it is open, no overlap at any time, and the preload's state at both ends: contact
    without friction has no memory.
    """
    assert history.contact_resultant[0] == history.contact_resultant[-1] == 0.0 < history.contact_resultant[3]
    assert history.contact_force.shape == history.gap.shape and (history.gap > -1e-18).all()
    assert (history.contact_force * history.gap == 0.0).all()
    np.testing.assert_allclose(history.displacement("A")[0], history.displacement("A")[-1], rtol=1e-9)


def test_without_contact_it_is_linear(model):
    """Displacements follow the signal."""
    load = sb.PointForce("A", fy=sb.Harmonic(600.0, 0.3, 0.2))
    found = sb.load_history(model, load, TIMES, contact=False)
    one = sb.static(model, sb.PointForce("A", fy=1.0), contact=False).displacement("A")
    expected = np.outer(600.0 * np.sin(2.0 * np.pi * 0.3 * TIMES + 0.2), one)
    np.testing.assert_allclose(found.displacement("A"), expected, rtol=1e-8)
    assert (found.gap < 0.0).any() and not found.contact_force.any()


def test_no_warning_of_rounding(model):
    """Where the loads vanish but for rounding, 1e-13 N and less, so does the contact that is missed."""
    load = sb.PointForce("A", fy=sb.Harmonic(600.0, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "load_history: around the tip .* edges of order 3")
        found = sb.load_history(model, load, [0.0, 0.5, 0.75, 1.0])
    missed = [sum(state.unresolved_contact.values()) for state in found.states]
    assert max(missed[0], missed[1], missed[3]) < 1e-20 and max(missed[1], missed[3]) > 0.0


@pytest.mark.slow
def test_more_states_than_memory(model):
    with pytest.raises(ValueError, match=r"10,000,000 states would take .* at most [\d,]+ times fit"):
        sb.load_history(model, sb.PointForce("A", fy=1.0), np.linspace(0.0, 1.0, 10_000_000))


def test_a_slow_time_history_is_the_same(model):
    """A half-cosine rise over 60 periods of the lowest mode: inertia changes displacements by less than 1e-3,
    the square of the ratio of both frequencies.
    """
    rise = 60.0 / sb.modal(model, 1).frequencies[0]
    load = sb.PointForce("A", fy=sb.Step(600.0, rise=rise))
    times = np.linspace(0.25, 1.0, 4) * rise
    slow = sb.load_history(model, load, times)
    moving = sb.transient(model, load, rise, modes=12)
    found = np.array([np.interp(times, moving.time, u) for u in moving.displacement("A").T]).T
    np.testing.assert_allclose(
        found, slow.displacement("A"), atol=1e-3 * np.abs(slow.displacement("A")).max()
    )


@pytest.mark.parametrize(
    "time, kind, sentence",
    [
        ([], ValueError, "time is empty"),
        ([[0.0]], ValueError, "time has 2 dimensions"),
        ([0.0, float("nan")], ValueError, r"time\[1\] = nan must be finite"),
        ("soon", TypeError, "time = 'soon' must be an array of real numbers"),
    ],
)
def test_bad_times(model, time, kind, sentence):
    with pytest.raises(kind, match=sentence):
        sb.load_history(model, sb.PointForce("A", fy=1.0), time)


def test_bad_loads(model):
    with pytest.raises(TypeError, match="neither a PointForce nor an EdgeLoad"):
        sb.load_history(model, 300.0, TIMES)
    with pytest.raises(KeyError, match="point 'Z' does not exist"):
        sb.load_history(model, sb.PointForce("Z", fy=1.0), TIMES)


def test_what_it_prints(history):
    assert repr(history).startswith("LoadHistory(6 states from 0 to 1 s, peak contact resultant ")


def test_a_line_asked_of_a_file(history, tmp_path):
    """Its states know no places any more, and say so."""
    path = str(tmp_path / "history.h5")
    sb.save(path, history)
    with pytest.raises(sb.SolveError, match="that was read from a file knows its named points"):
        sb.read(path).along((0.01, 0.001), (0.02, 0.001), 3)
