"""What the default mesh is good for: histories, harmonics of a contact front in mid-crack, cracks of any
path.
"""

import pathlib

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from tests.systems import ALUMINIUM, case_p
from tests.validation.contact_cases import LINES, SIDE, SQUARE

REFERENCE = pathlib.Path(__file__).parents[2] / "examples" / "reference" / "transient_paper.npz"


@pytest.mark.slow
def test_history_of_the_paper():
    """300 N over 33 ms, against an independent finite element code whose own error is 2e-4: displacement,
    peak of the contact resultant, and no stress intensity that closes the crack beyond 5 % of its peak.
    """
    reference = np.load(REFERENCE)
    burst = sb.PointForce("A", fy=sb.ToneBurst(300.0, 3000.0, 100))
    found = sb.transient(case_p(), burst, 0.033)
    exact, time = reference["uA_y_300N_contact"], reference["t"]
    u = np.interp(time, found.time, found.displacement("A")[:, 1])
    assert np.linalg.norm(u - exact) < 5e-4 * np.linalg.norm(exact)
    peak = reference["contact_resultant_300N"].max()
    assert found.contact_resultant.max() == pytest.approx(peak, rel=1e-3)
    forces = np.interp(time, found.time, found.contact_resultant)
    exact = reference["contact_resultant_300N"]
    assert np.linalg.norm(forces - exact) < 3e-3 * np.linalg.norm(exact)
    k = found.stress_intensity()[:, 0]
    assert k.min() > -0.05 * k.max()


@pytest.mark.slow
def test_harmonics_of_a_contact_front_in_mid_crack():
    """A preload holds the front in the middle of the faces. An independent code with 172 pairs and the
    earlier mesh with 481 agree on A2 1.590e-7, A3 8.15e-10, A4 3.3e-10.
    """
    beam = Beam(0.2, 0.005, [VNotch(0.05, 0.0025, 0.03)])
    model = sb.Model(beam.mesh(), ALUMINIUM, damping=0.003, rayleigh=(100.0, 0.0))
    load = sb.PointForce("A", fy=sb.Constant(150.0)) + sb.PointForce("A", fy=sb.Harmonic(200.0, 900.0))
    harmonics = np.abs(sb.periodic(model, load, 900.0).harmonics("A"))
    assert harmonics[2] == pytest.approx(1.590e-7, rel=0.01)
    assert harmonics[3] == pytest.approx(8.15e-10, rel=0.05)
    assert harmonics[4] == pytest.approx(3.3e-10, rel=0.05)


BODIES = {name: LINES[name] for name in ("crossing pair", "T", "star of three")}
BODIES["through"] = [[(0, 0.04), (SIDE, 0.06)]]


@pytest.mark.long
@pytest.mark.parametrize("name", BODIES)
def test_every_analysis_runs(name):
    """Cracks that meet, and a crack that cuts the body: all analyses, with forces in balance."""
    cracks = [CrackLine(points) for points in BODIES[name]]
    mesh = Plate(SQUARE, cracks=cracks).mesh(order=3, points={"P": (SIDE, SIDE)}, face_edges=4)
    upper = sb.Support("edge3", x=1e9, y=1e9)  # holds a piece that is cut off
    model = sb.Model(mesh, ALUMINIUM, clamped="edge1", damping=0.02, supports=[upper])
    modes = sb.modal(model, 6)
    assert (modes.frequencies > 0).all()

    pressed = sb.static(model, sb.EdgeLoad("edge3", ty=-1e6, tx=2e5))
    assert pressed.contact_resultant > 0
    total = sum(pressed.reactions.values())
    assert total == pytest.approx([-2e5 * SIDE, 1e6 * SIDE], rel=1e-6)
    assert pressed.strain_energy > 0

    frequency = 0.4 * float(modes.frequencies[0])
    # pressed together: a piece that is cut off would hammer on the other
    signal = sb.EdgeLoad("edge3", ty=sb.Constant(-2e6)) + sb.EdgeLoad("edge3", ty=sb.Harmonic(1e6, frequency))
    history = sb.transient(model, signal, 3.0 / frequency, modes=20)
    assert history.contact_resultant.max() > 0
    # pairs that switch within a step and what damping takes in it: first to second order in the step
    assert np.abs(history.energy.balance).max() < 3e-3 * np.abs(history.energy.total).max()
    orbit = sb.periodic(model, signal, frequency, modes=20)
    assert orbit.stable
    later = sb.transient(model, signal, 20.0 / frequency, modes=20)
    last = later.time > 19.0 / frequency
    settled = 0.5 * np.ptp(later.displacement("P")[last, 1])
    assert 0.5 * np.ptp(orbit.displacement("P")[:, 1]) == pytest.approx(settled, rel=1e-2)
    load = sb.EdgeLoad("edge3", ty=sb.Constant(-2e6)) + sb.EdgeLoad("edge3", ty=1e6)
    curve = sb.frequency_response(model, load, frequency, 1.05 * frequency, modes=20)
    assert curve.complete


