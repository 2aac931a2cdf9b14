"""What a family of solutions is to the continuation: equations with one more unknown than there are of them,
and the range of a value along them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..errors import SolveError

# What an iteration with an updated derivative may leave of what is missed, and in finer steps, of which a
# derivative is as dear as some five periods.
GAIN, FINER_GAIN = 0.3, 0.6
# The value of a function of the unknowns and its gradient.
Condition = Callable[[np.ndarray], tuple[float, np.ndarray]]


class Lost(SolveError):
    """There is no solution here, or the unknowns have left their domain."""


class Border(Protocol):
    """The linearised equations with one more row, factorised or preconditioned.

    Attributes
    ----------
    sign : float or None
        Of the determinant; None where it is not known.
    """

    sign: float | None

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Unknowns of a right side: this rank's equations and behind them the border's value."""


class Linear(Protocol):
    """The linearised equations, n rows in n + 1 unknowns, never seen as a matrix from outside.

    Attributes
    ----------
    rows : int
        Equations on this rank.
    """

    rows: int

    def bordered(self, row: np.ndarray) -> Border:
        """With a row below them. Raises `Lost` where that is singular."""

    def mixed(self, others: Sequence[Any], weights: Sequence[float]) -> Linear | None:
        """Weighted sum of others, what is expected between or beyond them; itself where there is no sum. None
        where derivatives are better made there, as those that say nothing else are.
        """
        return None


class State(Protocol):
    """The equations at some unknowns.

    Attributes
    ----------
    scale : float
        What the residual's norm is measured with.
    """

    scale: float

    @property
    def residual(self) -> np.ndarray:
        """(n,)."""

    def linear(self, smooth: bool = False) -> Linear:
        """Of the discrete equations (for Newton's method), or smooth: of the continuous ones (for tangents,
        signs and events), which the state keeps for the next call if they are dear.
        """

    def forget(self) -> None:
        """Let go of what takes memory and can be computed again."""


class Problem:
    """A family of solutions, by its equations alone: a subclass says what they are, their units and the value
    that the range is over, and what differs from the answers given here. Unknowns are one vector u of n + 1
    numbers, or this rank's part of it.

    Attributes
    ----------
    closed : float
        Norm of the residual over its scale at which a solution is taken ...
    settled : float
        ... and change of the unknowns in their units after which it is.
    scatter : float
        Norm of the residual, over its scale, up to which the equations jump from one place to the next: a
        step by their own derivative that hardly gains there is the last one.
    patience : int
        Newton's steps are taken that leave less to miss than at one of so many last iterates.
    shares : tuple of float
        Of a Newton step, of which the first that does so is taken.
    gain : float
        A derivative is brought up to date, rather than made anew, by iterations that leave no more than this
        of what is missed; 0: never.
    corners : bool
        Whether branches may have corners, beyond which the linearised equations are others.
    narrow : float
        Length of step below which a way past what stops or turns the branch is sought (`leap`); 0: never.
    begins : (n + 1,) array or None
        Direction of the first step in units; None: that in which the value goes where it is to go.
    isolated : str
        What to say where solutions are not isolated, with a place for the value.
    advice : str
        What may help where a branch comes to a stop.
    """

    closed, settled, scatter, patience, corners, narrow = 1e-11, 1e-9, 0.0, 1, False, 0.0
    shares: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1, 0.03)
    gain = GAIN
    begins: np.ndarray | None = None
    isolated = "solutions are not isolated at {:.8g}"
    advice = "take more steps"

    @property
    def unrestricted(self) -> Problem:
        """Itself, or of which this one is in a symmetric subspace."""
        return self

    def at(self, u: np.ndarray) -> State:
        """Raises `Lost`, or another SolveError, where the unknowns have no meaning."""
        raise NotImplementedError

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Units of the unknowns, and the weights, 0 or 1, with which their changes count as arc length."""
        raise NotImplementedError

    def value(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        """What the range is over, and its gradient: the last unknown."""
        return float(u[-1]), np.eye(1, len(u), len(u) - 1)[0]

    def placed(self, u: np.ndarray, value: float) -> np.ndarray:
        """The unknowns with exactly this value, where it is one of them; as they are otherwise."""
        return np.append(u[:-1], value)

    def sum(self, local: float) -> float:
        """Over the ranks: every inner product passes through it."""
        return local

    def alike(self, one: Point, other: Point) -> bool:
        """Whether two points lie on one smooth part of the branch: where it may have corners, the same pairs
        touch.
        """
        return not self.corners or bool((one.state.touching == other.state.touching).all())

    def refuse(self, last: Point, point: Point) -> str:
        """Why a converged point is none of this branch, for good: it ends there; "" if it is one."""
        return ""

    def restricted(self, point: Point) -> Problem | None:
        """The same equations in the symmetric subspace that a point lies in, for steps that fail outside."""
        return None

    def projected(self, u: np.ndarray) -> np.ndarray:
        """Unknowns or a change of them in that subspace; as they are otherwise."""
        return u

    def leap(self, points: list[Point], direction: int) -> Point | None:
        """A point beyond what stops or turns the branch, by other means than continuation."""
        return None

    def advanced(self, points: list[Point]) -> tuple[Problem, Point] | None:
        """Another discretisation and the last point in it, where this one no longer resolves it."""
        return None

    def finer(self, times: int) -> Problem:
        """The same equations in so many times the steps of time."""
        raise Lost("the equations have no finer steps")

    def wider(self, times: int) -> Any:
        """The same equations in more modes, in so many times the steps of time: `driven_orbits.WiderOrbits`.
        None where nothing is known of those that are left out, or there are none.
        """
        return None

    def whole(self, u: np.ndarray) -> np.ndarray:
        """The unknowns of all ranks, for a file, on rank 0. Collective."""
        return u

    def own(self, u: np.ndarray) -> np.ndarray:
        """This rank's of such unknowns."""
        return u

    def memory(self, point: Point) -> Any:
        """What of a point, beside its unknowns, its neighbours depend on: numbers, texts and arrays for a
        file, in lists and dicts.
        """

    def recalled(self, u: np.ndarray, value: float, memory: Any) -> Point:
        """The point of a former run with these unknowns, value and memory."""
        return Point(self, u, self.at(u), value)


