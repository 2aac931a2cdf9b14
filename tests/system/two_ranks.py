"""A program on two ranks: every argument of every analysis with a value on rank 1 that is another one, or a
wrong one.

Prints a line a case: what came of it on both ranks. A case that hangs ends the program.
"""

from __future__ import annotations

import faulthandler
import json
import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from mpi4py import MPI

import meshing
import sbfem_petsc as sb
from tests.fuzz import examples

WORLD = MPI.COMM_WORLD
SECONDS = 60
# What may differ between the ranks: what is told to a person.
OWN = {"progress"}
# A rank on a communicator of its own, or with what has none, is at another place of the program.
LEFT_OUT = {"comm", "model", "motion", "branch"}
WRONG = "?"


def cases() -> Iterator[tuple[str, dict[str, Any], str, str]]:
    """Owner, call, argument and kind of each case."""
    for owner, calls in (*examples.CALLS.items(), *examples.SHARED.items()):
        if owner in ("estimate_error", "estimate"):  # of a history of another model; a series of models
            continue
        for call in calls:
            given = call()
            if _is_shared(given) or owner == "Model":
                for name in given:
                    if name not in LEFT_OUT:
                        yield from ((owner, given, name, kind) for kind in ("other", "wrong"))


def _is_shared(given: dict[str, Any]) -> bool:
    """Whether a call is of a model that both ranks share, or of what was computed with it."""
    subject = given.get("model", given.get("motion", given.get("branch")))
    if isinstance(subject, (sb.Branch, sb.History, sb.Orbit)):
        subject = subject.reduced and subject.reduced.model
    return isinstance(subject, sb.Model)


def other(value: Any) -> Any:
    """Another value of the same kind."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, (int, float)):
        return type(value)(value * 2 + 1)
    if isinstance(value, sb.PointForce):
        return sb.PointForce("A", fy=2.0 * value.fy)
    if isinstance(value, sb.Material):
        return sb.Material(71e9, 0.33, 2700)
    if isinstance(value, meshing.BoundaryMesh):
        return meshing.Beam(0.1, 0.011).mesh(order=2)
    if value == "left":
        return "right"
    if isinstance(value, (tuple, list)) and value and all(isinstance(item, float) for item in value):
        return type(value)(1.5 * item + 0.1 for item in value)
    return None


def outcome(owner: str, given: dict[str, Any]) -> str:
    """The error's sentence, or the numbers of the result that all ranks have."""
    try:
        result = examples.public()[owner](**given)
    except (ValueError, TypeError, KeyError, RuntimeError) as error:
        return f"{type(error).__name__}: {error}"
    for name in ("frequencies", "amplitude", "displacement", "value", "unknowns"):
        found = getattr(result, name, None)
        if callable(found):
            found = found("A")
        if found is not None:
            return "result " + " ".join(f"{number:.6g}" for number in np.ravel(np.abs(found))[:50])
    return "result"


def main() -> None:
    first, spare = int(sys.argv[1]), sys.argv[2]
    warnings.simplefilter("ignore")
    os.chdir(WORLD.bcast(tempfile.mkdtemp(dir=spare) if WORLD.rank == 0 else None))
    for number, (owner, given, name, kind) in enumerate(cases()):
        if number < first:
            continue
        if WORLD.rank == 0:
            print(json.dumps({"begun": number, "case": f"{owner}({name}: {kind})"}), flush=True)
        faulthandler.dump_traceback_later(SECONDS, exit=True)
        value = WRONG if kind == "wrong" else other(given[name])
        told = outcome(owner, {**given, name: value} if WORLD.rank == 1 else given)
        said = WORLD.allgather(told)
        faulthandler.cancel_dump_traceback_later()
        if WORLD.rank == 0:
            same = said[0] == said[1] or name in OWN
            print(json.dumps({"ended": number, "same": same, "said": said}), flush=True)


if __name__ == "__main__":
    main()
