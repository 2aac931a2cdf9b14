"""The command: help, exit codes, reports, exports, pictures, PETSc's options, logs."""

import functools
import html.parser
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree

import h5py
import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from sbfem_petsc.plot import animation
from sbfem_petsc.progress import LogLines
from sbfem_petsc.study import report
from sbfem_petsc.study.case import objects
from sbfem_petsc.study.case.analyses import KINDS
from sbfem_petsc.study.case.case import read_case
from sbfem_petsc.study.revive import read_any
from sbfem_petsc.study.starter import KINDS as KINDS_OF_CASES
from tests.parallel import ROOT, interruptible, on_ranks
from tests.results.test_strangers_files import changed
from tests.study.small_case import CASE, SWEEP, sbfem, started, written

COMMANDS = (
    "new",
    "check",
    "mesh",
    "run",
    "sweep",
    "plot",
    "report",
    "info",
    "export",
    "doctor",
    "completion",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with a case, its results in out/ and its sweep in swept/."""
    folder = tmp_path_factory.mktemp("cli")
    short = CASE.replace("pictures = false", "vtu = true\ncsv = true")
    assert sbfem("run", written(folder, short), "--output", folder / "out", "--quiet").code == 0
    swept = written(folder, CASE + SWEEP, "sweep.toml")
    assert sbfem("sweep", swept, "--output", folder / "swept", "--quiet").code == 0
    return folder


def test_version_and_help():
    done = sbfem("--version")
    assert done.code == 0 and re.fullmatch(r"sbfem-petsc \d+\.\d+\S*\n", done.out)
    done = sbfem("--help")
    assert done.code == 0 and all(command in done.out for command in COMMANDS)
    assert "130" in done.out and "-static_" in done.out
    for command in COMMANDS:
        done = sbfem(command, "--help")
        assert done.code == 0 and f"usage: sbfem {command}" in done.out


@pytest.mark.parametrize(
    "typed, found",
    [
        ("sbfem re", "report"),
        ("sbfem new ", " ".join(KINDS_OF_CASES)),
        ("sbfem sweep --r", "--replace --rows"),
        ("sbfem sweep --rows 0:", ""),  # files are the shell's own
    ],
)
def test_words_are_completed(typed, found):
    """By bash, as it calls the function."""
    words = typed.split(" ")
    quoted = " ".join(f"'{word}'" for word in words)
    program = (
        f"{sbfem('completion').out}\nCOMP_WORDS=({quoted}) COMP_CWORD={len(words) - 1}\n"
        '_sbfem\nprintf %s "${COMPREPLY[*]}"\ncomplete -p sbfem >&2'
    )
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, timeout=300)
    assert (done.stdout, done.stderr) == (found, "complete -o default -F _sbfem sbfem\n")


@pytest.mark.parametrize(
    "arguments, words",
    [
        ((), "required: COMMAND"),
        (("rnu", "case.toml"), "invalid choice: 'rnu'"),
        (("run",), "CASE"),
        (("run", "nowhere.toml"), "nowhere.toml: cannot be read"),
        (("run", "case.toml", "--outptu", "x"), "--outptu"),
        (("run", "case.toml", "-log_view"), "PETSc's stand after --"),
        (("check", "nowhere.toml", "--", "-statik_ksp_type", "cg"), "-statik_ksp_type belongs to no solve"),
        (("check", "nowhere.toml", "--", "cg"), "'cg' belongs to no option"),
        (("new", "bean", "x.toml"), "did you mean 'beam'?"),
        (("info", "nowhere.h5"), "do not exist"),
        (("report", "."), "holds neither results.h5 nor sweep.h5"),
        (("export", "nowhere.h5", "--csv"), "do not exist"),
        (("export", "nowhere.h5"), "give --csv or --vtu"),
        (("plot", "nowhere.h5"), "do not exist"),
    ],
)
def test_wrong_command_lines(arguments, words, tmp_path, monkeypatch):
    """Exit code 2 and a sentence."""
    monkeypatch.chdir(tmp_path)
    done = sbfem(*arguments)
    assert done.code == 2 and words in done.err and done.out == ""


@pytest.mark.slow
def test_check(folder):
    """Sizes are those of the model; estimates are positive and grow with the work."""
    facts = sbfem("check", folder / "case.toml", "--json").answer
    assert facts["extent"] == [0.0, 0.0, 0.1, 0.01]
    summary = json.loads((folder / "out" / "summary.json").read_text())["run"]["model"]
    for name in ("unknowns", "boundary_unknowns", "contact_pairs", "elements"):
        assert facts[name] == summary[name]
    assert facts["memory"] > 1e8 and facts["disk"] > 1e4
    swept = sbfem("check", folder / "sweep.toml", "--json").answer["sweep"]
    assert swept["rows"] == 6 and swept["structures"] == 2 and swept["refused"] == []
    text = sbfem("check", folder / "case.toml").out
    assert "a valid case" in text and f"{facts['unknowns']:,d} with auxiliary ones" in text
    assert sbfem("check", folder / "case.toml", "--quiet").out == ""


@pytest.mark.parametrize(
    "asked, key",
    [
        ('kind = "modal"\ncount = 100_000', "count = 100000 asks for 100,000"),
        (
            'kind = "transient"\nload = "burst"\nduration = 1e-3\nmodes = 99_999',
            "modes = 99999 asks for 99,999",
        ),
        ('kind = "backbone"\nstart = 1.0\nstop = 2.0\nmode = 9_000', "mode = 9000 asks for 27,020"),
    ],
)
def test_check_tells_modes_that_there_are_not(asked, key, tmp_path):
    """As the functions do, which take half of the unknowns on boundaries at most."""
    file = written(tmp_path, f"{CASE}\n[analyses.many]\n{asked}\n")
    done, unknowns = sbfem("check", file), objects.model(read_case(file), MPI.COMM_SELF).boundary_unknowns
    words = f"analyses.many.{key} modes, and there are {unknowns // 2:,d}, half the unknowns on boundaries"
    assert done.code == 2 and words in done.err and done.err.count("\n") == 1


def test_places_outside_are_told_before_a_solve(tmp_path, monkeypatch):
    """By check and by run, which had solved and then failed; the place is named."""
    file = written(
        tmp_path, CASE.replace('load = "push"', 'load = "push"\nstress_at = { far = [0.5, 0.5] }', 1)
    )
    monkeypatch.setattr(sb, "static", None)
    for done in (sbfem("check", file), sbfem("run", file, "--output", tmp_path / "out")):
        assert done.code == 2 and "analyses.push.stress_at.far is refused: the point (0.5, 0.5) m" in done.err


def test_check_draws_the_ends_of_a_sweep(tmp_path):
    """A notch as deep as the beam is high is told before the sweep, by its row in sweep.csv, and why."""
    deep = CASE + SWEEP.replace("[0.002, 0.004]", "[0.004, 0.01, 0.002]")
    said = sbfem("check", written(tmp_path, deep), "--json").answer["sweep"]["refused"]
    assert len(said) == 1 and said[0].startswith(
        "row 3 of the sweep will fail (geometry.notches[0].depth = 0.01,"
    )
    assert "depth" in said[0].split("): ", 1)[1]
    assert said[0] in sbfem("check", tmp_path / "case.toml").out


@pytest.mark.slow
def test_mesh(folder, tmp_path):
    done = sbfem("mesh", folder / "case.toml", "--output", tmp_path / "mesh.png", "--quiet")
    assert done.code == 0 and (tmp_path / "mesh.png").read_bytes().startswith(b"\x89PNG")


def test_mesh_in_a_window_where_there_is_no_display(folder, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":4711")
    done = sbfem("mesh", folder / "case.toml", "--gui", "--quiet")
    assert done.code == 1 and not list(folder.glob("*.png"))
    assert "gmsh's window cannot be opened" in done.err and "have a picture drawn" in done.err


@pytest.mark.slow
def test_info(folder):
    done = sbfem("info", folder / "out")
    assert "frequencies (modal" in done.out and "contact_resultant" in done.out
    assert sbfem("info", folder / "out", "--case").out == (folder / "case.toml").read_text()
    summary = json.loads((folder / "out" / "summary.json").read_text())
    assert sbfem("info", folder / "out" / "results.h5", "--json").answer == summary
    assert sbfem("info", folder / "swept", "--json").answer["rows"] == 6
    assert "A2_A1" in sbfem("info", folder / "swept").out


class Tags(html.parser.HTMLParser):
    """Collects what a page refers to, and checks that its tags are closed."""

    def __init__(self):
        super().__init__()
        self.open, self.sources, self.text = [], [], ""

    def handle_starttag(self, tag, attributes):
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)
        self.sources += [value for key, value in attributes if key in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


@pytest.mark.slow
@pytest.mark.parametrize("results", ["out", pytest.param("swept", marks=pytest.mark.long)])
def test_report(folder, tmp_path, results):
    """One file that refers to nothing outside itself, with numbers and pictures; of no other kind's name."""
    path, own = tmp_path / "report.html", tmp_path / "case.toml"
    own.write_text("mine")
    assert "must end in .html or .htm" in sbfem("report", folder / results, "--output", own).err
    assert own.read_text() == "mine"
    assert sbfem("report", folder / results, "--output", path).code == 0
    page = Tags()
    page.feed(path.read_text())
    assert page.open == []
    assert len(page.sources) >= 5 and all(
        source.startswith("data:image/png;base64,") for source in page.sources
    )
    assert "[geometry]" in page.text
    if results == "out":
        summary = json.loads((folder / "out" / "summary.json").read_text())
        for frequency in summary["frequencies"]["frequencies"]:
            assert f"{frequency:.6g}" in page.text
        pushed = summary["push"]["displacement"]["A"][1]
        assert 0.5e-6 < pushed < 0.5e-3 and f"{1e6 * pushed:.6g} µm" in page.text
        for words in (
            "displacement x, y of A",
            "stress intensity I, II of crack1",
            "reactions x, y of left",
            "√m",
        ):
            assert words in page.text
        assert "10^" not in page.text and "contact_resultant" not in page.text
        return
    swept = read_any(folder / results)
    for name in ("frequencies/frequencies", "frequencies/frequency_shift"):
        for smallest in swept.values[name].min(axis=0)[:3]:
            assert report.number(float(smallest), 5) in page.text
    assert "frequencies: frequency shift, 3" in page.text and "force of push along y" in page.text
    # one picture a quantity: with noise in that without
    assert len(page.sources) == len(
        {name.split("/")[1].removesuffix("_noisy") for name in swept.values if "A1" in name}
    ) + len([name for name in swept.values if name.endswith(("frequency_shift", "contact_resultant"))])


@pytest.mark.long
def test_plot_again(folder, tmp_path, monkeypatch):
    """Pictures drawn from the results are those that the run has drawn; motions are animated if asked for."""
    few = functools.partial(animation.animate_crack, frames=2)
    monkeypatch.setattr(animation, "animate_crack", few)
    assert sbfem("plot", folder / "out", "--output", tmp_path, "--quiet", "--animation").code == 0
    assert {path.name for path in tmp_path.glob("*.gif")} == {"steady_crack1.gif", "burst_crack1.gif"}
    first = {path.name for path in (folder / "out" / "pictures").glob("*.png")}
    assert first == {path.name for path in tmp_path.glob("*.png")} and len(first) >= 6
    assert sbfem("plot", folder / "swept", "--quiet").code == 0
    assert (folder / "swept" / "pictures" / "steady_A2_A1.png").stat().st_size > 5000


@pytest.mark.slow
def test_export(folder, tmp_path):
    done = sbfem("export", folder / "out", "--csv", "--vtu", "--output", tmp_path, "--quiet")
    assert done.code == 0, done.err
    summary = json.loads((folder / "out" / "summary.json").read_text())
    rows = np.genfromtxt(tmp_path / "frequencies.csv", delimiter=",", names=True)
    assert rows["frequencies_Hz"].tolist() == summary["frequencies"]["frequencies"]
    tables = {path.name: path.read_text() for path in (folder / "out" / "tables").iterdir()}  # of the run
    assert tables == {path.name: path.read_text() for path in tmp_path.glob("*.csv")} and len(tables) > 5
    whole = sb.read(folder / "out")  # with what is too long for a summary
    assert whole.facts()["steady"]["harmonics"] == summary["steady"]["harmonics"]
    assert len(whole.value("burst", "velocity", "A")) == len(whole.value("burst", "time"))
    for name in ("frequencies", "push"):
        assert (tmp_path / f"{name}.vtu").read_bytes() == (
            folder / "out/pictures" / f"{name}.vtu"
        ).read_bytes()
    assert sbfem("export", folder / "swept", "--vtu").code == 2
    done = sbfem("export", folder / "swept", "--csv", "--output", tmp_path, "--quiet")
    assert (tmp_path / "sweep.csv").read_text() == (folder / "swept" / "sweep.csv").read_text()


@pytest.mark.slow
def test_results_of_a_case_in_python(folder):
    """By the folder or its file: what summary.json and sweep.csv hold."""
    summary = json.loads((folder / "out" / "summary.json").read_text())
    for path in (folder / "out", folder / "out" / "results.h5"):
        found = sb.read(str(path))
        assert found.value("push", "displacement", "A").tolist() == summary["push"]["displacement"]["A"]
    swept = sb.read(str(folder / "swept"))
    table = np.genfromtxt(folder / "swept" / "sweep.csv", delimiter=",", skip_header=1, usecols=(1, 2, 3))
    assert np.stack([*swept.inputs.values()], axis=1).tolist() == table[:, :2].tolist()
    assert swept.values["frequencies/frequencies"][:, 0].tolist() == table[:, 2].tolist()
    with pytest.raises(ValueError, match="holds neither results.h5 nor sweep.h5"):
        sb.read(str(folder))
    with pytest.raises(ValueError, match=rf"one analysis of a run, .* by sb.read\('{folder / 'out'}'\)"):
        sb.read(str(folder / "out/analyses/push.h5"))


def test_a_case_file_is_no_result(folder):
    done = sbfem("report", folder / "case.toml")
    assert done.code == 2 and "is a case file; name the results" in done.err


def test_broken_results(folder, tmp_path):
    """Truncated files and files of another kind are told apart."""
    whole = (folder / "out" / "results.h5").read_bytes()
    (tmp_path / "results.h5").write_bytes(whole[: len(whole) // 2])
    done = sbfem("info", tmp_path / "results.h5")
    assert done.code == 2 and "truncated" in done.err
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    done = sbfem("info", tmp_path / "other.h5")
    assert done.code == 2 and "another kind" in done.err


def test_texts_of_a_strangers_file_stay_texts(folder, tmp_path):
    """What a file holds does not reach the terminal as control characters, neither as an answer nor in an
    error.
    """

    text = "title = 'a\x1b[8m'\n\tb = 1\n"

    def change(file):
        run = json.loads(file.attrs["run"])
        run["title"] = "\x1b]0;mine\x07 \x9b2J \u202e \r é"
        run["failed"] = {"a\x1b[2J": "no\x00thing"}
        file.attrs["run"] = json.dumps(run)
        del file["case/text"]
        file["case/text"] = np.frombuffer(text.encode(), np.uint8)

    run = shutil.copy(folder / "out" / "results.h5", tmp_path / "run.h5")  # a run's, no record's
    stranger = changed(run, tmp_path / "results.h5", change)
    for options in ((), ("--case",)):
        said = sbfem("info", stranger, *options)
        assert said.code == 0
        assert [c for c in said.out + said.err if not c.isprintable() and c not in "\n\t"] == []
    assert said.out == text.replace("\x1b", r"\x1b")
    assert r"\x1b]0;mine\x07 \x9b2J \u202e \r é" in sbfem("info", stranger).out
    said = sbfem("info", "no\x1b[2Jwhere.h5")
    assert said.code == 2 and r"no\x1b[2Jwhere.h5" in said.err and "\x1b" not in said.err


@pytest.mark.long
@pytest.mark.parametrize("missing", ["petsc4py", "mpi4py"])
def test_package_that_is_missing(missing, tmp_path):
    """One sentence with a remedy, no traceback; `doctor` lists what is there."""
    (tmp_path / f"{missing}.py").write_text(f"raise ModuleNotFoundError('none here', name={missing!r})")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}

    def said(*arguments):
        command = [sys.executable, "-m", "sbfem_petsc", *arguments]
        return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)

    done = said("run", "case.toml")
    assert done.returncode == 1 and done.stdout == "" and "Traceback" not in done.stderr
    assert done.stderr.startswith(f"error: {missing} cannot be imported") and done.stderr.count("\n") == 1
    assert "./run" in done.stderr
    if missing == "petsc4py":
        assert "petsc4py cannot be imported" in said("doctor").stdout


def test_doctor():
    done = sbfem("doctor", "--json")
    found = done.answer
    assert found["packages"]["numpy"] == np.__version__ and "PETSc" in found["libraries"]
    assert found["scalar"] in ("float64", "complex128")
    assert done.code == (1 if found["faults"] else 0)


@pytest.mark.long
def test_petsc_options(tmp_path):
    """Words after -- reach the solves; one that no solve has asked for is told."""
    path = written(
        tmp_path,
        CASE[: CASE.index("[analyses.frequencies]")] + '[analyses.push]\nkind = "static"\nload = "push"\n',
    )
    script = (
        f"from sbfem_petsc.cli import main; main(['run', {str(path)!r}, '--output', "
        f"{str(tmp_path / 'out')!r}, "
        "'--', '-static_ksp_type', 'cg', '-static_ksp_monitir'])"
    )
    done = on_ranks(1, script)
    assert "cg" in json.loads((tmp_path / "out" / "summary.json").read_text())["push"]["solver"]
    assert "static_ksp_monitir" in done.stdout + done.stderr


EARLY = """
import os, signal, sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "sbfem_petsc.cli.parser":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
from sbfem_petsc.cli import main
main(["doctor"])
"""


def test_interrupted_while_modules_are_imported():
    command, told = [sys.executable, "-c", EARLY], subprocess.PIPE
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=told, stderr=told, text=True, preexec_fn=interruptible
    )
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "interrupted\n")


