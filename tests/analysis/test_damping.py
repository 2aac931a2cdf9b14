"""Damping as it is measured: ratios of each mode, by frequency, Rayleigh's, beside SciPy's matrices."""

import numpy as np
import pytest
from scipy import linalg, sparse

import sbfem_petsc as sb
from meshing import Beam

ALUMINIUM = sb.Material(70e9, 0.33, 2700)
MASS = np.diag([1.0, 2.0, 1.5, 1.0])
STIFFNESS = 1e4 * (np.diag([2.0, 3.0, 3.0, 1.0]) - np.diag([1.0, 2.0, 1.0], 1) - np.diag([1.0, 2.0, 1.0], -1))
VALUES, SHAPES = linalg.eigh(STIFFNESS, MASS)
OMEGA = np.sqrt(VALUES)
HERTZ = OMEGA / (2.0 * np.pi)
A, B = 0.8, 2e-4
# What a user gives, and the ratios of the four modes that it stands for.
WAYS = {
    "one": ({"damping": 0.02}, np.full(4, 0.02)),
    "each": ({"damping": [0.01, 0.03, 0.02, 0.05]}, np.array([0.01, 0.03, 0.02, 0.05])),
    "lowest": ({"damping": np.array([0.01, 0.03])}, np.array([0.01, 0.03, 0.03, 0.03])),
    # on the line between two points, and constant beyond them
    "frequency": (
        {"damping": sb.DampingTable([(HERTZ[1], 0.01), (HERTZ[3] - 2.0, 0.05)])},
        0.01 + 0.04 * np.array([0.0, 0.0, (HERTZ[2] - HERTZ[1]) / (HERTZ[3] - 2.0 - HERTZ[1]), 1.0]),
    ),
    "rayleigh": ({"rayleigh": (A, B)}, A / (2.0 * OMEGA) + B * OMEGA / 2.0),
    "both": (
        {"damping": [0.01, 0.02], "rayleigh": (A, B)},
        [0.01, 0.02, 0.02, 0.02] + A / (2.0 * OMEGA) + B * OMEGA / 2.0,
    ),
}


def chain(**damping):
    """Four masses on springs, a wall that none of them reaches, a load on the second."""
    return sb.reduce_matrices(
        MASS,
        STIFFNESS,
        np.array([[-1.0, 0.0, 0.0, 0.0]]),
        np.array([1e3]),
        loads=np.eye(4)[:, [1]],
        sensors={"end": 3},
        compliance=np.array([1e-4]),
        **damping,
    )


def matrix(ratios):
    """The damping matrix in which the modes have these ratios."""
    inverse = MASS @ SHAPES
    return inverse @ np.diag(2.0 * ratios * OMEGA) @ inverse.T


@pytest.mark.parametrize("way", WAYS)
def test_frequency_response(way):
    """Steady states between and beside all resonances are those of M, C and K."""
    given, ratios = WAYS[way]
    reduced = chain(**given)
    assert reduced.damping == pytest.approx(ratios, rel=1e-12)
    for frequency in (0.5 * HERTZ[0], *HERTZ, 0.5 * (HERTZ[2] + HERTZ[3])):
        w = 2.0 * np.pi * frequency
        dynamic = STIFFNESS - w**2 * MASS + 1j * w * matrix(ratios)
        exact = np.linalg.solve(dynamic, np.eye(4)[:, 1])[3]
        orbit = sb.periodic(reduced, 3.0, frequency, stability=False)
        assert orbit.harmonics("end")[1] == pytest.approx(-3j * exact, rel=1e-9)


@pytest.mark.parametrize("way", WAYS)
def test_decay(way):
    """Under a sudden load: the matrix exponential of M, C and K, decaying about the displacement at rest."""
    given, ratios = WAYS[way]
    history = sb.transient(chain(**given), 3.0, 0.6, step=1e-3)
    start = np.concatenate([-np.linalg.solve(STIFFNESS, 3.0 * np.eye(4)[:, 1]), np.zeros(4)])
    first = np.block([[np.zeros((4, 4)), np.eye(4)], [-np.linalg.solve(MASS, STIFFNESS), np.zeros((4, 4))]])
    first[4:, 4:] = -np.linalg.solve(MASS, matrix(ratios))
    exact = np.array([(linalg.expm(first * t) @ start)[3] for t in history.time[::50]]) - start[3]
    assert np.abs(history.displacement("end")[::50, 1] - exact).max() < 1e-10 * np.abs(exact).max()


