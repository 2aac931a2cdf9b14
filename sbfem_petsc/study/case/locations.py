"""TOML text to data, with the line on which every key and every element of an array stands."""

from __future__ import annotations

import bisect
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

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_DIGITS = re.compile(r"[\d_]+")
_BARE_VALUE = re.compile(r"[^,\]}\n#]*")


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
        raise CaseError(file, [Problem((), "its arrays or tables are nested too deeply", 1)]) from None
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"\(at line (\d+), column \d+\)", str(error))
        # what is missing at the end is told without a line
        line = int(found[1]) if found else max(1, text.rstrip().count("\n") + 1)
        reason = re.sub(r"\s*\(at .*\)$", "", str(error))
        words = text.splitlines()[line - 1].strip() if line <= len(text.splitlines()) else ""
        raise CaseError(
            file,
            [
                Problem(
                    (),
                    f"{words!r} is not TOML ({reason}); write key = value, texts in quotation marks, tables "
                    "as [name]",
                    line,
                )
            ],
        ) from None
    except ValueError:  # Python's limit for texts of numbers
        longest = max(_DIGITS.finditer(text), key=lambda found: len(found[0]))
        line = text.count("\n", 0, longest.start()) + 1
        words = f"a number of {len(longest[0]):,d} digits is too long; write it as 1e9 is written"
        raise CaseError(file, [Problem((), words, line)]) from None
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
        raise CaseError(
            name, [Problem((), "is no text in UTF-8; a case file in TOML was expected")]
        ) from None
    except OSError as error:
        raise CaseError(
            name,
            [
                Problem(
                    (),
                    f"cannot be read ({error.strerror or error}); name an existing case file, or write one "
                    "with  sbfem new beam FILE",
                )
            ],
        ) from None


class _Scanner:
    """Finds the keys of a text that is known to be valid TOML."""

    def __init__(self, text: str):
        self.text, self.at = text, 0
        self.breaks = [m.start() for m in re.finditer("\n", text)]
        self.lines: dict[Path, int] = {}
        self.tables: dict[Path, int] = {}  # arrays of tables and their lengths

    def scan(self) -> dict[Path, int]:
        here: Path = ()
        while self._skip():
            if self.text.startswith("[[", self.at):
                here = self._header(2, array=True)
            elif self.text[self.at] == "[":
                here = self._header(1, array=False)
            else:
                self._pair(here)
        return self.lines

    def _line(self) -> int:
        return bisect.bisect_left(self.breaks, self.at) + 1

    def _skip(self, also: str = "") -> bool:
        """Move past blanks, line ends, comments and the characters in `also`; False at the text's end."""
        while self.at < len(self.text):
            character = self.text[self.at]
            if character == "#":
                end = self.text.find("\n", self.at)
                self.at = len(self.text) if end < 0 else end
            elif character in " \t\r\n" or character in also:
                self.at += 1
            else:
                return True
        return False

    def _header(self, brackets: int, array: bool) -> Path:
        line = self._line()
        self.at += brackets
        keys = self._keys()
        self.at = self.text.index("]", self.at) + brackets
        path: Path = ()
        for k, key in enumerate(keys):
            path += (key,)
            last = k == len(keys) - 1
            if last and array:
                self.tables[path] = self.tables.get(path, 0) + 1
                self.lines.setdefault(path, line)
            if path in self.tables:
                path += (self.tables[path] - 1,)
            self.lines.setdefault(path, line)
        return path

    def _keys(self) -> list[str]:
        keys = []
        while True:
            self._skip()
            quote = self.text[self.at]
            if quote in "\"'":
                start = self.at
                self._string()
                keys.append(next(iter(tomllib.loads(f"{self.text[start : self.at]} = 0"))))
            else:
                found = _BARE_KEY.match(self.text, self.at)
                assert found is not None  # the text is valid TOML
                keys.append(found[0])
                self.at = found.end()
            self._skip()
            if self.text[self.at] != ".":
                return keys
            self.at += 1

    def _pair(self, here: Path) -> None:
        line = self._line()
        for key in self._keys():
            here += (key,)
            self.lines.setdefault(here, line)
        self.at += 1  # the equals sign
        self._skip()
        self._value(here)

    def _value(self, path: Path) -> None:
        first = self.text[self.at]
        if first in "\"'":
            self._string()
        elif first == "[":
            self.at += 1
            position = 0
            while self._skip(",") and self.text[self.at] != "]":
                self.lines[(*path, position)] = self._line()
                self._value((*path, position))
                position += 1
            self.at += 1
        elif first == "{":
            self.at += 1
            while self._skip(",") and self.text[self.at] != "}":
                self._pair(path)
            self.at += 1
        else:
            found = _BARE_VALUE.match(self.text, self.at)
            assert found is not None
            self.at = found.end()

    def _string(self) -> None:
        quote = self.text[self.at]
        mark = quote * 3 if self.text.startswith(quote * 3, self.at) else quote
        self.at += len(mark)
        while not self.text.startswith(mark, self.at):
            self.at += 2 if self.text[self.at] == "\\" and quote == '"' else 1
        self.at += len(mark)
        # up to two quotation marks may stand before the closing three
        while len(mark) == 3 and self.text.startswith(quote, self.at):
            self.at += 1
