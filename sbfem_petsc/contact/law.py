"""Contact laws: what the two faces of a contact row do to each other, as rows of data that solvers read.

A contact row has a gap and a force that presses its faces apart (N, compression positive). Solvers condense a
structure onto its rows, gap = W force + free gap. A law is a staircase in the plane of gap and force that
falls from left to right, of at most three steps, the states of a row: in the middle one it is free, at either
end its faces meet something that holds the gap (`State`). A row stays in a state as long as what this leaves
open, a free row's gap or a held row's force, is between two bounds; beyond, a held row is let go, and a free
one is held on the side that it has passed. An elastic layer is no state: it is part of W.

`RowLaws` has the bounds of many rows as arrays, `Table`. The exchanges of states, on the host
(`complementarity.active_set`) and compiled (`pivoting.contact_forces`), read nothing else; what others ask is
answered from the same arrays: `RowLaws.acting` (the rows that keep their gaps, for derivatives), `room` (how
far a free row is from being held, for grazing motions), `rest` (gaps of a model), `fixed` (rows of one state
alone).

Coulomb friction is a second, tangential row for each one that rubs (`friction`): its states depend on the
force of the normal row and on the slip before. Table and `RowLaws` are those of the normal rows alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from meshing.input_checks import check_said

from ..checks import Bounds, real, said, shown
from ..errors import failed_solve
from ..record.record import Record, derived, described

# Rounding of a gap, relative to the sum of its terms' moduli.
ROUND_OFF = 1e-14
# Ratio of two peaks' moduli that steps explain: of 100 a period they miss 5e-4 of a tone's peak.
ALIKE = 1.001
# States of a row; those that are not free hold its gap.
FREE, PRESSED, PULLED = range(3)


class State(NamedTuple):
    """A state of a row.

    Attributes
    ----------
    place : float
        Gap that is kept, m, if any is.
    least, most : float
        Bounds of the force, N, of a row whose gap is kept, or of the gap, m, of a free one.
    """

    place: float
    least: float
    most: float


# No row stays in it.
_NEVER = State(0.0, math.inf, -math.inf)
# Apart; pressed on each other.
_APART, _PRESSED = State(0.0, 0.0, math.inf), State(0.0, 0.0, math.inf)


@dataclass(frozen=True)
class ContactLaw:
    """Base of the laws; not a law itself.

    Attributes
    ----------
    compliance : float
        Of an elastic layer between the faces, m^3/N: they overlap by so much for each pascal of pressure, the
        layer's thickness over its modulus. Each contact row has the share of its own area of face.
    """

    compliance: float = field(
        default=0.0, metadata=said("of an elastic layer on the faces, across them", "m^3/N", ge=0)
    )

    def __post_init__(self) -> None:
        check_said(self)

    @property
    def states(self) -> tuple[State, State, State]:
        """Free, pressed, pulled."""
        raise NotImplementedError

    @property
    def rubs(self) -> bool:
        """Whether friction resists the faces' sliding."""
        return False

    @property
    def parts(self) -> bool:
        """Whether the faces ever come apart."""
        return self.states[FREE].least <= self.states[FREE].most


@dataclass(frozen=True)
class Unilateral(ContactLaw):
    """Frictionless contact: faces press on each other and come apart freely, 0 <= force _|_ gap >= 0.

    Attributes
    ----------
    compliance : float
        m^3/N; an elastic layer on the faces if it is not zero.
    """

    @property
    def states(self) -> tuple[State, State, State]:
        """Free at gaps from zero on."""
        return _APART, _PRESSED, _NEVER


@dataclass(frozen=True)
class Tied(ContactLaw):
    """Faces that do not come apart: the gap keeps its initial value under forces of either sign.

    They slide along each other as all faces do: a crack under shear is no intact body. The gap of a tied row
    is counted from its initial value. `modal` knows no contact and leaves these cracks open, too.

    Attributes
    ----------
    compliance : float
        m^3/N; an elastic joint if it is not zero.
    """

    @property
    def states(self) -> tuple[State, State, State]:
        """One alone."""
        return _NEVER, State(0.0, -math.inf, math.inf), _NEVER


@dataclass(frozen=True)
class Clearance(ContactLaw):
    """Faces between two stops: free while their gap is between zero and a width, pressed on each other below,
    held back above, where the force is tension.

    The gap is the distance of the faces, that of the undeformed ones included: faces that stand further apart
    than the width are pulled together at rest.

    Attributes
    ----------
    compliance : float
        m^3/N; an elastic layer, the same at either side, if it is not zero.
    width : float
        m.
    """

    width: float = field(kw_only=True, metadata=said("play", "m", ge=0))

    @property
    def states(self) -> tuple[State, State, State]:
        """Free from zero to the width."""
        return State(0.0, 0.0, self.width), _PRESSED, State(self.width, -math.inf, 0.0)


