"""Search for contact pairs: nodes of equal fraction along the two faces of a crack."""

from __future__ import annotations

import numpy as np

from meshing.boundary_mesh import ContactPairs

_FRACTION_TOLERANCE = 1e-6


def face_chain(edges: np.ndarray, nodes: np.ndarray, tip: tuple[float, float], name: str) -> np.ndarray:
    """Nodes of one face in order, from the tip outwards.

    Parameters
    ----------
    edges : (n, p + 1) int array
        Nodes of the face's edges, in any order and direction.
    nodes : (n_nodes, 2) array
        Coordinates, m.
    tip : (x, y)
        m.
    name : str
        The crack, for messages.

    Returns
    -------
    (n p + 1,) int array

    Raises
    ------
    ValueError
        The edges are not one chain.
    """
    at: dict[int, list[int]] = {}
    for i, edge in enumerate(edges):
        at.setdefault(int(edge[0]), []).append(i)
        at.setdefault(int(edge[-1]), []).append(i)
    ends = [node for node, touching in at.items() if len(touching) == 1]
    if len(ends) != 2 or any(len(touching) > 2 for touching in at.values()):
        raise ValueError(
            f"{name}: the edges of a face do not form one line from the tip to the mouth; give one connected "
            "chain of curves per face."
        )
    node = min(ends, key=lambda end: np.hypot(*(nodes[end] - tip)))
    chain, left_over = [node], set(range(len(edges)))
    while left_over:
        step = next((i for i in at[node] if i in left_over), None)
        if step is None:
            raise ValueError(
                f"{name}: the edges of a face do not form one line from the tip to the mouth; give one "
                "connected chain of curves per face."
            )
        left_over.remove(step)
        edge = edges[step] if edges[step][0] == node else edges[step][::-1]
        chain.extend(int(n) for n in edge[1:])
        node = chain[-1]
    return np.array(chain)


def face_fractions(chain: np.ndarray, nodes: np.ndarray, tip: tuple[float, float]) -> np.ndarray:
    """Fraction of the face's length, 0 at the tip and 1 at the mouth, of each node of a chain that runs
    outwards.
    """
    path = np.vstack([tip, nodes[chain]])
    distance = np.cumsum(np.hypot(*np.diff(path, axis=0).T))
    return distance / distance[-1]


def find_pairs(
    right: np.ndarray,
    left: np.ndarray,
    nodes: np.ndarray,
    tip: tuple[float, float],
    axis: tuple[float, float],
    crack: int,
    name: str,
) -> ContactPairs:
    """Pair the nodes of two faces by their fraction of the faces' lengths.

    Parameters
    ----------
    right, left : (n, p + 1) int array
        Nodes of the faces' edges; the normal points from the left face to the right one.
    nodes : (n_nodes, 2) array
        Coordinates, m.
    tip, axis : (x, y)
        Tip, m, and unit vector from the tip to the mouth.
    crack : int
        Index of the crack.
    name : str
        The crack, for messages.

    Returns
    -------
    ContactPairs
        From the tip outwards; a node that both faces share (the tip) is left out.

    Raises
    ------
    ValueError
        The faces carry different numbers of nodes or at different fractions, or they overlap.
    """
    chains = [face_chain(edges, nodes, tip, name) for edges in (right, left)]
    fractions = [face_fractions(chain, nodes, tip) for chain in chains]
    if len(chains[0]) != len(chains[1]):
        raise ValueError(
            f"{name}: the faces do not match, {len(chains[0])} nodes on the right face and {len(chains[1])} "
            "on the left; "
            "divide both into edges of equal fractions of their lengths."
        )
    mismatch = np.abs(fractions[0] - fractions[1])
    if mismatch.max() > _FRACTION_TOLERANCE:
        worst = int(mismatch.argmax())
        raise ValueError(
            f"{name}: the faces do not match, node {worst + 1} from the tip lies at "
            f"{fractions[0][worst]:.6g} of the right face and at "
            f"{fractions[1][worst]:.6g} of the left one; divide both into edges of equal fractions of their "
            "lengths."
        )
    separate = chains[0] != chains[1]
    pairs = np.stack([chains[0][separate], chains[1][separate]], axis=1)
    position = 0.5 * (fractions[0] + fractions[1])[separate]
    normal = np.tile([axis[1], -axis[0]], (len(pairs), 1))
    gap = np.einsum("ij,ij->i", normal, nodes[pairs[:, 0]] - nodes[pairs[:, 1]])
    length = np.hypot(*(nodes[chains[0][-1]] - tip))
    if len(gap) and gap.min() < -1e-9 * length:
        raise ValueError(
            f"{name}: the faces overlap by {-gap.min():.3g} m; the right face must lie at the right hand of "
            "the left one, seen from the tip."
        )
    # Faces of a closed crack coincide to round-off; a gap below that is no gap.
    gap = np.where(gap < 1e-12 * length, 0.0, gap)
    return ContactPairs(pairs, normal, gap, np.full(len(pairs), crack), position)


def join_pairs(parts: list[ContactPairs]) -> ContactPairs:
    """Pairs of several cracks one after the other."""
    if not parts:
        return ContactPairs(
            np.zeros((0, 2), int), np.zeros((0, 2)), np.zeros(0), np.zeros(0, int), np.zeros(0)
        )
    return ContactPairs(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("nodes", "normal", "gap", "crack", "position")
        )
    )
