"""A program on two ranks: every argument of every public function that works on ranks together, with another
and a wrong value on rank 1.

Prints a line a case: what came of it on both ranks. A case that hangs ends the program.
"""

from __future__ import annotations

import dataclasses
import faulthandler
import functools
import inspect
import json
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy.sparse
from mpi4py import MPI

import meshing
import sbfem_petsc as sb
from tests.fuzz import examples
from tests.study.small_case import CASE

WORLD = MPI.COMM_WORLD
SECONDS = 60
# Without a model a rank has no communicator to compare on: its error is its own, and ends the program.
LEADING = {"model", "motion", "branch", "modal", "fields", "cases", "result", "self"}
WRONG = "?"
Call = Callable[..., Any]


def cases() -> Iterator[tuple[str, Call, dict[str, Any], str, Any]]:
    """Owner, function, a call of it, the argument that differs on rank 1, and its value there; arguments that
    calls leave out once for each function.
    """
    seen = set()
    for owner, call, given in calls():
        for name, item in inspect.signature(call).parameters.items():
            if name in apart(call) or name == "comm" or name not in given and (owner, name) in seen:
                continue
            seen.add((owner, name))
            another = other(given.get(name, item.default))
            if another is not None:
                yield owner, call, given, name, another
            if name not in LEADING and (owner, name) != ("quasi_periodic_response", "guess"):
                yield owner, call, given, name, WRONG


def calls() -> Iterator[tuple[str, Call, dict[str, Any]]]:
    """Every function and method that compares its arguments, with those of a call that both ranks share."""
    public = examples.public()
    for owner in compared():
        if "." not in owner or owner.startswith(("plot.", "results.")):
            for make in (*examples.CALLS[owner], *examples.SHARED.get(owner, ())):
                if is_shared(owner, given := make()):
                    yield owner, public[owner], given
    for name in ("Static", "Modal", "LoadHistory", "Motion"):
        item = (examples.motion if name == "Motion" else examples.OBJECTS[name])()
        for method, call in inspect.getmembers(type(item), inspect.isfunction):
            if compares(call) and not method.startswith("_"):
                given = {
                    p: {"mode": 0, "time": 1e-5, "place": (0.03, 0.005)}.get(p, examples.ARGUMENTS.get(p))
                    for p, found in list(inspect.signature(call).parameters.items())[1:]
                    if found.default is found.empty
                }
                yield f"{name}.{method}", call, {"self": item, **given}


def compared() -> list[str]:
    """Public functions that compare their arguments."""
    return [name for name, item in examples.public().items() if compares(item)]


def compares(item: Any) -> bool:
    """Whether the arguments of a call are compared."""
    return hasattr(item.__init__ if inspect.isclass(item) else item, "own")


def apart(call: Call) -> set[str]:
    """Arguments that each rank may have of its own; the mesh of a model is compared where all have one."""
    own = set((call.__init__ if inspect.isclass(call) else call).own)
    return own - {"mesh"} if call is sb.Model else own


def is_shared(owner: str, given: dict[str, Any]) -> bool:
    """Whether a call is of a model that both ranks share, or of what was computed with it."""
    from sbfem_petsc.ranks.parallel import ranks_of

    if owner == "Model" or "comm" in inspect.signature(examples.public()[owner]).parameters:
        return owner != "basins" or isinstance(given["model"], sb.Model)
    return any(comm is not None and comm.size > 1 for comm in map(ranks_of, given.values()))


@functools.cache
def another_model() -> sb.Model:
    return sb.Model(examples.mesh(), sb.Material(71e9, 0.33, 2700), damping=0.02)


def other(value: Any) -> Any:
    """Another value of the same kind; None where there is none."""
    if value is None or isinstance(value, MPI.Comm):
        return None
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + "2"
    if isinstance(value, (int, float, np.ndarray)):
        return value * 2 + 1
    if isinstance(value, sb.Model):
        return another_model()
    if isinstance(value, sb.FiniteElementModel):
        arguments = examples.body_arguments()
        return sb.FiniteElementModel(**{**arguments, "mass": 2.0 * arguments["mass"]})
    if scipy.sparse.issparse(value):
        return 2.0 * value
    if isinstance(value, meshing.BoundaryMesh):
        return meshing.Beam(0.1, 0.011).mesh(order=2)
    if isinstance(value, dict):
        return {key: other(item) if k == 0 else item for k, (key, item) in enumerate(value.items())} or None
    if isinstance(value, (tuple, list)):
        return type(value)([other(value[0]), *value[1:]]) if len(value) else type(value)([1.0])
    if callable(value):
        return lambda *_: 2.0
    assert dataclasses.is_dataclass(value), value
    for field in dataclasses.fields(value):
        changed = other(getattr(value, field.name))
        if field.compare and changed is not None and field.init:
            return changed_in(value, field.name, changed)
    return None


def changed_in(value: Any, name: str, item: Any) -> Any:
    """A copy of an object with another attribute, whatever checks its class has."""
    result = object.__new__(type(value))
    for field in dataclasses.fields(value):
        object.__setattr__(result, field.name, getattr(value, field.name))
    object.__setattr__(result, name, item)
    return result


def outcome(call: Call, given: dict[str, Any]) -> str:
    """The error's sentence, or that there was a result."""
    try:
        call(**given)
    except (ValueError, TypeError, KeyError, RuntimeError) as error:
        return f"{type(error).__name__}: {error}"
    return "result"


def main() -> None:
    first, spare = int(sys.argv[1]), sys.argv[2]
    warnings.simplefilter("ignore")
    os.chdir(WORLD.bcast(tempfile.mkdtemp(dir=spare) if WORLD.rank == 0 else None))
    found = sorted({owner for owner, *_ in calls()})
    if WORLD.rank == 0:
        os.makedirs("given")
        with open("given/small.toml", "w", encoding="utf-8") as file:
            file.write(CASE)
        print(json.dumps({"functions": found}), flush=True)
    for number, (owner, call, given, name, value) in enumerate(cases()):
        if number < first:
            continue
        if WORLD.rank == 0:
            case = {"begun": number, "owner": owner, "name": name, "wrong": value is WRONG}
            print(json.dumps(case), flush=True)
        faulthandler.dump_traceback_later(SECONDS, exit=True)
        said = WORLD.allgather(outcome(call, {**given, name: value} if WORLD.rank == 1 else given))
        faulthandler.cancel_dump_traceback_later()
        if WORLD.rank == 0:
            print(json.dumps({"ended": number, "said": said}), flush=True)


if __name__ == "__main__":
    main()
