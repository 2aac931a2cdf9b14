"""What is told of the error of two tones' lines by left-out modes and by the steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...errors import PetscFailure, SolveError
from ...reduction.build import wider
from ...reduction.reduced_model import ReducedModel
from ..harmonic_errors import FAINT, SECOND, beyond, in_modes
from ..orbit import LOWEST
from ..problem import Point
from .tones import tone_lines
from .torus import Torus


def line_error_estimates(
    torus: Torus, point: Point, make: Callable[[ReducedModel, int], Torus]
) -> np.ndarray:
    """(2, 5): errors by left-out modes and by the steps of the lines m f1 + n f2 of all named points, the
    largest of each order |m| + |n| = 0 to 4, relative to the line or to 1e-3 of the largest that oscillates;
    as `harmonic_error_estimates` has those of one tone. Collective.

    Parameters
    ----------
    torus : Torus
    point : Point
        Its invariant curve.
    make : callable
        The same map of a model in so many steps.
    """
    r, steps = torus.reduced, torus.period.steps
    more = wider(r)
    if more is None or not len(r.points.names):
        return np.full((2, LOWEST), np.nan)
    errors, added = np.full((2, LOWEST), np.inf), point.state.states - torus.linear
    own = _lines(torus, point)
    if not point.state.peak:  # known in closed form
        errors[1] = 0.0
    elif found := _nearby(lambda: make(r, 2 * steps), added):
        errors[1] = SECOND * _by_order(found[0] - own, own)
        steps, (own, added) = 2 * steps, found
    factor = beyond(r, more)
    if np.isfinite(factor) and (found := _nearby(lambda: make(more, steps), in_modes(added, r, more))):
        errors[0] = factor * _by_order(found[0] - own, own)
    return errors


def _nearby(make: Callable[[], Torus], added: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Lines of an invariant curve near a difference to the linear response, and its own; None if there is
    none, or no room for it. Collective.
    """
    try:
        torus = make()
    except ValueError:  # for which there is no memory
        return None
    try:
        point = torus.solve(added + torus.linear)
    except PetscFailure:
        raise
    except SolveError:
        return None
    return _lines(torus, point), point.state.states - torus.linear


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
