"""Backbones: free periodic motions of one mode, its frequency and damping over the energy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..capacity import FEW, require_compiler, require_memory, room
from ..checks import index_of
from ..continuation.orbit import Orbit, Orbits, make_orbit, modal_motion
from ..continuation.problems.free import FreeMotion, FreeSystem
from ..continuation.problems.free_branch import ADDED, FreeBranch, Pace
from ..continuation.problems.free_stability import free_multipliers
from ..continuation.problems.free_start import first_motion
from ..errors import SolveError, on_all_ranks
from ..motion.excitation import one_sided
from ..motion.loading import communicator
from ..motion.period_map import FixedPoint
from ..motion.preparation import period_memory
from ..motion.step_plan import CONTACT_STEP
from ..parallel import collective
from ..progress import progress_bar
from ..reduction.build import reduced
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from ..system.plausibility import furthest_of_lines
from .analysis import analysis
from .options import BackboneOptions

# Steps a period, and modes kept beside three for each up to the followed one.
STEPS, MODES = 1024, 20
# Points a decade where the motions of all energies are alike.
DECADE = 8
# Without damping all multipliers have modulus one; what the steps and their eigenvalues add to it.
UNCERTAIN = 1e-5
HARMONICS = 20


@dataclass(frozen=True, eq=False)
class Backbone(Orbits):
    """Free periodic motions, point by point along their branch.

    Attributes
    ----------
    mode : int
        The followed one, counted from 1.
    energy : (n,) array
        J, at t = 0, where the velocity of the followed mode vanishes.
    frequency : (n,) array
        Hz.
    frequency_error : (n,) array
        What half the step changes, Hz, an estimate; nan without refinement, or where half the step leads
        elsewhere, as it may at an interaction with a high mode.
    damping_ratio : (n,) array
        By the rate of decay: xi / (4 pi f), of a linear system of the same frequency whose amplitude falls as
        that of a free vibration does at the moment, by exp(-xi t / 2) (the modal damping ratio of Krack
        2015); without damping the trace that the steps leave, about 1e-14.
    damping_error : (n,) array
        What half the step changes of it, as `frequency_error`.
    energy_damping_ratio : (n,) array
        By the energy: what the dampers take in a period over 4 pi times the energy, that of a linear system
        which loses the same share of its energy in a period; `damping_ratio` times twice the mean kinetic
        energy over the energy, and the same where nothing touches.
    energy_damping_error : (n,) array
        What half the step changes of it.
    states : (n, 2 m) array
        (Omega q, q') at t = 0.
    multipliers : (n, k) complex array
        Floquet multipliers by falling modulus, in conjugate pairs, without those that every free motion has:
        +1 along the motion and, without damping, +1 along the branch; with damping less what the
        self-excitation gives to every disturbance. Empty if they were not asked for.
    point_harmonics : (n, points, 2, 21) complex array
        Harmonics 0 to 20 of the displacement of all named points, m.
    point_amplitudes : (n, points) array
        Half the peak-to-peak of u_y, m.
    passed : tuple of (float, float)
        Energies on either side of interactions with higher modes that were passed over, J.
    damped : bool
    reason : str
        Why the branch ends.
    complete : bool
        Whether it reached the last energy.
    """

    mode: int
    energy: np.ndarray
    frequency: np.ndarray
    frequency_error: np.ndarray
    damping_ratio: np.ndarray
    damping_error: np.ndarray
    energy_damping_ratio: np.ndarray
    energy_damping_error: np.ndarray
    states: np.ndarray
    multipliers: np.ndarray
    point_harmonics: np.ndarray
    point_amplitudes: np.ndarray
    passed: tuple[tuple[float, float], ...]
    damped: bool
    reason: str
    complete: bool
    _system: FreeSystem = field(repr=False)
    _excitation: np.ndarray = field(repr=False)
    _own_frequency: np.ndarray = field(repr=False)

    @property
    def reduced(self) -> ReducedModel:
        """The reduced model whose motions these are."""
        return self._system.reduced

    @property
    def stable(self) -> np.ndarray:
        """(n,) bool: no multiplier outside the unit circle by more than 1e-5; True throughout where stability
        was not asked for.
        """
        if not self.multipliers.shape[1]:
            return np.ones(len(self.energy), dtype=bool)
        return np.abs(self.multipliers[:, 0]) <= 1.0 + UNCERTAIN

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
        driven = self._system.at(float(self._own_frequency[k]), float(self._excitation[k]))
        motion = driven.run(self.states[k])
        shot = FixedPoint(self.states[k], driven, motion, (float(np.linalg.norm(motion.residual)),))
        return make_orbit(shot, self.multipliers[k], UNCERTAIN, "point of a backbone")

    def __repr__(self) -> str:
        return (
            f"Backbone(mode {self.mode}, {len(self.energy)} points, {self.energy.min():.4g} to "
            f"{self.energy.max():.4g} J, {self.frequency.min():.7g} to {self.frequency.max():.7g} Hz, "
            f"{int((~self.stable).sum())} unstable, {self.reason})"
        )


@analysis(BackboneOptions)
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
    largest_change: float = 0.4,
    interactions: bool = False,
    refine: bool = True,
    stability: bool = True,
    progress: Callable[[float], None] | str | None = "auto",
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
    largest_change : float
        Largest change of the state from a point to the next, relative.
    interactions : bool
        Follow the narrow tongues along which the branch turns back in energy where a multiple of its
        frequency meets that of a higher mode; by default those that can be are passed over, and noted in
        `passed`.
    refine : bool
        Solve every point once more with half the step and extrapolate frequency and damping ratios.
    stability : bool
        Compute Floquet multipliers.
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
    require_compiler("backbone", communicator(model))
    most = _room_for(reduction, steps, points)
    more = "raise points" if most == points else "there is no memory for more points"
    system = FreeSystem(reduction, mode - 1, steps)
    passed: tuple[tuple[float, float], ...] = ()
    try:
        first = first_motion(system, start)
    except SolveError as error:
        raise on_all_ranks(error) from None
    if reduction.homogeneous:
        motions, reason = _alike(system, first, start, stop), f"end of the range at {stop:.6g} J"
    else:
        branch = FreeBranch(
            system,
            first,
            (min(start, stop), max(start, stop)),
            Pace(1 if stop > start else -1, most, largest_change, interactions),
        )
        with progress_bar(communicator(model), "backbone", progress) as report:
            for point in branch:
                if report is not None:
                    report(min(1.0, abs(math.log(point.energy / start) / math.log(stop / start))))
        motions, reason, passed = branch.points, branch.reason, tuple(branch.passed)
    collected = _collect(system, motions, _Wanted(refine, stability, damping), reason, stop)
    result = replace(collected, passed=passed)
    if not result.complete:
        failure = SolveError(
            f"backbone: the branch of mode {mode} ends at {result.energy[-1]:.6g} J after {len(motions)} "
            f"points, before {stop:.6g} J: {reason}; {more}, take more steps a period or fewer modes"
            f"{'' if interactions or damping else ', or follow interactions (interactions=True)'}"
        )
        failure.backbone = result  # type: ignore[attr-defined]
        raise on_all_ranks(failure)
    return result


def _reduction(model: Model | ReducedModel, mode: int, modes: int | None) -> ReducedModel:
    """The reduced model whose motions are followed from one of its elastic modes. Collective."""
    kept = modes or 3 * mode + MODES
    with collective(communicator(model)):
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
        if mode > len(found.omega) or found.omega[mode - 1] == 0.0:
            raise ValueError(
                f"backbone: mode = {mode} must be an elastic one of the {len(found.omega)} modes kept"
            )
    return found


def _room_for(reduction: ReducedModel, steps: int, points: int) -> int:
    """Points that there is memory for: few branches take as many as they may. Collective."""
    motion = 8.0 * steps * (2 * len(reduction.omega) + 2 * len(reduction.initial_gap))
    few, period = min(points, FEW), period_memory(reduction, steps, 1)
    require_memory(
        "backbone",
        reduction.comm,
        few * motion + period,
        f"{few} motions of {steps:,d} steps and {len(reduction.omega)} modes",
        lambda share: "give fewer steps or modes",
    )
    return min(points, max(few, room(reduction.comm, motion, period)))


def _alike(system: FreeSystem, first: FreeMotion, start: float, stop: float) -> list[FreeMotion]:
    """Motions of a system in which nothing but touching faces can open: all are one times a factor."""
    count = max(2, 1 + math.ceil(DECADE * abs(math.log10(stop / start))))
    result = []
    for energy in np.geomspace(start, stop, count):
        state = first.state * math.sqrt(energy / start)
        result.append(replace(first, state=state, energy=float(energy), motion=first.driven.run(state)))
    return result


class _Wanted(NamedTuple):
    """What is computed of each motion: frequencies with half the step too, multipliers; whether damped."""

    refine: bool
    stability: bool
    damped: bool


def _collect(system: FreeSystem, motions, wanted: _Wanted, reason: str, stop: float) -> Backbone:
    r = system.reduced
    # frequency and damping ratios, and what half the step changes of them
    found = np.array([_numbers(p) for p in motions])
    own, changed, alike = found[:, 0].copy(), np.full_like(found, np.nan), r.homogeneous
    if wanted.refine:
        finer = FreeSystem(r, system.mode, 2 * system.steps)
        for n, p in enumerate(motions):
            if n and alike:
                found[n], changed[n] = found[0], changed[0]
                continue
            try:
                fine = _finer(finer, p, alike)
            except SolveError:  # the point stays as it is, with an error that is not known
                continue
            difference = _numbers(fine) - found[n]
            found[n] += 4.0 / 3.0 * difference
            changed[n] = np.abs(difference)
    if alike:  # one motion times a factor
        h, a, values = _row(system, motions[0], wanted)
        rows = [
            (h * factor, a * factor, values)
            for factor in (math.sqrt(p.energy / motions[0].energy) for p in motions)
        ]
    else:
        rows = [_row(system, p, wanted) for p in motions]
    harmonics, amplitudes, multipliers = (np.array(column) for column in zip(*rows))
    return Backbone(
        system.mode + 1,
        np.array([p.energy for p in motions]),
        found[:, 0].copy(),
        changed[:, 0].copy(),
        found[:, 1].copy(),
        changed[:, 1].copy(),
        found[:, 2].copy(),
        changed[:, 2].copy(),
        np.array([p.state for p in motions]),
        multipliers,
        harmonics,
        amplitudes,
        (),
        wanted.damped,
        reason,
        math.isclose(motions[-1].energy, stop, rel_tol=1e-9),
        system,
        np.array([p.excitation for p in motions]),
        own,
    )


def _numbers(point: FreeMotion) -> np.ndarray:
    """(3,): frequency and both damping ratios."""
    return np.array([point.frequency, point.damping_ratio, point.energy_damping_ratio])


def _finer(finer: FreeSystem, point: FreeMotion, alike: bool) -> FreeMotion:
    """The same motion of a finer system; that of closed faces by way of damped ones where it has to be."""
    try:
        return finer.again(point, point.energy, point.excitation)
    except SolveError:
        if not alike:
            raise
        return finer.around(point, ADDED)


def _row(system: FreeSystem, point: FreeMotion, wanted: _Wanted):
    """Harmonics, amplitudes and multipliers of a motion."""
    r = system.reduced
    q, _ = modal_motion(point.driven, point.motion)
    u = np.einsum("pim,nm->npi", r.points.modes, q[:-1], optimize=True)
    u += np.einsum("pic,nc->npi", r.points.contact, point.motion.forces[:-1], optimize=True)
    spectrum = np.moveaxis(one_sided(u)[: HARMONICS + 1], 0, -1)
    values = np.zeros(0, dtype=complex)
    if wanted.stability:
        values = free_multipliers(system, point, damped=wanted.damped)
    return spectrum, 0.5 * np.ptp(u[..., 1], axis=0), values
