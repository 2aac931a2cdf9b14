"""Rows over all unknowns of the unreduced model by which a step sees its gaps, loads and named points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from ...loads import Load, SupportMotion
from ...system.solve.pencil import Pencil
from .ground import Ground


class SparseColumns:
    """The transpose of some rows, of which most unknowns know nothing."""

    def __init__(self, rows: sparse.csr_matrix):
        transposed = rows.T.tocsr()
        self.places = np.flatnonzero(np.diff(transposed.indptr))
        self.matrix = transposed[self.places]

    def add(self, target: np.ndarray, values: np.ndarray) -> None:
        """target += columns @ values."""
        target[self.places] += self.matrix @ values


def probe_rows(
    pencil: Pencil, units: Sequence[Load], forces: np.ndarray, ground: Ground, gaps: sparse.csr_matrix
) -> tuple[sparse.csr_matrix, sparse.csr_matrix, sparse.csr_matrix]:
    """Rows over this rank's unknowns.

    Parameters
    ----------
    pencil : Pencil
        With all auxiliary unknowns.
    units : sequence of Load
    forces : (owned, loads) array
        Of the unit loads.
    ground : Ground
    gaps : (c, owned) sparse matrix
        Contact rows that matter, over the displacement unknowns.

    Returns
    -------
    gaps, loads, points : (c, n), (loads, n), (2 points, n) sparse
    """
    auxiliary = len(pencil.auxiliary_inertia())

    def widened(rows: sparse.csr_matrix) -> sparse.csr_matrix:
        return sparse.hstack([rows, sparse.csr_matrix((rows.shape[0], auxiliary))], format="csr")

    loads = np.zeros((len(units), pencil.owned + auxiliary))
    loads[:, : pencil.owned] = forces.T
    for k, unit in enumerate(units):
        if isinstance(unit, SupportMotion):
            loads[k, pencil.owned :] = -pencil.auxiliary_translation() @ [unit.ax, unit.ay]
    loads[ground.edges] = -ground.inertia
    return widened(gaps), sparse.csr_matrix(loads), widened(pencil.layout.point_rows.matrix)
