"""Eigenvalues of a product of matrices without the product: the periodic QR algorithm.

Unitary Q_k make B_k = Q_(k+1)^* F_k Q_k, cyclic in k, upper triangular, so that the eigenvalues of
F_n ... F_2 F_1 are the products of the diagonals (A. Bojanczyk, G. Golub, P. Van Dooren, Proc. SPIE 1770, 31,
1992). The errors are those of perturbations of each factor by rounding of its own norm.
"""

from __future__ import annotations

import numpy as np

from ..contact.compiled import compiled
from ..errors import SolveError, on_all_ranks

ROUND_OFF = 2.3e-16
# Sweeps for an eigenvalue at most; every so many take no shift, which is lost in the rounding of products
# that are graded the wrong way round.
SWEEPS, PLAIN = 300, 5


@compiled
def rotate(factors: np.ndarray) -> None:
    """Bring the last of real factors (n, s, s), in place, to upper Hessenberg form by rotations of its rows,
    each chased through the triangular others.
    """
    last, size = len(factors) - 1, factors.shape[1]
    for j in range(size - 2):
        for i in range(size - 1, j + 1, -1):
            one, other = factors[last, i - 1, j], factors[last, i, j]
            length = np.hypot(one, other)
            if other == 0.0 or length == 0.0:
                continue
            cosine, sine = one / length, other / length
            for column in range(j, size):
                upper, lower = factors[last, i - 1, column], factors[last, i, column]
                factors[last, i - 1, column] = cosine * upper + sine * lower
                factors[last, i, column] = cosine * lower - sine * upper
            factors[last, i, j] = 0.0
            for k in range(last):
                for row in range(i + 1):
                    left, right = factors[k, row, i - 1], factors[k, row, i]
                    factors[k, row, i - 1] = cosine * left + sine * right
                    factors[k, row, i] = cosine * right - sine * left
                one, other = factors[k, i - 1, i - 1], factors[k, i, i - 1]
                length = np.hypot(one, other)
                cosine, sine = (1.0, 0.0) if length == 0.0 else (one / length, other / length)
                for column in range(i - 1, size):
                    upper, lower = factors[k, i - 1, column], factors[k, i, column]
                    factors[k, i - 1, column] = cosine * upper + sine * lower
                    factors[k, i, column] = cosine * lower - sine * upper
                factors[k, i, i - 1] = 0.0
            for row in range(size):
                left, right = factors[last, row, i - 1], factors[last, row, i]
                factors[last, row, i - 1] = cosine * left + sine * right
                factors[last, row, i] = cosine * right - sine * left


@compiled
def triangulate(factors: np.ndarray) -> bool:
    """Bring complex factors in the form that `rotate` leaves, in place, to upper triangular form on their
    diagonals and what is needed of them: the entries above are those of windows in which the iteration has
    worked. Returns whether it has ended.
    """
    count, size = factors.shape[0], factors.shape[1]
    last = count - 1
    top, sweeps = size - 1, 0
    while top > 0:
        # the window whose last entry is `top`
        low = top
        while low > 0:
            beside = abs(factors[last, low, low]) + abs(factors[last, low - 1, low - 1])
            if beside == 0.0:
                beside = 1.0
            if abs(factors[last, low, low - 1]) <= ROUND_OFF * beside:
                factors[last, low, low - 1] = 0.0
                break
            low -= 1
        if low == top:
            top, sweeps = top - 1, 0
            continue
        sweeps += 1
        if sweeps > SWEEPS:
            return False
        # the shift over the product of the triangular factors' diagonals at the window's beginning, by
        # logarithms: products of many factors leave the range of numbers
        ratio = 0.0j
        if sweeps % PLAIN:
            ratio = _shift(factors, low, top)
        one, other = factors[last, low, low] - ratio, factors[last, low + 1, low]
        for i in range(low, top):
            if i > low:
                one, other = factors[last, i, i - 1], factors[last, i + 1, i - 1]
            length = np.hypot(abs(one), abs(other))
            cosine, sine = 1.0 + 0.0j, 0.0j
            if length > 0.0:
                cosine, sine = one / length, other / length
            for column in range(max(i - 1, low), top + 1):
                upper, lower = factors[last, i, column], factors[last, i + 1, column]
                factors[last, i, column] = cosine.conjugate() * upper + sine.conjugate() * lower
                factors[last, i + 1, column] = cosine * lower - sine * upper
            if i > low:
                factors[last, i + 1, i - 1] = 0.0
            for k in range(last):
                for row in range(low, i + 2):
                    left, right = factors[k, row, i], factors[k, row, i + 1]
                    factors[k, row, i] = left * cosine + right * sine
                    factors[k, row, i + 1] = right * cosine.conjugate() - left * sine.conjugate()
                one, other = factors[k, i, i], factors[k, i + 1, i]
                length = np.hypot(abs(one), abs(other))
                cosine, sine = 1.0 + 0.0j, 0.0j
                if length > 0.0:
                    cosine, sine = one / length, other / length
                for column in range(i, top + 1):
                    upper, lower = factors[k, i, column], factors[k, i + 1, column]
                    factors[k, i, column] = cosine.conjugate() * upper + sine.conjugate() * lower
                    factors[k, i + 1, column] = cosine * lower - sine * upper
                factors[k, i + 1, i] = 0.0
            for row in range(low, min(i + 2, top) + 1):
                left, right = factors[last, row, i], factors[last, row, i + 1]
                factors[last, row, i] = left * cosine + right * sine
                factors[last, row, i + 1] = right * cosine.conjugate() - left * sine.conjugate()
    return True


