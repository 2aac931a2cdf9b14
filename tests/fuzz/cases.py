"""Cases by inspection: every argument of every public function and method with every value, and what
becomes of them.
"""

from __future__ import annotations

import contextlib
import inspect
import linecache
import os
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import meshing
import sbfem_petsc
from sbfem_petsc.study.case.problems import CaseError

from .examples import ARGUMENTS, CALLS, INTERNAL, NOT_CALLED, OBJECTS, public
from .values import FEW, SLOW, USERS, VALUES, must_be_refused

ROOMS = tuple(os.path.dirname(package.__file__) + os.sep for package in (meshing, sbfem_petsc))
KINDS = (ValueError, TypeError, KeyError, RuntimeError)
VARIADIC = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
SECONDS = 20.0
POINTS = ("point", "points", "place", "start", "end")
OWNERS = {name.split(".")[-1] for name in public()}


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

    def outcome(self) -> tuple[str, str]:
        """What came of it: "result", "sentence", or a failure ("silent", "raw", "late") and its
        description.
        """
        value = VALUES[self.label]
        try:
            with _limited(SECONDS), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = self.call(**{**self.given, self.parameter.name: value})
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
        frame = traceback.extract_tb(error.__traceback__)[-1]
        ours = frame.filename.startswith(ROOMS) or "<string>" in frame.filename
        line = linecache.getline(frame.filename, frame.lineno or 0)
        text = str(error)
        if USERS in text or (self.label == "function" and self.parameter.name == "work"):
            return "sentence", ""  # the user's own function failed
        value = VALUES[self.label]
        names = (self.parameter.name, self.owner.split(".")[-1])
        with contextlib.suppress(ValueError):  # Python's limit for the digits of a number
            names = (*names, str(value) or repr(value), repr(value))
        if self.parameter.name in POINTS:
            names = (*names, "point")
        named = text.split(":")[0] in OWNERS or any(
            name.strip("_").replace("_", " ") in text.replace("_", " ") for name in names
        )
        if not ours or "raise" not in line:
            return "raw", _described(error)
        # a case's faults are listed a line each
        if (
            ("\n" in text and not isinstance(error, CaseError))
            or len(text) > 600
            or not (named or text == self.usual())
        ):
            return "unnamed", _described(error)
        return "sentence", ""


def cases() -> Iterator[Case]:
    """Every case."""
    for name in dict.fromkeys([*CALLS, *OBJECTS]):
        yield from cases_of(name)


def cases_of(name: str) -> Iterator[Case]:
    """Those of a function, or of a class and its methods."""
    for make in CALLS.get(name, []):
        yield from _of(name, public()[name], make())
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


def _of(owner: str, call: Callable[..., Any], given: dict[str, Any]) -> Iterator[Case]:
    for name, parameter in inspect.signature(call).parameters.items():
        if parameter.kind in VARIADIC:
            continue
        if owner in CALLS and name not in given:
            continue
        for label in FEW if owner.startswith(SLOW) and owner != "estimate_error" else VALUES:
            yield Case(owner, call, given, parameter, label)


def without_example() -> list[str]:
    """Public names that nobody has given an example of, and arguments that no example has."""
    found = []
    for name, item in public().items():
        if name in NOT_CALLED:
            continue
        if name not in CALLS and name not in OBJECTS:
            found.append(name)
        elif name in CALLS:
            known = {argument for make in CALLS[name] for argument in make()}
            for argument in inspect.signature(item).parameters.values():
                if argument.kind not in VARIADIC and argument.name not in known:
                    found.append(f"{name}({argument.name})")
    for name, make in OBJECTS.items():
        for method, call, given in methods(name, make()):
            for argument in inspect.signature(call).parameters.values():
                if (
                    argument.default is argument.empty
                    and argument.name not in given
                    and argument.kind not in VARIADIC
                ):
                    found.append(f"{name}.{method}({argument.name})")
    return found


def _described(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if frame.filename.startswith(ROOMS)] or frames
    place = f"{os.path.relpath(ours[-1].filename)}:{ours[-1].lineno}"
    return f"{type(error).__name__}: {' '.join(str(error).split())[:160]} @ {place}"


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    def late(*_: Any) -> None:
        raise Late

    former = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, former)


assert MPI.COMM_WORLD.size == 1  # one rank's errors only; `tests/system/test_ranks.py` has the others
