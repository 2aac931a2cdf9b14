"""TOML text to data, with the line on which every key and every element of an array stands."""

from __future__ import annotations

import os
import re
import sys
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover - the standard library has it from 3.11 on
    import tomli as tomllib

from meshing.whole_file import require_regular

from .problems import CaseError
from .tables import Path, Problem

_DIGITS = re.compile(r"[\d_]+")
# Texts, up to two quotation marks before the closing three included; comments; signs; keys and values.
_TOKEN = re.compile(
    r""""{3}(?:\\.|[^\\])*?"{3,5}|'{3}.*?'{3,5}|"(?:\\.|[^"\\])*"|'[^']*'|#[^\n]*"""
    r"""|[][{},=.]|[^][{},=.#"'\s]+""",
    re.DOTALL,
)


def parse(text: str, file: str) -> tuple[dict[str, Any], dict[Path, int]]:
    """Data of a TOML text and the line numbers (from 1) of its paths.

    A path is a tuple of keys and of positions in arrays, ("geometry", "notches", 0, "depth").

    Raises
    ------
    CaseError
        If the text is not TOML; the sentence names file and line.
    """
    try:
        data = tomllib.loads(text)
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
    return data, _Scanner(text).scan()


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


class _Scanner:
    """Finds the keys of a text that is known to be valid TOML."""

    def __init__(self, text: str):
        self.tokens: list[tuple[str, int]] = []  # and the line of each
        self.at, line, before = 0, 1, 0
        for found in _TOKEN.finditer(text):
            line, before = line + text.count("\n", before, found.start()), found.start()
            if not found[0].startswith("#"):
                self.tokens.append((found[0], line))
        self.tokens.append(("", line))
        self.lines: dict[Path, int] = {}
        self.tables: dict[Path, int] = {}  # arrays of tables and their lengths

    def scan(self) -> dict[Path, int]:
        here: Path = ()
        while word := self._word():
            if word == "[":
                here = self._header()
            else:
                self._pair(here)
        return self.lines

    def _word(self) -> str:
        return self.tokens[self.at][0]

    def _header(self) -> Path:
        line, array = self.tokens[self.at][1], self.tokens[self.at + 1][0] == "["
        self.at += 1 + array
        keys = self._keys()
        self.at += 1 + array
        path: Path = ()
        for k, key in enumerate(keys):
            path += (key,)
            if array and k == len(keys) - 1:
                self.tables[path] = self.tables.get(path, 0) + 1
                self.lines.setdefault(path, line)
            if path in self.tables:
                path += (self.tables[path] - 1,)
            self.lines.setdefault(path, line)
        return path

    def _keys(self) -> list[str]:
        keys = []
        while True:
            word = self._word()
            keys.append(next(iter(tomllib.loads(f"{word} = 0"))) if word[0] in "\"'" else word)
            self.at += 1
            if self._word() != ".":
                return keys
            self.at += 1

    def _pair(self, here: Path) -> None:
        line = self.tokens[self.at][1]
        for key in self._keys():
            here += (key,)
            self.lines.setdefault(here, line)
        self.at += 1  # the equals sign
        self._value(here)

    def _value(self, path: Path) -> None:
        (first, line), position = self.tokens[self.at], 0
        self.at += 1
        if first in ("[", "{"):
            while (word := self._word()) not in ("]", "}"):
                if word == ",":
                    self.at += 1
                elif first == "{":
                    self._pair(path)
                else:
                    self.lines[(*path, position)] = self.tokens[self.at][1]
                    self._value((*path, position))
                    position += 1
            self.at += 1
        elif first[0] not in "\"'":  # a number or date, of several tokens
            while self._word() not in (",", "]", "}", "") and self.tokens[self.at][1] == line:
                self.at += 1