@compiled
def _shift(factors: np.ndarray, low: int, top: int) -> complex:
    """Eigenvalue of the product's last two rows and columns that is next to its last entry, over the product
    of the triangular factors' first diagonal entries in the window; 0 where it is out of range.
    """
    last, under = factors.shape[0] - 1, top - 1
    # upper triangular products, with the scale taken out
    a, b, d, scale, first = 1.0 + 0.0j, 0.0j, 1.0 + 0.0j, 0.0, 1.0 + 0.0j
    # the row above them, which the last factor's entry left of the two takes up
    e, f, first_scale = 0.0j, 0.0j, 0.0
    above = under - 1 >= low
    for k in range(last):
        t = factors[k]
        if above:
            e, f = (
                t[under - 1, under - 1] * e + t[under - 1, under] * a,
                t[under - 1, under - 1] * f + t[under - 1, under] * b + t[under - 1, top] * d,
            )
        a, b, d = t[under, under] * a, t[under, under] * b + t[under, top] * d, t[top, top] * d
        size = max(max(abs(a), abs(b)), max(abs(d), max(abs(e), abs(f))))
        if size == 0.0:
            return 0.0j
        a, b, d, e, f, scale = a / size, b / size, d / size, e / size, f / size, scale + np.log(size)
        first = first * t[low, low]
        size = abs(first)
        if size == 0.0:
            return 0.0j
        first, first_scale = first / size, first_scale + np.log(size)
    h = factors[last]
    p11, p12 = h[under, under] * a, h[under, under] * b + h[under, top] * d
    p21, p22 = h[top, under] * a, h[top, under] * b + h[top, top] * d
    if above:
        p11, p12 = p11 + h[under, under - 1] * e, p12 + h[under, under - 1] * f
    half = 0.5 * (p11 - p22)
    root = np.sqrt(half * half + p12 * p21)
    if (half.conjugate() * root).real < 0.0:
        root = -root
    denominator = half + root
    shift = p22
    if denominator != 0.0:
        shift = p22 - p12 * p21 / denominator
    exponent = scale - first_scale
    if abs(exponent) > 600.0:
        return 0.0j
    return shift / first * np.exp(exponent)


def product_eigenvalues(factors: np.ndarray) -> np.ndarray:
    """Eigenvalues of F_n ... F_2 F_1 by falling modulus, without the product, in whose rounding small ones
    are lost.

    Each is that of factors which differ from the given ones by about 1e-15 of their norms: relative errors
    are that times the condition of the eigenvalue, whatever its size beside the largest.

    Parameters
    ----------
    factors : (n, s, s) array

    Raises
    ------
    SolveError
        If the factors are not finite, or the iteration does not end.
    """
    blocks = np.array(factors, dtype=float)
    count, size = blocks.shape[:2]
    norms = np.abs(blocks).max(axis=(1, 2))
    if not np.isfinite(norms).all():
        raise on_all_ranks(SolveError("Floquet multipliers: the derivative of a segment is not finite"))
    if not norms.all():
        return np.zeros(size, dtype=complex)
    blocks /= norms[:, None, None]
    if count == 1:
        values = np.linalg.eigvals(blocks[0]).astype(complex) * norms[0]
        return values[np.argsort(-np.abs(values), kind="stable")]
    for k in range(count - 1):
        turn, blocks[k] = np.linalg.qr(blocks[k])
        blocks[k + 1] = blocks[k + 1] @ turn
    rotate(blocks)
    turned = blocks.astype(complex)
    if not triangulate(turned):
        raise on_all_ranks(
            SolveError(
                f"Floquet multipliers: the periodic QR iteration has not ended in {SWEEPS} sweeps for one of "
                f"{size} eigenvalues; take another number of segments"
            )
        )
    with np.errstate(divide="ignore", over="ignore"):
        diagonals = np.einsum("kii->ki", turned)
        logarithms = np.log(np.abs(diagonals)).sum(axis=0) + np.log(norms).sum()
        angles = np.angle(diagonals).sum(axis=0)
        values = np.exp(logarithms) * np.exp(1j * angles)
    return _conjugate(values[np.argsort(-np.abs(values), kind="stable")])


def _conjugate(values: np.ndarray) -> np.ndarray:
    """The eigenvalues of a real product of those that complex arithmetic has found: pairs made conjugate, and
    what rounding has turned made real.
    """
    result, left = values.copy(), list(range(len(values)))
    while left:
        one = left.pop(0)
        if values[one].imag == 0.0 or not left:
            result[one] = values[one].real
            continue
        apart = np.abs(values[left] - values[one].conjugate())
        other = int(np.argmin(apart))
        # nearer to its own mirror image than to another's: real
        if 2.0 * abs(values[one].imag) <= apart[other]:
            result[one] = values[one].real
            continue
        partner = left.pop(other)
        mean = 0.5 * (values[one] + values[partner].conjugate())
        result[one], result[partner] = mean, mean.conjugate()
    return result
