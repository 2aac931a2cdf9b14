"""225 beams and 150 plates drawn at random: all are meshed, all meshes are sound, all are written and read
again.
"""

import numpy as np
import pytest
import random_bodies
from mesh_checks import check_mesh
from scipy.spatial import cKDTree

from meshing import read_gmsh


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", ["beams", "plates"])
def test_random_bodies(kind, seed):
    for body, options in getattr(random_bodies, kind)(seed):
        mesh = body.mesh(order=3, **options)
        check_mesh(mesh, body.area, 1e-4 if body.holes else 1e-9, covered=False)


def check_read_again(body, options, path):
    """What gmsh fills of a file is what it fills of the drawing."""
    body.write(path, **options)
    mesh, again = body.mesh(order=2, **options), read_gmsh(path, order=2)
    assert len(again.nodes) == len(mesh.nodes)
    for one, other in ((mesh, again), (again, mesh)):
        assert cKDTree(one.nodes).query(other.nodes)[0].max() < 1e-14 * np.ptp(mesh.nodes, axis=0).max()


@pytest.mark.parametrize("number", [0, 8])
def test_plates_are_filled_alike(number, tmp_path):
    """Plates whose plane gmsh turns upside down when it looks at them a second time."""
    check_read_again(*random_bodies.plates(1)[number], tmp_path / "body.geo_unrolled")


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", ["beams", "plates"])
def test_random_bodies_are_read_again(kind, seed, tmp_path):
    for body, options in getattr(random_bodies, kind)(seed)[::10]:
        check_read_again(body, options, tmp_path / "body.geo_unrolled")