@pytest.mark.long
def test_interrupt_and_termination(tmp_path):
    """SIGINT: 130, SIGTERM: 143, and the sentence that tells how to go on."""
    path = written(
        tmp_path, CASE.replace("duration = 0.003", "duration = 600.0\ndecimation = 1000\nstep = 1e-6")
    )
    for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
        out = tmp_path / f"out{code}"
        process = started("run", path, "--output", out)
        limit = time.monotonic() + 120
        while not list(out.glob("analyses/*.result.journal")) and time.monotonic() < limit:
            time.sleep(0.05)
        process.send_signal(number)
        _, err = process.communicate(timeout=300)
        assert process.returncode == code and "goes on where it was" in err


def test_termination_while_the_command_is_loaded():
    """A sentence, no traceback: the modules of a command take a second, on a loaded machine more."""
    script = """
import os, signal, sys
from sbfem_petsc.cli import main

class Ending:
    def find_spec(self, name, path, target=None):
        if name == "sbfem_petsc.cli.commands":
            os.kill(os.getpid(), signal.SIGTERM)

sys.meta_path.insert(0, Ending())
main(["doctor"])
"""
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 143 and "goes on where it was" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_signal_while_a_weak_reference_is_cleared():
    """What its handler raises there is dropped by Python; the signal is sent again."""
    script = """
import os, signal, time, weakref
from sbfem_petsc.cli.entry import _no_signal_lost

class Thing:
    pass

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background process ignores it otherwise
with _no_signal_lost():
    thing = Thing()
    kept = weakref.ref(thing, lambda _: (os.kill(os.getpid(), signal.SIGINT), time.sleep(0.01)))
    try:
        del thing
        time.sleep(20.0)
    except KeyboardInterrupt:
        print("heard")
"""
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=300, check=True
    )
    assert done.stdout.split() == ["heard"]


