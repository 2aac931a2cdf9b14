"""Options as frozen classes: type, bounds, unit, default and words of each stand once, for a Python function,
a table of a case file and the record of what was run. Nothing here waits for PETSc or MPI.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo

from .checks import Bounds, choice, flag, integer, names_of, numbers_of, positive, real, shown

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Own = TypeVar("Own", bound="Options")


def item(default: Any = ..., *, text: str, unit: str = "", **bounds: Any) -> Any:
    """An option with its description, unit and default."""
    return Field(default, description=text, json_schema_extra={"unit": unit}, **bounds)


class Options(BaseModel):
    """Options that are checked once: unknown names, other types, nan and infinity are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _plain(cls, data: Any) -> Any:
        """NumPy's numbers as Python's, tuples and arrays as lists."""
        return {key: _plain(value) for key, value in data.items()} if isinstance(data, dict) else data

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """What single options cannot tell: the name of one, or "", and what is wrong with it."""
        return iter(())

    def of(self, kind: type[Options]) -> dict[str, Any]:
        """By name, the options of a class that this one has taken over."""
        return {name: getattr(self, name) for name in kind.model_fields}

    @classmethod
    def checked(cls: type[Own], owner: str, values: Mapping[str, Any]) -> Own:
        """The options of a function's call.

        Raises
        ------
        TypeError, ValueError
            One sentence that names the function, the option, its value and what is expected.
        """
        fault = None
        try:
            found = cls.model_validate(dict(values))
        except ValidationError as error:
            fault = error.errors(include_url=False, include_input=False, include_context=False)[0]
        if fault is not None:  # out of what pydantic raises, which would be printed too
            name = str(fault["loc"][0])
            _refuse(owner, name, values.get(name), cls.model_fields[name])
            raise ValueError(f"{owner}: {name} = {shown(values.get(name))}: {fault['msg']}")
        for name, text in found.contradictions():
            raise ValueError(f"{owner}: {f'{name} ' if name else ''}{text}")
        return found


def unit_of(field: FieldInfo) -> str:
    """Unit of an option, "" where it has none."""
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def _plain(value: Any) -> Any:
    if isinstance(value, np.floating):
        return float(value)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray) and value.ndim == 1 and not np.ma.is_masked(value):
        return value.tolist()
    if hasattr(value, "__float__") and not isinstance(value, Real):
        return object()  # pydantic would take it: an array without dimensions, say
    return list(value) if isinstance(value, tuple) else value


def _refuse(owner: str, name: str, value: Any, field: FieldInfo) -> None:
    """Raise what `checks` says of a value that an option does not take: one rule, in the words of Python."""
    kind = field.annotation
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        kind = next(part for part in typing.get_args(kind) if part is not type(None))
    if typing.get_origin(kind) is Annotated:
        kind = typing.get_args(kind)[0]
    keys = ("gt", "ge", "lt", "le")
    bounds: dict[str, Any] = {
        key: getattr(entry, key) for entry in field.metadata for key in keys if hasattr(entry, key)
    }
    within = Bounds(*(bounds.get(key) for key in keys))
    if kind is float:
        if bounds.get("ge", 0.0) > 0.0:  # that it is above zero comes before how small it may be
            positive(owner, name, value, unit_of(field))
        real(owner, name, value, unit_of(field), within=within)
    elif kind is int:
        integer(owner, name, value, least=bounds.get("ge"), most=bounds.get("le"))
    elif kind is bool:
        flag(owner, name, value)
    elif typing.get_origin(kind) is typing.Literal:
        choice(owner, name, value, typing.get_args(kind))
    elif kind == list[float]:
        numbers_of(owner, name, value, 2, f"{field.description}, in {unit_of(field)}")
    else:
        words = typing.get_args(typing.get_args(kind)[0])
        for word in names_of(owner, name, value):
            choice(owner, name, word, words)
        raise ValueError(f"{owner}: {name} is empty; name one of {', '.join(words)} at least")