def test_factor_on_all_ratios():
    """A curve over damping multiplies the ratios of each mode."""
    ratios = WAYS["each"][1]
    branch = sb.load_response(
        chain(damping=ratios), 3.0, HERTZ[1], 1.0, stop=2.0, parameter="damping", points=60, stability=False
    )
    for value, found in zip(branch.value, np.abs(branch.harmonics("end")[:, 1])):
        w = OMEGA[1]
        dynamic = STIFFNESS - w**2 * MASS + 1j * w * matrix(value * ratios)
        assert found == pytest.approx(3.0 * abs(np.linalg.solve(dynamic, np.eye(4)[:, 1])[3]), rel=1e-8)


def test_rigid_body_motions_are_no_modes():
    """Of a free chain the first ratio is that of the first mode that vibrates."""
    free = STIFFNESS - 1e4 * np.diag([1.0, 0.0, 0.0, 0.0])
    given = {"loads": np.eye(4)[:, :1], "sensors": {"end": 3}}
    reduced = sb.reduce_matrices(MASS, free, np.zeros((0, 4)), [], **given, damping=[0.01, 0.02, 0.03])
    assert reduced.omega[0] == 0.0 and reduced.damping[1:].tolist() == [0.01, 0.02, 0.03]
    reduced = sb.reduce_matrices(MASS, free, np.zeros((0, 4)), [], **given, rayleigh=(0.0, B))
    assert reduced.damping == pytest.approx(B * reduced.omega / 2.0, rel=1e-12)
    with pytest.raises(
        ValueError, match="rigid-body motion.*hold the system by a weak spring, or give a = 0"
    ):
        sb.reduce_matrices(MASS, free, np.zeros((0, 4)), [], **given, rayleigh=(A, B))


def test_sparse_matrices():
    """By SLEPc, and as a body of another code: the same ratios."""
    reduced = sb.reduce_matrices(
        sparse.csr_matrix(MASS),
        sparse.csr_matrix(STIFFNESS),
        np.zeros((0, 4)),
        [],
        loads=np.eye(4)[:, :1],
        sensors={"end": 3},
        modes=2,
        **WAYS["both"][0],
    )
    assert reduced.damping == pytest.approx(WAYS["both"][1][:2], rel=1e-9)


@pytest.fixture(scope="module")
def beam():
    return Beam(0.1, 0.005).mesh(order=3, corners=())


@pytest.mark.parametrize("way", ["each", "frequency"])
def test_beam(beam, way):
    """The linear response of a beam: modes with their ratios, what is above them by flexibility."""
    modes, push = 5, sb.PointForce("A", fy=1.0)
    plain = sb.Model(beam, ALUMINIUM)
    found, static = sb.modal(plain, modes), sb.static(plain, push).displacement("A")[1]
    ratios = np.array([0.02, 0.005, 0.01, 0.01, 0.01])
    if way == "frequency":
        table = sb.DampingTable([(f, z) for f, z in zip(found.frequencies, ratios)][:3])
    with sb.Model(beam, ALUMINIUM, damping=ratios[:3] if way == "each" else table) as model:
        w, own = 2.0 * np.pi * found.frequencies, found.point_shapes["A"][:, 1]
        for frequency in (found.frequencies[0], 0.99 * found.frequencies[1]):
            drive = 2.0 * np.pi * frequency
            dynamic = w**2 - drive**2 + 2j * ratios * w * drive
            exact = static + (own**2 * (1.0 / dynamic - 1.0 / w**2)).sum()
            orbit = sb.periodic(model, push, frequency, modes=modes, stability=False)
            assert orbit.harmonics("A")[1] == pytest.approx(-1j * exact, rel=1e-6)


@pytest.mark.long
def test_unreduced(beam, tmp_path):
    """The unreduced model decays as the reduced one does, each mode by its own ratio; a history goes on with
    the same damping alone.
    """
    given = {"damping": [0.001, 0.03], "rayleigh": (2.0, 1e-8)}
    with sb.Model(beam, ALUMINIUM, **given) as model:
        f = sb.modal(model, 2).frequencies[1]
        push = sb.PointForce("A", fy=sb.ToneBurst(1.0, f, 3))
        run = {"duration": 12.0 / f, "step": 1.0 / (200.0 * f), "modes": 6}
        path = tmp_path / "history"
        found = sb.transient(model, push, reduction=None, file=path, **run)
        exact = sb.transient(model, push, **run)
        a, b = (h.displacement("A")[:, 1] for h in (found, exact))
        assert np.abs(a - b).max() < 2e-3 * np.abs(b).max()
        assert found.energy.damping[-1] == pytest.approx(exact.energy.damping[-1], rel=2e-3)
        assert np.abs(found.energy.balance).max() < 1e-8 * found.energy.external.max()
        again = sb.transient(model, push, reduction=None, file=path, resume=True, **run)
        assert again.displacement("A")[-1, 1] == found.displacement("A")[-1, 1]
    for other in (0.001, [0.001, 0.02], sb.DampingTable([(1.0, 0.001), (2.0, 0.03)])):
        with sb.Model(beam, ALUMINIUM, **{**given, "damping": other}) as model:
            with pytest.raises(ValueError, match="damping"):
                sb.transient(model, push, reduction=None, file=path, resume=True, **run)


