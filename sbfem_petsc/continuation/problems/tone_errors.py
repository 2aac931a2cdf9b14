"""What is told of the error of two tones' lines by left-out modes and by the steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...errors import PetscFailure, SolveError
from ...petsc import MPI
from ...reduction.left_out import LeftOut
from ..orbit import FAINT, LOWEST, PARTS, SECOND
from ..problem import Point
from .tones import LINES, tone_lines
from .torus import Torus


def line_error_estimates(torus: Torus, point: Point, finer: Callable[[], Torus]) -> np.ndarray:
    """(2, 5): errors by left-out modes and by the steps of the lines m f1 + n f2 of all named points, the
    largest of each order |m| + |n| = 0 to 4, relative to the line or to 1e-3 of the largest that oscillates;
    as `harmonic_error_estimates` has those of one tone. Collective.

    Parameters
    ----------
    torus : Torus
    point : Point
        Its invariant curve.
    finer : callable
        The same map in twice the steps.
    """
    r = torus.reduced
    if r.massless is None or not len(r.points.names):
        return np.full((2, LOWEST), np.nan)
    gaps, beyond = _left_out(torus, point)
    own, states = _lines(torus, point), point.state.states
    errors = np.full((2, LOWEST), np.inf)
    if not point.state.peak:
        return np.stack([_by_order(beyond, own), np.zeros(LOWEST)])
    for part in PARTS:  # of hard blows the whole may be too far
        inert = _nearby(torus.with_gaps(part * gaps), states)
        if inert is not None:
            errors[0] = _by_order((inert - own) / part + beyond, own)
            break
    double = finer()
    other = _nearby(double, states - torus.linear + double.linear)
    if other is not None:
        errors[1] = SECOND * _by_order(other - own, own)
    return errors


def _left_out(torus: Torus, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """What the inertia of left-out modes adds to the free gaps, see `Torus.with_gaps`, and to the lines of
    the named points. Collective.
    """
    p, r, samples, orders = torus.period, torus.reduced, torus.samples, torus.orders
    mine = [(i, motion) for i, motion in enumerate(point.state.motions) if motion is not None]
    over = np.exp(-2j * np.pi * orders[:, None] * [i for i, _ in mine] / samples) / samples
    slow = np.zeros((len(orders), p.steps, p.pairs), dtype=complex)
    if mine:
        slow += np.tensordot(over, np.array([motion.forces[:-1] for _, motion in mine]), 1)
    torus.comm.Allreduce(MPI.IN_PLACE, slow)
    turns = torus.rotation * orders[:, None, None] * np.arange(p.steps + 1)[:, None] / p.steps
    turned = np.exp(2j * np.pi * turns)
    forces = np.fft.fft(slow / turned[:, :-1], axis=1) / p.steps
    fast = np.fft.fftfreq(p.steps, 1.0 / p.steps)
    tones = fast * torus.frequencies[0] + orders[:, None] * torus.frequencies[1]
    loads = np.zeros((len(orders), p.steps, r.load_modes.shape[1]), dtype=complex)
    middle = samples // 2
    for tone, drive in enumerate(torus.drives):
        for order, values in zip(drive.orders, drive.amplitudes):
            if order > (middle if tone else p.steps // 2):
                continue
            for sign, share in ((1, values), (-1, values.conj())):
                # the highest multiple of an even number of samples is at both ends of their range
                slow_order = (middle + sign * order) % samples
                loads[(middle, sign * order) if tone == 0 else (slow_order, 0)] += 0.5 * share
    left = LeftOut(r, p.pairs, 2.0 * np.pi * tones.ravel())
    flat = forces.reshape(-1, p.pairs), loads.reshape(-1, loads.shape[-1])
    gaps = np.fft.ifft(left.gaps(*flat).reshape(forces.shape), axis=1) * p.steps
    moved = left.displacements(*flat).reshape(*tones.shape, *r.points.modes.shape[:2])
    lines = 2.0 * np.moveaxis(moved[:, : min(LINES, p.steps // 2 - 1) + 1], 0, 1)
    lines[0, middle] *= 0.5
    if samples % 2 == 0:  # both ends of the range are the same harmonic of the samples
        lines = np.concatenate([0.5 * lines[:, :1], lines[:, 1:], 0.5 * lines[:, :1]], axis=1)
    return np.concatenate([gaps, gaps[:, :1]], axis=1) * turned, lines


def _nearby(torus: Torus, states: np.ndarray) -> np.ndarray | None:
    """Lines of an invariant curve beside another one; None if there is none. Collective."""
    try:
        return _lines(torus, torus.solve(states))
    except PetscFailure:
        raise
    except SolveError:
        return None


def _lines(torus: Torus, point: Point) -> np.ndarray:
    """See `tone_lines`. Collective."""
    linear = tuple(zip(torus.drives, (torus.base.amplitudes, torus.pumped)))
    return tone_lines(torus.period, point.state.motions, torus.rotation, linear, torus.comm)


def _by_order(off: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(5,): of lines (m, n, points, xy), the largest error of each order."""
    count = min(len(off), len(own))
    off, own = (np.linalg.norm(part[:count], axis=(2, 3)) for part in (off, own))
    middle = own.shape[1] // 2
    off[0, :middle] = 0.0  # conjugate to those of positive n, but for the linear response, which these have
    order = np.arange(count)[:, None] + np.abs(np.arange(own.shape[1]) - middle)
    least = max(FAINT * own[order > 0].max(initial=0.0), np.finfo(float).tiny)
    errors = off / np.maximum(own, least)
    return np.array([errors[order == k].max(initial=0.0) for k in range(LOWEST)])
