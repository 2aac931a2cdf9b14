"""The stiffness applied S-element by S-element with the rigid-body motions taken out.

An S-element's stiffness times a rigid-body motion is round-off, not zero, and so are the sums of it in the
assembled matrix. In slender structures, whose elements move almost rigidly, that round-off outweighs the
strain energy of the lowest modes. Here the motions are taken out of an element's displacements before the
product and out of its forces after it.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable

import numpy as np
from scipy import sparse

from meshing.warnings import RoundOffWarning

from ...errors import SolveError, caller_level, on_all_ranks
from ...petsc import MPI, PETSc
from ...selement.rigid_motions import rigid_body_basis
from ..layout.layout import Layout
from ..solve.assembly import ElementBlocks
from .elements import Elements

# Round-off of the assembled stiffness, relative to the load, beyond which solves are refined; corrections
# that end it at once, and once they fall no more; and how many are made at most (62 at L/h = 1e5).
NEEDED, _ENOUGH, _SETTLED, _MOST = 1e-9, 1e-13, 1e-9, 100
# Errors beyond which the user is warned, and a result is refused; what the softest deformation's round-off
# was measured to do to slender cantilevers.
ROUND_OFF, REFUSED, _SOFTEST = 1e-5, 1e-2, 4.0


class ElementStiffness:
    """Nodal forces of displacements, sum of P K_e P u_e with P = I - Q Q^T over the S-elements.

    Parameters
    ----------
    elements : Elements
    springs : list of ElementBlocks
        Of elastic supports.

    Notes
    -----
    Holds the element stiffnesses once more, 12 bytes an entry.
    """

    def __init__(self, elements: Elements, springs: list[ElementBlocks]):
        self._layout, groups = elements.layout, elements.groups
        places = [(2 * group.nodes[:, :, None] + [0, 1]).reshape(-1) for group in groups]
        self._places = np.concatenate([np.empty(0, dtype=int), *places])
        self._motions = _block_diagonal(
            [rigid_body_basis(self._layout.part.coordinates[group.nodes]) for group in groups]
        )
        self._blocks = _block_diagonal(
            [elements.scales(group)[0] * group.turned_both(group.solution.stiffness) for group in groups]
        )
        self._shares, self._vector = self._motions.createVecs()
        self._product = self._vector.duplicate()
        self._springs = _springs(self._layout, springs)

    def __call__(self, owned: np.ndarray) -> np.ndarray:
        """Forces (owned,) or (owned, c) of displacements of the same shape. Collective."""
        if owned.ndim == 2:
            return np.stack([self(column) for column in owned.T], axis=1)
        field = self._layout.nodal(owned).ravel()
        self._vector.array = field[self._places]
        self._remove_motions(self._vector)
        self._blocks.mult(self._vector, self._product)
        self._remove_motions(self._product)
        forces = np.bincount(self._places, self._product.array_r, minlength=len(field))
        if self._springs.nnz:
            forces += self._springs @ field
        return self._layout.summed(forces.reshape(-1, 2))

    def _remove_motions(self, vector: PETSc.Vec) -> None:
        """Twice: once leaves the round-off of large motions."""
        for _ in range(2):
            self._motions.multTranspose(vector, self._shares)
            self._shares.scale(-1.0)
            self._motions.multAdd(self._shares, vector, vector)


def _block_diagonal(blocks: list[np.ndarray]) -> PETSc.Mat:
    """This rank's block-diagonal matrix of dense blocks, (k, n, m) of those of one shape."""
    kind = PETSc.IntType
    columns, lengths, first, height = [np.empty(0, dtype=kind)], [np.zeros(1, dtype=kind)], 0, 0
    for k, n, m in (some.shape for some in blocks):
        numbers = np.arange(first, first + k * m, dtype=kind).reshape(k, 1, m)
        columns.append(np.broadcast_to(numbers, (k, n, m)).ravel())
        lengths.append(np.full(k * n, m, dtype=kind))
        first, height = first + k * m, height + k * n
    csr = (
        np.cumsum(np.concatenate(lengths), dtype=kind),
        np.concatenate(columns),
        np.concatenate([np.empty(0), *(some.ravel() for some in blocks)]),
    )
    return PETSc.Mat().createAIJWithArrays((height, first), csr, comm=PETSc.COMM_SELF)


