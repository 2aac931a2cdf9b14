"""Vectors in the place of left-out modes beside eight times as many modes."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.continuation.harmonic_errors import MOVED
from sbfem_petsc.reduction.build import wider
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


RANKS = """
import json
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.reduction.build import wider
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
