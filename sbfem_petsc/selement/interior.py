"""Displacement and stress inside an S-element from its boundary displacement.

Along the radius the static solution is u(xi) = xi^A u(1) with A = `SElement.radial`; the strain at (xi, eta)
is B1 u,xi + B2 u / xi with u,xi = A u / xi (eqs. (4), (10), (11) of Sepehry et al. 2020).

The static interpolation serves files and pictures of mode shapes and other vibrating states too. Between
the boundaries it neglects the element's own inertia, an error of relative order (k h)^2 with the wave number
k and the element's size h; on the boundaries the solution is what the continued fraction gives. Results at
points add what inertia does inside, see `interior_motion`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy import linalg

from meshing.gll import shape_functions

from .coefficients import edge_nodes, strain_operators
from .face_tractions import FaceTractions
from .rigid_motions import translations
from .sectors import Sectors

# Points whose fields are held at a time.
_CHUNK = 64


def radial_displacement(
    radial: np.ndarray,
    boundary: np.ndarray,
    levels: np.ndarray,
    faces: tuple[FaceTractions, np.ndarray] | None = None,
) -> np.ndarray:
    """Static displacement along the radius for several xi: xi^A u(1), and what tractions on the faces add.

    Parameters
    ----------
    radial : (n, n) array
        A. It may be non-diagonalisable: the power is formed from matrix exponentials, never from
        eigenvectors.
    boundary : (n, c) array
        Boundary displacements u(1), one column a field, in the frame that A belongs to.
    levels : (l,) array
        xi in [0, 1]; 0 is the scaling centre, where a translation is all that is left.
    faces : (FaceTractions, (m, c) array), optional
        Traction modes on the faces of an open S-element, and their forces divided by E and the thickness, m.

    Returns
    -------
    (l, n, c) array

    Notes
    -----
    Translations are kept apart exactly: on an orthonormal basis [T, P] of translations and the rest, A is
    [[0, a], [0, B]] with Re(eigenvalues of B) > 0. The rest d decays as xi^B d, and the translation becomes
    c - a B^-1 (d - xi^B d). The levels are visited from 1 inwards, so no rounding error grows. The powers of
    xi of the tractions are appended to d as states of their own, which holds the logarithms of resonant
    powers too.
    """
    levels = np.asarray(levels, dtype=float)
    if not ((levels >= 0.0) & (levels <= 1.0)).all():
        raise ValueError(
            f"levels must be between 0 (scaling centre) and 1 (boundary), got {levels.min():g} to "
            f"{levels.max():g}"
        )
    n = len(radial)
    moved, rest = translations(n)
    inner = rest.T @ radial @ rest
    outer = moved.T @ radial @ rest
    constant = moved.T @ boundary
    start = rest.T @ boundary
    if faces is not None:
        tractions, force = faces
        m = len(tractions.growth)
        inner = np.block([[inner, -rest.T @ tractions.forcing], [np.zeros((m, n - 2)), tractions.growth]])
        outer = np.concatenate([outer, -moved.T @ tractions.forcing], axis=1)
        start = np.concatenate([start, tractions.monomials @ force])
    transfer = linalg.solve(inner.T, outer.T).T  # a B^-1
    total = constant - transfer @ start  # translation of the scaling centre
    result = np.empty((len(levels), *boundary.shape))
    for index, current in marched(inner, start, levels):
        result[index] = moved @ (total + transfer @ current) + rest @ current[: n - 2]
    return result


def marched(inner: np.ndarray, start: np.ndarray, levels: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Numbers of levels xi in [0, 1] and ``xi^inner start`` there, from 1 inwards: every factor decays; 0 at
    0.
    """
    factors: dict[float, np.ndarray] = {}
    current, reached = start, 1.0
    for index in np.argsort(-levels, kind="stable"):
        level = levels[index]
        if level == 0.0:
            current = np.zeros_like(start)
        elif level < reached:
            ratio = float(f"{level / reached:.14g}")  # graded levels share one factor
            if ratio not in factors:
                factors[ratio] = linalg.expm(inner * np.log(ratio))
            current = factors[ratio] @ current
        reached = level
        yield index, current


class Located(NamedTuple):
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


class RadialFields(NamedTuple):
    """Fields on the rays through the nodes, which tell what is between them.

    Attributes
    ----------
    displacements : (l, n, c) array
    beside, slopes : (l, n, c) arrays
        Displacements where the stress is taken, and xi times their derivatives there.
    levels : (l,) array
        xi there; at 0 the stress is nan.
    """

    displacements: np.ndarray
    beside: np.ndarray
    slopes: np.ndarray
    levels: np.ndarray


def static_fields(
    radial: np.ndarray,
    boundary: np.ndarray,
    levels: np.ndarray,
    near: np.ndarray,
    faces: tuple[FaceTractions, np.ndarray] | None = None,
) -> RadialFields:
    """Static fields at levels (l,), and at others (l,) for the stress; see `radial_displacement`."""
    whole = radial_displacement(radial, boundary, np.concatenate([levels, near]), faces)
    beside = whole[len(levels) :]
    slopes = radial @ beside
    if faces is not None:
        slopes += faces[0].inflow(faces[1], near)
    return RadialFields(whole[: len(levels)], beside, slopes, near)


def fields_at(
    sectors: Sectors, closed: bool, located: Located, fields: RadialFields, which: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(q, 2, c), (q, 3, c): displacement and stress (xx, yy, xy) at points, in the frame of the S-element's
    shape and in units of its size and modulus; ``which`` (q,) of the fields' levels each point has.
    """
    shape, order, elasticity = sectors
    edges = edge_nodes(len(shape), order, closed)
    nodes = edges[located.edge]
    unknowns = which[:, None, None], 2 * nodes[:, :, None] + [0, 1]
    values, derivatives = shape_functions(order, located.eta)
    displacement = np.einsum("qa,qaic->qic", values, fields.displacements[unknowns])
    first, second, _ = strain_operators(shape[nodes], values[:, None], derivatives[:, None])
    width = 2 * nodes.shape[1]
    first, second = (part.reshape(-1, 3, width) for part in (first, second))
    slopes, beside = (
        part[unknowns].reshape(len(which), width, -1) for part in (fields.slopes, fields.beside)
    )
    levels = np.where(fields.levels > 0.0, fields.levels, np.nan)[which, None, None]
    strain = (first @ slopes + second @ beside) / levels
    return displacement, np.broadcast_to(elasticity, (len(edges), 3, 3))[located.edge] @ strain


def in_chunks(
    located: Located, of_some: Callable[[Located], tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and stress at points, of so few at a time that their fields find room."""
    parts = range(0, max(len(located.edge), 1), _CHUNK)
    found = [of_some(Located(*(part[k : k + _CHUNK] for part in located))) for k in parts]
    displacement, stress = (np.concatenate(part) for part in zip(*found))
    return displacement, stress


def in_own_frames(
    displacement: np.ndarray, stress: np.ndarray, rotations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(k, q, 2), (k, q, 3): fields (q, 2, k), (q, 3, k) of k copies of a shape, from its frame."""
    tensor = stress[:, [0, 2, 2, 1]].reshape(len(stress), 2, 2, -1)
    turned = np.einsum("kai,qabk,kbj->kqij", rotations, tensor, rotations, optimize=True)
    return np.einsum("kij,qik->kqj", rotations, displacement), turned[..., [0, 1, 0], [0, 1, 1]]
