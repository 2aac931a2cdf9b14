"""The discrete structure: S-elements on their ranks, numbered unknowns, stiffness, loads, contact rows,
fields.
"""

from __future__ import annotations

import copy
import functools
import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from meshing.boundary_mesh import BoundaryMesh

from ..contact.friction import refuse_friction
from ..contact.law import ContactLaw
from ..errors import SolveError, listed, on_all_ranks
from ..loads import Loads, as_loads
from ..material import AnyMaterial, Material, OrthotropicMaterial, SectorMaterials
from ..petsc import MPI, PETSc, require_thread
from ..ranks.parallel import alone, collective
from ..supports import Support
from .boundary import LoadColumns, NodalForces, free_bodies, load_columns, spring_blocks
from .contact.gap_operator import GapOperator, gap_operator
from .elements.element_stiffness import Refinement
from .elements.shapes import Group, solve_groups, turned_both
from .fields.fracture import TStressForm, t_stress_forms
from .fields.places import Places, places
from .fields.reactions import SupportForces
from .fields.tip_faces import TipFaces, tip_faces, tip_gaps, tip_rows
from .fields.tips import TipIntensities, TipPlace, tip_intensities, tip_places
from .layout.distribution import distribute
from .layout.rows import Rows
from .solve.assembly import ElementBlocks, assemble, assemble_by_ranks
from .solve.static_solver import Compliance, StaticSolver


class Named(NamedTuple):
    """What a mesh knows by name alone.

    Attributes
    ----------
    materials : callable
        Materials in the order of the mesh's names, which it is given.
    contact_laws : callable
        Dict of the law of each crack by its name, from the names of the cracks.
    """

    materials: Callable
    contact_laws: Callable


class Numbers(NamedTuple):
    """What a structure is computed with.

    Attributes
    ----------
    continued_fraction : int
        Its terms.
    thickness : float
        m.
    tip_modes : int
        Polynomials of the pressure on the faces inside each tip element.
    """

    continued_fraction: int
    thickness: float
    tip_modes: int


def _around(parts: tuple[Material | OrthotropicMaterial, ...]) -> AnyMaterial:
    """The material of an S-element from that of each edge's sector: materials of two names may be one."""
    return SectorMaterials(parts) if len(set(parts)) > 1 else parts[0]


class Ghosts(NamedTuple):
    """Scatter from the distributed displacement unknowns to those of this rank's nodes.

    Attributes
    ----------
    scatter : Scatter
    source, target : Vec
        All unknowns, and those of this rank's nodes.
    free : (m, 2) array
        False where held fixed.
    """

    scatter: PETSc.Scatter
    source: PETSc.Vec
    target: PETSc.Vec
    free: np.ndarray


