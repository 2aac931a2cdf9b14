"""TOML text to data, with the line on which every key and every element of an array stands."""

from __future__ import annotations

import os
import re
import sys
import uuid
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover - the standard library has it from 3.11 on
    import tomli as tomllib

from meshing.whole_file import require_regular

from .problems import CaseError
from .tables import Path, Problem

_DIGITS = re.compile(r"[\d_]+")
_TEXT = r""""(?:\\.|[^"\\\n])*"|'[^'\n]*'"""
_KEYS = rf"(?:[\w-]+|{_TEXT})(?:[ \t]*\.[ \t]*(?:[\w-]+|{_TEXT}))*[ \t]*"
_HEADER = re.compile(rf"^[ \t]*\[\[?[ \t]*{_KEYS}\]\]?(?P<header>)", re.MULTILINE)
# Texts on several lines have up to two quotation marks before the closing three.
_VALUE = rf""""{{3}}(?:\\.|[^\\])*?"{{3,5}}|'{{3}}.*?'{{3,5}}|{_TEXT}|\{{\s*\}}|[^][{{}},#"'\n]+"""
_LEFT = rf"{_KEYS}=|#[^\n]*|\s*\n|[ \t]+"
_TOKEN = re.compile(rf"{_LEFT}|(?P<open>\[)|(?P<close>\])|(?P<value>{_VALUE})|[,{{}}]", re.DOTALL)


def parse(text: str, file: str) -> tuple[dict[str, Any], dict[Path, int]]:
    """Data of a TOML text and the line numbers (from 1) of its paths.

    A path is a tuple of keys and of positions in arrays, ("geometry", "notches", 0, "depth").

    Raises
    ------
    CaseError
        If the text is not TOML; the sentence names file and line.
    """
    try:
        return tomllib.loads(text), _lines(text)
    except RecursionError:
        raise _refused(file, "its arrays or tables are nested too deeply", 1) from None
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"\(at line (\d+), column \d+\)", str(error))
        # what is missing at the end is told without a line
        line = int(found[1]) if found else max(1, text.rstrip().count("\n") + 1)
        reason = re.sub(r"\s*\(at .*\)$", "", str(error))
        words = text.splitlines()[line - 1].strip() if line <= len(text.splitlines()) else ""
        remedy = "write key = value, texts in quotation marks, tables as [name]"
        raise _refused(file, f"{words!r} is not TOML ({reason}); {remedy}", line) from None
    except ValueError:  # Python's limit for texts of numbers
        longest = max(_DIGITS.finditer(text), key=lambda found: len(found[0]))
        line = text.count("\n", 0, longest.start()) + 1
        words = f"a number of {len(longest[0]):,d} digits is too long; write it as 1e9 is written"
        raise _refused(file, words, line) from None


def read_text(path: str | os.PathLike[str]) -> str:
    """Text of a file in UTF-8.

    Raises
    ------
    CaseError
        If it cannot be read.
    """
    name = os.fspath(path)
    try:
        require_regular(name)
        with open(name, encoding="utf-8-sig", newline=None) as file:
            return file.read()
    except UnicodeDecodeError:
        raise _refused(name, "is no text in UTF-8; a case file in TOML was expected") from None
    except OSError as error:
        remedy = "name an existing case file, or write one with  sbfem new beam FILE"
        raise _refused(name, f"cannot be read ({error.strerror or error}); {remedy}") from None


def _refused(file: str, text: str, line: int | None = None) -> CaseError:
    return CaseError(file, [Problem((), text)], {(): line} if line else None)


def _lines(text: str) -> dict[Path, int]:
    """Lines of the paths of a valid text: one with these in the place of its values, and in front of those of
    each table and array, has them at the same paths.
    """
    own = uuid.uuid4().hex  # a key that it has not
    written, line, at, depth = [], 1, 0, 0
    while at < len(text):
        token: Any = (_HEADER.match(text, at) if depth == 0 else None) or _TOKEN.match(text, at)
        kind, words = token.lastgroup, token[0]
        depth += {"open": 1, "close": -1}.get(kind, 0)
        marked = {"header": f"{words}\n{own} = {line}", "open": f"[{line}, ", "value": f"{line}"}
        written.append(marked.get(kind, words))
        line, at = line + words.count("\n"), token.end()
    found: dict[Path, int] = {}

    def visit(value: Any, path: Path) -> int:
        if isinstance(value, int):
            found[path] = value
        else:  # a table that has no line of its own stands where the first of its keys does
            first = -1 if isinstance(value, list) and isinstance(value[0], int) else 0
            entries = value.items() if isinstance(value, dict) else enumerate(value, first)
            found[path] = min(visit(entry, (*path, key)) for key, entry in entries)
        return found[path]

    for key, value in tomllib.loads("".join(written)).items():
        visit(value, (key,))
    return {path: line for path, line in found.items() if path[-1] not in (own, -1)}
