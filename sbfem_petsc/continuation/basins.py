"""Basins of attraction: initial states, and the steady states that histories from them settle on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..checks import choice, index_of, integer, real_array, shown, text
from ..record.record import Record, derived, described, quantity
from ..reduction.reduced_model import ReducedModel
from .orbit import Orbit, component

KINDS = ("displacement", "velocity", "impulse")


@dataclass(frozen=True)
class StartAxis(Record):
    """An axis of a grid of initial states.

    Attributes
    ----------
    values : tuple of float
        For a displacement or velocity: modal coordinate, m sqrt(kg), or its rate, m sqrt(kg)/s; with a point
        what the mode makes of that point's displacement or velocity, m or m/s. For an impulse: N s for each
        newton of the unit load.
    kind : {"displacement", "velocity", "impulse"}
    mode : int
        Number of the mode, from 1; of an impulse: number of the unit load, from 1.
    point : str or None
        Named point in whose displacement the values are.
    direction : {"x", "y"}
    """

    values: tuple[float, ...] = quantity(
        "SI", "values along the axis", "value", unit_of=lambda axis: axis.unit
    )
    kind: str = quantity(text="what they are of", default="displacement", one_of=KINDS)
    mode: int = quantity("1", "number of the mode, or of the unit load", called="of", default=1, least=1)
    point: str | None = quantity(text="point in whose displacement they are", default=None)
    direction: str = quantity(text="its direction", default="y", kw_only=True, one_of=("x", "y"))

    def __post_init__(self) -> None:
        owner = "StartAxis"
        values = real_array(owner, "values", self.values, 1)
        if not values.size or (np.diff(values) <= 0.0).any():
            raise ValueError(f"{owner}: values = {shown(self.values)} must be rising numbers, at least one")
        object.__setattr__(self, "values", tuple(values.tolist()))
        choice(owner, "kind", self.kind, KINDS)
        object.__setattr__(self, "mode", integer(owner, "mode", self.mode, least=1))
        choice(owner, "direction", self.direction, ("x", "y"))
        if self.point is None:
            return
        text(owner, "point", self.point)
        if self.kind == "impulse":
            raise ValueError(f"{owner}: point = {self.point!r} has no meaning for an impulse; leave it out")

    @property
    def quantity(self) -> str:
        """What the values are."""
        if self.kind == "impulse":
            return f"impulse of load {self.mode}"
        if self.point is not None:
            return f"initial {self.kind} of {self.point} in mode {self.mode}"
        return f"initial modal {self.kind} of mode {self.mode}"

    @property
    def unit(self) -> str:
        """Of the values: "N s", "m", "m/s", "m kg$^{1/2}$" or "m kg$^{1/2}$/s"."""
        if self.kind == "impulse":
            return "N s"
        root = " kg$^{1/2}$" if self.point is None else ""
        return f"m{root}{'/s' if self.kind == 'velocity' else ''}"

    @property
    def label(self) -> str:
        """What the values are, with their unit."""
        return f"{self.quantity}, {self.unit}"


@described
class Basins(Record):
    """Where histories from many initial states settle.

    `reached` is the number of the orbit that each initial state leads to, from 0, -1 where it is none within
    the periods allowed; `periods` are the forcing periods until that was known; `states` the initial states
    (Omega q, q'), m sqrt(kg)/s. The last is (..., 2 m), the others (...) over the axes of the grid.
    """

    coordinates: ClassVar = ("starts",)

    frequency: float = quantity("Hz", "forcing frequency", least=1e-300)
    orbits: tuple[Orbit, ...] = quantity(
        text="the steady states: those that were given, then those that were found", part="Orbit", detail=True
    )
    reached: np.ndarray
    periods: np.ndarray
    states: np.ndarray = field(repr=False)
    axes: tuple[StartAxis, ...] = quantity(
        text="axes of the grid; none where the initial states were given one by one",
        part="StartAxis",
        default=(),
    )

    @derived("1", "lengths of the axes", "axis", kinds="iu", back=True, detail=True, least=1)
    def shape(self) -> np.ndarray:
        """Of `reached`."""
        return np.array(self.reached.shape)

    @derived("SI", "values of the axes", "start axis")
    def starts(self) -> np.ndarray | None:
        """(starts, axes), None where the initial states were given one by one."""
        if not self.axes:
            return None
        grid = np.meshgrid(*(axis.values for axis in self.axes), indexing="ij")
        return np.stack([values.ravel() for values in grid], axis=1)

    @derived("1", "number of the orbit reached, -1: none", "start", kinds="i", back=True, least=-1)
    def orbit_reached(self) -> np.ndarray:
        """(starts,): `reached`, one initial state after the other."""
        return self.reached.ravel()

    @derived("1", "forcing periods until that was known", "start", kinds="i", back=True, least=0)
    def periods_needed(self) -> np.ndarray:
        """(starts,): `periods`."""
        return self.periods.ravel()

    @derived("m sqrt(kg)/s", "initial states (Omega q, q')", "start state", back=True, detail=True)
    def initial_states(self) -> np.ndarray:
        """(starts, 2 m): `states`."""
        return self.states.reshape(self.reached.size, -1)

    @classmethod
    def _revived(cls, found: dict[str, Any]) -> Basins:
        """From a file."""
        shape = found.pop("shape").tolist()
        of_starts = {"reached": "orbit_reached", "periods": "periods_needed", "states": "initial_states"}
        arrays = {name: found.pop(flat) for name, flat in of_starts.items()}
        on_grid = {name: array.reshape(*shape, *array.shape[1:]) for name, array in arrays.items()}
        return cls(**found | on_grid)

    def check(self) -> None:
        """Raise ValueError unless grid, orbits and axes belong together."""
        shape = tuple(len(axis.values) for axis in self.axes)
        if (shape and shape != self.reached.shape) or self.reached.max(initial=-1) >= len(self.orbits):
            raise ValueError(
                f"starts of shape {self.reached.shape} lead to none of {len(self.orbits)} orbits"
            )
        points = {name for orbit in self.orbits for name in orbit.points}
        for axis in self.axes:
            if axis.point is not None and axis.point not in points:
                raise ValueError(f"point {axis.point!r} of an axis is none of its orbits'")

    @derived("1", "share of the initial states that reach each orbit", "orbit", row=True)
    def share(self) -> np.ndarray:
        """(k,): share of the initial states that leads to each orbit. Of states drawn at random it is an
        estimate of the probability p, with the standard error sqrt(p (1 - p) / n).
        """
        return np.array([np.mean(self.reached == k) for k in range(len(self.orbits))])

    def integrity(self, k: int) -> float:
        """Energy of the least disturbance of the k-th orbit at t = 0 that leads to another one, J: half the
        square of the distance, in (Omega q, q'), to the nearest of these initial states that does; inf if
        none does. Of histories that have not settled it is not known where they lead: they do not count.
        """
        k = index_of("integrity", "k", k, len(self.orbits))
        elsewhere = self.states[(self.reached != k) & (self.reached >= 0)]
        if not len(elsewhere):
            return math.inf
        state = self.orbits[k].state[: self.states.shape[-1]]  # slips stand behind
        return 0.5 * float(((elsewhere - state) ** 2).sum(axis=-1).min())

    def __repr__(self) -> str:
        shares = ", ".join(f"{100.0 * share:.3g} %" for share in self.share)
        lost = int((self.reached < 0).sum())
        return (
            f"Basins({self.reached.size} initial states at {self.frequency:.6g} Hz, {len(self.orbits)} "
            f"orbit{'s' * (len(self.orbits) != 1)} reached by {shares or 'none'}"
            + (f", {lost} not settled)" if lost else ")")
        )


def start_direction(axis: StartAxis, reduced: ReducedModel, weights: np.ndarray) -> np.ndarray:
    """(2 m,): change of the state (Omega q, q') for a value 1 on an axis.

    Raises
    ------
    ValueError
        If the mode does not move the point.
    """
    modes = len(weights)
    if axis.kind == "impulse":
        return np.concatenate([np.zeros(modes), reduced.load_modes[:, axis.mode - 1]])
    k, unit = axis.mode - 1, 1.0
    if axis.point is not None:
        shapes = component(reduced.points.of(axis.point, "point").modes, axis.direction, False, 0)
        if not abs(shapes[k]) > 1e-9 * np.abs(shapes).max():
            raise ValueError(
                f"basins: mode {axis.mode} does not move point {axis.point!r} along {axis.direction}; give "
                "another point or mode, or modal coordinates (point=None)"
            )
        unit = 1.0 / float(shapes[k])
    result = np.zeros(2 * modes)
    result[k if axis.kind == "displacement" else modes + k] = unit * (
        weights[k] if axis.kind == "displacement" else 1.0
    )
    return result


def count_of(starts: Any) -> int:
    """Initial states of a grid's axes; of arrays, which take their place already, none."""
    if isinstance(starts, (list, tuple)) and all(isinstance(axis, StartAxis) for axis in starts):
        return math.prod(len(axis.values) for axis in starts)
    return 0


def state_of(orbit: Orbit, unknowns: int) -> np.ndarray:
    """(2 m + k,): the state of a motion at t = 0; ValueError if it has another number of unknowns."""
    if orbit.state.shape != (unknowns,):
        raise ValueError(
            f"basins: {orbit!r} has a state of {orbit.state.size} values, the reduced model one of "
            f"{unknowns}; give orbits of the same reduced model"
        )
    return orbit.state


def initial_states(
    starts: Any, reduced: ReducedModel, weights: np.ndarray, origin: np.ndarray
) -> tuple[tuple[StartAxis, ...], np.ndarray]:
    """Axes of the grid, if any, and the states (..., 2 m)."""
    if isinstance(starts, (list, tuple)) and starts and all(isinstance(s, StartAxis) for s in starts):
        states, behind = origin, np.zeros(len(origin) - 2 * len(weights))  # axes do not move slips
        for axis in starts:
            _check_axis(axis, reduced)
            way = np.append(start_direction(axis, reduced, weights), behind)
            states = states[..., None, :] + np.multiply.outer(axis.values, way)
        return tuple(starts), states
    if not isinstance(starts, tuple) or len(starts) != 2:
        raise TypeError(
            f"basins: starts = {shown(starts)} must be a sequence of StartAxis, or two arrays (..., m), "
            "modal coordinates and their rates"
        )
    q, v = (
        real_array("basins", f"starts[{k}]", part, max(1, np.ndim(part))) for k, part in enumerate(starts)
    )
    if q.shape != v.shape or q.shape[-1] != len(weights) or not q.size:
        raise ValueError(
            f"basins: starts has the shapes {q.shape} and {v.shape}; two arrays (..., {len(weights)}) are "
            "expected"
        )
    slips = np.zeros((*q.shape[:-1], len(origin) - 2 * len(weights)))
    return (), origin + np.concatenate([weights * q, v, slips], axis=-1)


def _check_axis(axis: StartAxis, reduced: ReducedModel) -> None:
    """Raise where an axis asks for what the model has not."""
    most = reduced.load_modes.shape[1] if axis.kind == "impulse" else reduced.natural
    integer("basins", "mode of starts", axis.mode, least=1, most=most)
    if axis.kind == "impulse" and axis.mode - 1 in reduced.edges:
        raise ValueError(
            f"basins: load {axis.mode} of starts is a prescribed displacement, which gives no impulse; name "
            "one that is a force"
        )
    if axis.point is not None:
        reduced.points.of(axis.point, "point")
