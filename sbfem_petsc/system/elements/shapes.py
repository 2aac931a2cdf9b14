"""One computation for all similar S-elements, over all ranks."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from ...material import AnyMaterial, Material, SectorMaterials
from ...petsc import MPI, stage
from ...ranks.parallel import collective
from ...selement.coefficients import SElementError
from ...selement.congruence import placements, same_shape, shape_key
from ...selement.inertia import Inertia, Moments
from ...selement.sectors import Sectors
from ...selement.solution import STACK, Begun, SElement, begun, inertia_of_stack, solve_selement, solve_stack
from ..layout.partition import Part

_Given = TypeVar("_Given")
_Found = TypeVar("_Found")
# S-elements that are placed at a time.
_BATCH = 4096
# How many times longer an S-element takes that is not solved with others.
_ALONE = 3


@dataclass(frozen=True, eq=False)
class Group:
    """S-elements of one rank that share a non-dimensional solution.

    Attributes
    ----------
    solution : SElement
    shape : (nodes, 2) array
        Reference coordinates.
    order : int
    closed : bool
    material : int
        Index of the material.
    elements : (k,) int array
        Rows of the rank's `Part`.
    nodes : (k, nodes) int array
        Nodes in the order of the reference shape, as rows of the part's nodes.
    sizes : (k,) array
        m.
    rotations : (k, 2, 2) array
        From the element's frame to the reference frame.
    """

    solution: SElement
    shape: np.ndarray
    order: int
    closed: bool
    material: int
    elements: np.ndarray
    nodes: np.ndarray
    sizes: np.ndarray
    rotations: np.ndarray

    def select(self, rows: np.ndarray | slice) -> Group:
        """The group reduced to some of its S-elements."""
        return replace(
            self,
            elements=self.elements[rows],
            nodes=self.nodes[rows],
            sizes=self.sizes[rows],
            rotations=self.rotations[rows],
        )

    def turned(self, matrix: np.ndarray) -> np.ndarray:
        """(n, m) matrix whose rows are vectors of the reference frame -> (k, n, m) in each element's frame:
        R^T matrix.
        """
        return turned(self.rotations, matrix[None])

    def turned_both(self, matrix: np.ndarray) -> np.ndarray:
        """(n, n) symmetric matrix of the reference frame -> (k, n, n): R^T matrix R."""
        return turned_both(self.rotations, matrix[None])


def turned_both(rotations: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """R^T matrix R of (k, 2, 2) rotations and (k, n, n) symmetric matrices, or one of these for all."""
    half = turned(rotations, matrices)
    return turned(rotations, half.transpose(0, 2, 1))


def turned(rotations: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """R^T matrix of (k, 2, 2) rotations and (k, n, m) matrices, or one of these for all."""
    count, n, m = matrices.shape
    pairs = matrices.reshape(count, n // 2, 2, m)
    return np.matmul(rotations.transpose(0, 2, 1)[:, None], pairs).reshape(len(rotations), n, m)


def add_forces(forces: np.ndarray, nodes: np.ndarray, stiffness: np.ndarray, field: np.ndarray) -> None:
    """Add to nodal forces (m, 2, ...) those of stiffnesses (k, 2 n, 2 n) between nodes (k, n) that have the
    displacements of a field (m, 2, ...).
    """
    pulled = stiffness @ field[nodes].reshape(*stiffness.shape[:2], math.prod(field.shape[2:]))
    np.add.at(forces, nodes, pulled.reshape(*nodes.shape, *field.shape[1:]))


@dataclass(frozen=True, eq=False)
class _Request:
    key: bytes
    shape: np.ndarray
    closed: bool
    material: int
    tolerance: float
    label: str


# Poisson's ratio in plane strain beyond which S-elements lose digits by it, some of order 1 and 2 and tips of
# order 8 at .499999; at .49999 none of 44 plates with cracks of eleven shapes did.
_NEARLY = 0.49999


def incompressible(material: AnyMaterial) -> str:
    """What an error of an S-element says of a material that all but keeps its volume, else nothing."""
    parts = material.parts if isinstance(material, SectorMaterials) else (material,)
    strained = [one.poisson for one in parts if isinstance(one, Material) and one.plane == "strain"]
    if max(strained, default=0.0) <= _NEARLY:
        return ""
    return (
        f"; or give a poisson of at most {_NEARLY:g}: with {max(strained):.10g} the material is all but "
        "incompressible"
    )


@stage("S-elements")
def solve_groups(
    comm: MPI.Comm, part: Part, order: int, materials: Sequence[AnyMaterial]
) -> tuple[list[Group], Solutions]:
    """Group the rank's S-elements by shape and compute the stiffness of each shape once on one of the ranks.

    Returns
    -------
    groups : list of Group
    solutions : Solutions

    Raises
    ------
    SElementError
        On all ranks, naming the element and its scaling centre.
    """
    buckets = _similar(part, order, materials)
    solutions = Solutions(comm, [bucket[0] for bucket in buckets], order, materials)
    groups = []
    for (request, *placed), solution in zip(buckets, solutions.stiffness()):
        elements = np.array([i for i, _ in placed])
        groups.append(
            Group(
                solution,
                request.shape,
                order,
                request.closed,
                request.material,
                elements,
                np.stack([part.chains[i][p.permutation] for i, p in placed]),
                np.array([p.size for _, p in placed]),
                np.stack([p.rotation for _, p in placed]),
            )
        )
    return groups, solutions


def _similar(part: Part, order: int, materials: Sequence[AnyMaterial]) -> list[list]:
    """The rank's S-elements by shape: of each a request, then (row, placement) of those that have it."""
    members: dict[bytes, list[list]] = {}
    kinds: dict[tuple, list[int]] = {}
    for i, chain in enumerate(part.chains):
        kinds.setdefault((len(chain), bool(part.closed[i]), int(part.materials[i])), []).append(i)
    noise = 8.0 * np.finfo(float).eps * (np.abs(part.coordinates).max() if len(part.coordinates) else 0.0)
    # a batch at a time: every outline is turned to each of its vertices
    batches = [
        (closed, material, rows[first : first + _BATCH])
        for (_, closed, material), rows in kinds.items()
        for first in range(0, len(rows), _BATCH)
    ]
    for closed, material, rows in batches:
        outlines = part.coordinates[np.stack([part.chains[i] for i in rows])] - part.centres[rows][:, None]
        for i, placement in zip(rows, placements(outlines, order, closed, materials[material].isotropic)):
            tolerance = float(1e-11 + noise / placement.size)
            key = shape_key(placement.shape) + bytes((closed,)) + material.to_bytes(4, "little")
            for bucket in members.setdefault(key, []):
                if same_shape(bucket[0].shape, placement.shape, max(tolerance, bucket[0].tolerance)):
                    break
            else:
                label = (
                    f"S-element {part.elements[i]} around ({part.centres[i][0]:.6g}, "
                    f"{part.centres[i][1]:.6g}) m"
                )
                bucket = [_Request(key, placement.shape, closed, material, tolerance, label)]
                members[key].append(bucket)
            bucket.append((i, placement))
    return [bucket for group in members.values() for bucket in group]


