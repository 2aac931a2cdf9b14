"""Prescribed displacements in time of the unreduced model, and what its supports bear: a rod in closed form,
the ride of all supports, statics, files, other ranks.
"""

import numpy as np
import pytest

import sbfem_petsc as sb
from tests.analysis.test_moved_edges import (
    HEIGHT,
    LEFT,
    LENGTH,
    LOWER,
    MOVE,
    RIGHT,
    ROD,
    SPEED,
    burst,
    cracked,
    held_plate,
    rod,
)
from tests.parallel import answer, on_ranks

PROGRAM = """
import json
from mpi4py import MPI
from tests.analysis.test_moved_edges_unreduced import shared
found = shared()
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


def test_pulse_in_a_rod():
    """The wave goes out, comes back from the free end with the same sign, and the support bears E A v / c and
    does the work of that; the balance of energies has no error but rounding.
    """
    length, late = 3e-5, LENGTH / SPEED

    def pulse(t):
        return MOVE * np.where((t > 0.0) & (t < length), np.sin(np.pi * t / length) ** 4, 0.0)

    with rod(False) as model:
        load = sb.EdgeMotion(LEFT, ux=sb.Custom(pulse, highest_frequency=2.0 / length))
        found = sb.transient(model, load, 7.5e-5, 1e-7, reduction=None)
        inside = found.along((0.031, 0.007), (0.177, 0.015), count=5)
    time, rate = found.time, np.gradient(pulse(found.time), found.time)
    assert np.abs(found.displacement("end")[:, 0] - 2.0 * pulse(time - late)).max() < 1e-3 * MOVE
    middle = pulse(time - 0.5 * late) + pulse(time - 1.5 * late)
    assert np.abs(found.displacement("middle")[:, 0] - middle).max() < 1e-3 * MOVE
    for force, exact in ((found.reaction(LEFT), rate), (found.reaction(RIGHT), 0.0 * rate)):
        error = force[:, 0] - ROD.young * HEIGHT / SPEED * exact
        assert np.abs(error).max() < 1e-3 * ROD.young * HEIGHT / SPEED * rate.max()
    work = ROD.young * HEIGHT / SPEED * np.sum(rate**2) * found.step
    assert found.energy.external[-1] == pytest.approx(work, rel=1e-5)
    assert found.energy_error < 1e-10
    # inside cells, whose inertia acts there
    for (x, _), u, stress in zip(inside[0], *(np.moveaxis(part[..., 0], 1, 0) for part in inside[1:])):
        gone, back = x / SPEED, 2.0 * late - x / SPEED
        assert np.abs(u - pulse(time - gone) - pulse(time - back)).max() < 1e-3 * MOVE
        exact = np.interp(time - back, time, rate) - np.interp(time - gone, time, rate)
        error = stress - ROD.young / SPEED * exact
        assert np.abs(error).max() < 3e-3 * ROD.young / SPEED * rate.max()


@pytest.mark.long
def test_all_supports_ride():
    """With contact: the same as their acceleration, but for the ride itself: displacements, rates, forces."""
    model, options = cracked(), {"step": 4e-6, "modes": 20, "reduction": None}
    riding, pushed = (sb.Custom(lambda t, k=k: burst(t)[k], highest_frequency=4e3) for k in (0, 1))
    one = sb.transient(model, sb.EdgeMotion("left", uy=riding), 1.2e-3, **options)
    other = sb.transient(model, sb.SupportMotion(ay=pushed), 1.2e-3, **options)
    assert other.contact_resultant.max() > 100.0
    base = burst(one.time)[0]
    for point in one.points:
        apart = one.displacement(point) - [0.0, 1.0] * base[:, None] - other.displacement(point)
        assert np.abs(apart).max() < 1e-4 * np.abs(other.displacement("A")).max()
    assert np.abs(one.reactions - other.reactions).max() < 1e-3 * np.abs(other.reactions).max()
    assert np.abs(one.contact_force - other.contact_force).max() < 1e-3 * other.contact_force.max()
    apart = one.stress_intensity() - other.stress_intensity()
    assert np.abs(apart).max() < 1e-3 * np.abs(other.stress_intensity()).max()
    ride = np.gradient(base, one.time)
    error = one.velocity("A")[:, 1] - ride - other.velocity("A")[:, 1]
    assert np.abs(error).max() < 1e-3 * np.abs(other.velocity("A")).max()
    assert one.energy_error < 1e-9


def test_reactions_of_forces():
    """Without contact, of a force: those of the reduced model, to the square of the step."""
    model, push = cracked(), sb.PointForce("A", fy=sb.ToneBurst(200.0, 500.0, 3))
    options = {"step": 8e-6, "modes": 40, "contact": False}
    one, other = (sb.transient(model, push, 2e-3, reduction=kind, **options) for kind in (None, "modes"))
    assert one.supports == other.supports == ("left",)
    assert np.abs(one.reactions - other.reactions).max() < 5e-4 * np.abs(other.reactions).max()


@pytest.mark.slow
def test_begun_at_rest():
    """From equilibrium, with contact, under constant motions and pressure nothing moves: forces, stresses,
    stress intensity factors and fields are those of statics.
    """
    with held_plate() as model:
        load = sb.EdgeMotion("top", uy=-1e-5) + sb.EdgeMotion(LOWER, ux=4e-6)
        load += sb.EdgeLoad("edge2", pressure=1e5)
        resting = sb.static(model, load)
        assert resting.contact_resultant > 100.0
        found = sb.transient(
            model, load, 1e-4, 1e-5, modes=10, reduction=None, initial="equilibrium", decimation=5
        )
        places = [(0.04, 0.11), (0.06, 0.001), (0.03, 0.149)]
        for values, exact in (
            (found.reactions, [resting.reactions[name] for name in found.supports]),
            (found.point_displacements, [resting.displacement(point) for point in found.points]),
            (found.contact_force, resting.contact_force),
            (found.stress_intensity(), next(iter(resting.stress_intensity.values()))),
            *((found.stress(place), resting.stress(place)) for place in places),
            *((found.displacement(place), resting.displacement(place)) for place in places),
            (np.asarray(found.field(1e-4))[None], resting.field),
        ):
            scale = np.abs(np.asarray(exact)).max()
            assert np.abs(values - np.asarray(exact)).max() < 1e-6 * scale
        assert np.abs(found.velocity("top")).max() < 1e-9


@pytest.mark.parametrize("terms", [0, 1, 3])
def test_weight_at_rest(terms):
    """From equilibrium under a weight and a force nothing moves: the insides of S-elements are at rest, too,
    where displacements and stresses are those of statics.
    """
    model, weight = cracked(terms=terms), sb.PointForce("A", fy=10.0) + sb.SupportMotion(ay=1e3)
    resting = sb.static(model, weight)
    found = sb.transient(model, weight, 1e-4, 1e-5, modes=6, reduction=None, initial="equilibrium")
    for point in found.points:
        apart = found.displacement(point) - resting.displacement(point)
        assert np.abs(apart).max() < 1e-9 * np.abs(resting.displacement("A")).max()
    line = (0.013, 0.003), (0.287, 0.008)
    for values, exact in zip(found.along(*line, count=7)[1:], resting.along(*line, count=7)[1:]):
        assert np.abs(values - exact).max() < 1e-8 * np.abs(exact).max()
    assert found.energy.kinetic.max() < 1e-12 * found.energy.strain.max()


def test_goes_on(tmp_path, monkeypatch):
    """From a file bit by bit, with reactions, which it keeps."""
    monkeypatch.setattr("sbfem_petsc.motion.unreduced.history.CHUNK", 16)
    rise, path = sb.EdgeMotion("left", uy=sb.Step(1e-5, rise=2e-4)), str(tmp_path / "h.journal")
    options = {"step": 4e-6, "modes": 6, "reduction": None}
    model = cracked()
    whole = sb.transient(model, rise, 2e-4, **options)
    sb.transient(model, rise, 1e-4, file=path, **options)
    found = sb.transient(model, rise, 2e-4, file=path, resume=True, **options)
    assert np.abs(whole.reactions).max() > 10.0
    for one in (found, sb.read(path)):
        assert one.supports == ("left",)
        for name in ("point_displacements", "reactions", "contact_force"):
            values, exact = getattr(one, name), getattr(whole, name)
            assert np.abs(values - exact).max() < 1e-10 * np.abs(exact).max()
        assert np.abs(one.energy.external - whole.energy.external).max() < 1e-10 * whole.energy.external.max()


def shared():
    """What it finds with contact on any number of ranks."""
    with held_plate() as model:
        load = sb.EdgeMotion("top", uy=sb.Step(-1e-5, rise=1e-3))
        load += sb.EdgeMotion(LOWER, ux=sb.Harmonic(1e-6, 900.0))
        found = sb.transient(model, load, 2.5e-4, 5e-6, modes=12, reduction=None)
        return {
            "reactions": found.reactions[::10].ravel().tolist(),
            "contact": found.contact_resultant[::10].tolist(),
            "place": found.displacement((0.06, 0.08))[::10].ravel().tolist(),
            "stress": found.stress((0.06, 0.08))[::10].ravel().tolist(),
            "energy": found.energy.external[::10].tolist(),
        }


@pytest.mark.long
def test_two_ranks():
    """The same on two."""
    alone, found = shared(), answer(on_ranks(2, PROGRAM))
    assert np.max(alone["contact"]) > 1e3
    for name, value in alone.items():
        assert np.array(found[name]) == pytest.approx(
            np.array(value), rel=1e-6, abs=1e-6 * np.abs(value).max()
        )
