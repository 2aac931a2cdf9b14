"""Numbers that are finite and seldom meant are told: sizes and wave speeds of another unit, displacements
that are not small.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, Plate, UnitWarning
from sbfem_petsc.motion.states import ModalStates
from tests.systems import two_masses

ALUMINIUM = sb.Material(70e9, 0.33, 2700.0)


def told(call, kind):
    """Sentences of one kind of warning, each at the line that called."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = call()
    found = [one for one in caught if one.category is kind]
    assert all(one.filename == __file__ for one in found)
    return result, [str(one.message) for one in found]


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (Beam(600.0, 20.0), "beam: it is 600 m wide and 20 m high; lengths are in m, so divide those in"),
        (Beam(20.0, 2.0), None),
        (Beam(0.001, 0.0001), None),
        (Beam(0.0009, 0.0001), "beam: it is 0.0009 m wide and 0.0001 m high"),
        (Plate([(0, 0), (10, 0), (10, 30), (0, 30)]), "plate: it is 10 m wide and 30 m high"),
        (Plate([(0, 0), (1, 0), (1, 3), (0, 3)]), None),
    ],
)
def test_bodies_above_20_m_and_below_1_mm(body, says):
    _, said = told(lambda: body.mesh(order=1), UnitWarning)
    assert len(said) == (says is not None) and all(one.startswith(says) for one in said)


@pytest.mark.parametrize(
    ("young", "density", "speed"),
    [
        (70e3, 2700.0, "5.09 m/s"),  # MPa
        (70.0, 2700.0, "0.161 m/s"),  # GPa
        (70e9, 2.7, "1.61e+05 m/s"),  # g/cm^3
        (70e9, 2.7e-9, "5.09e+09 m/s"),  # t/mm^3
        (70e3, 2.7e-9, "5.09e+06 m/s"),  # both: what is right for lengths in mm
        (70e9, 2700.0, None),
        (1050e9, 3500.0, None),  # diamond
        (3e6, 1100.0, None),  # rubber
    ],
)
def test_wave_speeds(young, density, speed):
    mesh = Beam(0.4, 0.01).mesh(order=1)
    _, said = told(lambda: sb.Model(mesh, sb.Material(young, 0.3, density)), UnitWarning)
    assert len(said) == (speed is not None)
    for one in said:
        assert f"sqrt(E / density) = {speed}, outside of 50 to 20000 m/s, with E = {young:g} Pa" in one


def cantilever(**options):
    """Far from the origin: a body's size counts, not where it is."""
    corners = [(10.0, 0.0), (10.6, 0.0), (10.6, 0.02), (10.0, 0.02)]
    mesh = Plate(corners).mesh(order=2, size=0.02, points={"A": corners[2]})
    return sb.Model(mesh, ALUMINIUM, clamped="edge4", **options)


# m/N of a cantilever's end, slender: L^3 / (3 E I)
SOFTNESS = 0.6**3 / (3 * 70e9 * 0.02**3 / 12)


@pytest.mark.slow
def test_static_displacements():
    """109 mm on 600 mm are told, 4.8 % are not."""
    model = cantilever()

    def pulled(share, **options):
        load = sb.PointForce("A", fy=share * 0.6 / SOFTNESS)
        return told(lambda: sb.static(model, load, **options), sb.LargeDisplacementWarning)

    found, said = pulled(0.109 / 0.6)
    assert found.displacement("A")[1] == pytest.approx(0.109, rel=0.02)
    says = "static: displacements reach 0.109 m, 18.2 % of the body's 0.6 m, and the theory is that of small"
    assert len(said) == 1 and said[0].startswith(says)
    assert not pulled(0.048)[1] and len(pulled(0.052)[1]) == len(pulled(0.052, accuracy=1e-2)[1]) == 1


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.04, 0.08])
def test_displacements_of_motions(share):
    """At resonance with a damping ratio of 1 % the end moves fifty times as far as under the load at rest."""
    model = cantilever(damping=0.01)
    first = sb.modal(model, 1).frequencies[0]
    load = sb.PointForce("A", fy=share * 0.6 / SOFTNESS / 50.0)
    slow = sb.PointForce("A", fy=sb.Harmonic(share * 0.6 / SOFTNESS, first / 20))
    few = {"modes": 4}

    def curve(**options):
        return sb.frequency_response(model, load, 0.98 * first, 1.02 * first, **few, **options)

    orbit, said = told(lambda: sb.periodic(model, load, first, steps=64, **few), sb.LargeDisplacementWarning)
    # the first mode has 0.97 of the static flexibility
    assert np.abs(orbit.displacement("A")[:, 1]).max() == pytest.approx(share * 0.6, rel=0.04)
    said += told(lambda: curve(contact=False), sb.LargeDisplacementWarning)[1]
    said += told(lambda: curve(steps=64), sb.LargeDisplacementWarning)[1]
    said += told(lambda: sb.transient(model, slow, 10 / first, **few), sb.LargeDisplacementWarning)[1]
    begins = ["periodic", "frequency_response", "frequency_response", "transient"]
    assert [one.split(":")[0] for one in said] == (begins if share > 0.05 else [])


