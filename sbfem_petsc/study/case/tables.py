"""What all tables of a case file have in common, and how a value finds the table it belongs to."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, Discriminator, Field, Tag

from ...options import Options

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
    line : int or None
        Line of the file; None: that of the path.
    """

    path: Path
    text: str
    line: int | None = None


class Table(Options):
    """A table of a case file.

    Attributes
    ----------
    made : class or function of the Python interface
        What it stands for; its keys are the arguments.
    """

    made: ClassVar[Any] = None

    def problems(self) -> Iterator[Problem]:
        """What single keys cannot tell, at paths within the table."""
        return (Problem((key,) if key else (), text) for key, text in self.contradictions())


def _printable(name: str) -> str:
    if not name.isprintable():
        raise ValueError(f"= {name!r} holds control characters; use letters, digits, '-' and '_'")
    return name


Name = Annotated[str, Field(min_length=1), AfterValidator(_printable)]


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


_ONE_OR_MORE = BeforeValidator(_listed, json_schema_input_type=str | list[str])
# One name stands for a list of one.
Names = Annotated[list[Name], _ONE_OR_MORE, Field(min_length=1)]
AnyNames = Annotated[list[Name], _ONE_OR_MORE]


def kind_of(value: Any) -> Any:
    """Mark of a table in a union: its `kind`."""
    return value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)


def by_kind(*tables: type[Table], number: bool = False) -> Any:
    """Union of tables told apart by their key `kind`, and of numbers where these may stand for one."""
    members: tuple[Any, ...] = tuple(Annotated[table, Tag(kind_name(table))] for table in tables)
    if number:
        members = (Annotated[float, Tag("number")], *members)
    told = Discriminator(_number_or_kind if number else kind_of)
    return Annotated[typing.Union[members], told]  # noqa: UP007 - made at run time


def _number_or_kind(value: Any) -> Any:
    return kind_of(value) if isinstance(value, (dict, Table)) else "number"


def kind_name(table: type[BaseModel]) -> str:
    """Kind of a table that has one."""
    return str(typing.get_args(table.model_fields["kind"].annotation)[0])


def members(annotation: Any) -> list[type[BaseModel]]:
    """Tables in an annotation, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for part in typing.get_args(annotation) for table in members(part)]


def member_of(table: Any, key: str | int, value: Any) -> Any:
    """The table class, or the annotation, that a value under `key` of a table stands for."""
    if isinstance(table, type) and issubclass(table, BaseModel):
        field = table.model_fields.get(str(key))
        annotation = field.annotation if field is not None else None
        if field is not None and field.metadata:
            annotation = Annotated[(annotation, *field.metadata)]  # type: ignore[assignment]
    else:
        annotation = _element(table)
    return _chosen(annotation, value)


def _element(annotation: Any) -> Any:
    """Annotation of the elements of an array or of the values of a table of tables."""
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        return _element(parts[0])
    if origin in (list, dict):
        return parts[-1]
    for part in parts:
        found = _element(part)
        if found is not None:
            return found
    return None


def _chosen(annotation: Any, value: Any) -> Any:
    origin = typing.get_origin(annotation)
    if isinstance(value, dict) and origin not in (dict, list):
        if origin is Annotated and typing.get_origin(typing.get_args(annotation)[0]) in (dict, list):
            return annotation
        found = members(annotation)
        if origin in (typing.Union, types.UnionType) or origin is Annotated:
            nested = [p for p in typing.get_args(annotation) if typing.get_origin(p) in (dict, list)]
            if nested and not found:
                return nested[0]
        wanted = value.get("kind")
        for table in found:
            if "kind" not in table.model_fields:
                continue
            if kind_name(table) == wanted or (
                wanted is None and not table.model_fields["kind"].is_required()
            ):
                return table
        return found[0] if len(found) == 1 else annotation
    return annotation


def kind_names(annotation: Any) -> list[str]:
    """Kinds of the tables in an annotation."""
    return [kind_name(table) for table in members(annotation) if "kind" in table.model_fields]
