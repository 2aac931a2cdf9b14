"""The structure's matrices in SciPy's hands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..errors import wrong_input
from ..petsc import PETSc
from .contact.rows import Contact
from .solve.pencil import Pencil
from .solve.stiffness import Stiffness


class Matrices(NamedTuple):
    """A structure on its supports, without damping: M u'' + K u = f + G' force.

    Attributes
    ----------
    stiffness, mass : (n, n) csr_matrix
        K, N/m, and M, kg, of the displacement unknowns and, behind them, the auxiliary ones of the continued
        fraction, every one of them.
    gaps : (c, n) csr_matrix
        G: changes of the gaps of the contact rows, those of pairs first, then those inside tip elements.
    initial : (c,) array
        Gaps without displacements, m.
    flexibility : (c, c) csr_array
        What forces do to the gaps without moving an unknown, m/N.
    """

    stiffness: sparse.csr_matrix
    mass: sparse.csr_matrix
    gaps: sparse.csr_matrix
    initial: np.ndarray
    flexibility: sparse.csr_array


def matrices(stiffness: Stiffness, contact: Contact) -> Matrices:
    """See `Structure.matrices`."""
    if stiffness.layout.comm.size > 1:
        raise wrong_input("Model.matrices: the model is on several ranks; make it on one")
    with Pencil(stiffness, 1.0, 0.0) as pencil:
        whole, mass = (_in_scipy(matrix) for matrix in (pencil.stiffness, pencil.mass))
    rows = contact.rows.matrix
    gaps = sparse.csr_matrix((rows.data, rows.indices, rows.indptr), shape=(rows.shape[0], whole.shape[0]))
    return Matrices(whole, mass, gaps, contact.initial, contact.flexibility)


def _in_scipy(matrix: PETSc.Mat) -> sparse.csr_matrix:
    plain = matrix.convert("aij", PETSc.Mat()) if matrix.getType() != "seqaij" else matrix
    indptr, indices, values = plain.getValuesCSR()
    return sparse.csr_matrix((values, indices, indptr), shape=matrix.getSize())
