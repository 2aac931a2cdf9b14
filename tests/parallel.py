"""Run a piece of Python on several ranks in a subprocess."""

import json
import os
import pathlib
import shutil
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[1]


def on_ranks(
    ranks: int, script: str, *arguments: str, check: bool = True, timeout: float = 300
) -> subprocess.CompletedProcess:
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
        "OMP_NUM_THREADS": "1",
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
    }
    done = subprocess.run(
        [mpiexec, "-n", str(ranks), sys.executable, *program, *arguments],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    if check:
        assert done.returncode == 0, done.stdout + done.stderr
    return done


def answer(done: subprocess.CompletedProcess) -> dict:
    """The JSON object on the last line that starts with a brace."""
    return json.loads([line for line in done.stdout.splitlines() if line.startswith("{")][-1])
