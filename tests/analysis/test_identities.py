"""What holds exactly or in closed form: energies from the matrices, gaps from the points, a rigid body on
springs, series that give their function back, multipliers by another integrator.
"""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate
from sbfem_petsc.motion import reduced_history
from tests.event_map import two_masses_exactly
from tests.systems import (
    CHAIN_COMPLIANCE,
    CHAIN_MASS,
    CHAIN_STIFFNESS,
    chain,
    short_beam,
    two_masses,
)

TURN = 2.0 * np.pi


# ---------------------------------------------------------------- energy of a history


@pytest.mark.parametrize("modes", [5, 3])
def test_energies_are_those_of_the_matrices(modes):
    """A chain with two stops, in all or in three modes: at each instant the strain energy is u'Ku / 2 and the
    stops' own, the kinetic energy v'Mv / 2, to round-off.

    The loads' work is compared with the trapezoidal rule, of second order in the step: 1e-6 is met. So are
    the balance, which damping's trapezoidal rule limits, and the work that contact does in steps that switch.
    """
    system = chain(modes)
    loads = [sb.Harmonic(0.3, 0.11), sb.Harmonic(-0.2, 0.05, 0.4)]
    history = sb.transient(system, loads, 40.0, step=5e-3)
    assert (np.count_nonzero(history.contact_force, axis=0) > 500).all()
    u, v = (
        np.stack([of(str(k))[:, 1] for k in range(5)], axis=1)
        for of in (history.displacement, history.velocity)
    )
    energy = history.energy
    stops = 0.5 * (CHAIN_COMPLIANCE * history.contact_force**2).sum(axis=1)
    strain = 0.5 * ((u @ CHAIN_STIFFNESS) * u).sum(axis=1) + stops
    kinetic = 0.5 * ((v @ CHAIN_MASS) * v).sum(axis=1)
    np.testing.assert_allclose(energy.strain, strain, atol=1e-13 * strain.max())
    np.testing.assert_allclose(energy.kinetic, kinetic, atol=1e-13 * kinetic.max())
    force = np.stack([load(history.time) for load in loads], axis=1)
    work = np.cumsum((0.5 * (force[1:] + force[:-1]) * np.diff(u[:, [0, 3]], axis=0)).sum(axis=1))
    scale = np.abs(work).max()
    np.testing.assert_allclose(energy.external[1:], work, atol=5e-6 * scale)
    assert energy.damping[-1] > 0.3 * scale
    assert np.abs(energy.balance).max() < 5e-6 * scale and np.abs(energy.contact).max() < 5e-5 * scale


@pytest.mark.slow
def test_energies_do_not_hang_on_chunks(monkeypatch):
    """Loads that begin and end, stops that touch now and then: the same energies in chunks of 3 steps, in
    most of which one of them or another does not act, as in a single one.
    """
    loads = [sb.ToneBurst(0.3, 0.11, 2), sb.Samples(np.array([0.0, 9.0, 11.0, 40.0]), [0.0, 0.0, -0.2, 0.1])]
    system, found = chain(), []
    for size in (4096, 3):
        monkeypatch.setattr(reduced_history, "CHUNK", size)
        found.append(sb.transient(system, loads, 24.0, step=1e-2))
    one, other = found
    closed = (one.contact_force > 0.0).any(axis=1)[1:].reshape(-1, 3)
    assert closed.any(axis=1).sum() > 20 and (~closed).all(axis=1).sum() > 20
    # on some processors a product of matrices is rounded otherwise where it has other rows beside it
    moved, again = one.displacement("0"), other.displacement("0")
    np.testing.assert_allclose(again, moved, rtol=0.0, atol=1e-14 * np.abs(moved).max())
    scale = one.energy.total.max()
    for name in ("kinetic", "strain", "external", "damping", "contact"):
        np.testing.assert_allclose(
            getattr(one.energy, name), getattr(other.energy, name), rtol=0.0, atol=2e-14 * scale
        )


def test_energy_balance_is_of_fourth_order():
    """Without damping and contact: the loads' work is a quadrature with slopes at both ends, of fourth order
    in the step (without them: second).
    """
    stiffness = 2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    system = sb.reduce_matrices(
        np.eye(3), stiffness, np.zeros((0, 3)), np.zeros(0), loads=np.eye(3)[:, [0]], sensors={"first": 0}
    )
    errors = []
    for step in (0.2, 0.1, 0.05):
        energy = sb.transient(system, [sb.Harmonic(1.0, 0.1)], 40.0, step=step).energy
        errors.append(np.abs(energy.balance).max() / np.abs(energy.external).max())
    assert errors[0] < 1e-6 and np.diff(np.log2(errors)) == pytest.approx([-4.0, -4.0], abs=0.05)


