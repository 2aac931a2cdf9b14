"""How many modules one thing passes through, followed while it runs."""

import os
import sys
from functools import partial

import numpy as np

import sbfem_petsc as sb
from sbfem_petsc.continuation import follow
from tests.systems import two_masses

TURN = 2.0 * np.pi
PACKAGE = os.path.dirname(sb.__file__) + os.sep


class Followed:
    """The package's functions that are called within a `with` block, with their arguments."""

    def __init__(self):
        self.calls = []

    def _note(self, frame, event, _):
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGE):
            names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            given = [frame.f_locals.get(name) for name in names]
            self.calls.append((code.co_filename.removeprefix(PACKAGE), code.co_name, given))

    def __enter__(self):
        sys.setprofile(self._note)
        return self

    def __exit__(self, *_):
        sys.setprofile(None)


def test_modules_of_a_corrected_point(monkeypatch):
    """Newton's method on a point of a response curve, with the motions and derivatives that it takes: at most
    twelve modules, whichever point.
    """
    correct, entered = follow.correct, []

    def watched(*arguments):
        with Followed() as found:
            point = correct(*arguments)
        entered.append({module for module, _, _ in found.calls})
        return point

    curve = partial(sb.frequency_response, two_masses(), [0.1], 0.5 / TURN, steps=256)
    curve(0.6 / TURN)  # kernels are loaded from disk, once in a process
    monkeypatch.setattr(follow, "correct", watched)
    branch = curve(0.6 / TURN)
    assert branch.contact_peak.max() > 0.0 and len(entered) >= len(branch.value) - 12
    assert max(map(len, entered)) <= 12, max(entered, key=len)


def test_stays_of_the_start():
    """The first frequency of a curve, as an argument from call to call until it is followed: at most fifteen
    functions in eight files.
    """
    start = 0.5 / TURN + 1e-9
    with Followed() as found:
        sb.frequency_response(two_masses(), [0.1], start, 0.51 / TURN, steps=64, points=3)
    stays = {
        (module, name)
        for module, name, given in found.calls
        if any(isinstance(value, float) and value == start for value in given)
    }
    assert len(stays) >= 5 and len(stays) <= 15, sorted(stays)
    assert len({module for module, _ in stays}) <= 8, sorted(stays)
