"""Static states along a history of the loads, with contact (prefix ``static_``).

Frictionless contact has no memory: each state is the static solution under the loads of its instant. Faces
that rub remember how far they have slipped: a state follows from the one before it, the first one from rest.
The history shows how faces close and open, and K_I(t) and K_II(t), under loads too slow for inertia to
matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, overload

import numpy as np

from ..checks import instance, real_array
from ..contact.law import peak_of
from ..errors import at_point
from ..loads import Loads
from ..motion.history import Motion
from ..motion.loading import loading
from ..motion.states import ModalStates, Point
from ..ranks.capacity import require_memory
from ..ranks.parallel import agreed, collective
from ..record.record import Record, derived, described, of_each, quantity
from ..reduction.reduced_model import SYSTEM, ReducedModel
from ..signals.signal import Signal
from ..system.fields.places import checked_line
from ..system.fields.static_resolution import warn_of_rest
from ..system.fields.tip_facts import together
from ..system.fields.tips import warn_of_tips
from ..system.model import Model
from .analysis import analysis
from .options import LoadHistoryOptions
from .static import at_rest, reduced_states, state
from .static_result import Static

_over_time = of_each("states", Static, "time")


@described
class LoadHistory(Record):
    """Static states at given times."""

    labels: ClassVar = {"place": "points", "support": "supports", "tip": "tips"}
    coordinates: ClassVar = ("time",)

    time: np.ndarray = quantity("s", "times of the states", "time")
    states: tuple[Static, ...] = quantity(
        text="the solutions themselves, their fields included", part="Static", detail=True
    )

    def check(self) -> None:
        """Raise ValueError unless each time has its state."""
        if not len(self.states) == len(self.time) > 0:
            raise ValueError(f"{len(self.states)} states at {len(self.time)} times do not fit")

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return tuple(self.states[0].point_displacements)

    @property
    def supports(self) -> tuple[str, ...]:
        """Names of what is supported."""
        return tuple(self.states[0].reactions)

    @property
    def tips(self) -> tuple[str, ...]:
        """Names of the crack tips with a tip element."""
        return tuple(self.states[0].stress_intensity)

    point_displacements = _over_time("point_displacements")
    reactions = _over_time("reactions")
    stress_intensities = _over_time("stress_intensity", called="stress_intensity")
    energy_release_rate = _over_time("energy_release_rate")
    t_stress = _over_time("t_stress")
    contact_force = _over_time("contact_force", detail=True)
    gap = _over_time("gap", detail=True)
    slip = _over_time("slip", detail=True)
    friction_force = _over_time("friction_force", detail=True)
    slid = _over_time("slid", detail=True)
    contact_resultant = _over_time("contact_resultant")

    def displacement(self, point: str | tuple[float, float]) -> np.ndarray:
        """(n, 2): displacement of a named point, or of any point (x, y) in m, in m. Collective for (x, y)."""
        return np.array([state.displacement(point) for state in self.states])

    @agreed()
    def stress(self, place: str | tuple[float, float]) -> np.ndarray:
        """(n, 3): stress xx, yy, xy at a named point or at any point (x, y) in m, Pa. Collective."""
        return np.array([state.stress(place) for state in self.states])

    @agreed()
    def along(
        self, start: tuple[float, float], end: tuple[float, float], count: int = 101
    ) -> tuple[np.ndarray, ...]:
        """Displacement and stress along a straight line. Collective.

        Returns
        -------
        places, displacement, stress : (count, 2), (n, count, 2), (n, count, 3) arrays
            m, m and Pa.
        """
        line, points = checked_line(start, end, count)
        model, columns = self.states[0]._solved, [state.columns for state in self.states]
        inertia = any(c.acceleration.any() for c in columns)
        moved = any(c.lift is not None for c in columns)
        places = model.places(points, inertia=inertia, moved=moved)
        u, stress = zip(*(state.at_places(places) for state in self.states))
        return line, np.array(u), np.array(stress)

    @derived(text="what K, G, T and forces of single pairs do not tell by themselves", dims="note")
    def notes(self) -> tuple[str, ...]:
        """What K, G and T of the tips do not tell by themselves in one state or more, see `Static`. They are
        printed too.
        """
        return together([state.notes for state in self.states])

    def stress_intensity(self, crack: str) -> np.ndarray:
        """(n, 2): K_I and K_II of a crack's tip, Pa m^(1/2) (at open notches as `notes` says).

        Raises
        ------
        KeyError
            If the crack has no tip element.
        """
        at_point(self.states[0].stress_intensity, crack, "crack tip")
        return np.array([state.stress_intensity[crack] for state in self.states])

    @derived("J", "lost to friction so far", "time")
    def friction_loss(self) -> np.ndarray | None:
        """(n,): J, that inside tip elements included; friction changes linearly from a state to the next."""
        if self.states[0].friction_loss is None:
            return None
        return np.cumsum([state.friction_loss for state in self.states])

    def __repr__(self) -> str:
        return (
            f"LoadHistory({len(self.time)} states from {self.time[0]:.6g} to {self.time[-1]:.6g} s, peak "
            f"contact resultant {'; '.join([f'{peak_of(self.contact_resultant):.6g} N', *self.notes])})"
        )


@described
class ReducedLoadHistory(Motion):
    """Static states of a reduced model of a body or of matrices at given times."""

    friction_loss: np.ndarray | None = quantity(
        "J", "lost to friction so far", "time", kinds="f", default=None
    )

    @derived("m", "displacement along the own direction of each point", "time place", called="displacement")
    def point_displacements(self) -> np.ndarray:
        """(n, points): m."""
        return np.stack([self.displacement(point) for point in self.points], axis=1)

    def displacement(self, point: Point) -> np.ndarray:
        """(n,): of a named point along its own direction, m."""
        return self.states.displacement(point)[:, -1]

    @derived("J", "that of elastic stops included", "time")
    def strain_energy(self) -> np.ndarray:
        """(n,): J."""
        assert isinstance(self.states, ModalStates)
        return self.states.strain_energy

    def check(self) -> None:
        """Any times are good: states follow each other in the order in which they stand."""

    def __repr__(self) -> str:
        return (
            f"ReducedLoadHistory({len(self.time)} states from {self.time[0]:.6g} to {self.time[-1]:.6g} s, "
            f"peak contact resultant {peak_of(self.contact_resultant):.6g} N)"
        )


@overload
def load_history(
    model: Model, load, time: Sequence[float] | np.ndarray, *, contact: bool = True
) -> LoadHistory: ...
@overload
def load_history(
    model: ReducedModel, load, time: Sequence[float] | np.ndarray, *, contact: bool = True
) -> ReducedLoadHistory: ...
@analysis(LoadHistoryOptions, rubs=True)
def load_history(
    model: Model | ReducedModel, load, time: Sequence[float] | np.ndarray, *, contact: bool = True
) -> LoadHistory | ReducedLoadHistory:
    """Static states under loads that change slowly.

    Parameters
    ----------
    model : Model or ReducedModel
        A reduced one of a body or of matrices, as in `static`.
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        Numbers are constant loads; signals are taken at each time. Of a reduced model a number or signal for
        each of its unit loads.
    time : (n,) sequence of float
        s, in the order in which the states are wanted and in which faces rub (`Coulomb`).
    contact : bool
        Whether crack faces may press on each other; False: they may overlap.

    Raises
    ------
    ValueError
        For no times, or one that is not finite; for what `static` refuses.
    TypeError
        For times that are not numbers.
    SolveError
        If the linear solve or the active set fails.

    Warns
    -----
    MeshWarning
        As `static`; of displacements once, in the state that is off most of the four in most doubt.
    """
    if isinstance(model, ReducedModel):
        times, signals = _checked(time), loading("load_history", model, load).signals
        over = np.array([[float(signal(t)) for signal in signals] for t in times])
        found = reduced_states("load_history", model, over, contact)
        lost = None if model.friction is None else np.cumsum(found.lost)
        return ReducedLoadHistory(times, found.motion, lost)
    instance("load_history", "model", model, Model, SYSTEM)
    with collective(model.comm):
        times = _checked(time)
        loads = model.checked_loads(load, constant=False)
    require_memory(
        "load_history",
        model.comm,
        len(times) * _state_size(model),
        f"{len(times):,d} states",
        lambda share: f"at most {int(share * len(times)):,d} times fit, or take a coarser mesh",
    )
    states: list[Static] = []
    for t in times:
        former = states[-1] if states else None
        states.append(state(model, _at(loads, float(t)), contact, former=former))
    warn_of_tips("load_history", model.tips, [one.stress_intensity for one in states])
    warn_of_rest(model, [at_rest(f"load_history, at {t:.6g} s", one) for t, one in zip(times, states)])
    return LoadHistory(times, tuple(states))


def _state_size(model: Model) -> float:
    """Bytes that a static solution keeps on this rank, about: the fields of displacement and forces, by nodes
    and by unknowns, what belongs to the contact rows, and Python's own.
    """
    layout = model.layout
    nodes, unknowns = len(layout.part.nodes), layout.owned.stop - layout.owned.start
    return 8.0 * (4 * nodes + 2 * unknowns + 6 * model.contact.pairs) + 6000.0


def _checked(time) -> np.ndarray:
    times = real_array("load_history", "time", time, 1, "s")
    if len(times) == 0:
        raise ValueError("load_history: time is empty; one or more times are expected")
    return times


def _at(loads: Loads, time: float) -> Loads:
    """The loads of one instant, as constants."""

    def constant(load):
        values = {name: value for name, value in load.components.items() if isinstance(value, Signal)}
        return replace(load, **{name: float(signal(time)) for name, signal in values.items()})

    return Loads(tuple(constant(part) for part in loads.parts))