@pytest.mark.slow
def test_log_lines():
    """Plain lines: at once for each piece of work, and again within the pause while it lasts."""
    stream, began = io.StringIO(), time.monotonic()
    with LogLines(stream, pause=0.2) as watch:
        watch.stage("long work")
        watch.fraction(0.25)
        while stream.getvalue().count("long work: 25 %,") < 3 and time.monotonic() < began + 60.0:
            time.sleep(0.01)
        watch.say("done")
    most = (time.monotonic() - began) / 0.15
    lines = stream.getvalue().splitlines()
    assert lines[0] == "long work" and lines[-1] == "done"
    assert 3 <= sum(line.startswith("long work: 25 %,") for line in lines) <= most
    assert "\x1b" not in stream.getvalue()


def test_pictures_of_analyses_with_like_names(tmp_path):
    """Those of "push_2" do not stand under "push" too."""
    (tmp_path / "pictures").mkdir()
    for name in ("push_crack1.png", "push_2_crack1.png", "push_2_contact2.png", "push.vtu"):
        (tmp_path / "pictures" / name).write_bytes(b"")
    captions = []
    for names in (("push_", ("push_2_",)), ("push_2_",)):
        body = xml.etree.ElementTree.Element("body")
        report._pictures(body, str(tmp_path), KINDS["static"].captions, *names)
        captions.append([str(picture.get("alt")) for picture in body.iter("img")])
    assert captions == [
        ["deformed region of crack 1"],
        ["contact pressure and gap along crack 2", "deformed region of crack 1"],
    ]
