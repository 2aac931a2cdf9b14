"""Radial modes r^lambda around a tip in closed form: cracks and notches in anisotropic and several materials.

Around the tip the body consists of sectors, each of one material. In a sector a mode is a sum of four complex
functions of r^lambda, with coefficients of their own: Lekhnitskii's ``z_k^lambda, conj(z_k)^lambda``, z_k = x
+ mu_k y, of an anisotropic material, Muskhelishvili's of an isotropic one, whose two mu_k coincide.
Displacements and the derivatives of Airy's function, which are the resultant forces on a ray, are continuous
from sector to sector, and the forces vanish on the two faces. The determinant of these conditions vanishes at
the exponents: 1/2 at any crack in one material, 1/2 +- i eps at one between two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .coefficients import SElementError, edge_nodes

# Exponents closer than this are one double exponent: a double root of the determinant is only found to the
# square root of round-off.
_DOUBLE = 1e-6
_ISOTROPIC = 1e-6


@dataclass(frozen=True, eq=False)
class TipMode:
    """A mode ``2 Re(c r^lambda f)``, or ``c r^lambda f`` where lambda is real.

    Attributes
    ----------
    exponent : complex
    displacement : (n,) complex array
        At the boundary nodes, x and y in turn.
    traction : (2,) complex array
        Normal and shear stress straight ahead of the tip at unit distance.
    """

    exponent: complex
    displacement: np.ndarray
    traction: np.ndarray


def characteristic_roots(compliance: np.ndarray) -> np.ndarray:
    """(2,) complex: the roots mu_k with positive imaginary parts of Lekhnitskii's characteristic equation.

    Parameters
    ----------
    compliance : (3, 3) array
        Strains (xx, yy, 2 xy) from stresses, of the plane problem (the inverse of D).
    """
    s = compliance
    roots = np.roots([s[0, 0], -2.0 * s[0, 2], 2.0 * s[0, 1] + s[2, 2], -2.0 * s[1, 2], s[1, 1]])
    return roots[np.argsort(-roots.imag)][:2]


def is_isotropic(elasticity: np.ndarray) -> bool:
    """Whether a plane elasticity matrix is the same in all directions."""
    d = elasticity
    deviation = [d[0, 0] - d[1, 1], d[0, 2], d[1, 2], d[0, 0] - d[0, 1] - 2.0 * d[2, 2]]
    return bool(np.abs(deviation).max() < _ISOTROPIC * d[0, 0])


def _isotropic_functions(elasticity: np.ndarray) -> Callable[[complex, np.ndarray], np.ndarray]:
    """Function (lambda, theta (q,)) -> (q, 4, 4): u, v, U,x, U,y of the four functions at r = 1."""
    shear = elasticity[2, 2]
    kappa = 1.0 + 2.0 * shear / (elasticity[0, 1] + shear)

    def functions(exponent: complex, theta: np.ndarray) -> np.ndarray:
        turn = np.exp(1j * theta)
        power, dual = np.exp(1j * exponent * theta), np.exp(-1j * exponent * theta)
        first = np.zeros((len(theta), 4, 4), dtype=complex)  # u + i v, u - i v, U,x + i U,y, U,x - i U,y
        for row, factor, sign in ((0, kappa, -1.0), (2, 1.0, 1.0)):
            first[:, row, 0] = factor * power
            first[:, row, 1] = sign * exponent * dual * turn**2
            first[:, row, 2] = sign * dual
            first[:, row + 1, 1] = factor * dual
            first[:, row + 1, 0] = sign * exponent * power / turn**2
            first[:, row + 1, 3] = sign * power
        first[:, :2] /= 2.0 * shear
        plus, minus = first[:, [0, 2]], first[:, [1, 3]]
        result = np.empty_like(first)
        result[:, [0, 2]] = 0.5 * (plus + minus)
        result[:, [1, 3]] = -0.5j * (plus - minus)
        return result

    return functions


def _anisotropic_functions(elasticity: np.ndarray) -> Callable[[complex, np.ndarray], np.ndarray]:
    """As `_isotropic_functions`, by Lekhnitskii's potentials."""
    s = np.linalg.inv(elasticity)
    roots = characteristic_roots(s)
    p = s[0, 0] * roots**2 + s[0, 1] - s[0, 2] * roots
    q = s[0, 1] * roots + s[1, 1] / roots - s[1, 2]
    table = np.array([p, q, np.ones(2), roots])  # (4, 2)

    def functions(exponent: complex, theta: np.ndarray) -> np.ndarray:
        z = np.cos(theta)[:, None] + np.sin(theta)[:, None] * roots
        # the argument of z_k follows theta around the tip, equal to it at multiples of pi
        angle = np.angle(z)
        angle += 2.0 * np.pi * np.round((theta[:, None] - angle) / (2.0 * np.pi))
        log = np.log(np.abs(z))
        power = np.exp(exponent * (log + 1j * angle))[:, None, :]
        dual = np.exp(exponent * (log - 1j * angle))[:, None, :]
        return np.concatenate([table * power, table.conj() * dual], axis=2)

    return functions


