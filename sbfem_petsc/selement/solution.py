"""Stiffness, mass and continued fraction of S-elements, non-dimensional and checked.

Lengths are in units of the element's size h, stresses in units of the modulus E, and x = -omega^2 is in units
of E / (rho h^2), so that similar elements share one solution.

Many closed S-elements of one material and one number of nodes are solved at once: what NumPy does with stacks
of matrices costs a fraction of what it costs one by one. What a stack does not solve to round-off, as curved
or very flat outlines, is None, and left to `solve_selement`, which says why where it cannot either.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .coefficients import Coefficients, SElementError, coefficient_matrices, edge_nodes, straight_edges
from .dense import ADVICE, SchurForm, cholesky, cholesky_solve, is_definite, largest, schur, turned
from .inertia import Inertia, Moments, continued_fraction, moments
from .polynomial_modes import PolynomialModes, polynomial_modes
from .rigid_motions import rigid_motions
from .sectors import Sectors
from .stiffness import ACCEPTED, largest_of_each, static_stiffness, stiffness_beyond

# Round-off of the stiffness and the Lyapunov solves grows with the number of unknowns; up to 400 unknowns an
# element 1e-13 to 1e-11 is met, while a wrong split of the spectrum shows as 1e-6 or more.
TOLERANCE = 1e-8
# Of S-elements that are solved at once: their matrices stay in a processor's cache.
STACK = 32
_E0 = "coefficient matrix E0"


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
        c = self._coefficients()
        return cholesky_solve(cholesky(c.e0, _E0), self.stiffness - c.e1.T)

    @functools.cached_property
    def radial_form(self) -> SchurForm:
        """Of A, kept for what is told of tips."""
        return schur(self.radial)

    def _coefficients(self) -> Coefficients:
        return coefficient_matrices(
            self.coordinates, self.order, self.closed, self.elasticity, density=self.density
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
        c = self._coefficients()
        factor = cholesky(c.e0, _E0)
        radial = cholesky_solve(factor, self.stiffness - c.e1.T)
        return replace(self, dynamics=continued_fraction(c.m0, factor, radial, terms))


def solve_selement(
    sectors: Sectors,
    closed: bool,
    terms: int | None = None,
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
    shape, order, elasticity = sectors
    stack = Sectors(shape[None], order, np.asarray(elasticity, dtype=float))
    element = _solved(stack, closed, density, method)[0]
    return element if terms is None else element.with_inertia(terms)


def solve_selements(
    stack: Sectors, closed: bool, terms: int | None = None, *, density: np.ndarray | None = None
) -> list[SElement]:
    """Solve many non-dimensional S-elements of one number of nodes as `solve_selement`, those at once that
    can be.

    Parameters
    ----------
    stack : Sectors
        With (k, nodes, 2) shapes and one elasticity, that of `solve_selement`.
    closed, terms, density
        As of `solve_selement`.
    """
    found = _solved(stack, closed, density, None)
    if terms is None:
        return found
    return [
        element.with_inertia(terms) if dynamics is None else replace(element, dynamics=dynamics)
        for element, dynamics in zip(found, inertia_of_stack(found, terms))
    ]


def _solved(stack: Sectors, closed: bool, density: np.ndarray | None, method: str | None) -> list[SElement]:
    """The stiffness of each, of those at once that can be."""
    shapes, order, elasticity = stack
    found: list[SElement | None] = [None] * len(shapes)
    if method is None and closed and elasticity.ndim == 2 and density is None:
        found = solve_stack(stack)
    return [
        element or _solved_alone(Sectors(shape, order, elasticity), closed, density, method)
        for shape, element in zip(shapes, found)
    ]


def _solved_alone(sectors: Sectors, closed: bool, density: np.ndarray | None, method: str | None) -> SElement:
    """The stiffness by doubling or by Schur forms, without known modes but the translations."""
    coordinates, order, elasticity = sectors
    c = coefficient_matrices(coordinates, order, closed, elasticity, density=density)
    factor, motions = cholesky(c.e0, _E0), rigid_motions(coordinates)
    stiffness, asymmetry = static_stiffness(c, method)
    cholesky(_shifted(stiffness), "stiffness")
    residual = (stiffness - c.e1) @ cholesky_solve(factor, stiffness - c.e1.T) - c.e2
    riccati = largest(residual) / max(largest(c.e2), largest(stiffness))
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
    return SElement(coordinates, order, closed, elasticity, stiffness, riccati, asymmetry, rigid, density)


def _shifted(stiffness: np.ndarray) -> np.ndarray:
    """K is singular for rigid-body motions alone: a shift at round-off's level makes it definite, or
    something is wrong.
    """
    return stiffness + TOLERANCE * largest(stiffness) * np.eye(len(stiffness))


# Rows of S-elements of a stack, their coefficient matrices and their polynomial modes.
Begun = list[tuple[np.ndarray, Coefficients, PolynomialModes]]


def begun(stack: Sectors) -> Begun:
    """What stiffness and inertia of a stack both begin with: of those whose polynomial modes are known."""
    shapes, order, elasticity = stack
    straight = np.flatnonzero(straight_edges(shapes, order, edge_nodes(shapes.shape[1], order, True)))
    try:
        c = coefficient_matrices(shapes[straight], order, True, elasticity)
        found = polynomial_modes(shapes[straight], order, elasticity, c)
        return [(straight[some], c.of(some), known) for some, known in found]
    except (SElementError, np.linalg.LinAlgError):  # of one of them
        return []


def solve_stack(stack: Sectors, start: Begun | None = None) -> list[SElement | None]:
    """The stiffness of each.

    Parameters
    ----------
    stack : Sectors
        With (b, nodes, 2) shapes, one elasticity, and closed outlines.
    start : Begun, optional
        `begun` of it, where that is there.
    """
    shapes, order, elasticity = stack

    def solve(rows: np.ndarray, c: Coefficients, known: PolynomialModes) -> list[SElement | None]:
        found = stiffness_beyond(c, known)
        if found is None:
            return [None] * len(rows)
        stiffness, asymmetry, good = found
        radial = np.linalg.solve(c.e0, stiffness - turned(c.e1))
        riccati = largest_of_each((stiffness - c.e1) @ radial - c.e2)
        riccati /= np.maximum(largest_of_each(c.e2), largest_of_each(stiffness))
        rigid = largest_of_each(stiffness @ rigid_motions(shapes[rows])) / largest_of_each(stiffness)
        good &= (riccati <= ACCEPTED) & (asymmetry < TOLERANCE) & (rigid < TOLERANCE)
        return [
            SElement(shapes[row], order, True, elasticity, k, float(r), float(a), float(m))
            if fine and is_definite(e0) and is_definite(_shifted(k))
            else None
            for row, k, r, a, m, fine, e0 in zip(rows, stiffness, riccati, asymmetry, rigid, good, c.e0)
        ]

    return _each(len(stack.shape), begun(stack) if start is None else start, solve)


def inertia_of_stack(
    elements: list[SElement], terms: int, start: Begun | None = None
) -> list[Inertia | Moments | None]:
    """The mass of each, and the moments where the continued fraction has `terms` = 1, of S-elements that
    agree in all but their outlines; of more terms, and of open ones or several materials, none is solved.
    `start`: `begun` of them, where that is there.
    """
    first = elements[0]
    if terms > 1 or not first.closed or first.elasticity.ndim != 2 or first.density is not None:
        return [None] * len(elements)
    stack = Sectors(np.stack([element.coordinates for element in elements]), first.order, first.elasticity)

    def solve(rows: np.ndarray, c: Coefficients, known: PolynomialModes) -> list[Inertia | Moments | None]:
        if not known.rest.size:  # no Schur form is left to take, as of triangles of order 1
            return [None] * len(rows)
        found = moments(c, known, np.stack([elements[row].stiffness for row in rows]))
        none = (np.zeros((len(c.e0[0]), 0)), np.zeros(0))
        return [
            (Moments(mass, second, third) if terms else Inertia(mass, *none))
            if fine and is_definite(mass)
            else None
            for mass, second, third, fine in zip(*found)
        ]

    return _each(len(stack.shape), begun(stack) if start is None else start, solve)


def _each(count: int, start: Begun, solve: Callable[..., list]) -> list:
    """What `solve` finds of those of so many whose polynomial modes are known, None of the others."""
    found: list = [None] * count
    for rows, c, known in start:
        with contextlib.suppress(SElementError, np.linalg.LinAlgError):  # of one of them
            for row, one in zip(rows, solve(rows, c, known)):
                found[row] = one
    return found
