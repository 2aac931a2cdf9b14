"""Branches in files: what is read is what was found, interrupted runs are continued, and foreign files are
refused.
"""

import csv
import os
import shutil
import warnings
from dataclasses import replace

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from meshing.warnings import BranchWarning, IncompleteBranch
from sbfem_petsc.contact.law import Tied, Unilateral
from sbfem_petsc.continuation import follow as following
from sbfem_petsc.motion.files import run_file as module
from tests.results.same import compared, inverted
from tests.systems import same_products, two_masses

TURN = 2 * np.pi
START, STOP = 0.5 / TURN, 0.9 / TURN


def test_contact_laws_are_kept(tmp_path):
    """A tied row stays tied in the file, and a branch of it is another model's."""
    systems = {
        name: sb.reduce_matrices(
            np.eye(2),
            np.array([[1.0, -1.0], [-1.0, 2.0]]),
            np.array([[1.0, 0.0]]),
            np.array([1.0]),
            loads=np.array([[0.0], [1.0]]),
            sensors={"1": 0, "2": 1},
            damping=0.03,
            compliance=np.array([0.01]),
            contact_laws=law,
        )
        for name, law in (("free", Unilateral()), ("tied", Tied()))
    }
    path = str(tmp_path / "tied.h5")
    run = {"start": 0.1, "stop": 0.11, "steps": 256, "points": 50, "file": path}
    branch = sb.frequency_response(systems["tied"], [0.1], **run)
    found = sb.read(path)
    assert found.reduced.contact_laws.fixed.all() and branch.contact_peak.max() > 0.0
    same_products(found.orbit(2).displacement("2"), branch.orbit(2).displacement("2"))
    with pytest.raises(ValueError, match="another model .its (contact laws|initial gaps) differ"):
        sb.frequency_response(systems["free"], [0.1], **run, resume=True)


def follow(**options):
    return sb.frequency_response(two_masses(), [0.1], START, STOP, **{"steps": 512, **options})


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = str(tmp_path_factory.mktemp("curves") / "whole.h5")
    return follow(file=path), path


def same(found, expected):
    """Everything that is kept of two curves."""
    compared(found, expected)


@pytest.mark.long
def test_what_is_read_is_what_was_found(whole):
    curve, path = whole
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = sb.read(path)
    same(found, curve)
    assert found.complete and len(found.bifurcations) >= 5 and repr(found) == repr(curve)
    np.testing.assert_array_equal(found.stable, curve.stable)
    np.testing.assert_array_equal(found.harmonics("2"), curve.harmonics("2"))
    same(found.peak("2"), curve.peak("2"))
    # orbits come back from their states
    for k in (2, 30, -3):
        same_products(found.orbit(k).displacement("2"), curve.orbit(k).displacement("2"))


@pytest.mark.slow
def test_the_file_explains_itself(whole, tmp_path):
    curve, path = whole
    assert sorted(os.listdir(os.path.dirname(path))) == ["whole.h5", "whole.h5.state"]
    sb.save(tmp_path / "curve.h5", curve)
    same(sb.read(tmp_path / "curve.h5"), curve)
    with h5py.File(tmp_path / "curve.h5") as file:
        place = list(file["place"][:]).index(b"2")
        np.testing.assert_array_equal(file["amplitude"][:, place], curve.amplitude("2"))
        assert file["amplitude"].attrs["units"] == b"m" and file["frequency"].attrs["units"] == b"Hz"


def test_save_and_read_a_load_curve(tmp_path):
    curve = sb.load_response(two_masses(), [0.1], 0.1, stop=0.2, steps=512, stability=False)
    path = str(tmp_path / "load.h5")
    sb.save(path, curve)
    found = sb.read(path)
    same(found, curve)
    assert (
        found.parameter == "load"
        and found.fixed_frequency == 0.1
        and found.multipliers.shape == (len(curve.value), 0)
    )