class TipSectors:
    """Sectors of one material around a tip, and the conditions between them.

    Parameters
    ----------
    shape : (nodes, 2) array
        Boundary nodes about the tip, counter-clockwise from face to face.
    order : int
    elasticity : (3, 3) or (edges, 3, 3) array
    axis : (2,) array
        Unit vector from the tip to the mouth.
    """

    def __init__(self, shape: np.ndarray, order: int, elasticity: np.ndarray, axis: np.ndarray):
        chains = edge_nodes(len(shape), order, False)
        elasticity = np.broadcast_to(elasticity, (len(chains), 3, 3))
        self.radius = np.hypot(*shape.T)
        self.theta = np.unwrap(np.arctan2(shape[:, 1], shape[:, 0]))
        starts = [0] + [
            k for k in range(1, len(chains)) if not np.array_equal(elasticity[k], elasticity[k - 1])
        ]
        self.materials = [elasticity[k] for k in starts]
        self.functions = [
            _isotropic_functions(d) if is_isotropic(d) else _anisotropic_functions(d) for d in self.materials
        ]
        first_nodes = np.array([chains[k][0] for k in starts] + [len(shape) - 1])
        self.bounds = self.theta[first_nodes]
        self.sector = np.clip(
            np.searchsorted(first_nodes, np.arange(len(shape)), side="right") - 1, 0, len(starts) - 1
        )
        ahead = float(np.arctan2(-axis[1], -axis[0]))
        self.ahead = ahead + 2.0 * np.pi * np.ceil((self.theta[0] - ahead) / (2.0 * np.pi))
        self.homogeneous_crack = len(starts) == 1 and abs(np.ptp(self.bounds) - 2.0 * np.pi) < 1e-9

    def conditions(self, exponent: complex) -> np.ndarray:
        """(4 s, 4 s) complex: continuity between the s sectors and free faces."""
        count = len(self.functions)
        before = np.ones(4)
        matrix = np.zeros((4 * count, 4 * count), dtype=complex)
        for k, functions in enumerate(self.functions):
            ends = functions(exponent, self.bounds[k : k + 2])
            scale = np.abs(ends).max(axis=(0, 2))
            columns = slice(4 * k, 4 * k + 4)
            if k == 0:
                matrix[:2, columns] = ends[0, 2:] / scale[2:, None]
            else:
                matrix[4 * k - 2 : 4 * k + 2, columns] = -ends[0] / before[:, None]
            if k == count - 1:
                matrix[-2:, columns] = ends[1, 2:] / scale[2:, None]
            else:
                before = scale
                matrix[4 * k + 2 : 4 * k + 6, columns] = ends[1] / scale[:, None]
        return matrix

    def exponents(self, guesses: np.ndarray) -> np.ndarray:
        """(count,) complex: roots of the determinant next to guesses, by Muller's method with the roots found
        divided out.
        """
        if self.homogeneous_crack:
            return np.full(len(guesses), 0.5 + 0.0j)
        found: list[complex] = []
        for guess in sorted(guesses, key=lambda value: (value.real, value.imag)):
            found.append(_muller(lambda x: np.linalg.det(self.conditions(x)), complex(guess), found))
        roots = np.array(found)
        for i in range(len(roots)):
            for j in range(i):
                if abs(roots[i] - roots[j]) < _DOUBLE:
                    roots[i] = roots[j] = 0.5 * (roots[i] + roots[j])
        roots[np.abs(roots.imag) < _DOUBLE] = roots[np.abs(roots.imag) < _DOUBLE].real
        return roots

    def modes(self, guesses: np.ndarray) -> list[TipMode]:
        """The modes of exponents next to guesses; one of each conjugate pair.

        Raises
        ------
        SElementError
            If a guess leads to no exponent of its own.
        """
        exponents = self.exponents(guesses)
        modes = []
        for value in np.unique(exponents):
            multiplicity = int((exponents == value).sum())
            if value.imag < 0.0:
                continue
            _, singular, right = np.linalg.svd(self.conditions(value))
            if singular[-multiplicity] > 1e-6 * singular[0]:
                raise SElementError(
                    f"the exponent {value:.6g} of its tip is no {multiplicity}-fold root of the conditions "
                    "on its faces; check the materials around the tip"
                )
            modes += self._modes_of(complex(value), right[-multiplicity:].conj())
        return modes

    def _modes_of(self, exponent: complex, coefficients: np.ndarray) -> list[TipMode]:
        """Modes of one exponent from the null vectors (multiplicity, 4 s) of its conditions."""
        coefficients = coefficients.reshape(len(coefficients), -1, 4)
        displacement = np.empty((len(self.theta), 2, len(coefficients)), dtype=complex)
        for k, functions in enumerate(self.functions):
            nodes = self.sector == k
            displacement[nodes] = functions(exponent, self.theta[nodes])[:, :2] @ coefficients[:, k].T
        displacement *= (self.radius**exponent)[:, None, None]
        k = min(int(np.searchsorted(self.bounds, self.ahead, side="right")) - 1, len(self.functions) - 1)
        ahead = self.functions[k](exponent, np.array([self.ahead]))[0, 2:]
        forces = exponent * (ahead @ coefficients[:, k].T)  # d/dr of U,x and U,y
        c, s = np.cos(self.ahead), np.sin(self.ahead)
        normal, shear = s * forces[1] + c * forces[0], s * forces[0] - c * forces[1]
        columns = np.concatenate([displacement.reshape(-1, len(coefficients)), [normal, shear]])
        if exponent.imag == 0.0:
            # null vectors are complex combinations of as many real modes
            parts = np.concatenate([columns.real, columns.imag], axis=1)
            columns = np.linalg.svd(parts, full_matrices=False)[0][:, : len(coefficients)]
        return [TipMode(exponent, column[:-2], column[-2:]) for column in columns.T]


def _muller(function: Callable[[complex], complex], guess: complex, known: list[complex]) -> complex:
    """Root of a function next to a guess, with known roots divided out."""

    def deflated(x: complex) -> complex:
        value = function(x)
        for root in known:
            value = value / (x - root) if x != root else value / 1e-12
        return value

    points = [guess + 3e-3, guess - 2e-3, guess + 1e-3j]
    values = [deflated(x) for x in points]
    for _ in range(50):
        (x0, x1, x2), (f0, f1, f2) = points, values
        h0, h1 = x1 - x0, x2 - x1
        slope0, slope1 = (f1 - f0) / h0, (f2 - f1) / h1
        a = (slope1 - slope0) / (h1 + h0)
        b = a * h1 + slope1
        root = np.sqrt(b * b - 4.0 * a * f2 + 0j)
        denominator = b + root if abs(b + root) >= abs(b - root) else b - root
        if denominator == 0.0:
            return x2
        step = -2.0 * f2 / denominator
        if abs(step) > 0.1:
            step *= 0.1 / abs(step)
        points, values = [x1, x2, x2 + step], [f1, f2, deflated(x2 + step)]
        if abs(step) < 1e-14:
            break
    return complex(points[2])
