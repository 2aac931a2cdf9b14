"""Every argument of every public function and method with every value of a table, and every input that once
ended badly: a result, or one clear sentence.

The functions are found by inspection. A new one fails here until `examples` has a call of it; then it is
covered. What was done to files byte by byte stands with what reads them (`tests/results`, `tests/meshing`,
`tests/system/test_faults.py`).
"""

from __future__ import annotations

import faulthandler
import inspect
import resource
from collections.abc import Iterator

import numpy as np
import pytest

from . import cases, examples

MEMORY = 12 << 30  # bytes; an argument that asks for more ends in a MemoryError and not the machine


@pytest.fixture(scope="module", autouse=True)
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A folder with what is read, a limit of memory and, should compiled code not return, an end of the
    process.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("fuzz"))
        examples.write_files()
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY if hard < 0 else min(MEMORY, hard), hard))
        faulthandler.dump_traceback_later(900, exit=True)
        yield
        faulthandler.cancel_dump_traceback_later()
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def test_every_public_function_has_an_example():
    assert cases.without_example() == []


def test_there_are_enough_cases():
    assert sum(1 for owner in cases.OWNERS for _ in cases.cases_of(owner)) >= 45_000
    assert len({case.expression for lines in cases.known().values() for case in lines}) >= 494


@pytest.mark.slow
@pytest.mark.parametrize("owner", cases.OWNERS)
@pytest.mark.parametrize("long", [False, pytest.param(True, marks=pytest.mark.long)])
def test_result_or_sentence(owner, long):
    """No argument is accepted that cannot have a meaning, nothing ends in an error from below, nothing
    hangs: of those by inspection one in ten, drawn by its name, and the others in the long set.
    """
    outcomes = {str(case): case.outcome() for case in cases.cases_of(owner) if case.long == long}
    failed = {name: found for name, found in outcomes.items() if found[0] not in ("result", "sentence")}
    assert not failed, "\n".join(f"{kind}: {name}: {text}" for name, (kind, text) in failed.items())


def silent(points: int) -> float:
    return 1.0


def raw(points: int) -> float:
    return points + np.float64(1.0)


def nameless(points: int) -> float:
    raise ValueError("bad input")


@pytest.mark.parametrize(
    "call, label, expected", [(silent, "'a'", "silent"), (raw, "'a'", "raw"), (nameless, "1", "raw")]
)
def test_the_judge_finds_faults(call, label, expected):
    parameter = inspect.signature(call).parameters["points"]
    parameter = parameter.replace(annotation="int")
    assert cases.Case("judged", call, {}, parameter, label).outcome()[0] == expected
