"""Stiffness, mass and continued fraction of one S-element, non-dimensional and checked.

Lengths are in units of the element's size h, stresses in units of the Young's modulus E, and
x = -omega^2 is in units of E / (rho h^2), so that similar elements share one solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from .coefficients import Coefficients, SElementError, coefficient_matrices
from .dense import (
    ADVICE,
    cholesky,
    cholesky_solve,
    growing_subspace,
    largest,
    lower_solve,
    lyapunov,
    orthogonal_complement,
    schur,
    solve,
    symmetric,
    symmetric_eigen,
)
from .symmetry import invariant_subspaces

# Round-off of the ordered Schur form and the Lyapunov solves grows with the number of unknowns; up to 400
# unknowns an element 1e-13 to 1e-11 is met, while a wrong split of the spectrum shows as 1e-6 or more.
TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class SElement:
    """Solution of one non-dimensional S-element with n boundary unknowns and a auxiliary ones.

    The dynamic stiffness is ``K - w2 M - w2^2 C (I - w2 diag(J))^-1 C^T`` with w2 = omega^2 rho h^2 / E, that
    is the pencil ``diag(K, I) - w2 [[M, C], [C^T, diag(J)]]``: the continued fraction (16), (17) with its
    auxiliary unknowns brought to their own modes.

    Attributes
    ----------
    stiffness, mass : (n, n) arrays
        K and M, symmetric.
    coupling : (n, a) array
        C.
    inertia : (a,) array
        J > 0, ascending; the auxiliary unknowns alone vibrate at w2 = 1 / J.
    radial : (n, n) array
        A = E0^-1 (K - E1^T): static displacements along the radius are u(xi) = xi^A u(1).
    riccati_residual, asymmetry, rigid_body_residual : float
        Relative; asymmetry before the symmetrisation.
    """

    stiffness: np.ndarray
    mass: np.ndarray
    coupling: np.ndarray
    inertia: np.ndarray
    radial: np.ndarray
    riccati_residual: float
    asymmetry: float
    rigid_body_residual: float


def solve_selement(
    coordinates: np.ndarray,
    order: int,
    closed: bool,
    elasticity: np.ndarray,
    terms: int,
    isotropic: bool = False,
) -> SElement:
    """Solve one non-dimensional S-element.

    Parameters
    ----------
    coordinates : (nodes, 2) array
        Boundary nodes relative to the scaling centre, counter-clockwise, in units of the element's size.
    order : int
    closed : bool
    elasticity : (3, 3) array
        D / E.
    terms : int
        Order of the continued fraction (Mcf of the paper), 0 for stiffness and mass alone.
    isotropic : bool
        Whether mirror symmetries of the outline are symmetries of the S-element; its equations then separate.

    Raises
    ------
    SElementError
        If the boundary is not visible from the scaling centre or a check fails.
    """
    coefficients = coefficient_matrices(coordinates, order, closed, elasticity)
    motions = _rigid_motions(coordinates)
    parts = [
        _solve_subspace(coefficients, motions[:, :2], basis, terms)
        for basis in invariant_subspaces(coordinates, order, closed, isotropic)
    ]
    stiffness, mass, radial = (sum(basis @ part[k] @ basis.T for basis, part in parts) for k in range(3))
    coupling = np.concatenate([basis @ part[3] for basis, part in parts], axis=1)
    inertia = np.concatenate([part[4] for _, part in parts])
    scale = largest(stiffness)
    riccati = largest((stiffness - coefficients.e1) @ radial - coefficients.e2) / max(
        largest(coefficients.e2), scale
    )
    asymmetry = max(part[5] for _, part in parts)
    rigid = largest(stiffness @ motions) / scale
    for name, value in (
        ("residual of the Riccati equation", riccati),
        ("asymmetry of the stiffness", asymmetry),
        ("rigid-body residual", rigid),
    ):
        if not value < TOLERANCE:
            raise SElementError(
                f"{name} {value:.2g} exceeds {TOLERANCE:.0g}: the radial modes could not be separated; "
                f"{ADVICE}"
            )
    ascending = np.argsort(inertia, kind="stable")
    return SElement(
        symmetric(stiffness),
        symmetric(mass),
        coupling[:, ascending],
        inertia[ascending],
        radial,
        riccati,
        asymmetry,
        rigid,
    )


def _solve_subspace(coefficients: Coefficients, translations: np.ndarray, basis: np.ndarray, terms: int):
    """The basis, and K, M, A, C, J and the asymmetry of K in a subspace that E0, E1, E2 and M0 leave
    invariant.
    """
    local = Coefficients(
        *(
            basis.T @ matrix @ basis
            for matrix in (coefficients.e0, coefficients.e1, coefficients.e2, coefficients.m0)
        )
    )
    factor = cholesky(local.e0, "coefficient matrix E0")
    stiffness, asymmetry = _static_stiffness(local, factor, basis.T @ translations)
    # K is singular for rigid-body motions alone: a shift at round-off's level makes it definite, or something
    # is wrong
    cholesky(stiffness + TOLERANCE * largest(stiffness) * np.eye(len(stiffness)), "stiffness")
    radial = cholesky_solve(factor, stiffness - local.e1.T)
    mass, coupling, inertia = _continued_fraction(local, factor, radial, terms)
    return basis, (stiffness, mass, radial, coupling, inertia, asymmetry)


def _static_stiffness(
    coefficients: Coefficients, factor: np.ndarray, translations: np.ndarray
) -> tuple[np.ndarray, float]:
    """K from the invariant subspace of the growing radial modes, and its relative asymmetry.

    The translations R are deflated exactly: E1^T R = 0, E2 R = 0 and K R = 0, hence on their complement P the
    Hamiltonian [[-P'F E1'P, P'F P], [P'(E2 - E1 F E1')P, P'E1 F P]], F = E0^-1, has no zero eigenvalue.
    """
    complement = orthogonal_complement(translations)
    project, m = complement.T, complement.shape[1]
    inverse = cholesky_solve(factor, complement)  # F P
    inverse_e1 = cholesky_solve(factor, coefficients.e1.T @ complement)  # F E1' P
    hamiltonian = np.empty((2 * m, 2 * m), order="F")
    hamiltonian[:m, :m] = -project @ inverse_e1
    hamiltonian[:m, m:] = project @ inverse
    hamiltonian[m:, :m] = project @ (coefficients.e2 @ complement - coefficients.e1 @ inverse_e1)
    hamiltonian[m:, m:] = inverse_e1.T @ complement
    vectors, growing = growing_subspace(hamiltonian)
    if growing != m:
        raise SElementError(f"{growing} growing radial modes instead of {m}; {ADVICE}")
    reduced = solve(vectors[:m, :m].T, vectors[m:, :m].T).T
    return complement @ symmetric(reduced) @ project, largest(reduced - reduced.T) / largest(reduced)


def _continued_fraction(
    coefficients: Coefficients, factor: np.ndarray, radial: np.ndarray, terms: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, coupling and inertia of the auxiliary unknowns, (12)-(19) with S0 = I by the scaling X X^T =
    Z.
    """
    n = len(radial)
    u = radial.T
    form = schur(u)
    mass = lyapunov(form, 1.0, coefficients.m0)
    cholesky(mass, "mass")
    if terms == 0:
        return mass, np.zeros((n, 0)), np.zeros(0)
    identity = np.eye(n)
    c = cholesky_solve(factor, identity)
    v = mass @ c
    a = symmetric(v @ mass)
    scalings, inertias = [], []
    for i in range(1, terms + 1):
        x = cholesky(lyapunov(form, 2.0, a), f"term {i} of the continued fraction")
        b0 = lower_solve(x, (u + 2.0 * identity) @ x).T  # X^T (U + 2 I)^T X^-T
        b1 = lower_solve(x, v @ x).T
        next_c = symmetric(lower_solve(x, lower_solve(x, a).T))  # X^-1 a X^-T
        next_a = x.T @ c @ x
        u = b0.T
        form = schur(u)
        s1 = lyapunov(form, 1.0, b1 + b1.T)
        scalings.append(x)
        inertias.append(s1)
        v = s1 @ next_c - b1
        product = s1 @ b1.T
        a = symmetric(s1 @ next_c @ s1 - product - product.T + next_a)
        c = next_c
    pencil = inertias[0] if terms == 1 else linalg.block_diag(*inertias)
    for i, x in enumerate(scalings[1:], start=1):
        upper, lower = slice((i - 1) * n, i * n), slice(i * n, (i + 1) * n)
        pencil[upper, lower], pencil[lower, upper] = -x, -x.T
    inertia, modes = symmetric_eigen(pencil)
    if not inertia[0] > 0.0:
        raise SElementError(
            "the auxiliary mass of the continued fraction is not positive definite (smallest eigenvalue "
            f"{inertia[0]:.2g}); {ADVICE}"
        )
    return mass, -scalings[0] @ modes[:n], inertia


def _rigid_motions(coordinates: np.ndarray) -> np.ndarray:
    """(n, 3): two translations and the rotation about the scaling centre, each of unit maximum."""
    motions = np.zeros((len(coordinates), 2, 3))
    motions[:, 0, 0] = motions[:, 1, 1] = 1.0
    motions[:, 0, 2], motions[:, 1, 2] = -coordinates[:, 1], coordinates[:, 0]
    return motions.reshape(-1, 3)
