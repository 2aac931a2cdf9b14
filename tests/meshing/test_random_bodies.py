"""450 beams and 300 plates drawn at random: all are meshed, all meshes are sound."""

import pytest
import random_bodies
from mesh_checks import check_mesh


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("kind", ["beams", "plates"])
def test_random_bodies(kind, seed):
    for body, options in getattr(random_bodies, kind)(seed):
        mesh = body.mesh(order=3, **options)
        check_mesh(mesh, body.area, 1e-4 if body.holes else 1e-9, covered=False)