def _springs(layout: Layout, blocks: list[ElementBlocks]) -> sparse.csr_matrix:
    """Elastic supports over the displacements of this rank's nodes."""
    size = layout.part.unknowns.size
    total = sparse.csr_matrix((size, size))
    if not blocks:
        return total
    place = {int(number): k for k, number in enumerate(layout.part.unknowns.ravel()) if number >= 0}
    for block in blocks:
        for numbers, values in zip(block.rows, block.values(slice(0, len(block.rows)))):
            places = np.array([place.get(int(number), -1) for number in numbers])
            held = np.flatnonzero(places >= 0)
            rows, columns = np.meshgrid(places[held], places[held], indexing="ij")
            entries = (values[np.ix_(held, held)].ravel(), (rows.ravel(), columns.ravel()))
            total = total + sparse.csr_matrix(entries, shape=(size, size))
    return total


class Refinement:
    """Refinement of solves with the assembled stiffness, where its round-off needs it.

    Parameters
    ----------
    elements : Elements
    springs : list of ElementBlocks
        Of elastic supports.
    matrix : PETSc.Mat
        The assembled stiffness.

    Attributes
    ----------
    correction : float
        Relative size of the last correction; 0 without refinement.
    """

    def __init__(self, elements: Elements, springs: list[ElementBlocks], matrix: PETSc.Mat):
        self._elements, self._springs, self._comm = elements, springs, elements.layout.comm
        self.scale = np.finfo(float).eps * matrix.norm(PETSc.NormType.NORM_INFINITY)
        self.correction = 0.0
        self._operator: ElementStiffness | None = None

    def needed(self, right: float, solution: float) -> bool:
        """Whether the round-off of the assembled stiffness reaches the digits of a solution, from the norms
        of a right-hand side and of its solution.
        """
        return self.scale * solution > NEEDED * right

    @property
    def operator(self) -> ElementStiffness:
        if self._operator is None:
            self._operator = ElementStiffness(self._elements, self._springs)
        return self._operator

    @functools.cached_property
    def cell_error(self) -> float:
        """What the round-off inside S-elements leaves of the digits, relative: that of the stiffest
        S-element's softest deformation, which cells of very small height meet. Collective.
        """
        ratios = [0.0]
        for group in self._elements.groups:
            values = np.linalg.eigvalsh(group.solution.stiffness)
            ratios.append(values[-1] / max(values[3], np.finfo(float).eps * values[-1]))
        return _SOFTEST * np.finfo(float).eps * self._comm.allreduce(max(ratios), MPI.MAX)

    def judge(self, analysis: str) -> None:
        """Warn, or refuse, where the round-off inside S-elements reaches a refined result. Collective.

        Raises
        ------
        SolveError
        """
        if self._operator is None or self.cell_error <= ROUND_OFF:
            return
        text = (
            f"{analysis}: round-off in the stiffness of the most slender S-elements leaves results an error "
            "of "
            f"about {self.cell_error:.1g}, for they are much longer than high; use shorter cells (size)"
        )
        if self.cell_error > REFUSED:
            raise on_all_ranks(SolveError(text))
        warnings.warn(text, RoundOffWarning, stacklevel=caller_level())

    def refine(
        self, right: np.ndarray, solution: np.ndarray, solve: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Corrected solutions (owned,) or (owned, c) of `solve(right)`, by conjugate gradients with the solve
        as preconditioner: two or three steps, more where round-off leaves little of the solve. Collective.
        """
        solution = solution.copy()
        residual = right - self.operator(solution)
        direction, before = np.zeros_like(right), np.inf
        energy = np.zeros(right.shape[1:])
        for _ in range(_MOST):
            change = solve(residual)
            former, energy = energy, self._dot(residual, change)
            # no share of columns that are solved, of a right-hand side of zeros say
            share = np.divide(energy, former, out=np.zeros_like(energy), where=former != 0.0)
            direction = change + share * direction
            sizes = self._dot(direction, direction) / np.maximum(
                self._dot(solution, solution), np.finfo(float).tiny
            )
            self.correction = float(np.sqrt(np.max(sizes, initial=0.0)))
            if self.correction <= _ENOUGH:
                solution += direction  # so small that its length does not matter
                break
            product = self.operator(direction)
            curvature = self._dot(direction, product)
            length = np.divide(energy, curvature, out=np.zeros_like(energy), where=curvature > 0.0)
            solution += length * direction
            residual = residual - length * product
            self.correction = float(np.sqrt(np.max(length**2 * sizes, initial=0.0)))
            if self.correction <= _ENOUGH or (self.correction <= _SETTLED and self.correction >= before):
                break
            before = self.correction
        return solution

    def _dot(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Inner products (c,) of columns, or of two vectors."""
        sums = np.array((first * second).sum(axis=0))
        self._comm.Allreduce(MPI.IN_PLACE, sums)
        return sums
