"""A family of motions that the package does not know, by one file of its own (`forced`): files, resumed runs
and events come with the continuation.
"""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sbfem_petsc.continuation.problem import Range
from sbfem_petsc.motion.files import run_file
from tests.parallel import ROOT

from .forced import Forced, follow_forced

# A mass on a spring x + a x^2 + b x^3, damped, under f cos(w t).
DAMPING, A, B, FORCE = 0.1, 1.0, 0.5, 1.2
FIRST, WITHIN = np.array([FORCE / (1.0 - 1.6**2), 0.0, 1.6]), Range(0.7, 1.6, -1)


def right(t, x, w):
    return np.array([x[1], FORCE * np.cos(w * t) - DAMPING * x[1] - x[0] - A * x[0] ** 2 - B * x[0] ** 3])


def slope(x):
    return np.array([[0.0, 1.0], [-1.0 - 2.0 * A * x[0] - 3.0 * B * x[0] ** 2, -DAMPING]])


def killed(path, after):
    """Follow it into a file, and end by SIGKILL at so many points."""
    run_file.PAUSE, told = 0.0, []

    def tell(share):
        told.append(share)
        if len(told) == after:
            os.kill(os.getpid(), signal.SIGKILL)

    follow_forced(Forced(right, slope), FIRST, WITHIN, path, progress=tell)


def multipliers(u):
    """Those of a motion, and how far it is from periodic, by SciPy's own integration and differences."""

    def end(state):
        span = 0.0, 2.0 * np.pi / u[-1]
        return solve_ivp(right, span, state, args=(u[-1],), rtol=1e-10, atol=1e-12).y[:, -1]

    steps = 1e-5 * np.eye(2)
    columns = [(end(u[:-1] + step) - end(u[:-1] - step)) / 2e-5 for step in steps]
    return np.linalg.eigvals(np.array(columns).T), np.abs(end(u[:-1]) - u[:-1]).max()


@pytest.mark.long
def test_files_resumed_runs_and_events(tmp_path):
    """Killed and resumed to the same points bit by bit; a multiplier is 1 at the fold, -1 at the doubling."""
    line, folds, doublings = follow_forced(Forced(right, slope), FIRST, WITHIN, str(tmp_path / "whole.h5"))
    assert line.complete and line.reason == "end of the range at 1.6" and len(folds) == len(doublings) == 1
    for point, expected in ((folds[0], 1.0), (doublings[0], -1.0)):
        found, missed = multipliers(point.u)
        assert missed < 1e-6  # of the steps: h^4
        assert np.abs(found - expected).min() < 1e-3
    path = str(tmp_path / "line.h5")
    program = f"from tests.continuation.test_another_family import killed; killed({path!r}, 4)"
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT).returncode == -signal.SIGKILL
    again, *_ = follow_forced(Forced(right, slope), FIRST, WITHIN, path, resume=True)
    np.testing.assert_array_equal([p.u for p in again.points], [p.u for p in line.points])
    with pytest.raises(ValueError, match="was written with upper = 1.6, not 1.7; resume with the same value"):
        follow_forced(Forced(right, slope), FIRST, Range(0.7, 1.7, -1), path, resume=True)
    with open(os.path.join(ROOT, "tests", "continuation", "forced.py")) as file:
        assert len(file.readlines()) <= 60
