"""An accuracy that is asked for: true errors beside many more modes and steps, what is said without it."""

import importlib
import io
import warnings
import zlib

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Plate
from sbfem_petsc.analysis import response
from sbfem_petsc.analysis.transient import distance
from sbfem_petsc.continuation import branch_following, harmonic_errors
from sbfem_petsc.continuation.accuracy import Accuracy
from sbfem_petsc.continuation.harmonic_errors import FAINT
from sbfem_petsc.errors import PetscFailure
from sbfem_petsc.motion.period_map import FixedPoint
from sbfem_petsc.motion.preparation import PeriodSettings
from sbfem_petsc.record import journal
from sbfem_petsc.reduction.build import modes_for
from tests.analysis.test_mode_error import TURN, rod, true_error
from tests.systems import coarse_beam, one_mass, two_masses

periodic_module = importlib.import_module("sbfem_petsc.analysis.periodic")
quasi_periodic = importlib.import_module("sbfem_petsc.analysis.quasi_periodic")
PUSH = sb.PointForce("A", fy=300.0)


@pytest.mark.parametrize("accuracy", [1e-2, None])
def test_modes_and_steps_of_an_orbit(accuracy):
    """Harmonics 1 to 4 beside 120 modes, each by its order, in a third of 80 modes; 1e-3 by default."""
    beam = coarse_beam(0.002)
    found = sb.periodic(beam, PUSH, 433.0, accuracy=accuracy, stability=False)
    true = true_error(found, sb.periodic(beam, PUSH, 433.0, modes=120, steps=1024, stability=False))
    orders = np.arange(1, 5)
    assert (true[1:] / orders).max() <= found.largest_mode_error <= (accuracy or 1e-3), (true, found)
    assert len(found.reduced.omega) <= 30 and len(found.time) <= 512


@pytest.mark.parametrize("frequency, modes, most", [(1339.0, 120, 80), (14150.0, 360, 246)])
def test_as_many_modes_as_fast_loads_need(frequency, modes, most):
    """By default, near a superharmonic resonance and at 14 kHz, where the 80 modes that were the default are
    told to be 6e-3 off: within 1e-3 of many more modes in twice the steps, and not a word.
    """
    beam = coarse_beam(0.002)
    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.AccuracyWarning)
        found = sb.periodic(beam, PUSH, frequency, stability=False)
    more = sb.periodic(beam, PUSH, frequency, modes=modes, steps=1024, guess=found, stability=False)
    true = true_error(found, more)[1:] / np.arange(1, 5)
    assert true.max() <= found.largest_mode_error <= 1e-3, (true, found)
    assert len(found.reduced.omega) <= most and len(found.time) == 512


