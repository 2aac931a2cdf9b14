"""Vectors in the place of left-out modes beside eight times as many modes."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.continuation.harmonic_errors import MOVED
from sbfem_petsc.reduction.build import reduced, wider
from sbfem_petsc.reduction.reduced_model import share_modes
from tests.parallel import alone, answer, on_ranks
from tests.systems import ALUMINIUM, coarse_beam


def thick_beam() -> sb.Model:
    """Half as high as it is long: of its modes the auxiliary unknowns have a large part."""
    return sb.Model(Beam(0.1, 0.05, [VNotch(0.04, 0.02, 0.0)]).mesh(order=2), ALUMINIUM)


def beyond(model: sb.ReducedModel, count: int, omega: float) -> np.ndarray:
    """What the modes behind so many add to the static displacements of gaps and points under loads and unit
    contact forces that oscillate, without damping.
    """
    rows = np.concatenate([model.gap.modes, model.points.modes.reshape(-1, len(model.omega))])[:, count:]
    columns = np.concatenate([model.load_modes, model.gap.modes.T], axis=1)[count:]
    squares = model.omega[count:] ** 2
    return rows @ (columns * (1.0 / (squares - omega**2) - 1.0 / squares)[:, None])


@pytest.mark.parametrize(
    ("make", "load"),
    [
        (coarse_beam, sb.PointForce("A", fy=1.0)),
        (coarse_beam, sb.SupportMotion(ay=1.0)),
        (coarse_beam, sb.EdgeMotion("left", uy=1.0)),
        (thick_beam, sb.PointForce("A", fy=1.0)),
    ],
)
def test_dynamic_flexibility(make, load):
    """Of some ten vectors within a fifth of that of 160 modes up to nine tenths of the highest frequency that
    is kept; of edges that move no less of it than what is told makes up for.
    """
    model, count = make(), 20
    few, most = (sb.reduce(model, load, modes=modes) for modes in (count, 160))
    more = wider(few)
    assert more is not None and count < len(more.omega) <= count + 16
    assert (more.omega[count:] > 0.999 * few.omega[-1]).all()
    for share in (0.1, 0.5, 0.9):
        found, exact = (beyond(system, count, share * few.omega[-1]) for system in (more, most))
        of_load, of_rows = np.linalg.norm((found - exact)[:, 0]), np.linalg.norm((found - exact)[:, 1:])
        assert of_rows < 0.2 * np.linalg.norm(exact[:, 1:]), share
        if isinstance(load, sb.EdgeMotion):
            assert np.linalg.norm(exact[:, 0]) < MOVED * np.linalg.norm(found[:, 0]), share
        else:
            assert of_load < 0.2 * np.linalg.norm(exact[:, 0]), share
    # what they leave of the static one is not negative
    np.testing.assert_array_less(-1e-9 * np.trace(few.gap.contact), np.linalg.eigvalsh(more.gap.contact))
    assert np.trace(more.gap.contact) < np.trace(few.gap.contact)


def answers(model: sb.ReducedModel, omega: float) -> list[np.ndarray]:
    """Gaps, points, stress inside and forces of the supports under loads and unit contact forces that
    oscillate, without damping.
    """
    columns = np.concatenate([model.load_modes, model.gap.modes.T], axis=1)
    q = columns / (model.omega**2 - omega**2)[:, None]
    found = []
    for part in (model.gap, model.points, model.output_at("stress", (0.3, 0.0013))):
        static = np.concatenate([part.loads, part.contact], axis=-1)
        found.append(part.modes @ q + static)
    supports = model.supports
    static = np.concatenate([supports.loads, supports.contact], axis=-1)
    return [*found, static - omega**2 * supports.inertia @ q]


@pytest.mark.parametrize("load", [sb.PointForce("A", fy=1.0), sb.SupportMotion(ay=1.0)])
def test_modes_and_vectors(load):
    """A model of both is that of its modes at rest, and above them a tenth as far from one of 160 modes:
    gaps, points, stresses (a third) and reactions; a place moves as the point there. Damping is the model's.
    """
    model = coarse_beam(0.002)
    few, most = sb.reduce(model, load, modes=20), sb.reduce(model, load, modes=160)
    both = reduced(model, (load,), 20, vectors=True)
    assert both.natural == 20 and both.vectors == len(both.omega) - 20 > 3 and "vectors" in repr(both)
    assert reduced(model, (load,), 20, vectors=True) is both and reduced(model, (load,), 20) is few
    for one, other in zip(answers(both, 0.0), answers(few, 0.0)):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9 * np.abs(other).max())
    for share in (0.5, 0.97):
        of = [answers(system, share * few.omega[-1]) for system in (both, few, most)]
        for (one, other, exact), gain in zip(zip(*of, strict=True), (0.1, 0.1, 0.33, 0.1), strict=True):
            off, without = np.linalg.norm(one - exact), np.linalg.norm(other - exact)
            assert off < gain * without, (share, off, without)
    ratios = model.damping_ratios(both.omega)
    np.testing.assert_allclose(both.damping, ratios, rtol=1e-12)
    seen, named = both.output_at("displacement", (0.4, 0.005)), both.points.of("A", "point")
    np.testing.assert_allclose(seen.modes, named.modes, rtol=0.0, atol=1e-9 * np.abs(named.modes).max())
    more = wider(both)
    assert more.natural == 20 and more.vectors > both.vectors and not share_modes(more, both)
    assert more.vector_shapes is None is more.modal  # of the whole it holds nothing


def test_what_is_of_natural_modes(tmp_path):
    """Backbones and axes of initial states have these alone, and histories in vectors are not made again, nor
    gone on with without them.
    """
    model, load = coarse_beam(0.002), sb.PointForce("A", fy=1.0)
    both = reduced(model, (load,), 20, vectors=True)
    with pytest.raises(ValueError, match="^backbone: mode = 21 must be an elastic one of the 20 modes kept"):
        sb.backbone(both, 21, 1e-9, 1e-8)
    axis = sb.StartAxis((0.0, 1e-6), mode=21)
    with pytest.raises(ValueError, match="^basins: mode of starts = 21 must be between 1 and 20"):
        sb.basins(both, load, 433.0, [axis])
    sine = sb.PointForce("A", fy=sb.Harmonic(1.0, 433.0))
    history = sb.transient(both, sine, 1e-3, file=str(tmp_path / "history.h5"))
    with pytest.raises(ValueError, match="another model .20 modes and .* vectors, not 20 modes.; "):
        sb.transient(model, sine, 1e-3, modes=20, file=str(tmp_path / "history.h5"), resume=True)
    with pytest.raises(ValueError, match="^estimate_error: the history is in 20 modes and .* modes = 20$"):
        sb.estimate_error(model, sine, history)


@pytest.mark.filterwarnings("ignore:transient. a load jumps:sbfem_petsc.MeshWarning")
def test_load_that_jumps():
    """Vectors ring under it, and gain nothing: beside 120 modes a history in 12 and some vectors is 1.1e-2
    off, in 12 alone 7e-3.
    """
    model, load = thick_beam(), sb.PointForce("A", fy=1.0)
    both, jump = reduced(model, (load,), 12, vectors=True), sb.PointForce("A", fy=sb.Step(1.0))
    few, most = (sb.reduce(model, load, modes=modes) for modes in (12, 120))
    found, without, exact = (
        sb.transient(system, jump, 1e-3, 2e-6).displacement("A") for system in (both, few, most)
    )
    assert np.linalg.norm(found - exact) < 2.0 * np.linalg.norm(without - exact)


RANKS = """
import json
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.reduction.build import reduced, wider
from sbfem_petsc.reduction.reduced_model import share_modes
from tests.reduction.test_left_out import thick_beam
loads = [sb.PointForce("A", fx=1.0), sb.SupportMotion(ay=1.0), sb.EdgeMotion("left", uy=1.0)]
with thick_beam() as model:
    own = sb.reduce(model, loads, modes=12)
    more = wider(own)
    further = slice(12, None)
    found = {"frequencies": more.frequencies[further], "mass": more.supports.mass}
    moved = [abs(more.translation[further]), abs(more.load_modes[further]), abs(more.gap.modes[:, further])]
    moved.append(abs(more.supports.inertia[..., further]))
    found |= {"moved": np.concatenate([part.ravel() / part.max() for part in moved])}
    found |= {"loads": more.load_flexibility, "points": more.points.loads, "tips": more.tips.contact}
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({name: values.tolist() for name, values in found.items()}))
"""


def test_two_ranks():
    """The numbers of one rank, but for the signs of the vectors."""
    one, two = alone(RANKS), answer(on_ranks(2, RANKS))
    for name, values in one.items():
        expected = np.array(values)
        np.testing.assert_allclose(
            two[name], expected, rtol=0.0, atol=1e-6 * abs(expected).max(), err_msg=name
        )


def test_beside_soft_springs():
    """What is beside motions as good as rigid has no momentum; vectors had some, by the digits that these
    motions take, and default steady states bore up to two hundred times what their springs do.
    """
    mesh = Beam(0.3, 0.01, [VNotch(0.15, 0.004, 0.01)]).mesh(order=3)
    springs = [sb.Support("bottom", x=1e3, y=1e3)]
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700.0), clamped=None, supports=springs, damping=0.01)
    load = sb.PointForce("A", fy=10.0)
    orbit = sb.periodic(model, load, 500.0, stability=False)
    assert orbit.reduced.vectors > 0
    beside = orbit.reduced.translation[-orbit.reduced.vectors :]
    assert np.abs(beside).max() < 1e-7 * np.sqrt(0.3 * 0.01 * 2700.0)
    modes = sb.periodic(model, load, 500.0, modes=40, stability=False)
    peaks = [np.abs(motion.reactions).max(axis=0) for motion in (orbit, modes)]
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-4)
