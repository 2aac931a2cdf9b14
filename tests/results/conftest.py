"""One small case for all tests of the results, computed once in this process and once on two ranks.

Its module is imported by the fixtures alone: a process that has loaded MPI marks its children's environment,
and the one that starts the test workers must not.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def solved():
    """Mesh, model, modes and static cases of the small case."""
    from tests.results.results_case import build

    return build()


@pytest.fixture(scope="session")
def serial_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with all files, written by this process."""
    from tests.results.results_case import write_all

    folder = tmp_path_factory.mktemp("serial")
    write_all(str(folder))
    return folder


@pytest.fixture(scope="session")
def parallel_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with all files, written by two ranks."""
    if shutil.which("mpiexec") is None:
        pytest.skip("there is no mpiexec")
    from tests.results.results_case import on_ranks

    folder = tmp_path_factory.mktemp("parallel")
    done = on_ranks(2, "write", str(folder))
    assert done.returncode == 0, done.stderr
    return folder
