"""Many closed S-elements of one material and one number of nodes at once: what NumPy does with stacks of
matrices costs a fraction of what it costs one by one.

What a stack does not solve to round-off, as curved or very flat outlines, is None, and left to
`solution.solve_selement`, which says why where it cannot either; so are mirrored outlines, which separate
there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import lapack

from .coefficients import Coefficients, SElementError, coefficient_matrices, edge_nodes, straight_edges
from .dense import is_definite, symmetric, turned
from .inertia import Inertia, Moments
from .polynomial_modes import MIXED, PolynomialModes, polynomial_modes
from .rigid_motions import rigid_motions
from .sectors import Sectors
from .solution import TOLERANCE, SElement, shifted
from .stiffness import ACCEPTED, largest_of_each, stiffness_beyond
from .symmetry import mirrored

# Of S-elements: their matrices stay in a processor's cache.
STACK = 32
# Polynomial modes that depend more on one another, as on flat cells, cost moments digits (2e-13 here).
_APART = 0.03


def solve_stack(stack: Sectors, isotropic: bool) -> list[SElement | None]:
    """The stiffness of each.

    Parameters
    ----------
    stack : Sectors
        With (b, nodes, 2) shapes, one elasticity, and closed outlines.
    isotropic : bool
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
        motions = np.stack([rigid_motions(shape) for shape in shapes[rows]])
        rigid = largest_of_each(stiffness @ motions) / largest_of_each(stiffness)
        good &= (riccati <= ACCEPTED) & (asymmetry < TOLERANCE) & (rigid < TOLERANCE)
        return [
            SElement(shapes[row], order, True, elasticity, isotropic, k, float(r), float(a), float(m))
            if fine and is_definite(e0) and is_definite(shifted(k))
            else None
            for row, k, r, a, m, fine, e0 in zip(rows, stiffness, riccati, asymmetry, rigid, good, c.e0)
        ]

    return _each(stack, isotropic, solve)


def inertia_of_stack(elements: list[SElement], terms: int) -> list[Inertia | Moments | None]:
    """The mass of each, and the moments where the continued fraction has `terms` = 1, of S-elements that
    agree in all but their outlines; of more terms than that none is solved.
    """
    if terms > 1:
        return [None] * len(elements)
    first = elements[0]
    stack = Sectors(np.stack([element.coordinates for element in elements]), first.order, first.elasticity)

    def solve(rows: np.ndarray, c: Coefficients, known: PolynomialModes) -> list[Inertia | Moments | None]:
        if not known.rest.size:  # no Schur form is left to take, as of triangles of order 1
            return [None] * len(rows)
        found = _moments(c, known, np.stack([elements[row].stiffness for row in rows]))
        none = (np.zeros((len(c.e0[0]), 0)), np.zeros(0))
        return [
            (Moments(mass, second, third) if terms else Inertia(mass, *none))
            if fine and is_definite(mass)
            else None
            for mass, second, third, fine in zip(*found)
        ]

    return _each(stack, first.isotropic, solve)


def _each(
    stack: Sectors, isotropic: bool, solve: Callable[[np.ndarray, Coefficients, PolynomialModes], list]
) -> list:
    """What `solve` finds of those whose polynomial modes are known, None of the others."""
    shapes, order, elasticity = stack
    found: list = [None] * len(shapes)
    taken = straight_edges(shapes, order, edge_nodes(shapes.shape[1], order, True))
    if isotropic:
        taken &= ~mirrored(shapes, order)
    straight = np.flatnonzero(taken)
    try:
        c = coefficient_matrices(shapes[straight], order, True, elasticity)
        for some, known in polynomial_modes(shapes[straight], order, elasticity, c):
            for row, one in zip(straight[some], solve(straight[some], c.of(some), known)):
                found[row] = one
    except (SElementError, np.linalg.LinAlgError):  # of one of them
        pass
    return found


def _moments(
    c: Coefficients, known: PolynomialModes, stiffness: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """M, P and S (b, n, n), and where they could be told (b,).

    The Lyapunov equations (A^T + s) Y + Y (A + s) = R of s = 1, 2, 3 are solved in the basis X = [modes, W Z]
    with A X = X [[E, N], [0, U]]: the polynomial modes with their exponents E, a complement W and the Schur
    vectors Z of W^T A W. Blocks of Y among the modes are divisions.
    """
    basis, rest, triangle, exponents = known.basis, known.rest, known.triangle, known.exponents
    count, n, k = basis.shape
    right = np.concatenate([stiffness - turned(c.e1), np.broadcast_to(np.eye(n), stiffness.shape)], axis=2)
    solved = np.linalg.solve(c.e0, right)
    radial, flexibility = solved[:, :, :n], solved[:, :, n:]
    good = largest_of_each(turned(rest) @ (radial @ basis)) <= MIXED * largest_of_each(radial)
    sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
    good &= sizes.min(axis=1) >= _APART * sizes.max(axis=1)
    images = radial @ rest
    forms, vectors = np.empty((2, count, n - k, n - k))
    own = turned(rest) @ images
    for b in range(count):
        forms[b], _, _, _, vectors[b], _, info = lapack.dgees(lambda re, im: False, own[b])
        good[b] &= info == 0
    x = np.concatenate([basis @ triangle, rest @ vectors], axis=2)
    dual = np.concatenate([np.linalg.solve(triangle, turned(basis)), turned(rest @ vectors)], axis=1)  # X^-1
    mixed = dual[:, :k] @ images @ vectors
    gram = dual @ flexibility @ turned(dual)

    def lyapunov(right: np.ndarray, shift: float) -> np.ndarray:
        y = np.empty_like(right)
        y[:, :k, :k] = right[:, :k, :k] / (exponents[:, None] + exponents + 2.0 * shift)
        both = right[:, :k, k:] - y[:, :k, :k] @ mixed
        diagonal, away = np.diag(exponents + shift), shift * np.eye(n - k)
        for b in range(count):
            y[b, :k, k:], scale, info = lapack.dtrsyl(diagonal, forms[b] + away, both[b])
            good[b] &= info == 0 and scale == 1.0
        product = turned(mixed) @ y[:, :k, k:]
        corner = right[:, k:, k:] - product - turned(product)
        for b in range(count):
            form = forms[b] + away
            y[b, k:, k:], scale, info = lapack.dtrsyl(form, form, corner[b], trana="T")
            good[b] &= info == 0 and scale == 1.0
        y[:, k:, :k] = turned(y[:, :k, k:])
        return symmetric(y)

    first = lyapunov(turned(x) @ c.m0 @ x, 1.0)
    product = first @ gram
    second = lyapunov(symmetric(product @ first), 2.0)
    third = lyapunov(2.0 * symmetric(product @ second), 3.0)
    mass, second, third = (symmetric(turned(dual) @ y @ dual) for y in (first, second, third))
    return mass, second, third, good
