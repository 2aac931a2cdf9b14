"""One period of the unreduced model as a map, and its derivative as products.

The state (u, v) of all unknowns is distributed. A product with the derivative is one linearised period: the
same steps without loads, in which the rows that touched in each step keep their gaps. Its inverse is near
that of the motion without contact in the lowest modes, closed form; what lies above them dies out within the
period, as stiffness-proportional damping makes it. Only what is stiffer than the time steps resolve does not:
average acceleration turns its sign in each step and leaves its size. The number of steps is therefore odd, so
that Phi - 1 is about -2 there and not about 0.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ...petsc import stage
from ...ranks.capacity import require_compiler, require_memory
from ...ranks.parallel import collective
from ...system.model import Model
from ...system.solve.demand import require_steps
from ...system.solve.modes import lowest_modes
from ...system.solve.pencil import Pencil
from ..excitation import Excitation
from ..integration import Steps
from ..loading import Loading, warn_of_unreduced
from ..preparation import STEPS, PeriodSettings, driving
from ..states import Rows, SampledStates
from ..steps import step_coefficients
from .history import row_of, row_size, sampled
from .kept_fields import KeptFields
from .steps import KEPT_RESPONSES, UnreducedSteps

# Modes of the inverse nearby and of the linear response by default.
MODES = 40
# Step lengths that are kept prepared: a motion's, and that beside it by which its rate is found.
PREPARED = 2
# Is told the steps, and the forces and gaps at the end of one.
Watch = Callable[[UnreducedSteps, np.ndarray, np.ndarray], None]
# GMRES keeps two vectors (u, v) an iteration of so many at most; few take more than a quarter of them.
KRYLOV = 100


class UnreducedMotion(NamedTuple):
    """One period from a given state.

    Attributes
    ----------
    end : (n,) array
        x(T), this rank's part.
    sets : (steps, c) bool array
        Rows that touch in each step.
    displacements : (steps, points, 2) array
        Of the named points, m; from t = 0 on, where the last instant of a periodic motion stands.
    resultant : (steps,) array
        Contact resultant, N; in the same order.
    """

    end: np.ndarray
    sets: np.ndarray
    displacements: np.ndarray
    resultant: np.ndarray


class UnreducedPeriod:
    """The period of a driven unreduced model, in equal steps; a context manager.

    Parameters
    ----------
    model : Model
    loads : Loading
    excitation : Excitation
    settings : PeriodSettings
        Its modes are those of the inverse nearby and of the linear response, and those that have the model's
        modal damping ratio.
    frequency : float
        By which displacements are weighed to be velocities, Hz.

    Attributes
    ----------
    steps : int
        Of the period; one more than asked for if these are even in number.
    products : int
        Linearised periods so far.
    """

    def __init__(
        self, model: Model, loads: Loading, excitation: Excitation, settings: PeriodSettings, frequency: float
    ):
        self.model, self.comm, self.loads = model, model.comm, loads
        self.steps = odd_steps(settings.steps, excitation.periods)
        self.excitation = excitation.below(0.5 * self.steps)
        self.contact, self.weight, self.products = settings.contact, 2.0 * np.pi * frequency, 0
        self.found = lowest_modes(model, settings.modes or MODES, auxiliary_tolerance=0.0)
        self.pencil = Pencil(model.statics, 1.0, 0.0)
        self._marches: dict[float, UnreducedSteps] = {}

    def __enter__(self) -> UnreducedPeriod:
        return self

    def __exit__(self, *_: object) -> None:
        while self._marches:
            self._marches.popitem()[1].release()
        self.pencil.destroy()

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return tuple(self.model.points)

    @property
    def unknowns(self) -> int:
        """Of a state, this rank's."""
        return 2 * int(self.pencil.stiffness.getLocalSize()[0])

    def at(self, frequency: float, load: float = 1.0) -> UnreducedDriven:
        """The period at a forcing frequency (Hz) and a factor on the oscillating loads."""
        return UnreducedDriven(self, frequency, load)

    @property
    def told_steps(self) -> int:
        """Steps a forcing period."""
        return self.steps // self.excitation.periods

    def march(self, frequency: float) -> UnreducedSteps:
        """The steps of a forcing frequency (Hz), of which the last ones are kept. Collective."""
        march = self._marches.pop(frequency, None)
        if march is None:
            while len(self._marches) >= PREPARED:
                self._marches.pop(next(iter(self._marches))).release()
            step = self.excitation.periods / frequency / self.steps
            steps = Steps(self.steps, step, self.contact, "implicit", 1)
            march = UnreducedSteps(self.model, self.pencil, self.loads.units, steps, self.found)
        self._marches[frequency] = march
        return march