@pytest.mark.long
@pytest.mark.parametrize("after", [17, 60])
def test_an_interrupted_curve_is_continued(whole, tmp_path, monkeypatch, after):
    """Ctrl-C after some points, on every part of the branch: the file is readable and marked, and the
    continued curve has the same points to 1e-8.
    """
    monkeypatch.setattr(module, "PAUSE", 0.0)
    curve, _ = whole
    path = str(tmp_path / "curve.h5")
    count = [0]

    def interrupt(fraction):
        count[0] += 1
        if count[0] == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        follow(file=path, progress=interrupt)
    with pytest.warns(IncompleteBranch, match="is incomplete: it ends at .*; resume=True continues it"):
        part = sb.read(path)
    assert not part.complete and len(part.value) == after + 1
    # the whole curve has further points where it bends, added at the end
    beside = np.searchsorted(np.cumsum(np.isin(curve.value, part.value)), np.arange(1, after + 2))
    np.testing.assert_array_equal(part.states, curve.states[beside])
    np.testing.assert_array_equal(part.multipliers, curve.multipliers[beside])
    resumed = follow(file=path, resume=True)
    assert resumed.complete and len(resumed.value) == len(curve.value)
    np.testing.assert_allclose(resumed.value, curve.value, rtol=1e-8)
    assert np.abs(resumed.states - curve.states).max() < 1e-7 * np.abs(curve.states).max()
    np.testing.assert_array_equal(resumed.stable, curve.stable)
    assert [b.kind for b in resumed.bifurcations] == [b.kind for b in curve.bifurcations]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        same(sb.read(path), resumed)


def test_a_reader_lacks_the_last_seconds_of_a_curve(tmp_path):
    """And is told so; a run that goes on has them."""
    path, count = str(tmp_path / "curve.h5"), [0]

    def interrupt(fraction):
        count[0] += 1
        if count[0] == 9:
            raise KeyboardInterrupt

    def follow(**options):
        return sb.frequency_response(two_masses(), 1.0, 0.1, 0.2, stability=False, file=path, **options)

    def read():
        with pytest.warns(IncompleteBranch, match="continues it, from points of .* that are not here"):
            return len(sb.read(path).value)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(module, "PAUSE", 1e9)  # all of it is in one pause
        follow(progress=interrupt)
    assert read() < 9
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BranchWarning)
        assert len(follow(resume=True, points=2).value) > 9


@pytest.mark.slow
def test_a_complete_curve_is_not_traced_again(whole, monkeypatch):
    curve, path = whole

    def no(*arguments, **options):
        raise AssertionError("a point was sought")

    monkeypatch.setattr(following, "correct", no)
    before = open(path, "rb").read()
    resumed = follow(file=path, resume=True, stability=False)
    np.testing.assert_array_equal(resumed.value, curve.value)
    # it keeps its reason, and the file its multipliers
    assert resumed.reason == curve.reason == sb.read(path).reason and open(path, "rb").read() == before


def test_resume_without_a_file_begins(tmp_path):
    path = str(tmp_path / "new.h5")
    assert len(follow(file=path, resume=True, points=5, stability=False).value) == 5
    with pytest.warns(IncompleteBranch, match="it was given 5 points; resume=True with more of them"):
        assert len(sb.read(path).value) == 5
    # more points are allowed: it goes on
    assert len(follow(file=path, resume=True, points=9, stability=False).value) == 9
    # without resume the file is replaced
    follow(file=path, points=3, stability=False)
    with pytest.warns(IncompleteBranch):
        assert len(sb.read(path).value) == 3


@pytest.mark.slow
def test_a_curve_that_has_ended_is_not_said_to_go_on(whole, tmp_path):
    """One that left its range where it came in: resuming it would find nothing further."""
    curve, _ = whole
    path = str(tmp_path / "ended.h5")
    sb.save(path, replace(curve, complete=False, reason=f"end of the range at {START:.8g}"))
    with pytest.warns(IncompleteBranch, match="its run has ended: end of the range at 0.0795") as caught:
        sb.read(path)
    assert "resume" not in str(caught[0].message)


@pytest.mark.long
def test_a_failed_curve_keeps_its_points(tmp_path, monkeypatch):
    """What Newton's method could not go on from is in the file, marked, and is continued when it can."""
    whole = following.correct

    def fails(problem, u, *rest):
        if u[-1] > 0.65 / TURN:
            raise sb.SolveError("no")
        return whole(problem, u, *rest)

    path = str(tmp_path / "failed.h5")
    with monkeypatch.context() as patch:
        patch.setattr(following, "correct", fails)
        with pytest.raises(sb.SolveError, match="the curve stops at") as caught:
            follow(file=path, stability=False)
    with pytest.warns(IncompleteBranch):
        part = sb.read(path)
    np.testing.assert_array_equal(part.value, caught.value.branch.value)
    assert "no further point" in part.reason
    assert follow(file=path, resume=True, stability=False).complete


