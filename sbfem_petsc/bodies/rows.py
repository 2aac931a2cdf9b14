"""Rows of displacements and contact of a body given by its matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from ..checks import real, shown
from ..contact.law import ContactLaw

AXES = "xyz"
# In the place of an unknown of a node: what is held, and what there is not.
HELD, NONE = -1, -2


def told(vector: np.ndarray) -> str:
    """A unit vector as the direction of a row."""
    axis = next((name for name, unit in zip(AXES, np.eye(3)) if (vector == unit).all()), "")
    return axis or f"({', '.join(f'{part + 0.0:.6g}' for part in vector)})"


def _opposite(direction: str) -> str:
    axes = dict(zip(AXES, np.eye(3)))
    return direction and told(-np.array(axes.get(direction, direction.strip("()").split(",")), dtype=float))


@dataclass(frozen=True, eq=False)
class Row:
    """A weighted sum of unknowns: load, sensor, or both. Rows of one body add and subtract, and take factors.

    Attributes
    ----------
    weights : (1, n) sparse matrix
    direction : str
        "z", or the components of a unit vector; "" of a sum along several.
    body : int or None
        Tells the body whose row it is, by its nodes and unknowns; None of one made by hand.
    """

    weights: sparse.csr_matrix
    direction: str = ""
    body: int | None = None

    def __add__(self, other: Row, factor: float = 1.0) -> Row:
        weights = sparse.csr_matrix(self.weights + factor * _same("row", self, other).weights)
        along = self.direction if self.direction == other.direction else ""
        return Row(weights, along, other.body if self.body is None else self.body)

    def __sub__(self, other: Row) -> Row:
        return self.__add__(other, -1.0)

    def __mul__(self, factor: float) -> Row:
        factor = real("row", "factor", factor)
        turned = _opposite(self.direction) if factor < 0.0 else self.direction
        return Row(sparse.csr_matrix(factor * self.weights), turned, self.body)

    __rmul__ = __mul__

    @property
    def size(self) -> int:
        """Unknowns of its body."""
        return self.weights.shape[1]

    def __repr__(self) -> str:
        along = f" along {self.direction}" if self.direction else ""
        return f"Row({self.weights.nnz} of {self.size} unknowns{along})"


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact rows, whose gaps are `rows` u + `gap`; those of one body add.

    Attributes
    ----------
    rows : (pairs, n) sparse matrix
    gap : (pairs,) array
        m.
    laws : tuple of ContactLaw
        Of the pairs.
    slips : (pairs, n) sparse matrix
        Slips are `slips` u; rows of zeros where nothing rubs.
    body : int or None
        As of a `Row`.
    """

    rows: sparse.csr_matrix
    gap: np.ndarray
    laws: tuple[ContactLaw, ...]
    slips: sparse.csr_matrix
    body: int | None = None

    def __add__(self, other: Contact) -> Contact:
        both = (self.rows, _same("contact", self, other).rows), (self.slips, other.slips)
        one, two = ([(*row.indices, *row.data) for row in rows.sorted_indices()] for rows in both[0])
        if again := {*one} & {*two}:
            first = min(map(two.index, again))
            raise ValueError(f"contact: pair {first} that is added is there already; leave its node out")
        rows, slips = (sparse.vstack(parts).tocsr() for parts in both)
        body = other.body if self.body is None else self.body
        return Contact(rows, np.append(self.gap, other.gap), self.laws + other.laws, slips, body)

    @property
    def size(self) -> int:
        """Unknowns of its body."""
        return self.rows.shape[1]

    def __repr__(self) -> str:
        return f"Contact({len(self.gap)} pairs of {self.size} unknowns)"


def _same(what: str, one: Any, other: Any) -> Any:
    """The other, of the same kind and body."""
    if type(other) is not type(one) or not of_body(other, one.size, one.body):
        raise TypeError(f"{what}: {shown(other)} does not add to {one}; give a {what} of the same body")
    return other


def of_body(given: Row | Contact, size: int, body: int | None) -> bool:
    """Whether it may be of a body of so many unknowns."""
    return given.size == size and (None in (given.body, body) or given.body == body)
