"""Rigid-body motions of an S-element.

A stiffness times a rigid motion is round-off, not zero. In slender structures, whose elements move almost
rigidly, that round-off outweighs the strain energy of the lowest modes; taken out of the displacements before
the product, and out of the forces after it, the motions cost no digits (`ElementStiffness`).
"""

from __future__ import annotations

import numpy as np


def rigid_motions(coordinates: np.ndarray) -> np.ndarray:
    """(..., n, 3): two translations and the rotation about the origin, each of unit maximum, for nodes
    (..., nodes, 2) of unit size.
    """
    motions = np.zeros((*coordinates.shape, 3))
    motions[..., 0, 0] = motions[..., 1, 1] = 1.0
    motions[..., 0, 2], motions[..., 1, 2] = -coordinates[..., 1], coordinates[..., 0]
    return motions.reshape(*coordinates.shape[:-2], 2 * coordinates.shape[-2], 3)


def rigid_body_basis(coordinates: np.ndarray) -> np.ndarray:
    """(..., n, 3): orthonormal translations and rotation about the mean of the nodes (..., nodes, 2)."""
    motions = rigid_motions(coordinates - coordinates.mean(axis=-2, keepdims=True))
    return motions / np.linalg.norm(motions, axis=-2, keepdims=True)


def translations(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal bases of the two translations (n, 2) and of their complement (n, n - 2), from a Householder
    reflector.
    """
    nodes = n // 2
    vector = np.full(nodes, 1.0 / np.sqrt(nodes))
    vector[0] += 1.0
    reflector = np.eye(nodes) - np.outer(vector, vector) / vector[0]
    return np.kron(reflector[:, :1], np.eye(2)), np.kron(reflector[:, 1:], np.eye(2))
