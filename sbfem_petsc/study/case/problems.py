"""What is wrong with a case, as sentences that name file, line, item and remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from pydantic import ValidationError

from ...checks import shown
from .tables import Path, Problem


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


def from_validation(error: ValidationError) -> list[Problem]:
    """What tables find wrong with what is in them."""
    return [Problem(fault["loc"], fault["ctx"]["text"]) for fault in error.errors(include_url=False)]
