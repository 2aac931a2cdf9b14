"""Compiles the kernels of the time steps alone, where PETSc may still be missing: ``python -m
sbfem_petsc.contact.precompile``, which `./run` waits for. `cli.precompile` compiles all.
"""

from __future__ import annotations

import numpy as np

from .friction import rubbing_of
from .law import RowLaws
from .marching import march, step_constants
from .step_data import StepHistory, StepLoads, StepState


def compile_kernels() -> None:
    """Compile what `marching.march` needs; it is kept where `compiled.compiled` says."""
    rows = np.eye(2)
    each = RowLaws.unilateral(2), rubbing_of(None, rows, 2)
    march(
        step_constants([np.zeros((10, 2))], (rows, rows), rows, each, np.zeros(2)),
        StepLoads(np.zeros((2, 2)), np.ones((2, 2)), np.zeros(1, dtype=np.int8)),
        StepState(np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2, dtype=np.int8)),
        StepHistory(np.empty((1, 2)), np.empty((1, 2)), np.empty((1, 2)), np.empty(1)),
    )


if __name__ == "__main__":
    compile_kernels()
