"""Runs into a folder: numbers of the Python interface, resuming, failures, exit codes, ranks."""

import functools
import inspect
import json
import os
import pickle
import re
import shutil
import signal
import time

import h5py
import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from meshing import Beam, VNotch
from meshing.folder_index import INDEX
from sbfem_petsc.record.files import opened
from sbfem_petsc.record.found import Found
from sbfem_petsc.study import revive, run
from sbfem_petsc.study.case.case import case_from_text, read_case
from sbfem_petsc.study.case.problems import CaseError
from sbfem_petsc.study.folder import hold_folder
from sbfem_petsc.study.revive import read_any
from sbfem_petsc.study.run import run_case
from sbfem_petsc.study.starter import write_starter
from sbfem_petsc.study.structure import Structure
from tests.parallel import on_ranks
from tests.results.same import inverted
from tests.study.small_case import CASE, COMMANDS, sbfem, started, written

# Where the dearer analyses of the case begin.
STEADY, BURST = (CASE.index(f"[analyses.{name}]") for name in ("steady", "burst"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with the case and its results in out/."""
    folder = tmp_path_factory.mktemp("run")
    done = sbfem("run", written(folder), "--output", folder / "out", "--quiet")
    assert done.code == 0, done.err
    return folder


@pytest.fixture(scope="module")
def summary(folder):
    return json.loads((folder / "out" / "summary.json").read_text())


@pytest.fixture(scope="module")
def model():
    beam = Beam(length=0.1, height=0.01, notches=[VNotch(x=0.05, depth=0.004, opening=0.005)])
    return sb.Model(
        beam.mesh(order=3),
        sb.Material(young=70e9, poisson=0.33, density=2700),
        clamped="left",
        damping=0.01,
        comm=MPI.COMM_SELF,
    )


FORCE = sb.PointForce("A", fy=200.0)


@pytest.mark.slow
def test_modal_and_static(summary, model):
    """The numbers of the Python interface, to its rank-to-rank tolerances."""
    np.testing.assert_allclose(
        summary["frequencies"]["frequencies"], sb.modal(model, count=5).frequencies, rtol=1e-7
    )
    push = sb.static(model, FORCE)
    for point in ("A", "B", "C"):
        np.testing.assert_allclose(
            summary["push"]["displacement"][point], push.displacement(point), rtol=1e-6
        )
    assert summary["push"]["contact_resultant"] == pytest.approx(push.contact_resultant, rel=1e-6)
    np.testing.assert_allclose(
        summary["push"]["stress_intensity"]["crack1"], push.stress_intensity["crack1"], rtol=1e-6
    )


def test_periodic(summary, model):
    orbit = sb.periodic(model, FORCE, 400.0, modes=12, steps=256)
    harmonics = summary["steady"]["harmonics"]["A"]
    found = (np.array(harmonics["magnitude"]) * np.exp(1j * np.array(harmonics["phase"])))[:, 1]
    exact = orbit.harmonics("A")[: len(found)]
    assert len(found) >= 21
    # 1e-6: the project's tolerance between ranks for histories
    np.testing.assert_allclose(found, exact, atol=1e-6 * np.abs(exact).max())
    assert summary["steady"]["stable"] is orbit.stable is True and summary["steady"]["converged"] is True
    assert orbit.contact_resultant.max() > 0.0  # the crack breathes


def test_transient(summary, model, folder):
    load = sb.PointForce("A", fy=sb.ToneBurst(100.0, 2000.0, 4))
    history = sb.transient(model, load, duration=0.003, modes=12)
    found = np.array(summary["burst"]["displacement"]["A"])
    assert found.shape == history.displacement("A").shape
    scale = np.abs(history.displacement("A")).max()
    np.testing.assert_allclose(found, history.displacement("A"), atol=1e-6 * scale)
    results = read_any(folder / "out")
    np.testing.assert_allclose(
        results.value("burst", "velocity", "A"),
        history.velocity("A"),
        atol=1e-6 * np.abs(history.velocity("A")).max(),
    )


def test_results_file(folder):
    """Units stand beside the numbers, and the case can be run again from the file."""
    results = read_any(folder / "out")
    assert case_from_text(results.text).key == read_case(folder / "case.toml").key
    with h5py.File(folder / "out" / "results.h5") as file:
        data = file["analyses/frequencies/frequencies"]
        assert data.attrs["units"] == b"Hz" and data.attrs["long_name"]
    assert results.kinds == {
        "frequencies": "modal",
        "push": "static",
        "steady": "periodic",
        "burst": "transient",
    }


def test_xarray_opens_the_results(folder):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("netCDF4")
    results = read_any(folder / "out")
    with xarray.open_datatree(folder / "out" / "results.h5") as tree:
        frequencies = tree["analyses/frequencies/frequencies"]
        np.testing.assert_array_equal(frequencies, results.value("frequencies", "frequencies"))
        assert frequencies.dims == ("mode",) and frequencies.attrs["units"] == "Hz"
        moved = tree["analyses/burst/displacement"].sel(place="A")
        np.testing.assert_array_equal(moved, results.value("burst", "displacement", "A"))
        assert moved.dims == ("time", "xy")
        np.testing.assert_array_equal(moved["time"], results.value("burst", "time"))


@pytest.mark.long
@pytest.mark.parametrize(("name", "every"), [("results.h5", 15013), ("analyses/push.h5", 61)])
def test_changed_bytes_of_results_are_told(folder, tmp_path, name, every):
    """A byte that is inverted is told of, or changes nothing of what is read."""

    def read(path):
        if name == "results.h5":
            found = read_any(path)
            return [pickle.dumps(item) for item in (found.text, found.run, found.kinds, found.analyses)]
        with opened(path) as file:
            return [pickle.dumps(Found.read(file))]

    path = shutil.copy(folder / "out" / name, tmp_path / "copy.h5")
    told, _, silent = inverted(path, read, every)
    assert silent == [] and told > 0


def test_nothing_is_repeated(folder, monkeypatch):
    """A second run solves nothing and leaves the numbers as they are."""
    before = (folder / "out" / "summary.json").read_text()
    monkeypatch.setattr(Structure, "__init__", lambda *a: pytest.fail("a model was made"))
    done = sbfem("run", folder / "case.toml", "--output", folder / "out")
    assert done.code == 0 and "frequencies: finished before" in done.err
    first, second = json.loads(before), json.loads((folder / "out" / "summary.json").read_text())
    assert {k: v for k, v in first.items() if k != "run"} == {k: v for k, v in second.items() if k != "run"}


def test_a_damaged_part_is_told_with_its_remedy(folder, tmp_path, monkeypatch):
    """Before anything is solved: what is left to solve waits until the part is removed."""
    out = shutil.copytree(folder / "out", tmp_path / "out")
    monkeypatch.setattr(Structure, "__init__", lambda *a: pytest.fail("a model was made"))
    (out / "analyses/frequencies.h5").unlink()
    part = out / "analyses/push.h5"
    part.write_bytes(part.read_bytes()[:-1000])
    done = sbfem("run", folder / "case.toml", "--output", out)
    assert done.code == 2 and "remove this file to have push computed again" in done.err


@pytest.mark.long
def test_another_case_is_refused(folder, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(folder / "out", out)
    other = written(tmp_path, CASE.replace("count = 5", "count = 3"))
    done = sbfem("run", other, "--output", out)
    assert done.code == 2 and "another case" in done.err and "--replace" in done.err
    assert json.loads((out / "summary.json").read_text())["frequencies"]["frequencies"][4] > 0
    state = json.loads((out / "run.json").read_text())
    for change, told in (
        ({"schema": 5}, "the schema 5, of version"),
        ({"version": "0.0"}, "of version 0.0, and this program writes"),
    ):
        (out / "run.json").write_text(json.dumps(state | change))
        done = sbfem("run", other, "--output", out)
        assert done.code == 2 and told in done.err and "--replace to compute it again" in done.err
    done = sbfem("run", other, "--output", out, "--replace", "--quiet")
    assert done.code == 0
    assert len(json.loads((out / "summary.json").read_text())["frequencies"]["frequencies"]) == 3


def test_changed_bytes_of_a_state_are_told(tmp_path):
    """Of what a folder holds."""
    text = CASE[: CASE.index("[analyses.frequencies]")] + CASE[CASE.index("[analyses.push]") : STEADY]
    case = case_from_text(text, str(tmp_path / "case.toml"))
    assert not run_case(case, tmp_path)["run"]["failed"]
    path, told = tmp_path / "run.json", 0
    data = path.read_bytes()
    for place in range(len(data)):
        changed = bytearray(data)
        changed[place] ^= 1  # stays a text
        path.write_bytes(changed)
        try:
            hold_folder(str(tmp_path), case, "run").close()
        except ValueError as error:
            told += str(tmp_path) in str(error)
        else:
            assert json.loads(changed) == json.loads(data), place
    assert told > 0.9 * len(data)


@pytest.mark.slow
def test_interrupted_and_resumed(tmp_path, monkeypatch):
    """Ctrl-C in the third analysis: exit code 130; the next run solves the third and fourth alone. The file
    of all results is put together once a run, whatever it has come to.
    """
    path, solve, solved, made = written(tmp_path), Structure.solve, [], []
    new = run.new_results
    monkeypatch.setattr(run, "new_results", lambda *given: made.append(given[1]) or new(*given))

    def stopped(self, case, name, **options):
        if name == "steady" and not solved.count("steady"):
            solved.append(name)
            raise KeyboardInterrupt
        solved.append(name)
        return solve(self, case, name, **options)

    monkeypatch.setattr(Structure, "solve", stopped)
    done = sbfem("run", path, "--output", tmp_path / "out", "--quiet")
    assert done.code == 130 and "goes on where it was" in done.err
    partial = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert set(partial) == {"run", "frequencies", "push"} and not partial["run"]["complete"]
    assert made == ["analysis", "analysis", "run"] and set(read_any(tmp_path / "out").kinds) < set(partial)
    assert sbfem("run", path, "--output", tmp_path / "out", "--quiet").code == 0
    assert made[3:] == ["analysis", "analysis", "run"]
    assert solved == ["frequencies", "push", "steady", "steady", "burst"]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["run"]["complete"]


@pytest.mark.long
def test_killed_and_resumed(folder, summary, tmp_path):
    """kill -9 after the first analysis: nothing is lost, and the numbers are those of an undisturbed run."""
    path, out = written(tmp_path), tmp_path / "out"
    process = started("run", path, "--output", out, "--quiet")
    first, limit = out / "analyses" / "push.h5", time.monotonic() + 120
    while not first.exists() and process.poll() is None and time.monotonic() < limit:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert (out / "analyses" / "frequencies.h5").is_file() and not (out / "results.h5").exists()
    with pytest.raises(ValueError, match="a run that has not come to its end; call  sbfem run CASE"):
        read_any(out)
    stamp = os.stat(out / "analyses" / "frequencies.h5").st_mtime_ns
    left, foreign = out / ".run.json.1a_b2c3d.part", out / ".mine.part"  # a killed run's, the user's
    left.mkdir()
    (left / "run.json").touch()
    foreign.touch()
    refused = sbfem("run", path, "--output", out, "--quiet")
    assert refused.code == 2 and "'.mine.part'" in refused.err and foreign.exists() and left.exists()
    foreign.unlink()
    assert sbfem("run", path, "--output", out, "--quiet").code == 0
    assert not left.exists()
    assert os.stat(out / "analyses" / "frequencies.h5").st_mtime_ns == stamp
    found = json.loads((out / "summary.json").read_text())
    one, two = (np.array(s["steady"]["harmonics"]["A"]["magnitude"])[:3, 1] for s in (summary, found))
    np.testing.assert_allclose(two, one, rtol=1e-6)
    assert not [name for name in os.listdir(out) if name.startswith((".results", ".summary", ".run"))]


@pytest.mark.slow
def test_failed_analysis(tmp_path, monkeypatch):
    """A solve that fails: exit code 1, its reason is kept, the others are finished; it is tried again."""
    path, solve = written(tmp_path, CASE.replace(CASE[STEADY:BURST], "")), Structure.solve

    def failing(self, case, name, **options):
        if name == "push":
            raise sb.SolveError("static: no luck")
        return solve(self, case, name, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Structure, "solve", failing)
        done = sbfem("run", path, "--output", tmp_path / "out", "--quiet", "--json")
    assert done.code == 1 and "push: static: no luck" in done.err
    assert done.answer["run"]["failed"] == {"push": "static: no luck"}
    assert "push" not in done.answer and "burst" in done.answer
    assert sbfem("run", path, "--output", tmp_path / "out", "--quiet").code == 0


@pytest.mark.slow
def test_wrong_input_of_an_analysis(tmp_path):
    """What the analysis itself refuses: exit code 2, with the line of its table."""
    path = written(tmp_path, CASE[:STEADY].replace("count = 5", "count = 5000"))
    done = sbfem("run", path, "--output", tmp_path / "out", "--quiet")
    line = CASE.splitlines().index("count = 5") + 1
    assert (
        done.code == 2 and f"case.toml, line {line}: analyses.frequencies" in done.err and "5000" in done.err
    )


def test_two_runs_at_once(folder):
    """A folder in which another process is at work is left alone."""
    import fcntl

    with open(folder / "out" / INDEX, "r+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = sbfem("run", folder / "case.toml", "--output", folder / "out")
    assert done.code == 2 and "another process is at work" in done.err


@pytest.mark.long
def test_two_ranks(summary, tmp_path):
    """One rank's numbers, to the tolerances between ranks."""
    path = written(tmp_path, CASE[: CASE.index("[analyses.burst]")])
    words = ["run", str(path), "--output", str(tmp_path / "out")]
    script = f"from sbfem_petsc.cli import main; main({words!r})"
    done = on_ranks(2, script)
    assert done.stderr.count("[1/3] frequencies (modal)") == 1
    found = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert found["run"]["ranks"] == 2
    np.testing.assert_allclose(
        found["frequencies"]["frequencies"], summary["frequencies"]["frequencies"], rtol=1e-7
    )
    np.testing.assert_allclose(
        found["push"]["displacement"]["A"], summary["push"]["displacement"]["A"], rtol=1e-6
    )
    one, two = (np.array(s["steady"]["harmonics"]["A"]["magnitude"]) for s in (summary, found))
    np.testing.assert_allclose(two, one, atol=1e-6 * one.max())


@pytest.mark.long
def test_wrong_cases_on_two_ranks(tmp_path):
    """One sentence each, exit code 2; also of what its model alone tells."""
    commands, told = [], []
    for command, old, new, words in (
        ("run", "order = 3", "ordre = 3", "did you mean 'order'?"),
        ("check", "count = 5", "count = 5000", "count = 5000 asks for 5,000 modes, and there are"),
        ("check", "duration = 0.003", "duration = 0.003\nstep = 1e-12", "3e+09 steps of 1e-12 s"),
    ):
        path = written(tmp_path, CASE.replace(old, new), f"{len(told)}.toml")
        commands.append([command, str(path)])
        told.append(words)
    done = on_ranks(2, COMMANDS, json.dumps(commands), check=False)
    assert done.returncode == 2
    assert [done.stderr.count(words) for words in told] == [1, 1, 1]


def test_from_python(folder):
    """`run_case` gives the summary too."""
    summary = run_case(folder / "case.toml", folder / "out", comm=MPI.COMM_SELF)
    assert not summary["run"]["failed"] and summary["push"]["kind"] == "static"


FURTHER = """
[loads.probe]
kind = "point_force"
point = "A"
fy = 10.0

[loads.slow]
kind = "point_force"
point = "A"
fy = { kind = "harmonic", amplitude = 100.0, frequency = 1.0 }

[analyses.tones]
kind = "quasi_periodic"
probe = "probe"
probe_frequency = 6000.0
pump = "push"
pump_frequency = 565.6854
order = 2
samples = 7
steps = 128
modes = 8

[analyses.slow]
kind = "load_history"
load = "slow"
times = { start = 0.0, stop = 1.0, count = 5 }

[analyses.stress]
kind = "static"
load = "push"
stress_at = { inside = [0.03, 0.009], end = "C" }
"""


@pytest.mark.long
def test_further_analyses(tmp_path, model):
    """Two tones, slow loads and stresses at places, against the Python interface."""
    text = CASE[: CASE.index("[analyses.frequencies]")] + FURTHER + '[output]\npoints = ["A"]\n'
    done = sbfem("run", written(tmp_path, text), "--output", tmp_path / "out", "--quiet", "--json")
    assert done.code == 0, done.err
    found = done.answer
    load = sb.PointForce("A", fy=sb.Harmonic(10.0, 6000.0) + sb.Harmonic(200.0, 565.6854))
    tones = sb.quasi_periodic(model, load, (6000.0, 565.6854), samples=7, steps=128, modes=8)
    listed = found["tones"]["lines"]["A"]
    assert found["tones"]["line"][0] == [0, 0] and len(found["tones"]["line"]) == 13
    for k, (m, n) in enumerate(found["tones"]["line"]):
        line = listed["magnitude"][k] * np.exp(1j * listed["phase"][k])
        # 1e-6: the project's tolerance for histories, of the largest line
        assert abs(line - tones.line(m, n, "A")) < 1e-6 * max(listed["magnitude"])
        assert found["tones"]["frequency"][k] == pytest.approx(m * 6000.0 + n * 565.6854, abs=1e-9)
    assert found["tones"]["frequency"] == sorted(found["tones"]["frequency"])
    assert found["tones"]["modulation_index"]["A"] == pytest.approx(tones.modulation_index("A"), rel=1e-6)
    assert found["tones"]["stable"] is tones.stable is True and found["tones"]["contact_peak"] > 0.0
    slow = sb.load_history(model, sb.PointForce("A", fy=sb.Harmonic(100.0, 1.0)), np.linspace(0.0, 1.0, 5))
    np.testing.assert_allclose(
        found["slow"]["displacement"]["A"],
        slow.displacement("A"),
        atol=1e-6 * np.abs(slow.displacement("A")).max(),
    )
    np.testing.assert_allclose(
        found["slow"]["stress_intensity"]["crack1"],
        slow.stress_intensity("crack1"),
        atol=1e-6 * np.abs(slow.stress_intensity("crack1")).max(),
    )
    push = sb.static(model, FORCE)
    for name, place in (("inside", (0.03, 0.009)), ("end", "C")):
        stress = push.stress(place)
        np.testing.assert_allclose(
            found["stress"]["stress"][name], stress, atol=1e-6 * np.abs(push.stress((0.03, 0.009))).max()
        )
    names = {path.name for path in (tmp_path / "out" / "pictures").iterdir()}
    assert {"tones_lines.png", "slow_history.png"} <= names
    assert sbfem("report", tmp_path / "out").code == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert "1 probe -1 pump" in page and 'alt="lines of the spectrum"' in page


@pytest.mark.slow
def test_accuracy(model):
    """Finer meshes until two agree: the frequencies of `modal` with an accuracy, and its error."""
    text = CASE.replace("count = 5", "count = 2\naccuracy = 1e-3")
    rows = sb.sweep(
        case_from_text(text), {"loads.push.fy": [200.0]}, analyses=["frequencies"], comm=MPI.COMM_SELF
    ).values
    found = sb.modal(model, 2, accuracy=1e-3)
    np.testing.assert_allclose(rows["frequencies/frequencies"][0], found.frequencies, rtol=1e-7)
    assert rows["frequencies/estimated_error"][0] == pytest.approx(found.estimate.error, rel=1e-3)
    assert 0.0 < found.estimate.error <= 1e-3
    found.model.destroy()


def test_rows_of_further_analyses(model):
    """What a sweep keeps of them."""
    text = CASE[: CASE.index("[analyses.frequencies]")] + FURTHER
    rows = sb.sweep(case_from_text(text), {"loads.push.fy": [200.0]}, comm=MPI.COMM_SELF).values
    push = sb.static(model, FORCE)
    np.testing.assert_allclose(rows["stress/stress/inside"][0], push.stress((0.03, 0.009)), rtol=1e-6)
    lines, named = rows["tones/lines/A"][0], rows["tones/frequency"][0]
    carrier = np.abs(lines[np.isclose(named, 6000.0)])[0]
    sidebands = sum(np.abs(lines[np.isclose(named, 6000.0 + s * 565.6854)])[0] for s in (1, -1))
    assert rows["tones/carrier_amplitude/A"][0] == pytest.approx(carrier, rel=1e-12)
    assert rows["tones/modulation_index/A"][0] == pytest.approx(sidebands / carrier, rel=1e-9)
    assert rows["tones/stable"][0] == 1.0 and rows["slow/closed_states"][0] == 1.0


BRANCHES = """
[analyses.over_frequency]
kind = "frequency_response"
load = "push"
start = 700.0
stop = 760.0
modes = 8
steps = 128
points = 60

[analyses.linear]
kind = "frequency_response"
load = "push"
start = 700.0
stop = 900.0
contact = false
modes = 8

[analyses.over_load]
kind = "load_response"
load = "push"
frequency = 400.0
start = 0.5
modes = 8
steps = 128

[analyses.free]
kind = "backbone"
mode = 1
start = 1e-4
stop = 3e-4
points = 20
refine = false

[analyses.map]
kind = "locus"
load = "push"
factor = 5.0
start = 5150.0
stop = 5165.0
least = 0.9
most = 1.1
points = 1
steps = 128
modes = 8

[analyses.own]
kind = "quasi_periodic_response"
load = "push"
factor = 5.0
start = 5150.0
stop = 5165.0
end = 5158.0
order = 2
samples = 7
points = 3
steps = 128
modes = 8
stability = false

[analyses.attraction]
kind = "basins"
load = "push"
frequency = 700.0
starts = [
    { values = { start = -1e-6, stop = 1e-6, count = 2 }, point = "A" },
    { values = [0.0, 1e-3], kind = "impulse" },
]
steps = 128
modes = 2

[analyses.slow]
kind = "swept_response"
load = "push"
start = 740.0
stop = 800.0
duration = 0.2
steps = 128
modes = 8
"""


@pytest.mark.slow
def test_a_locus_without_bifurcations_says_so(tmp_path):
    """In the run's words, its summary and its report."""
    text = (
        CASE[: CASE.index("[analyses.frequencies]")]
        + """
[analyses.map]
kind = "locus"
load = "push"
start = 300.0
stop = 310.0
bifurcations = ["fold", "grazing"]
steps = 64
modes = 4
"""
    )
    done = sbfem("run", written(tmp_path, text), "--output", tmp_path / "out")
    sentence = "no fold or grazing that can be followed was found on the curve from 300 to 310 Hz"
    assert done.code == 0 and f"map: {sentence}" in done.out + done.err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["map"]["reason"] == sentence and summary["map"]["count"] == 0
    assert sbfem("report", tmp_path / "out", "--quiet").code == 0
    assert sentence in (tmp_path / "out" / "report.html").read_text()


def test_keys_of_a_backbone(monkeypatch):
    """All options of `backbone` are keys of the case file and reach it; tongues are followed if asked for."""
    text = '[analyses.bone]\nkind = "backbone"\nmode = 1\nstart = 1e-6\nstop = 1e-3\ninteractions = true\n'
    case = case_from_text(CASE + text)
    options, given = inspect.signature(sb.backbone).parameters, {}
    told = functools.wraps(sb.backbone)(lambda model, **options: given.update(options))
    monkeypatch.setattr(sb, "backbone", told)
    case.tables.analyses["bone"].solve(case, None, progress="auto")
    assert set(given) == set(options) - {"model"}
    assert [given.pop(name) for name in ("mode", "start", "stop", "interactions")] == [1, 1e-6, 1e-3, True]
    assert all(value == options[name].default for name, value in given.items())


@pytest.mark.parametrize("kind", ["frequency_response", "load_response"])
def test_curves_of_the_unreduced_model(kind):
    """What it has not is told before anything is solved, of a curve's options as of a steady state's."""
    between = "start = 700.0\nstop = 900.0" if kind == "frequency_response" else "frequency = 400.0"
    text = f'{CASE}\n[analyses.over]\nkind = "{kind}"\nload = "push"\n{between}\nreduced = false\n'
    for option in ("accuracy = 0.001", "stability = true"):
        sentence = f"over.{option} is for the reduced model; leave out reduced = false or {option.split()[0]}"
        with pytest.raises(CaseError, match=sentence):
            case_from_text(f"{text}{option}\n")


def test_a_band_without_modes(tmp_path):
    """It is a result as any, without pictures and fields."""
    none = '[analyses.none]\nkind = "modal"\nband = [1.0, 2.0]\n[output]\nvtu = true\ncsv = true\n'
    path = written(tmp_path, CASE[: CASE.index("[analyses.")] + none)
    done = sbfem("run", path, "--output", tmp_path / "out", "--quiet", "--json")
    assert done.code == 0 and done.answer["none"]["frequencies"] == []
    assert sbfem("export", tmp_path / "out", "--vtu", "--csv", "--quiet").code == 0
    assert sbfem("report", tmp_path / "out", "--quiet").code == 0
    assert not list(tmp_path.rglob("*.vtu")) and not list(tmp_path.rglob("*.png"))


@pytest.mark.long
def test_a_steady_state_of_the_unreduced_model():
    """It has no multipliers, and is not asked for them unless the case does."""
    text = CASE.replace("damping = 0.01", "damping = 0.01\nrayleigh = [0.0, 1e-6]")
    text = text.replace("steps = 256", "steps = 64\nreduced = false")
    case = case_from_text(text)
    found = Structure(case, MPI.COMM_SELF).solve(case, "steady")
    assert found.reduced is None and not len(found.multipliers) and len(found.time) == 65
    with pytest.raises(CaseError, match="steady.stability = true is for the reduced model"):
        case_from_text(text.replace("reduced = false", "reduced = false\nstability = true"))


@pytest.mark.long
def test_branches(tmp_path):
    """Curves over frequency and load, the linear response, a backbone and a line of Neimark-Sacker points,
    against the Python interface.
    """
    text = CASE[: CASE.index("[analyses.frequencies]")] + BRANCHES + '[output]\npoints = ["A"]\n'
    done = sbfem("run", written(tmp_path, text), "--output", tmp_path / "out", "--quiet", "--json")
    assert done.code == 0, done.err
    found = done.answer
    beam = Beam(length=0.1, height=0.01, notches=[VNotch(x=0.05, depth=0.004, opening=0.005)])
    material = sb.Material(young=70e9, poisson=0.33, density=2700)
    model = sb.Model(beam.mesh(order=3), material, clamped="left", damping=0.01, comm=MPI.COMM_SELF)
    linear = sb.frequency_response(model, FORCE, 700.0, 900.0, contact=False, modes=8)
    assert found["linear"]["peak_frequency"]["A"] == pytest.approx(linear.peak("A").frequency, rel=1e-6)
    assert found["linear"]["bandwidth"]["A"] == pytest.approx(linear.peak("A").bandwidth, rel=1e-4)
    curve = sb.load_response(model, FORCE, 400.0, start=0.5, stop=1.0, modes=8, steps=128)
    assert found["over_load"]["value"] == pytest.approx(curve.value, rel=1e-6)
    np.testing.assert_allclose(found["over_load"]["amplitude"]["A"], curve.amplitude("A"), rtol=1e-6)
    assert found["over_load"]["stable"] == curve.stable.tolist()
    assert len(found["over_frequency"]["frequency"]) == len(found["over_frequency"]["amplitude"]["A"])
    assert found["over_frequency"]["complete"] and found["free"]["complete"]
    energies = np.array(found["free"]["energy"])
    assert energies[0] == pytest.approx(1e-4, rel=1e-6) and energies[-1] == pytest.approx(3e-4, rel=1e-6)
    (line,) = found["map"]["loci"]
    assert line["kind"] == "Neimark-Sacker" and len(line["frequency"]) == 3
    np.testing.assert_allclose(line["multiplier"]["magnitude"], 1.0, atol=1e-5)
    load = sb.PointForce("A", fy=1000.0 * line["value"][0])
    orbit = sb.periodic(model, load, line["frequency"][0], modes=8, steps=128)
    assert abs(orbit.multipliers[0]) == pytest.approx(1.0, abs=1e-5)
    down = sb.swept_response(model, FORCE, 800.0, 740.0, duration=0.2, steps=128, modes=8)
    np.testing.assert_allclose(found["slow"]["down"]["frequency"], down.frequency, rtol=1e-12)
    np.testing.assert_allclose(found["slow"]["down"]["amplitude"]["A"], down.amplitude("A"), rtol=1e-6)
    assert len(found["slow"]["up"]["frequency"]) == 154
    assert found["slow"]["down"]["jump"]["A"] == [jump.frequency for jump in down.jumps("A")]
    basins = found["attraction"]
    steady = sb.periodic(model, FORCE, 700.0, steps=128, modes=2)
    assert basins["orbit_reached"] == 4 * [0] and basins["share"] == [1.0]
    assert basins["orbits"][0]["amplitude"]["A"] == pytest.approx(steady.amplitude("A"), rel=1e-6)
    own, load = found["own"], sb.PointForce("A", fy=1000.0)
    around = sb.frequency_response(model, load, 5150.0, 5165.0, modes=8, steps=128)
    point = next(item for item in around.bifurcations if item.kind == "Neimark-Sacker")
    first = sb.switch_branch(around, point, samples=7)
    assert own["value"][0] == pytest.approx(first.frequencies[0], rel=1e-7)
    assert own["own_frequency"][0] == pytest.approx(first.frequencies[1], rel=1e-4)
    assert len(own["value"]) <= 3 and len(own["lines"]["A"]["magnitude"][0]) == len(own["line_tones"])
    # results are read from their own files for other pictures
    for name, kind in (("own", sb.QuasiPeriodicBranch), ("free", sb.Backbone), ("attraction", sb.Basins)):
        ending = "journal" if name == "free" else "h5"
        assert isinstance(sb.read(tmp_path / "out" / "analyses" / f"{name}.result.{ending}"), kind)
    drawn = {path.name for path in (tmp_path / "out" / "pictures").iterdir()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(revive, "Structure", None)  # nothing is computed again
        done = sbfem("plot", tmp_path / "out", "--output", tmp_path / "again", "--quiet")
    assert done.code == 0, done.err
    names = {path.name for path in (tmp_path / "again").iterdir()}
    assert names == drawn | {".sbfem-index"}
    assert {
        "attraction_basins.png",
        "own_own_tones.png",
        "map_loci.png",
        "slow_swept.png",
        "over_frequency_curve.png",
        "over_load_curve.png",
        "linear_curve.png",
        "free_backbone.png",
    } <= names
    model.destroy()


@pytest.mark.long
def test_a_held_point_and_no_notes(tmp_path):
    """A point that does not move has no picture of harmonics, the next one has; tips of a sharp crack, whose
    K_I and K_II need no words, leave the tables whole.
    """
    kept = CASE.split("[analyses.frequencies]")[0].replace("opening = 0.005", "opening = 0")
    steady = "[analyses.steady]" + CASE.split("[analyses.steady]")[1].split("[analyses.burst]")[0]
    text = kept.replace("[material]", "[points]\nheld = [0.0, 0.005]\n\n[material]") + steady
    path = written(tmp_path, text + '[output]\npoints = ["held", "A"]\ncsv = true\n')
    done = sbfem("run", path, "--output", tmp_path / "out", "--quiet")
    assert done.code == 0, done.err
    names = {file.name for file in (tmp_path / "out" / "pictures").iterdir()}
    assert {"steady_harmonics.png", "steady_orbit.png"} <= names
    assert (tmp_path / "out" / "tables" / "steady.csv").stat().st_size > 1000


def test_files_that_files_name_decide(tmp_path):
    """What a script of gmsh includes or merges, whose names stand in quotes, is of the case."""
    write_starter("gmsh", str(tmp_path / "case.toml"))
    script = tmp_path / "part.geo"
    script.write_text(re.sub("^lc = .*$", 'Include "sizes.geo";', script.read_text(), flags=re.M))
    keys = []
    for length in (0.012, 0.006):
        (tmp_path / "sizes.geo").write_text('Include "more.geo";\n')
        (tmp_path / "more.geo").write_text(f'lc = {length};  // "sizes.geo" "/etc/passwd" "none" ".."\n')
        keys.append(read_case(tmp_path / "case.toml").key)
    assert keys[0] != keys[1] == read_case(tmp_path / "case.toml").key
