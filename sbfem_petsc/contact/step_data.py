"""What steps of a reduced model are given, and what they lead to, as kernels take them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .friction import Rubbing
from .law import Table


class Halving(NamedTuple):
    """Which steps are taken as two halves, and these as halves again, as far as there are constants: those in
    which the faces' contact, which does no work in the exact motion but for what friction takes, does more of
    it than so much.

    Attributes
    ----------
    tolerance : float
        Of the energy of the modes at the step's end; infinite: no step.
    floor : float
        Energy that is added to it, J.
    """

    tolerance: float
    floor: float


NEVER = Halving(math.inf, 0.0)


class StepConstants(NamedTuple):
    """What the steps of a reduced model have in common; see `step_constants`.

    Attributes
    ----------
    coefficients : (levels, 10, m) array
        aqq, aqv, bq, dq, cq, avq, avv, bv, dv, cv of each mode, of a step h, of h / 2, h / 4, ..
    left, right : (r, pairs), (r, m) arrays
        Rows of the factors of C = U V^T, gaps of the modes: U^T and V^T.
    flexibility : (levels, pairs, pairs) array
        W of each of these steps.
    residual : (pairs, pairs) array
        R, which alone gives the forces of a state from which no step leads back.
    laws : Table
        Of the normal rows.
    rubbing : Rubbing
    stiffness : (m,) array
        omega^2, of the energy that the work of contact is compared with.
    halving : Halving
    """

    coefficients: np.ndarray
    left: np.ndarray
    right: np.ndarray
    flexibility: np.ndarray
    residual: np.ndarray
    laws: Table
    rubbing: Rubbing
    stiffness: np.ndarray
    halving: Halving


class StepLoads(NamedTuple):
    """What drives several steps, at their n + 1 ends.

    Attributes
    ----------
    external : (n + 1, m) array
        Modal forces of the loads; (0, m) where there are none.
    free_gap : (n + 1, pairs) array
        Initial gaps and the residual flexibility's share of the loads.
    levels : (n,) int8 array
        Of the steps, whose lengths are h / 2^level. Loads and gaps are linear in each.
    """

    external: np.ndarray
    free_gap: np.ndarray
    levels: np.ndarray


class StepState(NamedTuple):
    """A state between two steps, advanced in place.

    Attributes
    ----------
    q, v : (m,) arrays
        Modal coordinates and rates.
    force : (pairs,) array
        Of contact, N.
    rows : (pairs,) int8 array
        States of the contact rows, see `law` and `friction`.
    slip : (k,) array
        Of the tangential rows, m: what faces that rub remember.
    """

    q: np.ndarray
    v: np.ndarray
    force: np.ndarray
    rows: np.ndarray
    slip: np.ndarray = np.empty(0)


class StepHistory(NamedTuple):
    """Filled with what the steps lead to.

    Attributes
    ----------
    states, velocities, forces : (n, m), (n, m), (n, pairs) arrays
        q, v and the contact forces after each step. With a row more, the first one is of the beginning, an
        instant from which no step leads back and where contact is solved first, from the state's slips and
        rows before.
    work : (n,) array
        Of the contact forces in each, J: mean force times change of the gap, of its parts one by one, but for
        what is lost to friction.
    parts : (n 2^(levels - 1) + 1,) or (0,) int8 array
        Levels of the steps as they were taken, whose number is told; not kept in an empty one.
    lost : (n,) or (0,) array
        To friction in each, J; not kept in an empty one.
    rows : (n, pairs) or (0, 0) int8 array
        States of the rows, as forces; not kept in an empty one.
    kept : (k,) or (0,) array
        Slips that the tangential rows keep in the last step, m; not told in an empty one.
    landings : (n, k, 3) or (0, 0, 3) array
        Zeros, but for where tangential rows land in each step, see `problem.Sets`; not kept in an empty
        one.
    told : (n, pairs) or (0, 0) int8 array
        States from which it is told where they land in each step; not kept where landings are not.
    """

    states: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray
    work: np.ndarray
    parts: np.ndarray = np.empty(0, dtype=np.int8)
    lost: np.ndarray = np.empty(0)
    rows: np.ndarray = np.empty((0, 0), dtype=np.int8)
    kept: np.ndarray = np.empty(0)
    landings: np.ndarray = np.empty((0, 0, 3))
    told: np.ndarray = np.empty((0, 0), dtype=np.int8)


class Marched(NamedTuple):
    """What has been done.

    Attributes
    ----------
    steps : int
        Fewer than n: a contact problem was not solved.
    exchanges : int
        Of active sets, in all.
    unresolved : int
        Steps of the last level in which contact does more work than `Halving` allows.
    taken : int
        Steps and parts of steps.
    """

    steps: int
    exchanges: int
    unresolved: int
    taken: int
