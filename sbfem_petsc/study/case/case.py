"""A case: what a user's file describes, read, checked and kept with its text."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from meshing.whole_file import require_regular

from .case_tables import CaseTables
from .contradictions import contradictions
from .locations import parse, read_text
from .problems import CaseError, from_validation
from .sweep import STRUCTURE, SweepTable, parameter_problems, parsed, replaced_in
from .tables import Path, Problem, within

# Tables on which the results of an analysis depend.
_DECISIVE = (*STRUCTURE, "loads", "analyses", "output")
_QUOTED = re.compile(r'"([^"\n\0]+)"')


@dataclass(frozen=True, eq=False)
class Case:
    """A checked case.

    Attributes
    ----------
    tables : CaseTables
    data : dict
        The tables as the user wrote them.
    text : str
        The file's text.
    file : str
        Its path, for messages.
    folder : str
        Folder that the paths in the case are relative to.
    lines : dict of tuple to int
        Line of each path of the case.
    """

    tables: CaseTables
    data: dict[str, Any]
    text: str
    file: str
    folder: str
    lines: Mapping[Path, int]

    def problem(self, path: Path, text: str) -> CaseError:
        """The error that something is wrong at a path of the case."""
        return CaseError(self.file, [Problem(path, text)], self.lines)

    def resolve(self, file: str) -> str:
        """Path of a file that the case names."""
        return os.path.join(self.folder, file)

    def _fingerprint(self) -> object:
        """What tells it from others."""
        return self.data, self.named_files()

    def check_tones(self, names: Iterable[str]) -> None:
        """Refuse analyses whose loads have no common period, or tones that belong to none of theirs.

        Raises
        ------
        CaseError
        """
        for name in names:
            self.tables.analyses[name].tones(self, ("analyses", name))

    @property
    def unvaried(self) -> list[str]:
        """Analyses that the sweep, if there is one, changes no key of, nor of their loads: what the case says
        of others stands for nothing in its rows.
        """
        sweep, analyses = self.tables.sweep, self.tables.analyses
        varied = {parsed(key)[:2] for key in sweep.parameters} if sweep is not None else set()
        owned = {name: [("loads", load) for load in kind.loads()] for name, kind in analyses.items()}
        return [name for name, loads in owned.items() if varied.isdisjoint([("analyses", name), *loads])]

    def with_data(self, data: dict[str, Any]) -> Case:
        """The case with other tables, checked again; errors name the lines of this one."""
        return replace(self, tables=_checked(data, self.file, self.folder, self.lines), data=data)

    @property
    def key(self) -> str:
        """Hash of all that results depend on: tables and the contents of the files they name."""
        return self._hash(_DECISIVE)

    @property
    def structure_key(self) -> str:
        """Hash of geometry, mesh, material and supports."""
        return self._hash(STRUCTURE)

    @property
    def sweep_key(self) -> str:
        """The same as `key`, with the sweep."""
        return self._hash((*_DECISIVE, "sweep"))

    def with_values(self, values: Mapping[str, Any]) -> Case:
        """The case without its sweep, with values at dotted paths, checked again.

        Raises
        ------
        CaseError
            If a path leads nowhere or a value makes no sense there.
        """
        try:
            data = replaced_in(self.data, values)
        except ValueError as error:
            raise self.problem((), f"{', '.join(values)}: {error}") from None
        return self.with_data(data)

    def named_files(self) -> dict[str, bytes]:
        """Contents of the files that the case names (model, samples), by their names in the case; not those
        of a body, whose matrices are as large as results.
        """
        return {name: self._content(path, name) for path, name in _files(self.data).items()}

    def _content(self, path: Path, name: str) -> bytes:
        """Of a file that is named at a path of the case."""
        try:
            require_regular(self.resolve(name))
            with open(self.resolve(name), "rb") as file:
                return file.read()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise self.problem(path, f"= {name!r} cannot be read ({reason})") from None

    def _hash(self, tables: tuple[str, ...]) -> str:
        chosen = self.tables.model_dump(mode="json", include=set(tables))
        if "output" in chosen:
            # what is drawn decides over no result
            chosen["output"] = chosen["output"].get("points")
        if (sweep := self.tables.sweep) is not None and "sweep" in chosen:
            # rows have numbers in the order of what varies, noise in that of the analyses
            chosen["order"] = [*sweep.parameters, *(self.tables.analyses if sweep.noise else ())]
        digest = hashlib.sha256(json.dumps(chosen, sort_keys=True).encode())
        named = sorted(_files(self.data).items(), key=str)
        if self.tables.body is not None:
            try:
                named += [(("body",), name) for name in self.tables.body.files(self.resolve)]
            except ValueError as error:
                raise self.problem(("body",), f"is refused: {error}") from None
        for path, name in named:
            if path[0] in tables:
                digest.update(hashlib.sha256(self._content(path, name)).digest())
                for file in _merged(self.resolve(name)):
                    digest.update(hashlib.sha256(self._content(path, file)).digest())
        return digest.hexdigest()

    def __repr__(self) -> str:
        return (
            f"Case({self.file!r}: {self.tables.kind}, "
            f"analyses {', '.join(f'{n} ({a.kind})' for n, a in self.tables.analyses.items())})"
        )


def read_case(path: str | os.PathLike[str], sweep: dict[str, Any] | None = None) -> Case:
    """Read and check a case file.

    Parameters
    ----------
    path : path-like
        TOML file; paths in it are relative to its folder.
    sweep : dict, optional
        In the place of its table [sweep].

    Raises
    ------
    CaseError
        A ValueError; one line a problem, each with file, line, item, value and what was expected.
    """
    return case_from_text(read_text(path), os.fspath(path), sweep=sweep)


def case_from_text(
    text: str,
    file: str = "case",
    folder: str | None = None,
    files: Mapping[str, str] | None = None,
    sweep: dict[str, Any] | None = None,
) -> Case:
    """Check the text of a case.

    Parameters
    ----------
    text : str
    file : str
        Name for messages.
    folder : str, optional
        Folder of the files that the case names. Default: that of `file`.
    files : dict of str to str, optional
        Names there of the files that the case names, where they have others.
    sweep : dict, optional
        In the place of its table [sweep].

    Raises
    ------
    CaseError
        See `read_case`.
    """
    folder = os.path.dirname(os.path.abspath(file)) if folder is None else folder
    data, lines = parse(text, file)
    if sweep is not None:
        data["sweep"] = sweep
    if files is not None:
        for path, name in _files(data).items():
            if name not in files:
                raise CaseError(file, [Problem(path, f"= {name!r} is not among the files kept")], lines)
            table: Any = data
            for key in path[:-1]:
                table = table[key]
            table[path[-1]] = files[name]
    return Case(_checked(data, file, folder, lines), data, text, file, folder, lines)


def _checked(data: dict[str, Any], file: str, folder: str, lines: Mapping[Path, int]) -> CaseTables:
    try:
        tables = CaseTables.model_validate(data)
    except ValidationError as error:
        raise CaseError(file, from_validation(error), lines) from None
    problems = contradictions(tables)
    if tables.sweep is not None:
        problems = _left_by_rows(problems, data, tables.sweep)
    problems += (
        Problem(path, f"= {name!r} does not exist in {folder!r}; name a file relative to the case file")
        for path, name in _files(data).items()
        if not os.path.isfile(os.path.join(folder, name))
    )
    if tables.sweep is not None and not problems:
        problems = list(parameter_problems(data, tables.sweep, CaseTables))
    if problems:
        raise CaseError(file, problems, lines)
    return tables


def _left_by_rows(problems: list[Problem], data: dict[str, Any], sweep: SweepTable) -> list[Problem]:
    """Contradictions of a case that neither the first nor the last row of its sweep mends by its values."""
    if not problems or any(problem.path[0] == "sweep" for problem in problems):
        return problems
    found = sweep.rows()
    for row in (found[0], found[-1]):
        try:
            there = contradictions(CaseTables.model_validate(replaced_in(data, row)))
        except ValueError:  # of its values, which are told by themselves
            return problems
        paths = {problem.path for problem in there}
        problems = [problem for problem in problems if problem.path in paths]
    return problems


def _files(data: dict[str, Any]) -> dict[Path, str]:
    """Paths in the case of the keys that name files, and what they name."""
    tables = ((path, table) for path, table in within(data) if isinstance(table, dict))
    return {
        (*path, "file"): table["file"]
        for path, table in tables
        if table.get("kind") in ("gmsh", "samples") and isinstance(table.get("file"), str)
    }


def _merged(file: str) -> list[str]:
    """Paths of files below its folder that a script of gmsh names in quotes, as it does what it merges or
    includes, and of those that they name.
    """
    found = [os.path.abspath(file)]
    for here in found:
        if here.endswith(".geo") and os.path.isfile(here):
            folder = os.path.dirname(here)
            with open(here, encoding="utf-8", errors="replace") as script:
                text = script.read()
            named = (os.path.normpath(os.path.join(folder, name)) for name in _QUOTED.findall(text))
            inside = (name for name in named if name.startswith(f"{folder}{os.sep}"))
            found += sorted({name for name in inside if os.path.isfile(name)} - set(found))
    return found[1:]