@pytest.mark.long
@pytest.mark.parametrize("name", BODIES)
def test_other_analyses_run(name):
    """The same bodies on coarse meshes: static histories, backbones and two tones, and where a crack cuts the
    body the unreduced model, whose linear steady state throws the pieces apart.
    """
    cracks = [CrackLine(points) for points in BODIES[name]]
    mesh = Plate(SQUARE, cracks=cracks).mesh(order=2, points={"P": (SIDE, SIDE)}, face_edges=3)
    stiff = (
        1e12 if name == "through" else 1e9
    )  # in 64 steps the backbone of the crossing pair is lost on stiff ones
    upper = [sb.Support("edge3", x=stiff, y=stiff)]
    given = {"clamped": "edge1", "rayleigh": (0.0, 2e-5), "supports": upper}
    model = sb.Model(mesh, ALUMINIUM, **given)
    healthy = sb.Model(Plate(SQUARE).mesh(), ALUMINIUM, **given)
    opened, sound = (float(sb.modal(body, 1).frequencies[0]) for body in (model, healthy))

    load = sb.EdgeLoad("edge3", ty=-2e6)
    slow = sb.load_history(model, sb.EdgeLoad("edge3", ty=sb.Constant(-2e6)), [0.0, 1.0])
    assert slow.contact_resultant == pytest.approx([sb.static(model, load).contact_resultant] * 2, rel=1e-9)

    # faces that touch at rest: the same motion at every energy, between those of open cracks and of none
    free = sb.backbone(model, 1, 1e-4, 1e-2, modes=4, steps=64, points=30)
    assert np.ptp(free.frequency) < 1e-6 * opened
    assert opened * (1 - 1e-6) < free.frequency[0] < sound * (1 + 2e-3)

    frequency = 0.4 * opened
    signal = sb.EdgeLoad("edge3", ty=sb.Constant(-2e6)) + sb.EdgeLoad("edge3", ty=sb.Harmonic(1e6, frequency))
    second = sb.EdgeLoad("edge3", ty=sb.Harmonic(1e3, 1.618 * frequency))
    options = {"modes": 6, "steps": 64, "stability": False}
    orbit = sb.periodic(model, signal, frequency, **options)
    tones = sb.quasi_periodic(model, signal + second, (frequency, 1.618 * frequency), samples=7, **options)
    assert abs(tones.line(1, 0, "P")) == pytest.approx(abs(orbit.harmonics("P")[1]), rel=1e-2)
    if name == "through":
        whole = sb.periodic(model, signal, frequency, reduction=None, steps=64, stability=False)
        # faces that never part: the linear motion of what slides there, settled to; 6 modes carry 1e-2 of it
        assert (whole.contact_force > 0).all() and whole.path == "history"
        assert abs(whole.harmonics("P")[1]) == pytest.approx(abs(orbit.harmonics("P")[1]), rel=2e-2)
