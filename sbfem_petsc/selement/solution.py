"""Stiffness, mass and continued fraction of one S-element, non-dimensional and checked.

Lengths are in units of the element's size h, stresses in units of the modulus E, and x = -omega^2 is in units
of E / (rho h^2), so that similar elements share one solution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .coefficients import Coefficients, SElementError, coefficient_matrices
from .dense import ADVICE, cholesky, cholesky_solve, largest, symmetric
from .inertia import Inertia, continued_fraction
from .rigid_motions import rigid_motions
from .stiffness import static_stiffness
from .symmetry import invariant_subspaces

# Round-off of the stiffness and the Lyapunov solves grows with the number of unknowns; up to 400 unknowns an
# element 1e-13 to 1e-11 is met, while a wrong split of the spectrum shows as 1e-6 or more.
TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class SElement:
    """Solution of one non-dimensional S-element with n boundary unknowns and a auxiliary ones.

    The dynamic stiffness is ``K - w2 M - w2^2 C (I - w2 diag(J))^-1 C^T`` with w2 = omega^2 rho h^2 / E, that
    is the pencil ``diag(K, I) - w2 [[M, C], [C^T, diag(J)]]``: the continued fraction (16), (17) with its
    auxiliary unknowns brought to their own modes. Statics need the stiffness alone: `mass`, `coupling` and
    `inertia` are there once `with_inertia` has computed them.

    Attributes
    ----------
    coordinates : (nodes, 2) array
        Boundary nodes about the scaling centre, counter-clockwise.
    order : int
    closed : bool
    elasticity : (3, 3) or (edges, 3, 3) array
        D in units of the modulus, of the S-element or of each edge's sector.
    isotropic : bool
        Whether mirror symmetries of the outline are used.
    stiffness : (n, n) array
        K, symmetric.
    riccati_residual, asymmetry, rigid_body_residual : float
        Relative; asymmetry before the symmetrisation.
    density : (edges,) array or None
        Densities of the sectors in units of the S-element's.
    dynamics : Inertia or None
    """

    coordinates: np.ndarray
    order: int
    closed: bool
    elasticity: np.ndarray
    isotropic: bool
    stiffness: np.ndarray
    riccati_residual: float
    asymmetry: float
    rigid_body_residual: float
    density: np.ndarray | None = None
    dynamics: Inertia | None = None

    @property
    def radial(self) -> np.ndarray:
        """(n, n): A = E0^-1 (K - E1^T); static displacements along the radius are u(xi) = xi^A u(1).

        Computed each time: of many S-elements it would take as much memory as their stiffness.
        """
        coefficients, bases, factors = self._equations()
        return _radial(self.stiffness, coefficients, factors, bases)

    def _equations(self) -> tuple[Coefficients, _Bases, list[np.ndarray]]:
        """Coefficient matrices, invariant subspaces and the factors of E0 there."""
        coefficients = coefficient_matrices(
            self.coordinates, self.order, self.closed, self.elasticity, density=self.density
        )
        mirrored = self.isotropic and _uniform(self.elasticity, self.density)
        bases = _bases(self.coordinates, self.order, self.closed, mirrored)
        return coefficients, bases, _factors(coefficients, bases)

    @property
    def mass(self) -> np.ndarray:
        """(n, n): M, symmetric."""
        return self._with_dynamics.mass

    @property
    def coupling(self) -> np.ndarray:
        """(n, a): C."""
        return self._with_dynamics.coupling

    @property
    def inertia(self) -> np.ndarray:
        """(a,): J > 0, ascending."""
        return self._with_dynamics.inertia

    @property
    def _with_dynamics(self) -> Inertia:
        if self.dynamics is None:
            raise RuntimeError(
                "the inertia of this S-element is not computed; take with_inertia(terms) of it"
            )
        return self.dynamics

    def with_inertia(self, terms: int) -> SElement:
        """The S-element with mass and continued fraction.

        Parameters
        ----------
        terms : int
            Order of the continued fraction (Mcf of the paper), 0 for the mass alone.

        Raises
        ------
        SElementError
            If a matrix that is positive definite in exact arithmetic is not.
        """
        coefficients, bases, factors = self._equations()
        radial = _radial(self.stiffness, coefficients, factors, bases)
        return replace(self, dynamics=_dynamics(coefficients, factors, radial, bases, terms))


def solve_selement(
    coordinates: np.ndarray,
    order: int,
    closed: bool,
    elasticity: np.ndarray,
    terms: int | None = None,
    isotropic: bool = False,
    *,
    density: np.ndarray | None = None,
    method: str | None = None,
) -> SElement:
    """Solve one non-dimensional S-element.

    Parameters
    ----------
    coordinates : (nodes, 2) array
        Boundary nodes relative to the scaling centre, counter-clockwise, in units of the element's size.
    order : int
    closed : bool
    elasticity : (3, 3) or (edges, 3, 3) array
        D / E, of the S-element or of the sector that each edge spans with the scaling centre.
    terms : int, optional
        Order of the continued fraction (Mcf of the paper), 0 for stiffness and mass; default: the stiffness
        alone.
    isotropic : bool
        Whether mirror symmetries of the outline are symmetries of the S-element; its equations then separate.
    density : (edges,) array, optional
        Densities of the sectors in units of the one that the inertia is scaled with; default: 1.
    method : {"doubling", "schur"}, optional
        How the stiffness is computed (`stiffness.static_stiffness`).

    Raises
    ------
    SElementError
        If the boundary is not visible from the scaling centre or a check fails.
    """
    elasticity = np.asarray(elasticity, dtype=float)
    coefficients = coefficient_matrices(coordinates, order, closed, elasticity, density=density)
    motions = rigid_motions(coordinates)
    bases = _bases(coordinates, order, closed, isotropic and _uniform(elasticity, density))
    factors = _factors(coefficients, bases)
    parts = [
        _solve_subspace(coefficients, factor, motions[:, :2], basis, method)
        for basis, factor in zip(bases, factors)
    ]
    stiffness = symmetric(_whole([part[0] for part in parts], bases))
    radial = _radial(stiffness, coefficients, factors, bases)
    asymmetry = max(part[1] for part in parts)
    scale = largest(stiffness)
    riccati = largest((stiffness - coefficients.e1) @ radial - coefficients.e2) / max(
        largest(coefficients.e2), scale
    )
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
    return SElement(
        coordinates,
        order,
        closed,
        elasticity,
        isotropic,
        stiffness,
        riccati,
        asymmetry,
        rigid,
        density,
        None if terms is None else _dynamics(coefficients, factors, radial, bases, terms),
    )


# A basis is None where the whole space is taken: products with an identity would cost as much as others.
_Bases = list[np.ndarray] | list[None]


def _uniform(elasticity: np.ndarray, density: np.ndarray | None) -> bool:
    """Whether all sectors are of one material, so that the outline's mirrors are the S-element's."""
    return elasticity.ndim == 2 and density is None


def _bases(coordinates: np.ndarray, order: int, closed: bool, mirrored: bool) -> _Bases:
    """Bases of the subspaces that the S-element's matrices leave invariant."""
    if not mirrored:
        return [None]
    bases = invariant_subspaces(coordinates, order, closed, True)
    return [None] if len(bases) == 1 else bases


