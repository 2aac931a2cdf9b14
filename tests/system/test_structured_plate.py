"""The benchmark's plate of rows and columns of cells against gmsh's cells around the same crack."""

import pytest

import sbfem_petsc as sb
from benchmarks.structured_plate import structured_plate
from meshing import CrackLine, Plate


@pytest.mark.slow
@pytest.mark.parametrize("pressure", [1e6, -1e6])
def test_against_gmsh(pressure):
    """In compression the pairs carry what crosses the crack, in tension it opens; cells without grading at
    the clamped corners and the tips are too stiff, by 0.3 % of the energy.
    """
    structured = structured_plate(6000, cracks=1, order=4, seed=3)
    assert structured.area == pytest.approx(1.0, rel=1e-12)
    crack = structured.cracks[0]
    (x, y), length = crack.tip, crack.length
    # the halves of the edges at the tips belong to no pair
    assert 0.9 * length < structured.pairs.weight.sum() < length
    body = Plate([(0, 0), (1, 0), (1, 1), (0, 1)], cracks=[CrackLine([(x, y), (x + length, y)])])
    energies = []
    for mesh in (structured, body.mesh(order=4)):
        model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), clamped="edge1")
        found = sb.static(model, sb.EdgeLoad("edge3", pressure=pressure, tx=2e5))
        energies.append(found.strain_energy)
        if pressure > 0.0:
            assert found.active.all() and found.contact_resultant == pytest.approx(1e6 * length, rel=0.1)
        else:
            assert not found.active.any()
    assert 0.995 * energies[1] < energies[0] < energies[1]
