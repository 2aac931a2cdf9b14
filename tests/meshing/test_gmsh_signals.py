"""gmsh leaves a program's handlers of signals alone."""

import subprocess
import sys

from tests.parallel import ROOT

PROGRAM = """
import os, signal
from meshing import Beam
signal.signal(signal.SIGTERM, lambda *_: print("met"))
Beam(0.1, 0.0137).mesh(order=1)
os.kill(os.getpid(), signal.SIGTERM)
"""


def test_handlers_stand_after_a_mesh():
    """The PETSc inside gmsh takes them away, so that SIGTERM ended a program without its own word."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert (done.returncode, done.stdout) == (0, "met\n"), done.stderr
