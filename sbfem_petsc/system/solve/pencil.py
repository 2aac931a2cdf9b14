"""The generalised eigenvalue pencil (16), (17): displacement and auxiliary unknowns, the latter reduced to
what a band needs.
"""

from __future__ import annotations

import copy
import functools
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...petsc import (
    PETSc,
    dense_columns,
    direct_solver,
    free,
    freeing,
    make_ksp,
    negative_eigenvalues,
    require_thread,
)
from ...ranks.capacity import give_back
from ...ranks.parallel import alone
from ...selement.leading_unknowns import reduced_fraction
from ..elements.elements import Elements
from ..elements.shapes import Group, turned, turned_both
from ..layout.layout import Layout
from ..layout.rows import Rows
from .assembly import ElementBlocks, assemble, assemble_like, from_rows
from .linear_solver import LinearSolver
from .stiffness import Stiffness

# Unknowns up to which, on one rank, a hundred solves by PETSc's own factor are faster than by MUMPS and its
# fronts: four times as fast at 2,000, as fast at 4,000. Products with full blocks are faster than those with
# the upper half, too.
_SMALL = 4000
# Columns that the stiffness is multiplied with at a time.
_COLUMNS = 16


class Pencil:
    """``K x = omega^2 M x`` with ``K = diag(K_b, E t I)`` and ``M = [[M_b, C], [C', J]]``.

    The auxiliary unknowns of an S-element act through -omega^4 C (E t I - omega^2 J)^-1 C'. For a band of
    frequencies they are projected on the leading right singular vectors of L^-1 C, L L' = K_b + omega^2 M_b
    of the element at the top of the band, an even number of them: what is left out is bounded there, and
    below falls with omega^4.
    Elements much smaller than a wavelength keep none. The projection keeps the pencil symmetric and its mass
    positive definite.

    Parameters
    ----------
    statics : Stiffness
        K_b.
    highest : float
        Top of the band, rad/s.
    tolerance : float
        What the dropped auxiliary unknowns of an S-element may contribute at most, relative to its own strain
        and kinetic energy at the top of the band; 0 keeps every one.

    Attributes
    ----------
    layout, elements
        Of the stiffness.
    unknowns : int
        Each rank holds its displacement unknowns, then its auxiliary ones.
    counted : (float, int)
        omega^2 and the eigenvalues below it, of a pencil that is kept for the modes that were counted so: it
        is not freed behind a `with`. Of others -1.
    """

    def __init__(self, statics: Stiffness, highest: float, tolerance: float):
        require_thread()
        self.statics, self.elements, self.layout = statics, statics.elements, statics.layout
        layout, comm = self.layout, self.layout.comm
        self.small, self.highest, self.counted = is_small(layout), highest, (0.0, -1)
        self._pieces = _pieces(self.elements, highest, tolerance)
        local = sum(piece.inertia.size for piece in self._pieces)
        self.auxiliary_ranges = np.concatenate([[0], np.cumsum(comm.allgather(local))]).astype(np.int64)
        self.ranges = layout.ranges + self.auxiliary_ranges
        self.unknowns = int(self.ranges[-1])
        self.owned = layout.owned.stop - layout.owned.start
        moduli = [np.full(piece.inertia.size, piece.modulus) for piece in self._pieces]
        self._auxiliary_stiffness = np.concatenate([np.empty(0), *moduli])

    @functools.cached_property
    def stiffness(self) -> PETSc.Mat:
        """diag(K_b, E t I) without a copy of the model's stiffness, made when it is first asked for."""
        comm, count = self.layout.comm, len(self._auxiliary_stiffness)
        own = int(self.auxiliary_ranges[comm.rank]) + np.arange(count)
        rows = (np.arange(count + 1), own, self._auxiliary_stiffness)
        corner = from_rows(comm, self.auxiliary_ranges, self.auxiliary_ranges, rows, symmetric=True)
        matrix = PETSc.Mat().createNest([[self.statics.matrix, None], [None, corner]], comm=comm)
        corner.destroy()
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        return matrix

    def stiff_products(self, columns: np.ndarray) -> np.ndarray:
        """diag(K_b, E t I) times this rank's rows of columns, in Fortran's order. Collective."""
        matrix, result = self.statics.matrix, np.empty_like(columns)
        for first in range(0, columns.shape[1], _COLUMNS):
            some = slice(first, first + _COLUMNS)
            given = dense_columns(matrix, np.asfortranarray(columns[: self.owned, some]))
            product = matrix.matMult(given)
            result[: self.owned, some] = product.getDenseArray()
            free(self.layout.comm, given, product)
        result[self.owned :] = self._auxiliary_stiffness[:, None] * columns[self.owned :]
        return result

    @functools.cached_property
    def mass(self) -> PETSc.Mat:
        """Made when it is first asked for: to count frequencies takes none."""
        comm = self.layout.comm
        mass = []
        first = int(self.ranges[comm.rank]) + self.owned
        for piece in self._pieces:
            numbers = piece.numbers(first)
            unknowns = self.numbers(piece.unknowns)
            mass.append(ElementBlocks(unknowns, unknowns, piece.mass))
            if numbers.size:
                mass.append(ElementBlocks(unknowns, numbers, piece.coupling))
                mass.append(ElementBlocks(numbers, unknowns, piece.transposed_coupling))
                pairs = numbers.reshape(-1, 2)
                inertia = piece.inertia.reshape(-1, 2, 1) * np.eye(2)
                mass.append(ElementBlocks(pairs, pairs, inertia.__getitem__))
            first += numbers.size
        # products with it take most of an eigensolver's time
        size = self.statics.matrix.getBlockSize()
        kind = "blocks" if self.small and size == 2 else "upper"
        return assemble(comm, self.ranges, mass, kind, block_size=size)

    def numbers(self, unknowns: np.ndarray) -> np.ndarray:
        """Numbers in the pencil of displacement unknowns; -1 stays -1."""
        ranges, size = self.layout.ranges, self.layout.comm.size
        if size == 1:
            return unknowns
        owner = np.clip(np.searchsorted(ranges, unknowns, side="right") - 1, 0, size - 1)
        return np.where(unknowns >= 0, unknowns + self.auxiliary_ranges[owner], -1)

    def full_shapes(self, shapes: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """(local unknowns, n), in Fortran's order: modes, by this rank's displacement unknowns (owned, n) and
        angular frequencies (n,), with their auxiliary unknowns, which follow by the lower half of (K -
        omega^2 M) phi = 0. Collective.
        """
        away = self._auxiliary_stiffness[:, None] - omega**2 * self.auxiliary_inertia()[:, None]
        inside = omega**2 * self.auxiliary_momentum(self.layout.nodal(shapes)) / away
        return np.asfortranarray(np.concatenate([shapes, inside]))

    def heavy_products(self, columns: np.ndarray) -> np.ndarray:
        """The mass times this rank's rows of columns, in Fortran's order. Collective.

        One by one: PETSc 3.18 crashes in products of matrices kept by halves with blocks of columns.
        """
        return products(self.mass, columns)

    def condensed(self, shift: float) -> PETSc.Mat:
        """K - shift M with the auxiliary unknowns eliminated, over the displacement unknowns alone."""
        if shift == 0.0:
            return copy.copy(self.statics.matrix)  # a reference of its own
        return assemble_like(self.statics.matrix, self._condensed_blocks(shift), definite=shift < 0.0)

    def _condensed_blocks(self, shift: float) -> list[ElementBlocks]:
        return self.statics.spring_blocks() + [
            ElementBlocks(piece.unknowns, piece.unknowns, piece.condensed(shift)) for piece in self._pieces
        ]

    @functools.cached_property
    def coupling(self) -> PETSc.Mat:
        """C, displacement by auxiliary unknowns, made when it is first asked for."""
        first, blocks = int(self.auxiliary_ranges[self.layout.comm.rank]), []
        for piece in self._pieces:
            numbers = piece.numbers(first)
            blocks.append(ElementBlocks(piece.unknowns, numbers, piece.coupling))
            first += numbers.size
        return assemble(
            self.layout.comm, self.layout.ranges, blocks, "general", column_ranges=self.auxiliary_ranges
        )

    def auxiliary_diagonal(self, shift: float) -> np.ndarray:
        """E t - shift J of this rank's auxiliary unknowns."""
        return self._auxiliary_stiffness - shift * self.auxiliary_inertia()

    def auxiliary_translation(self) -> np.ndarray:
        """(local auxiliary unknowns, 2): C' times a unit translation along x and y, what a rigid motion of
        the structure couples to.
        """
        return self.auxiliary_momentum(np.broadcast_to(np.eye(2), (len(self.layout.part.nodes), 2, 2)))

    def auxiliary_momentum(self, field: np.ndarray) -> np.ndarray:
        """(local auxiliary unknowns, ...): C' times displacements (m, 2, ...) of this rank's nodes."""
        width = math.prod(field.shape[2:])
        parts = [np.empty((0, width))]
        for piece in self._pieces:
            for part in ElementBlocks(piece.unknowns, piece.numbers(0), piece.coupling).batches():
                coupling = piece.transposed_coupling(part)
                moved = field[piece.nodes[part]].reshape(len(coupling), coupling.shape[2], width)
                parts.append(np.concatenate(coupling @ moved))
        found = np.concatenate(parts)
        return found.reshape(len(found), *field.shape[2:])

    def momenta(self, fields: np.ndarray) -> np.ndarray:
        """(k, local unknowns): products of the mass with displacements (m, 2, k) of this rank's nodes, which
        the insides of S-elements follow at rest. Collective.
        """
        forces = self.layout.summed(self.elements.inertia_forces(fields))
        return np.concatenate([forces, self.auxiliary_momentum(fields)]).T

    def placed(self) -> Iterator[tuple[Group, float, np.ndarray]]:
        """S-elements of one shape and size: their group, rho h^2 t (kg), and their auxiliary unknowns among
        those of this rank, (k, a); of a pencil that keeps every one.
        """
        first = 0
        for kind in itertools.chain.from_iterable(piece.kinds for piece in self._pieces):
            count = len(kind.group.sizes) * len(kind.inertia)
            yield kind.group, kind.scale, first + np.arange(count).reshape(len(kind.group.sizes), -1)
            first += count

    def auxiliary_inertia(self) -> np.ndarray:
        """J of this rank's auxiliary unknowns."""
        return np.concatenate([np.empty(0), *(piece.inertia.ravel() for piece in self._pieces)])

    def eigenvalues_below(self, shift: float) -> int | None:
        """Number of eigenvalues omega^2 < `shift` by Sylvester's law of inertia; None where the direct solver
        does not tell it (MUMPS does). Collective.
        """
        comm = self.layout.comm
        if direct_solver(comm)[1] != "mumps":  # before a matrix is made for it
            return None
        size, blocks = self.statics.matrix.getBlockSize(), self._condensed_blocks(shift)
        with freeing(comm, assemble(comm, self.layout.ranges, blocks, "upper", block_size=size)) as (half,):
            half.setOption(PETSc.Mat.Option.SPD, False)
            negative = negative_eigenvalues(half, "modal")
        own = int((self.auxiliary_diagonal(shift) < 0.0).sum())
        return None if negative is None else negative + comm.allreduce(own)

    def __enter__(self) -> Pencil:
        return self

    def __exit__(self, *_: object) -> None:
        if self.counted[1] < 0:
            self.destroy()

    def destroy(self) -> None:
        """Free the PETSc matrices."""
        made = (self.__dict__.get(name) for name in ("stiffness", "mass", "coupling"))
        free(self.layout.comm, *(matrix for matrix in made if matrix is not None))
        give_back(self.layout.count)


@dataclass(frozen=True, eq=False)
class _Kind:
    """S-elements of one shape and one size, equal up to rotation, with the auxiliary unknowns that are kept.

    Attributes
    ----------
    group : Group
    scale : float
        rho h^2 t, kg.
    coupling : (n, r) array
    inertia : (r,) array
    """

    group: Group
    scale: float
    coupling: np.ndarray
    inertia: np.ndarray


class _Piece:
    """S-elements of one material with as many boundary and as many auxiliary unknowns, of however many kinds:
    what is done for each kind at a time takes longer than its numbers.
    """

    def __init__(self, elements: Elements, kinds: list[_Kind]):
        self.kinds = kinds
        self._of = np.repeat(np.arange(len(kinds)), [len(kind.group.sizes) for kind in kinds])
        self._rotations = np.concatenate([kind.group.rotations for kind in kinds])
        self.nodes = np.concatenate([kind.group.nodes for kind in kinds])
        self.unknowns = elements.layout.part.unknowns[self.nodes].reshape(len(self.nodes), -1)
        self.modulus = elements.scales(kinds[0].group)[0]
        self._scales = np.array([kind.scale for kind in kinds])[self._of, None, None]
        self._coupling = np.stack([kind.coupling for kind in kinds])
        self._inertia = np.stack([kind.inertia for kind in kinds])

    @property
    def inertia(self) -> np.ndarray:
        """(k, r)"""
        return self._scales[:, 0] * self._inertia[self._of]

    def numbers(self, first: int) -> np.ndarray:
        """(k, r) numbers of the auxiliary unknowns, the first of which is given."""
        count = len(self._of)
        return first + np.arange(count * self._inertia.shape[1]).reshape(count, -1)

    def mass(self, part: slice) -> np.ndarray:
        """(k, n, n) blocks of some of the S-elements."""
        masses = np.stack([self.kinds[k].group.solution.mass for k in self._of[part]])
        return self._scales[part] * turned_both(self._rotations[part], masses)

    def coupling(self, part: slice) -> np.ndarray:
        """(k, n, r) blocks of some of the S-elements."""
        return self._scales[part] * turned(self._rotations[part], self._coupling[self._of[part]])

    def transposed_coupling(self, part: slice) -> np.ndarray:
        """(k, r, n)"""
        return self.coupling(part).transpose(0, 2, 1)

    def condensed(self, shift: float) -> Callable[[slice], np.ndarray]:
        """(k, n, n) blocks of the shifted stiffness without auxiliary unknowns, of some of the S-elements."""

        def values(part: slice) -> np.ndarray:
            of, s = self._of[part], shift / self.modulus * self._scales[part]
            solutions = [self.kinds[k].group.solution for k in of]
            matrices = s * np.stack([solution.mass for solution in solutions])
            coupling = s * self._coupling[of]
            matrices += (coupling / (1.0 - s * self._inertia[of][:, None])) @ coupling.transpose(0, 2, 1)
            matrices = np.stack([solution.stiffness for solution in solutions]) - matrices
            return self.modulus * turned_both(self._rotations[part], matrices)

        return values


def _pieces(elements: Elements, highest: float, tolerance: float) -> list[_Piece]:
    """All S-elements of this rank; see `Pencil`."""
    alike: dict[tuple[int, int, int], list[_Kind]] = {}
    for group in elements.moving:
        for some in _of_one_size(group) if len(group.sizes) > 1 else [group]:
            modulus, scales = elements.scales(some)
            w2 = highest**2 * scales[0] / modulus
            coupling, inertia = reduced_fraction(some.solution, w2, tolerance, elements.terms)
            key = (group.material, len(coupling), len(inertia))
            alike.setdefault(key, []).append(_Kind(some, float(scales[0]), coupling, inertia))
    return [_Piece(elements, kinds) for kinds in alike.values()]


def _of_one_size(group: Group) -> list[Group]:
    """A group split by the sizes of its S-elements."""
    sizes = group.sizes
    order = np.argsort(sizes, kind="stable")
    breaks = np.flatnonzero(np.diff(sizes[order]) > 1e-9 * sizes[order][1:]) + 1
    return [group.select(rows) for rows in np.split(order, breaks)]


class CondensedSolve:
    """Python preconditioner of PETSc that applies (K - shift M)^-1 exactly.

    The auxiliary unknowns, diagonal in both matrices, are eliminated element by element; what is left is one
    linear solve over the displacement unknowns, configured under `prefix`; `what` names the solve in its
    error.
    """

    def __init__(self, pencil: Pencil, shift: float, prefix: str, what: str):
        self.pencil, self.shift, self.what = pencil, shift, what
        self.matrix = pencil.condensed(shift)
        solver = pencil.statics.kept_solver
        chosen = bool(PETSc.Options(prefix).getAll())
        definite = shift <= 0.0
        if definite and pencil.small and not chosen:
            self.ksp = make_ksp(self.matrix, prefix, small=True)
        elif shift == 0.0 and solver is not None and solver.factorised and solver.direct and not chosen:
            self.ksp = copy.copy(solver.ksp)  # the stiffness is factorised
        else:
            self.ksp = make_ksp(self.matrix, prefix, definite)
        # without a shift the lowest modes of slender structures need more digits than the assembled stiffness
        # has
        self.refinement = pencil.statics.refinement if shift == 0.0 else None
        self._solver = LinearSolver(self.ksp, self.matrix, self.refinement)
        self.diagonal = pencil.auxiliary_diagonal(shift)
        self.right, self.left = self.matrix.createVecs()
        if shift != 0.0:
            self.auxiliary = pencil.coupling.createVecRight()

    def apply(self, pc: PETSc.PC, right: PETSc.Vec, left: PETSc.Vec) -> None:
        """left = (K - shift M)^-1 right."""
        owned = self.pencil.owned
        source = right.array_r
        self.right.array = source[:owned]
        scaled = source[owned:] / self.diagonal
        if self.shift != 0.0:
            self.auxiliary.array = self.shift * scaled
            self.pencil.coupling.multAdd(self.auxiliary, self.right, self.right)
        self._solver.solve(self.right, self.left, self.what)
        if self.shift != 0.0:
            self.pencil.coupling.multTranspose(self.left, self.auxiliary)
            scaled = scaled + self.shift * self.auxiliary.array_r / self.diagonal
        target = left.array
        target[:owned] = self.left.array_r
        target[owned:] = scaled

    def nearer(self, right: np.ndarray, near: np.ndarray, enough: float) -> np.ndarray:
        """K^-1 of columns (local unknowns, k), where there is no shift, refined from what is near to it
        until corrections are so small. Collective.
        """
        owned = self.pencil.owned
        upper = self._solver.nearer(right[:owned], near[:owned], self.what, enough)
        return np.concatenate([upper, right[owned:] / self.diagonal[:, None]])

    def of_rows(self, rows: Rows, chosen: slice) -> np.ndarray:
        """(K - shift M)^-1 of the transposes of some rows, (local unknowns, k). Collective."""
        upper = self._solver.of_rows(rows, chosen, self.what)
        if self.shift == 0.0:
            return np.pad(upper, ((0, len(self.diagonal)), (0, 0)))
        follow = products(self.pencil.coupling, upper, transposed=True)
        follow *= self.shift / self.diagonal[:, None]
        return np.concatenate([upper, follow])

    def release(self) -> None:
        """Free the PETSc objects and let go of the pencil: PETSc may keep this context longer than it is of
        use.
        """
        comm = self.pencil.layout.comm
        if alone(comm):
            return
        if self.shift != 0.0:
            self.auxiliary.destroy()
        free(comm, self.ksp, self.right, self.left, self.matrix)
        give_back(self.pencil.layout.count)
        self.__dict__.clear()


def products(matrix: PETSc.Mat, columns: np.ndarray, transposed: bool = False) -> np.ndarray:
    """A matrix, or its transpose, times this rank's rows of columns, in Fortran's order. Collective."""
    given, found = matrix.createVecs()
    if transposed:
        given, found = found, given
    multiply = matrix.multTranspose if transposed else matrix.mult
    with freeing(matrix.comm.tompi4py(), given, found):
        result = np.empty((found.getLocalSize(), columns.shape[1]), order="F")
        for k, column in enumerate(columns.T):
            given.array = column
            multiply(given, found)
            result[:, k] = found.array_r
    return result


def is_small(layout: Layout) -> bool:
    """Whether a structure is small: a matter of caches, not of memory."""
    return layout.comm.size == 1 and layout.count <= _SMALL


def top_of_band(elements: Elements, count: int) -> float:
    """Estimate of the angular frequency of mode `count` by Weyl's law with its boundary term, rad/s.

    It only decides how many auxiliary unknowns are kept at first; the analysis checks it against what it
    finds, and begins anew where it is too low: a fifth more than the law makes that rare.
    """
    squares = [m.density / m.modulus / np.linalg.eigvalsh(m.elasticity) for m in elements.materials]
    slow, fast = max((float(part.max()), float(part.min())) for part in squares)
    a, b = (
        elements.layout.area * (slow + fast) / (4.0 * math.pi),
        elements.layout.perimeter * math.sqrt(slow) / (2.0 * math.pi),
    )
    return 1.2 * (math.sqrt(b * b + 4.0 * a * count) - b) / (2.0 * a)
