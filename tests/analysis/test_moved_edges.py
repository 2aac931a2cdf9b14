"""Prescribed displacements in time, and what supports bear: bars in closed form, the ride of all supports,
and load_history where loads are slow.
"""

import functools

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from tests.parallel import answer, on_ranks

LENGTH, HEIGHT, MOVE = 0.2, 0.02, 1e-5
ROD = sb.Material(young=200e9, poisson=0.0, density=8000.0)
SPEED = np.sqrt(200e9 / 8000.0)
ALUMINIUM = sb.Material(70e9, 0.33, 2700.0)
OUTLINE = [(0.0, 0.0), (LENGTH, 0.0), (LENGTH, HEIGHT), (0.0, HEIGHT)]
LOWER, RIGHT, LEFT = "edge1", "edge2", "edge4"
PROGRAM = """
import json
from mpi4py import MPI
from tests.analysis.test_moved_edges import shared
found = shared()
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


@functools.cache
def mesh_of_rod():
    return Plate(OUTLINE).mesh(
        order=5, size=0.02, points={"end": (LENGTH, HEIGHT), "middle": (0.5 * LENGTH, HEIGHT)}
    )


def rod(right, **damping):
    """A rod without contraction on rollers, its left end held, its right one as given."""
    supports = [sb.Support(LOWER, x=False), sb.Support(LEFT, y=False), sb.Support(RIGHT, x=right, y=False)]
    return sb.Model(mesh_of_rod(), ROD, clamped=None, supports=supports, **damping)


def amplitude(orbit, column):
    """Complex amplitude of exp(i omega t), where a tone is sin(omega t), of a column over a period."""
    return 2j * np.fft.fft(column)[1] / len(orbit.time)


UNREDUCED = {"reduction": None, "steps": 256}


@pytest.mark.parametrize(
    ("asked", "foundation", "nearness", "balance"),
    [({"modes": 60}, end, 1e-4, 3e-5) for end in (True, 4e11)]
    # to the steps' (omega h)^2 / 12
    + [pytest.param(UNREDUCED, end, 1e-3, 1e-3, marks=pytest.mark.long) for end in (True, 4e11)],
)
def test_steady_state_of_a_rod(asked, foundation, nearness, balance):
    """Ends moved in different phases, damping by stiffness: the wave equation with a complex modulus,
    displacement and forces; a foundation at the right end is damped as all else.
    """
    b, frequency = 1e-6, 9000.0
    omega, right = 2.0 * np.pi * frequency, 0.5j * MOVE
    loss = 1.0 + 1j * omega * b
    wave = omega / (SPEED * np.sqrt(loss))
    stress = ROD.young * loss * wave
    with rod(foundation, rayleigh=(0.0, b)) as model:
        load = sb.EdgeMotion(LEFT, ux=sb.Harmonic(MOVE, frequency))
        if foundation is True:
            load += sb.EdgeMotion(RIGHT, ux=sb.Harmonic(abs(right), frequency, 0.5 * np.pi))
        orbit = sb.periodic(model, load, frequency, **asked)
        inside = orbit.along((0.031, 0.007), (0.177, 0.015), count=5)
    c, s = np.cos(wave * LENGTH), np.sin(wave * LENGTH)
    k = foundation * loss
    # u = MOVE cos(wave x) + other sin(wave x)
    other = (
        (right - MOVE * c) / s if foundation is True else MOVE * (stress * s - k * c) / (stress * c + k * s)
    )
    end = MOVE * c + other * s
    for name, x in (("middle", 0.5 * LENGTH), ("end", LENGTH)):
        exact = MOVE * np.cos(wave * x) + other * np.sin(wave * x)
        assert abs(amplitude(orbit, orbit.displacement(name)[:, 0]) - exact) < nearness * MOVE
    # of modes, the inside of a cell has the inertia of those kept, whose series converges slowly in stress
    for number, (x, _) in enumerate(inside[0]):
        cos, sin, size = np.cos(wave * x), np.sin(wave * x), abs(ROD.young * wave * MOVE)
        assert (
            abs(amplitude(orbit, inside[1][:, number, 0]) - MOVE * cos - other * sin) < 3.0 * nearness * MOVE
        )
        elastic = ROD.young * wave * (other * cos - MOVE * sin)
        assert abs(amplitude(orbit, inside[2][:, number, 0]) - elastic) < 3e-3 * size
    forces = {
        LEFT: -HEIGHT * stress * other,
        RIGHT: HEIGHT * stress * (other * c - MOVE * s) if foundation is True else -HEIGHT * k * end,
    }
    for name, force in forces.items():
        found = amplitude(orbit, orbit.reaction(name)[:, 0])
        assert abs(found - force) < balance * abs(HEIGHT * stress * MOVE)


def test_a_nanometre_beside_a_load_in_pascals():
    """A transducer moves the left end of a rod that is pressed at the right one: the wave equation, beside
    the static shortening. Metres and pascals are 17 orders apart.
    """
    b, frequency, move, pressure = 1e-6, 9000.0, 1e-9, 1e8
    omega = 2.0 * np.pi * frequency
    wave = omega / (SPEED * np.sqrt(1.0 + 1j * omega * b))
    with rod(False, rayleigh=(0.0, b)) as model:
        motion = sb.EdgeMotion(LEFT, ux=sb.Harmonic(move, frequency))
        load = motion + sb.EdgeLoad(RIGHT, pressure=sb.Constant(pressure))
        orbit = sb.periodic(model, load, frequency, modes=60, steps=64)
    end = orbit.displacement("end")[:, 0]
    assert end.mean() == pytest.approx(-pressure * LENGTH / ROD.young, rel=1e-6)
    # as near as `test_steady_state_of_a_rod`
    assert abs(amplitude(orbit, end) - move / np.cos(wave * LENGTH)) < 1e-4 * move


@pytest.mark.long
def test_pulse_in_a_rod():
    """An end that moves to and fro: the wave goes out, comes back from the free end with the same sign, and
    the support bears E A v / c; the energies are in balance with its work.
    """
    length, late = 3e-5, LENGTH / SPEED

    def pulse(t):
        return MOVE * np.where((t > 0.0) & (t < length), np.sin(np.pi * t / length) ** 4, 0.0)

    with rod(False) as model:
        load = sb.EdgeMotion(LEFT, ux=sb.Custom(pulse, highest_frequency=2.0 / length))
        found = sb.transient(model, load, 7.5e-5, 5e-8, modes=80)
    time, rate = found.time, np.gradient(pulse(found.time), found.time)
    assert np.abs(found.displacement("end")[:, 0] - 2.0 * pulse(time - late)).max() < 1e-3 * MOVE
    middle = pulse(time - 0.5 * late) + pulse(time - 1.5 * late)
    assert np.abs(found.displacement("middle")[:, 0] - middle).max() < 1e-3 * MOVE
    force = ROD.young * HEIGHT / SPEED * rate
    assert np.abs(found.reaction(LEFT)[:, 0] - force).max() < 1e-2 * force.max()
    work = ROD.young * HEIGHT / SPEED * np.sum(rate**2) * found.step
    assert found.energy.external[-1] == pytest.approx(work, rel=1e-3)
    assert found.energy_error < 1e-3


@functools.cache
def cracked(damping=0.02, terms=1):
    """A beam with a closed crack."""
    mesh = Beam(0.3, 0.01, [VNotch(0.1, 0.005, 0.0)]).mesh(order=3)
    return sb.Model(mesh, ALUMINIUM, damping=damping, continued_fraction=terms)


def burst(t):
    """Displacement, m, rate and acceleration of an even rise and fall of 1 ms."""
    turn, inside = 2e3 * np.pi, (t >= 0.0) & (t <= 1e-3)
    u = 1e-5 * (1.0 - np.cos(turn * t)) ** 2
    a = 2e-5 * turn**2 * (np.sin(turn * t) ** 2 + (1.0 - np.cos(turn * t)) * np.cos(turn * t))
    return inside * u, inside * a


def test_all_supports_ride():
    """The same as their acceleration, with contact, but for the ride itself: displacements, forces."""
    model, riding = cracked(), sb.Custom(lambda t: burst(t)[0], highest_frequency=4e3)
    pushed = sb.Custom(lambda t: burst(t)[1], highest_frequency=4e3)
    one = sb.transient(model, sb.EdgeMotion("left", uy=riding), 2e-3, 5e-7, modes=60)
    other = sb.transient(model, sb.SupportMotion(ay=pushed), 2e-3, 5e-7, modes=60)
    base = burst(one.time)[0]
    assert other.contact_resultant.max() > 100.0
    scale = np.abs(other.displacement("A")).max()
    for point in one.points:
        apart = one.displacement(point) - [0.0, 1.0] * base[:, None] - other.displacement(point)
        assert np.abs(apart).max() < 1e-5 * scale
    assert np.abs(one.reactions - other.reactions).max() < 1e-3 * np.abs(other.reactions).max()
    assert np.abs(one.contact_force - other.contact_force).max() < 1e-3 * other.contact_force.max()
    ride = np.gradient(base, one.time)
    error = one.velocity("A")[:, 1] - ride - other.velocity("A")[:, 1]
    assert np.abs(error).max() < 1e-3 * np.abs(other.velocity("A")).max()
    assert one.energy_error < 1e-3


def test_steady_states_that_ride():
    """With contact: those of the acceleration."""
    model, size, frequency = cracked(), 1e-6, 900.0
    omega = 2.0 * np.pi * frequency
    one = sb.periodic(model, sb.EdgeMotion("left", uy=size), frequency, modes=40, stability=False)
    force = sb.SupportMotion(ay=-size * omega**2)
    other = sb.periodic(model, force, frequency, modes=40, stability=False)
    assert other.contact_resultant.max() > 10.0
    assert np.abs(one.reactions - other.reactions).max() < 1e-3 * np.abs(other.reactions).max()
    riding = one.displacement("A")[:, 1] - size * np.sin(omega * one.time)
    assert np.abs(riding - other.displacement("A")[:, 1]).max() < 1e-3 * other.amplitude("A")


@pytest.mark.long
def test_curves_that_ride(tmp_path):
    """A curve's motions are those of `periodic`, also over a factor on the damping; a slow sweep follows it;
    under two tones it is the
    acceleration's; files keep the reactions.
    """
    model, shake = cracked(), sb.EdgeMotion("left", uy=1e-6)
    reduced = sb.reduce(model, shake, modes=30)
    branch = sb.frequency_response(reduced, shake, 520.0, 570.0)
    k = len(branch.frequency) // 2
    again = sb.periodic(reduced, shake, branch.frequency[k])
    assert branch.amplitude("A")[k] == pytest.approx(again.amplitude("A"), rel=1e-6)
    sweep = sb.swept_response(reduced, shake, 540.0, 542.0, duration=0.5)
    assert sweep.amplitude("A")[150] == pytest.approx(
        np.interp(sweep.frequency[150], branch.frequency, branch.amplitude("A")), rel=5e-3
    )
    damped = sb.load_response(reduced, shake, 545.0, start=0.5, stop=1.0, parameter="damping")
    less = cracked(0.01)
    exact = sb.periodic(less, shake, 545.0, modes=30)
    first = int(np.argmin(damped.value))
    assert damped.amplitude("A")[first] == pytest.approx(exact.amplitude("A"), rel=1e-6)
    sb.save(tmp_path / "orbit.h5", again)
    assert np.abs(sb.read(tmp_path / "orbit.h5").reactions - again.reactions).max() < 1e-9
    rise = sb.EdgeMotion("left", uy=sb.Step(1e-6, rise=5e-4))
    history = sb.transient(reduced, rise, 1e-3, file=str(tmp_path / "h.journal"))
    assert np.abs(history.reactions).max() > 10.0
    assert np.abs(sb.read(tmp_path / "h.journal").reactions - history.reactions).max() < 1e-9
    sizes, both = (1e-6, 2e-9), (900.0, 310.0)
    two, pushed = (
        sb.quasi_periodic(model, load, both, samples=16, modes=40)
        for load in (
            sb.EdgeMotion("left", uy=sum(map(sb.Harmonic, sizes, both), sb.Constant(0.0))),
            sb.SupportMotion(
                ay=sum(
                    (sb.Harmonic(-u * (2 * np.pi * f) ** 2, f) for u, f in zip(sizes, both)), sb.Constant(0.0)
                )
            ),
        )
    )
    assert pushed.contact_peak > 10.0
    riding = two.lines[:, :, two.points.index("A"), 1].copy()
    riding[[1, 0], [two.samples // 2, two.samples // 2 + 1]] += 1j * np.array(sizes)
    other = pushed.lines[:, :, two.points.index("A"), 1]
    assert np.abs(riding - other).max() < 1e-3 * np.abs(other).max()


def held_plate(damping=0.05):
    """A plate with a slanted crack, held below, and a point above that is moved."""
    crack = CrackLine([(0.0, 0.06), (0.05, 0.075)])
    mesh = Plate([(0.0, 0.0), (0.1, 0.0), (0.1, 0.15), (0.0, 0.15)], cracks=[crack]).mesh(
        order=3, points={"top": (0.03, 0.15)}
    )
    return sb.Model(mesh, ALUMINIUM, clamped=LOWER, supports=[sb.Support("top", x=False)], damping=damping)


def test_work_on_what_is_held():
    """Inertia acts on the nodes of a moved edge, too, and works on them: the energies are in balance."""
    load = sb.EdgeMotion(LOWER, uy=sb.Step(1e-5, rise=2e-4)) + sb.SupportMotion(ay=sb.Step(1e4, rise=2e-4))
    with held_plate() as model:
        found = sb.transient(model, load, 4e-4, 1e-6, modes=40, contact=False)
    assert found.energy_error < 1e-3


def test_slow_motion():
    """Under slow motions of both supports and a force, with contact, it is load_history's."""
    with held_plate(0.3) as model:
        rise = 0.02
        load = sb.EdgeMotion("top", uy=sb.Step(-1e-5, rise=rise))
        load += sb.EdgeMotion(LOWER, ux=sb.Samples([0.0, 0.5 * rise, rise], [0.0, 0.0, 4e-6], "cubic"))
        load += sb.EdgeLoad("edge2", pressure=sb.Step(1e5, rise=rise))
        moving = sb.transient(model, load, rise, 2e-5, modes=16)
        instants = np.array([300, 600, 950])
        resting = sb.load_history(model, load, moving.time[instants])
        assert resting.contact_resultant.min() > 100.0
        for found, exact in (
            (
                moving.reactions,
                resting.reactions[:, [list(resting.supports).index(s) for s in moving.supports]],
            ),
            (moving.point_displacements, resting.point_displacements),
            (moving.contact_force, resting.contact_force),
            (moving.stress_intensity(), resting.stress_intensities[:, 0]),
            (moving.stress((0.04, 0.11)), resting.stress((0.04, 0.11))),
            *zip(*(one.along((0.02, 0.11), (0.06, 0.1), 4)[1:] for one in (moving, resting))),
        ):
            assert np.abs(found[instants] - exact).max() < 2e-3 * np.abs(exact).max()
        field, exact = moving.field(moving.time[950]), resting.states[2].field
        assert np.abs(np.asarray(field) - exact).max() < 2e-3 * np.abs(exact).max()


