"""Motion inside S-elements as the dynamic unknowns mean it: projections of fields given everywhere.

At a frequency omega the radial equation is ``xi u,xi = F (S(omega xi) - E1^T) u`` with the dynamic stiffness
S = K - x R_1 - x^2 R_2 - ..., x = omega^2 xi^2, R_1 = M, and

    (A^T + q I) R_q + R_q (A + q I) = sum over m + l = q of R_m F R_l

so that ``u = w_0 + omega^2 w_1 + omega^4 w_2 + ...`` with w_0 = xi^A u(1), the static field, and
``xi w_k,xi = A w_k - F sum_m xi^2m R_m w_(k-m)``, w_k(1) = 0: what inertia moves inside while the boundary is
held. The continued fraction of T terms is the element with these T fields alone inside (Guyan's reduction
with the first Krylov vectors); its auxiliary unknowns y stand for the fields V y with
``V J^k C^T = w_(k+1)``.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from .coefficients import coefficient_matrices
from .dense import cholesky, cholesky_solve, lyapunov, schur, symmetric
from .interior import Located, RadialFields, fields_at, in_chunks, marched, radial_displacement
from .points import PointOperators
from .sectors import Sectors
from .solution import SElement

# Below this xi what inertia adds is taken as here: it varies like xi^2 and stands beside 1 / xi^2k.
_INNERMOST = 1e-2
# Fields w_k that results at points are made of: more differ by rounding alone.
_KRYLOV = 3


def interior_fields(element: SElement, levels: np.ndarray, terms: int) -> tuple[np.ndarray, np.ndarray]:
    """Fields of the boundary unknowns and of the auxiliary ones along the radius.

    Parameters
    ----------
    element : SElement
        With its inertia, of `terms` terms.
    levels : (l,) array
        xi in (0, 1].
    terms : int

    Returns
    -------
    static : (l, n, n) array
        xi^A.
    auxiliary : (l, n, a) array
        V, zero on the boundary.
    """
    radial, n = element.radial, element.stiffness.shape[0]
    static = radial_displacement(radial, np.eye(n), levels)
    return static, _auxiliary(element, _held_fields(element, radial, levels, max(terms, 1))[0])


def inertial_operators(element: SElement, terms: int, located: Located) -> PointOperators:
    """What inertia adds to displacement and stress at points, in the reference frame.

    Columns: the auxiliary unknowns, then unit body forces along x and y (in units of E / h), with the
    boundary held.

    Parameters
    ----------
    element : SElement
        With its inertia, of `terms` terms.
    terms : int
    located : Located
    """
    radial, translations = element.radial, np.tile(np.eye(2), (len(element.coordinates), 1))
    sectors = Sectors(element.coordinates, element.order, element.elasticity)

    def of_some(some: Located) -> tuple[np.ndarray, np.ndarray]:
        distinct, which = np.unique(np.maximum(some.level, _INNERMOST), return_inverse=True)
        whole, steep = (
            np.concatenate([_auxiliary(element, parts), parts[0] @ translations], axis=2)
            for parts in _held_fields(element, radial, distinct, min(max(terms, 1), _KRYLOV))
        )
        fields = RadialFields(whole, whole, steep, distinct)
        return fields_at(sectors, element.closed, some, fields, which.ravel())

    return PointOperators(*in_chunks(located, of_some), 0)


def _auxiliary(element: SElement, fields: list[np.ndarray]) -> np.ndarray:
    """(l, n, a): V, from the first fields w_1, w_2, ... (l, n, n), or the same of their slopes."""
    krylov = [element.coupling.T]
    for _ in fields[1:]:
        krylov.append(element.inertia[:, None] * krylov[-1])
    if len(element.inertia) == 0:
        return np.zeros((*fields[0].shape[:2], 0))
    # V [C^T, J C^T, ...] = [w_1, w_2, ...], scaled by columns: the powers of J differ much
    basis = np.concatenate(krylov, axis=1)
    scale = 1.0 / np.linalg.norm(basis, axis=0)
    stacked = np.concatenate(fields, axis=2) * scale
    flat = stacked.reshape(-1, basis.shape[1])
    solved = linalg.lstsq((basis * scale).T, flat.T, cond=1e-12)[0]
    return solved.T.reshape(*fields[0].shape[:2], -1)


def _held_fields(
    element: SElement, radial: np.ndarray, levels: np.ndarray, terms: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """w_1, ..., w_T, each (l, n, n), of unit boundary displacements, and xi times their derivatives."""
    n = len(radial)
    coefficients = coefficient_matrices(
        element.coordinates, element.order, element.closed, element.elasticity, density=element.density
    )
    factor = cholesky(coefficients.e0, "coefficient matrix E0")
    (triangle, vectors), series = schur(radial.T), [element.mass]
    for q in range(2, terms + 1):
        right = sum(series[m] @ cholesky_solve(factor, series[q - 2 - m]) for m in range(q - 1))
        solved = lyapunov(triangle, float(q), vectors.T @ symmetric(right) @ vectors)
        series.append(vectors @ solved @ vectors.T)
    # states xi^2k w_(T-k): what decays inwards is marched inwards
    size = (terms + 1) * n
    inner = np.zeros((size, size))
    for k in range(terms + 1):
        rows = slice(k * n, (k + 1) * n)
        inner[rows, rows] = radial + 2.0 * k * np.eye(n)
        for m in range(1, terms + 1 - k):
            inner[rows, (k + m) * n : (k + m + 1) * n] = -cholesky_solve(factor, series[m - 1])
    start = np.zeros((size, n))
    start[terms * n :] = np.eye(n)
    result, slopes = np.empty((2, terms, len(levels), n, n))
    for index, current in marched(inner, start, levels):
        states, rates = (part.reshape(terms + 1, n, n) for part in (current, inner @ current))
        for k in range(terms):  # w_(T-k)
            power = levels[index] ** (2 * k)
            result[terms - k - 1, index] = states[k] / power
            slopes[terms - k - 1, index] = (rates[k] - 2.0 * k * states[k]) / power
    return list(result), list(slopes)
