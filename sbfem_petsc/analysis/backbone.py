"""Backbones: free periodic motions of one mode, its frequency and damping over the energy."""

from __future__ import annotations

import contextlib
import math
from dataclasses import field, replace
from typing import Any, ClassVar

import numpy as np

from ..checks import index_of
from ..continuation.events import refine as refine_points
from ..continuation.follow import Line, follow
from ..continuation.line_file import LineFile
from ..continuation.orbit import Orbit, Orbits, make_orbit
from ..continuation.problem import Lost, Point, Range
from ..continuation.problems.free import ADDED, FreeMotions, FreeState, FreeSystem
from ..continuation.problems.free_stability import (
    FreeEvent,
    Interactions,
    free_events,
    free_multipliers,
    turns,
)
from ..continuation.problems.free_start import PACE, first_motion
from ..errors import SolveError, on_all_ranks
from ..motion.excitation import one_sided
from ..motion.loading import communicator
from ..motion.of_period import require_waves
from ..motion.period_map import FixedPoint
from ..motion.preparation import period_memory
from ..motion.step_plan import CONTACT_STEP
from ..progress import Progress, progress_bar
from ..ranks.capacity import FEW, require_compiler, require_memory, room
from ..ranks.parallel import collective
from ..record.record import Record, derived, described, quantity
from ..reduction.build import reduced
from ..reduction.reduced_model import ReducedModel
from ..system.elements.plausibility import furthest_of_lines
from ..system.model import Model
from .analysis import analysis
from .options import BackboneOptions

# Steps a period, and modes kept beside three for each up to the followed one.
STEPS, MODES = 1024, 20
# Points a decade where the motions of all energies are alike.
DECADE = 8
# Without damping all multipliers have modulus one; what the steps and their eigenvalues add to it.
UNCERTAIN = 1e-5
# A point is next to each turn in energy, relative.
NEXT = 2e-3
HARMONICS = 20