def by_lagrange(modulus, density, frequency, moved):
    """u of the middle of the upper side and what both ends bear, by quadratic elements of scikit-fem with all
    unknowns: what moves the left end along y by `moved[0]` and the right one by `moved[1]`, in phase or not,
    are Lagrange's multipliers.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import linear_elasticity

    nu, x, y = ALUMINIUM.poisson, np.linspace(0.0, LENGTH, 61), np.linspace(0.0, HEIGHT, 9)
    element = skfem.ElementVector(skfem.ElementQuad2())
    basis = skfem.Basis(skfem.MeshQuad.init_tensor(x, y), element, intorder=5)
    unit = linear_elasticity(nu / (1.0 - nu**2), 0.5 / (1.0 + nu)).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: density * (u[0] * v[0] + u[1] * v[1])).assemble(basis)
    place, along_y = basis.doflocs, np.zeros(basis.N, dtype=bool)
    along_y[np.concatenate([basis.nodal_dofs[1], basis.facet_dofs[1], basis.interior_dofs[1]])] = True
    ends = np.isclose(place[0], 0.0), np.isclose(place[0], LENGTH) & along_y
    held = np.flatnonzero(ends[0] | ends[1])
    given = np.where(along_y[held], np.where(ends[1][held], moved[1], moved[0]), 0.0)
    rows = sparse.csr_matrix((np.ones(len(held)), (np.arange(len(held)), held)), shape=(len(held), basis.N))
    dynamic = modulus * unit - (2.0 * np.pi * frequency) ** 2 * mass
    saddle = sparse.bmat([[dynamic, rows.T], [rows, None]]).tocsc()
    found = spsolve(saddle, np.concatenate([np.zeros(basis.N), given]))
    bear = np.zeros(basis.N, dtype=complex)
    bear[held] = -found[basis.N :]
    at = np.isclose(place[0], 0.5 * LENGTH) & np.isclose(place[1], HEIGHT)
    middle = [found[: basis.N][at & direction][0] for direction in (~along_y, along_y)]
    return np.array(middle), [[bear[end & ~along_y].sum(), bear[end & along_y].sum()] for end in ends]


@pytest.mark.long
def test_beside_lagrange_multipliers():
    """Bending and shear of a short beam, damped by its stiffness, both of its ends moved."""
    frequency, b, size = 3000.0, 2e-6, np.array([MOVE, 0.5j * MOVE])
    loss = 1.0 + 2j * np.pi * frequency * b
    middle, (left, right) = by_lagrange(70e9 * loss, 2700.0, frequency, size)
    options = {"clamped": LEFT, "supports": [sb.Support(RIGHT, x=False)], "rayleigh": (0.0, b)}
    with sb.Model(mesh_of_rod(), ALUMINIUM, **options) as model:
        load = sb.EdgeMotion(LEFT, uy=sb.Harmonic(MOVE, frequency))
        load += sb.EdgeMotion(RIGHT, uy=sb.Harmonic(0.5 * MOVE, frequency, 0.5 * np.pi))
        orbit = sb.periodic(model, load, frequency, modes=60)
    found = [amplitude(orbit, column) for column in orbit.displacement("middle").T]
    assert np.abs(found - middle).max() < 1e-3 * np.abs(middle).max()
    for name, exact in ((LEFT, left), (RIGHT, right)):
        found = [amplitude(orbit, column) for column in orbit.reaction(name).T]
        assert np.abs(np.array(found) - exact).max() < 1e-3 * np.abs(left).max()


@pytest.mark.long
def test_rubbing_faces_that_ride():
    """With friction: the acceleration's motion, loss and forces."""
    crack = CrackLine([(0.05, 0.0), (0.052, 0.01)])
    mesh = Plate(OUTLINE, cracks=[crack]).mesh(order=2, points={"end": (LENGTH, HEIGHT)})
    size, frequency, options = 1e-6, 300.0, {"modes": 20, "steps": 1024, "stability": False}
    laws = {"crack1": sb.Coulomb(friction=0.3)}
    with sb.Model(mesh, ALUMINIUM, damping=0.02, clamped=LEFT, contact_laws=laws) as model:
        one = sb.periodic(model, sb.EdgeMotion(LEFT, uy=size), frequency, **options)
        force = sb.SupportMotion(ay=-size * (2.0 * np.pi * frequency) ** 2)
        other = sb.periodic(model, force, frequency, **options)
    assert other.friction_loss > 0.0
    assert one.friction_loss == pytest.approx(other.friction_loss, rel=1e-2)
    assert np.abs(one.reactions - other.reactions).max() < 1e-3 * np.abs(other.reactions).max()


def shared():
    """What it finds with contact on any number of ranks, with what two supports bear and a field."""
    with held_plate() as model:
        load = sb.EdgeMotion("top", uy=sb.Step(-1e-5, rise=1e-3)) + sb.EdgeMotion(
            LOWER, ux=sb.Harmonic(1e-6, 900.0)
        )
        found = sb.transient(model, load, 1e-3, 5e-6, modes=12)
        field = np.asarray(found.field(1e-3))
        largest = model.comm.allreduce(float(np.abs(field).max()), op=max)
        return {
            "reactions": found.reactions[::20].ravel().tolist(),
            "contact": found.contact_resultant[::20].tolist(),
            "place": found.displacement((0.06, 0.08))[::20].ravel().tolist(),
            "energy": found.energy.external[::20].tolist(),
            "largest": [largest],
        }


@pytest.mark.long
def test_two_ranks():
    """The same on two."""
    alone, found = shared(), answer(on_ranks(2, PROGRAM))
    assert np.max(alone["contact"]) > 1e3
    assert alone["largest"] == pytest.approx([1e-5], rel=0.2)
    for name, value in alone.items():
        assert np.array(found[name]) == pytest.approx(
            np.array(value), rel=1e-6, abs=1e-6 * np.abs(value).max()
        )