class Structure:
    """A distributed structure of S-elements and its operators; `Model` is what a user sees of it.

    Parameters
    ----------
    comm : Comm
    mesh : BoundaryMesh or None
    supports : tuple of Support
    named : Named
    numbers : Numbers
    """

    def __init__(
        self,
        comm: MPI.Comm,
        mesh: BoundaryMesh | None,
        supports: tuple[Support, ...],
        named: Named,
        numbers: Numbers,
    ):
        self.comm, self.supports = comm, supports
        self.continued_fraction, self.thickness, self.tip_modes = numbers
        # what is made when it is first asked for and outlives no `destroy`, and the response to unit contact
        # forces, which is not made where larger problems are solved without it
        self._freed = False
        self._matrix: PETSc.Mat | None = None
        self._scatter: Ghosts | None = None
        self.kept_solver: StaticSolver | None = None
        self.kept_compliance: Compliance | None = None
        found = distribute(comm, mesh, supports)
        self.order, self.elements, self.part, self.ranges = (
            found.order,
            found.elements,
            found.part,
            found.ranges,
        )
        self.points, self.cracks, self.pairs, self.pair_unknowns = (
            found.points,
            found.cracks,
            found.pairs,
            found.pair_unknowns,
        )
        self._compositions = found.compositions
        self.edge_set_names, self.material_names = found.edge_sets, found.material_names
        self.bodies = found.bodies
        self.extent, self.area, self.perimeter = found.extent, found.area, found.perimeter
        self.tip_elements = found.tip_elements
        self.boundary_unknowns = int(self.ranges[-1])
        with collective(comm):
            materials = named.materials(self.material_names)
            sectors = [_around(tuple(materials[k] for k in parts)) for parts in found.compositions]
            self.materials: list[AnyMaterial] = [*materials, *sectors]
            self._contact_laws = named.contact_laws(tuple(crack.name for crack in self.cracks))
            if self.boundary_unknowns == 0:
                raise ValueError(
                    f"Model: the supports ({listed(s.where for s in supports)}) leave no free displacement"
                )
        self.groups, self._solutions = solve_groups(comm, self.part, self.order, self.materials)
        self.shapes = self._solutions.count
        # a term of the continued fraction has as many unknowns as the S-element's boundary
        auxiliary = self.continued_fraction * sum(2 * group.nodes.size for group in self.groups)
        self.unknowns = self.boundary_unknowns + comm.allreduce(auxiliary)

    @property
    def contact_laws(self) -> Mapping[str, ContactLaw]:
        """Of the cracks, by name; other laws are of another model, for what is computed is kept."""
        return MappingProxyType(self._contact_laws)

    @property
    def owned(self) -> slice:
        """Numbers of the displacement unknowns that this rank owns."""
        return slice(int(self.ranges[self.comm.rank]), int(self.ranges[self.comm.rank + 1]))

    def named_materials(self, number: int) -> tuple[int, ...]:
        """Indices into `material_names` of an entry of `materials`: one, or that of each edge's sector."""
        count = len(self.material_names)
        return (number,) if number < count else self._compositions[number - count]

    # ------------------------------------------------------------------ matrices
    @functools.cached_property
    def moving_groups(self) -> list[Group]:
        """The groups with mass and continued fraction, computed when the first analysis asks. Collective."""
        found = self._solutions.inertia(self.continued_fraction)
        return [
            replace(group, solution=replace(group.solution, dynamics=inertia))
            for group, inertia in zip(self.groups, found)
        ]

    def unknowns_of(self, group: Group) -> np.ndarray:
        """(k, n) unknowns of the S-elements of a group, -1 where held fixed."""
        return self.part.unknowns[group.nodes].reshape(len(group.sizes), -1)

    def scales(self, group: Group) -> tuple[float, np.ndarray]:
        """Stiffness scale E t (N/m) and inertia scale rho h^2 t (kg), (k,)."""
        material = self.materials[group.material]
        return material.modulus * self.thickness, material.density * group.sizes**2 * self.thickness

    @property
    def stiffness(self) -> PETSc.Mat:
        """K over the displacement unknowns, N/m; with the rigid-body motions as near null space for multigrid
        where every node has both unknowns or none.
        """
        if self._matrix is None:
            self._matrix = self._assembled()
        return self._matrix

    def _assembled(self) -> PETSc.Mat:
        if self._freed:
            raise SolveError("Model: it has been destroyed; make it again, or use it inside its `with` block")
        free = self.part.unknowns >= 0
        blocks = all(self.comm.allgather(bool((free[:, 0] == free[:, 1]).all())))
        matrix = assemble(self.comm, self.ranges, self._all_blocks(), block_size=2 if blocks else 1)
        if blocks:
            self._attach_rigid_motions(matrix, free)
        return matrix

    def stiffness_by_ranks(self) -> PETSc.Mat:
        """K as a MATIS, each rank's S-elements apart; a new one, the caller's. Collective."""
        size = self.stiffness.getBlockSize()
        matrix = assemble_by_ranks(self.comm, self.ranges, self._all_blocks(), size)
        if size == 2:
            matrix.setNearNullSpace(self.stiffness.getNearNullSpace())
        return matrix

    def _all_blocks(self) -> list[ElementBlocks]:
        alike = itertools.groupby(self.groups, key=lambda group: (group.material, len(group.shape)))
        return [self._stiffness_blocks(list(groups)) for _, groups in alike] + self.spring_blocks()

    def _stiffness_blocks(self, groups: list[Group]) -> ElementBlocks:
        """Those of S-elements of one material and one number of nodes, of however many shapes: what is done
        for each of them at a time takes longer than its numbers.
        """
        nodes = np.concatenate([group.nodes for group in groups])
        rotations = np.concatenate([group.rotations for group in groups])
        of_element = np.repeat(np.arange(len(groups)), [len(group.sizes) for group in groups])
        unknowns, scale = self.part.unknowns[nodes].reshape(len(nodes), -1), self.scales(groups[0])[0]

        def values(part: slice) -> np.ndarray:
            matrices = np.stack([groups[k].solution.stiffness for k in of_element[part]])
            return scale * turned_both(rotations[part], matrices)

        return ElementBlocks(unknowns, unknowns, values)

    def spring_blocks(self) -> list[ElementBlocks]:
        """Those of the elastic supports."""
        return spring_blocks(self)

    def _attach_rigid_motions(self, matrix: PETSc.Mat, free: np.ndarray) -> None:
        places = matrix.createVecRight()
        owned = free & (self.part.unknowns >= self.owned.start) & (self.part.unknowns < self.owned.stop)
        places.array[self.part.unknowns[owned] - self.owned.start] = self.part.coordinates[owned]
        motions = PETSc.NullSpace().createRigidBody(places)
        matrix.setNearNullSpace(motions)
        motions.destroy()
        places.destroy()

    @functools.cached_property
    def refinement(self) -> Refinement:
        """Refines solves with the stiffness where they need it."""
        return Refinement(self, self.stiffness)

    # ------------------------------------------------------------------ loads and supports
    def load_columns(self, loads: Iterable) -> LoadColumns:
        """What several constant loads do, one column each. Collective.

        Raises
        ------
        KeyError, ValueError, TypeError
            If a point or edge set does not exist or a component is not finite.
        """
        loads = list(loads)
        with collective(self.comm):
            for load in loads:
                self.checked_loads(load)
        return load_columns(self, loads)

    def checked_loads(self, load: Any, constant: bool = True) -> Loads:
        """The loads, each with an existing place and finite components, or signals unless `constant`."""
        loads = as_loads(load)
        places = NodalForces(self, None)
        for item in loads.parts:
            item.check(places, constant)
        return loads

    @functools.cached_property
    def free_bodies(self) -> list[int]:
        """Rows of `bodies` that the supports leave a rigid-body motion. Collective."""
        return free_bodies(self)

    @property
    def supported(self) -> bool:
        """Whether the supports admit no rigid-body motion. Collective."""
        return not self.free_bodies

    def require_support(self, analysis: str) -> None:
        """Raise ValueError, on all ranks, if the supports admit a rigid-body motion."""
        if not self.supported:
            if len(self.free_bodies) < len(self.bodies):
                x, y = self.bodies[self.free_bodies[0]]
                raise on_all_ranks(
                    ValueError(
                        f"{analysis} needs every body held against rigid-body motions, but of the "
                        f"{len(self.bodies)} bodies that cracks cut the structure into the one around "
                        f"({x:.4g}, {y:.4g}) m is held by contact alone; give it a support of its own, if "
                        "need be weak springs, Support(edge set, x=..., y=...) in N/m^3"
                    )
                )
            held = listed(s.where for s in self.supports) if self.supports else "nothing"
            raise on_all_ranks(
                ValueError(
                    f"{analysis} needs a structure held against every rigid-body motion, but the supports "
                    f"({held}) leave one free; clamp an edge set or add supports, such as the weak springs "
                    "of a structure that hangs freely, Support(edge set, x=..., y=...) in N/m^3"
                )
            )

    @functools.cached_property
    def held(self) -> Structure:
        """The same with what supports hold fixed in the place of the displacement unknowns: its rows are
        those of prescribed displacements; it has no matrices. Collective.
        """
        result = copy.copy(self)
        for name in ("gap_operator", "point_rows", "tips", "held"):
            result.__dict__.pop(name, None)
        part, comm = self.part, self.comm
        mine = np.argwhere(part.unknowns < 0)
        keys = [2 * part.nodes[row] + k for row, k in mine]
        # each belongs to the lowest rank that touches it
        owners: dict[int, int] = {}
        for rank, others in enumerate(comm.allgather(keys)):
            owners |= {key: rank for key in others if key not in owners}
        ordered = sorted(owners, key=lambda key: (owners[key], key))
        number = {key: k for k, key in enumerate(ordered)}
        counts = np.bincount(list(owners.values()), minlength=comm.size)
        result.ranges = np.concatenate([[0], np.cumsum(counts)])
        unknowns = np.full_like(part.unknowns, -1)
        unknowns[tuple(mine.T)] = [number[key] for key in keys]
        result.part = replace(part, unknowns=unknowns)

        def of(node: int) -> tuple[int, int]:
            return number.get(2 * node, -1), number.get(2 * node + 1, -1)

        result.points = {name: (at, of(node), node) for name, (at, _, node) in self.points.items()}
        pairs = [of(int(node)) for node in self.pairs.nodes.ravel()]
        result.pair_unknowns = np.array(pairs, dtype=int).reshape(-1, 2, 2)
        return result

    # ------------------------------------------------------------------ contact and outputs
    def require_frictionless(self, owner: str, why: str = "knows no friction yet") -> None:
        """Raise ValueError, on all ranks, where faces rub."""
        rubbing = [name for name, law in self.contact_laws.items() if law.rubs]
        if rubbing:
            refuse_friction(owner, f"{listed(rubbing)} has the law {self.contact_laws[rubbing[0]]!r}", why)

    @functools.cached_property
    def point_holders(self) -> dict[str, list[int]]:
        """Ranks whose S-elements touch each named point. Collective."""
        held = [name for name, (_, _, node) in self.points.items() if (self.part.nodes == node).any()]
        everywhere = self.comm.allgather(held)
        return {name: [r for r, names in enumerate(everywhere) if name in names] for name in self.points}

    @functools.cached_property
    def pair_rows(self) -> np.ndarray:
        """(pairs, 2): both nodes of each pair among this rank's, -1 where a lower rank touches them, or this
        one does not. Collective.
        """
        nodes, mine, comm = self.pairs.nodes.reshape(-1, 2), self.part.nodes, self.comm
        lowest = np.where(np.isin(nodes, mine), comm.rank, comm.size)
        comm.Allreduce(MPI.IN_PLACE, lowest, MPI.MIN)
        return np.where(lowest == comm.rank, np.searchsorted(mine, nodes), -1)

    @functools.cached_property
    def tip_places(self) -> list[TipPlace]:
        """The tip elements that this rank holds."""
        return tip_places(self)

    @functools.cached_property
    def t_stress_forms(self) -> list[TStressForm]:
        """T-stress of the tips that this rank holds and that have one."""
        return t_stress_forms(self)

    @functools.cached_property
    def support_forces(self) -> SupportForces:
        """Forces of the supports. Collective."""
        return SupportForces(self)

    @functools.cached_property
    def tip_gaps(self) -> np.ndarray:
        """(tips, 2): initial gaps at each tip and on the boundary of its S-element, m. Collective."""
        return tip_gaps(self)

    @functools.cached_property
    def tip_rows(self) -> np.ndarray:
        """(tips + 1,): first contact row of each tip element, and the number of all contact rows.
        Collective.
        """
        return tip_rows(self)

    @functools.cached_property
    def tip_faces(self) -> list[TipFaces]:
        """Traction modes on the faces inside the tip elements that this rank holds. Collective."""
        return tip_faces(self)

    @functools.cached_property
    def gap_operator(self) -> GapOperator:
        """Contact rows."""
        return gap_operator(self)

    @functools.cached_property
    def point_rows(self) -> Rows:
        """x and y displacement of each named point, two rows a point."""
        one = np.ones(1)
        unknowns = [np.array([u]) for _, place, _ in self.points.values() for u in place]
        return Rows.of(self.comm, self.ranges, [(u, one) for u in unknowns])

    @functools.cached_property
    def tips(self) -> TipIntensities:
        """Stress intensity factors of the crack tips. Collective."""
        return tip_intensities(self)

    @functools.cached_property
    def element_boxes(self) -> np.ndarray:
        """(elements, 4): least and greatest x and y of this rank's S-elements, their scaling centres
        included, m.
        """
        boxes = []
        for chain, centre in zip(self.part.chains, self.part.centres):
            places = np.vstack([self.part.coordinates[chain], centre])
            boxes.append([*places.min(axis=0), *places.max(axis=0)])
        return np.array(boxes).reshape(-1, 4)

    def places(self, points: list[tuple[float, float]], inertia: bool = False, moved: bool = False) -> Places:
        """Forms of displacement and stress at points (m), with what inertia adds inside S-elements, and what
        supports that move do, if it is asked for. Collective.
        """
        return places(self, points, inertia, moved)

    def at_points(self, owned: np.ndarray) -> dict[str, np.ndarray]:
        """Displacement of every named point, on all ranks. Collective.

        Parameters
        ----------
        owned : (k,) or (k, n) array
            This rank's displacement unknowns, of one field or of n fields.

        Returns
        -------
        dict of str to (2,) or (n, 2) array
        """
        table = self.point_rows(owned).reshape(len(self.points), 2, *owned.shape[1:])
        return dict(zip(self.points, np.moveaxis(table, 1, -1)))

    @property
    def _ghosts(self) -> Ghosts:
        if self._scatter is None:
            self._scatter = self._make_ghosts()
        return self._scatter

    def _make_ghosts(self) -> Ghosts:
        needed = self.part.unknowns[self.part.unknowns >= 0].astype(PETSc.IntType)
        places = PETSc.IS().createGeneral(needed, comm=PETSc.COMM_SELF)
        target = PETSc.Vec().createSeq(len(needed))
        source = self.stiffness.createVecRight()
        scatter = PETSc.Scatter().create(source, places, target, None)
        places.destroy()
        return Ghosts(scatter, source, target, self.part.unknowns >= 0)

    def nodal(self, owned: np.ndarray) -> np.ndarray:
        """Displacements (m, 2) of this rank's nodes from its displacement unknowns; 0 where held fixed.
        Collective.
        """
        require_thread()
        scatter, source, target, free = self._ghosts
        source.array = owned
        scatter.scatter(source, target)
        result = np.zeros(self.part.unknowns.shape)
        result[free] = target.array_r
        return result

    def summed_nodal(self, forces: np.ndarray) -> np.ndarray:
        """(owned,): sums over the ranks of forces (m, 2) on this rank's nodes, on its displacement unknowns.
        Collective.
        """
        require_thread()
        scatter, source, target, free = self._ghosts
        target.array = forces[free]
        source.set(0.0)
        scatter.scatter(target, source, addv=True, mode=PETSc.ScatterMode.REVERSE)
        return source.array_r.copy()

    def destroy(self) -> None:
        """Free the PETSc objects now instead of at garbage collection, which ranks reach at different
        times.
        """
        if alone(self.comm):
            return
        self._freed = True
        held = [self.kept_solver, *(self._scatter or ())[:3], self._matrix]
        self.kept_solver = self._scatter = self._matrix = None
        for item in held:
            if item is not None:
                item.destroy()
