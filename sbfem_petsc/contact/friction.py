"""Coulomb friction of some contact rows: a tangential row beside each normal one that rubs.

The rows obey (gap, slip) = W (n, t) + free, n pressure and t friction. With the slip s_old of the state
before, a tangential row is in one of four states: apart, t = 0; sticking, s = s_old and |t| <= mu n; slipping
either way, t = +-mu n against the change of s. `friction_solve` finds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import wrong_input
from ..record.record import Record, described, quantity
from .complementarity import Complementarity
from .law import ContactLaw, RowLaws

# States of a tangential row: apart as FREE, sticking, slipping under friction along t and against it.
STICKS, ALONG, AGAINST = 1, 2, 3


@described
class Friction(Record):
    """The tangential rows, which stand behind the normal ones."""

    rows: np.ndarray = quantity(
        "1", "number of the normal row of each", "tangential_row", kinds="iu", least=0
    )
    kinetic: np.ndarray = quantity("1", "coefficients of rows that slip", "tangential_row", least=0.0)
    static: np.ndarray = quantity("1", "coefficients up to which rows stick", "tangential_row", least=0.0)

    @classmethod
    def of(cls, laws: Sequence[ContactLaw], rows: np.ndarray) -> Friction:
        """Of normal rows with these laws, those that rub and others."""
        found = [[getattr(laws[k], name, 0.0) for k in rows] for name in ("friction", "static_friction")]
        return cls(rows, *np.array(found, dtype=float).reshape(2, len(rows)))

    @property
    def falls(self) -> bool:
        """Whether it falls where a slip begins."""
        return bool((self.static > self.kinetic).any())

    def same(self, other: Friction | None) -> bool:
        """Whether these are the same rows and coefficients."""
        mine = (self.rows, self.kinetic, self.static)
        return other is not None and all(map(np.array_equal, mine, (other.rows, other.kinetic, other.static)))


class Rubbing(NamedTuple):
    """Tangential rows (k), behind the normal ones (c); `Friction` for kernels and derivatives.

    Attributes
    ----------
    rows : (k,) int array
        The normal row of each.
    beside : (c,) int array
        The tangential row of each among all rows, -1 where there is none.
    kinetic, static : (k,) arrays
        Coefficients; zero of rows that no force moves.
    """

    rows: np.ndarray
    beside: np.ndarray
    kinetic: np.ndarray
    static: np.ndarray


def rubbing_of(friction: Friction | None, flexibility: np.ndarray, count: int) -> Rubbing:
    """For kernels, of rows with a flexibility of which so many are normal ones; None: nothing rubs."""
    beside, moves = np.full(count, -1, dtype=np.int64), np.diag(flexibility) > 0.0
    if friction is None:
        return Rubbing(np.zeros(0, dtype=np.int64), beside, np.zeros(0), np.zeros(0))
    rubs = moves[count:] & moves[friction.rows]
    rows = np.ascontiguousarray(friction.rows, dtype=np.int64)
    beside[rows] = count + np.arange(len(rows))
    return Rubbing(rows, beside, np.where(rubs, friction.kinetic, 0.0), np.where(rubs, friction.static, 0.0))


def refuse_friction(owner: str, rubs: str, why: str) -> None:
    """Raise ValueError, on all ranks, for what rubs, in an analysis with a reason why it cannot."""
    raise wrong_input(
        f"{owner} {why}, and {rubs}; use transient, periodic, quasi_periodic, swept_response, "
        "frequency_response or load_response in modes, static or load_history, or contact_laws = "
        "Unilateral()"
    )


class Memory(NamedTuple):
    """What a state leaves to the next one.

    Attributes
    ----------
    slip, force : (k,) arrays
        Of the tangential rows, m and N.
    pressing : (c,) array
        Of the normal rows, N.
    normal, tangential : int8 arrays
        States.
    gap : (c,) array
        Of the normal rows, m: where those that are apart land; zero where the next state is one of the same
        instant, or the first one.
    kept : (k,) array
        Slips that the tangential rows have stuck to or slid from, m.
    """

    slip: np.ndarray
    force: np.ndarray
    pressing: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray
    gap: np.ndarray
    kept: np.ndarray

    @classmethod
    def none(cls, laws: RowLaws, friction: Friction) -> Memory:
        """Of faces that have never been loaded."""
        normal, along = np.zeros(len(laws)), np.zeros(len(friction.rows))
        return cls(along, along, normal, normal.astype(np.int8), along.astype(np.int8), normal, along)

    def lost_since(self, former: Memory, friction: Friction) -> float:
        """Work lost to friction on the way from a former state, J: each row slips one way, against a friction
        that goes linearly from what the former pressure allows, or from what held it if that is more, to what
        it is now. Exact where the pressure stays or changes with the slip, also where the slip turns.
        """
        allowed = friction.kinetic * np.maximum(former.pressing[friction.rows], 0.0)
        begun = np.maximum(allowed, np.abs(former.force))
        return float((0.5 * (begun + np.abs(self.force)) * np.abs(self.slip - self.kept)).sum())

    @classmethod
    def of(cls, found: Complementarity, count: int) -> Memory:
        """Of a solution with so many normal rows."""
        state = found.state
        normal, along, gap = found.force[:count], found.force[count:], found.gap
        return cls(gap[count:], along, normal, state[:count], state[count:], gap[:count], found.kept)