@dataclass(frozen=True, init=False)
class Coulomb(Unilateral):
    """Faces that come apart freely and rub where they press on each other: |t| <= friction n, the friction t
    against the slip; with friction 0, `Unilateral`.

    Attributes
    ----------
    friction : float
        Coefficient of faces that slip.
    static_friction : float
        Coefficient up to which they stick, at least `friction`. Default: the same.
    compliance : float
        m^3/N; an elastic layer on the faces if it is not zero.
    tangential_compliance : float
        m^3/N; the same along the faces: they slide by so much for each pascal before they slip.
    """

    friction: float = field(default=0.0, metadata=said("coefficient of faces that slip", ge=0))
    static_friction: float = field(
        default=0.0, metadata=said("coefficient up to which they stick; default: the same", ge=0)
    )
    tangential_compliance: float = field(
        default=0.0, metadata=said("of an elastic layer on the faces, along them", "m^3/N", ge=0)
    )

    def __init__(
        self,
        friction: float,
        static_friction: float | None = None,
        compliance: float = 0.0,
        tangential_compliance: float = 0.0,
    ):
        mu = real("Coulomb", "friction", friction, within=Bounds(least=0.0))
        static = mu if static_friction is None else real("Coulomb", "static_friction", static_friction)
        if static < mu:
            raise ValueError(f"Coulomb: static_friction = {static:g} must be at least friction = {mu:g}")
        along = real(
            "Coulomb", "tangential_compliance", tangential_compliance, "m^3/N", within=Bounds(least=0.0)
        )
        for name, value in (
            ("compliance", compliance),
            ("friction", mu),
            ("static_friction", static),
            ("tangential_compliance", along),
        ):
            object.__setattr__(self, name, value)
        self.__post_init__()

    @property
    def rubs(self) -> bool:
        """Unless both coefficients are zero."""
        return self.static_friction > 0.0


class Table(NamedTuple):
    """Places and bounds of the states of some contact rows, as `State` has them, for compiled kernels.

    Attributes
    ----------
    place, least, most : (3, c) arrays
        Of the states FREE, PRESSED, PULLED.
    """

    place: np.ndarray
    least: np.ndarray
    most: np.ndarray


