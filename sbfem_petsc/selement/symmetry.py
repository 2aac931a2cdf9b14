"""Mirror symmetries of an S-element's outline, and the subspaces into which they separate its equations.

Rectangles have two mirrors, the trapezoids of a ring and the square around a crack tip one. The cost of a
Schur form grows with the cube of its size, so two mirrors save a factor of sixteen.
"""

from __future__ import annotations

import numpy as np

from .dense import symmetric_eigen

TOLERANCE = 1e-12


def invariant_subspaces(
    coordinates: np.ndarray, order: int, closed: bool, isotropic: bool
) -> list[np.ndarray]:
    """Orthonormal bases (n, n_i) of subspaces that the S-element's matrices leave invariant; together they
    span all.

    Parameters
    ----------
    coordinates : (nodes, 2) array
        Boundary nodes about the scaling centre, counter-clockwise, in units of the size.
    order : int
    closed : bool
    isotropic : bool
        Without isotropy no symmetry is sought.
    """
    n = 2 * len(coordinates)
    mirrors = _mirrors(coordinates, order, closed) if isotropic else []
    if not mirrors:
        return [np.eye(n)]
    # commuting involutions: the eigenvalues of S1 + 2 S2 tell the parities apart
    values, vectors = symmetric_eigen(np.tensordot(np.arange(1.0, len(mirrors) + 1.0), mirrors, axes=1))
    breaks = np.flatnonzero(np.diff(values) > 0.5) + 1
    return np.split(vectors, breaks, axis=1)


def mirrored(outlines: np.ndarray, order: int) -> np.ndarray:
    """(b,): whether closed outlines (b, nodes, 2) have a mirror."""
    return np.asarray(_sought(outlines, order, True)[2].any(axis=1))


def _mirrors(coordinates: np.ndarray, order: int, closed: bool) -> list[np.ndarray]:
    """One mirror of the outline, and the one perpendicular to it if there is one, as (n, n) symmetric
    orthogonal matrices.
    """
    index, turns, holds = _sought(coordinates[None], order, closed)
    turn, found = turns[0], np.flatnonzero(holds[0])
    if len(found) == 0:
        return []
    chosen = [found[0]] + [k for k in found[1:] if abs(turn[k] + turn[found[0]]) < 1e-9][:1]
    return [_operator(index[k], turn[k]) for k in chosen]


def _sought(outlines: np.ndarray, order: int, closed: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What mirrors may do to outlines (b, nodes, 2): the node that each node comes from (m, nodes), the turns
    (b, m), and whether they map the outline on itself (b, m).
    """
    nodes = outlines.shape[1]
    z = outlines[..., 0] + 1j * outlines[..., 1]
    # A mirror sends node i to node s - i: s is even around vertices and edge centres alike, given in half
    # edges.
    sums = order * np.arange(nodes // order) if closed else np.array([nodes - 1])
    index = (sums[:, None] - np.arange(nodes)) % nodes
    image = z[:, index]
    turn = (image * z[:, None]).mean(axis=2)  # image = turn * conj(z) under a mirror
    turn = turn / np.maximum(np.abs(turn), 1e-300)
    holds = np.abs(image - turn[:, :, None] * z[:, None].conj()).max(axis=2) < TOLERANCE
    return index, turn, holds


def _operator(index: np.ndarray, turn: complex) -> np.ndarray:
    """Displacement of node i of the mirrored field is the mirrored displacement of node index[i]."""
    mirror = np.array([[turn.real, turn.imag], [turn.imag, -turn.real]])
    nodes = len(index)
    operator = np.zeros((nodes, 2, nodes, 2))
    operator[np.arange(nodes), :, index, :] = mirror
    return operator.reshape(2 * nodes, 2 * nodes)
