"""Static stiffness of an S-element from its coefficient matrices.

With F = E0^-1 the stiffness K solves the Riccati equation ``(K - E1) F (K - E1^T) - E2 = 0`` such that the
radial modes grow with xi: all eigenvalues of ``A = F (K - E1^T)`` but the zeros of the two translations have
positive real parts. The translations R are deflated exactly (E1^T R = 0, E2 R = 0 and K R = 0); on their
complement P the equation is ``a^T X + X a - X g X + q = 0`` with X = P^T K P.

Structure-preserving doubling (Chu, Fan, Lin 2005) solves it by products and linear systems alone and keeps
the symmetry. Where it does not reach round-off the invariant subspace of an ordered real Schur form is taken,
never eigenvectors: the radial modes are nearly dependent.

Where polynomial modes are known (`polynomial_modes`), with K V = Y on an orthonormal basis V of them, the
same is done on their complement W, with K0 = Y V^T + V Y^T W W^T in the place of zero:
``a = -W^T F (K0 - E1^T) W`` and ``q = W^T (E2 - (K0 - E1) F (K0 - E1^T)) W``.
"""

from __future__ import annotations

import numpy as np

from .coefficients import Coefficients, SElementError
from .dense import ADVICE, growing_subspace, largest, solve, symmetric, turned
from .polynomial_modes import PolynomialModes
from .rigid_motions import translations

# Doubling converges quadratically: two increments tell the next one, which is not made where it is below
# this. From 1 to 400 unknowns it takes 4 to 14 steps; its residual is 1e-15 to 1e-13, and beyond ACCEPTED
# the Schur form is asked.
_INCREMENT, _STEPS, ACCEPTED = 1e-15, 30, 1e-12


def static_stiffness(coefficients: Coefficients, method: str | None = None) -> tuple[np.ndarray, float]:
    """K, and its relative asymmetry before the symmetrisation.

    Parameters
    ----------
    coefficients : Coefficients
        With E0 that is definite.
    method : {"doubling", "schur"}, optional
        Default: doubling, and the Schur form where the residual of doubling is not at round-off.

    Raises
    ------
    SElementError
        If the radial modes cannot be separated.
    """
    _, complement = translations(len(coefficients.e0))
    a, g, q = _equation(coefficients, complement, -(coefficients.e1.T @ complement))
    found = None if method == "schur" else _doubling(a[None], symmetric(g)[None], symmetric(q)[None])
    if found is not None and found[1].all():
        reduced = found[0][0]
    else:
        if method == "doubling":
            raise SElementError(f"structured doubling did not converge; {ADVICE}")
        reduced = _invariant_subspace(a, g, q)
    return complement @ symmetric(reduced) @ complement.T, largest(reduced - reduced.T) / largest(reduced)


