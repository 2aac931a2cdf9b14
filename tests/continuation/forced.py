"""A family of its own: forced motions of a system given by its right-hand side, over the frequency."""

import numpy as np

from sbfem_petsc.continuation.events import find_zero, folds
from sbfem_petsc.continuation.follow import Line, Settings
from sbfem_petsc.continuation.line_file import LineFile
from sbfem_petsc.continuation.newton import correct
from sbfem_petsc.continuation.problem import Metric
from sbfem_petsc.petsc import MPI

from .problems import Equations, Values


class Forced(Equations):
    """x(T) - x(0) = 0 in Runge-Kutta's steps and their linearisation; unknowns are x(0) and rad/s."""

    def __init__(self, right, slope, steps=200):
        self.right, self.slope, self.steps = right, slope, steps
        super().__init__(lambda u: self.period(u)[0] - u[:-1], self.matrix)

    def along(self, t, y, w):
        return np.column_stack([self.right(t, y[:, 0], w), self.slope(y[:, 0]) @ y[:, 1:]])

    def period(self, u):
        """x(T) and dx(T) / dx(0)."""
        y, h = np.column_stack([u[:-1], np.eye(len(u) - 1)]), 2.0 * np.pi / u[-1] / self.steps
        for t in h * np.arange(self.steps):
            a = self.along(t, y, u[-1])
            b = self.along(t + 0.5 * h, y + 0.5 * h * a, u[-1])
            c = self.along(t + 0.5 * h, y + 0.5 * h * b, u[-1])
            y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + self.along(t + h, y + h * c, u[-1]))
        return y[:, 0], y[:, 1:]

    def matrix(self, u):
        end, monodromy = self.period(u)
        ahead, _ = self.period(np.append(u[:-1], u[-1] + 1e-6))
        return np.column_stack([monodromy - np.eye(len(end)), (ahead - end) / 1e-6])


def follow_forced(problem, first, within, file, resume=False, progress=None):
    """Its line in a file, its folds and its period doublings."""

    with LineFile(MPI.COMM_SELF, file, resume=resume, progress=progress) as kept:
        kept.begin(None, {"lower": within.lower, "upper": within.upper}, first)
        level = Metric(problem, first).level(first, first[-1])
        line = kept.line(problem) or Line([correct(problem, first, level)])

        def share(value):
            return (value - within.lower) / within.extent

        kept.follow([line], within, Settings(), lambda: Values(line.values), share)
        kept.update(lambda: Values(line.values), [line], last=True)
    pairs = [tuple(map(doubled, line.points[k : k + 2])) for k in range(len(line.points) - 1)]
    turns = [point for _, point in folds(line)]
    return line, turns, [find_zero(line, k, doubled, p)[0] for k, p in enumerate(pairs) if p[0] * p[1] < 0.0]


def doubled(point):
    return float(np.linalg.det(point.problem.period(point.u)[1] + np.eye(len(point.u) - 1)))
