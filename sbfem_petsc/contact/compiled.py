"""Compilation of kernels by numba, which is imported here first, kept on disk for the next process."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from ..working_directory import unread

_CONFIGURATION = ".numba_config.yaml"
_first = "numba" not in sys.modules
try:
    with unread(_CONFIGURATION, "numba"):
        from numba import njit
        from numba import typeof as typeof
        from numba import types as types
        from numba.core import config
        from numba.core.caching import IndexDataCacheFile
        from numba.extending import typeof_impl as typeof_impl
except OSError as error:  # of the library of its compiler, of which it takes the name for missing
    raise ImportError(
        "numba, which compiles the time steps, cannot load its library: is there memory left for it (some "
        "hundred MB of address space, ulimit -v), and is llvmlite whole?"
    ) from error


if _first and getattr(config, "_config_fname", None) == _CONFIGURATION:
    config._config_fname = ""  # which each compilation would look for

# Quotients by zero give infinity, as in NumPy; a product and a sum may be one operation; no C code calls a
# kernel.
OPTIONS: dict[str, object] = {"error_model": "numpy", "fastmath": {"contract"}, "no_cfunc_wrapper": True}
Kernel = TypeVar("Kernel", bound=Callable)


class KernelFiles(IndexDataCacheFile):
    """What is kept on disk of one kernel: a file for each kind of arguments.

    Its name has a digest of all that the code depends on: kind, processor, numba, the kernel's own module and
    this package's, from which kernels take others and constants. So a file is never out of date, and what
    several processes write at once is the same. numba's own files are numbered in an index, in which two
    processes may give two kinds one number, and know nothing of what a kernel calls.
    """

    def __init__(self, kernel: Any) -> None:
        kept, module = kernel._cache, Path(kernel.py_func.__code__.co_filename)
        super().__init__(kept.cache_path, kept._impl.filename_base, _sources(module))
        self.name = kept._impl.filename_base
        # read too where it may not be written; who names a folder means no other
        beside = [] if config.CACHE_DIR else [str(module.parent / "__pycache__")]
        self.folders = [kept.cache_path, *beside]

    def file_name(self, key: object) -> str:
        """Of the machine code for a kind of arguments."""
        depends = repr((key, self._version, self._source_stamp))
        return f"{self.name}.{hashlib.sha256(depends.encode()).hexdigest()[:32]}.nbc"

    def save(self, key: object, data: object) -> None:
        with contextlib.suppress(OSError):  # a full disk: the next process compiles it again
            self._save_data(self.file_name(key), data)

    def load(self, key: object) -> Any:
        for folder in self.folders:
            try:
                return self._load_data(os.path.join(folder, self.file_name(key)))
            except (OSError, EOFError, pickle.UnpicklingError):  # not there, or cut by a fall of the machine
                continue
        return None


@functools.cache
def _sources(module: Path) -> str:
    files = {module, *Path(__file__).parent.glob("*.py")}
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(files))).hexdigest()


def compiled(function: Kernel, **options: object) -> Kernel:
    """`function` compiled when it is first called.

    The machine code is kept in NUMBA_CACHE_DIR if that is set, else beside the source, or where that is not
    writable in the user's cache directory. Where nothing is writable each process compiles for itself.
    """
    options = OPTIONS | options
    try:
        kernel = njit(cache=True, **options)(function)
        kernel._cache._cache_file = KernelFiles(kernel)
    except (RuntimeError, OSError):  # numba finds no directory to write to; no file holds the source
        return njit(**options)(function)
    return kernel


def compiled_loops(function: Kernel) -> Kernel:
    """As `compiled`, for loops over arrays that are given: none is made inside, so that references to them
    need not be counted, of which much would be compiled.
    """
    return compiled(function, _nrt=False)


def inner_loops(function: Kernel) -> Kernel:
    """As `compiled_loops`, for what kernels alone call and is kept with them: they take it in, for a call
    hands over each size and stride of all its arrays, which takes as long as a step of few modes.
    """
    return njit(no_cpython_wrapper=True, forceinline=True, _nrt=False, **OPTIONS)(function)


def inner_sums(function: Kernel) -> Kernel:
    """As `inner_loops`, and sums may be taken in any order: several terms at once; taken in where that is
    short.
    """
    options = OPTIONS | {"fastmath": {"contract", "reassoc"}}
    return njit(no_cpython_wrapper=True, _nrt=False, **options)(function)


def compiled_apart(function: Kernel) -> Kernel:
    """As `compiled_loops`, for what others call by its `Address`: they are compiled without it, once for all
    that are called so.
    """
    return compiled(function, _nrt=False, no_cfunc_wrapper=False)