def test_a_warning_where_it_cannot_be_had(monkeypatch):
    """Told errors above 1e-3 in as many modes as there may be, of a motion, and of a curve, whose
    bifurcations are located all the same; of a motion that has no room in more modes, or is not found there,
    the last one and the reason. Modes that are given are not judged.
    """
    beam, blow, hard = coarse_beam(0.002), *(sb.PointForce("A", fy=f) for f in (3e3, 3e4))
    words = r"harmonics 1 to 4 are told to be 0\.00\d+ off, not within accuracy = 0.001"
    left = ", most by what is left out beyond"
    with pytest.warns(
        sb.AccuracyWarning,
        match=f"periodic: {words}{left} 2.. modes and .. vectors; ask for less or refine the mesh, as 246",
    ):
        found = sb.periodic(beam, hard, 12e3, stability=False)
    assert 1e-3 < found.largest_mode_error < 1e-2
    with pytest.warns(
        sb.AccuracyWarning, match=f"{words}, the default{left} 160 modes; give accuracy = 0.001 for up to 246"
    ):
        curve = sb.frequency_response(beam, blow, 12e3, 12001.0, points=6)
    assert not curve.unlocated and len(curve.reduced.omega) == 160
    many = sb.frequency_response(beam, blow, 40e3, 40001.0, points=2, stability=False)
    assert len(many.reduced.omega) == 160 < modes_for(beam, 40001.0, 1e-3)
    original, find = periodic_module.prepare, periodic_module.find_steady_state

    def lost(driven, *args, **options):
        if driven.period.reduced.natural > 90:
            raise sb.SolveError("lost")
        return find(driven, *args, **options)

    def refused(*args, settings, **options):
        if (settings.modes or 0) > 90:
            raise ValueError("periodic: 246 modes take more memory than is free")
        return original(*args, settings=settings, **options)

    for name, patch, why in (
        ("find_steady_state", lost, "no motion is found near it in 9"),
        ("prepare", refused, "periodic: 246 modes take more memory"),
    ):
        with monkeypatch.context() as patched:
            patched.setattr(periodic_module, name, patch)
            with pytest.warns(sb.AccuracyWarning, match=rf"beyond 7. modes and .. vectors \({why}"):
                found = sb.periodic(beam, blow, 12e3, stability=False)
        assert found.reduced.natural < 80
    few = sb.reduce(beam, blow, modes=96)
    asked, errors = (
        Accuracy("periodic", beam, PeriodSettings(accuracy=1e-3)),
        np.full((3, 4), [[0.5], [0], [0]]),
    )
    assert asked.further(few, 512, errors) is None  # (246 / 96)^4 times 1e-3 may be mended
    assert "96 modes; ask for less or refine the mesh, as 246 modes would be far" in asked.missing(
        few, 512, errors
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.AccuracyWarning)
        sb.periodic(beam, blow, 12e3, modes=80, stability=False)


def test_usual_modes_where_no_error_is_told():
    """Without a named point nobody would know how good a few modes are; of a small mesh all usual ones."""
    plate = Plate([(0, 0), (0.1, 0), (0.1, 0.15), (0, 0.15)])
    for mesh in (plate.mesh(order=2), plate.mesh(order=1, size=0.1)):
        model = sb.Model(mesh, sb.Material(210e9, 0.3, 7850.0), clamped="edge1", damping=0.01)
        load = sb.EdgeLoad("edge3", pressure=sb.Harmonic(1e6, 100.0))
        found = sb.periodic(model, load, 100.0, stability=False)
        assert len(found.reduced.omega) == model.boundary_unknowns // 4


def test_usual_modes_where_a_few_find_no_motion(monkeypatch):
    """As far as it is known, none does; one that is made to fail, and a curve's first one."""
    original = periodic_module.find_steady_state

    def lost(driven, *args, **options):
        if driven.period.modes <= 40:
            raise sb.SolveError("lost")
        return original(driven, *args, **options)

    for module in (periodic_module, response):
        monkeypatch.setattr(module, "find_steady_state", lost)
    found = sb.periodic(coarse_beam(0.002), PUSH, 433.0, stability=False)
    assert found.reduced.natural == 80 and found.reduced.vectors
    curve = sb.frequency_response(coarse_beam(0.002), PUSH, 431.0, 431.1, stability=False)
    assert curve.complete and len(curve.reduced.omega) == 80
    few = sb.reduce(coarse_beam(0.002), PUSH, modes=20)  # has no others
    for system, asked in (coarse_beam(0.002), {"modes": 20}), (few, {"accuracy": 1e-3}):
        load = PUSH if asked.keys() == {"modes"} else 300.0
        with pytest.raises(sb.SolveError, match="lost"):
            sb.periodic(system, load, 433.0, stability=False, **asked)
        with pytest.raises(sb.SolveError, match="lost"):
            sb.frequency_response(system, load, 431.0, 431.1, stability=False, **asked)


