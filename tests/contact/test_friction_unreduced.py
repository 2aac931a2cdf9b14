"""Friction in histories of the unreduced model: the reduced one, energies, the law, files and ranks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

import sbfem_petsc as sb
from meshing import CrackLine, Plate
from sbfem_petsc.motion.unreduced import history as unreduced
from tests.contact.test_friction import square
from tests.parallel import alone, answer, on_ranks

CRACK = [[(0.03, 0.035), (0.07, 0.065)]]


def pressed(plate, periods=6.0):
    """Pressed, let go and pressed again within some periods of the first mode: loads, duration (s)."""
    duration = periods / plate.modes(3).frequencies[0]
    time = np.linspace(0.0, duration, 2001)
    shape = PchipInterpolator([0.0, 0.4 * duration, 0.7 * duration, duration], [0.1, 1.0, 0.3, 0.9])
    return [sb.EdgeLoad("edge3", pressure=sb.Samples(time, 1e6 * shape(time)))], duration


@pytest.fixture(scope="module")
def plate():
    with square(CRACK, sb.Coulomb(0.2), order=2) as model:
        yield model


def obeys(found, coefficient):
    """Bounds, gaps and the sense of friction at every instant."""
    states, gaps = found.states, found.states.gaps
    along, slip = states.contact[:, gaps:], states.gap[:, gaps:]
    pairs = found.states.pairs
    pressing = found.contact_force
    assert (np.abs(found.friction_force) <= coefficient * pressing * (1 + 1e-9) + 1e-9 * pressing.max()).all()
    assert (states.gap[:, :gaps] >= -1e-12 * np.abs(states.gap).max()).all()
    moved = np.diff(slip, axis=0)
    assert (along[1:] * moved <= 1e-9 * np.abs(along).max() * np.abs(moved).max()).all()
    slips = np.abs(moved[:, :pairs]) > 1e-9 * np.abs(moved).max()
    most = coefficient * pressing[1:]
    assert np.abs(found.friction_force[1:])[slips] == pytest.approx(most[slips], abs=1e-9 * pressing.max())


@pytest.mark.long
def test_files_energies_and_the_law(plate, tmp_path, monkeypatch):
    """Energies are in balance to rounding, what friction takes never falls; a run that goes on from its file
    is the uninterrupted one to the last bit, and so is what is read.
    """
    monkeypatch.setattr(unreduced, "CHUNK", 40)

    def stop(done):
        if done > 0.4:
            raise KeyboardInterrupt

    load, duration = pressed(plate)
    options = {"reduction": None, "initial": "equilibrium"}
    file = str(tmp_path / "run.journal")
    whole = sb.transient(plate, load, duration, duration / 150, **options)
    with pytest.raises(KeyboardInterrupt):
        sb.transient(plate, load, duration, duration / 150, file=file, progress=stop, **options)
    gone_on = sb.transient(plate, load, duration, duration / 150, file=file, resume=True, **options)
    sb.save(tmp_path / "saved.h5", whole)
    for other in (gone_on, sb.read(file), sb.read(tmp_path / "saved.h5")):
        for name in ("slip", "friction_force", "gap", "contact_force", "contact_resultant"):
            assert np.array_equal(getattr(other, name), getattr(whole, name)), name
        assert np.array_equal(other.energy.friction, whole.energy.friction)
    energy = whole.energy
    assert (np.diff(energy.friction) >= 0.0).all() and energy.friction[-1] > 0.01 * energy.external.max()
    assert np.abs(energy.balance).max() < 1e-12 * energy.external.max()
    assert np.abs(energy.contact).max() < 1e-4 * energy.friction[-1]
    assert not np.array_equal(whole.slip[-1], whole.slip[0])
    obeys(whole, 0.2)
    apart = sb.transient(plate, load, duration / 10, duration / 150, reduction=None, contact=False)
    assert not apart.friction_force.any() and not apart.energy.friction.any()
    sb.transient(plate, load, 1e-6, 1e-7, reduction=None, file=file)
    with square(CRACK, sb.Coulomb(0.1), order=2) as other:
        with pytest.raises(ValueError, match="other friction"):
            sb.transient(other, load, 2e-6, reduction=None, file=file, resume=True)


@pytest.mark.long
def test_against_the_reduced_model(plate):
    """Average acceleration with mass on the faces against modes with massless ones, from above and below:
    slips, resultant, K_II and loss come closer with the steps. Measured at 600: 2.3e-2, 1.9e-2, 2.1e-2, 5e-3.
    """
    load, duration = pressed(plate)
    reduced = sb.transient(plate, load, duration, duration / 1200, modes=40, initial="equilibrium")
    errors = []
    for steps in (150, 600):
        found = sb.transient(plate, load, duration, duration / steps, reduction=None, initial="equilibrium")
        every, error = 1200 // steps, []
        for one, other in (
            (found.slip, reduced.slip),
            (found.contact_resultant, reduced.contact_resultant),
            (found.stress_intensity(), reduced.stress_intensity()),
        ):
            other = other[::every]
            error.append(np.abs(one - other).max() / np.abs(other).max())
        error.append(abs(found.energy.friction[-1] / reduced.energy.friction[-1] - 1.0))
        errors.append(error)
        obeys(found, 0.2)
    assert max(errors[1]) < 3e-2 and errors[1][-1] < 1e-2
    assert (np.array(errors[1]) < 0.6 * np.array(errors[0])).all()


def test_what_lands_sticks_where_it_lands():
    """The upper half of a plate is thrown up aslant, falls under a pressure, lands between two steps on soft
    layers and sticks under a friction beyond the coefficient of slips: in closed form. Held where it stood at
    the step's beginning it slips, its friction is .31 of its pressure, and .15 of its energy is lost.
    """
    pressure, compliance, mass, pull = 1e4, 1e-8, 2700.0 * 0.02, 0.5
    corners, middle = [(0, 0), (0.1, 0), (0.1, 0.04), (0, 0.04)], CrackLine([(0.0, 0.02), (0.1, 0.02)])
    law = sb.Coulomb(0.3, 0.9, compliance=compliance, tangential_compliance=compliance)
    rate = 1.0 / math.sqrt(mass * compliance)
    deepest = math.pi - math.atan(1.0 / (rate * compliance * pressure))
    with sb.Model(
        Plate(corners, cracks=[middle]).mesh(order=1),
        sb.Material(70e9, 0.33, 2700.0),
        clamped="edge1",
        supports=[sb.Support("edge3", x=1e3, y=1e3)],
        contact_laws=law,
    ) as plate:
        thrown = (None, lambda x, y: (np.where(y > 0.02, pull, 0.0), np.where(y > 0.02, 1.0, 0.0)))
        duration, step = 2.0 * mass / pressure + 2.8 * deepest / rate, math.pi / rate / 137
        load = sb.EdgeLoad("edge3", pressure=pressure)
        found = sb.transient(plate, load, duration, step, reduction=None, initial=thrown)
    pressing, along = found.contact_force.sum(axis=1), found.friction_force.sum(axis=1)
    most = np.argmax(pressing)
    depth = compliance * pressure * (1.0 - math.cos(deepest)) + math.sin(deepest) / rate
    assert -along[most] / pressing[most] == pytest.approx(pull * math.sin(deepest) / rate / depth, rel=2e-2)
    assert found.energy.friction[-1] < 0.01 * 0.5 * mass * 0.1
    assert np.abs(found.energy.balance).max() < 1e-8 * found.energy.kinetic[0]


RANKS = """
import json
import sbfem_petsc as sb
from mpi4py import MPI
from tests.contact.test_friction import square
from tests.contact.test_friction_unreduced import CRACK, pressed
with square(CRACK, sb.Coulomb(0.2), order=2) as plate:
    load, duration = pressed(plate)
    h = sb.transient(plate, load, duration, duration / 150, reduction=None, initial="equilibrium")
    names = ("slip", "friction_force", "contact_force")
    found = {name: getattr(h, name).tolist() for name in names}
    found["lost"] = h.energy.friction.tolist()
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


@pytest.mark.long
def test_two_ranks():
    """The same numbers to 1e-8, the same rows that slip."""
    one, two = alone(RANKS), answer(on_ranks(2, RANKS))
    for name, values in one.items():
        expected = np.array(values)
        assert np.array(two[name]) == pytest.approx(expected, abs=1e-8 * np.abs(expected).max()), name