class Solutions:
    """Different shapes over the ranks of a communicator, each solved once: by a rank that has it, or by one
    that has less to do.

    Parameters
    ----------
    comm : Comm
    requests : list of _Request
        This rank's shapes.
    order : int
    materials : sequence of Material

    Attributes
    ----------
    count : int
        Number of different shapes over all ranks.
    """

    def __init__(
        self, comm: MPI.Comm, requests: list[_Request], order: int, materials: Sequence[AnyMaterial]
    ):
        self.comm, self.order, self.materials = comm, order, materials
        self._owners = _solvers(comm, requests, [self._at_once(request) for request in requests])
        outgoing: list[list[_Request]] = [[] for _ in range(comm.size)]
        for request, owner in zip(requests, self._owners):
            outgoing[owner].append(request)
        incoming = _exchanged(comm, outgoing)
        # the different shapes that this rank solves, and which of them each rank has asked for
        self._shapes: list[_Request] = []
        self._solved: list[SElement] = []
        self._begun: list[Begun] = []
        self._known: dict[bytes, list[int]] = {}
        self._asked = [[self._number(request) for request in batch] for batch in incoming]
        self.count = comm.allreduce(len(self._shapes))

    def _number(self, request: _Request) -> int:
        """Row of the shape among those of this rank, a new one if it is met for the first time."""
        known = self._known.setdefault(request.key, [])
        for number in known:
            shape = self._shapes[number]
            if same_shape(shape.shape, request.shape, max(shape.tolerance, request.tolerance)):
                return number
        known.append(len(self._shapes))
        self._shapes.append(request)
        return known[-1]

    def stiffness(self) -> list[SElement]:
        """The S-element of each of this rank's requests, without inertia. Collective."""

        def solve(request: _Request) -> SElement:
            material = self.materials[request.material]
            return solve_selement(
                Sectors(request.shape, self.order, material.elasticity),
                request.closed,
                density=material.densities,
            )

        def solve_all(requests: list[_Request]) -> list[SElement | None]:
            material = self.materials[requests[0].material]
            shapes = np.stack([request.shape for request in requests])
            stack = Sectors(shapes, self.order, material.elasticity)
            start = begun(stack)
            if len(self._shapes) <= STACK:  # of more it would take several times their stiffness' memory
                self._begun.append(start)
            return solve_stack(stack, start)

        self._solved = self._of_each(self._shapes, solve_all, solve)
        return self._sent_back(self._solved)

    @stage("Inertia")
    def inertia(self, terms: int) -> list[Inertia | Moments]:
        """Mass and continued fraction of each of this rank's requests. Collective."""

        starts, self._begun = iter(self._begun), []  # all at once: what is interrupted is begun anew

        def solve_all(solved: list[SElement]) -> list[Inertia | Moments | None]:
            return inertia_of_stack(solved, terms, next(starts, None))

        def solve(solved: SElement) -> Inertia | Moments:
            dynamics = solved.with_inertia(terms).dynamics
            assert dynamics is not None  # `with_inertia` has just made them
            return dynamics

        return self._sent_back(self._of_each(self._solved, solve_all, solve))

    def _of_each(
        self,
        given: Sequence[_Given],
        solve_all: Callable[[list[_Given]], list[_Found | None]],
        solve: Callable[[_Given], _Found],
    ) -> list[_Found]:
        """What is found from what is given of each of this rank's shapes: of a stack of closed ones of one
        material at once, and one by one of what that leaves. What is raised names the S-element, on all
        ranks. Collective.
        """
        found: dict[int, _Found | None] = {}
        with collective(self.comm):
            for rows in self._stacks():
                found |= zip(rows, solve_all([given[row] for row in rows]))
            for row, request in enumerate(self._shapes):
                try:
                    found[row] = found.get(row) or solve(given[row])
                except SElementError as error:
                    cause = incompressible(self.materials[request.material])
                    raise SElementError(f"{request.label}: {error}{cause}") from None
        return [one for _, one in sorted(found.items()) if one is not None]

    def _at_once(self, request: _Request) -> bool:
        """Whether a shape can be solved with others."""
        return request.closed and self.materials[request.material].elasticity.ndim == 2

    def _stacks(self) -> Iterator[list[int]]:
        """Rows of this rank's shapes that can be solved at once."""
        alike: dict[tuple[int, int], list[int]] = {}
        for row, request in enumerate(self._shapes):
            if self._at_once(request):
                alike.setdefault((len(request.shape), request.material), []).append(row)
        for rows in alike.values():
            for first in range(0, len(rows), STACK):
                yield rows[first : first + STACK]

    def _sent_back(self, found: list) -> list:
        """Answers to this rank's requests, from what each rank has found for its own shapes."""
        answers = [[found[number] for number in batch] for batch in self._asked]
        queues = [iter(batch) for batch in _exchanged(self.comm, answers)]
        return [next(queues[owner]) for owner in self._owners]


