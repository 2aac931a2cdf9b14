"""The contact kernel over sequences of problems, each from what the one before has left. The oracle is the
complementarity conditions themselves: with a positive definite flexibility one solution alone satisfies them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.contact.complementarity import solve_complementarity
from sbfem_petsc.contact.friction import rubbing_of
from sbfem_petsc.contact.law import FREE, PRESSED, PULLED, RowLaws
from sbfem_petsc.contact.pivoting import PATIENCE, contact_forces
from sbfem_petsc.contact.problem import Problem, empty_sets

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


def missed(w: np.ndarray, gap: np.ndarray, force: np.ndarray, state: np.ndarray, laws: RowLaws) -> float:
    """By how much forces and states miss the conditions: each row in its own unit, relative to what is summed
    in it; inf where a force has a wrong sign, a free row a force, or a row is in a state that it has not.
    """
    rows, (place, least, most) = np.arange(len(gap)), (values.T for values in laws.table)
    place, least, most = place[rows, state], least[rows, state], most[rows, state]
    held = state != FREE
    if not np.isfinite(force).all() or force[~held].any() or (least > most).any():
        return np.inf
    if (held & ((force < least) | (force > most))).any():
        return np.inf
    total = w @ force + gap
    scale = np.abs(w) @ np.abs(force) + np.abs(gap) + np.where(np.isfinite(place), np.abs(place), 0.0)
    off = np.where(held, np.abs(total - place), np.maximum(np.maximum(least - total, total - most), 0.0))
    return float(np.max(off / np.where(scale > 0.0, scale, 1.0), initial=0.0))


KINDS = ("plain", "coupled", "nearly singular", "neighbours", "other units")


def sequences(kind: str) -> Iterator[tuple[np.ndarray, RowLaws, Iterator[np.ndarray]]]:
    """Flexibility, laws, gaps: 16 of small and of large problems, half of them with rows that are tied or, at
    a distance or at none, held from either side.
    """
    for seed in range(16):
        generator = np.random.default_rng([seed, KINDS.index(kind)])
        n = int(generator.integers(1, 40 if seed % 2 else 12))
        w = flexibilities(kind, n, generator)
        unit, chosen = np.sqrt(np.diag(w)), generator.random(n) < (0.3 if seed % 4 > 1 else 0.0)
        which = generator.random(n)
        laws = [
            sb.Tied()
            if tied
            else sb.Clearance(width=size * max(share - 0.6, 0.0))
            if seed % 4 > 1 and share > 0.5
            else sb.Unilateral()
            for tied, share, size in zip(chosen, which, unit)
        ]
        yield w, RowLaws.of(laws), gaps(n, unit, generator)


@pytest.mark.parametrize("kind", KINDS)
def test_kernel(kind):
    """5,600 problems, each from the states and the factor of the one before, or from any states and nothing
    factorised; all of them solved, to the rounding of the sums (1e-15 is met).
    """
    generator = np.random.default_rng(1)
    most, seen = 0, set()
    for w, laws, sequence in sequences(kind):
        n = len(w)
        state, factor, force = np.zeros(n, dtype=np.int8), empty_sets(n), np.zeros(n)
        smooth = rubbing_of(None, w, n)
        for gap in sequence:
            if generator.random() < 0.1:
                state[:], factor.members[n] = generator.integers(0, 3, n), -1
            exchanges = contact_forces(Problem(w, gap, gap, laws.table, smooth, state, factor, force))
            assert exchanges >= 0 and missed(w, gap, force, state, laws) < 1e-14
            assert set(factor.members[: factor.members[n]]) == set(np.flatnonzero(state))
            most, seen = max(most, exchanges), seen | set(state.tolist())
    assert kind != "coupled" or most > PATIENCE + 3  # single exchanges have taken over
    assert seen == {FREE, PRESSED, PULLED}


@pytest.mark.parametrize(
    "part", [slice(8), pytest.param(slice(8, None), marks=pytest.mark.long)], ids=["", "more"]
)
@pytest.mark.parametrize("kind", KINDS)
def test_exchange_of_the_condensed_problem(kind, part):
    """The same conditions, from the states of the problem before and from none, by full exchanges and by
    single ones alone.
    """
    for w, laws, sequence in [*sequences(kind)][part]:
        state = np.zeros(len(w), dtype=np.int8)
        for k, gap in enumerate(sequence):
            start, maximum = (state if k % 3 else None), (1 if k % 5 == 0 else 200)
            found = solve_complementarity(w, gap, laws, start=start, maximum=maximum)
            state = found.state
            assert missed(w, gap, found.force, state, laws) < 1e-14
            rounding = 1e-15 * (np.abs(w) @ np.abs(found.force) + np.abs(gap)).max()  # of products
            expected = laws.placed(state, w @ found.force + gap)
            np.testing.assert_allclose(found.gap, expected, rtol=0.0, atol=rounding)
