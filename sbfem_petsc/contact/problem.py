"""A contact problem as kernels take it, and what they keep of it from a step to the next."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .friction import Rubbing
from .law import Table

# Exchanges of states before other methods.
MAXIMUM = 40


class Sets(NamedTuple):
    """The inverse of the set of the step before, and room to work in, of n rows. Without friction it is L^-1
    of W = L L^T over the rows in contact, see `pivoting.contact_forces`.

    Attributes
    ----------
    sharp : bool
        Whether forces are solved for again until that brings no more: of small pivots they are wrong by more
        than gaps, by 1e-3 around a node. Reduced steps, whose solves take twice as long with it, do without.
    inverse : (n, n) array
        Forces of the members (rows) under their gaps (columns).
    known : (n,) int8 array
        States that it belongs to.
    members : (n + 1,) int array
        Unknowns in the order of the inverse, behind them rows that slip; the last entry is the number of
        unknowns, -1 where nothing is known.
    place : (n,) int array
        Of each row among the members, -1 of others.
    right : (n + 1,) array
        Of the members; the last entry is the rounding of forces.
    solved : (n,) array
        Forces of the members.
    free : (n,) array
        Gaps.
    following : (n,) int8 array
    rates : (2, n) array
        Forces and gaps of all rows a unit of the way of Lemke's method.
    kept : (n,) array
        Gaps before, of tangential rows the slips that they keep.
    landed : (n, 3) array
        Of tangential rows that land: the share of the way to the next slip after which they do, less what the
        gap before adds to the kept slip, and what the next gap adds; zero of others. Told only if any do.
    waits : (n,) int8 array
        Whether a normal row that stood apart waits until the others have settled without it.
    told : (n + 1,) int8 array
        States then, from which it is told where rows land; the last entry tells whether any do.
    seen : (m,) int array
        Sums that tell sets apart; of more than these none are exchanged.
    every : (n,) int array
        0, 1, ..
    """

    sharp: bool
    inverse: np.ndarray
    known: np.ndarray
    members: np.ndarray
    place: np.ndarray
    right: np.ndarray
    solved: np.ndarray
    free: np.ndarray
    following: np.ndarray
    rates: np.ndarray
    kept: np.ndarray
    landed: np.ndarray
    waits: np.ndarray
    told: np.ndarray
    seen: np.ndarray
    every: np.ndarray


def rubbing_room(rows: int) -> tuple[np.ndarray, ...]:
    """Room of `Sets` that sets of any step share: from `right` on."""
    following, waits, told = (np.zeros(n, dtype=np.int8) for n in (rows, rows, rows + 1))
    right, solved, free, kept = (np.empty(n) for n in (rows + 1, *[rows] * 3))
    rates, landed = np.empty((2, rows)), np.empty((rows, 3))
    seen = np.zeros(MAXIMUM, dtype=np.int64)
    return right, solved, free, following, rates, kept, landed, waits, told, seen, np.arange(rows)


def empty_sets(rows: int) -> Sets:
    """Nothing is known yet."""
    known, place = np.zeros(rows, dtype=np.int8), np.zeros(rows, dtype=np.int64)
    return Sets(True, np.empty((rows, rows)), known, np.full(rows + 1, -1), place, *rubbing_room(rows))


class Problem(NamedTuple):
    """A contact problem, whose gaps and slips are W force + free, of n rows.

    Attributes
    ----------
    flexibility : (n, n) array
        W.
    free, before : (n,) arrays
        Gaps and slips without forces, and those of the step before.
    laws : Table
    rubbing : Rubbing
    state : (n,) int8 array
        States of the step before, which are written anew.
    sets : Sets
    force : (n,) array
        Written.
    """

    flexibility: np.ndarray
    free: np.ndarray
    before: np.ndarray
    laws: Table
    rubbing: Rubbing
    state: np.ndarray
    sets: Sets
    force: np.ndarray