@described
class RowLaws(Record):
    """The laws of some contact rows as arrays, `table`. States of the rows are (c,) int8 arrays."""

    table: Table

    @derived("m", "gaps that free, pressed and pulled rows keep", "law normal_row", back=True, finite=False)
    def place(self) -> np.ndarray:
        return self.table.place

    @derived(
        "SI", "least force, or gap of a free row, in each state", "law normal_row", back=True, finite=False
    )
    def least(self) -> np.ndarray:
        return self.table.least

    @derived(
        "SI", "largest force, or gap of a free row, in each state", "law normal_row", back=True, finite=False
    )
    def most(self) -> np.ndarray:
        return self.table.most

    @classmethod
    def _revived(cls, found: dict[str, Any]) -> RowLaws:
        """From a file: bounds may be infinite."""
        table = Table(*(found[name] for name in Table._fields))
        if len(table.place) != 3 or any(np.isnan(values).any() for values in table):
            raise ValueError("the contact laws have values that are no numbers")
        return cls(table)

    @classmethod
    def of(cls, laws: Iterable[ContactLaw]) -> RowLaws:
        """From the law of each row."""
        laws = tuple(laws)
        values = np.array([law.states for law in laws], dtype=float).reshape(len(laws), 3, 3)
        return cls(Table(*(np.ascontiguousarray(values[:, :, k].T) for k in range(3))))

    @classmethod
    def unilateral(cls, count: int) -> RowLaws:
        """Frictionless unilateral contact of so many rows."""
        return cls.of([Unilateral()] * count)

    def __len__(self) -> int:
        return self.table.place.shape[1]

    def only(self, rows: np.ndarray | slice) -> RowLaws:
        """Those of some rows."""
        return RowLaws(Table(*(np.ascontiguousarray(values[:, rows]) for values in self.table)))

    def same(self, other: RowLaws) -> bool:
        """Whether these are the same laws."""
        return all(map(np.array_equal, self.table, other.table))

    @property
    def fixed(self) -> np.ndarray:
        """(c,): rows of one state alone, which are never free."""
        return self.table.least[FREE] > self.table.most[FREE]

    @property
    def homogeneous(self) -> bool:
        """Whether no length is told in the table, so that forces go with the gaps."""
        return not any(values[np.isfinite(values)].any() for values in self.table)

    def rest(self, gap: np.ndarray) -> np.ndarray:
        """Gaps at rest, from the distances of the undeformed faces, from which rows that are never free count
        theirs.
        """
        return np.where(self.fixed, 0.0, gap)

    def following(
        self,
        state: np.ndarray,
        force: np.ndarray,
        gap: np.ndarray,
        pull: float = 0.0,
        overlap: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """States that rows go on to, whose forces and gaps may miss their bounds by so much rounding."""
        rows = np.arange(len(state))
        let = force < self.table.least[state, rows] - pull
        let |= force > self.table.most[state, rows] + pull
        following = np.where(let, FREE, state)
        return np.where(state != FREE, following, self.touched(gap, overlap)).astype(np.int8)

    def touched(self, free_gap: np.ndarray, overlap: np.ndarray | float = 0.0) -> np.ndarray:
        """States of rows without forces; where none is held, no force acts at all."""
        low, high = free_gap < self.table.least[FREE] - overlap, free_gap > self.table.most[FREE] + overlap
        return np.where(low, PRESSED, np.where(high, PULLED, FREE)).astype(np.int8)

    def placed(self, state: np.ndarray, gap: np.ndarray) -> np.ndarray:
        """Gaps, of held rows those that are kept."""
        return np.where(state != FREE, self.places(state), gap)

    def places(self, state: np.ndarray) -> np.ndarray:
        """Gaps that rows in these states keep."""
        return self.table.place[state, np.arange(len(state))]

    def admissible(self, state: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Forces without what rounding has put beyond their bounds."""
        rows = np.arange(len(state))
        within = np.clip(force, self.table.least[state, rows], self.table.most[state, rows])
        return np.where(state != FREE, within, 0.0)

    def acting(self, force: np.ndarray) -> np.ndarray:
        """Rows that keep their gap, (..., c) of their forces."""
        return self.fixed | (force != 0.0)

    def room(self, gap: np.ndarray, row: int | slice = np.s_[:]) -> np.ndarray:
        """How far free rows, or one, are from being held, m, negative beyond; -inf where never free."""
        return np.minimum(gap - self.table.least[FREE, row], self.table.most[FREE, row] - gap)

    def reach(self, gap: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How far free rows may move to the side of a direction before they are held, m; 0 where they are."""
        least, most = self.table.least[FREE], self.table.most[FREE]
        return np.maximum(np.where(direction < 0.0, gap - least, most - gap), 0.0)


def row_laws(
    laws: ContactLaw | Sequence[ContactLaw] | None, count: int, owner: str
) -> tuple[ContactLaw, ...]:
    """The laws of so many rows without faces from one for all, one for each, or None: unilateral contact.

    Raises
    ------
    TypeError, ValueError
        If they are no laws, or not as many as rows, or have a layer, which is one of a face's area.
    """
    if laws is None:
        return (Unilateral(),) * count
    given = (laws,) * count if isinstance(laws, ContactLaw) else laws
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise TypeError(
            f"{owner}: contact_laws = {shown(laws)} must be a contact law or one for each row, such as Tied()"
        )
    for k, law in enumerate(given):
        check_without_layer(owner, f"contact_laws[{k}]", law)
    if len(given) != count:
        raise ValueError(
            f"{owner}: contact_laws has {len(given)} laws for {count} contact rows; give as many"
        )
    return tuple(given)


def check_without_layer(owner: str, name: str, law: object) -> None:
    """Raise unless it is a law of a row whose faces have no area."""
    check_law(owner, name, law)
    if getattr(law, "compliance", 0.0) or getattr(law, "tangential_compliance", 0.0):
        raise ValueError(
            f"{owner}: {name} = {law!r} is a layer in m^3/N of a face's area, which a row of matrices has "
            "not; give compliance = [...] in m/N of each row to reduce_matrices"
        )


# Solvers read of a law what stands in `RowLaws` alone: any other class would be one of these under its name.
KNOWN = (Unilateral, Tied, Clearance, Coulomb)
_GIVE = "Unilateral(), Tied(), Clearance(width=...) or Coulomb(friction)"


def check_law(owner: str, name: str, law: object) -> None:
    """Raise TypeError unless it is a contact law that the solvers know."""
    if type(law) in KNOWN:
        return
    if isinstance(law, ContactLaw) and type(law) is not ContactLaw:
        raise TypeError(
            f"{owner}: {name} is a law of its own class, {type(law).__name__}, of which no solver asks its "
            f"force; give {_GIVE}"
        )
    raise TypeError(f"{owner}: {name} = {shown(law)} must be a contact law, {_GIVE}")


def rows_depend() -> Exception:
    """Rows that are closed have no flexibility of their own each."""
    return failed_solve(
        "contact: rows that are closed depend on each other; is a pair given twice, or what moves it held, "
        "or do kept modes leave it no flexibility? Keep fewer modes, or give the rows compliance"
    )


def peaks_of(least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """The ones of larger modulus, of least and largest contact resultants: negative where laws hold faces
    back, positive where steps alone tell the moduli apart.
    """
    return np.where(-least > ALIKE * most, least, most)


def peak_of(resultant: np.ndarray) -> float:
    """The same of one contact resultant (n,), N."""
    return float(peaks_of(resultant.min(), resultant.max()))
