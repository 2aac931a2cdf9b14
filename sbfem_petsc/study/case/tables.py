"""What all tables of a case file have in common, and how a value finds the table it belongs to."""

from __future__ import annotations

import dataclasses
import inspect
import re
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    ValidationError,
    WrapValidator,
    create_model,
)

from ...checks import shown
from ...options import Options, item, one_of, told

Path = tuple[str | int, ...]


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong.

    Attributes
    ----------
    path : tuple of str and int
        Where in the case: keys and positions in arrays.
    text : str
        The sentence without its place.
    """

    path: Path
    text: str


class Table(Options):
    """A table of a case file.

    Attributes
    ----------
    made : class or function of the Python interface
        What it stands for; its keys are the arguments.
    """

    made: ClassVar[Any] = None

    @staticmethod
    def spelt(value: Any) -> str:
        """A value in sentences, as TOML has it."""
        return str(value).lower() if isinstance(value, bool) else shown(value)

    def problems(self) -> Iterator[Problem]:
        """What single keys cannot tell, at paths within the table."""
        yield from (Problem((key,) if key else (), text) for key, text in self.contradictions())
        tables = [one for _, one in within(self) if isinstance(one, Table)]
        if self.made is None or "file" in type(self).model_fields or len(tables) > 1:
            return
        try:
            type(self).made(**self.arguments())
        except (ValueError, TypeError) as error:
            text = str(error).rstrip(".")
            named = re.match(r"\w+: (\w+)\b( ?)", text)
            at = named[1] if named and named[1] in type(self).model_fields else None
            words = text[named.end() :] if named and at and named[2] else f"is refused: {text}"
            yield Problem((at,) if at else (), words)

    def arguments(self) -> dict[str, Any]:
        """Its keys as arguments of `made`."""
        return {name: value for name, value in self if name != "kind"}


def within(value: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """A value and all that is in it, with the path of each."""
    yield path, value
    entries = dict(value).items() if isinstance(value, (dict, Table)) else ()
    for key, entry in enumerate(value) if isinstance(value, list) else entries:
        yield from within(entry, (*path, key))


def _printable(name: str) -> str:
    if not name.isprintable():
        raise ValueError(f"= {name!r} holds control characters; use letters, digits, '-' and '_'")
    return name


Name = Annotated[str, Field(min_length=1), AfterValidator(_printable)]
# Names of files, and of groups in them, and bytes of a name that leave room for endings.
_FILED, _LONGEST = re.compile(r"[^/\\.\s][^/\\]*"), 120


def _filed(name: str) -> str:
    if not _FILED.fullmatch(name) or len(name.encode()) > _LONGEST:
        raise ValueError("cannot be a name here; use letters, digits, '-' and '_', at most 100 of them")
    return name


FileName = Annotated[Name, AfterValidator(_filed)]


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _as_list(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


_ONE_OR_MORE = BeforeValidator(_listed, json_schema_input_type=str | list[str])
# One name stands for a list of one.
Names = Annotated[list[Name], _ONE_OR_MORE, Field(min_length=1)]
AnyNames = Annotated[list[Name], _ONE_OR_MORE]


def table_of(
    made: Any,
    name: str,
    kind: Any = None,
    text: str = "",
    *,
    base: type[Table] = Table,
    types: Mapping[Any, Any] = {},
) -> Any:
    """Table of a class of the Python interface, whose fields say what they are (`said`), and its arguments
    their types and defaults.

    Parameters
    ----------
    made : type
        A dataclass.
    name : str
        Of the table.
    kind, text
        Its key `kind`, or that and its default, and what it is.
    base : type
        Class of the table.
    types : dict
        Types of keys by their names, or by their types in Python.
    """
    found: dict[str, Any] = {}
    if kind is not None:
        named, default = kind if isinstance(kind, tuple) else (kind, ...)
        found["kind"] = Literal[named], item(default, text=text)
    hints = typing.get_type_hints(made if made.__dataclass_params__.init else made.__init__)
    fields = {f.name: f for f in dataclasses.fields(made)}
    for key, argument in inspect.signature(made).parameters.items():
        says, hint = fields[key].metadata, hints[key]
        python = Literal[says["one_of"]] if says["one_of"] else types.get(hint, hint)
        default = ... if argument.default is inspect.Parameter.empty else _as_list(argument.default)
        option = item(default, text=says["text"], unit=says["unit"], **says["bounds"])
        found[key] = types.get(key, python), option
    # words of the first paragraph
    words = (made.__doc__ or "").split("\n\n")[0]
    table: Any = create_model(name, __base__=base, __doc__=words, __module__=base.__module__, **found)
    table.made = made
    return table


def by_kind(*tables: type[Table], default: str | None = None) -> Any:
    """Union of tables told apart by their key `kind`, the default where that is left out."""
    known = {kind_name(table): table for table in tables}
    names = list(known)

    def chosen(value: Any, check: Any) -> Any:
        if not isinstance(value, dict):
            return check(value)
        kind = value.get("kind", default)
        if kind in names:
            return known[kind].model_validate(value)
        fault = told(("kind",), f"= {Table.spelt(kind)} is unknown; {one_of(names, kind)}")
        if kind is None:
            fault = told((), f"has no kind; {one_of(names)}")
        raise ValidationError.from_exception_data("", [fault])

    union: Any = typing.Union[tables]  # noqa: UP007 - made at run time
    return Annotated[union, WrapValidator(chosen)]


def kind_name(table: type[BaseModel]) -> str:
    """Kind of a table that has one."""
    return str(typing.get_args(table.model_fields["kind"].annotation)[0])