def _restricted(matrix: np.ndarray, basis: np.ndarray | None) -> np.ndarray:
    return matrix if basis is None else basis.T @ matrix @ basis


def _whole(parts: list[np.ndarray], bases: _Bases) -> np.ndarray:
    """Sum of the subspaces' shares of an (n, n) matrix."""
    if bases[0] is None:
        return parts[0]
    return np.sum([basis @ part @ basis.T for basis, part in zip(bases, parts)], axis=0)


def _factors(coefficients: Coefficients, bases: _Bases) -> list[np.ndarray]:
    """Lower Cholesky factors of E0 in the subspaces."""
    return [cholesky(_restricted(coefficients.e0, basis), "coefficient matrix E0") for basis in bases]


def _solve_subspace(
    coefficients: Coefficients,
    factor: np.ndarray,
    translations: np.ndarray,
    basis: np.ndarray | None,
    method: str | None,
) -> tuple[np.ndarray, float]:
    """K and its asymmetry in a subspace that E0, E1 and E2 leave invariant."""
    if basis is not None:
        e0, e1, e2 = (_restricted(m, basis) for m in (coefficients.e0, coefficients.e1, coefficients.e2))
        coefficients = Coefficients(e0, e1, e2, coefficients.m0)
        translations = basis.T @ translations
    stiffness, asymmetry = static_stiffness(coefficients, factor, translations, method)
    # K is singular for rigid-body motions alone: a shift at round-off's level makes it definite, or something
    # is wrong
    shifted = stiffness + TOLERANCE * largest(stiffness) * np.eye(len(stiffness))
    cholesky(shifted, "stiffness")
    return stiffness, asymmetry


def _radial(
    stiffness: np.ndarray, coefficients: Coefficients, factors: list[np.ndarray], bases: _Bases
) -> np.ndarray:
    """A from K."""
    right = stiffness - coefficients.e1.T
    return _whole([cholesky_solve(f, _restricted(right, basis)) for f, basis in zip(factors, bases)], bases)


def _dynamics(
    coefficients: Coefficients, factors: list[np.ndarray], radial: np.ndarray, bases: _Bases, terms: int
) -> Inertia:
    """Inertia from that of the subspaces."""
    parts = [
        continued_fraction(_restricted(coefficients.m0, basis), factor, _restricted(radial, basis), terms)
        for basis, factor in zip(bases, factors)
    ]
    if bases[0] is None:
        return parts[0]
    inertia = np.concatenate([part.inertia for part in parts])
    coupling = np.concatenate([basis @ part.coupling for basis, part in zip(bases, parts)], axis=1)
    ascending = np.argsort(inertia, kind="stable")
    mass = _whole([part.mass for part in parts], bases)
    return Inertia(symmetric(mass), coupling[:, ascending], inertia[ascending])
