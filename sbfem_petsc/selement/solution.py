"""Stiffness, mass and continued fraction of one S-element, non-dimensional and checked.

Lengths are in units of the element's size h, stresses in units of the modulus E, and x = -omega^2 is in units
of E / (rho h^2), so that similar elements share one solution.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from .coefficients import Coefficients, SElementError, coefficient_matrices
from .dense import ADVICE, cholesky, cholesky_solve, is_definite, largest, symmetric
from .inertia import Inertia, Moments, continued_fraction
from .polynomial_modes import PolynomialModes, polynomial_modes
from .rigid_motions import rigid_motions
from .sectors import Sectors
from .stiffness import ACCEPTED, static_stiffness, stiffness_beyond
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
    dynamics : Inertia, Moments or None
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
    dynamics: Inertia | Moments | None = None

    @property
    def radial(self) -> np.ndarray:
        """(n, n): A = E0^-1 (K - E1^T); static displacements along the radius are u(xi) = xi^A u(1).

        Computed each time: of many S-elements it would take as much memory as their stiffness.
        """
        return self._equations().radial(self.stiffness)

    def _equations(self) -> _Equations:
        return _equations(
            self.coordinates, self.order, self.closed, self.elasticity, self.isotropic, self.density
        )

    @property
    def mass(self) -> np.ndarray:
        """(n, n): M, symmetric."""
        return self._with_dynamics.mass

    @property
    def coupling(self) -> np.ndarray:
        """(n, a): C."""
        return self._fraction.coupling

    @property
    def inertia(self) -> np.ndarray:
        """(a,): J > 0, ascending."""
        return self._fraction.inertia

    @property
    def _with_dynamics(self) -> Inertia | Moments:
        if self.dynamics is None:
            raise RuntimeError(
                "the inertia of this S-element is not computed; take with_inertia(terms) of it"
            )
        return self.dynamics

    @functools.cached_property
    def _fraction(self) -> Inertia:
        found = self._with_dynamics
        return self.with_inertia(1)._fraction if isinstance(found, Moments) else found

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
        equations = self._equations()
        dynamics = _dynamics(equations, equations.radial(self.stiffness), terms)
        return replace(self, dynamics=dynamics)


def solve_selement(
    sectors: Sectors,
    closed: bool,
    terms: int | None = None,
    isotropic: bool = False,
    *,
    density: np.ndarray | None = None,
    method: str | None = None,
) -> SElement:
    """Solve one non-dimensional S-element.

    Parameters
    ----------
    sectors : Sectors
    closed : bool
    terms : int, optional
        Order of the continued fraction (Mcf of the paper), 0 for stiffness and mass; default: the stiffness
        alone.
    isotropic : bool
        Whether mirror symmetries of the outline are symmetries of the S-element; its equations then separate.
    density : (edges,) array, optional
        Densities of the sectors in units of the one that the inertia is scaled with; default: 1.
    method : {"doubling", "schur"}, optional
        How the stiffness is computed (`stiffness.static_stiffness`); default: what goes beyond the polynomial
        modes, where these are known, else all of it by doubling.

    Raises
    ------
    SElementError
        If the boundary is not visible from the scaling centre or a check fails.
    """
    coordinates, order, elasticity = sectors
    elasticity = np.asarray(elasticity, dtype=float)
    equations = _equations(coordinates, order, closed, elasticity, isotropic, density)
    motions = rigid_motions(coordinates)
    solved = _beyond_polynomials(equations) if method is None else None
    stiffness, asymmetry, radial, riccati = solved or _by_subspaces(equations, motions[:, :2], method)
    rigid = largest(stiffness @ motions) / largest(stiffness)
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
        None if terms is None else _dynamics(equations, radial, terms),
    )


# A basis is None where the whole space is taken: products with an identity would cost as much as others.
_Bases = list[np.ndarray] | list[None]
# Stiffness, its asymmetry, A, and the residual of the Riccati equation.
_Solved = tuple[np.ndarray, float, np.ndarray, float]


@dataclass(frozen=True, eq=False)
class _Equations:
    """What the stiffness and the inertia of an S-element follow from.

    Attributes
    ----------
    coefficients : Coefficients
    bases : list
        Bases of the subspaces that the S-element's matrices leave invariant.
    factors : list of arrays
        Lower Cholesky factors of E0 in the subspaces.
    known : PolynomialModes or None
        Of this one.
    """

    coefficients: Coefficients
    bases: _Bases
    factors: list[np.ndarray]
    known: PolynomialModes | None

    def radial(self, stiffness: np.ndarray) -> np.ndarray:
        """A from K."""
        right = stiffness - self.coefficients.e1.T
        parts = [cholesky_solve(f, _restricted(right, b)) for f, b in zip(self.factors, self.bases)]
        return _whole(parts, self.bases)

    def judged(self, stiffness: np.ndarray) -> tuple[np.ndarray, float]:
        """A, and the relative residual of the Riccati equation."""
        c, radial = self.coefficients, self.radial(stiffness)
        residual = largest((stiffness - c.e1) @ radial - c.e2)
        return radial, residual / max(largest(c.e2), largest(stiffness))


def _equations(
    coordinates: np.ndarray,
    order: int,
    closed: bool,
    elasticity: np.ndarray,
    isotropic: bool,
    density: np.ndarray | None,
) -> _Equations:
    coefficients = coefficient_matrices(coordinates, order, closed, elasticity, density=density)
    uniform = elasticity.ndim == 2
    # the outline's mirrors are the S-element's if all sectors are of one material
    mirrored = isotropic and uniform and density is None
    bases: _Bases = invariant_subspaces(coordinates, order, closed, True) if mirrored else [None]
    known = None
    if len(bases) == 1:
        bases = [None]
        if closed and uniform:
            found = polynomial_modes(coordinates[None], order, elasticity, coefficients.of(None))
            known = next((modes for _, modes in found), None)
    factors = [cholesky(_restricted(coefficients.e0, b), "coefficient matrix E0") for b in bases]
    return _Equations(coefficients, bases, factors, known)


def _restricted(matrix: np.ndarray, basis: np.ndarray | None) -> np.ndarray:
    return matrix if basis is None else basis.T @ matrix @ basis


def _whole(parts: list[np.ndarray], bases: _Bases) -> np.ndarray:
    """Sum of the subspaces' shares of an (n, n) matrix."""
    if bases[0] is None:
        return parts[0]
    return np.sum([basis @ part @ basis.T for basis, part in zip(bases, parts)], axis=0)


