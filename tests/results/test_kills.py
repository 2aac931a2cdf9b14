"""Runs of each kind that keeps a file, killed at bytes chosen by chance (`tests.kills` does any number)."""

import subprocess
import sys

import pytest

from tests.kills import KINDS
from tests.parallel import ROOT

QUICK = ("reduced", "direct", "sweep")


@pytest.mark.long
@pytest.mark.parametrize("kinds", [QUICK, ("response", "damping", "locus")], ids=",".join)
def test_killed_at_any_byte(kinds):
    """Nothing is lost beyond the last frame; what goes on ends where an undisturbed run does, bit by bit."""
    assert set(kinds) <= set(KINDS)
    run = [sys.executable, "-m", "tests.kills", ",".join(kinds), "3"]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("none lost, all resumed bitwise") == len(kinds)
