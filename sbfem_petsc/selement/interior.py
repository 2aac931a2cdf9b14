"""Displacement and stress inside an S-element from its boundary displacement.

Along the radius the static solution is u(xi) = xi^A u(1) with A = `SElement.radial`; the strain at (xi, eta)
is B1 u,xi + B2 u / xi with u,xi = A u / xi (eqs. (4), (10), (11) of Sepehry et al. 2020).

The static interpolation serves files and pictures of mode shapes and other vibrating states too. Between
the boundaries it neglects the element's own inertia, an error of relative order (k h)^2 with the wave number
k and the element's size h; on the boundaries the solution is what the continued fraction gives. Results at
points add what inertia does inside, see `interior_motion`.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from .basis import shape_functions
from .coefficients import edge_nodes, strain_operators
from .face_tractions import FaceTractions


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
    c - a B^-1 (d - xi^B d). The levels are visited from 1 inwards, so every factor decays and no rounding
    error grows. The powers of xi of the tractions are appended to d as states of their own, which holds
    the logarithms of resonant powers too.
    """
    levels = np.asarray(levels, dtype=float)
    if not ((levels >= 0.0) & (levels <= 1.0)).all():
        raise ValueError(
            f"levels must be between 0 (scaling centre) and 1 (boundary), got {levels.min():g} to "
            f"{levels.max():g}"
        )
    n = len(radial)
    translations, rest = _translations(n)
    inner = rest.T @ radial @ rest
    outer = translations.T @ radial @ rest
    constant = translations.T @ boundary
    start = rest.T @ boundary
    if faces is not None:
        tractions, force = faces
        m = len(tractions.growth)
        inner = np.block([[inner, -rest.T @ tractions.forcing], [np.zeros((m, n - 2)), tractions.growth]])
        outer = np.concatenate([outer, -translations.T @ tractions.forcing], axis=1)
        start = np.concatenate([start, tractions.monomials @ force])
    transfer = linalg.solve(inner.T, outer.T).T  # a B^-1
    total = constant - transfer @ start  # translation of the scaling centre
    result = np.empty((len(levels), *boundary.shape))
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
        result[index] = translations @ (total + transfer @ current) + rest @ current[: n - 2]
    return result


