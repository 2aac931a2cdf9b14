"""Workers that run side by side: one thread and one cache of compiled functions each."""

from __future__ import annotations

import gc
import os
import pathlib
import signal
import sys

import pytest

import sbfem_petsc  # noqa: F401  names the kernels of OpenBLAS before NumPy loads it, as ./run does

ROOT = pathlib.Path(__file__).parents[1]

# Before anything loads a BLAS: small dense blocks, and more than one process at work.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# Hundreds of programs are started: each compiles all modules again where none may stand beside the sources,
# and pytest all tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Nothing is thrown away while tests are found, and what has been found stays to the end.
gc.disable()

# Tests raise interrupts, which a shell lets those that it starts in the background ignore.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# A process without a launcher needs no daemon of Open MPI's, which would outlive it where it is killed.
os.environ.setdefault("OMPI_MCA_ess_singleton_isolated", "1")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """One more than there are cores where all tests are run: programs on several ranks wait for one another,
    for files and for their end. None: what xdist takes.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    return cores + 1 if cores > 1 and config.args_source == pytest.Config.ArgsSource.TESTPATHS else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is long is slow too: `-m "not slow"` on the command line replaces the default `not long`. Files
    with programs on several ranks, which wait for one another (tests/parallel.py), come first and so to one
    worker; of these the ones with the longest limits of time, before other workers take some over.
    """
    limits: dict[pathlib.Path, float] = {}
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.slow)
        own = item.get_closest_marker("timeout")
        limits[item.path] = max(limits.get(item.path, 0.0), own.args[0] if own else 0.0)
    items.sort(key=lambda i: (not hasattr(getattr(i, "module", None), "on_ranks"), -limits[i.path]))


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()
