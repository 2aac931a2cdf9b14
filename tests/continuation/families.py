"""A small run of each family that is followed into a file."""

from __future__ import annotations

import functools
import os
import signal

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.motion.files import run_file
from tests.systems import beside_another, two_masses

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


def backbone(**file):
    """Free motions over two turns; their states, frequencies and energies."""
    found = sb.backbone(two_masses(0.0), 1, 0.2, 3.0, steps=128, interactions=True, **file)
    return np.column_stack([found.states, found.frequency, found.energy]), found.reason


@functools.cache
def motion():
    """A small motion with a tone of its own."""
    branch = sb.frequency_response(
        two_masses(0.02, compliance=0.1), [0.1], 0.607 / TURN, 0.602 / TURN, steps=256
    )
    point = next(item for item in branch.bifurcations if item.kind == "Neimark-Sacker")
    return sb.switch_branch(branch, point, samples=7)


def tori(end=0.6025, **file):
    """A branch of such motions through a change of its samples: their states at the first phase, frequencies,
    lines and exponents.
    """
    found = sb.quasi_periodic_response(motion(), end / TURN, **file)
    assert found.motions[0].samples < found.motions[-1].samples
    states = [np.append(item.states[0], item.exponents) for item in found.motions]
    lines = abs(found.line(0, 1, "1"))
    return np.column_stack([states, lines, found.frequencies, found.value]), found.reason


def leaps(**file):
    """Free motions over interactions that are passed over; their states, frequencies and energies."""
    found = sb.backbone(beside_another(0.01, 3.5), 1, 0.4, 20.0, steps=256, refine=False, **file)
    return np.column_stack([found.states, found.frequency, found.energy]), (found.reason, found.passed)


def response(**file):
    """A curve over the frequency."""
    return _told(sb.frequency_response(two_masses(), [0.1], 0.5 / TURN, 0.6 / TURN, steps=128, **file))


def over_damping(**file):
    """A curve over the damping."""
    asked = {"start": 0.5, "stop": 1.5, "steps": 128, "parameter": "damping"}
    return _told(sb.load_response(two_masses(), [0.1], 0.57 / TURN, **asked, **file))


def unreduced(points=5, **file):
    """Some points over the frequency of a body without modes."""
    asked = {"steps": 49, "points": points, "reduction": None}
    return _told(sb.frequency_response(body(), sb.PointForce("A", fy=3e3), 1300.0, 1330.0, **asked, **file))


@functools.cache
def body():
    shape = Beam(0.1, 0.02, (VNotch(0.04, 0.008, 0.5),))
    material = sb.Material(young=70e9, poisson=0.33, density=2700)
    ratios = sb.rayleigh_factors(1000.0, 0.1, 9000.0, 0.1)
    return sb.Model(shape.mesh(order=2, face_edges=2), material, rayleigh=ratios)


def _told(found):
    """What a branch is: values, states, amplitudes, iterations; and why it ends."""
    told = found.states, found.point_amplitudes, found.iterations, found.value
    return np.column_stack(told), (found.reason,)


FAMILIES = {
    "locus": locus,
    "response": response,
    "damping": over_damping,
    "unreduced": unreduced,
    "backbone": backbone,
    "leaps": leaps,
    "tori": tori,
}


def values(path: str) -> np.ndarray:
    """The last column of what a file holds."""
    found = sb.read(path)
    return found.energy if isinstance(found, sb.Backbone) else found.value


def killed(kind: str, path: str, after: int, **asked) -> None:
    """Follow a family into a file, and end by SIGKILL at so many points."""
    run_file.PAUSE = 0.0
    told: list[float] = []

    def tell(done: float) -> None:
        told.append(done)
        if len(told) == after:
            os.kill(os.getpid(), signal.SIGKILL)

    FAMILIES[kind](**asked, file=path, resume=True, progress=tell)
