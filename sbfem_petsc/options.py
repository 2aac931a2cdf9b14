"""Options as frozen classes: type, bounds, unit, default and words of each stand once, for a Python function,
a table of a case file and the record of what was run. Nothing here waits for PETSc or MPI.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from numbers import Real
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import InitErrorDetails, PydanticCustomError

from .checks import shown

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Own = TypeVar("Own", bound="Options")
Place = tuple[Any, ...]  # keys and positions
_LISTS = (list, tuple, np.ndarray)


def item(default: Any = ..., *, text: str, unit: str = "", **bounds: Any) -> Any:
    """An option with its description, unit and default."""
    return Field(default, description=text, json_schema_extra={"unit": unit}, **bounds)


class Options(BaseModel):
    """Options that are checked once: unknown names, other types, nan and infinity are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    @staticmethod
    def spelt(value: Any) -> str:
        """A value in sentences."""
        return shown(value)

    @model_validator(mode="wrap")
    @classmethod
    def _checked(cls, values: Any, check: Any) -> Any:
        """NumPy's numbers are taken as Python's, tuples and arrays as lists, in dicts too; what is wrong is
        told in words.
        """
        found: dict[Place, list[Any]] = {}
        try:
            return check(_plain(values))
        except ValidationError as error:
            for fault in error.errors(include_url=False):
                found.setdefault(_place(fault, values), []).append(fault)
        # of an option that may be of several types, what is wrong within one of them says more than its type
        faults = [
            cls._told(place, alike, values)
            for place, alike in found.items()
            if not all(fault["type"] in TYPES for fault in alike)
            or not any(other[: len(place)] == place and other != place for other in found)
        ]
        raise ValidationError.from_exception_data(cls.__name__, faults)

    @classmethod
    def _told(cls, place: Place, faults: list[Any], values: Any) -> InitErrorDetails:
        """What is wrong at a place."""
        fault = next((one for one in faults if one["type"] == "told"), faults[0])
        kind = fault["type"]
        if not place:  # no options at all, which is told where they should be
            return {"type": kind, "loc": (), "input": fault["input"], "ctx": fault.get("ctx", {})}
        if kind == "told":
            return told(place, fault["ctx"]["text"], fault["ctx"]["is_type"])
        field = cls.model_fields.get(place[0])
        unit = unit_of(field) if field is not None else ""
        if kind == "extra_forbidden":
            return told(place, f"is no key of this table; {one_of(cls.model_fields, place[0])}")
        if field is not None and kind == "missing":
            return told(place, f"is missing ({field.description}{f', in {unit}' if unit else ''}); add it")
        if len(place) == 1:
            faults = [{**one, "input": values[place[0]]} for one in faults]
        return told(place, wrong(faults, unit, cls.spelt), kind in TYPES and kind != "finite_number")

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
        faults: list[Any] = []
        try:
            found = cls.model_validate(dict(values))
        except ValidationError as error:
            faults = error.errors(include_url=False)
        for fault in faults:  # out of what pydantic raises, which would be printed too
            name, *within = fault["loc"]
            kind = TypeError if fault["ctx"]["is_type"] else ValueError
            raise kind(f"{owner}: {name}{''.join(f'[{k}]' for k in within)} {fault['ctx']['text']}")
        for name, text in found.contradictions():
            raise ValueError(f"{owner}: {f'{name} ' if name else ''}{text}")
        return found


def told(place: Place, text: str, is_type: bool = False) -> InitErrorDetails:
    """A fault for pydantic, in words behind its place; `is_type`: its type is wrong."""
    fault = PydanticCustomError("told", "{text}", {"text": text, "is_type": is_type, "place": place})
    return {"type": fault, "loc": place, "input": None}


def _place(fault: Any, values: Any) -> Place:
    """Where in given values a fault is: without the marks that tell the members of a union apart."""
    place, loc = [], fault["loc"]
    own = loc if fault["type"] == "missing" else fault.get("ctx", {}).get("place", ())
    for part in loc[: len(loc) - len(own)]:
        number = isinstance(part, int)
        if part in values if isinstance(values, Mapping) else number and isinstance(values, _LISTS):
            values = values[part]
            place.append(part)
    return (*place, *own)


def unit_of(field: FieldInfo) -> str:
    """Unit of an option, "" where it has none."""
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


class _Foreign:
    """What pydantic would take for a number: an array without dimensions, say."""

    def __init__(self, value: Any):
        self.value = value

    def __repr__(self) -> str:
        return repr(self.value)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.floating):
        return float(value)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray) and value.ndim and not np.ma.is_masked(value):
        return value.tolist()
    if hasattr(value, "__float__") and not isinstance(value, Real):
        return _Foreign(value)
    return list(value) if isinstance(value, tuple) else value


# What a value must be, by the names of pydantic's faults.
TYPES = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": 'a text in quotation marks, "..."',
    "list_type": "an array, [...]",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
}
_BOUNDS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


def wrong(faults: Sequence[Any], unit: str, spelt: Callable[[Any], str] = shown) -> str:
    """What pydantic finds wrong with a value, in words behind its name. Of one that may be of several types
    what is wrong within one of them says more than its type.
    """
    fault = next((one for one in faults if one["type"] not in TYPES), faults[0])
    kind, context, in_unit = fault["type"], fault.get("ctx", {}), f", in {unit}" if unit else ""
    given = f"= {spelt(fault['input'])}"
    if kind in TYPES:
        wanted = " or ".join(dict.fromkeys(TYPES[one["type"]] for one in faults))
        return f"{given} must be {wanted}{in_unit}"
    if kind in _BOUNDS:
        name, words = _BOUNDS[kind]
        return f"{given} must be {words} {context[name]:g}{in_unit}"
    if kind == "literal_error":
        names = re.findall(r"'([^']*)'", context["expected"])
        return f"{given} is unknown; {one_of(names, fault['input'])}"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        words = "at least" if kind == "too_short" else "at most"
        return f"has {context['actual_length']} entries; {words} {bound} expected{in_unit}"
    if kind == "string_too_short":
        return f"{given} must not be empty"
    return str(context["error"]) if kind == "value_error" else f"{given}: {fault['msg']}"


def one_of(names: Iterable[str], wrong: object = None) -> str:
    """Valid names for a sentence, the nearest one to a wrong name first."""
    names = list(names)
    if not names:
        return "there are none"
    listed = ", ".join(repr(name) for name in names)
    close = difflib.get_close_matches(wrong, names, n=1, cutoff=0.5) if isinstance(wrong, str) else []
    return f"did you mean {close[0]!r}? Valid are {listed}" if close else f"valid are {listed}"
