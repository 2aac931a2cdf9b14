"""What is wrong with a case, as sentences that name file, line, item and remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from ...checks import shown
from ...options import TYPES, one_of, unit_of, wrong
from .tables import Path, Problem, kind_names, members


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
        # that of the path, or of the innermost table around it that is in the file
        around = (problem.path[:length] for length in range(len(problem.path), -1, -1))
        line = next((self.lines[path] for path in around if path in self.lines), None)
        place = f"{self.file}, line {line}" if line else self.file
        item = f"{written(problem.path)} " if problem.path else ""
        return f"{place}: {item}{problem.text}{'' if problem.text.endswith('?') else '.'}"


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


def from_validation(error: ValidationError, data: Any, root: type[BaseModel]) -> list[Problem]:
    """Problems of a validation by pydantic, each with its path in the user's data."""
    faults: dict[Path, list[tuple[Any, type[BaseModel], list[str]]]] = {}
    for item in error.errors(include_url=False):
        path, table, kinds = _place(item["loc"], data, root, missing=item["type"] == "missing")
        value = item["input"]
        if item["type"] == "union_tag_invalid" and isinstance(value, dict):
            given = value["kind"]
            text = f"= {_spelt(given)} is unknown; {one_of(kinds, given)}"
            item = {**item, "type": "value_error", "ctx": {"error": text}}
            path = (*path, "kind")
        faults.setdefault(path, []).append((item, table, kinds))
    # of a key that may be of several types, what is wrong within one of them says more than its type
    return [
        Problem(path, _sentence([item for item, *_ in found], path, *found[0][1:]))
        for path, found in faults.items()
        if not all(item["type"] in TYPES for item, *_ in found)
        or not any(other[: len(path)] == path and other != path for other in faults)
    ]


def _place(
    loc: tuple, data: Any, root: type[BaseModel], missing: bool
) -> tuple[Path, type[BaseModel], list[str]]:
    """The user's path of an error, the table that its last key stands in, and the kinds that what stands
    there may have; marks that tell the members of a union apart are left out.
    """
    path: Path = ()
    here, owner, below = data, root, [root]  # tables that what stands here may be
    for k, part in enumerate(loc):
        told = [table for table in below if part in (table.__name__, *kind_names([table]))]
        if len(below) > 1 and told:
            below = told
            continue
        within = isinstance(here, (dict, list)) and part in (
            here if isinstance(here, dict) else range(len(here))
        )
        if not within and not (missing and k == len(loc) - 1):
            continue
        path, here = (*path, part), here[part] if within else None
        owner = below[0] if len(below) == 1 else owner
        if part in owner.model_fields:
            below = members(owner.model_fields[part].annotation)
    return path, owner, kind_names(below)


def _sentence(faults: list[Any], path: Path, table: type[BaseModel], kinds: list[str]) -> str:
    """What is wrong at a path: keys and kinds that the table does not know, or a value."""
    fault, key = faults[0], str(path[-1]) if path else ""
    field = table.model_fields.get(key)
    unit = unit_of(field) if field is not None else ""
    if fault["type"] == "extra_forbidden":
        return f"is no key of this table; {one_of(table.model_fields, key)}"
    if fault["type"] == "missing":
        what = f" ({field.description}{f', in {unit}' if unit else ''})" if field is not None else ""
        return f"is missing{what}; add it"
    if fault["type"] not in ("union_tag_not_found", "union_tag_invalid"):
        return wrong(faults, unit, _spelt)
    names = re.findall(r"'([^']*)'", str(fault.get("ctx", {}).get("expected_tags", ""))) or kinds
    if not isinstance(fault["input"], dict):
        return f"= {_spelt(fault['input'])} must be a table" + (" or a number" if "number" in names else "")
    return f"has no kind; {one_of(name for name in names if name != 'number')}"


def _spelt(value: Any) -> str:
    """As TOML has it."""
    return str(value).lower() if isinstance(value, bool) else shown(value)