def test_curves_in_few_modes_by_default(tmp_path, monkeypatch):
    """A slow curve, and gone on with from its file in its modes; peak and error beside 50. Where these are
    told not to do it is followed anew in more, which is said; where it is lost in these, or they have no
    memory, it stays in the former ones and is not followed again.
    """
    beam, file = coarse_beam(0.002), str(tmp_path / "curve.journal")
    found = sb.frequency_response(beam, PUSH, 431.0, 431.2, file=file, stability=False)
    fine = sb.frequency_response(beam, PUSH, 431.0, 431.2, modes=50, steps=512, stability=False)
    assert len(found.reduced.omega) <= 30 and found.largest_mode_error <= 1e-3
    assert found.peak("A").amplitude == pytest.approx(fine.peak("A").amplitude, rel=1e-3)
    again = sb.frequency_response(beam, PUSH, 431.0, 431.2, file=file, resume=True, stability=False)
    np.testing.assert_array_equal(again.point_amplitudes, found.point_amplitudes)

    def far_off(fixed: FixedPoint) -> np.ndarray:
        return np.array([[0.004 if fixed.driven.period.modes <= 40 else 0.0] * 5, [0.0] * 5])

    monkeypatch.setattr(branch_following, "harmonic_error_estimates", far_off)
    with pytest.warns(sb.BranchWarning, match="in 2. modes, are not accurate .* anew in 4. modes and 512"):
        again = sb.frequency_response(beam, PUSH, 431.0, 431.2, file=file, resume=True, stability=False)
    assert 40 < len(again.reduced.omega) == len(sb.read(file).reduced.omega) < 50
    beside = zlib.decompress(journal.read(file).state["result"].tobytes())
    with h5py.File(io.BytesIO(beside)) as kept:  # the new model stands in the head alone
        assert kept["map"].attrs["reduced"] == b"/model"

    follow = response.follow_response

    def lost(orbits, *args, **options):
        if orbits.period.modes > 40:
            raise sb.SolveError("lost")
        return follow(orbits, *args, **options)

    monkeypatch.setattr(response, "follow_response", lost)
    why = (
        "beyond 2. modes .no motion is found near it in 80 modes and 512 steps a forcing period.; give a few"
    )
    with pytest.warns(sb.AccuracyWarning, match=why):
        kept = sb.frequency_response(beam, PUSH, 431.0, 431.2, file=file, stability=False)
    np.testing.assert_array_equal(sb.read(file).point_amplitudes, kept.point_amplitudes)
    np.testing.assert_allclose(kept.point_amplitudes, found.point_amplitudes, rtol=1e-6)
    count, original = [], response.prepare

    def counted(*args, **options):
        count.append(args)
        return follow(*args, **options)

    def refused(*args, settings, **options):
        if (settings.modes or 0) > 40:
            raise ValueError("46 modes take more memory than is free")
        return original(*args, settings=settings, **options)

    monkeypatch.setattr(response, "follow_response", counted)
    monkeypatch.setattr(response, "prepare", refused)
    with pytest.warns(sb.AccuracyWarning, match="beyond 2. modes .46 modes take more memory than is free."):
        kept = sb.frequency_response(beam, PUSH, 431.0, 431.2, file=file, stability=False)
    assert len(count) == 1
    np.testing.assert_array_equal(sb.read(file).point_amplitudes, kept.point_amplitudes)
    np.testing.assert_allclose(kept.point_amplitudes, found.point_amplitudes, rtol=1e-6)


def test_curves_from_a_motion_with_vectors():
    """Have none, with steps that are given as well, and begin with the motion in the modes alone."""
    beam = coarse_beam(0.002)
    few = sb.periodic(beam, PUSH, 431.0, stability=False)
    for asked in ({}, {"steps": 512}):
        curve = sb.frequency_response(beam, PUSH, 431.0, 431.1, guess=few, stability=False, **asked)
        assert few.reduced.vectors and not curve.reduced.vectors
        alone = sb.periodic(
            beam, PUSH, 431.0, modes=len(curve.reduced.omega), steps=curve.period.steps, stability=False
        )
        np.testing.assert_allclose(curve.states[0], alone.state, atol=1e-7 * np.linalg.norm(alone.state))


