"""The stiffness of a structure on its supports: its matrix, its solver, and what refines the solves."""

from __future__ import annotations

import functools

import numpy as np

from ...errors import listed, wrong_input
from ...petsc import PETSc
from ...supports import Support
from ..elements.element_stiffness import Refinement
from ..elements.elements import Elements
from ..elements.shapes import add_forces
from ..supports import Springs, free_bodies, springs_of
from .assembly import ElementBlocks, assemble, assemble_by_ranks
from .demand import require_factor
from .static_solver import StaticSolver


class Stiffness:
    """K of S-elements on supports; its matrix and its factor are made when they are first asked for.

    Parameters
    ----------
    elements : Elements
    supports : tuple of Support
    columns : int
        Right-hand sides that contact may ask the factor for.

    Attributes
    ----------
    kept_solver : StaticSolver or None
        None until one is asked for.
    """

    def __init__(self, elements: Elements, supports: tuple[Support, ...], columns: int):
        self.elements, self.layout, self.supports = elements, elements.layout, supports
        self._columns = columns
        self._matrix: PETSc.Mat | None = None
        self.kept_solver: StaticSolver | None = None

    @property
    def matrix(self) -> PETSc.Mat:
        """K over the displacement unknowns, N/m; with the rigid-body motions as near null space for multigrid
        where every node has both unknowns or none. Collective.
        """
        if self._matrix is None:
            self._matrix = self._assembled()
        return self._matrix

    def _assembled(self) -> PETSc.Mat:
        layout = self.layout
        layout.require_unfreed()
        free = layout.part.unknowns >= 0
        blocks = all(layout.comm.allgather(bool((free[:, 0] == free[:, 1]).all())))
        matrix = assemble(layout.comm, layout.ranges, self._blocks(), block_size=2 if blocks else 1)
        if blocks:
            self._attach_rigid_motions(matrix, free)
        return matrix

    def by_ranks(self) -> PETSc.Mat:
        """K as a MATIS, each rank's S-elements apart; a new one, the caller's. Collective."""
        size = self.matrix.getBlockSize()
        matrix = assemble_by_ranks(self.layout.comm, self.layout.ranges, self._blocks(), size)
        if size == 2:
            matrix.setNearNullSpace(self.matrix.getNearNullSpace())
        return matrix

    def _blocks(self) -> list[ElementBlocks]:
        return self.elements.blocks() + self.spring_blocks()

    def spring_blocks(self) -> list[ElementBlocks]:
        """Those of the elastic supports."""
        return [
            ElementBlocks(numbers, numbers, spring.stiffness.__getitem__)
            for spring in self.springs
            for numbers in [self.layout.part.unknowns[spring.nodes].reshape(spring.stiffness.shape[:2])]
        ]

    @functools.cached_property
    def springs(self) -> list[Springs]:
        """Those of the elastic supports. Collective."""
        return springs_of(self.layout, self.elements.thickness, self.supports)

    def _attach_rigid_motions(self, matrix: PETSc.Mat, free: np.ndarray) -> None:
        part, own = self.layout.part, self.layout.owned
        places = matrix.createVecRight()
        owned = free & (part.unknowns >= own.start) & (part.unknowns < own.stop)
        places.array[part.unknowns[owned] - own.start] = part.coordinates[owned]
        motions = PETSc.NullSpace().createRigidBody(places)
        matrix.setNearNullSpace(motions)
        motions.destroy()
        places.destroy()

    @functools.cached_property
    def refinement(self) -> Refinement:
        """Refines solves with the stiffness where they need it."""
        return Refinement(self.elements, self._spring_forces, self.matrix)

    @property
    def solver(self) -> StaticSolver:
        """Factorised once, when it is asked for a solution (prefix ``static_``). Collective."""
        if self.kept_solver is None:
            require_factor(self.elements, self._columns)
            self.kept_solver = StaticSolver(self.matrix, self.refinement, self.by_ranks)
        return self.kept_solver

    def inner_forces(self, field: np.ndarray) -> np.ndarray:
        """(m, 2): this rank's part of the nodal forces that displacements (m, 2) of its nodes take, those of
        elastic supports included, N.
        """
        return self.elements.inner_forces(field) + self._spring_forces(field)

    def _spring_forces(self, field: np.ndarray) -> np.ndarray:
        forces = np.zeros_like(field)
        for spring in self.springs:
            add_forces(forces, spring.nodes, spring.stiffness, field)
        return forces

    # ------------------------------------------------------------------ whether it is definite
    @functools.cached_property
    def free_bodies(self) -> list[int]:
        """Rows of the layout's `bodies` that the supports leave a rigid-body motion. Collective."""
        return free_bodies(self.layout, self.supports)

    @property
    def supported(self) -> bool:
        """Whether the supports admit no rigid-body motion. Collective."""
        return not self.free_bodies

    def require_support(self, analysis: str) -> None:
        """Raise ValueError, on all ranks, if the supports admit a rigid-body motion."""
        if self.supported:
            return
        bodies = self.layout.bodies
        if len(self.free_bodies) < len(bodies):
            x, y = bodies[self.free_bodies[0]]
            raise wrong_input(
                f"{analysis} needs every body held against rigid-body motions, but of the "
                f"{len(bodies)} bodies that cracks cut the structure into the one around "
                f"({x:.4g}, {y:.4g}) m is held by contact alone; give it a support of its own, if "
                "need be weak springs, Support(edge set, x=..., y=...) in N/m^3"
            )
        held = listed(s.where for s in self.supports) if self.supports else "nothing"
        raise wrong_input(
            f"{analysis} needs a structure held against every rigid-body motion, but the supports "
            f"({held}) leave one free; clamp an edge set or add supports, such as the weak springs "
            "of a structure that hangs freely, Support(edge set, x=..., y=...) in N/m^3"
        )

    def destroy(self) -> None:
        """Free the matrix and its factor."""
        held, self.kept_solver, self._matrix = (self.kept_solver, self._matrix), None, None
        for item in held:
            if item is not None:
                item.destroy()
