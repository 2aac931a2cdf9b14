"""What OpenBLAS is told of the processor before it is loaded."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

# Of the first processor: a paragraph of lines "name : value".
_INFORMATION = Path("/proc/cpuinfo")
# The instructions that kernels need, and their name.
_KERNELS = (
    ({"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"}, "SKYLAKEX"),
    ({"avx2", "fma"}, "HASWELL"),
)


def name_kernels() -> None:
    """Choose OpenBLAS' kernels by the instructions of an Intel processor, where the user has not.

    OpenBLAS knows processors by their numbers, and takes one that came after it for a Prescott of 2004: that
    of Debian 12 (0.3.21) factorises and solves a plate in 4.2 CPU s on an Emerald Rapids of 2023, and in 1.8
    when it is told. Processors that it knows have the same kernels by these names. `run` does the same, for
    programs that load NumPy first.
    """
    try:
        with _INFORMATION.open(encoding="ascii", errors="replace") as lines:
            first = dict(map(_entry, itertools.takewhile(str.strip, lines)))
    except OSError:  # not Linux
        return
    flags = set(first.get("flags", "").split())
    kernels = next((name for needed, name in _KERNELS if needed <= flags), None)
    if first.get("vendor_id") == "GenuineIntel" and kernels is not None:
        os.environ.setdefault("OPENBLAS_CORETYPE", kernels)


def _entry(line: str) -> tuple[str, str]:
    name, _, value = line.partition(":")
    return name.strip(), value.strip()
