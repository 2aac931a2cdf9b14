"""Errors of a steady state's harmonics by left-out modes and by the steps, told by the same motion in more of
both.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np

from ..errors import SolveError
from ..motion.excitation import one_sided
from ..motion.period_map import DrivenPeriod, FixedPoint, Period
from ..motion.preparation import finer, require_period
from ..motion.steps import free_motion
from ..reduction.build import wider
from ..reduction.reduced_model import ReducedModel, share_modes
from .newton import attempt
from .orbit import LOWEST, Orbit, modal_motion
from .problem import FINER_GAIN
from .shooting import WHOLE, Shooting, rough_derivative

# A harmonic is beside itself, or this share of the largest; of a body at rest all that oscillates is
# rounding, below this share of the mean.
FAINT, RESTING = 1e-3, 1e-7
# Errors of second order, relative to the change in twice the steps; the same of left-out modes, whose error
# falls about as the square of the highest frequency, and at most.
SECOND, MODES, MOST = 4.0 / 3.0, 2.0, 4.0
# The same of vectors that stand for all of them up to twice the highest frequency; those beyond edges that
# move have more, and where faces rub errors fall as little as 1 / band.
ALL, MOVED, RUBBING = 1.5, 3.0, 2.5
# Iterations, and the residual relative to the first one and to the linear oscillation: where equal
# frequencies have other modes of one plane in the wider model the first one is large.
NEWTON, RELATIVE, OF_OSCILLATION = 16, 1e-2, 1e-5
# Whose memory is checked, for messages that nobody sees.
OWNER = "harmonic_error_estimates"
# Of the flexibility that is left out, what further modes take at least where they tell what all of them do:
# .05 to .65 on beams and plates, 1e-4 and less where those of other parts come next. What of a flexibility is
# rounding.
LEAST_PART, ROUNDING = 0.01, 1e-9


def harmonic_error_estimates(fixed: FixedPoint) -> np.ndarray:
    """(3, 5): errors by left-out modes, by the steps and by the viscosity of what is left out, of harmonics
    0 to 4 of the displacements of all named points and of the contact resultant, the larger one, each
    relative to itself or to 1e-3 of the largest that oscillates. Collective.

    The motion is found again in twice the steps, and in more modes (`build.wider`) in as many steps, or,
    where that is in vain, in its own; where faces rub in its own first. inf where it is not found, or has no
    room; nan where nothing is known of the left-out modes, or there is no named point.
    """
    driven, p = fixed.driven, fixed.driven.period
    more = wider(p.reduced)
    if more is None or not len(p.points):
        return np.full((3, LOWEST), np.nan)
    errors, best, where = np.full((3, LOWEST), np.inf), fixed, (driven.frequency, driven.factor)
    if not fixed.touching.any():  # known in closed form
        errors[1] = 0.0
    elif period := attempt(lambda: finer(OWNER, p, 2), ValueError):  # there may be no memory for it
        if found := _nearby(period.at(*where), fixed.state, lambda: known_derivative(fixed)):
            errors[1], best = SECOND * change(lowest(fixed), lowest(found), driven), found
    # Where faces rub, motions in more modes are dear in twice the steps; elsewhere they ring in the own ones.
    base, other = (fixed, best) if p.friction is not None else (best, fixed)
    delay, late = p.reduced.delay, base
    if not delay:
        errors[2] = 0.0
    elif found := _nearby(delayed(base.driven, base), base.state, lambda: known_derivative(fixed)):
        errors[2], late = change(lowest(base), lowest(found, delay), driven), found
    factor = beyond(p.reduced, more)
    if np.isfinite(factor):
        errors[0] = factor * _change_in_more_modes(late, fixed, more, delay * (late is not base))
        if np.isinf(errors[0]).any() and other is not base:
            errors[0] = factor * _change_in_more_modes(other, fixed, more, 0.0)
    return errors


def _change_in_more_modes(
    motion: FixedPoint, fixed: FixedPoint, more: ReducedModel, delay: float
) -> np.ndarray | float:
    """How harmonics change from those of a motion near another; inf where it is not found, or has no room."""
    driven, period = motion.driven, motion.driven.period
    wide = attempt(lambda: in_more_modes(period, more, period.steps), ValueError)
    if wide is None:
        return np.inf
    beside = wide.at(driven.frequency, driven.factor)
    beside = delayed(beside, motion) if delay else beside
    state = beside.linear_state + added(motion, wide)
    found = _nearby(beside, state, lambda: carried_derivative(fixed, beside, state))
    return np.inf if found is None else change(lowest(motion, delay), lowest(found, delay), driven)


def delayed(driven: DrivenPeriod, fixed: FixedPoint) -> DrivenPeriod:
    """A map whose gaps through what is left out follow the forces of a motion in as many steps as under
    Rayleigh's damping: what that changes is right to first order in b.
    """
    delay, r, pairs = fixed.driven.period.reduced.delay, driven.period.reduced, driven.period.pairs
    assert r.lag is not None  # whose delay it is
    loads, forces = (
        behind(part[:-1], delay, driven.duration) - part[:-1] for part in (driven.loads, fixed.motion.forces)
    )
    loads[:, r.edges] = 0.0  # what follows moving supports is not damped
    late = forces @ (r.gap.contact - np.diag(r.lag.layers))[:pairs, :pairs] + loads @ r.gap.loads[:pairs].T
    result = copy.copy(driven)
    result.free_gap, result._kept = driven.free_gap + late[np.r_[: len(late), 0]], None
    return result


def behind(values: np.ndarray, delay: float, duration: float) -> np.ndarray:
    """Periodic values (n, ...) that follow others as y + b y' = x, by their lines."""
    lines = np.fft.rfft(values, axis=0)
    speeds = 2j * np.pi / duration * np.arange(len(lines))[:, None]
    return np.fft.irfft(lines / (1.0 + delay * speeds), len(values), axis=0)


