"""Compilation of kernels by numba, kept on disk for the next process."""

from __future__ import annotations

try:
    from numba import njit
except OSError as error:  # of the library of its compiler, of which it takes the name for missing
    raise ImportError(
        "numba, which compiles the time steps, cannot load its library: is there memory left for it (some "
        "hundred MB of address space, ulimit -v), and is llvmlite whole?"
    ) from error


def compiled(function, *more: str):
    """`function` compiled when it is first called, with `more` of LLVM's liberties with numbers.

    The machine code is kept in NUMBA_CACHE_DIR if that is set, else beside the source, or where that is not
    writable in the user's cache directory. Where nothing is writable each process compiles for itself.
    """
    # quotients by zero give infinity, as in NumPy, and a product and a sum may be one operation
    options = {"error_model": "numpy", "fastmath": {"contract", *more}}
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # numba finds no directory to write to
        return njit(**options)(function)


def compiled_sums(function):
    """As `compiled`, and sums may be taken in any order: several terms at once."""
    return compiled(function, "reassoc")