@pytest.mark.slow
@pytest.mark.parametrize(
    "change, sentence",
    [
        ({"steps": 1024}, "was written with steps = 512, not 1024"),
        ({"stop": 0.1}, "was written with stop"),
        ({"start": 0.081}, "was written with start"),
        ({"load": [0.2]}, "was written for other loads"),
        ({"model": two_masses(damping=0.02)}, "another model .*damping"),
        ({"model": two_masses(compliance=0.02)}, "another model .*compliance"),
        ({"model": two_masses(force=2.0)}, "another model .*load"),
    ],
)
def test_another_run_is_not_continued(whole, change, sentence):
    _, path = whole
    given = {"model": two_masses(), "load": [0.1], "start": START, "stop": STOP, "steps": 512, **change}
    before = open(path, "rb").read()
    with pytest.raises(ValueError, match=sentence):
        sb.frequency_response(
            given["model"],
            given["load"],
            given["start"],
            given["stop"],
            steps=given["steps"],
            file=path,
            resume=True,
        )
    assert open(path, "rb").read() == before


@pytest.mark.slow
def test_a_load_curve_does_not_continue_a_frequency_curve(whole):
    _, path = whole
    with pytest.raises(ValueError, match="was written with parameter = frequency, not load"):
        sb.load_response(two_masses(), [0.1], 0.1, steps=512, file=path, resume=True)


@pytest.mark.slow
def test_files_that_are_no_curves(tmp_path, whole):
    _, path = whole
    with pytest.raises(ValueError, match="does not exist"):
        sb.read(str(tmp_path / "none.h5"))
    text = tmp_path / "text.h5"
    text.write_text("not a curve")
    with pytest.raises(ValueError, match="truncated, damaged or no HDF5 file"):
        sb.read(str(text))
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file.attrs["format"] = "something"
    with pytest.raises(ValueError, match="HDF5 file of another kind"):
        sb.read(str(other))
    data, cut = open(path, "rb").read(), tmp_path / "cut.h5"
    shutil.copy(f"{path}.state", f"{cut}.state")
    for length in (len(data) // 3, len(data) - 100):
        cut.write_bytes(data[:length])
        with pytest.raises(ValueError, match="is damaged: .* are left|its beginning is missing"):
            sb.read(str(cut))


def test_a_folder_that_does_not_exist(tmp_path):
    """Found before the first point is sought."""
    with pytest.raises(ValueError, match="cannot be written"):
        follow(file=str(tmp_path / "nowhere" / "curve.h5"))


def test_a_full_disk(tmp_path, monkeypatch):
    """The run ends with a sentence; what was written before stays readable and no half file is left."""
    path = str(tmp_path / "full.h5")
    follow(file=path, points=4, stability=False)

    def refuse(*arguments, **options):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", refuse)
        with pytest.raises(sb.SolveError, match="cannot be written any more .No space left.*stays readable"):
            follow(file=path, points=9, resume=True, stability=False)
    with pytest.warns(IncompleteBranch):
        assert len(sb.read(path).value) == 4
    assert sorted(os.listdir(tmp_path)) == ["full.h5", "full.h5.state"]


def test_two_writers(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PAUSE", 0.0)
    path, tried = str(tmp_path / "branch.h5"), []

    def second(fraction):
        if not tried:
            tried.append(True)
            with pytest.raises(ValueError, match="is being written by another run"):
                follow(file=path, points=5, stability=False)

    with pytest.warns(sb.BranchWarning):
        follow(file=path, points=5, stability=False, progress=second)
    assert tried and sorted(os.listdir(tmp_path)) == ["branch.h5", "branch.h5.state"]


@pytest.mark.long
@pytest.mark.parametrize("ending", ["", ".state"])
def test_changed_bytes_are_told(whole, ending, tmp_path):
    """Every 61st byte that is inverted is told of."""
    path = str(tmp_path / "branch.h5")
    for end in ("", ".state"):
        shutil.copy(f"{whole[1]}{end}", f"{path}{end}")
    told, without, silent = inverted(f"{path}{ending}", lambda _: sb.read(path), every=61)
    assert told > 500 and (without, silent) == (0, [])


@pytest.mark.slow
def test_as_a_table(whole, tmp_path):
    branch, _ = whole
    path = tmp_path / "branch.csv"
    branch.to_csv(path)
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:3] == ["value [Hz]", "frequency [Hz]", "stable"]
    for name, values in (
        ("value [Hz]", branch.value),
        ("amplitude_2 [m]", branch.amplitude("2")),
        ("harmonic_2_2 [m]", np.abs(branch.harmonics("2")[:, 2])),
    ):
        np.testing.assert_array_equal([float(row[name]) for row in rows], values)
    with pytest.raises(ValueError, match="table .* cannot be written: No such file"):
        branch.to_csv(tmp_path / "none" / "branch.csv")