@pytest.mark.parametrize("modes", [80, 30])
def test_motions_in_other_modes_to_begin_from(modes):
    """From one in few modes the motion that is found without it, in more of them; from one in more likewise.
    An accuracy takes as many as it needs, whatever the first one has; few that do are kept by default.
    """
    beam = coarse_beam(0.002)
    few = sb.periodic(beam, PUSH, 433.0, stability=False)
    least = few.reduced.natural
    found = sb.periodic(beam, PUSH, 433.0, guess=few, modes=modes, steps=512, stability=False)
    exact = sb.periodic(beam, PUSH, 433.0, modes=modes, steps=512, stability=False)
    np.testing.assert_allclose(found.state, exact.state, atol=1e-8 * np.linalg.norm(exact.state))
    assert found.iterations <= exact.iterations and len(found.reduced.omega) == modes
    back = sb.periodic(beam, PUSH, 433.0, guess=found, modes=least, steps=512, stability=False)
    alone = sb.periodic(beam, PUSH, 433.0, modes=least, steps=512, stability=False)
    np.testing.assert_allclose(back.harmonics("A")[:5], alone.harmonics("A")[:5], rtol=1e-8)
    kept = sb.periodic(beam, PUSH, 433.0, guess=few, stability=False)
    assert kept.reduced.natural == least < 30 and kept.largest_mode_error <= 1e-3
    np.testing.assert_allclose(kept.state, few.state, atol=1e-8 * np.linalg.norm(few.state))
    more = sb.periodic(beam, PUSH, 433.0, guess=few, accuracy=1e-4, stability=False)
    assert more.reduced.natural > least and more.largest_mode_error <= 1e-4


def test_history():
    """Displacements over time beside 120 modes in an eighth of the step, told and as asked for; modes and
    step that are given stay, and what is missing is said.
    """
    beam, burst = coarse_beam(0.002), sb.PointForce("A", fy=sb.ToneBurst(300.0, 433.0, 3))
    found = sb.transient(beam, burst, 8e-3, accuracy=1e-3)
    exact = sb.transient(beam, burst, 8e-3, found.step / 8, modes=120, decimation=8)
    true = distance(found, exact)
    assert 1e-6 < true <= found.mode_error <= min(1e-3, 30.0 * true), (true, found)
    assert len(found.reduced.omega) < 40 and "error of displacements" in repr(found)
    with pytest.warns(sb.AccuracyWarning, match="transient: displacements .* give more than modes = 3"):
        coarse = sb.transient(beam, burst, 8e-3, modes=3, accuracy=1e-4)
    assert len(coarse.reduced.omega) == 3 and distance(coarse, exact) <= 3.0 * coarse.mode_error
    with pytest.warns(sb.AccuracyWarning, match="lost in 40 steps; give a shorter step"):
        coarse = sb.transient(beam, burst, 8e-3, 2e-4, modes=6, accuracy=1e-3)
    assert coarse.step == pytest.approx(2e-4)


def test_history_in_a_file(tmp_path):
    """The modes and step that were found, and the error, which the file has as well."""
    beam, burst = coarse_beam(0.002), sb.PointForce("A", fy=sb.ToneBurst(300.0, 433.0, 3))
    asked = dict(accuracy=1e-2, contact=False)
    found = sb.transient(beam, burst, 4e-3, **asked)
    kept = sb.transient(beam, burst, 4e-3, file=str(tmp_path / "history.journal"), **asked)
    np.testing.assert_array_equal(kept.displacement("A"), found.displacement("A"))
    sb.save(str(tmp_path / "history.h5"), kept)
    assert sb.read(str(tmp_path / "history.h5")).mode_error == kept.mode_error == found.mode_error <= 1e-2
    with pytest.raises(ValueError, match="accuracy = 0.01 is for the reduced model"):
        sb.transient(beam, burst, 4e-3, reduction=None, accuracy=1e-2)


