"""The contact kernel over sequences of problems, each from what the one before has left. The oracle is the
complementarity conditions themselves: with a positive definite flexibility one solution alone satisfies them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from sbfem_petsc.contact.complementarity import solve_complementarity
from sbfem_petsc.contact.law import RowLaws
from sbfem_petsc.contact.marching import PATIENCE, contact_forces, empty_factor

STEPS = 70


def flexibilities(kind: str, n: int, generator: np.random.Generator) -> np.ndarray:
    """Positive definite (n, n) arrays."""
    factor = generator.standard_normal((n, n + 2))
    if kind == "coupled":  # rows pull others open: full exchanges go to and fro
        factor = generator.standard_normal((n, max(1, n // 3)))
        return factor @ factor.T + 1e-2 * np.eye(n)
    if kind == "nearly singular":
        factor = generator.standard_normal((n, max(1, n - 1)))
        return factor @ factor.T + 1e-6 * np.eye(n)
    if kind == "neighbours":  # of a line of pairs
        place = np.sort(generator.random(n))
        return np.exp(-np.abs(place[:, None] - place)) + 1e-6 * np.eye(n)
    if kind == "other units":
        unit = 10.0 ** generator.uniform(-6, 6, n)
        return unit[:, None] * (factor @ factor.T) * unit
    return factor @ factor.T


def gaps(n: int, unit: np.ndarray, generator: np.random.Generator) -> Iterator[np.ndarray]:
    """A sequence of (n,) arrays that goes in small and in large steps, over zeros, and over all rows."""
    gap = generator.standard_normal(n)
    for _ in range(STEPS):
        choice = generator.random()
        if choice < 0.5:
            gap = gap + 0.2 * generator.standard_normal(n)
        elif choice < 0.65:
            gap = generator.standard_normal(n)
        elif choice < 0.7:
            gap = -gap
        elif choice < 0.75:
            gap = np.abs(gap)
        elif choice < 0.8:
            gap = -np.abs(gap)
        else:
            gap = np.where(generator.random(n) < 0.7, 0.0, gap)
        yield unit * gap


def missed(w: np.ndarray, gap: np.ndarray, force: np.ndarray, active: np.ndarray, tied: np.ndarray) -> float:
    """By how much forces and an active set miss the conditions: each row in its own unit, relative to what is
    summed in it; inf where a force has a wrong sign or an open row a force.
    """
    if not np.isfinite(force).all() or (force[~tied] < 0.0).any() or force[~active].any():
        return np.inf
    if not active[tied].all():
        return np.inf
    residual = w @ force + gap
    scale = np.abs(w) @ np.abs(force) + np.abs(gap)
    off = np.where(active, np.abs(residual), np.maximum(-residual, 0.0))
    return float(np.max(off / np.where(scale > 0.0, scale, 1.0), initial=0.0))


KINDS = ("plain", "coupled", "nearly singular", "neighbours", "other units")


def sequences(kind: str) -> Iterator[tuple[np.ndarray, np.ndarray, Iterator[np.ndarray]]]:
    """Flexibility, tied rows, gaps: 16 of small and of large problems, half of them with tied rows."""
    for seed in range(16):
        generator = np.random.default_rng([seed, KINDS.index(kind)])
        n = int(generator.integers(1, 40 if seed % 2 else 12))
        w = flexibilities(kind, n, generator)
        yield w, generator.random(n) < (0.3 if seed % 4 > 1 else 0.0), gaps(n, np.sqrt(np.diag(w)), generator)


@pytest.mark.parametrize("kind", KINDS)
def test_kernel(kind):
    """5,600 problems, each from the active set and the factor of the one before, or from any active set and
    nothing factorised; all of them solved, to the rounding of the sums (1e-15 is met).
    """
    generator = np.random.default_rng(1)
    most = 0
    for w, tied, sequence in sequences(kind):
        n = len(w)
        active, factor, force = tied.copy(), empty_factor(n), np.zeros(n)
        for gap in sequence:
            if generator.random() < 0.1:
                active[:], factor.members[n] = tied | (generator.random(n) < 0.5), -1
            exchanges = contact_forces(w, gap, tied, active, factor, force)
            assert exchanges >= 0 and missed(w, gap, force, active, tied) < 1e-14
            assert set(factor.members[: factor.members[n]]) == set(np.flatnonzero(active))
            most = max(most, exchanges)
    assert kind != "coupled" or most > PATIENCE + 3  # single exchanges have taken over


@pytest.mark.parametrize("kind", KINDS)
def test_exchange_of_the_condensed_problem(kind):
    """The same conditions, from the active set of the problem before and from none, by full exchanges and by
    single ones alone.
    """
    for w, tied, sequence in sequences(kind):
        laws, active = RowLaws(tied), tied.copy()
        for k, gap in enumerate(sequence):
            start, maximum = (active if k % 3 else None), (1 if k % 5 == 0 else 200)
            found = solve_complementarity(w, gap, laws, start=start, maximum=maximum)
            active = found.active
            assert missed(w, gap, found.force, active, tied) < 1e-14
            rounding = 1e-15 * (np.abs(w) @ np.abs(found.force) + np.abs(gap)).max()  # of products
            expected = np.where(active, 0.0, w @ found.force + gap)
            np.testing.assert_allclose(found.gap, expected, rtol=0.0, atol=rounding)
