"""Run a piece of Python on several ranks in a subprocess."""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import pathlib
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping

import pytest

ROOT = pathlib.Path(__file__).parents[1]


@contextlib.contextmanager
def all_cores() -> Iterator[None]:
    """One program on several ranks at a time, whatever the number of test workers: ranks that wait for one
    another take the cores from each other.
    """
    name = f"sbfem-petsc-tests-{os.getuid()}.lock"
    with open(os.path.join(tempfile.gettempdir(), name), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def on_ranks(
    ranks: int, script: str | os.PathLike[str], *arguments: str, check: bool = True, timeout: float = 300
) -> subprocess.CompletedProcess[str]:
    """Run `script`, a file or a program's text, on `ranks` ranks with the project importable; a missing
    mpiexec skips the test.
    """
    mpiexec = shutil.which("mpiexec")
    if mpiexec is None:
        pytest.skip("there is no mpiexec")
    program = [str(script)] if str(script).endswith(".py") else ["-c", script]
    # more ranks than cores: allowed, and a waiting rank leaves its core to the others
    environment = {
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "OMPI_MCA_btl": "^tcp",  # Open MPI 5 complains of machines without a network where it tries
        "OMP_NUM_THREADS": "1",
        **os.environ,
    }
    with all_cores() if ranks > 1 else contextlib.nullcontext():
        done = whole([mpiexec, "-n", str(ranks), sys.executable, *program, *arguments], environment, timeout)
    if check:
        assert done.returncode == 0, done.stdout + done.stderr
    return done


def in_session(
    command: list[str], environment: Mapping[str, str] = os.environ, *, preexec_fn: Callable | None = None
) -> subprocess.Popen[str]:
    """Start a command, with the project importable, that leads a session of its own, by which `kill_all`
    finds what it has started.
    """
    places = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        command,
        cwd=ROOT,
        env={**environment, "PYTHONPATH": places},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=preexec_fn,
    )


def whole(
    command: list[str], environment: dict[str, str], timeout: float
) -> subprocess.CompletedProcess[str]:
    """Run a command in a session of its own; after `timeout` seconds all of it is killed and the test
    fails with what it has written until then.
    """
    process = in_session(command, environment)
    try:
        output, errors = process.communicate(timeout=timeout)
    except BaseException as error:  # also when the test itself is interrupted
        kill_all(process)
        output, errors = process.communicate()
        if not isinstance(error, subprocess.TimeoutExpired):
            raise
        pytest.fail(f"not ended after {timeout:g} s: {shlex.join(command)}\n{output}\n{errors}")
    return subprocess.CompletedProcess(command, process.returncode, output, errors)


def interruptible() -> None:
    """For a child before it starts: Ctrl-C's signal reaches it. Shells start what runs in the background
    with this signal ignored, and children inherit that.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def wait_for_a_signal() -> None:
    """Sleep until a signal ends it, in small pieces: Python sees one that comes just before a sleep only
    after it.
    """
    end = time.monotonic() + 600.0
    while time.monotonic() < end:
        time.sleep(0.05)


def kill_all(process: subprocess.Popen[str]) -> None:
    """Kill a process that leads a session and all in it; mpiexec gives each rank a process group of its
    own.
    """
    found = [int(name) for name in os.listdir("/proc") if name.isdigit()] if os.path.isdir("/proc") else []
    for number in [*found, process.pid]:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if number == process.pid or os.getsid(number) == process.pid:
                os.kill(number, signal.SIGKILL)


def answer(done: subprocess.CompletedProcess[str]) -> dict:
    """The JSON object on the last line that has one, whatever ranks write around it: the end of another one's
    line may come after it, as may what resets the colours, if colorama is installed, where a rank ends.
    """
    lines = done.stdout.replace("\033[0m", "").splitlines()
    line = [line for line in lines if "{" in line][-1]
    found, _ = json.JSONDecoder().raw_decode(line, line.index("{"))
    return found


def alone(program: str, *arguments: str) -> dict:
    """The answer of a program on one rank, this process."""
    given, sys.argv = sys.argv, ["-c", *arguments]
    try:
        with contextlib.redirect_stdout(io.StringIO()) as said:
            exec(program, {"__name__": "alone"})
    finally:
        sys.argv = given
    return answer(subprocess.CompletedProcess([], 0, said.getvalue(), ""))