def _translations(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal bases of the two translations (n, 2) and of their complement (n, n - 2), from a Householder
    reflector.
    """
    nodes = n // 2
    vector = np.full(nodes, 1.0 / np.sqrt(nodes))
    vector[0] += 1.0
    reflector = np.eye(nodes) - np.outer(vector, vector) / vector[0]
    return np.kron(reflector[:, :1], np.eye(2)), np.kron(reflector[:, 1:], np.eye(2))


class InteriorSampler:
    """Points (xi, edge, eta) of all copies of one reference shape, with displacement and stress there.

    Parameters
    ----------
    radial : (n, n) array
        A of the reference shape (`SElement.radial`).
    shape : (nodes, 2) array
        Reference coordinates about the scaling centre, counter-clockwise, in units of the element's size.
    order : int
    closed : bool
    elasticity : (3, 3) or (edges, 3, 3) array
        D in units of the modulus, in the reference frame.
    at : (q,) array
        eta in [-1, 1] on every edge.

    Attributes
    ----------
    edges : int
    """

    def __init__(
        self,
        radial: np.ndarray,
        shape: np.ndarray,
        order: int,
        closed: bool,
        elasticity: np.ndarray,
        at: np.ndarray,
    ):
        self._radial, self._shape = radial, shape
        self._connectivity = edge_nodes(len(shape), order, closed)
        self._elasticity = np.broadcast_to(elasticity, (len(self._connectivity), 3, 3))
        self._values, self._derivatives = shape_functions(order, at)
        self.edges = len(self._connectivity)

    def positions(
        self, levels: np.ndarray, centres: np.ndarray, sizes: np.ndarray, rotations: np.ndarray
    ) -> np.ndarray:
        """(k, l, edges, q, 2): coordinates, m, of the points of k copies.

        Parameters
        ----------
        levels : (l,) array
            xi.
        centres : (k, 2) array
            m.
        sizes : (k,) array
            m.
        rotations : (k, 2, 2) array
            From each copy's frame to the reference frame.
        """
        outline = self._values @ self._shape[self._connectivity]
        turned = np.einsum("k,eqi,kij->keqj", sizes, outline, rotations)
        return centres[:, None, None, None] + np.asarray(levels)[None, :, None, None, None] * turned[:, None]

    def radial_fields(
        self,
        boundary: np.ndarray,
        rotations: np.ndarray,
        levels: np.ndarray,
        faces: tuple[FaceTractions, np.ndarray] | None = None,
    ) -> np.ndarray:
        """(k, l, nodes, 2): displacements on the rays through the nodes, in the reference frame.

        Parameters
        ----------
        boundary : (k, nodes, 2) array
            Boundary displacements of each copy in its own frame, m.
        faces : (FaceTractions, (m, k) array), optional
            Traction modes on the faces of open S-elements, and their forces on each copy divided by the
            modulus and the thickness, m.
        """
        count, nodes, _ = boundary.shape
        columns = np.einsum("kij,knj->nik", rotations, boundary).reshape(2 * nodes, count)
        fields = radial_displacement(self._radial, columns, levels, faces)
        return np.moveaxis(fields, 2, 0).reshape(count, len(levels), nodes, 2)

    def displacement(self, fields: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """(k, l, edges, q, 2): displacement in each copy's own frame, m, from `radial_fields`."""
        return np.einsum(
            "qa,kleai,kij->kleqj", self._values, fields[:, :, self._connectivity], rotations, optimize=True
        )

    def stress(
        self,
        fields: np.ndarray,
        levels: np.ndarray,
        rotations: np.ndarray,
        sizes: np.ndarray,
        modulus: float,
        faces: tuple[FaceTractions, np.ndarray] | None = None,
    ) -> np.ndarray:
        """(k, l, edges, q, 3): stress (xx, yy, xy) in each copy's own frame, Pa, from `radial_fields` with
        the same tractions on the faces.

        Raises
        ------
        ValueError
            At xi = 0: the stress of a crack tip has no limit there, and elsewhere it depends on the
            direction.
        SElementError
            If the scaling centre does not see a point.
        """
        levels = np.asarray(levels, dtype=float)
        if not (levels > 0.0).all():
            raise ValueError(
                "the stress is not defined at the scaling centre (xi = 0); take a small positive xi"
            )
        first, second, _ = strain_operators(self._shape[self._connectivity], self._values, self._derivatives)
        count, depth, nodes, _ = fields.shape
        flat = fields.reshape(count, depth, 2 * nodes)
        slopes = flat @ self._radial.T  # xi u,xi
        if faces is not None:
            slopes = slopes + np.moveaxis(faces[0].inflow(faces[1], levels), 2, 0)
        slopes = slopes.reshape(fields.shape)
        strain = np.einsum("eqsai,kleai->kleqs", first, slopes[:, :, self._connectivity], optimize=True)
        strain += np.einsum("eqsai,kleai->kleqs", second, fields[:, :, self._connectivity], optimize=True)
        scale = modulus / (levels[None, :] * np.asarray(sizes)[:, None])
        stress = np.einsum("kleqs,ets->kleqt", strain, self._elasticity) * scale[:, :, None, None, None]
        tensor = stress[..., [0, 2, 2, 1]].reshape(*stress.shape[:-1], 2, 2)
        turned = np.einsum(
            "kai,kleqab,kbj->kleqij", rotations, tensor, rotations, optimize=True
        )  # R^T sigma R
        return np.stack([turned[..., 0, 0], turned[..., 1, 1], turned[..., 0, 1]], axis=-1)
