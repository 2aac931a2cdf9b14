"""Cases: every argument of every public function and method, by inspection, with every value, and the
inputs of `known_inputs.txt`, which once ended in an error from below, in a wrong number or never; what
becomes of them.
"""

from __future__ import annotations

import contextlib
import inspect
import linecache
import os
import pathlib
import signal
import traceback
import warnings
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import meshing
import sbfem_petsc
from sbfem_petsc.study.case.problems import CaseError

from .examples import ARGUMENTS, CALLS, INTERNAL, NOT_CALLED, OBJECTS, names, public
from .values import FEW, SLOW, USERS, VALUES, must_be_refused

ROOMS = tuple(os.path.dirname(package.__file__) + os.sep for package in (meshing, sbfem_petsc))
KINDS = (ValueError, TypeError, KeyError, RuntimeError)
VARIADIC = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
SECONDS = 20.0
POINTS = ("point", "points", "place", "start", "end")
NAMES = {name.split(".")[-1] for name in public()}
# Headings of known inputs that are left to the long set, as are nine of ten cases by inspection.
LONG = ("Files that are written", "Results of other models")
# Python's own sentences for a call with other arguments than there are.
ITS_OWN = ("unexpected keyword argument", "positional argument")


class Late(BaseException):
    """A case takes too long."""


@dataclass(frozen=True)
class Case:
    """One call with one argument replaced."""

    owner: str
    call: Callable[..., Any]
    given: dict[str, Any]
    parameter: inspect.Parameter
    label: str

    def __str__(self) -> str:
        return f"{self.owner}({self.parameter.name}={self.label})"

    @property
    def long(self) -> bool:
        """Whether it is none of the tenth that is drawn by name for the ordinary suite."""
        return bool(zlib.crc32(str(self).encode()) % 10)

    def outcome(self) -> tuple[str, str]:
        """What came of it: "result", "sentence", or a failure ("silent", "raw", "late") and its
        description.
        """
        value = VALUES[self.label]
        try:
            with _limited(SECONDS), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = self.call(**{**self._kept(), self.parameter.name: value})
                repr(result)
        except Late:
            return "late", f"no answer in {SECONDS:g} s"
        except KINDS as error:
            return self._judged(error)
        except Exception as error:
            if USERS in str(error):
                return "sentence", ""
            return "raw", _described(error)
        if must_be_refused(self.parameter, value):
            return "silent", " ".join(repr(result).split())[:100]
        return "result", ""

    def _kept(self) -> dict[str, Any]:
        """What is given beside the value; a file, four fifths of what such a call costs, in the drawn tenth
        and where it is resumed from.
        """
        without = self.long and self.parameter.name != "resume"
        return {name: value for name, value in self.given.items() if not (without and name == "file")}

    def usual(self) -> str:
        """The error of the call as it is, such as that of a file which is not there."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                self.call(**self.given)
            except KINDS as error:
                return str(error)
        return ""

    def _judged(self, error: Exception) -> tuple[str, str]:
        text = str(error)
        if USERS in text or (self.label == "function" and self.parameter.name == "work"):
            return "sentence", ""  # the user's own function failed
        value = VALUES[self.label]
        names = (self.parameter.name, self.owner.split(".")[-1])
        with contextlib.suppress(ValueError):  # Python's limit for the digits of a number
            names = (*names, str(value) or repr(value), repr(value))
        if self.parameter.name in POINTS:
            names = (*names, "point")
        named = text.split(":")[0] in NAMES or any(
            name.strip("_").replace("_", " ") in text.replace("_", " ") for name in names
        )
        if not _raised_here(error):
            return "raw", _described(error)
        if not (_is_sentence(error) and (named or text == self.usual())):
            return "unnamed", _described(error)
        return "sentence", ""


@dataclass(frozen=True)
class Known:
    """An expression that once ended badly, and why it is right as it is, if it is."""

    expression: str
    reason: str
    long: bool

    def __str__(self) -> str:
        return self.expression

    def outcome(self) -> tuple[str, str]:
        """As that of a `Case`; a result without a reason is a failure."""
        try:
            with _limited(SECONDS), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = eval(self.expression, names())
                repr(result)
        except Late:
            return "late", f"no answer in {SECONDS:g} s"
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            called = frame.filename == "<string>" or frame.line == "return function(*args, **kwargs)"
            if isinstance(error, ZeroDivisionError) and frame.filename == "<string>":
                return "sentence", ""  # the user's own function failed
            if isinstance(error, TypeError) and called:
                known = any(words in str(error) for words in ITS_OWN)
            else:
                known = isinstance(error, KINDS) and _raised_here(error) and _is_sentence(error)
            return ("sentence", "") if known else ("raw", _described(error))
        return ("result", "") if self.reason else ("silent", " ".join(repr(result).split())[:100])


def known() -> dict[str, list[Known]]:
    """The known inputs by their headings, one a line, with the reason behind a #."""
    found: dict[str, list[Known]] = {}
    for line in pathlib.Path(__file__).with_name("known_inputs.txt").read_text().splitlines():
        if line.startswith("# "):
            heading = line[2:]
        elif line:
            expression, _, reason = line.partition("  # ")
            found.setdefault(heading, []).append(Known(expression, reason, heading in LONG))
    return found


