"""One small case for all tests of the results, computed once in this process and once on two ranks."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from results_case import build, on_ranks, write_all


@pytest.fixture(scope="session")
def solved():
    """Mesh, model, modes and static cases of the small case."""
    return build()


@pytest.fixture(scope="session")
def serial_files(tmp_path_factory) -> Path:
    """Folder with all files, written by this process."""
    folder = tmp_path_factory.mktemp("serial")
    write_all(str(folder))
    return folder


@pytest.fixture(scope="session")
def parallel_files(tmp_path_factory) -> Path:
    """Folder with all files, written by two ranks."""
    if shutil.which("mpiexec") is None:
        pytest.skip("there is no mpiexec")
    folder = tmp_path_factory.mktemp("parallel")
    done = on_ranks(2, "write", str(folder))
    assert done.returncode == 0, done.stderr
    return folder
