"""Displacement and stress at points anywhere in an S-element, as rows over its boundary displacements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from .basis import shape_functions
from .coefficients import edge_nodes, strain_operators
from .face_tractions import FaceTractions
from .interior import radial_displacement

# A point this far outside the outline, relative to the size, counts as on it.
TOLERANCE = 1e-9
# Where the stress at the scaling centre of a closed S-element is taken: what varies there falls off like xi.
_CENTRE = 1e-4
# Points whose powers xi^A are held at a time.
_CHUNK = 64


@dataclass(frozen=True, eq=False)
class Located:
    """Where points lie in an S-element.

    Attributes
    ----------
    edge : (q,) int array
        Edge whose sector a point lies in, -1 outside the S-element.
    eta : (q,) array
        In [-1, 1] along the edge.
    level : (q,) array
        xi, 0 at the scaling centre and 1 on the boundary.
    """

    edge: np.ndarray
    eta: np.ndarray
    level: np.ndarray


def locate(
    shape: np.ndarray, order: int, closed: bool, points: np.ndarray, *, last_face: bool = False
) -> Located:
    """Scaled boundary coordinates of points.

    Parameters
    ----------
    shape : (nodes, 2) array
        Boundary nodes about the scaling centre, counter-clockwise, in units of the size.
    order : int
    closed : bool
    points : (q, 2) array
        About the scaling centre, in units of the size.
    last_face : bool
        On the faces of a closed crack, whether points belong to the last face (default: to the first).
    """
    edges = edge_nodes(len(shape), order, closed)
    count = len(points)
    edge, eta, level = np.full(count, -1), np.zeros(count), np.zeros(count)
    sequence = range(len(edges))[::-1] if last_face else range(len(edges))
    for i, point in enumerate(np.asarray(points, dtype=float)):
        distance = float(np.hypot(*point))
        if distance <= TOLERANCE * 1e-3:
            edge[i] = sequence[0]
            continue
        direction = point / distance
        for k in sequence:
            found = _meeting(shape[edges[k]], order, direction)
            if found is None:
                continue
            at, reach = found
            if distance <= reach + TOLERANCE:
                edge[i], eta[i], level[i] = k, at, min(distance / reach, 1.0)
            break
    return Located(edge, eta, level)


def _meeting(nodes: np.ndarray, order: int, direction: np.ndarray) -> tuple[float, float] | None:
    """eta and distance where a ray from the scaling centre meets an edge, or None."""
    across = np.array([-direction[1], direction[0]])

    def side(at: float) -> float:
        return float(shape_functions(order, np.array([at]))[0][0] @ nodes @ across)

    # the edge turns counter-clockwise about the scaling centre, so `side` rises through zero once
    low, high = side(-1.0), side(1.0)
    if low > TOLERANCE or high < -TOLERANCE or (nodes[[0, -1]] @ direction).max() <= 0.0:
        return None
    if low >= 0.0:
        at = -1.0
    elif high <= 0.0:
        at = 1.0
    else:
        at = float(optimize.brentq(side, -1.0, 1.0, xtol=1e-15))
    reach = float(shape_functions(order, np.array([at]))[0][0] @ nodes @ direction)
    return (at, reach) if reach > 0.0 else None


@dataclass(frozen=True, eq=False)
class PointOperators:
    """Rows over (boundary displacements (n,) in m, face forces (m,) / (E thickness) in m).

    Attributes
    ----------
    displacement : (q, 2, n + m) array
        m.
    stress : (q, 3, n + m) array
        xx, yy, xy; times E / h gives Pa. nan at the scaling centre of an open S-element, where the stress of
        a tip has no limit.
    unknowns : int
        n.
    """

    displacement: np.ndarray
    stress: np.ndarray
    unknowns: int

    def turned(self, rotation: np.ndarray) -> PointOperators:
        """From the reference frame to that of an S-element placed with ``v_reference = rotation @ v``, for
        displacements of its own in the reference order of the nodes.
        """
        n = self.unknowns

        def columns(rows: np.ndarray) -> np.ndarray:
            nodal = rows[..., :n].reshape(*rows.shape[:2], -1, 2) @ rotation
            return np.concatenate([nodal.reshape(*rows.shape[:2], n), rows[..., n:]], axis=2)

        tensor = columns(self.stress)[:, [0, 2, 2, 1]].reshape(len(self.stress), 2, 2, -1)
        tensor = np.einsum("ai,qabc,bj->qijc", rotation, tensor, rotation)
        return replace(
            self,
            displacement=np.einsum("ai,qac->qic", rotation, columns(self.displacement)),
            stress=np.stack([tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 0, 1]], axis=1),
        )


def point_operators(
    radial: np.ndarray,
    shape: np.ndarray,
    order: int,
    elasticity: np.ndarray,
    *,
    located: Located,
    closed: bool,
    tractions: FaceTractions | None = None,
) -> PointOperators:
    """Rows for displacement and stress at points of one S-element, in its reference frame.

    Parameters
    ----------
    radial : (n, n) array
        A of the S-element.
    shape : (nodes, 2) array
    order : int
    elasticity : (3, 3) or (edges, 3, 3) array
        D in units of the modulus.
    located : Located
        The points, from `locate`.
    closed : bool
    tractions : FaceTractions, optional
        Adds the columns of tractions on the faces of a tip element.

    Raises
    ------
    ValueError
        If a point lies outside.
    """
    if (located.edge < 0).any():
        missing = int(np.argmin(located.edge))
        raise ValueError(f"point {missing} lies outside the S-element; take only points that `locate` finds")
    n = len(radial)
    edges = edge_nodes(len(shape), order, closed)
    elasticity = np.broadcast_to(elasticity, (len(edges), 3, 3))
    m = 0 if tractions is None else len(tractions.powers)
    boundary, force = np.eye(n, n + m), np.eye(m, n + m, k=n)
    count = len(located.edge)
    displacement, stress = np.empty((count, 2, n + m)), np.empty((count, 3, n + m))
    for start in range(0, count, _CHUNK):
        chosen = np.arange(start, min(start + _CHUNK, count))
        # the stress of a closed S-element at its scaling centre is that next to it
        levels = np.maximum(located.level[chosen], _CENTRE if closed else 0.0)
        faces = None if tractions is None else (tractions, force)
        whole = radial_displacement(radial, boundary, located.level[chosen], faces)
        near = (
            whole
            if np.array_equal(levels, located.level[chosen])
            else radial_displacement(radial, boundary, levels, faces)
        )
        slopes = radial @ near
        if tractions is not None:
            slopes += tractions.inflow(force, levels)
        for i, field, beside, slope, level in zip(chosen, whole, near, slopes, levels):
            nodes = edges[located.edge[i]]
            unknowns = (2 * nodes[:, None] + np.arange(2)).ravel()
            values, derivatives = shape_functions(order, located.eta[i : i + 1])
            displacement[i] = np.einsum("a,aic->ic", values[0], field[unknowns].reshape(-1, 2, n + m))
            if level == 0.0:
                stress[i] = np.nan
                continue
            first, second, _ = strain_operators(shape[nodes][None], values, derivatives)
            strain = (
                first[0, 0].reshape(3, -1) @ slope[unknowns] + second[0, 0].reshape(3, -1) @ beside[unknowns]
            )
            stress[i] = elasticity[located.edge[i]] @ strain / level
    return PointOperators(displacement, stress, n)