def in_more_modes(period: Period, more: ReducedModel, steps: int) -> Period:
    """The map in more modes and so many steps. Raises ValueError where there is no memory for it."""
    require_period(OWNER, more, steps, len(period.excitation.orders), period.pairs > 0)
    return Period(more, period.excitation, steps, period.pairs > 0)


def beyond(reduced: ReducedModel, more: ReducedModel) -> float:
    """What the error by left-out modes is taken to be, relative to the change in more modes; inf where these
    have next to nothing of what is driven, and others tell.
    """
    if reduced.model is not None and more is not reduced:
        return MOVED if len(reduced.edges) else ALL if reduced.friction is None else RUBBING
    if more is reduced or not (more.points.loads.any() or more.points.contact.any()):  # which are all
        return 1.0
    own, omega = reduced.points, np.where(reduced.omega > 0.0, reduced.omega, np.inf)  # of what bends
    flexible = own.modes / omega**2
    for known, left, forced in (
        (own.loads, more.points.loads, reduced.load_modes),
        (own.contact, more.points.contact, reduced.gap.modes.T),
    ):
        most = np.linalg.norm(known)
        counts = most > ROUNDING * np.linalg.norm(flexible @ forced)
        if counts and np.linalg.norm(left - known) < LEAST_PART * most:
            return np.inf
    share = (reduced.frequencies.max() / more.frequencies.max()) ** 2
    return float(min(MODES / (1.0 - share), MOST))


def _nearby(
    driven: DrivenPeriod, state: np.ndarray, derivative: Callable[[], np.ndarray]
) -> FixedPoint | None:
    """The motion near a state, of a map whose derivative dx(T) / dx(0) is about known: by updates of that,
    and, where these hardly gain, by derivatives of its own.
    """
    whole = driven.period.unknowns <= WHOLE
    for jacobian in ("updated", "dense") if whole else ("matrix-free",):
        shooting = Shooting(driven, jacobian, NEWTON)
        shooting.hurries, shooting.gain = True, FINER_GAIN
        try:
            first = float(np.linalg.norm(shooting.motion_at(state).residual))
            shooting.relative = min(RELATIVE, OF_OSCILLATION * driven.oscillation / max(first, 1e-300))
            if jacobian == "updated":
                shooting.near = derivative() - np.eye(len(state))
            return shooting.solve(state)
        except SolveError:
            continue
    return None


def known_derivative(fixed: FixedPoint) -> np.ndarray:
    """dx(T) / dx(0) of a motion, where faces rub about."""
    if fixed.driven.period.friction is None:
        return fixed.monodromy
    return rough_derivative(fixed.driven, fixed.state)


def carried_derivative(fixed: FixedPoint, beside: DrivenPeriod, state: np.ndarray) -> np.ndarray:
    """dx(T) / dx(0) in more modes, about: further ones move freely; where faces rub, that near a state in
    fewer steps.
    """
    driven, r, p = fixed.driven, beside.period.reduced, beside.period
    if p.friction is not None:
        return rough_derivative(beside.in_steps(driven.period.steps), state)
    result = free_motion((r.omega, r.damping), beside.duration, p.weights, p.unknowns)
    signs, places = _shared(driven.period.reduced, r)
    m, count = len(driven.period.reduced.omega), len(places) // 2
    known = np.r_[:count, m : m + count]
    result[np.ix_(places, places)] = signs[:, None] * fixed.monodromy[np.ix_(known, known)] * signs
    return result