def test_errors_that_have_no_room(monkeypatch):
    """Where there is no memory for more steps, none for the further modes' motion: the motion all the same;
    PETSc's own failures are raised.
    """
    beam, asked = coarse_beam(0.002), dict(modes=12, steps=512, stability=False)

    def refused(*given: object) -> None:
        raise ValueError("no memory")

    with monkeypatch.context() as patched:
        for name in ("finer", "require_period"):
            patched.setattr(harmonic_errors, name, refused)
        assert np.isinf(sb.periodic(beam, PUSH, 433.0, **asked).mode_error).all()
    with monkeypatch.context() as patched:
        few = sb.reduce(beam, PUSH, modes=13)
        patched.setattr("sbfem_petsc.reduction.build.left_out", refused)
        assert np.isnan(sb.periodic(few, PUSH, 433.0, steps=512, stability=False).mode_error).all()

    class GivesUp(harmonic_errors.Shooting):
        def solve(self, state: np.ndarray) -> None:
            raise PetscFailure("PETSc gave up")

    monkeypatch.setattr(harmonic_errors, "Shooting", GivesUp)
    with pytest.raises(PetscFailure, match="PETSc gave up"):
        sb.periodic(beam, PUSH, 433.0, **asked)


def test_more_modes_where_the_rule_has_few():
    """Beside a resonance those up to 16 times the load's frequency are told to be too few for 1e-3."""
    found = sb.periodic(coarse_beam(0.002), PUSH, 447.5, accuracy=1e-3, stability=False)
    assert len(found.reduced.omega) > 21 and found.largest_mode_error <= 1e-3


def test_what_is_given_rules():
    """Modes and steps that are given stay, and what is missing is said."""
    with pytest.warns(
        sb.AccuracyWarning, match="not within accuracy = 0.0001, most by what is left out .* 12"
    ):
        found = sb.periodic(coarse_beam(0.002), PUSH, 433.0, modes=12, accuracy=1e-4, stability=False)
    assert len(found.reduced.omega) == 12 and len(found.time) == 1664
    with pytest.warns(
        sb.AccuracyWarning, match="lost in 64 steps a forcing period; give more than steps = 64"
    ):
        found = sb.periodic(rod(), [0.1], 1.1 / TURN, steps=64, accuracy=1e-3, stability=False)
    assert len(found.time) == 64


@pytest.mark.long
def test_of_a_reduced_model_only_steps_grow():
    """Both modes of two masses that meet a stop: the steps, until the true error is what is asked for."""
    found = sb.periodic(two_masses(), [0.2], 0.109, accuracy=1e-3, stability=False)
    true = true_error(found, sb.periodic(two_masses(), [0.2], 0.109, steps=2**16, stability=False))
    assert (true[1:] / np.arange(1, 5)).max() <= 1e-3 and len(found.time) > 512
    with pytest.warns(sb.AccuracyWarning, match="reduce the model to more modes"):
        sb.periodic(rod(6), [0.1], 1.1 / TURN, accuracy=1e-3, stability=False)


def test_more_steps_begin_with_the_derivative_in_fewer(monkeypatch):
    """By which their error has been told."""
    begun, shoot = [], periodic_module.shoot

    def noted(*args, near, **options):
        begun.append((near, shoot(*args, near=near, **options)))
        return begun[-1][1]

    monkeypatch.setattr(periodic_module, "shoot", noted)
    found = sb.periodic(two_masses(), [0.2], 0.109, accuracy=3e-5, stability=False)
    ((near, fixed),) = begun
    assert fixed.driven.period.steps == len(found.time)
    np.testing.assert_allclose(near, fixed.monodromy, rtol=0.0, atol=1e-3)
    again = sb.periodic(two_masses(), [0.2], 0.109, steps=len(found.time), stability=False)
    np.testing.assert_allclose(found.state, again.state, rtol=1e-8)