def stiffness_beyond(
    coefficients: Coefficients, known: PolynomialModes
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """K (b, n, n) of many S-elements, its relative asymmetries (b,), and whether round-off was reached (b,),
    from what it does to the polynomial modes and by doubling on the rest; None where a matrix is singular.
    """
    basis, rest, forces = known.basis, known.rest, known.forces
    mixed = turned(forces) @ rest  # V^T K W
    try:
        a, g, q = _equation(coefficients, rest, basis @ mixed - turned(coefficients.e1) @ rest)
    except np.linalg.LinAlgError:
        return None
    done = (q, np.ones(len(q), dtype=bool))
    found = _doubling(a, symmetric(g), symmetric(q), True) if rest.size else done
    if found is None:
        return None
    half = turned(basis) @ forces  # V^T K V
    both = forces @ turned(basis)
    both += (basis @ mixed + rest @ found[0]) @ turned(rest)
    return symmetric(both), largest_of_each(half - turned(half)) / largest_of_each(half), found[1]


def _equation(
    c: Coefficients, rest: np.ndarray, right: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """a, g and q of the equation on a complement W (n, m), or on many, from (K0 - E1^T) W."""
    solved = np.linalg.solve(c.e0, np.concatenate([rest, right], axis=-1))
    inverse, inverse_right = np.split(solved, 2, axis=-1)
    q = turned(rest) @ (c.e2 @ rest) - turned(right) @ inverse_right
    return -(turned(rest) @ inverse_right), turned(rest) @ inverse, q


def _doubling(
    a: np.ndarray, g: np.ndarray, q: np.ndarray, high: bool = False
) -> tuple[np.ndarray, np.ndarray] | None:
    """X (b, m, m) of b problems by structured doubling, and which of them have reached round-off (b,); None
    where a matrix is singular. `high`: the lowest radial exponents are none of the problems.
    """
    try:
        with np.errstate(all="ignore"):  # what overflows does not reach round-off
            return _doubled(a, g, q, high)
    except np.linalg.LinAlgError:
        return None


def _doubled(a: np.ndarray, g: np.ndarray, q: np.ndarray, high: bool) -> tuple[np.ndarray, np.ndarray]:
    count, m, _ = a.shape
    identity = np.eye(m)
    # The eigenvalues are the radial exponents, from 1/2 or 1 to a few times their root mean square, which
    # the trace of the squared Hamiltonian gives; the shift lies in the geometric middle, which is about that
    # mean without the lowest ones.
    mean_square = np.abs((a * turned(a)).sum(axis=(1, 2)) + (g * q).sum(axis=(1, 2))) / m
    shift = (np.sqrt(mean_square) if high else 2.0 * mean_square**0.25)[:, None, None]
    inverse = np.linalg.inv(a - shift * identity)
    for _ in range(3):
        # an eigenvalue of a near the shift costs digits though it is none of the problem
        near = np.flatnonzero(shift[:, 0, 0] * largest_of_each(inverse) >= 50.0)
        if not len(near):
            break
        shift[near] *= 1.5
        inverse[near] = np.linalg.inv(a[near] - shift[near] * identity)
    gain = inverse @ g
    other = np.linalg.inv(turned(a - shift * identity) + q @ gain)
    step, twice = identity + 2.0 * shift * other, 2.0 * shift
    dual = symmetric(twice * (gain @ other))
    x = symmetric(twice * (other @ (q @ inverse)))
    going, done, former = np.arange(count), np.zeros(count, dtype=bool), np.ones(count)
    for _ in range(_STEPS):
        matrix = x[going] @ dual + identity
        solved = np.linalg.solve(turned(matrix), turned(np.concatenate([step, dual], axis=1)))
        half, rest = turned(solved[:, :, :m]), solved[:, :, m:]
        increment = (step @ x[going]) @ turned(half)
        x[going] += increment
        share = _norms(increment) / _norms(x[going])
        small = share * np.maximum(share, (share / former[going]) ** 2) <= _INCREMENT
        former[going] = share
        done[going[small]] = True
        if small.all():
            break
        left = ~small
        going, half, rest, step, dual = going[left], half[left], rest[left], step[left], dual[left]
        dual = dual + (turned(step) @ rest) @ step
        step = half @ step
    x = symmetric(x)
    product = x @ a
    residual = largest_of_each(product + turned(product) - x @ g @ x + q)
    return x, done & (residual <= ACCEPTED * np.maximum(largest_of_each(q), largest_of_each(product)))


def largest_of_each(matrices: np.ndarray) -> np.ndarray:
    """(b,): largest absolute entries."""
    return np.asarray(np.abs(matrices).max(axis=(1, 2)))


def _norms(matrices: np.ndarray) -> np.ndarray:
    """(b,): Frobenius norms."""
    return np.sqrt((matrices * matrices).sum(axis=(1, 2)))


def _invariant_subspace(a: np.ndarray, g: np.ndarray, q: np.ndarray) -> np.ndarray:
    """X from the invariant subspace of the growing modes of the Hamiltonian [[-a, g], [q, a^T]]."""
    m = len(a)
    hamiltonian = np.empty((2 * m, 2 * m), order="F")
    hamiltonian[:m, :m], hamiltonian[:m, m:] = -a, g
    hamiltonian[m:, :m], hamiltonian[m:, m:] = q, a.T
    vectors, growing = growing_subspace(hamiltonian)
    if growing != m:
        raise SElementError(f"{growing} growing radial modes instead of {m}; {ADVICE}")
    return solve(vectors[:m, :m].T, vectors[m:, :m].T).T