OWNERS = list(dict.fromkeys([*CALLS, *OBJECTS, *known()]))


def cases_of(name: str) -> Iterator[Case | Known]:
    """Those of a function, or of a class and its methods; or the known inputs under a heading."""
    yield from known().get(name, [])
    for k, make in enumerate(CALLS.get(name, [])):
        yield from _of(name, public()[name], make(), whole=k == 0)
    if name in OBJECTS:
        for method, call, given in methods(name, OBJECTS[name]()):
            yield from _of(f"{name}.{method}", call, given)


def methods(name: str, item: Any) -> Iterator[tuple[str, Callable[..., Any], dict[str, Any]]]:
    """Public methods with arguments, bound, and a legitimate call of each."""
    for method, call in inspect.getmembers(item, callable):
        if method.startswith("_") or method in INTERNAL.get(name, ()) or not inspect.isroutine(call):
            continue
        parameters = inspect.signature(call).parameters.values()
        given = {}
        for parameter in parameters:
            known = f"{name}.{method}.{parameter.name}"
            if known in ARGUMENTS or (parameter.default is parameter.empty and parameter.name in ARGUMENTS):
                given[parameter.name] = ARGUMENTS.get(known, ARGUMENTS.get(parameter.name))
        if len(parameters):
            yield method, call, given


def _of(owner: str, call: Callable[..., Any], given: dict[str, Any], whole: bool = True) -> Iterator[Case]:
    """With each argument, or with each that is given, replaced."""
    for name, parameter in inspect.signature(call).parameters.items():
        if parameter.kind in VARIADIC or not (whole or name in given):
            continue
        for label in FEW if owner.startswith(SLOW) and owner != "estimate_error" else VALUES:
            yield Case(owner, call, given, parameter, label)


def without_example() -> list[str]:
    """Public names that nobody has given an example of, and arguments without a default that none has."""
    found = []
    for name, item in public().items():
        if name in NOT_CALLED:
            continue
        if name not in CALLS and name not in OBJECTS:
            found.append(name)
        elif name in CALLS:
            found += [f"{name}({argument})" for argument in missing(item, CALLS[name][0]())]
    for name, make in OBJECTS.items():
        for method, call, given in methods(name, make()):
            found += [f"{name}.{method}({argument})" for argument in missing(call, given)]
    return found


def missing(call: Callable[..., Any], given: dict[str, Any]) -> list[str]:
    """Arguments without a default that a call lacks."""
    parameters = inspect.signature(call).parameters.values()
    asked = [p.name for p in parameters if p.default is p.empty and p.kind not in VARIADIC]
    return [name for name in asked if name not in given]


def _raised_here(error: BaseException) -> bool:
    """By a statement of this package, or of an expression."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    ours = frame.filename.startswith(ROOMS) or "<string>" in frame.filename
    return ours and "raise" in linecache.getline(frame.filename, frame.lineno or 0)


def _is_sentence(error: Exception) -> bool:
    """On one line; a case's faults are listed a line each."""
    return len(str(error)) <= 600 and ("\n" not in str(error) or isinstance(error, CaseError))


def _described(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if frame.filename.startswith(ROOMS)] or frames
    place = f"{os.path.relpath(ours[-1].filename)}:{ours[-1].lineno}"
    return f"{type(error).__name__}: {' '.join(str(error).split())[:160]} @ {place}"


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    def late(*_: Any) -> None:
        raise Late

    former = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)  # of this process: others may have the cores meanwhile
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, former)


assert MPI.COMM_WORLD.size == 1  # one rank's errors only; `tests/system/test_ranks.py` has the others
