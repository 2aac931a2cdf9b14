"""The one writer of files at once: whole or not at all, whatever happens on the way."""

import os
import signal
import stat
import subprocess
import sys

import pytest

from meshing.whole_file import replaced
from sbfem_petsc.output_folder import UNFINISHED


def fill(path, text, what="table"):
    with replaced(str(path), what) as temporary:
        with open(temporary, "w") as file:
            file.write(text)


def test_a_new_file_and_one_that_is_replaced(tmp_path):
    path = tmp_path / "table.csv"
    before = os.umask(0o027)
    try:
        fill(path, "first")
    finally:
        os.umask(before)
    assert path.read_text() == "first" and stat.S_IMODE(path.stat().st_mode) == 0o640
    path.chmod(0o604)
    fill(path, "second")
    assert path.read_text() == "second" and stat.S_IMODE(path.stat().st_mode) == 0o604
    assert os.listdir(tmp_path) == ["table.csv"]


def test_a_link_stays_and_its_goal_is_replaced(tmp_path):
    (tmp_path / "goal").mkdir()
    goal, link = tmp_path / "goal" / "table.csv", tmp_path / "link.csv"
    goal.write_text("first")
    link.symlink_to(goal)
    fill(link, "second")
    assert link.is_symlink() and goal.read_text() == "second"
    link.unlink()
    link.symlink_to(tmp_path / "goal" / "new.csv")  # of a goal that is not there yet
    fill(link, "third")
    assert (tmp_path / "goal" / "new.csv").read_text() == "third"


@pytest.mark.parametrize("error", [ValueError("mine"), KeyboardInterrupt(), OSError(28, "No space left")])
def test_a_failure_leaves_the_former_file(tmp_path, error):
    path = tmp_path / "table.csv"
    path.write_text("first")
    with pytest.raises((ValueError, KeyboardInterrupt)) as caught:
        with replaced(str(path), "table") as temporary:
            with open(temporary, "w") as file:
                file.write("second")
            raise error
    assert path.read_text() == "first" and os.listdir(tmp_path) == ["table.csv"]
    if isinstance(error, OSError):
        assert str(caught.value) == f"table {str(path)!r} cannot be written: No space left"


@pytest.mark.parametrize("kind", ["folder", "pipe", "link to a folder"])
def test_what_is_no_file_is_not_replaced(tmp_path, kind):
    path = tmp_path / "table.csv"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        (tmp_path / "goal").mkdir()
        path.symlink_to(tmp_path / "goal")
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(ValueError, match="table .* cannot be written: .* is (a folder|no regular file)"):
        fill(path, "second")
    assert sorted(os.listdir(tmp_path)) == before


def test_nothing_written_is_a_sentence(tmp_path):
    with pytest.raises(ValueError, match="cannot be written: No such file"):
        with replaced(str(tmp_path / "table.csv"), "table"):
            pass
    assert os.listdir(tmp_path) == []


KILLED = """
import os, signal, sys
from meshing.whole_file import replaced
with replaced(sys.argv[1], "table") as temporary:
    with open(temporary, "w") as file:
        file.write("second")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_kill_leaves_the_former_file_and_a_folder_that_is_known_by_its_name(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("first")
    for _ in range(2):
        run = subprocess.run([sys.executable, "-c", KILLED, str(path)], timeout=300)
        assert run.returncode == -signal.SIGKILL
    left = [name for name in os.listdir(tmp_path) if name != "table.csv"]
    assert len(left) == 2 and all(UNFINISHED.fullmatch(name)[1] == "table.csv" for name in left)
    assert path.read_text() == "first"
    fill(path, "third")
    assert path.read_text() == "third"