def backbone(model, first, reach):
    shape = sb.modal(model, 1).point_shapes["A"][0]
    energy = 0.5 * (2.0 * np.pi * first * reach / np.linalg.norm(shape)) ** 2
    return sb.backbone(model, 1, 0.5 * energy, energy, modes=4, steps=64, refine=False, stability=False)


def two_tones(model, first, reach):
    """Each moves the end by half of it."""
    tones = [
        sb.Harmonic(0.5 * reach / SOFTNESS * (1.0 - share**2), share * first) for share in (0.3, 0.3 / 2**0.5)
    ]
    load = sb.PointForce("A", fy=tones[0] + tones[1])
    frequencies = (tones[0].frequency, tones[1].frequency)
    return sb.quasi_periodic(model, load, frequencies, modes=4, samples=5, steps=64, stability=False)


def sweep(model, first, reach):
    load = sb.PointForce("A", fy=reach / SOFTNESS)
    return sb.swept_response(
        model, load, 0.05 * first, 0.06 * first, duration=1.0, modes=4, steps=64, progress=None
    )


def attracted(model, first, reach):
    load, axis = sb.PointForce("A", fy=reach / SOFTNESS), sb.StartAxis([0.0, 1e-6])
    return sb.basins(model, load, 0.05 * first, [axis], modes=4, steps=64, progress=None)


def states(model, first, reach):
    return sb.load_history(model, sb.PointForce("A", fy=reach / SOFTNESS), [0.0, 1.0, 2.0])


@pytest.mark.slow
@pytest.mark.parametrize("result", [backbone, two_tones, sweep, attracted, states])
def test_displacements_of_every_result(result):
    """Told once above 5 %, with the number, which is where the end was sent; not below."""
    model = cantilever(damping=0.3)
    first = sb.modal(model, 1).frequencies[0]
    found, said = told(lambda: result(model, first, 0.08 * 0.6), sb.LargeDisplacementWarning)
    assert len(said) == 1 and found._furthest() == pytest.approx(0.08 * 0.6, rel=0.05)
    assert said[0].split(":")[0] in dir(sb) and f"reach {found._furthest():.3g} m, " in said[0]
    assert told(lambda: result(model, first, 0.04 * 0.6), sb.LargeDisplacementWarning)[1] == []


def test_histories_left_in_their_files(tmp_path):
    """They are told of as those in memory are, whose rows are read one block after the other."""
    model = cantilever(damping=0.3)
    first = sb.modal(model, 1).frequencies[0]
    load = sb.PointForce("A", fy=sb.Harmonic(0.08 * 0.6 / SOFTNESS, 0.05 * first))
    path = str(tmp_path / "history.h5")
    warnings.simplefilter("ignore")
    found = sb.transient(model, load, 20.0 / first, modes=4, file=path, progress=None)
    left = sb.read(path, in_memory=False)
    assert left._furthest() == pytest.approx(found._furthest(), rel=1e-12)
    assert found._furthest() == pytest.approx(
        np.linalg.norm(found.displacement("A"), axis=1).max(), rel=1e-12
    )


def test_lines_of_bifurcations():
    """The largest displacement told is that of steady states beside the line, at the loads of the line."""
    system = two_masses(0.02, compliance=0.1)
    curve = sb.frequency_response(system, [0.1], 0.092, 0.0932, steps=128, points=40)
    line = sb.locus(curve, curve.bifurcations[0], 1.0, 1.3, points=3)
    k = int(np.argmax(np.linalg.norm(line.states, axis=1)))
    load = [sb.Harmonic(0.1 * float(line.value[k]), float(line.frequency[k]))]
    start = replace(curve.orbit(0), state=line.states[k])
    orbit = sb.periodic(system, load, float(line.frequency[k]), steps=128, guess=start)
    assert line.largest_displacement == line._furthest() > 0.0
    moves = max(np.linalg.norm(orbit.displacement(name), axis=1).max() for name in orbit.points)
    assert line.largest_displacement == pytest.approx(moves, rel=1e-3)  # a fold: the root of 1e-6


def test_no_point_moves_further_than_the_bound():
    """In a random motion with loads and contact, and one that a single coordinate makes is the bound."""
    reduced = two_masses()
    generator = np.random.default_rng(3)
    for shares in ((1, 1, 1), (1, 0, 0), (0, 0, 1)):
        parts = [share * generator.normal(size=(50, n)) for share, n in zip(shares, (2, 1, 1))]
        states = ModalStates(parts[0], parts[0], parts[1], parts[2], reduced)
        moves = [np.linalg.norm(states.displacement(name), axis=-1).max() for name in states.points]
        assert max(moves) <= states.bound() <= 4.0 * max(moves)
    parts[0][:, 0] = generator.normal(size=50)
    states = ModalStates(parts[0], parts[0], parts[1], 0.0 * parts[2], reduced)
    moves = [np.linalg.norm(states.displacement(name), axis=-1).max() for name in states.points]
    assert states.bound() == pytest.approx(max(moves), rel=1e-12)
