"""One computation for all similar S-elements, over all ranks."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np

from ..parallel import collective
from ..petsc import MPI
from ..selement.coefficients import SElementError
from ..selement.congruence import placements, same_shape, shape_key
from ..selement.solution import SElement, solve_selement
from .partition import Part


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

    def select(self, rows: np.ndarray) -> Group:
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
        nodes = len(self.shape)
        return np.matmul(self.rotations.transpose(0, 2, 1)[:, None], matrix.reshape(1, nodes, 2, -1)).reshape(
            len(self.sizes), 2 * nodes, -1
        )

    def turned_both(self, matrix: np.ndarray) -> np.ndarray:
        """(n, n) symmetric matrix of the reference frame -> (k, n, n): R^T matrix R."""
        half = self.turned(matrix)
        k, n, _ = half.shape
        nodes = len(self.shape)
        other = half.transpose(0, 2, 1).reshape(k, nodes, 2, n)
        return np.matmul(self.rotations.transpose(0, 2, 1)[:, None], other).reshape(k, n, n)


@dataclass(frozen=True, eq=False)
class _Request:
    shape: np.ndarray
    closed: bool
    material: int
    tolerance: float
    label: str


def solve_groups(comm: MPI.Comm, part: Part, order: int, materials, terms: int) -> tuple[list[Group], int]:
    """Group the rank's S-elements by shape and solve each shape once on one of the ranks.

    Returns
    -------
    groups : list of Group
    shapes : int
        Number of different shapes over all ranks.

    Raises
    ------
    SElementError
        On all ranks, naming the element and its scaling centre.
    """
    members: dict[bytes, list[list]] = {}
    batches: dict[tuple, list[int]] = {}
    for i, chain in enumerate(part.chains):
        batches.setdefault((len(chain), bool(part.closed[i]), int(part.materials[i])), []).append(i)
    noise = 8.0 * np.finfo(float).eps * (np.abs(part.coordinates).max() if len(part.coordinates) else 0.0)
    for (_, closed, material), elements in batches.items():
        outlines = np.stack([part.coordinates[part.chains[i]] - part.centres[i] for i in elements])
        for i, placement in zip(elements, placements(outlines, order, closed, materials[material].isotropic)):
            tolerance = 1e-11 + noise / placement.size
            key = shape_key(placement.shape) + bytes((closed,)) + material.to_bytes(4, "little")
            for bucket in members.setdefault(key, []):
                if same_shape(bucket[0].shape, placement.shape, max(tolerance, bucket[0].tolerance)):
                    break
            else:
                label = (
                    f"S-element {part.elements[i]} around ({part.centres[i][0]:.6g}, "
                    f"{part.centres[i][1]:.6g}) m"
                )
                bucket = [_Request(placement.shape, closed, material, tolerance, label)]
                members[key].append(bucket)
            bucket.append((i, placement))
    buckets = [(key, bucket) for key, group in members.items() for bucket in group]
    solutions, shapes = _solve_once(
        comm, [(key, bucket[0]) for key, bucket in buckets], order, materials, terms
    )
    groups = []
    for (_, bucket), solution in zip(buckets, solutions):
        request, placed = bucket[0], bucket[1:]
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
    return groups, shapes


def _solve_once(
    comm: MPI.Comm, requests: list[tuple[bytes, _Request]], order: int, materials, terms: int
) -> tuple[list[SElement], int]:
    """Send each request to the rank its key points to, solve different shapes once there, send the solutions
    back.
    """
    owners = [zlib.crc32(key) % comm.size for key, _ in requests]
    outgoing = [[] for _ in range(comm.size)]
    for (key, request), owner in zip(requests, owners):
        outgoing[owner].append((key, request))
    incoming = comm.alltoall(outgoing) if comm.size > 1 else outgoing
    solved: dict[bytes, list[tuple[_Request, SElement]]] = {}
    answers = []
    with collective(comm):
        for batch in incoming:
            answer = []
            for key, request in batch:
                known = solved.setdefault(key, [])
                solution = next(
                    (
                        s
                        for r, s in known
                        if same_shape(r.shape, request.shape, max(r.tolerance, request.tolerance))
                    ),
                    None,
                )
                if solution is None:
                    material = materials[request.material]
                    try:
                        solution = solve_selement(
                            request.shape,
                            order,
                            request.closed,
                            material.elasticity,
                            terms,
                            material.isotropic,
                        )
                    except SElementError as error:
                        raise SElementError(f"{request.label}: {error}") from None
                    known.append((request, solution))
                answer.append(solution)
            answers.append(answer)
    returned = comm.alltoall(answers) if comm.size > 1 else answers
    queues = [iter(batch) for batch in returned]
    count = sum(len(known) for known in solved.values())
    return [next(queues[owner]) for owner in owners], comm.allreduce(count)
