"""What threads may do: import any module; everything that touches PETSc belongs to one of them."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_two_threads_import_any_two_modules():
    """A hundred pairs with the race between the threads forced."""
    program = [sys.executable, str(Path(__file__).with_name("race.py")), "100", "0"]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, timeout=500)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
