"""Compilation of kernels by numba, which is imported here first, kept on disk for the next process."""

from __future__ import annotations

import sys

from ..working_directory import unread

_CONFIGURATION = ".numba_config.yaml"
_first = "numba" not in sys.modules
try:
    with unread(_CONFIGURATION, "numba"):
        from numba import njit
        from numba.core import config
        from numba.extending import get_cython_function_address  # noqa: F401
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


def compiled(function, **options):
    """`function` compiled when it is first called.

    The machine code is kept in NUMBA_CACHE_DIR if that is set, else beside the source, or where that is not
    writable in the user's cache directory. Where nothing is writable each process compiles for itself.
    """
    options = OPTIONS | options
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # numba finds no directory to write to
        return njit(**options)(function)


def compiled_loops(function):
    """As `compiled`, for loops over arrays that are given: none is made inside, so that references to them
    need not be counted, of which much would be compiled.
    """
    return compiled(function, _nrt=False)


def inner_loops(function):
    """As `compiled_loops`, for what kernels alone call and is kept with them."""
    return njit(no_cpython_wrapper=True, _nrt=False, **OPTIONS)(function)


def inner_sums(function):
    """As `inner_loops`, and sums may be taken in any order: several terms at once."""
    options = OPTIONS | {"fastmath": {"contract", "reassoc"}}
    return njit(no_cpython_wrapper=True, _nrt=False, **options)(function)
