"""What supports of the unreduced model bear, and how they move it.

The unknowns of a step are displacements against those that follow the supports at rest, y = u - R w with the
prescribed displacements w: R w'' acts on them as a load by its inertia, as the ride of a structure does, and
damping on their rates. What a support bears is the work of all forces on R, those of inertia included.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from ...loads import EdgeMotion, Load, SupportMotion
from ...reduction.supports import at_rest
from ...system.loads import LoadColumns
from ...system.model import Model
from ...system.solve.pencil import Pencil


class Ground:
    """Supports of one run. Collective.

    Parameters
    ----------
    model : Model
    pencil : Pencil
        With all auxiliary unknowns.
    units : sequence of Load
    columns : LoadColumns
        Of the unit loads.

    Attributes
    ----------
    names : tuple of str
        What is supported.
    edges : (e,) array
        Unit loads that are prescribed displacements.
    rows : (2 names, local unknowns) sparse
        Momentum of the unknowns along what follows each support.
    inertia : (e, local unknowns) array
        The same along what follows prescribed displacements, R.
    owned, gaps, tips, points : (..., e) arrays
        R at this rank's displacement unknowns, contact rows, K_I and K_II, named points.
    loads, damping, mass : (2 names, loads) arrays
        Of what supports bear under unit loads; at rates and accelerations of prescribed displacements.
    contact : (2 names, c) array
        Under unit contact forces.
    """

    def __init__(self, model: Model, pencil: Pencil, units: Sequence[Load], columns: LoadColumns):
        edges = [k for k, unit in enumerate(units) if isinstance(unit, EdgeMotion)]
        solved = np.zeros(columns.forces.shape)
        if edges:
            solved[:, edges] = model.solver.columns(columns.forces[:, edges], "transient")
        shares, following = at_rest(model, units, columns, solved)
        self.names, self.edges = shares.names, np.array(edges, dtype=int)
        self.loads, self.contact, self.damping, self.mass = (
            part.reshape(2 * len(self.names), part.shape[2])
            for part in (shares.loads, shares.contact, shares.damping, shares.mass)
        )
        self.rows = sparse.csr_matrix(pencil.momenta(following))
        self.owned = solved[:, edges]
        self.gaps, self.tips = model.contact.rows(self.owned), model.tips.intensities.rows(self.owned)
        self.points = model.layout.point_rows(self.owned)
        fields = np.zeros((*model.layout.part.unknowns.shape, len(edges)))
        if columns.lift is not None:
            self.points = self.points + columns.lift.points.reshape(len(self.points), -1)[:, edges]
            fields = columns.lift.nodal[..., edges]
            fields = fields + model.nodal(self.owned)
        self.inertia = pencil.momenta(fields)
        at = shares.moved[self.edges]
        # of prescribed displacements: energies of w and w', power that damping takes at w', work of contact
        self.stiff, self.heavy, self.damped = (
            table[np.ix_(at, self.edges)] for table in (self.loads, self.mass, self.damping)
        )
        self.pressed = self.contact[at]


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
