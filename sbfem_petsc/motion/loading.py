"""From a user's loads to unit loads with signals, and what is said of models that do not resolve them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from ..checks import real, shown
from ..loads import EdgeMotion, Load, Loads, as_loads, separate
from ..petsc import MPI
from ..ranks.parallel import collective
from ..reduction.build import default_modes
from ..reduction.reduced_model import SYSTEM, ReducedModel
from ..signals.sampling import known
from ..signals.signal import Constant, Signal, as_signal
from ..system.fields.resolution import warn_of_band, warn_of_jumps
from ..system.model import Model

# Hz: what a structure can be driven at.
FASTEST = 1e15
# Share of the displacement under a load that jumps in modes that the default steps of a history follow.
MOVED = 3e-5


def communicator(system: Model | ReducedModel) -> MPI.Comm:
    """Ranks that work on a model together.

    Raises
    ------
    TypeError
        If it is neither a model nor a reduced one.
    """
    if not isinstance(system, (Model, ReducedModel)):
        raise TypeError(f"model = {shown(system)} must be {SYSTEM}")
    return system.comm


@dataclass(frozen=True, eq=False)
class Loading:
    """Unit loads and their signals.

    Attributes
    ----------
    units : tuple of Load
        Empty for a system of matrices, which has unit loads of its own.
    signals : tuple of Signal
        One for each unit load of the system.
    duration : float
        s; inf for steady states.
    rest : bool
        Whether they act on a structure at rest.
    edges : tuple of int
        Those that are prescribed displacements.
    """

    units: tuple[Load, ...]
    signals: tuple[Signal, ...]
    duration: float = math.inf
    rest: bool = False
    edges: tuple[int, ...] = ()

    @property
    def highest_frequency(self) -> float:
        """Hz, of the bands that are known; 0 where no signal has one."""
        return max((s.highest_frequency or 0.0 for s in self.signals), default=0.0)

    def over(self, owner: str, duration: float, rest: bool) -> Loading:
        """The same in a history of this duration (s), from rest or not, in which all bands are known.

        Raises
        ------
        ValueError
            If a function of time changes too often to be sampled, or a prescribed displacement jumps.
        """
        signals = tuple(known(signal, duration) for signal in self.signals)
        for k in self.edges:
            self.require_continuous(owner, k, signals[k]._leaps(duration))
            if rest and (begin := float(signals[k].after(0.0))) != 0.0:
                raise ValueError(
                    f"{owner}: {self._named(k)} is {begin:.6g} m at t = 0, where a structure at rest has no "
                    "displacement; let it begin at 0, or give initial = 'equilibrium'"
                )
        return replace(self, signals=signals, duration=duration, rest=rest)

    def require_continuous(self, owner: str, load: int, jumps: bool) -> None:
        """Raise ValueError for a prescribed displacement that jumps."""
        if jumps:
            raise ValueError(
                f"{owner}: {self._named(load)} = {self.signals[load]!r} jumps, which a displacement cannot; "
                "give it a rise, Step(amplitude, rise=...)"
            )

    def _named(self, load: int) -> str:
        """A prescribed displacement in a sentence."""
        if load >= len(self.units):
            return f"the prescribed displacement load[{load}]"
        unit: Any = self.units[load]
        return f"EdgeMotion {'uy' if unit.uy else 'ux'} of {unit.where!r}"

    @property
    def sudden(self) -> list[int]:
        """Loads that jump, act at once on a structure at rest, or whose highest frequency is not known."""
        return [
            k
            for k, s in enumerate(self.signals)
            if k not in self.edges
            and (
                s.highest_frequency is None or (self.rest and s.after(0.0) != 0.0) or s._leaps(self.duration)
            )
        ]

    @property
    def jumps(self) -> bool:
        """Whether a load jumps behind t = 0."""
        return any(0.0 < instant < self.duration for s in self.signals for instant in s.breaks)


def loading(
    owner: str, system: Model | ReducedModel, load: Any, number: Callable[[float], Signal] = as_signal
) -> Loading:
    """The loads of an analysis on a model, checked. Not collective.

    Parameters
    ----------
    owner : str
        The analysis, for messages.
    system : Model or ReducedModel
    load : loads; for a system of matrices a number or signal for each of its unit loads
    number : callable
        Makes a signal of a plain number: where this is no constant, a number beside signals that vary is
        refused, for it may be either.

    Raises
    ------
    ValueError, TypeError, KeyError
        If a load makes no sense, or a reduced model was not made for it.
    """
    if number is not as_signal:
        _refuse_ambiguous(owner, load)
    found = _loading(owner, system, load, number)
    if not found.highest_frequency <= FASTEST:
        raise ValueError(
            f"{owner}: the loads have frequencies up to {found.highest_frequency:.3g} Hz; at most "
            f"{FASTEST:g} Hz are expected"
        )
    return found


def _loading(
    owner: str, system: Model | ReducedModel, load: Any, number: Callable[[float], Signal]
) -> Loading:
    if isinstance(system, Model):
        system.checked_loads(load, constant=False)
        units, signals = separate(load, number)
        edges = tuple(k for k, unit in enumerate(units) if isinstance(unit, EdgeMotion))
        return Loading(tuple(units), tuple(signals), edges=edges)
    count, edges = system.load_modes.shape[1], tuple(system.edges.tolist())
    values = _values(load)
    if all(isinstance(value, (Real, Signal)) for value in values):
        if len(values) != count:
            raise ValueError(
                f"{owner}: the reduced model has {count} unit loads, the load has {len(values)}; give a "
                "number or signal for each"
            )
        for value in values:
            if isinstance(value, Real):
                real(owner, "load", value)
        given = tuple(v if isinstance(v, Signal) else number(v) for v in values)
        return Loading(system.loads, given, edges=edges)
    if system.model is None:
        raise TypeError(
            f"{owner}: load = {shown(load)} must be a number or signal for each of the {count} unit loads"
        )
    system.model.checked_loads(load, constant=False)
    units, signals = separate(load, number)
    acting: dict[int, Signal] = {}
    for unit, signal in zip(units, signals):
        if unit not in system.loads:
            raise ValueError(
                f"{owner}: the reduced model was made for other loads than {unit!r}; reduce the model again "
                "with it"
            )
        place = system.loads.index(unit)
        # the same place twice: the signals add up
        acting[place] = acting[place] + signal if place in acting else signal
    given = tuple(acting.get(k, Constant(0.0)) for k in range(count))
    return Loading(system.loads, given, edges=edges)


def amplitudes_only(what: str, load: Any) -> None:
    """Refuse signals other than constants where the frequency is swept."""
    _refuse_ambiguous(what, load)
    for name, value in _named(load):
        if _varies(value):
            raise ValueError(
                f"{what}: {name} = {value!r} does not follow the swept frequency; give a number, the "
                "amplitude of sin(2 pi f t), or a Constant"
            )


def _refuse_ambiguous(owner: str, load: Any) -> None:
    """Refuse a number beside signals that vary: it may be an amplitude or a constant."""
    named = _named(load)
    if any(_varies(value) for _, value in named):
        for name, value in named:
            if isinstance(value, Real) and value != 0:
                raise ValueError(
                    f"{owner}: {name} = {value!r} is a number beside signals and may be meant as a constant "
                    f"or as an amplitude; give sb.Constant({value!r}) or sb.Harmonic({value!r}, frequency)"
                )


def _values(load: Any) -> Any:
    """Loads of a sequence, or of a (k,) array, or the only one."""
    return load if isinstance(load, (list, tuple)) or getattr(load, "ndim", 0) == 1 else (load,)


def _named(load: Any) -> list[tuple[str, Any]]:
    """Numbers and signals of loads, with their names; of anything else none."""
    values = _values(load)
    if all(isinstance(value, (Real, Signal)) for value in values):
        return [(f"load[{k}]", value) for k, value in enumerate(values)]
    if not all(isinstance(value, (Load, Loads)) for value in values):
        return []
    return [
        (f"{name} of {type(item).__name__}", value)
        for item in as_loads(list(values)).parts
        for name, value in item.components.items()
    ]


def _varies(value: Any) -> bool:
    return isinstance(value, Signal) and not isinstance(value, Constant)


def warn_of_reduced(owner: str, reduced: ReducedModel, loads: Loading, highest: float) -> None:
    """Warn of modes too few or cells too large for loads; of one that knows its modes. Collective."""
    r = reduced
    if r.modal is None:
        return
    warn_of_band(owner, r.modal, r.damping[: r.natural], highest)
    shares = _shares_of(r, loads)[:, : r.natural]
    warn_of_jumps(owner, r.modal, r.damping[: r.natural], shares, loads.duration)


def moved_up_to(reduced: ReducedModel, loads: Loading) -> float:
    """Frequency of the highest mode, Hz, in which more than `MOVED` of the displacement under loads is that
    jump or have no known band. Collective.
    """
    moved = np.flatnonzero(_shares_of(reduced, loads).max(axis=0, initial=0.0) > MOVED)
    return float(reduced.frequencies[moved[-1]]) if len(moved) else 0.0


def warn_of_unreduced(owner: str, model: Model, loads: Loading, modes: int | None) -> None:
    """Warn of cells too large for loads that jump or have no known highest frequency on an unreduced model,
    by its lowest modes. Collective.

    Parameters
    ----------
    modes : int or None
        None: as many as a reduced model has by default.
    """
    with collective(model.comm):  # functions of a user
        units = [loads.units[k] for k in loads.sudden]
    if not units:
        return
    found = model.modes(modes or default_modes(model, loads.highest_frequency))
    omega, columns = 2.0 * np.pi * found.frequencies, model.load_columns(units)
    solved = model.solver.columns(columns.forces, owner)
    forces = model.comm.allreduce(found.shapes.T @ columns.forces)
    static = model.comm.allreduce((columns.forces * solved).sum(axis=0)) + columns.flexibility.diagonal()
    # what the modes do not move follows, with some mass, too
    above = static - ((forces / omega[:, None]) ** 2).sum(axis=0)
    shares = _shares(omega, forces, np.maximum(above, 0.0))
    warn_of_jumps(owner, found, model.damping_ratios(omega), shares, loads.duration, whole=True)


def _shares_of(r: ReducedModel, loads: Loading) -> np.ndarray:
    """`_shares` of a reduced model under loads that jump or have no known band. Collective."""
    with collective(r.comm):  # functions of a user
        sudden = loads.sudden
    return _shares(r.omega, r.load_modes[:, sudden], r.load_flexibility[sudden, sudden])


def _shares(omega: np.ndarray, forces: np.ndarray, above: np.ndarray) -> np.ndarray:
    """(loads, modes): of the static displacement under loads, in each mode, by their forces on the modes
    (modes, loads) and their work on what is above these (loads,); those that move nothing are left out.
    """
    moved = (forces / np.where(omega > 0.0, omega, np.inf)[:, None]) ** 2
    total = moved.sum(axis=0) + above
    return (moved[:, total > 0.0] / total[total > 0.0]).T