def _beyond_polynomials(equations: _Equations) -> _Solved | None:
    """The solution from the polynomial modes; None where they are not known or cost digits."""
    if equations.known is None:
        return None
    found = stiffness_beyond(equations.coefficients.of(None), equations.known)
    if found is None or not found[2].all():
        return None
    stiffness = found[0][0]
    radial, riccati = equations.judged(stiffness)
    if not (riccati <= ACCEPTED and is_definite(shifted(stiffness))):
        return None
    return stiffness, float(found[1][0]), radial, riccati


def _by_subspaces(equations: _Equations, translations: np.ndarray, method: str | None) -> _Solved:
    """The solution by doubling or by Schur forms."""
    parts = [
        _solve_subspace(equations.coefficients, factor, translations, basis, method)
        for basis, factor in zip(equations.bases, equations.factors)
    ]
    stiffness = symmetric(_whole([part[0] for part in parts], equations.bases))
    return (stiffness, max(part[1] for part in parts), *equations.judged(stiffness))


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
    cholesky(shifted(stiffness), "stiffness")
    return stiffness, asymmetry


def shifted(stiffness: np.ndarray) -> np.ndarray:
    """K is singular for rigid-body motions alone: a shift at round-off's level makes it definite, or
    something is wrong.
    """
    return stiffness + TOLERANCE * largest(stiffness) * np.eye(len(stiffness))


def _dynamics(equations: _Equations, radial: np.ndarray, terms: int) -> Inertia:
    """Inertia from that of the subspaces."""
    m0, bases, known = equations.coefficients.m0, equations.bases, equations.known
    form = None if known is None else known.schur_form(radial)
    parts = [
        continued_fraction(_restricted(m0, basis), factor, _restricted(radial, basis), terms, form=form)
        for basis, factor in zip(bases, equations.factors)
    ]
    if bases[0] is None:
        return parts[0]
    inertia = np.concatenate([part.inertia for part in parts])
    coupling = np.concatenate([basis @ part.coupling for basis, part in zip(bases, parts)], axis=1)
    ascending = np.argsort(inertia, kind="stable")
    mass = _whole([part.mass for part in parts], bases)
    return Inertia(symmetric(mass), coupling[:, ascending], inertia[ascending])
