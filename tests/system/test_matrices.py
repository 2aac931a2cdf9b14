"""The matrices that a model hands out."""

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh, splu

import sbfem_petsc as sb
from meshing import Beam, VNotch
from tests.parallel import on_ranks


def test_matrices_are_the_models():
    """SciPy's frequencies, displacements and gaps of them are those of `modal` and `static`."""
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.02)]).mesh(order=3)
    model, load = sb.Model(mesh, sb.Material(70e9, 0.33, 2700)), sb.PointForce("A", fy=100.0)
    found, columns = model.matrices(), model.load_columns([load])
    assert found.stiffness.shape == (model.unknowns, model.unknowns)
    squares = eigsh(found.stiffness, 4, found.mass, sigma=0.0, return_eigenvectors=False)
    frequencies = np.sqrt(np.sort(squares)) / (2.0 * np.pi)
    exact = sb.modal(model, 4, auxiliary_tolerance=0.0).frequencies
    np.testing.assert_allclose(frequencies, exact, rtol=1e-9)
    right = np.zeros(model.unknowns)
    right[: model.boundary_unknowns] = columns.forces[:, 0]
    push = sb.static(model, load)
    force = push.equilibrium.force
    u = splu(found.stiffness.tocsc()).solve(right + found.gaps.T @ force)
    np.testing.assert_allclose(u[list(model.points["A"][1])], push.displacement("A"), rtol=1e-8)
    gap = found.gaps @ u + found.initial + columns.gaps[:, 0] + found.flexibility @ force
    np.testing.assert_allclose(gap, push.equilibrium.gap, rtol=0.0, atol=1e-12)


@pytest.mark.slow
def test_of_several_ranks(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(
        "import sbfem_petsc as sb\n"
        "from meshing import Beam\n"
        "model = sb.Model(Beam(0.1, 0.01).mesh(order=2), sb.Material(70e9, 0.33, 2700))\n"
        "model.matrices()\n"
    )
    done = on_ranks(2, str(program), check=False)
    assert done.returncode != 0 and "make it on one" in done.stderr