# ---------------------------------------------------------------- the mass that a moving support sets going


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_bar_on_a_moving_wall(share):
    """Without Poisson's effect a block of one S-element held at its left end is a bar: driven at a share of
    its first resonance its free end moves by -a / w^2 (1 / cos(w L / c) - 1) against the wall. All of its
    inertia takes part, an eighth of the first mode's through the auxiliary unknowns. The modes left out act
    statically: 3e-4 and 1e-3 with 8 modes (1e-6 with 60 on a finer mesh).
    """
    side, material = 0.02, sb.Material(70e9, 0.0, 2700.0)
    model = sb.Model(Beam(side, side).mesh(order=6, corners=()), material, continued_fraction=3)
    speed = np.sqrt(70e9 / 2700.0)
    omega = share * 0.5 * np.pi * speed / side
    orbit = sb.periodic(
        model, sb.SupportMotion(ax=1.0), omega / TURN, contact=False, modes=8, stability=False
    )
    exact = 1j / omega**2 * (1.0 / np.cos(omega * side / speed) - 1.0)
    assert abs(orbit.harmonics("A", "x")[1] - exact) < 2e-3 * abs(exact)
    # within the S-element, where inertia adds to what the boundary's displacements make
    wall = -np.tan(omega * side / speed) * 70e9 / (omega * speed)
    for at in (0.25, 0.5, 0.85):
        angle = omega * side * (1.0 - at) / speed
        inside = (at * side, 0.3 * side)
        displacement = -(np.cos(angle) / np.cos(omega * side / speed) - 1.0) / omega**2
        stress = -70e9 / (omega * speed) * np.sin(angle) / np.cos(omega * side / speed)
        shape = np.sin(TURN * orbit.frequency * orbit.time)
        np.testing.assert_allclose(
            orbit.displacement(inside)[:, 0], displacement * shape, atol=2e-3 * abs(exact)
        )
        np.testing.assert_allclose(orbit.stress(inside)[:, 0], stress * shape, atol=5e-3 * abs(wall))


def test_weight_of_a_hanging_bar():
    """The stress grows linearly from the free end, also between the boundaries of S-elements (the largest of
    one bar's length of two); a half of the weight's work is the strain energy.
    """
    young, density, gravity, length = 2e9, 1000.0, 9.81, 2.0
    mesh = Plate([(0, 0), (1, 0), (1, length), (0, length)]).mesh(order=3, size=1.0)
    bar = sb.Model(mesh, sb.Material(young, 0.0, density), supports=[sb.Support("edge3")])
    state = sb.static(bar, sb.SupportMotion(ay=gravity))
    weight = density * gravity
    places, displacement, stress = state.along((0.37, 0.0), (0.37, length), 12)
    y = places[:, 1]
    np.testing.assert_allclose(stress, np.outer(weight * y, [0, 1, 0]), atol=1e-9 * weight * length)
    np.testing.assert_allclose(
        displacement[:, 1], -weight / (2 * young) * (length**2 - y**2), atol=1e-10 * weight / young
    )
    assert state.strain_energy == pytest.approx(weight**2 * length**3 / (6 * young), rel=1e-10)


# ---------------------------------------------------------------- unreduced steps under strong modal damping


@pytest.mark.slow
def test_gaps_of_the_unreduced_model_are_those_of_its_points():
    """Whatever the damping, the gap by which contact is decided is the distance between the faces: at the
    mouth that of B and C. A damping ratio of 0.3 in 20 modes is felt within a step.
    """
    load = sb.PointForce("A", fy=sb.Step(3e4, rise=1e-5))
    history = sb.transient(short_beam(damping=0.3), load, 3e-4, step=5e-6, modes=20, reduction=None)
    mouth = int(np.argmax(history.gap[0]))
    assert (history.contact_force[:, mouth] > 0.0).any()
    distance = (history.displacement("B") - history.displacement("C"))[:, 0]
    expected = history.gap[0, mouth] + distance
    np.testing.assert_allclose(history.gap[:, mouth], expected, atol=1e-10 * np.abs(distance).max())


# ---------------------------------------------------------------- spectra


@pytest.mark.parametrize("steps", [48, 49])
def test_spectrum_gives_the_motion_back(steps):
    """Re sum_k c_k exp(i k w t) is the displacement at every instant, with an even number of steps too, where
    the highest line stands for itself alone; it is there where a stop acts through flexibility alone.
    """
    orbit = sb.periodic(chain(3), [0.3, 0.1], 0.11, steps=steps, stability=False)
    lines, u = orbit.spectrum("1"), orbit.displacement("1")[:, 1]
    turns = TURN * np.arange(len(lines)) * orbit.time[:, None] * orbit.frequency
    assert steps % 2 or abs(lines[-1]) > 1e-4 * np.abs(u).max()
    np.testing.assert_allclose((np.exp(1j * turns) @ lines).real, u, atol=1e-12 * np.abs(u).max())


