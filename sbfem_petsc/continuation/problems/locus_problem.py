"""Bifurcations over the forcing frequency and a second parameter, by minimally augmented equations.

Beside x(T) - x(0) = 0 stands g = 0. For a multiplier mu of the monodromy M it is the last entry of

    [M - mu, w; v^H, 0] [a; g] = [0; 1],

with borders near the null vectors; its derivative along any direction is -b^T (dM - dmu) a, b of the
transposed system: one more period and one product with M, no eigenvalue (W. Govaerts, Numerical Methods for
Bifurcations of Dynamical Equilibria, SIAM 2000, chapter 4). mu is 1, -1, or exp(i theta) with the angle theta
as one more unknown and two real equations. For grazing g is the least gap of a row over the period of the
model without that row.

The linearised equations are never one matrix: of g only slopes along solutions of the linearised motion are
made.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg

from ...motion.period_map import DrivenPeriod
from ...motion.period_motion import PeriodMotion
from ..linear import Factors
from ..multipliers import inverse_iteration
from ..newton import correct
from ..problem import Linear, Lost, Metric, Point, Problem
from .driven_orbits import Family, OpenRowFamily, least

# Unit of the frequency: itself over this number. Share of g in the residual.
SPAN, FINE = 20.0, 0.3
# Multipliers scatter by up to 2e-7 from switch to switch within the steps. What g is left with, and what it
# has to change by in the step of a difference (in units) along the steepest direction, or that is made ten
# times as long, as those of the same state behind it.
BAND, CLEAR, APART = 3e-9, 1e-6, 1e-4
# Slopes along what is left of a direction beside known ones are not made where it is so little of it.
NEGLECTED = 0.1
PLACES = {"fold": 1.0, "period doubling": -1.0}


class LocusProblem(Problem):
    """u = (x(0), frequency, factor), behind them the multiplier's angle for Neimark-Sacker points.

    Parameters
    ----------
    family : Family
        An `OpenRowFamily` for grazing.
    kind : {"fold", "period doubling", "Neimark-Sacker", "grazing"}
    begin : array
        Unknowns close to the locus.
    extent : float
        Range of the second parameter.

    Attributes
    ----------
    borders : tuple of array
        Near the right and left null vectors, at first those where it begins.
    """

    closed, settled, scatter, band = 1e-9, 2e-7, 1e-7, BAND

    def __init__(self, family: Family, kind: str, begin: np.ndarray, extent: float):
        self.family, self.kind, self.begin, self.extent = family, kind, begin, max(extent, 1e-300)
        angle = [1.0] if kind == "Neimark-Sacker" else []
        self.modes2 = len(begin) - 2 - len(angle)
        driven, motion = self.run(begin)
        state, frequency, value = self.split(begin)
        self.size = driven.period.size(state)
        self._units = np.concatenate(
            [np.full(self.modes2, self.size), [frequency / SPAN, self.extent], angle]
        )
        self._weights = np.append(np.ones(self.modes2 + 2), 0.0 * np.array(angle))
        self.unit, self.borders = 1.0, tuple[np.ndarray, ...]()
        if isinstance(family, OpenRowFamily):
            self.unit = max(float(np.ptp(family.gap(driven, motion, value))), 1e-300)
            self.scatter = 0.0  # gaps are smooth
        else:
            self.borders = _null_vectors(driven.monodromy(motion, rubbing=True), self.place(begin))

    def place(self, u: np.ndarray) -> complex:
        """Where the multiplier is to be."""
        return PLACES[self.kind] if self.kind in PLACES else np.exp(1j * u[-1])

    def split(self, u: np.ndarray) -> tuple[np.ndarray, float, float]:
        """State, frequency and factor; negative damping would let motions grow without bounds."""
        frequency, value = float(u[self.modes2]), float(u[self.modes2 + 1])
        if not (frequency > 0.0 and value >= -2.0 * APART * self.extent):
            raise Lost("the parameters have left their range")
        return u[: self.modes2], frequency, value

    def first(self, held: int) -> Point:
        """The point next to the start at the same frequency (0) or second parameter (1). Raises `Lost` if
        there is none.
        """
        u = self.begin
        return correct(self, u, Metric(self, u).plane(np.eye(1, len(u), self.modes2 + held)[0], u))

    def run(self, u: np.ndarray) -> tuple[DrivenPeriod, PeriodMotion]:
        """The driven period and the motion over it."""
        x, frequency, value = self.split(u)
        driven = self.family.at(frequency, value)
        return driven, driven.run(x)

    def at(self, u: np.ndarray) -> LocusState:
        """The equations there."""
        return (_AtGrazing if self.kind == "grazing" else _AtMultiplier)(self, u)

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The angle, which state and parameters determine, has no length."""
        return self._units, self._weights

    def value(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        """The second parameter."""
        return float(u[self.modes2 + 1]), np.eye(1, len(u), self.modes2 + 1)[0]

    def placed(self, u: np.ndarray, value: float) -> np.ndarray:
        """With that second parameter."""
        result = u.copy()
        result[self.modes2 + 1] = value
        return result

    def bordered_by(self, borders: Sequence[np.ndarray]) -> LocusProblem:
        """The same equations with other borders."""
        result = copy.copy(self)
        result.borders = tuple(borders)
        return result

    def advanced(self, points: list[Point]) -> tuple[LocusProblem, Point]:
        """The borders follow the null vectors."""
        problem = self.bordered_by(points[-1].state.null_vectors())
        return problem, replace(points[-1], problem=problem)

    def memory(self, point: Point) -> Sequence[np.ndarray] | None:
        """The borders of its state, if it has any."""
        return point.state.problem.borders

    def recalled(self, u: np.ndarray, value: float, memory: Sequence[np.ndarray] | None) -> Point:
        """A point of a former run."""
        problem = self.bordered_by(memory) if memory else self
        return problem.advanced([Point(problem, u, problem.at(u), value)])[1]


def _null_vectors(matrix: np.ndarray, place: complex) -> tuple[np.ndarray, np.ndarray]:
    """Right and left eigenvectors of the eigenvalue next to a place, of length one; real for a real place."""
    values = linalg.eigvals(matrix)
    near = complex(values[np.argmin(np.abs(values - place))])
    found = []
    for item in (matrix, matrix.T):
        vector = inverse_iteration(item, near)
        vector = vector * (np.abs(vector).max() / vector[np.abs(vector).argmax()])
        vector = vector if isinstance(place, complex) else vector.real
        found.append(vector / np.linalg.norm(vector))
    return found[0], found[1]


class LocusState:
    """The equations at some unknowns.

    Attributes
    ----------
    condition : (1,) or (2,) array
        g.
    multiplier : complex
        The one that is followed; nan for grazing.
    """

    condition: np.ndarray
    multiplier = complex(np.nan)

    def __init__(self, problem: LocusProblem, u: np.ndarray):
        self.problem, self.u, self.scale = problem, u, problem.size
        driven, motion = self._run
        self._begin(driven, motion)
        off = np.where(np.abs(self.condition) > problem.band, self.condition, 0.0)
        self.residual = np.append(motion.residual, FINE * self.scale * off)
        self.rows = len(self.residual)
        # orthonormal directions in units, and the slopes of g along them
        self._known, self._rates = np.empty((0, len(u))), np.empty((0, len(self.condition)))
        self._aparts: tuple[float, ...] = (APART, 10.0 * APART)

    def forget(self) -> None:
        """See `problem.State`."""
        for name in ("_run", "factors"):
            self.__dict__.pop(name, None)

    @functools.cached_property
    def _run(self) -> tuple[DrivenPeriod, PeriodMotion]:
        return self.problem.run(self.u)

    def _begin(self, driven: DrivenPeriod, motion: PeriodMotion) -> None:
        """Set the condition."""
        raise NotImplementedError

    def _change(self, u: np.ndarray, driven: DrivenPeriod, motion: PeriodMotion) -> np.ndarray:
        """What the condition changes by towards other unknowns."""
        raise NotImplementedError

    def null_vectors(self) -> tuple[np.ndarray, ...]:
        """Right and left, of length one, where there are any."""
        return ()

    def slope(self, direction: np.ndarray) -> np.ndarray:
        """Of g along a change of the unknowns in units, by differences only along what is not known of it."""
        rest, total = direction, np.zeros(len(self.condition))
        for _ in range(2):  # twice is enough for orthogonal to rounding
            shares = self._known @ rest
            rest, total = rest - shares @ self._known, total + shares @ self._rates
        length = float(np.linalg.norm(rest))
        if length > NEGLECTED * float(np.linalg.norm(direction)):
            rate = self._difference(rest / length)
            self._known = np.vstack([self._known, rest / length])
            self._rates = np.vstack([self._rates, rate])
            total = total + length * rate
        return total

    def _difference(self, direction: np.ndarray) -> np.ndarray:
        """The slope along a direction of length one."""
        steepest = float(np.abs(self._rates).max(initial=0.0))
        for apart in self._aparts:
            u = self.u + apart * direction * self.problem.units(self.u)[0]
            change = self._change(u, *self.problem.run(u))
            if max(float(np.abs(change).max()), apart * steepest) > CLEAR:
                break
        self._aparts = tuple(other for other in self._aparts if other >= apart)
        return change / apart

    @functools.cached_property
    def factors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Q and R of the transposed derivative of the motion's residual along the unknowns in units, and
        directions in which it does not change.
        """
        problem = self.problem
        x, _, value = problem.split(self.u)
        part = problem.family.derivative(*self._run, x, value)
        part[:, : len(x)] -= np.eye(len(x))
        surface = np.zeros((len(self.u), len(x)))
        surface[: len(x) + 2] = part.T
        q, r = np.linalg.qr(surface * problem.units(self.u)[0][:, None], mode="complete")
        return q[:, : len(x)], r[: len(x)], q[:, len(x) :]

    def linear(self, smooth: bool = False) -> LocusState:
        """Itself, for Newton's method and for tangents: a `problem.Linear` too."""
        return self

    def mixed(self, others: Sequence[Linear], weights: Sequence[float]) -> LocusState:
        """See `problem.Linear`: they have no sum with those of others."""
        return self

    def bordered(self, row: np.ndarray) -> _AugmentedBorder:
        """See `problem.Linear`."""
        return _AugmentedBorder(self, row)


class _AtMultiplier(LocusState):
    """g of the bordered monodromy."""

    def _begin(self, driven: DrivenPeriod, motion: PeriodMotion) -> None:
        problem, matrix = self.problem, driven.monodromy(motion, rubbing=True)
        (right, left), place, n = problem.borders, problem.place(self.u), len(matrix)
        bordered = np.zeros((n + 1, n + 1), dtype=np.result_type(right, matrix))
        bordered[:n, :n] = matrix
        bordered[range(n), range(n)] -= place
        bordered[:n, n], bordered[n, :n] = left.conj(), right.conj()
        factors, unit = Factors(bordered), np.eye(1, n + 1, n, dtype=bordered.dtype)[0]
        a, b = factors.solve(unit), factors.solve_transposed(unit)
        self.right, self.left = a[:n], b[:n]
        self.image = matrix @ self.right
        self.condition = self._real(a[n])
        # Rayleigh's quotient of both vectors
        self.multiplier = complex(place - a[n] / (self.left @ self.right))

    def _real(self, value: complex) -> np.ndarray:
        return np.array([value.real, value.imag] if self.problem.kind == "Neimark-Sacker" else [value])

    def null_vectors(self) -> tuple[np.ndarray, ...]:
        """Right and left, of length one."""
        return tuple(vector / np.linalg.norm(vector) for vector in (self.right, self.left))

    def _change(self, u: np.ndarray, driven: DrivenPeriod, motion: PeriodMotion) -> np.ndarray:
        parts = [self.right.real, self.right.imag] if np.iscomplexobj(self.right) else [self.right]
        moved = driven.carried(motion, np.array(parts).T, located=True, rubbing=True)
        image = moved[:, 0] + 1j * moved[:, 1] if len(parts) > 1 else moved[:, 0]
        place = self.problem.place(u) - self.problem.place(self.u)
        return self._real(-(self.left @ (image - self.image - place * self.right)))


class _AtGrazing(LocusState):
    """g is the least gap of an open row over what its gap varies by at the start."""

    def _begin(self, driven: DrivenPeriod, motion: PeriodMotion) -> None:
        self.condition = self._gap(self.u, driven, motion)

    def _gap(self, u: np.ndarray, driven: DrivenPeriod, motion: PeriodMotion) -> np.ndarray:
        family = self.problem.family
        assert isinstance(family, OpenRowFamily)
        return np.array(
            [least(family.gap(driven, motion, self.problem.value(u)[0])[:-1]) / self.problem.unit]
        )

    def _change(self, u: np.ndarray, driven: DrivenPeriod, motion: PeriodMotion) -> np.ndarray:
        return self._gap(u, driven, motion) - self.condition


class _AugmentedBorder:
    """By orthogonal factors of the motion's rows, J = R^T Q^T; of the directions in which these do not change
    the border tells one, and g the others (one, two for Neimark-Sacker points).
    """

    sign: float | None = None

    def __init__(self, state: LocusState, row: np.ndarray):
        self.state, self.units = state, state.problem.units(state.u)[0]
        self.range, self.triangle, null = state.factors
        self.row = row * self.units
        turned, _ = np.linalg.qr((self.row @ null)[:, None], mode="complete")
        self.along, self.null = null @ turned[:, 0], null @ turned[:, 1:]
        self.slopes = np.array([state.slope(direction) for direction in self.null.T]).T

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`: of the motion's rows, g and the border."""
        known, singular = linalg.lapack.dtrtrs(self.triangle, right[: len(self.triangle)], trans=1)
        steep = float(self.row @ self.along)
        if singular or not steep:
            raise Lost("the locus has no single direction")
        particular = self.range @ known
        particular += (right[-1] - self.row @ particular) / steep * self.along
        wanted = right[len(known) : -1] / (FINE * self.state.scale) - self.state.slope(particular)
        try:
            return self.units * (particular + self.null @ np.linalg.solve(self.slopes, wanted))
        except np.linalg.LinAlgError:
            raise Lost("the locus has no single direction") from None