def test_what_files_and_words_say(beam, tmp_path):
    """What a model was made of tells its damping as it was given."""
    table = sb.DampingTable([(50.0, 0.01), (400.0, 0.02)])
    for damping, ratios, frequencies, text in (
        (0.02, [0.02], [np.nan], "damping ratio 0.02,"),
        ((0.01, 0.02), [0.01, 0.02], [np.nan, np.nan], "damping ratios 0.01, 0.02,"),
        (table, [0.01, 0.02], [50.0, 400.0], "damping ratios from 0.01 at 50 Hz to 0.02 at 400 Hz,"),
        ([0.0, 0.0], [0.0], [np.nan], "damping ratio 0,"),
    ):
        with sb.Model(beam, ALUMINIUM, damping=damping) as model:
            assert text in repr(model)
            body = model.record()
            sb.save(tmp_path / "modes.h5", {"modes": sb.modal(model, 1)})
        assert body.damping.tolist() == ratios
        np.testing.assert_array_equal(body.damping_frequency, frequencies)
        sb.read(tmp_path / "modes.h5")


@pytest.mark.parametrize(
    ("low", "low_ratio", "high", "high_ratio"),
    [
        (50.0, 0.01, 400.0, 0.02),
        (50.0, 0.02, 400.0, 0.01),
        (50.0, 0.01, 400.0, 0.08),
        (50.0, 0.08, 400.0, 0.01),
    ],
)
def test_rayleigh_of_two(low, low_ratio, high, high_ratio):
    """Both ratios are met; between them mass or stiffness alone at the ends of what is possible."""
    a, b = sb.rayleigh_factors(low, low_ratio, high, high_ratio)
    w = 2.0 * np.pi * np.array([low, high])
    exact = np.linalg.solve(np.stack([0.5 / w, 0.5 * w], axis=1), [low_ratio, high_ratio])
    assert a == pytest.approx(exact[0], rel=1e-9, abs=1e-12) and min(a, b) >= 0.0
    assert b == pytest.approx(exact[1], rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: sb.rayleigh_factors(50.0, 0.01, 400.0, 0.09), ValueError, "from 0.00125 to 0.08"),
        (lambda: sb.rayleigh_factors(50.0, 0.01, 50.0, 0.01), ValueError, "low = 50 Hz must be below high"),
        (
            lambda: sb.rayleigh_factors(50.0, 1.0, 400.0, 0.01),
            ValueError,
            "low_ratio = 1.0 must be finite and at least 0 and below 1",
        ),
        (lambda: sb.DampingTable([]), ValueError, "points is empty"),
        (lambda: sb.DampingTable(0.01), TypeError, "points = 0.01 must be pairs"),
        (lambda: sb.DampingTable([0.01, 0.02]), TypeError, r"points\[0\] = 0.01 must be a frequency"),
        (lambda: sb.DampingTable([(1.0, 0.1), (1.0, 0.2)]), ValueError, r"points\[1\] is at 1 Hz, not above"),
        (
            lambda: sb.DampingTable([(1.0, -0.1)]),
            ValueError,
            r"points\[0\]\[1\] = -0.1 must be finite and at least 0",
        ),
        (
            lambda: sb.DampingTable([(-1.0, 0.1)]),
            ValueError,
            r"points\[0\]\[0\] = -1.0 must be finite and at least 0",
        ),
        (lambda: chain(damping=[]), ValueError, "damping is empty"),
        (
            lambda: chain(damping=[0.1, 1.0]),
            ValueError,
            r"damping\[1\] = 1.0 must be finite and at least 0 and below 1",
        ),
        (lambda: chain(damping=[0.1] * 5), ValueError, "5 ratios for 4 unknowns"),
        (lambda: chain(damping=[[1.0, 0.1], [2.0, 0.1]]), ValueError, "frequency are a DampingTable"),
        (lambda: chain(damping=[[1.0, 0.1], 2.0]), ValueError, "rows of different lengths"),
        (
            lambda: chain(damping="light"),
            TypeError,
            "must be a ratio, ratios of the lowest modes or a Damping",
        ),
        (lambda: chain(rayleigh=0.1), TypeError, "rayleigh = 0.1 must be two numbers"),
        (lambda: sb.Model(None, ALUMINIUM, damping=[0.1, np.nan]), ValueError, r"damping\[1\] = nan"),
        (lambda: sb.Model(None, ALUMINIUM, damping=[(1.0, 0.1)]), TypeError, r"damping\[0\]"),
    ],
)
def test_refused(call, error, text):
    """Each by a sentence that names the item."""
    with pytest.raises(error, match=text):
        call()
