"""The decorator of every picture: ranks, checks, choice by name, axes to draw in, style."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ParamSpec, TypeVar

import numpy as np
from matplotlib import rc_context
from mpi4py import MPI

from ..checks import Bounds, choice, flag, instance, integer, numbers_of, positive, real, real_array, shown
from ..indicators.record import numbers
from ..ranks.parallel import agreed, checked_communicator, collective, on_root, ranks_of
from ..record.record import Record
from ..system.fields.places import checked_place
from .drawing import STYLE, Sheet

Subject = TypeVar("Subject")
Result = TypeVar("Result")
Parameters = ParamSpec("Parameters")
Check = Callable[[str, str, Any], Any]
# Ranks that call a picture; None: those of COMM_WORLD.
Comm = MPI.Comm | None


def picture(
    *kinds: type, several: bool = False, **checks: Check
) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Decorator of a function that draws its first argument and returns the axes.

    Inside, arguments are checked by their names, `ax` is a `Sheet`, and what is given by name is a dict. A
    function with `comm` is called on rank 0, where its first argument is; for a place (x, y), at which all
    ranks find a displacement together, on each of them. One without `comm` gathers what it draws on all ranks
    of its model.

    Parameters
    ----------
    *kinds : type
        Of the first argument; none: it is checked inside.
    several : bool
        It may be a dict of them by name.
    **checks : function
        Of arguments, instead of those of `CHECKS`.
    """

    def decorated(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        signature, owner = inspect.signature(function), function.__name__
        names = list(signature.parameters)
        subject, table = names[0], {name: check for name, check in (CHECKS | checks).items() if name in names}
        gathers = "comm" not in names

        @functools.wraps(function)
        def draw(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
            try:
                bound = signature.bind(*args, **kwargs)
            except TypeError as error:
                raise TypeError(f"{owner}: {error}") from None
            bound.apply_defaults()
            given = bound.arguments
            sharing = (ranks_of(given[subject]) or MPI.COMM_SELF) if gathers else given["comm"]
            comm = checked_communicator(owner, sharing)
            with collective(comm):
                for name, check in table.items():
                    given[name] = check(owner, name, given[name])
                together = gathers or isinstance(given.get("point"), tuple)
                if together or comm.rank == 0:
                    given[subject] = _subject(owner, subject, given[subject], kinds, several)
                sheet = Sheet(owner, given.get("ax") if comm.rank == 0 else None)
                given |= {"ax": sheet} if "ax" in given else {}

            def work() -> Any:
                with rc_context(STYLE):
                    drawn = function(*bound.args, **bound.kwargs)
                    return sheet.finished(drawn, given.get("title", "")) if "ax" in given else drawn

            found = work() if together else on_root(comm, work)
            return found if comm.rank == 0 else None  # type: ignore[return-value]

        # `fields` are of each rank's nodes
        own = ("ax", "fields") if gathers else tuple(name for name in names if name not in (*table, "comm"))
        return agreed(*own)(draw)

    return decorated


def _subject(owner: str, name: str, value: Any, kinds: tuple[type, ...], several: bool) -> Any:
    """What is to be drawn, of one of some kinds; by its names in the legend where there may be several, of
    which one alone has none.
    """
    if not kinds:
        return value
    one = " or ".join(f"a{'n' * (kind.__name__[0] in 'AEIO')} {kind.__name__}" for kind in kinds)
    if not several:
        return instance(owner, name, value, kinds, one)
    if isinstance(value, kinds):
        return {"": value}
    wanted = f"give one {kinds[0].__name__}, or a dict of them by name"
    if not isinstance(value, Mapping):
        raise TypeError(f"{owner}: {shown(value)} cannot be drawn; {wanted}")
    for key, item in value.items():
        if not isinstance(key, str) or not isinstance(item, kinds):
            raise TypeError(f"{owner}: {shown(key)}: {shown(item)} cannot be drawn; {wanted}")
    if not value:
        raise ValueError(f"{owner}: {name} is empty; {wanted}")
    return value


def named(subjects: Subject | Mapping[str, Subject]) -> Mapping[str, Subject]:
    """What `picture` has given names."""
    assert isinstance(subjects, Mapping)
    return subjects


def divisors(owner: str, names: Iterable[str], forces: Mapping[str, float] | None) -> dict[str, float]:
    """What the values of each name are divided by."""
    missing = [name for name in names if forces is not None and not forces.get(name, 0.0) > 0.0]
    if missing:
        raise ValueError(
            f"{owner}: forces has no positive force for {missing[0]!r}; give one for each name, or none"
        )
    return {name: 1.0 if forces is None else forces[name] for name in names}


def a_text(owner: str, name: str, value: Any) -> str:
    """A string, which may be empty."""
    return instance(owner, name, value, str, "a text")


def require_crack(owner: str, crack: int, count: int) -> None:
    """Raise ValueError for the number of a crack that a model of so many has not."""
    if crack >= count:
        raise ValueError(f"{owner}: crack = {crack} does not exist; the model has {count}")


def _point(owner: str, name: str, value: Any) -> str | tuple[float, float]:
    return value if isinstance(value, str) else checked_place(owner, value)


def place_name(point: str | tuple[float, float]) -> str:
    """What a point is called in labels: its name, or its coordinates."""
    return point if isinstance(point, str) else f"{point[0]:.6g} m, {point[1]:.6g} m"


def symbol(motions: Record | Mapping[str, Record], direction: str, point: Any) -> str:
    """Of a displacement in formulas: of a row, which stands in the place of y, with its own direction where
    that is an axis.
    """
    first = next(iter(motions.values())) if isinstance(motions, Mapping) else motions
    if first.of_rows and direction == "y":
        direction = first.point_directions.get(point, "")
    return f"u_{direction}" if direction in tuple("xyz") else "u"


def optional(check: Check) -> Check:
    """A check of what may be None."""
    return lambda owner, name, value: None if value is None else check(owner, name, value)


def one_of(*values: str) -> Check:
    """A check of a word."""
    return lambda owner, name, value: choice(owner, name, value, values)


def whole(least: int | None = None, most: int | None = None) -> Check:
    """A check of a whole number."""
    return lambda owner, name, value: integer(owner, name, value, least=least, most=most)


def number(unit: str = "", **bounds: float) -> Check:
    """A check of a number within `Bounds`."""
    return lambda owner, name, value: real(owner, name, value, unit, within=Bounds(**bounds))


def two_numbers(owner: str, name: str, value: Any) -> tuple[float, float]:
    """Two numbers, the lower one first."""
    start, stop = numbers_of(owner, name, value, 2, "two numbers, the lower one first")
    if not start < stop:
        raise ValueError(f"{owner}: {name} = {shown(value)} must be two numbers, the lower one first")
    return start, stop


def table_of(check: Check, one: str = "") -> Check:
    """A check of a dict by name, each entry by another check; of one `one` at least, in words."""

    def checked(owner: str, name: str, value: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
            raise TypeError(f"{owner}: {name} = {shown(value)} must be a dict by name")
        if one and not value:
            raise ValueError(f"{owner}: {name} is empty; give one {one} at least")
        return {key: check(owner, f"{name}[{key!r}]", item) for key, item in value.items()}

    return checked


# Displacement fields of a model.
fields_by_name = table_of(lambda owner, name, item: item, "field")


def curve(owner: str, name: str, value: Any) -> tuple[np.ndarray, np.ndarray]:
    """A pair of arrays of one length that can be drawn over each other."""
    if not isinstance(value, (tuple, list)) or len(value) != 2:
        raise TypeError(f"{owner}: {name} = {shown(value)} must be two arrays, places and values")
    along = real_array(owner, f"{name}[0]", value[0], 1)
    values = numbers(owner, f"{name}[1]", value[1], "an array of real or complex numbers")
    if along.shape != values.shape:
        raise ValueError(
            f"{owner}: {name} has the shapes {along.shape} and {values.shape}; two arrays of one length, "
            "places and values, are expected"
        )
    if not np.isfinite(values).any():
        raise ValueError(f"{owner}: {name}[1] has no finite number to be drawn")
    return along, values


CHECKS: dict[str, Check] = {
    "point": _point,
    "title": a_text,
    "quantity": a_text,
    "label": optional(a_text),
    "direction": one_of("x", "y"),
    "colour": one_of("von_mises", "displacement"),
    "harmonic": optional(whole(0, 20)),
    "count": whole(1, 10_000),
    "order": whole(1, 1000),
    "columns": whole(1, 100),
    "crack": whole(0),
    "decades": number(above=0.0, most=300.0),
    "magnification": optional(number(above=0.0)),
    "least": positive,
    "unit": optional(positive),
    "window": optional(two_numbers),
    "forces": optional(table_of(positive)),
    "lines": optional(table_of(real)),
    "pairs": optional(table_of(whole(0))),
    "harmonics": optional(table_of(lambda owner, name, value: real_array(owner, name, value, 1, "Hz"))),
    "every": flag,
}