def lowest(fixed: FixedPoint, delay: float = 0.0) -> list[np.ndarray]:
    """(5, ...) each: harmonics 0 to 4 of what is seen of a motion, see `seen`."""
    periods = fixed.driven.period.excitation.periods
    return [one_sided(part)[: periods * LOWEST : periods] for part in seen(fixed, delay)]


def seen(fixed: FixedPoint, delay: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(n, points, 2), m: displacements of the named points, from t = 0 on, of which what is left out may
    follow by a delay (s); (n,), N: the contact resultant.
    """
    driven, motion, p = fixed.driven, fixed.motion, fixed.driven.period
    r = p.reduced
    forces = np.zeros((p.steps, len(r.initial_gap)))
    forces[:, : p.pairs] = motion.forces[:-1]
    loads, late = driven.loads[:-1], forces
    if delay:
        loads, late = (behind(part, delay, driven.duration) for part in (loads, forces))
        loads[:, r.edges] = driven.loads[:-1, r.edges]
    u = r.points(modal_motion(driven, motion)[0][:-1], loads, late)
    return u, forces[:, : r.gaps].sum(axis=1)


def change(own: list[np.ndarray], other: list[np.ndarray], driven: DrivenPeriod) -> np.ndarray:
    """(5,): the largest change of each harmonic, relative to what it comes to or the least that counts."""
    found, resting = np.zeros(LOWEST), RESTING if driven.oscillation == 0.0 else 0.0
    for one, two in zip(own, other):
        one, two = one.reshape(LOWEST, -1), two.reshape(LOWEST, -1)
        sizes = np.linalg.norm([one, two], axis=2)
        least = max(FAINT * sizes[:, 1:].max(), resting * sizes[:, 0].max(), np.finfo(float).tiny)
        found = np.maximum(found, np.linalg.norm(one - two, axis=1) / np.maximum(sizes[1], least))
    return found


def added(fixed: FixedPoint, period: Period) -> np.ndarray:
    """What contact adds to the linear response in a motion's state, in the modes of another map: further ones
    stand where its forces hold them, for at rest they would ring, and lead Newton's method astray.
    """
    old, new, force = fixed.driven.period.reduced, period.reduced, fixed.motion.forces[0]
    result = in_modes(fixed.state - fixed.driven.linear_state, old, new)
    further = slice(alike(old, new), len(new.omega))
    pushed = new.gap.modes[: len(force), further].T @ force
    result[further] += period.weights[further] * pushed / new.omega[further] ** 2
    return result


def in_modes(states: np.ndarray, old: ReducedModel, new: ReducedModel) -> np.ndarray:
    """(..., 2 m + k) differences of states in the modes of another model of the same structure: those are the
    same but for their signs, further ones and vectors rest, and slips have units of their own.
    """
    (signs, places), m, n = _shared(old, new), len(old.omega), len(new.omega)
    count, slips = alike(old, new), states[..., 2 * m :]
    result = np.zeros((*states.shape[:-1], 2 * n + slips.shape[-1]))
    result[..., places] = signs * states[..., np.r_[:count, m : m + count]]
    result[..., 2 * n :] = slips * (old.slip_units / new.slip_units)[: slips.shape[-1]]
    return result


def begun(guess: Orbit | None, driven: DrivenPeriod) -> np.ndarray:
    """A state to begin with: that of a reduced model's motion in the modes of a period, of which further ones
    move as without contact, or without a motion that of the linear response.
    """
    if guess is None or guess.reduced is None:
        return driven.linear_state
    old, new = guess.reduced, driven.period.reduced
    if share_modes(old, new):
        return driven.period.begun(guess.state)
    result, (_, places) = driven.linear_state.copy(), _shared(old, new)
    result[places] = in_modes(guess.state, old, new)[places]
    return result


def _shared(old: ReducedModel, new: ReducedModel) -> tuple[np.ndarray, np.ndarray]:
    """Signs of the coordinates and velocities of the modes that two models share, and their places in a state
    of the new one.
    """
    n, count = len(new.omega), alike(old, new)
    rows = [(r.gap.modes, r.points.modes.reshape(-1, len(r.omega)), r.load_modes.T) for r in (old, new)]
    common = [pair for pair in zip(*rows) if len(pair[0]) == len(pair[1])]
    seen = [np.concatenate([part[:, :count] for part in parts]) for parts in zip(*common)]
    signs = np.where((seen[0] * seen[1]).sum(axis=0) < 0.0, -1.0, 1.0)
    return np.tile(signs, 2), np.r_[:count, n : n + count]


def alike(old: ReducedModel, new: ReducedModel) -> int:
    """Modes that two models share: vectors behind them are others, unless all are the same."""
    return len(old.omega) if share_modes(old, new) else min(old.natural, new.natural)
