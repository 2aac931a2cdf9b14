"""Branches, sweeps and histories that are ended from outside: readable afterwards, and continued to the same
numbers.
"""

import json
import os
import pickle
import re
import resource
import shutil
import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from meshing.warnings import IncompleteHistory
from sbfem_petsc.study import rows
from sbfem_petsc.study.revive import read_any
from sbfem_petsc.study.run import RunResults
from sbfem_petsc.study.sweep_file import Sweep
from tests import kills
from tests.parallel import ROOT, answer, in_session, interruptible, kill_all, on_ranks
from tests.study.small_case import CASE, COMMANDS, SWEEP, sbfem, stopped_sweep, written

# Follows a branch, or integrates a history, slowly; each rank says who it is. Ends with the last value.
PROGRAM = """
import json, os, sys, warnings
import sbfem_petsc as sb
from meshing import Beam, VNotch
from mpi4py import MPI
from tests.parallel import wait_for_a_signal
kind, file, wait = sys.argv[1], sys.argv[2], sys.argv[3] == "wait"
warnings.simplefilter("ignore")
mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.001)]).mesh(order=1, face_edges=2)
model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), damping=0.02)
told = 0
def tell(done):
    "After four of them, where there is a signal to come, wait for it."
    global told
    told += 1
    sys.stdout.write(f"rank {MPI.COMM_WORLD.rank} is {os.getpid()} at {done}\\n")
    sys.stdout.flush()
    if wait and told >= 4:
        wait_for_a_signal()
if kind == "branch":
    push = sb.PointForce("A", fy=10.0)
    found = sb.frequency_response(model, push, 700.0, 800.0, modes=4, steps=64, points=40, stability=False,
                                  file=file, resume=True, progress=tell)
    last = [found.amplitude("A")[-1], len(found.value)]
else:
    from sbfem_petsc.motion import reduced_history
    from sbfem_petsc.motion.unreduced import history as unreduced_history
    reduced_history.CHUNK = unreduced_history.CHUNK = 8
    push = sb.PointForce("A", fy=sb.Harmonic(10.0, 700.0))
    found = sb.transient(model, push, 2e-3, 1e-5, modes=4, reduction="modes" if kind == "history" else None,
                         file=file, resume=True, progress=tell)
    last = [*found.displacement("A")[-1], len(found.time)]
found = MPI.COMM_WORLD.gather(list(map(float, last)))
if MPI.COMM_WORLD.rank == 0:
    print("\\n" + json.dumps({"last": found}), flush=True)
"""


def begun(ranks, *arguments):
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    if ranks > 1:
        command = ["mpiexec", "-n", str(ranks), *command]
    return in_session(command, preexec_fn=interruptible)


def full(size):
    """For a child: no file can grow beyond so many bytes, as on a full disk. It must not write bytecode:
    Python takes what is cut there for whole, in programs that begin later, too.
    """

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return limit


def last(done):
    """The numbers of the last line, the same on all ranks to rounding."""
    found = np.array(answer(done)["last"])
    np.testing.assert_allclose(found, found[[0] * len(found)], rtol=1e-9)
    return found[0]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The last lines of runs that nobody ends, by kind and ranks."""
    folder, found = tmp_path_factory.mktemp("undisturbed"), {}

    def make(kind, ranks):
        if (kind, ranks) not in found:
            file = str(folder / f"{kind}{ranks}.h5")
            found[kind, ranks] = last(on_ranks(ranks, PROGRAM, kind, file, "go"))
        return found[kind, ranks]

    return make


# Each kind, each signal and both numbers of ranks.
ENDS = [
    ("branch", 1, signal.SIGKILL),
    ("branch", 2, signal.SIGTERM),
    ("history", 1, signal.SIGINT),
    ("unreduced", 2, signal.SIGKILL),
]


@pytest.mark.long
@pytest.mark.parametrize("kind, ranks, number", ENDS)
def test_ended_and_continued(kind, ranks, number, undisturbed, tmp_path):
    """On two ranks one of them gets the signal: both end. What is on disk is read, and the run goes on to the
    same numbers.
    """
    file = tmp_path / "run.h5"
    process = begun(ranks, kind, file, "wait")
    victim, told = process.pid, 0
    try:
        while told < 4 * ranks:
            words = process.stdout.readline().replace("\033[0m", "").split()
            assert words, process.stderr.read()
            told += words[:1] == ["rank"]
            if ranks > 1 and words[:2] == ["rank", "1"]:
                victim = int(words[3])
        os.kill(victim, number)
        process.communicate(timeout=300)
    finally:
        kill_all(process)
    assert process.returncode != 0
    with pytest.warns(sb.IncompleteHistory) if kind != "branch" else pytest.MonkeyPatch.context():
        part = sb.read(file)
    assert not part.complete
    continued = last(on_ranks(ranks, PROGRAM, kind, str(file), "go"))
    # in one process bit by bit
    np.testing.assert_allclose(continued, undisturbed(kind, ranks), rtol=0.0 if ranks == 1 else 1e-9)


SCARCE = """
import sys
from mpi4py import MPI
from sbfem_petsc.cli import main
from sbfem_petsc.system.solve import assembly
whole = assembly.row_lengths
def scarce(*arguments):
    if MPI.COMM_WORLD.rank == 1:
        raise MemoryError
    return whole(*arguments)
