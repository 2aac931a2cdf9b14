"""Equations of closed form as problems of the continuation."""

from __future__ import annotations

import functools

import numpy as np

from sbfem_petsc.continuation.linear import Dense, Krylov
from sbfem_petsc.continuation.problem import Lost, Problem
from sbfem_petsc.record.record import Record, described, quantity


@described
class Values(Record):
    """Those of a line."""

    value: np.ndarray = quantity("rad/s", "frequencies", "point")


class Equations(Problem):
    """f(u) = 0 with its matrix of derivatives; the last unknown is the value."""

    def __init__(self, function, derivative, units=None, finest=None, weights=None):
        self.function, self.derivative, self.unit, self.finest = function, derivative, units, finest
        self.weights = weights
        self.states = 0

    def at(self, u):
        self.states += 1
        return Residual(self, u)

    def units(self, u):
        return tuple(
            np.ones(len(u)) if given is None else np.array(given) for given in (self.unit, self.weights)
        )

    def value(self, u):
        return float(u[-1]), np.eye(1, len(u), len(u) - 1)[0]

    def placed(self, u, value):
        return np.append(u[:-1], value)


class Residual:
    touching = np.zeros(0, dtype=bool)

    def __init__(self, problem, u):
        self.problem, self.u, self.scale = problem, u, 1.0
        self.residual = np.atleast_1d(np.asarray(problem.function(u), dtype=float))
        if not np.isfinite(self.residual).all():
            raise Lost("no number")

    def linear(self, smooth=False):
        matrix = np.atleast_2d(np.asarray(self.problem.derivative(self.u), dtype=float))
        return Dense(matrix)

    def forget(self):
        pass


class ByProducts(Equations):
    """The same without a matrix; preconditioned by a diagonal."""

    def at(self, u):
        return _Products(self, u)


class _Products(Residual):
    def linear(self, smooth=False):
        return _Diagonal(np.atleast_2d(self.problem.derivative(self.u)))


class _Diagonal(Krylov):
    def __init__(self, matrix):
        self.matrix, self.rows = matrix, len(matrix)

    def products(self, vector):
        return self.matrix[:, :-1] @ vector

    def nearby(self, right):
        return right / (1.0 + np.abs(np.diag(self.matrix[:, :-1])))

    @functools.cached_property
    def column(self):
        return self.matrix[:, -1]


def circle():
    """u_0^2 + u_1^2 = 1."""
    return Equations(lambda u: u @ u - 1.0, lambda u: 2.0 * u)


def pitchfork(offset=0.0):
    """x^3 - v x + offset = 0."""
    return Equations(lambda u: u[0] ** 3 - u[1] * u[0] + offset, lambda u: [3.0 * u[0] ** 2 - u[1], -u[0]])


def kinked():
    """v = x up to 1, then back twice as steeply: a corner at which the branch turns."""
    problem = Equations(
        lambda u: u[1] - min(u[0], 3.0 - 2.0 * u[0]), lambda u: [-1.0 if u[0] < 1.0 else 2.0, 1.0]
    )
    problem.corners = True
    return problem


class Duffing(Equations):
    """x'' + c x' + x + k x^3 = f cos(w t) by one harmonic a cos(w t) + b sin(w t); the value is w."""

    def __init__(self, damping, cubic, force, cls=None):
        self.damping, self.cubic, self.force = damping, cubic, force
        super().__init__(self._function, self._derivative)

    def _function(self, u):
        a, b, w = u
        stiff = 1.0 - w**2 + 0.75 * self.cubic * (a**2 + b**2)
        return [stiff * a + self.damping * w * b - self.force, stiff * b - self.damping * w * a]

    def _derivative(self, u):
        a, b, w = u
        stiff, k, c = 1.0 - w**2 + 0.75 * self.cubic * (a**2 + b**2), 1.5 * self.cubic, self.damping
        return [
            [stiff + k * a * a, k * a * b + c * w, -2.0 * w * a + c * b],
            [k * a * b - c * w, stiff + k * b * b, -2.0 * w * b - c * a],
        ]

    def amplitudes(self, w):
        """All squared amplitudes of the harmonic at a frequency, by its cubic equation."""
        k, d = 0.75 * self.cubic, 1.0 - w**2
        roots = np.roots([k * k, 2.0 * k * d, d * d + (self.damping * w) ** 2, -(self.force**2)])
        return np.sort(roots.real[np.abs(roots.imag) < 1e-9])

    def folds(self):
        """The frequencies at which that cubic's discriminant vanishes."""
        k, c, f = 0.75 * self.cubic, self.damping, self.force

        def discriminant(w):
            a, b, e = 2.0 * (1.0 - w**2) / k, ((1.0 - w**2) ** 2 + (c * w) ** 2) / k**2, -((f / k) ** 2)
            return a * a * b * b - 4.0 * b**3 - 4.0 * a**3 * e - 27.0 * e * e + 18.0 * a * b * e

        from scipy.optimize import brentq

        grid = np.linspace(0.5, 3.0, 20001)
        signs = np.sign([discriminant(w) for w in grid])
        return [brentq(discriminant, grid[k], grid[k + 1]) for k in np.flatnonzero(signs[1:] != signs[:-1])]