# ---------------------------------------------------------------- multipliers


@pytest.mark.slow
def test_multipliers_by_another_integrator():
    """A motion that closes and opens the stop once: the multipliers' moduli are those of the exact motion, to
    second order in the step, since switches are located inside their steps.
    """
    system, frequency, errors = two_masses(), 0.1, []
    exact = two_masses_exactly(0.1)
    for steps in (512, 1024, 2048):
        orbit = sb.periodic(system, [0.1], frequency, steps=steps)
        assert 0 < np.count_nonzero(orbit.contact_force) < steps
        state = np.array([of(p)[0, 1] for of in (orbit.displacement, orbit.velocity) for p in "12"])
        moduli = np.abs(exact.multipliers(state, frequency))
        errors.append(np.abs(np.abs(orbit.multipliers) - moduli).max())
    assert errors[-1] < 2e-5 and np.polyfit([9, 10, 11], np.log2(errors), 1)[0] < -1.8


def test_multipliers_depend_on_the_phase_within_their_uncertainty():
    """A load that is half a step late puts the switches elsewhere in the grid's steps: the largest modulus
    changes by less than what is told. A load that is a whole step late changes nothing.
    """
    system, frequency, steps = two_masses(), 0.1, 256

    def late(part):
        phase = -TURN * part / steps
        return sb.periodic(system, [sb.Harmonic(0.1, frequency, phase)], frequency, steps=steps)

    there, half, whole = (late(part) for part in (0.0, 0.5, 1.0))
    changes = [abs(abs(other.multipliers[0]) - abs(there.multipliers[0])) for other in (half, whole)]
    assert 1e-6 < changes[0] < there.multiplier_error and changes[1] < 1e-8


@pytest.mark.slow
def test_work_of_a_pressure_in_a_crack():
    """Griffith: faces under a pressure p open by 4 p sqrt(a^2 - x^2) / E, so that p does 2 pi a^2 p^2 / E; in
    few modes the residual flexibility of loads makes up for the others, what opens inside the tip elements
    included: 2.5 % of it for such large ones. A plate 50 times larger leaves 3.5e-4.
    """
    crack = CrackLine([(-1.0, 0.0), (1.0, 0.0)], name="c")
    plate = Plate([(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)], cracks=[crack])
    model = sb.Model(plate.mesh(order=5, tip_size=0.3), sb.Material(1.0, 0.3, 1.0), "edge1")
    pressure = [sb.EdgeLoad(f"c_{side}", pressure=1.0) for side in ("left", "right")]
    reduced = sb.reduce(model, pressure, modes=4)
    compliance = reduced.load_modes.T @ (reduced.load_modes / reduced.omega[:, None] ** 2)
    assert (compliance + reduced.load_flexibility).sum() == pytest.approx(2.0 * np.pi, rel=1e-3)
    beside = sb.reduce(model, [*pressure, sb.EdgeMotion("edge1", ux=1.0)], modes=4)  # what is held moves too
    compliance = beside.load_modes.T @ (beside.load_modes / beside.omega[:, None] ** 2)
    assert (compliance + beside.load_flexibility)[:2, :2].sum() == pytest.approx(2.0 * np.pi, rel=1e-3)
    assert 2.0 * sb.static(model, pressure).strain_energy == pytest.approx(2.0 * np.pi, rel=1e-3)


@pytest.mark.parametrize("unit, mass", [(2.0**44, 1.0), (2.0**-44, 1.0), (1.0, 2.0**88)])
def test_rows_of_units_and_masses_far_apart(unit, mass):
    """Two oscillators that know nothing of each other, the gap of the second told in another unit, or its
    mass, springs and load larger: both move as before, on their stops, to the rounding of powers of two.
    """

    def motions(unit, mass):
        scale = np.diag([1.0, mass])
        system = sb.reduce_matrices(
            scale,
            scale @ np.diag([1.0, 1.3]),
            np.diag([1.0, unit]),
            0.3 * np.array([1.0, unit]),
            loads=scale,
            sensors={"1": 0, "2": 1},
            damping=0.05,
            compliance=0.1 * np.array([1.0, unit**2 / mass]),
        )
        orbit = sb.periodic(system, [1.0, -0.8], 0.1, steps=256)
        assert (orbit.contact_force != 0.0).any(axis=0).all()
        return [orbit.displacement(name)[:, 1] for name in "12"]

    for found, expected in zip(motions(unit, mass), motions(1.0, 1.0)):
        # Newton's method ends at 1e-10
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