class UnreducedDriven:
    """An `UnreducedPeriod` at one frequency and load."""

    def __init__(self, period: UnreducedPeriod, frequency: float, factor: float):
        self.period, self.frequency, self.factor = period, frequency, factor
        self.weight, self.size = period.weight, period.unknowns // 2
        self.excitation = period.excitation.scaled(factor)
        self.amplitudes = self.excitation.loads(period.steps)
        edges, lines = list(period.loads.edges), self.excitation
        speeds = 2j * np.pi * frequency / lines.periods * lines.orders[:, None] * lines.amplitudes[:, edges]
        self.rates = lines.over_time(speeds, period.steps)

    @property
    def march(self) -> UnreducedSteps:
        """Its steps. Collective."""
        return self.period.march(self.frequency)

    @stage("Steps")
    def run(self, state: np.ndarray, watch: Watch | None = None) -> UnreducedMotion:
        """One period from x(0) = (weight u, v), this rank's part; `watch` is called after each step.
        Collective.
        """
        march, steps = self.march, self.period.steps
        sets, resultant = np.zeros((steps, march.pairs), dtype=bool), np.zeros(steps)
        places = np.zeros((steps, len(self.period.points), 2))
        self._set(march, state)
        march.amplitudes, march.rates = self.amplitudes[0], self.rates[0]
        march.contact.open(np.zeros(march.pairs))
        for k in range(steps):
            before, after = self.amplitudes[k : k + 2]
            force, gap = march.advance(before + after, after, self.rates[k + 1])
            sets[k], places[k], resultant[k] = march.laws.acting(force), march.at_points()[0], force.sum()
            if watch is not None:
                watch(march, force, gap)
        march.settle()
        return UnreducedMotion(self._state(march), sets, np.roll(places, 1, axis=0), np.roll(resultant, 1))

    @stage("Steps")
    def carried(self, vector: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """dx(T) along dx(0), this rank's part, of a motion whose rows touch as in `sets`. Collective."""
        march = self.march
        self._set(march, vector)
        for acting in sets:
            march.advance_linearised(acting)
        march.settle()
        self.period.products += 1
        return self._state(march)

    def _set(self, march: UnreducedSteps, state: np.ndarray) -> None:
        march.u[:], march.v[:] = state[: self.size] / self.weight, state[self.size :]
        march.settle(fold=False)

    def _state(self, march: UnreducedSteps) -> np.ndarray:
        return np.concatenate([self.weight * march.u, march.v])

    @functools.cached_property
    def _modal_map(self) -> np.ndarray:
        """(m, 2, 2): the period map of each computed mode without loads and contact, in (weight q, p)."""
        omega, step = self.march.omega, self.march.step
        ratios = self.period.model.damping_ratios(omega)
        a, b, _, _, _, c, d, _, _, _ = step_coefficients(omega, ratios, step, "newmark")
        rows = np.array([[a, self.weight * b], [c / self.weight, d]])
        return np.linalg.matrix_power(np.moveaxis(rows, 2, 0), self.period.steps)

    def linear_resolvent(self, vector: np.ndarray) -> np.ndarray:
        """(Phi - 1)^-1 of the motion without contact: closed form in the modes, -1 above them. Collective."""
        march = self.march
        parts = [part.copy() for part in np.split(vector, 2)]
        modal_parts = np.stack(
            [march.summed(march.phi.T @ march._times(march.pencil.mass, part)) for part in parts], axis=1
        )
        solved = np.linalg.solve(self._modal_map - np.eye(2), modal_parts[..., None])[..., 0] + modal_parts
        return np.concatenate([march.phi @ solved[:, k] - parts[k] for k in (0, 1)])

    @property
    def linear_state(self) -> np.ndarray:
        """x(0) of the linear steady state in the computed modes."""
        march = self.march
        orders, periods = self.excitation.orders[:, None], self.excitation.periods
        rates = 2.0 * np.pi * orders * self.frequency / periods
        acting, edges = self.excitation.amplitudes.copy(), march.ground.edges
        acting[:, edges] *= -(rates**2)
        forces = acting @ march.probe_modes[march.pairs : march.pairs + march.loads]
        a, b = march.rayleigh
        q = forces / (march.omega**2 - rates**2 + 1j * rates * (march.friction + a + b * march.omega**2))
        return np.concatenate(
            [self.weight * (march.phi @ q.sum(axis=0).real), march.phi @ (1j * rates * q).sum(axis=0).real]
        )

    def states(self, state: np.ndarray) -> SampledStates:
        """The instants of the period from a state, from t = 0 on. Collective."""
        march, count = self.march, self.period.steps
        fields = KeptFields(march.model, march.pencil, self.period.loads.units, count)
        rows: list[Rows] = []

        def watch(march: UnreducedSteps, force: np.ndarray, gap: np.ndarray) -> None:
            borne = march.slope[len(march.ground.points) :].reshape(-1, 2)
            rows.append({**row_of(march, force, gap), "reactions": borne})
            if fields.wanted:
                fields.add(march.whole(), march.amplitudes)

        self.run(state, watch)
        # the last instant is the first one: the rows begin after it
        found = {name: np.roll(np.array([row[name] for row in rows]), 1, axis=0) for name in rows[0]}
        borne, speeds, apart = found["reactions"], found["velocity"], 2.0 * march.step
        found["reactions"] = 0.5 * (borne + np.roll(borne, -1, axis=0))
        # the mean of the accelerations of the two steps beside an instant
        found["acceleration"] = (np.roll(speeds, -1, axis=0) - np.roll(speeds, 1, axis=0)) / apart
        kept = fields.rolled().complete(count) if fields.wanted else None
        return sampled(march, found, kept)


def odd_steps(steps: int | None, periods: int) -> int:
    """Steps of a period of so many forcing periods."""
    return (steps or STEPS) * periods | 1


def prepare_unreduced(
    owner: str, model: Model, load: Any, frequency: float, *, settings: PeriodSettings
) -> UnreducedPeriod:
    """The period map of checked input. Collective.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense, a model whose motions above the computed modes never die out, and where
        there is no room.
    """
    model.require_support(owner)
    with collective(model.comm):
        loads, excitation = driving(owner, model, load, frequency, settings=settings)
        if model.rayleigh[1] == 0.0:
            raise ValueError(
                f"{owner}: the unreduced model needs stiffness-proportional damping, Model(rayleigh=(a, b)) "
                "with b > 0: without it motions above the computed modes never die out, and no steady state "
                "is reached"
            )
    modes = settings.modes or MODES
    _require_room(owner, model, odd_steps(settings.steps, excitation.periods), modes)
    warn_of_unreduced(owner, model, loads, modes)
    return UnreducedPeriod(model, loads, excitation, settings, frequency)


def _require_room(owner: str, model: Model, count: int, modes: int) -> None:
    """Refuse a period whose instants, or whose matrices and Krylov vectors, would take more memory than is
    free. Collective.
    """
    require_compiler(owner, model.comm)
    # lists of small arrays, then arrays of all, rolled
    row = 3 * row_size(model) + 1000
    require_memory(
        owner,
        model.comm,
        float(count * row),
        f"{count:,d} steps a period",
        lambda share: f"give at most {int(share * count):,d}",
    )
    responses = min(len(model.contact), KEPT_RESPONSES)
    require_steps(owner, model.cells, modes, responses, vectors=KRYLOV // 2)
