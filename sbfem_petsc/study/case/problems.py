"""What is wrong with a case, as sentences that name file, line, item and remedy."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from ...checks import shown
from .tables import Path, Problem, kind_names, member_of

# Names of files, and of groups in them, and bytes of a name that leave room for endings.
_FILED, _LONGEST = re.compile(r"[^/\\.\s][^/\\]*"), 120


class CaseError(ValueError):
    """A case that makes no sense; its text has one line a problem.

    Attributes
    ----------
    problems : list of Problem
    """

    def __init__(
        self, file: str, problems: Iterable[Problem], lines: Mapping[Path, int] | None = None
    ) -> None:
        self.file, self.problems, self.lines = file, list(problems), dict(lines or {})
        super().__init__(file, self.problems, self.lines)

    def __str__(self) -> str:
        return "\n".join(self._sentence(problem) for problem in self.problems)

    def _sentence(self, problem: Problem) -> str:
        line = problem.line or nearest_line(self.lines, problem.path)
        place = f"{self.file}, line {line}" if line else self.file
        item = f"{written(problem.path)} " if problem.path else ""
        return f"{place}: {item}{problem.text}."


def nearest_line(lines: Mapping[Path, int], path: Path) -> int | None:
    """Line of a path, or of the innermost table around it that is in the file."""
    for length in range(len(path), 0, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return None


def written(path: Path) -> str:
    """A path as in geometry.notches[0].depth."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
            continue
        key = part if re.fullmatch(r"[\w-]{1,80}", part) else f'"{shown(part)[1:-1]}"'
        text += f".{key}" if text else key
    return text


def filed(name: str) -> bool:
    """Whether files can bear a name."""
    return bool(_FILED.fullmatch(name)) and name.isprintable() and len(name.encode()) <= _LONGEST


def one_of(names: Iterable[str], wrong: object = None) -> str:
    """Valid names for a sentence, the nearest one to a wrong name first."""
    names = list(names)
    if not names:
        return "there are none"
    listed = ", ".join(repr(name) for name in names)
    close = difflib.get_close_matches(str(wrong), names, n=1, cutoff=0.5) if wrong is not None else []
    return f"did you mean {close[0]!r}? Valid are {listed}" if close else f"valid are {listed}"


def from_validation(error: ValidationError, data: Any, root: type[BaseModel]) -> list[Problem]:
    """Problems of a validation by pydantic, each with its path in the user's data."""
    found: dict[Path, list[tuple[Any, type[BaseModel] | None, list[str]]]] = {}
    for item in error.errors(include_url=False):
        path, table, kinds = _place(item["loc"], data, root, missing=item["type"] == "missing")
        value = item["input"]
        if item["type"] == "union_tag_invalid" and isinstance(value, dict):
            wrong = value["kind"]
            text = f"= {_shown(wrong)} is unknown; {one_of(kinds, wrong)}"
            found[(*path, "kind")] = [
                ({"type": "value_error", "ctx": {"error": text}, "input": wrong}, None, [])
            ]
            continue
        found.setdefault(path, []).append((item, table, kinds))
    problems = []
    for path, items in found.items():
        # of a key that may be of several types, what is wrong within one of them says more than its type
        deeper = any(other[: len(path)] == path and other != path for other in found)
        first = next((entry for entry in items if entry[0]["type"] not in _TYPES), None)
        if first is not None:
            item, table, kinds = first
            problems.append(Problem(path, _sentence(item, path, table, kinds)))
        elif not deeper:
            item, table, _ = items[0]
            wanted = " or ".join(dict.fromkeys(_TYPES[other[0]["type"]] for other in items))
            problems.append(
                Problem(path, f"= {_shown(item['input'])} must be {wanted}{_in_unit(path, table)}")
            )
    return problems


_TYPES = {
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
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def _in_unit(path: Path, table: type[BaseModel] | None) -> str:
    field = table.model_fields.get(str(path[-1])) if path and table is not None else None
    extra = field.json_schema_extra if field is not None else None
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    return f", in {unit}" if unit else ""


def _place(
    loc: tuple, data: Any, root: type[BaseModel], missing: bool
) -> tuple[Path, type[BaseModel] | None, list[str]]:
    """The user's path of an error, the table that its last key stands in, and the kinds that what stands
    there may have; marks that tell the members of a union apart are left out.
    """

    path: Path = ()
    here: Any = data
    owner: type[BaseModel] | None = None
    table: Any = root
    for k, part in enumerate(loc):
        within = (isinstance(here, dict) and part in here) or (
            isinstance(here, list) and isinstance(part, int) and part < len(here)
        )
        if within:
            owner = table if isinstance(table, type) else owner
            here, path = here[part], (*path, part)
            table = member_of(table, part, here)
        elif missing and k == len(loc) - 1:
            owner = table if isinstance(table, type) else owner
            path = (*path, part)
    return path, owner, kind_names(table)


def _sentence(item: Any, path: Path, table: type[BaseModel] | None, kinds: list[str]) -> str:
    kind, value, context = item["type"], item["input"], item.get("ctx", {})
    key = str(path[-1]) if path else ""
    in_unit = _in_unit(path, table)
    if kind == "extra_forbidden":
        return f"is no key of this table; {one_of(table.model_fields if table else (), key)}"
    if kind == "missing":
        field = table.model_fields.get(key) if table is not None else None
        what = f" ({field.description}{in_unit})" if field is not None else ""
        return f"is missing{what}; add it"
    given = f"= {_shown(value)}"
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        names = _quoted(str(context.get("expected_tags", ""))) or kinds
        if not isinstance(value, dict):
            return f"{given} must be a table" + (" or a number" if "number" in names else "")
        return f"has no kind; {one_of(name for name in names if name != 'number')}"
    if kind == "literal_error":
        return f"{given} is unknown; {one_of(_quoted(context['expected'].replace(' or ', ', ')), value)}"
    if kind in _BOUNDS:
        name, words = _BOUNDS[kind]
        return f"{given} must be {words} {context[name]:g}{in_unit}"
    if kind in ("too_short", "too_long"):
        bound = context["min_length" if kind == "too_short" else "max_length"]
        words = "at least" if kind == "too_short" else "at most"
        return f"has {context['actual_length']} entries; {words} {bound} expected{in_unit}"
    if kind == "string_too_short":
        return f"{given} must not be empty"
    if kind == "value_error":
        return str(context["error"])
    return f"{given}: {item['msg']}"


def _shown(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else shown(value)


def _quoted(listed: str) -> list[str]:
    return [name.strip().strip("'") for name in listed.split(",") if name.strip()]
