"""The stored numbers hold, on one rank and on two; what moves is told."""

import math
import sys

import pytest

from tests.numbers import GROUPS, table
from tests.numbers.__main__ import main
from tests.numbers.table import Group, Number, compare
from tests.parallel import on_ranks

# Groups that take more than three seconds.
DEAR = ("basins", "curves", "fields", "free", "histories", "loci", "orbits", "unreduced")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if name in DEAR else ()) for name in GROUPS]
)
def test_stored_numbers(name):
    moved = [text for distance, text in compare(GROUPS[name], GROUPS[name].compute()) if distance > 1.0]
    assert not moved, "\n".join(moved)


@pytest.mark.long
def test_two_ranks():
    """The same to the same tolerances."""
    program = "import sys; from tests.numbers.__main__ import main; sys.exit(main())"
    done = on_ranks(2, program, "--only", "statics", "--only", "fracture", "--only", "orbits")
    assert ", 0 moved" in done.stdout


@pytest.fixture
def group(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "STORED", tmp_path)
    made = Group("made", 1e-3, "A reason.")
    made.case(lambda: [("one", 2.0), ("none", None), ("vector", [1.0, 1e-9]), ("part", 1j), ("yes", True)])
    return made


def numbers(group):
    return list(group.compute())


def test_numbers_return_from_their_file(group):
    """Entries of a vector are held to its largest, a complex number in its parts."""
    group.write(numbers(group))
    assert group.file.read_text().startswith("# A reason.\n")
    names = ["one", "none", "vector.1", "vector.2", "part.1", "part.2", "yes"]
    assert list(group.stored()) == [f"<lambda>.{name}" for name in names]
    assert group.stored()["<lambda>.vector.2"] == Number("<lambda>.vector.2", 1e-9, 1e-3, True)
    assert [distance for distance, _ in compare(group, numbers(group))] == [0.0] * 7


def test_what_moves_is_told(group):
    group.write(numbers(group))
    group.cases = {"<lambda>": lambda: [("one", 2.003), ("none", 1.0), ("vector", [1.0, 0.0]), ("new", 1.0)]}
    group.case(broken)
    told = {text: distance for distance, text in compare(group, numbers(group)) if distance > 1.0}
    assert "made: <lambda>.one 2 -> 2.003, 1.5e-03 of it, 1.5 tolerances" in told
    assert "made: <lambda>.new is new: 1" in told and "made: <lambda>.yes is gone" in told
    assert "made: broken failed: ValueError: so" in told
    assert sorted(told.values())[1:] == [math.inf] * 6
    # what holds keeps its digits, what has moved gets its new ones
    group.cases = {"<lambda>": lambda: [("one", 2.001), ("none", 1.0)]}
    group.write(numbers(group))
    assert [number.value for number in group.stored().values()] == [2.0, 1.0]


def broken():
    raise ValueError("so")


def test_the_command(group, monkeypatch, capsys):
    monkeypatch.setattr("tests.numbers.__main__.GROUPS", {"made": group})
    for arguments, code, said in (
        (["--write"], 0, "7 numbers, 7 moved"),
        ([], 0, "7 numbers, 0 moved"),
        (["--only", "made", "--all"], 0, "one 2 -> 2"),
    ):
        monkeypatch.setattr(sys, "argv", ["numbers", *arguments])
        assert main() == code
        assert said in capsys.readouterr().out
    group.cases = {"<lambda>": lambda: [("one", 3.0)]}
    monkeypatch.setattr(sys, "argv", ["numbers"])
    assert main() == 1