def test_accuracy_is_not_for_what_tells_no_errors():
    """Segments, a tolerance, the unreduced model, which has no modes."""
    for name, value in (("segments", 2), ("tolerance", 1e-3), ("reduction", None)):
        with pytest.raises(ValueError, match=f"accuracy .*{name}|accuracy = 0.001 is for the reduced model"):
            sb.periodic(coarse_beam(0.002), PUSH, 433.0, accuracy=1e-3, **{name: value})


@pytest.mark.long
def test_curves(tmp_path):
    """Followed once in the modes of their worst end or peak; gone on with from a file in its modes."""
    beam, file = coarse_beam(0.002), str(tmp_path / "curve.journal")
    asked = dict(accuracy=3e-3, stability=False)
    found = sb.frequency_response(beam, PUSH, 447.0, 447.8, file=file, **asked)
    fine = sb.frequency_response(beam, PUSH, 447.0, 447.8, modes=80, steps=1024, stability=False)
    assert 21 < len(found.reduced.omega) < 40 and found.largest_mode_error <= 3e-3
    assert found.peak("A").amplitude == pytest.approx(fine.peak("A").amplitude, rel=found.largest_mode_error)
    again = sb.frequency_response(beam, PUSH, 447.0, 447.8, file=file, resume=True, **asked)
    np.testing.assert_array_equal(again.point_amplitudes, found.point_amplitudes)
    with pytest.raises(ValueError, match="written with accuracy = 0.003, not 0.01"):
        sb.frequency_response(beam, PUSH, 447.0, 447.8, file=file, resume=True, **{**asked, "accuracy": 1e-2})


def test_bifurcations_are_not_located_where_the_error_is_above():
    """Two masses with a stop: it is between points of the curve, where it has it if none is asked."""
    system, range_of = two_masses(), (0.1085, 0.11)
    curve = sb.frequency_response(system, [0.2], *range_of, steps=512, accuracy=0.1)
    with pytest.warns(sb.AccuracyWarning, match="frequency_response: harmonics 1 to 4 are told to be"):
        blocked = sb.frequency_response(system, [0.2], *range_of, steps=512, accuracy=1e-7)
    assert len(curve.bifurcations) == 1 and blocked.bifurcations == () and not curve.unlocated
    places = blocked.unlocated.split(" are not located: ")[0].removeprefix("bifurcations ").split(", ")
    ends = [sorted(map(float, place.removeprefix("between ").split(" and "))) for place in places]
    for item in curve.bifurcations:
        assert any(low - 1e-6 <= item.own_value <= high + 1e-6 for low, high in ends), (item, ends)
    assert "are not located: harmonics" in repr(blocked)


def test_bifurcations_of_matrices_that_are_gone_on_with(tmp_path):
    """A resumed curve of matrices has the errors and the bifurcations of the run that it goes on with."""
    asked = dict(steps=512, accuracy=0.1, file=str(tmp_path / "curve.journal"))
    first = sb.frequency_response(two_masses(), [0.2], 0.1085, 0.11, **asked)
    again = sb.frequency_response(two_masses(), [0.2], 0.1085, 0.11, resume=True, **asked)
    np.testing.assert_array_equal(again.mode_error, first.mode_error)
    assert [b.own_value for b in again.bifurcations] == [b.own_value for b in first.bifurcations] != []


