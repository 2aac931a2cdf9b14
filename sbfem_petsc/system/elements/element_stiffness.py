"""The stiffness applied S-element by S-element with the rigid-body motions taken out.

An S-element's stiffness times a rigid-body motion is round-off, not zero, and so are the sums of it in the
assembled matrix. In slender structures, whose elements move almost rigidly, that round-off outweighs the
strain energy of the lowest modes. Here the motions are taken out of an element's displacements before the
product and out of its forces after it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from scipy import sparse

from meshing.warnings import RoundOffWarning

from ...errors import failed_solve, warn
from ...petsc import MPI, PETSc, summed
from ...selement.dense import is_definite
from ...selement.rigid_motions import rigid_body_basis
from .elements import Elements
from .shapes import Group

# Round-off of the assembled stiffness, relative to the load, beyond which solves are refined; corrections
# that end it at once, and once they fall no more; and how many are made at most (62 at L/h = 1e5).
NEEDED, ENOUGH, _SETTLED, _MOST = 1e-9, 1e-13, 1e-9, 100
# Errors beyond which the user is warned, and a result is refused; what the softest deformation's round-off
# was measured to do to slender cantilevers.
ROUND_OFF, REFUSED, _SOFTEST = 1e-5, 1e-2, 4.0
# Columns of displacements that are gone through at a time.
_COLUMNS = 16


# Forces that springs take up, (m, 2, k), of displacements (m, 2, k) of this rank's nodes.
Springs = Callable[[np.ndarray], np.ndarray]
# Solutions of right-hand sides, (owned, k) both.
Solve = Callable[[np.ndarray], np.ndarray]


class ElementStiffness:
    """Nodal forces of displacements, sum of P K_e P u_e with P = I - Q Q^T over the S-elements.

    Parameters
    ----------
    elements : Elements
    springs : callable
        Of elastic supports.

    Notes
    -----
    Holds the element stiffnesses once more, 8 bytes an entry.
    """

    def __init__(self, elements: Elements, springs: Springs):
        self._layout, self._springs = elements.layout, springs
        alike: dict[int, list[Group]] = {}
        for group in elements.groups:
            alike.setdefault(group.nodes.shape[1], []).append(group)
        # of as many nodes together: motions (k, 2 m, 3), stiffnesses (k, 2 m, 2 m)
        self._parts, nodes = [], []
        for groups in alike.values():
            nodes.append(np.concatenate([group.nodes for group in groups]))
            blocks = [elements.scales(g)[0] * g.turned_both(g.solution.stiffness) for g in groups]
            motions = rigid_body_basis(self._layout.part.coordinates[nodes[-1]])
            self._parts.append((motions, np.concatenate(blocks)))
        # of all S-elements, one behind the other, and the sums over those that share one
        self._nodes = np.concatenate([np.empty(0, dtype=int), *(part.ravel() for part in nodes)])
        self._sums = sparse.csr_matrix(
            (np.ones(len(self._nodes)), (self._nodes, np.arange(len(self._nodes)))),
            shape=(len(self._layout.part.nodes), len(self._nodes)),
        )

    def __call__(self, owned: np.ndarray) -> np.ndarray:
        """Forces (owned,) or (owned, c) of displacements of the same shape. Collective."""
        columns = owned if owned.ndim == 2 else owned[:, None]
        parts = [
            self._of_some(columns[:, first : first + _COLUMNS])
            for first in range(0, columns.shape[1], _COLUMNS)
        ]
        return np.concatenate(parts, axis=1).reshape(owned.shape) if parts else np.zeros_like(owned)

    def _of_some(self, columns: np.ndarray) -> np.ndarray:
        """Forces (owned, c) of so few columns that the S-elements' displacements find room."""
        fields, width = self._layout.nodal(columns), columns.shape[1]
        moved, first = fields[self._nodes], 0
        pulled = np.empty_like(moved)
        for motions, blocks in self._parts:
            count, size, _ = motions.shape
            part = slice(first, first + count * size // 2)
            forces = blocks @ without_motions(motions, moved[part].reshape(count, size, width))
            # once is enough: the motions' part of forces is round-off
            forces -= motions @ (motions.transpose(0, 2, 1) @ forces)
            pulled[part], first = forces.reshape(-1, 2, width), part.stop
        sums = (self._sums @ pulled.reshape(-1, 2 * width)).reshape(-1, 2, width)
        return self._layout.summed(sums + self._springs(fields))


def without_motions(motions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(I - Q Q^T) vectors for (k, n, 3) orthonormal motions and (k, n, c) vectors, applied twice: once leaves
    the round-off of large motions.
    """
    for _ in range(2):
        vectors = vectors - motions @ (motions.transpose(0, 2, 1) @ vectors)
    return vectors


class Refinement:
    """Refinement of solves with the assembled stiffness, where its round-off needs it.

    Parameters
    ----------
    elements : Elements
    springs : callable
        Of elastic supports.
    matrix : PETSc.Mat
        The assembled stiffness.

    Attributes
    ----------
    correction : float
        Relative size of the last correction; 0 without refinement.
    """

    def __init__(self, elements: Elements, springs: Springs, matrix: PETSc.Mat):
        self._elements, self._springs, self._comm = elements, springs, elements.layout.comm
        self.scale = np.finfo(float).eps * matrix.norm(PETSc.NormType.NORM_INFINITY)
        self.correction = 0.0
        self._operator: ElementStiffness | None = None

    def needed(self, right: float, solution: float) -> bool:
        """Whether the round-off of the assembled stiffness reaches the digits of a solution, from the norms
        of a right-hand side and of its solution.
        """
        return self.scale * solution > NEEDED * right

    def needed_by(self, right: np.ndarray, solution: np.ndarray) -> bool:
        """The same of right-hand sides (owned,) or (owned, c) and their solutions. Collective."""
        sums = np.sqrt(np.stack([self._dot(part, part) for part in (right, solution)]))
        return any(self.needed(*pair) for pair in sums.reshape(2, -1).T)

    @property
    def operator(self) -> ElementStiffness:
        if self._operator is None:
            self._operator = ElementStiffness(self._elements, self._springs)
        return self._operator

    @functools.cached_property
    def cell_error(self) -> float:
        """What the round-off inside S-elements leaves of the digits, relative: that of the stiffest
        S-element's softest deformation, which cells of very small height meet; 0 where factors tell
        that it stays below `ROUND_OFF`. Collective.
        """
        ratios = [0.0]
        for group in self._elements.groups:
            stiffness = group.solution.stiffness
            # without three of the unknowns the lowest eigenvalue is no higher than the fourth of all
            least = _SOFTEST * np.finfo(float).eps / ROUND_OFF * np.trace(stiffness)
            if is_definite(stiffness[3:, 3:] - least * np.eye(len(stiffness) - 3)):
                continue
            values = np.linalg.eigvalsh(stiffness)
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
            raise failed_solve(text)
        warn(text, RoundOffWarning)

    def refine(
        self, right: np.ndarray, solution: np.ndarray, solve: Solve, enough: float = ENOUGH
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
            if self.correction <= enough:
                solution += direction  # so small that its length does not matter
                break
            product = self.operator(direction)
            curvature = self._dot(direction, product)
            length = np.divide(energy, curvature, out=np.zeros_like(energy), where=curvature > 0.0)
            solution += length * direction
            residual = residual - length * product
            self.correction = float(np.sqrt(np.max(length**2 * sizes, initial=0.0)))
            if self.correction <= enough or (self.correction <= _SETTLED and self.correction >= before):
                break
            before = self.correction
        return solution

    def _dot(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Inner products (c,) of columns, or of two vectors."""
        return summed(self._comm, (first * second).sum(axis=0))
