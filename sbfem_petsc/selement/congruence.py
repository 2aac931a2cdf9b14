"""Placement of S-elements as scaled, rotated, reflected copies of a reference shape.

Similar S-elements share one non-dimensional solution. An outline's reference shape is found by trying every
start vertex and, for isotropic materials, both senses: each candidate is scaled to unit size, turned so
that its first node lies on the x axis, and the lexicographically smallest rounded one is chosen. A rounding
tie can at worst hide a congruence (one computation more), never produce a wrong one: shapes
are compared node by node before a solution is shared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

DIGITS = 6


@dataclass(frozen=True, eq=False)
class Placement:
    """How an S-element with the node chain `outline` follows from its reference shape.

    Attributes
    ----------
    shape : (nodes, 2) array
        Reference coordinates: ``outline[permutation] - centre == size * shape @ rotation``.
    size : float
        Largest distance of a node from the scaling centre, m.
    rotation : (2, 2) array
        Orthogonal (a reflection where its determinant is -1); a vector v of the element is ``rotation @ v``
        in the frame of the reference shape.
    permutation : (nodes,) int array
    """

    shape: np.ndarray
    size: float
    rotation: np.ndarray
    permutation: np.ndarray


def placements(outlines: np.ndarray, order: int, closed: bool, isotropic: bool) -> list[Placement]:
    """Place several S-elements with equal numbers of nodes.

    Parameters
    ----------
    outlines : (k, nodes, 2) array
        Nodes relative to the scaling centre, counter-clockwise, m.
    order : int
        Polynomial order of the edges.
    closed : bool
    isotropic : bool
        Whether turned and reflected copies behave alike.
    """
    count, nodes, _ = outlines.shape
    size = np.sqrt((outlines**2).sum(axis=2)).max(axis=1)
    z = (outlines[..., 0] + 1j * outlines[..., 1]) / size[:, None]
    starts = np.arange(0, nodes, order) if closed else np.array([0])
    forward = (starts[:, None] + np.arange(nodes)) % nodes
    if isotropic:
        # A reflected copy runs through the nodes backwards; mirroring makes it counter-clockwise again.
        backward = (starts[:, None] - np.arange(nodes)) % nodes if closed else np.arange(nodes)[::-1][None, :]
        index = np.concatenate([forward, backward])
        candidates = z[:, index]
        candidates[:, len(forward) :] = candidates[:, len(forward) :].conj()
        turn = candidates[..., 0].conj() / np.abs(candidates[..., 0])
        candidates = candidates * turn[..., None]
    else:
        index, candidates = forward, z[:, forward]
        turn = np.ones(candidates.shape[:2], dtype=complex)
    chosen = _smallest(candidates)
    rows = np.arange(count)
    shape, turn = candidates[rows, chosen], turn[rows, chosen]
    mirrored = chosen >= len(forward)
    rotation = np.empty((count, 2, 2))
    # v -> turn * v, or turn * conj(v) where mirrored
    rotation[:, 0, 0], rotation[:, 1, 0] = turn.real, turn.imag
    sign = np.where(mirrored, -1.0, 1.0)
    rotation[:, 0, 1], rotation[:, 1, 1] = -sign * turn.imag, sign * turn.real
    shape = np.stack([shape.real, shape.imag], axis=-1)
    return [Placement(shape[i], float(size[i]), rotation[i], index[chosen[i]]) for i in range(count)]


def _smallest(candidates: np.ndarray) -> np.ndarray:
    """Index of the lexicographically smallest rounded candidate of each element; candidates (k, c, nodes)
    complex.
    """
    rounded = np.round(np.concatenate([candidates.real, candidates.imag], axis=2), DIGITS)
    alive, every = np.ones(rounded.shape[:2], dtype=bool), np.arange(len(rounded))
    for k, column in enumerate(np.moveaxis(rounded, 2, 0)):
        column = np.where(alive, column, np.inf)
        alive &= column == column.min(axis=1, keepdims=True)
        # outlines with symmetries keep several, which are soon one and the same
        if k & (k - 1) == 0 and (rounded == rounded[every, alive.argmax(axis=1)][:, None])[alive].all():
            break
    return alive.argmax(axis=1)


def shape_key(shape: np.ndarray) -> bytes:
    """Hashable, rounded image of a reference shape: equal keys are candidates for a congruence."""
    return (np.round(shape, DIGITS) + 0.0).tobytes()


def same_shape(a: np.ndarray, b: np.ndarray, tolerance: float) -> bool:
    """Whether two reference shapes agree node by node within `tolerance` (in units of their size)."""
    return a.shape == b.shape and bool(np.abs(a - b).max() <= tolerance)
