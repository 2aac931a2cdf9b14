"""A small run of each family that is followed into a file."""

from __future__ import annotations

import functools
import os
import signal

import numpy as np

import sbfem_petsc as sb
from sbfem_petsc.recording import kept_file
from tests.systems import two_masses

TURN = 2.0 * np.pi


@functools.cache
def curve():
    return sb.frequency_response(
        two_masses(0.02, compliance=0.1), [0.1], 0.6 / TURN, 0.62 / TURN, steps=128, stability=True
    )


def locus(**file):
    """A line of Neimark-Sacker points; its states, frequencies and factors."""
    point = next(item for item in curve().bifurcations if item.kind == "Neimark-Sacker")
    found = sb.locus(curve(), point, 0.9, 1.1, points=6, **file)
    return np.column_stack([found.states, found.frequency, found.value]), found.reasons


FAMILIES = {"locus": locus}


def killed(kind: str, path: str, after: int) -> None:
    """Follow a family into a file, and end by SIGKILL at so many points."""
    kept_file.PAUSE, told = 0.0, []

    def tell(done: float) -> None:
        told.append(done)
        if len(told) == after:
            os.kill(os.getpid(), signal.SIGKILL)

    FAMILIES[kind](file=path, resume=True, progress=tell)