@described
class Backbone(Orbits, Record):
    """Free periodic motions, point by point along their branch.

    Errors are what half the step changes, estimates; nan without refinement, or where half the step leads
    elsewhere, as it may at an interaction with a high mode. The damping ratio by the rate of decay is
    xi / (4 pi f), of a linear system of the same frequency whose amplitude falls as that of a free vibration
    does at the moment, by exp(-xi t / 2) (the modal damping ratio of Krack 2015); without damping the trace
    that the steps leave, about 1e-14. That by the energy is what the dampers take in a period over 4 pi times
    the energy; it is the other one times twice the mean kinetic energy over the energy, and the same where
    nothing touches.

    Multipliers, empty if they were not asked for, are without those that every free motion has: +1 along the
    motion and, without damping, +1 along the branch; with damping less what the self-excitation gives to
    every disturbance. Interactions that were passed over are all on whose tongue the state would change by
    more than 1e-3 of itself. Events are turns in energy, located between the points, and where the branch
    becomes stable or unstable.
    """

    labels: ClassVar = {"place": "points"}
    coordinates: ClassVar = ("energy", "frequency", "stable")

    mode: int = quantity("1", "the followed one, from 1", least=1)
    energy: np.ndarray = quantity(
        "J", "energy at t = 0, where the velocity of the followed mode vanishes", "point", least=0.0
    )
    frequency: np.ndarray = quantity("Hz", "its frequency", "point", least=1e-300)
    frequency_error: np.ndarray = quantity("Hz", "error of the frequency", "point", finite=False)
    damping_ratio: np.ndarray = quantity("1", "damping ratio by the rate of decay", "point")
    damping_error: np.ndarray = quantity("1", "error of damping_ratio", "point", finite=False)
    energy_damping_ratio: np.ndarray = quantity("1", "damping ratio by the energy", "point")
    energy_damping_error: np.ndarray = quantity("1", "error of energy_damping_ratio", "point", finite=False)
    states: np.ndarray = quantity("m sqrt(kg)/s", "(Omega q, q') at t = 0", "point state", detail=True)
    multipliers: np.ndarray = quantity(
        "1", "Floquet multipliers, by falling modulus", "point multiplier", kinds="c", detail=True
    )
    point_harmonics: np.ndarray = quantity(
        "m",
        "harmonics 0 to 20 of the displacement",
        "point place xy harmonic",
        called="harmonics",
        kinds="c",
        detail=True,
    )
    point_amplitudes: np.ndarray = quantity(
        "m", "half the peak-to-peak of u_y", "point place", called="amplitude", least=0.0
    )
    passed: tuple[tuple[float, float], ...] = quantity(
        "J", "energies on either side of interactions with higher modes passed over", "interaction side"
    )
    events: tuple[FreeEvent, ...] = quantity(text="in order", part="FreeEvent")
    damped: bool = quantity("1", "whether with the model's damping")
    reason: str = quantity(text="why the branch ends")
    complete: bool = quantity("1", "whether it reached the last energy", row=True)
    _system: FreeSystem = field(repr=False)
    excitation: np.ndarray = quantity(
        "1/s", "self-excitation that makes up for damping", "point", detail=True
    )
    own_frequency: np.ndarray = quantity(
        "Hz",
        "frequency in the branch's own steps",
        "point",
        detail=True,
        least=1e-300,
    )

    @derived(text="the reduced model", part="ReducedModel", back=True, detail=True)
    def reduced_model(self) -> ReducedModel:
        """The reduced model."""
        return self.reduced

    @derived("1", "time steps a period of the motion", back=True, detail=True, least=1)
    def steps(self) -> int:
        """A period."""
        return self._system.steps

    @classmethod
    def _revived(cls, found: dict[str, Any]) -> Backbone:
        """From a file: the system anew."""
        reduced, steps = found.pop("reduced_model"), found.pop("steps")
        if reduced is None or steps is None or found["mode"] > len(reduced.omega):
            raise ValueError("the reduced model, the steps or the mode is missing")
        require_waves(steps, 1)
        return cls(**found | {"_system": FreeSystem(reduced, found["mode"] - 1, steps)})

    def check(self) -> None:
        """Raise ValueError unless points and model belong together."""
        modes = len(self.reduced.omega)
        if (
            not len(self.energy)
            or self.states.shape[1] != 2 * modes
            or self.point_harmonics.shape[1:3] != self.reduced.points.modes.shape[:2]
            or any(event.after > len(self.energy) for event in self.events)
        ):
            raise ValueError(
                f"{len(self.energy)} motions are not those of {modes} modes and {len(self.points)} points"
            )

    @property
    def reduced(self) -> ReducedModel:
        """The reduced model whose motions these are."""
        return self._system.reduced

    @derived("1", "whether small disturbances die out", "point", kinds="b")
    def stable(self) -> np.ndarray:
        """(n,) bool: no multiplier outside the unit circle by more than 1e-5; False throughout where
        stability was not asked for.
        """
        return ~self.unstable & bool(self.multipliers.shape[1])

    @property
    def unstable(self) -> np.ndarray:
        """(n,) bool: some multiplier is; False throughout where stability was not asked for."""
        largest = np.abs(self.multipliers).max(axis=1, initial=0.0)
        return largest > 1.0 + UNCERTAIN

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a named point by its harmonics, m; less than `least` where that is known to
        be so.
        """
        return furthest_of_lines(self.point_harmonics[..., None], least)

    def orbit(self, k: int) -> Orbit:
        """The k-th motion over its period, integrated again from its state; with damping under the
        self-excitation that keeps it going.
        """
        k = index_of("orbit", "k", k, len(self.energy))
        driven = self._system.at(float(self.own_frequency[k]), float(self.excitation[k]))
        motion = driven.run(self.states[k])
        shot = FixedPoint(self.states[k], driven, motion, (float(np.linalg.norm(motion.residual)),))
        return make_orbit(shot, self.multipliers[k], UNCERTAIN, "point of a backbone")

    def __len__(self) -> int:
        return len(self.energy)

    def __repr__(self) -> str:
        return (
            f"Backbone(mode {self.mode}, {len(self.energy)} points, {self.energy.min():.4g} to "
            f"{self.energy.max():.4g} J, {self.frequency.min():.7g} to {self.frequency.max():.7g} Hz, "
            f"{int(self.unstable.sum())} unstable, {self.reason})"
        )


@analysis(BackboneOptions, rubs=True)
def backbone(
    model: Model | ReducedModel,
    mode: int,
    start: float,
    stop: float,
    *,
    damping: bool = False,
    modes: int | None = None,
    steps: int | None = None,
    points: int = 200,
    largest_step: float | None = None,
    largest_change: float = 0.4,
    interactions: bool = False,
    refine: bool = True,
    stability: bool = True,
    file: str | None = None,
    resume: bool = False,
    progress: Progress = "auto",
) -> Backbone:
    """Follow the free periodic motions that begin as one mode of the open structure, over their energy.

    Parameters
    ----------
    model : Model or ReducedModel
    mode : int
        Counted from 1.
    start, stop : float
        Energies, J; `stop` below `start` goes down.
    damping : bool
        False: without damping, the nonlinear normal mode. True: with the model's, under a self-excitation
        proportional to the velocity that makes up for it: the motion a force reaches that is everywhere in
        phase with the velocity (phase resonance); gives the damping ratios over the energy.
    modes : int, optional
        Modes kept. Default: three for each up to the followed one, and 20.
    steps : int, optional
        Time steps a period, all of one length. Default: 1024, or as many as keep the step below 0.8 of the
        shortest modal period; they are not halved where contact does work, for what twice the steps change
        is told and taken off (`refine`).
    points : int
        Points at most.
    largest_step : float, optional
        Largest change of the energy (J) from a point to the next one, for a finer branch.
    largest_change : float
        Largest change of the state from a point to the next one, relative.
    interactions : bool
        Follow the narrow tongues along which the branch turns back in energy where a multiple of its
        frequency meets that of a higher mode; by default those that can be are passed over, and noted in
        `passed`.
    refine : bool
        Solve every point once more with half the step and extrapolate frequency and damping ratios.
    stability : bool
        Compute Floquet multipliers.
    file : str, optional
        Journal that is kept up to date (`read`).
    resume : bool
        Go on from `file` if it exists, with the same model, mode, range and settings.
    progress : callable, "auto" or None
        As for `transient`; the fraction of the range in logarithms that the branch has come.

    Raises
    ------
    ValueError, TypeError
        For input that makes no sense, and if not even a short branch would find room in the free memory.
    SolveError
        If no motion is found at `start`, or the branch ends between the energies; the points so far are its
        attribute `backbone`.
    """
    reduction = _reduction(model, mode, modes)
    if not damping:
        reduction = replace(reduction, damping=np.zeros(len(reduction.omega)))
    own = float(reduction.frequencies[mode - 1])
    if steps is None:
        steps = max(STEPS, math.ceil(float(reduction.frequencies.max()) / (CONTACT_STEP * own)))
    comm = communicator(model)
    require_compiler("backbone", comm)
    most = _room_for(reduction, steps, points)
    with contextlib.ExitStack() as stack:
        record = None
        if file is not None:
            record = stack.enter_context(LineFile(comm, file, resume=resume))
            told: dict[str, Any] = {"mode": mode, "start": start, "stop": stop, "steps": steps}
            told |= {"damped": damping}
            told |= {
                "damped": damping,
                "interactions": interactions,
                "refine": refine,
                "stability": stability,
            }
            told |= {"largest_step": largest_step or "none", "largest_change": largest_change}
            reduction, _ = record.begin(reduction, told, np.array([start, stop]))
        system = FreeSystem(reduction, mode - 1, steps)
        rows = _Rows(system, refine, stability, damping, interactions)
        report = stack.enter_context(progress_bar(comm, "backbone", progress))
        limits = min(start, stop), max(start, stop)
        problem = FreeMotions(system, limits, interactions)
        line = _begun(problem, record, rows, start, stop)

        def keep(line: Line) -> None:
            rows.add(line.points[-1])
            if record is not None:
                record.update(lambda: rows.backbone(line), [line])
            if report is not None:
                report(min(1.0, abs(math.log(line.points[-1].value / start) / math.log(stop / start))))

        if not line.reason or line.reason.endswith(" points"):  # otherwise it has come to its end
            pace = replace(
                PACE,
                points=most,
                first=min(PACE.first, largest_change),
                largest=largest_change,
                largest_step=largest_step or math.inf,
            )
            follow(line, Range(*limits, 1 if stop > start else -1), pace, keep)
            if line.complete:
                rows.refine_line(line, math.log(limits[1] / limits[0]))
        result = rows.finished(line)
        if record is not None:
            record.update(lambda: result, [line], last=True)
    if not result.complete:
        more = "raise points" if most == points else "there is no memory for more points"
        failure = SolveError(
            f"backbone: the branch of mode {mode} ends at {result.energy[-1]:.6g} J after "
            f"{len(result.energy)} points, before {stop:.6g} J: {result.reason}; {more}, {problem.advice}"
            f"{'' if interactions or damping else ', or follow interactions (interactions=True)'}"
        )
        failure.backbone = result  # type: ignore[attr-defined]
        raise on_all_ranks(failure)
    return result


def _begun(problem: FreeMotions, record: LineFile | None, rows: _Rows, start: float, stop: float) -> Line:
    """The branch of a former run, or its first motion; all of it where motions of all energies are alike."""
    for line in record.lines(problem) if record is not None else ():
        for point in line.points:
            rows.add(point)
            point.state.forget()
        return line
    try:
        first = first_motion(problem.system, start)
    except SolveError as error:
        if not isinstance(error, Lost):  # it says so itself
            raise on_all_ranks(error) from None
        mode = problem.system.mode + 1
        text = f"backbone: no free motion of mode {mode} was found at {start:.6g} J: {error}"
        raise on_all_ranks(SolveError(text)) from None
    first = problem.recalled(first.u, start, np.zeros(2))
    rows.add(first)
    if not problem.system.reduced.homogeneous:
        return Line([first])
    line = Line([first], reason=f"end of the range at {stop:.8g}", complete=True)
    count = max(2, 1 + math.ceil(DECADE * abs(math.log10(stop / start))))
    for energy in np.geomspace(start, stop, count)[1:].tolist():
        u = first.u.copy()
        u[:-2] *= math.sqrt(energy / start)
        line.points.append(problem.recalled(u, energy, np.zeros(2)))
        rows.add(line.points[-1])
    return line


def _reduction(model: Model | ReducedModel, mode: int, modes: int | None) -> ReducedModel:
    """The reduced model whose motions are followed from one of its elastic modes. Collective."""
    kept = modes or 3 * mode + MODES
    with collective(communicator(model)):
        model.require_frictionless("backbone", "follows free motions, which friction brings to rest")
        if isinstance(model, ReducedModel) and modes is not None:
            raise ValueError(
                f"backbone: modes = {modes} has no meaning beside a reduced model; reduce it to so many"
            )
        if isinstance(model, Model) and kept > model.boundary_unknowns // 2:
            raise ValueError(
                f"backbone: {kept} modes are more than half of the {model.boundary_unknowns} unknowns; give "
                "fewer modes, or refine the mesh"
            )
    found = model if isinstance(model, ReducedModel) else reduced(model, (), kept)
    with collective(communicator(model)):
        if (found.initial_gap < 0.0).any():
            raise ValueError(
                f"backbone: contact rows overlap at rest, by {-found.initial_gap.min():g} m; free motions "
                "are followed around a place that nothing presses: give gaps of 0 or more"
            )
        if mode > len(found.omega) or found.omega[mode - 1] == 0.0:
            raise ValueError(
                f"backbone: mode = {mode} must be an elastic one of the {len(found.omega)} modes kept"
            )
    return found


def _room_for(reduction: ReducedModel, steps: int, points: int) -> int:
    """Points that there is memory for: few branches take as many as they may. Collective."""
    size, named = 2 * len(reduction.omega), len(reduction.points.names)
    # the monodromy of each, its state, its multipliers and its harmonics
    each = 8.0 * (size**2 + 4 * size + 4 * named * (HARMONICS + 2))
    few, period = min(points, FEW), period_memory(reduction, steps, 1)
    require_memory(
        "backbone",
        reduction.comm,
        few * each + period,
        f"{few} motions of {steps:,d} steps and {len(reduction.omega)} modes",
        lambda share: "give fewer steps or modes",
    )
    return min(points, max(few, room(reduction.comm, each, period)))


class _Rows:
    """What is kept of each point.

    Parameters
    ----------
    system : FreeSystem
    refine, stability : bool
        Whether frequencies are solved for with half the step too, and multipliers computed.
    damped, interactions : bool
        With the model's damping; into interactions.
    """

    def __init__(self, system: FreeSystem, refine: bool, stability: bool, damped: bool, interactions: bool):
        self.system, self.refine, self.stability = system, refine, stability
        self.damped, self.interactions = damped, interactions
        self.rows: list[tuple[np.ndarray, ...]] = []
        self.first = np.zeros(0)

    def add(self, point: Point, place: int | None = None) -> None:
        """Note a point, at the end or before another one."""
        state, alike = point.state, self.system.reduced.homogeneous
        if self.rows and alike:  # one motion times a factor
            harmonics, amplitudes, *others = self.rows[0]
            factor = float(np.linalg.norm(state.state) / np.linalg.norm(self.first))
            self.rows.append((harmonics * factor, amplitudes * factor, *others))
            return
        if not self.rows:
            self.first = state.state
        values = free_multipliers(state, damped=self.damped) if self.stability else np.zeros(0, complex)
        own, changed = _numbers(state), np.full(3, np.nan)
        found = own.copy()
        # where half the step leads elsewhere the point stays as it is, with an error that is not known
        with contextlib.suppress(SolveError):
            if self.refine:
                difference = _numbers(self._finer(point)) - own
                found, changed = own + 4.0 / 3.0 * difference, np.abs(difference)
        u = state.seen()[0]
        harmonics = np.moveaxis(one_sided(u)[: HARMONICS + 1], 0, -1)
        row = (harmonics, 0.5 * np.ptp(u[..., -1], axis=0), values, own, found, changed)
        self.rows.insert(len(self.rows) if place is None else place, row)

    def _bend(self) -> np.ndarray:
        """(1, n): how far frequencies are from the lowest one, and the range of them: what a curve over the
        energy shows.
        """
        frequency = np.array([row[3][0] for row in self.rows])
        return (frequency - frequency.min() + np.ptp(frequency))[None]

    def _finer(self, point: Point) -> FreeState:
        """The same motion in half the step; that of closed faces by way of damped ones where it has to be."""
        finer = point.problem.finer(2)
        try:
            return finer.of_energy(point.u, point.value, point.linear).state
        except SolveError:
            if not self.system.reduced.homogeneous:
                raise
            return finer.system.around(point, ADDED).state

    def refine_line(self, line: Line, decades: float) -> None:
        """Further points where the branch bends, passes interactions or turns in energy."""
        refine_points(line, lambda: np.log(line.values) / decades, self._bend, self.add)
        if self._passes:
            Interactions(line).divide(self.add)
        for before, point in reversed(turns(line)):
            nearest = min(abs(line.points[k].value - point.value) for k in (before, before + 1))
            if nearest > NEXT * point.value:
                self.add(point, before + 1)
                line.points.insert(before + 1, point)

    @property
    def _passes(self) -> bool:
        """Whether interactions are looked for: with damping there are none."""
        return not (self.damped or self.interactions or self.system.reduced.homogeneous)

    def finished(self, line: Line) -> Backbone:
        """The result with what lies between its points."""
        result = self.backbone(line)
        if self.system.reduced.homogeneous:
            return result
        return replace(
            result,
            passed=Interactions(line).energies() if self._passes else result.passed,
            events=free_events(line, damped=self.damped, stability=self.stability),
        )

    def backbone(self, line: Line) -> Backbone:
        """The result as it is."""
        points = line.points
        harmonics, amplitudes, multipliers, own, found, changed = (
            np.array(column) for column in zip(*self.rows)
        )
        return Backbone(
            self.system.mode + 1,
            line.values,
            found[:, 0].copy(),
            changed[:, 0].copy(),
            found[:, 1].copy(),
            changed[:, 1].copy(),
            found[:, 2].copy(),
            changed[:, 2].copy(),
            np.array([point.state.state for point in points]),
            multipliers,
            harmonics,
            amplitudes,
            tuple((one.value, other.value) for one, other in zip(points, points[1:]) if other.leapt),
            (),
            self.damped,
            line.reason or "unfinished",
            line.complete,
            self.system,
            np.array([point.state.excitation for point in points]),
            own[:, 0].copy(),
        )


def _numbers(state: FreeState) -> np.ndarray:
    """(3,): frequency and both damping ratios."""
    return np.array([state.frequency, state.damping_ratio, state.energy_damping_ratio])
