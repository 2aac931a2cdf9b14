"""The stiffness of a structure on its supports: its matrix, its solver, and what refines the solves."""

from __future__ import annotations

import functools

import numpy as np
from scipy import linalg

from meshing.warnings import RoundOffWarning

from ...errors import listed, warn, wrong_input
from ...petsc import PETSc
from ...selement.rigid_motions import rigid_motions
from ...supports import Support
from ..elements.element_stiffness import ROUND_OFF, Refinement
from ..elements.elements import Elements
from ..elements.shapes import add_forces
from ..supports import Springs, free_bodies, springs_of
from .assembly import ElementBlocks, assemble, assemble_by_ranks
from .demand import require_factor
from .static_solver import StaticSolver

# Share of the round-off of the matrix times the deformation that turns or moves a body as a whole.
_AS_A_WHOLE = 1.0 / 30.0


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
            layout = self.layout
            layout.require_unfreed()
            free = layout.part.unknowns >= 0
            blocks = all(layout.comm.allgather(bool((free[:, 0] == free[:, 1]).all())))
            self._matrix = assemble(layout.comm, layout.ranges, self._blocks(), block_size=2 if blocks else 1)
            if blocks:
                self._attach_rigid_motions(self._matrix, free)
        return self._matrix

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
        """(m, 2, ...): this rank's part of the nodal forces that displacements (m, 2, ...) of its nodes take,
        those of elastic supports included, N.
        """
        return self.elements.inner_forces(field) + self._spring_forces(field)

    def _spring_forces(self, field: np.ndarray) -> np.ndarray:
        forces = np.zeros(field.shape)
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

    # ------------------------------------------------------------------ what springs hardly hold
    @functools.cached_property
    def _rigid(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Rigid-body motions (owned, 3 a body), their inner products, and the least stiffness against one,
        N/m, what is held fixed counted as stiff as the matrix is. Collective.
        """
        layout, part, bodies = self.layout, self.layout.part, np.array(self.layout.bodies)
        size = float(np.linalg.norm(layout.extent[1] - layout.extent[0]))
        motions = np.zeros((len(part.nodes), 2, len(bodies), 3))
        places = (part.coordinates - bodies[part.bodies]) / size
        motions[np.arange(len(places)), :, part.bodies] = rigid_motions(places).reshape(-1, 2, 3)
        motions = motions.reshape(len(places), 2, 3 * len(bodies))
        fixed, owned = motions[part.unknowns < 0], layout.owned_values(motions)
        borne = np.einsum("nik,nil->kl", motions, self._spring_forces(motions))
        still, alike, borne = layout.comm.allreduce(np.array([fixed.T @ fixed, owned.T @ owned, borne]))
        stiff = self.refinement.scale / np.finfo(float).eps
        return owned, still + alike, float(linalg.eigvalsh(borne + stiff * still, still + alike)[0])

    def judge(self, analysis: str, owned: np.ndarray) -> None:
        """Warn where springs hold a body so softly that what rounding leaves of loads in balance moves it as
        a whole: displacements then lose digits that stresses have. Collective.

        Warns
        -----
        RoundOffWarning
        """
        if not any(np.any(support.springs) for support in self.supports):
            return
        motions, products, least = self._rigid
        whole = np.linalg.solve(products, self.layout.comm.allreduce(motions.T @ owned))
        parts = np.array([owned @ owned, np.sum((owned - motions @ whole) ** 2)])
        size, deformation = np.sqrt(self.layout.comm.allreduce(parts))
        moved, held = _AS_A_WHOLE * self.refinement.scale * deformation, max(least, 0.0) * size
        if moved > ROUND_OFF * held:
            told = f"{moved / held:.0e}" if moved < 0.1 * held else "more than a tenth"
            warn(
                f"{analysis}: springs hold a body so softly that the rounding of loads in balance moves or "
                f"turns it as a whole, and displacements may be off by {told} of themselves, though stresses "
                "are not; make the springs stiffer, or clamp a point",
                RoundOffWarning,
            )

    def destroy(self) -> None:
        """Free the matrix and its factor."""
        held, self.kept_solver, self._matrix = (self.kept_solver, self._matrix), None, None
        for item in held:
            if item is not None:
                item.destroy()
