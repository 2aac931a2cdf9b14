"""Branches, sweeps and histories that are ended from outside: readable afterwards, and continued to the same
numbers.
"""

import os
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.study import rows
from sbfem_petsc.study.sweep_file import read_sweep
from tests.parallel import ROOT, on_ranks
from tests.study.small_case import CASE, SWEEP, sbfem, started, written

SIGNALS = [signal.SIGKILL, signal.SIGTERM, signal.SIGINT]

# Follows a branch, or integrates a history, slowly; each rank says who it is. Ends with the last value.
PROGRAM = """
import os, sys, time, warnings
import sbfem_petsc as sb
from meshing import Beam, VNotch
from mpi4py import MPI
kind, file, pause = sys.argv[1], sys.argv[2], float(sys.argv[3])
warnings.simplefilter("ignore")
mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.001)]).mesh(order=1, face_edges=2)
model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), damping=0.02)
def tell(done):
    print(f"rank {MPI.COMM_WORLD.rank} is {os.getpid()} at {done}", flush=True)
    time.sleep(pause)
if kind == "branch":
    push = sb.PointForce("A", fy=10.0)
    found = sb.frequency_response(model, push, 700.0, 800.0, modes=4, steps=64, points=40, stability=False,
                                  file=file, resume=True, progress=tell)
    print(f"last {found.amplitude('A')[-1]!r} {len(found.value)}", flush=True)
else:
    from sbfem_petsc.dynamics import reduced_history, unreduced_history
    reduced_history.CHUNK = unreduced_history.CHUNK = 8
    push = sb.PointForce("A", fy=sb.Harmonic(10.0, 700.0))
    found = sb.transient(model, push, 2e-3, 1e-5, modes=4, reduction="modes" if kind == "history" else None,
                         file=file, restart=True, progress=tell)
    print(f"last {found.displacement('A')[-1].tolist()!r} {len(found.time)}", flush=True)
"""


def begun(ranks, *arguments):
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    if ranks > 1:
        command = ["mpiexec", "-n", str(ranks), *command]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    return subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def last(output: str) -> set[str]:
    return {line for line in output.splitlines() if line.startswith("last")}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The last lines of runs that nobody ends, by kind and ranks."""
    folder, found = tmp_path_factory.mktemp("undisturbed"), {}

    def make(kind, ranks):
        if (kind, ranks) not in found:
            file = str(folder / f"{kind}{ranks}.h5")
            found[kind, ranks] = last(on_ranks(ranks, PROGRAM, kind, file, "0").stdout)
        return found[kind, ranks]

    return make


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["branch", "history", "unreduced"])
@pytest.mark.parametrize(
    "ranks, number", [(1, SIGNALS[0]), (1, SIGNALS[1]), (1, SIGNALS[2]), (2, SIGNALS[0])]
)
def test_ended_and_continued(kind, ranks, number, undisturbed, tmp_path):
    """On two ranks one of them is killed: both end. What is on disk is read, and the run goes on to the same
    numbers.
    """
    file = tmp_path / "run.h5"
    process = begun(ranks, kind, file, 0.05)
    victim, told = process.pid, 0
    while told < 4 * ranks:
        words = process.stdout.readline().split()
        assert words, process.stderr.read()
        told += words[:1] == ["rank"]
        if ranks > 1 and words[:2] == ["rank", "1"]:
            victim = int(words[3])
    os.kill(victim, number)
    process.communicate(timeout=60)
    assert process.returncode != 0
    read = sb.read_branch if kind == "branch" else sb.read_history
    with pytest.warns(sb.IncompleteHistory) if kind != "branch" else pytest.MonkeyPatch.context():
        part = read(file)
    assert not part.complete
    assert last(on_ranks(ranks, PROGRAM, kind, str(file), "0").stdout) == undisturbed(kind, ranks)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_sweep_ended_and_resumed(number, tmp_path):
    """One line, no traceback, and the rows so far are not computed again."""
    path, out = written(tmp_path, CASE + SWEEP), tmp_path / "out"
    process = started("sweep", path, "--output", out, "--quiet")
    limit = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < limit:
        if (out / "rows").is_dir() and rows.count(str(out / "rows")) >= 2:
            break
        time.sleep(0.01)
    process.send_signal(number)
    errors = process.communicate(timeout=60)[1]
    assert process.returncode not in (0, 1) and "goes on where it was" in errors and "Traceback" not in errors
    before = rows.read(str(out / "rows"))
    assert sbfem("sweep", path, "--output", out, "--quiet").code == 0
    again = read_sweep(out)
    assert len(again.seconds) == 6
    for name, row in before.items():
        assert again.seconds[name] == row.seconds


@pytest.mark.slow
@pytest.mark.parametrize("size", [0, 700, 3000])
def test_sweep_on_a_full_disk(size, tmp_path):
    """No file can grow beyond some bytes: one sentence; with room again the sweep is completed."""
    path, out = written(tmp_path, CASE + SWEEP), tmp_path / "out"

    def full():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    command = [sys.executable, "-m", "sbfem_petsc", "sweep", str(path), "--output", str(out), "--quiet"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, preexec_fn=full, timeout=300)
    assert done.returncode != 0
    assert "Traceback" not in done.stderr and "error:" in done.stderr
    assert sbfem("sweep", path, "--output", out, "--quiet").code == 0
    assert np.isfinite(read_sweep(out).values["frequencies/frequencies"]).all()