@dataclass(eq=False)
class Point:
    """A solution.

    Attributes
    ----------
    problem : Problem
        Whose solution it is.
    u : (n + 1,) array
    state : State
    value : float
        What the range is over.
    effort : float
        Newton iterations; three with an updated derivative count as one.
    residuals : tuple of float
        What was missed at each Newton iterate, relative.
    leapt : bool
        Whether the branch has not been followed to it, but leapt over something (`Problem.leap`).
    told : dict
        What a result keeps of it, by the names of the result's fields; empty before it is asked for.
    """

    problem: Any
    u: np.ndarray
    state: Any
    value: float
    effort: float = 0.0
    residuals: tuple[float, ...] = (0.0,)
    leapt: bool = False
    told: dict[str, Any] = field(default_factory=dict)

    @property
    def iterations(self) -> int:
        """Newton iterations."""
        return len(self.residuals) - 1

    @property
    def linear(self) -> Linear:
        """The smooth linearised equations."""
        return self.state.linear(smooth=True)

    @classmethod
    def known(cls, problem: Problem, u: np.ndarray) -> Point:
        """Of unknowns that are known to solve the equations."""
        return cls(problem, u, problem.at(u), problem.value(u)[0])


@dataclass(frozen=True)
class Range:
    """Where a value may go, at first in a direction, +1 or -1."""

    lower: float
    upper: float
    direction: int

    @property
    def extent(self) -> float:
        """Its length."""
        return self.upper - self.lower

    def holds(self, value: float) -> bool:
        """Whether a value lies inside, the ends excluded."""
        return self.lower < value < self.upper

    def nearest(self, value: float) -> float:
        """The value of the range, its ends included, that is nearest to one."""
        return min(max(value, self.lower), self.upper)


class Metric:
    """Lengths and angles of changes of the unknowns in their units, about some unknowns."""

    def __init__(self, problem: Problem, u: np.ndarray):
        self.problem = problem
        self.units, self.weights = problem.units(u)

    def dot(self, one: np.ndarray, other: np.ndarray) -> float:
        """Inner product of changes in units, of those that count as arc length."""
        return self.problem.sum(float((one * self.weights) @ (other * self.weights)))

    def length(self, step: np.ndarray) -> float:
        """Arc length of a change in units."""
        return self.dot(step, step) ** 0.5

    def unit(self, step: np.ndarray) -> np.ndarray:
        """A change in units, made as long as one."""
        return step / max(self.length(step), 1e-300)

    def way(self, one: Point, other: Point) -> np.ndarray:
        """From a point to another one, in units."""
        return (other.u - one.u) / self.units

    def chord(self, one: Point, other: Point) -> np.ndarray:
        """Its direction."""
        return self.unit(self.way(one, other))

    def row(self, tangent: np.ndarray) -> np.ndarray:
        """The row whose product with a change of the unknowns is its arc length along a tangent."""
        return tangent * self.weights**2 / self.units

    def tangent(self, linear: Linear, near: np.ndarray) -> tuple[np.ndarray, float | None]:
        """Direction in which linearised equations do not change, in units, and their determinant's sign;
        `near` is a direction not across it.
        """
        border = linear.bordered(self.row(near))
        return self.unit(border.solve(np.eye(1, linear.rows + 1, linear.rows)[0]) / self.units), border.sign

    def pace(self, u: np.ndarray) -> float:
        """Change of the value, at most, over a unit of arc length."""
        slope = self.problem.value(u)[1] * self.units
        return self.problem.sum(float(slope @ slope)) ** 0.5

    def plane(self, tangent: np.ndarray, u: np.ndarray) -> Condition:
        """That unknowns lie in the plane across a tangent through some."""
        row = self.row(tangent)
        place = self.problem.sum(float(row @ u))
        return lambda x: (self.problem.sum(float(row @ x)) - place, row)

    def level(self, u: np.ndarray, goal: float) -> Condition:
        """That the value is `goal`, in units of its pace at `u`."""
        pace = max(self.pace(u), 1e-300)

        def condition(x: np.ndarray) -> tuple[float, np.ndarray]:
            found, slope = self.problem.value(x)
            return (found - goal) / pace, slope / pace

        return condition
