"""Prescribed displacements: bars in closed form, and the force that makes the same displacement."""

import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from sbfem_petsc.system.contact.rows import rows_on
from tests.parallel import answer, on_ranks

STEEL = sb.Material(210e9, 0.3, 7800)
LENGTH, HEIGHT, PULL = 0.2, 0.05, 1e-4
OUTLINE = [(0.0, 0.0), (LENGTH, 0.0), (LENGTH, HEIGHT), (0.0, HEIGHT)]
LOWER, RIGHT, LEFT = "edge1", "edge2", "edge4"
PROGRAM = """
import json
from mpi4py import MPI
from tests.analysis.test_edge_motion import shared
found = shared()
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


def bar(left, right, **options):
    """A bar on rollers below, between supports of its ends along x."""
    mesh = Plate(OUTLINE).mesh(order=3, points={"end": (LENGTH, 0.5 * HEIGHT)})
    rollers = sb.Support(LOWER, x=False)
    ends = [sb.Support(LEFT, x=left, y=False), sb.Support(RIGHT, x=right, y=False)]
    return sb.Model(mesh, STEEL, clamped=None, supports=[rollers, *ends], **options)


def test_bar_pulled_by_its_end():
    """One-dimensional tension: E u / L, the force on the ends, the work, and -nu of the strain across."""
    thickness = 0.01
    with bar(True, True, thickness=thickness) as model:
        found = sb.static(model, sb.EdgeMotion(RIGHT, ux=PULL))
        strain = PULL / LENGTH
        force = STEEL.young * strain * HEIGHT * thickness
        for x, y in ((0.03, 0.02), (0.11, 0.04), (LENGTH, 0.01)):
            exact = strain * np.array([x, -STEEL.poisson * y])
            assert found.displacement((x, y)) == pytest.approx(exact, rel=1e-9, abs=1e-9 * PULL)
            stress = STEEL.young * strain * np.array([1.0, 0.0, 0.0])
            assert found.stress((x, y)) == pytest.approx(stress, rel=1e-8, abs=1e-8 * stress[0])
        assert found.displacement("end")[0] == PULL
        assert found.reactions[RIGHT] == pytest.approx([force, 0.0], rel=1e-9, abs=1e-9 * force)
        assert found.reactions[LEFT] == pytest.approx([-force, 0.0], rel=1e-9, abs=1e-9 * force)
        assert found.strain_energy == pytest.approx(0.5 * force * PULL, rel=1e-9)
        assert np.abs(found.field[:, 0]).max() == PULL


def test_elastic_end():
    """A bar and a spring behind it share the displacement."""
    foundation = 4e11  # N/m^3
    with bar(True, foundation) as model:
        found = sb.static(model, sb.EdgeMotion(LEFT, ux=-PULL))
        force = PULL * HEIGHT / (LENGTH / STEEL.young + 1.0 / foundation)
        assert found.reactions[LEFT] == pytest.approx([-force, 0.0], rel=1e-9, abs=1e-9 * force)
        assert found.reactions[RIGHT] == pytest.approx([force, 0.0], rel=1e-9, abs=1e-9 * force)
        assert found.displacement("end")[0] == pytest.approx(-force / (foundation * HEIGHT), rel=1e-9)
        assert found.strain_energy == pytest.approx(0.5 * force * PULL, rel=1e-9)


def cracked(*supports, laws=None):
    """A plate with a slanted crack, held below, and a point above by which it is pulled or pressed."""
    crack = CrackLine([(0.0, 0.06), (0.05, 0.075)])
    mesh = Plate([(0.0, 0.0), (0.1, 0.0), (0.1, 0.15), (0.0, 0.15)], cracks=[crack]).mesh(
        order=3, points={"top": (0.03, 0.15)}
    )
    return sb.Model(mesh, STEEL, clamped=LOWER, supports=supports, contact_laws=laws)


@pytest.mark.parametrize("force", [4e5, -4e5])
def test_the_displacement_that_a_force_makes(force):
    """Open or in contact, moved as far as a force moves it: the support has the force, all else is alike."""
    with cracked() as free, cracked(sb.Support("top", x=False)) as held:
        pushed = sb.static(free, sb.PointForce("top", fy=force))
        moved = sb.static(held, sb.EdgeMotion("top", uy=pushed.displacement("top")[1]))
        scale = np.abs(pushed.field).max()
        assert (pushed.active.sum() > 3) == (force < 0.0)
        assert moved.reactions["top"] == pytest.approx([0.0, force], rel=1e-8, abs=1e-8 * abs(force))
        assert np.abs(moved.field - pushed.field).max() < 1e-8 * scale
        assert np.abs(moved.gap - pushed.gap).max() < 1e-8 * scale
        assert moved.contact_force == pytest.approx(pushed.contact_force, rel=1e-6, abs=1e-6 * abs(force))
        assert moved.strain_energy == pytest.approx(pushed.strain_energy, rel=1e-8)
        (name,) = pushed.stress_intensity
        unit = np.abs(pushed.stress_intensity[name]).max()
        assert moved.stress_intensity[name] == pytest.approx(pushed.stress_intensity[name], abs=1e-8 * unit)
        assert moved.t_stress[name] == pytest.approx(pushed.t_stress[name], rel=1e-6)
        for place in ((0.03, 0.149), (0.06, 0.08), (0.01, 0.02)):
            assert moved.displacement(place) == pytest.approx(pushed.displacement(place), abs=1e-8 * scale)
            stress = pushed.stress(place)
            assert moved.stress(place) == pytest.approx(stress, abs=1e-7 * np.abs(stress).max())


def test_all_supports_moved_alike():
    """A rigid-body motion: no stress, no force, gaps and tips as they were, whatever holds their nodes."""
    ends = ["left", "crack1_right"]  # a face of the crack, its tip's S-element and its pairs included
    mesh = Beam(0.1, 0.01, [VNotch(0.03, 0.004, 0.02)]).mesh(order=3)
    with sb.Model(mesh, STEEL, clamped=ends) as model:
        motions = [sb.EdgeMotion(end, ux=PULL, uy=-PULL) for end in ends]
        moved = sb.static(model, motions, contact=False)
        initial = model.contact.initial[: len(moved.gap)]
        held = model.layout.held
        assert rows_on(held, model.tips).matrix.nnz and model.tips.intensities.rows_on(held).matrix.nnz
        assert np.abs(moved.field - [PULL, -PULL]).max() < 1e-9 * PULL
        assert np.abs(moved.gap - initial).max() < 1e-9 * PULL
        unit = STEEL.young * PULL / 0.01 * np.sqrt(0.01)
        assert np.abs(list(moved.stress_intensity.values())).max() < 1e-8 * unit
        assert np.abs(list(moved.reactions.values())).max() < 1e-8 * STEEL.young * PULL
        assert abs(moved.strain_energy) < 1e-9 * STEEL.young * PULL**2
        for place in ((1e-4, 1e-4), (0.03001, 0.0061), (0.05, 0.005)):
            assert moved.displacement(place) == pytest.approx([PULL, -PULL], rel=1e-8)
            assert np.abs(moved.stress(place)).max() < 1e-7 * STEEL.young * PULL / 0.01


def test_beside_other_loads():
    """Without contact, displacement, force and field of a motion and a force add up, over a history too."""
    with cracked(sb.Support("top", x=False)) as model:
        motion, push = sb.EdgeMotion("top", uy=PULL), sb.EdgeLoad("edge2", pressure=1e6)
        one, other, both = (sb.static(model, load, contact=False) for load in (motion, push, motion + push))
        scale = np.abs(both.field).max()
        assert np.abs(both.field - one.field - other.field).max() < 1e-10 * scale
        force = np.array([one.reactions["top"], other.reactions["top"], both.reactions["top"]])
        assert np.abs(force[2] - force[0] - force[1]).max() < 1e-9 * np.abs(force).max()
        ramp = sb.Samples([0.0, 1.0], [0.0, PULL])
        history = sb.load_history(model, sb.EdgeMotion("top", uy=ramp) + push, [0.0, 0.5, 1.0], contact=False)
        for share, state in zip((0.0, 0.5, 1.0), history.states):
            assert np.abs(state.field - share * one.field - other.field).max() < 1e-10 * scale
        line, u, _ = history.along((0.01, 0.149), (0.09, 0.149), 5)
        exact = np.array([both.displacement(tuple(place)) for place in line])
        assert np.abs(u[2] - exact).max() < 1e-9 * scale


def shared():
    """What it finds with contact on any number of ranks."""
    with cracked(sb.Support("top", x=False)) as model:
        found = sb.static(model, sb.EdgeMotion("top", uy=-PULL) + sb.EdgeMotion(LOWER, ux=0.5 * PULL))
        return {
            "reactions": [list(force) for force in found.reactions.values()],
            "place": list(found.displacement((0.06, 0.08))),
            "energy": found.strain_energy,
            "contact": found.contact_resultant,
        }


@pytest.mark.long
def test_two_ranks():
    """The same on two."""
    alone, found = shared(), answer(on_ranks(2, PROGRAM))
    assert alone["contact"] > 1e3
    for name, value in alone.items():
        assert np.ravel(found[name]) == pytest.approx(
            np.ravel(value), rel=1e-7, abs=1e-7 * np.abs(value).max()
        )


def test_read_again(tmp_path):
    """A file has the moved field and the forces."""
    with bar(True, True) as model:
        found = sb.static(model, sb.EdgeMotion(RIGHT, ux=PULL))
        sb.save(tmp_path / "pull.h5", found)
        again = sb.read(tmp_path / "pull.h5")
        assert again.displacement("end")[0] == PULL
        assert again.field[:, 0].max() == PULL


def test_refused():
    """What is not held, not supported, held by another support; jumps."""
    mesh = Plate(OUTLINE).mesh(order=2)
    with sb.Model(mesh, STEEL, clamped=LEFT, supports=[sb.Support(LOWER, x=False)]) as model:
        for load, error, text in (
            (sb.EdgeMotion(RIGHT, ux=PULL), KeyError, "'edge2' is not supported; give the model Support"),
            (
                sb.EdgeMotion(LOWER, ux=PULL),
                ValueError,
                r"does not hold; give the model Support\('edge1', x=True",
            ),
            (
                sb.EdgeMotion(LOWER, uy=PULL),
                ValueError,
                r"\(0, 0\) m 'edge1' is to move along y, which 'edge4'",
            ),
            (sb.EdgeMotion(LEFT, ux=sb.Harmonic(PULL, 10.0)), TypeError, "must be a number"),
        ):
            with pytest.raises(error, match=text):
                sb.static(model, load)
    with sb.Model(mesh, STEEL, clamped=LEFT, rayleigh=(0.0, 1e-7)) as model:
        tone = sb.EdgeMotion(LEFT, uy=sb.Harmonic(PULL, 100.0))
        jump = sb.EdgeMotion(LEFT, uy=sb.Step(PULL, time=1e-4))
        leaping = sb.EdgeMotion(LEFT, uy=sb.Custom(lambda t: PULL * (1e2 * t % 1.0 > 0.5), 1e3))
        reduced = sb.reduce(model, tone, modes=4)
        pushed = sb.reduce(model, sb.EdgeLoad(RIGHT, ty=1.0), modes=4)
        other = "made for other loads"
        rise = "jumps, which a displacement cannot; give it a rise"
        for call, text in (
            (lambda: sb.transient(model, jump, 1e-3, reduction=None), f"uy of 'edge4' = Step.*{rise}"),
            (lambda: sb.periodic(pushed, tone, 100.0), other),
            (lambda: sb.transient(reduced, jump, 1e-3), f"uy of 'edge4' = Step.*{rise}"),
            (lambda: sb.periodic(reduced, leaping, 100.0), rise),
            (lambda: sb.periodic(model, leaping, 100.0, steps=49, reduction=None), rise),
            (lambda: sb.transient(reduced, PULL, 1e-3), "is 0.0001 m at t = 0, where a structure at rest"),
            (
                lambda: sb.basins(reduced, tone, 100.0, [sb.StartAxis([0.0, 1.0], "impulse")]),
                "prescribed displacement, which gives no impulse",
            ),
        ):
            with pytest.raises(ValueError, match=text):
                call()


def test_a_crack_that_ends_in_a_support():
    """It is told that its mouth is held; beside the mouth nothing is."""
    crack = CrackLine([(0.05, 0.0), (0.05, 0.04)])
    mesh = Plate(OUTLINE, cracks=[crack]).mesh(order=2)
    press = sb.EdgeLoad(RIGHT, pressure=1e6)
    with (
        sb.Model(mesh, STEEL, clamped=LOWER) as model,
        pytest.warns(sb.LoadWarning, match="both faces of 'crack1' at 1 of"),
    ):
        found = sb.static(model, press)
    assert found.contact_force[found.active].min() > 0.0 and not model.contact.flexible().all()
    with sb.Model(mesh, STEEL, clamped=LEFT) as model, warnings.catch_warnings():
        warnings.simplefilter("error", sb.LoadWarning)
        sb.static(model, press)


def test_what_is_prescribed_is_what_supports_hold():
    mesh = Beam(0.1, 0.01).mesh(order=2)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700))
    assert model.layout.held.count == 2 * len(np.unique(mesh.edges[mesh.edge_sets["left"]]))