def test_two_tones(monkeypatch):
    """Lines of each order beside 80 modes, which are 5e-4 from 120 in twice the steps. By default 1e-3,
    and more modes where these are told not to do; where the motion is lost in more, or they have no memory,
    the former one and the reason.
    """
    load = sb.PointForce("A", fy=sb.Harmonic(100.0, 433.0) + sb.Harmonic(60.0, 61.7))
    frequencies, beam = (433.0, 61.7), coarse_beam(0.002)
    found = sb.quasi_periodic(beam, load, frequencies, accuracy=1e-2, stability=False)
    fine = sb.quasi_periodic(beam, load, frequencies, modes=80, steps=512, stability=False)
    sizes = {(m, n): abs(fine.line(m, n, "A")) for m in range(4) for n in range(-3, 4) if (m, n) > (0, 0)}
    least, errors = FAINT * max(sizes.values()), np.zeros(5)
    for (m, n), size in sizes.items():
        if (order := m + abs(n)) < 5:
            off = abs(found.line(m, n, "A") - fine.line(m, n, "A")) / max(size, least)
            errors[order] = max(errors[order], off / order)
    assert 1e-4 < errors.max() <= found.largest_mode_error <= 1e-2, (errors, found.mode_error)
    assert found.reduced.natural < 20 and np.isnan(fine.mode_error).all()
    few = sb.quasi_periodic(beam, load, frequencies, stability=False)
    assert len(few.reduced.omega) < 40 and few.largest_mode_error <= 1e-3
    of_modes = lambda torus, *given: np.array(
        [[0.0 if len(torus.reduced.omega) > 40 else 0.004] * 5, [0.0] * 5]
    )
    monkeypatch.setattr(quasi_periodic, "line_error_estimates", of_modes)
    more = sb.quasi_periodic(beam, load, frequencies, guess=few, stability=False)
    assert 40 < len(more.reduced.omega) < 80
    np.testing.assert_allclose(more.line(1, 1, "A"), fine.line(1, 1, "A"), rtol=1e-4)
    solve = quasi_periodic._TwoTones._solved
    nowhere = (
        r"no motion is found near it in 80 modes and .. vectors and \d+ steps a period of the faster tone"
    )
    for lost, why in (
        (sb.SolveError("it does not converge"), nowhere),
        (ValueError("it takes more memory than is free"), "it takes more memory than is free"),
    ):

        def refused(tones, torus, *given, lost=lost):
            if len(torus.reduced.omega) > 40:
                raise lost
            return solve(tones, torus, *given)

        monkeypatch.setattr(quasi_periodic._TwoTones, "_solved", refused)
        words = rf"lines m f1 \+ n f2 .* beyond .. modes and .+ vectors \({why}\); give a few more than modes"
        with pytest.warns(sb.AccuracyWarning, match=words):
            kept = sb.quasi_periodic(beam, load, frequencies, guess=few, stability=False)
        np.testing.assert_allclose(kept.line(1, 1, "A"), few.line(1, 1, "A"), rtol=1e-3)
    monkeypatch.undo()
    with pytest.warns(sb.AccuracyWarning, match="quasi_periodic: .* give more than modes = 6"):
        sb.quasi_periodic(beam, load, frequencies, modes=6, steps=192, accuracy=1e-3, stability=False)


@pytest.mark.long
def test_as_many_steps_as_by_default_are_not_begun_with_again():
    """Of a curve that begins in 256 steps and needs twice as many, 512: the default."""
    mass = one_mass(1.0, 3e-4, stiffness=0.02)
    first = mass.frequencies[0]
    curve = sb.frequency_response(mass, [9e-4], 0.97 * first, 1.1 * first, accuracy=5e-3, stability=False)
    assert curve.period.steps == 512 and curve.largest_mode_error <= 5e-3


def test_a_tone_that_the_samples_just_resolve():
    """The highest multiple of an even number of samples; errors of lines (0, -n) are those of (0, n)."""
    load = sb.PointForce("A", fy=sb.Harmonic(20.0, 433.0) + sb.Harmonic(60.0, 61.7) + sb.Harmonic(0.1, 493.6))
    asked = dict(modes=12, steps=192, accuracy=0.1, stability=False)
    with pytest.warns(sb.StepWarning):
        found = sb.quasi_periodic(coarse_beam(0.002), load, (433.0, 61.7), samples=16, **asked)
    assert found.mode_error[1] < found.mode_error[2] < 0.1