def _solvers(comm: MPI.Comm, requests: list[_Request], at_once: list[bool]) -> list[int]:
    """Rank that solves each of this rank's shapes. Collective.

    Of all shapes every rank knows a digest and a cost, and finds the same. Where two shapes share a digest,
    the rank that solves them tells them apart.
    """
    made = [hashlib.blake2b(request.key, digest_size=8).digest() for request in requests]
    digests = [int.from_bytes(digest, "little") >> 1 for digest in made]
    costs = [len(r.shape) ** 3 * (1 if alike else _ALONE) for r, alike in zip(requests, at_once)]
    parts = comm.allgather(np.array([digests, costs], dtype=np.int64))
    digest, cost = np.concatenate(parts, axis=1)
    holder = np.repeat(np.arange(comm.size), [part.shape[1] for part in parts])
    return shared_out(digest, cost, holder, comm.size)[holder == comm.rank].tolist()


def shared_out(digest: np.ndarray, cost: np.ndarray, holder: np.ndarray, ranks: int) -> np.ndarray:
    """(n,): rank that solves each of n shapes, which ranks hold, those of one digest once: one that holds it,
    or one that has less to do than others.
    """
    distinct, first, which, counts = np.unique(
        digest, return_index=True, return_inverse=True, return_counts=True
    )
    ends, cost = np.cumsum(counts), cost[first]
    worker = holder[np.argsort(which, kind="stable")[ends - counts + distinct % counts]]
    load = np.bincount(worker, cost, ranks)
    # of a rank's shapes one after the other those beyond the mean go to ranks below it
    order, mean = np.argsort(worker, kind="stable"), load.sum() / ranks
    middle = np.cumsum(cost[order]) - 0.5 * cost[order] - (np.cumsum(load) - load)[worker[order]]
    left = order[middle > mean]
    room = np.cumsum(np.maximum(mean - load, 0.0))
    places = np.searchsorted(room, np.cumsum(cost[left]) - 0.5 * cost[left])
    worker[left] = np.minimum(places, ranks - 1)
    return worker[which]


def _exchanged(comm: MPI.Comm, outgoing: list[list]) -> list[list]:
    """What each rank has for this one; its own as it is, without a copy. Collective."""
    own, outgoing[comm.rank] = outgoing[comm.rank], []
    incoming = comm.alltoall(outgoing) if comm.size > 1 else [[]]
    incoming[comm.rank] = own
    return incoming