assembly.row_lengths = scarce
sys.exit(main(["run", sys.argv[1], "--output", sys.argv[2], "--quiet"]))
"""


@pytest.mark.long
def test_memory_that_one_rank_lacks(tmp_path):
    """The other one, which waits for it in an assembly, ends too."""
    done = on_ranks(2, SCARCE, str(written(tmp_path, CASE)), str(tmp_path / "out"), check=False, timeout=300)
    assert done.returncode != 0 and "not enough memory" in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_sweep_ended_and_resumed(number, tmp_path):
    """One line, no traceback, and the rows so far are not computed again."""
    path, out = written(tmp_path, CASE + SWEEP), tmp_path / "out"
    code, errors = stopped_sweep(number, path, out)
    assert code == 128 + number and "goes on where it was" in errors and "Traceback" not in errors
    before = rows.read(str(out / "rows"))
    assert len(before) == 2
    assert sbfem("sweep", path, "--output", out, "--quiet").code == 0
    again = read_any(out)
    assert len(again.seconds) == 6
    for name, row in before.items():
        assert again.seconds[name] == row.seconds


@pytest.mark.long
@pytest.mark.parametrize("size", [0, 3000])
def test_sweep_on_a_full_disk(size, tmp_path):
    """No file can grow beyond some bytes: one sentence; with room again the sweep is completed."""
    path, out = written(tmp_path, CASE + SWEEP), tmp_path / "out"
    command = [sys.executable, "-B", "-m", "sbfem_petsc", "sweep", str(path), "--output", str(out), "--quiet"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, preexec_fn=full(size), timeout=300
    )
    assert done.returncode != 0
    assert (
        "Traceback" not in done.stderr
        and "error:" in done.stderr
        and (str(out) in done.stderr or "TMPDIR" in done.stderr)
    )
    assert sbfem("sweep", path, "--output", out, "--quiet").code == 0
    assert np.isfinite(read_any(out).values["frequencies/frequencies"]).all()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A finished history, branch, sweep and run: a file of each, and what reads it."""
    folder = tmp_path_factory.mktemp("files")
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.001)]).mesh(order=1, face_edges=2)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), damping=0.02)
    push = sb.PointForce("A", fy=10.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        burst = sb.PointForce("A", fy=sb.Harmonic(10.0, 700.0))
        sb.transient(model, burst, 2e-3, 1e-5, modes=4, file=folder / "h.h5")
        sb.frequency_response(
            model, push, 700.0, 710.0, modes=4, steps=64, points=6, stability=False, file=folder / "b.h5"
        )
    small = written(folder, kills.case(kills.SWEEP), "small.toml")
    assert sbfem("sweep", small, "--output", folder / "sweep", "--quiet").code == 0
    path = written(folder, CASE)
    assert sbfem("run", path, "--output", folder / "run", "--quiet").code == 0
    return {
        "history": (folder / "h.h5", sb.read),
        "branch": (folder / "b.h5", sb.read),
        "sweep": (folder / "sweep" / "sweep.h5", read_any),
        "run": (folder / "run" / "results.h5", read_any),
    }


def said(read, path, whole):
    """The sentence with which a file is refused or told to be incomplete; "the same" for a history whose
    states are those of the whole file bit for bit, and for a run or sweep of which all is.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", IncompleteHistory)
        try:
            found = read(path)
        except (ValueError, IncompleteHistory) as sentence:
            return str(sentence)
    if isinstance(found, (Sweep, RunResults)):
        same = pickle.dumps(found) == pickle.dumps(whole)
    else:
        same = isinstance(found, sb.History) and np.array_equal(found.states.q, whole.states.q)
    return "the same" if same else "nothing"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["history", "branch", "sweep", "run"])
def test_flipped_bits_and_cut_ends(kind, files, tmp_path):
    """Whatever bit has changed, and wherever the end is missing: a sentence."""
    path, read = files[kind]
    data, copy, generator = path.read_bytes(), tmp_path / path.name, np.random.default_rng(1)
    copy.write_bytes(data)
    if kind in ("history", "branch"):
        shutil.copy(f"{path}.state", f"{copy}.state")
    whole = read(copy)
    for place in generator.integers(len(data), size=20):
        changed = bytearray(data)
        changed[place] ^= 1 << int(generator.integers(8))
        copy.write_bytes(changed)
        sentence = said(read, copy, whole)
        assert re.search("damaged|no HDF5|checksum|the same", sentence)
    for length in generator.integers(len(data), size=5):
        copy.write_bytes(data[:length])
        with pytest.raises(ValueError, match="truncated|damaged|lost its checksum"):
            read(copy)


@pytest.mark.long
@pytest.mark.parametrize("kind, share", [("run", 0.5), ("sweep", 0.5)])
def test_report_on_a_full_disk(kind, share, files, tmp_path):
    """One sentence with exit code 2, and the former report as it was; with room again a whole one."""
    page = tmp_path / "report.html"
    arguments = ["report", str(files[kind][0]), "--output", str(page)]
    assert sbfem(*arguments).code == 0
    before = page.read_bytes()
    command = [sys.executable, "-B", "-m", "sbfem_petsc", *arguments]
    limit = full(int(share * len(before)))
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, preexec_fn=limit, timeout=300)
    assert done.returncode == 2 and done.stderr.count("error:") == 1 and "Traceback" not in done.stderr
    assert "cannot be written: File too large" in done.stderr and str(page) in done.stderr
    assert page.read_bytes() == before and os.listdir(tmp_path) == [page.name]
    assert sbfem(*arguments).code == 0 and page.read_bytes().endswith(b"</html>\n")


# Ends itself where the whole page has been written under another name, but has not its own yet.
ENDED = """
import os, sys
from meshing import whole_file
from sbfem_petsc.cli import main
whole_file.synchronise = lambda path: os.kill(os.getpid(), int(sys.argv[1]))
main(["report", *sys.argv[2:]])
"""


@pytest.mark.long
@pytest.mark.parametrize(
    "ranks, number, former",
    [
        (1, signal.SIGKILL, "a former one"),
        pytest.param(2, signal.SIGKILL, "", marks=pytest.mark.long),
        pytest.param(2, signal.SIGTERM, "a former one", marks=pytest.mark.long),
    ],
)
def test_report_ended(ranks, number, former, files, tmp_path):
    """The former report stays, or none is there; the next one is whole."""
    page = tmp_path / "report.html"
    if former:
        page.write_text(former)
    end = (str(int(number)), str(files["run"][0]), "--output", str(page))
    done = on_ranks(ranks, ENDED, *end, check=False)
    assert done.returncode != 0 and "Traceback" not in done.stderr
    assert page.read_text() == former if former else not page.exists()
    assert sbfem("report", files["run"][0], "--output", page).code == 0
    assert page.read_text().endswith("</html>\n")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc, where not even root can write")
@pytest.mark.parametrize("command", ["run", "sweep", "report", "export"])
def test_folder_that_takes_no_files(command, files, tmp_path):
    """One sentence, no traceback."""
    source = written(tmp_path, CASE + SWEEP) if command in ("run", "sweep") else files["run"][0]
    formats = ["--csv"] if command == "export" else []
    done = sbfem(command, source, *formats, "--output", "/proc/out")
    assert done.code == 2 and done.err.count("error:") == 1 and "/proc" in done.err


@pytest.mark.long
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc, where not even root can write")
def test_folders_that_take_no_files_on_two_ranks(files, tmp_path):
    """Both ranks end with one sentence, also below what is a file and no folder."""
    case, results = str(written(tmp_path, CASE + SWEEP)), str(files["run"][0])
    (tmp_path / "file").write_text("")
    wheres = ("/proc/out", str(tmp_path / "file/out"), "/proc/report", str(tmp_path / "file/export"))
    commands = (["run", case], ["sweep", case], ["report", results], ["export", results, "--csv"])
    given = [[*command, "--output", where] for command, where in zip(commands, wheres)]
    done = on_ranks(2, COMMANDS, json.dumps(given), check=False, timeout=300)
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    said = [line for line in done.stderr.splitlines() if "error:" in line]
    assert len(said) == 4 and all(where in line for where, line in zip(wheres, said)), done.stderr
    assert (tmp_path / "file").read_text() == "" and not os.path.exists("/proc/out")
