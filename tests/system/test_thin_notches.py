"""Notches whose faces are next to closed."""

import math

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch


@pytest.mark.parametrize("tilts", [(0.0,), (10.0, -3.0)])
def test_notches_that_hardly_open_become_closed_cracks(tilts):
    """Faces 1e-13 to 1e-7 of the height apart at the mouth: frequencies and the contact resultant come to
    those of opening 0 in proportion to it. Up to 1e-10 the mouth's corners were one place, and two notches
    could not be divided up to 1e-7.
    """
    height = 0.01

    def found(mouth):
        opening = 2.0 * math.degrees(math.atan(0.5 * mouth * height / 0.0025))
        notches = [
            VNotch(0.04 + 5e-4 * k, 0.0025, opening, tilt, edge=("top", "bottom")[k])
            for k, tilt in enumerate(tilts)
        ]
        mesh = Beam(0.1, height, notches).mesh(order=3)
        assert [crack.opening for crack in mesh.cracks] == pytest.approx([math.radians(opening)] * len(tilts))
        model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700))
        pressed = sb.static(model, sb.PointForce("A", fy=10.0))
        return np.append(sb.modal(model, 3).frequencies, pressed.contact_resultant)

    closed, far = found(0.0), found(1e-7)
    assert abs(far[-1] / closed[-1] - 1.0) > 1e-3
    slope = abs(far / closed - 1.0) / 1e-7
    for mouth in (1e-13, 1e-10, 1e-8):
        # twice the slope, and what rounding of another mesh leaves
        assert (abs(found(mouth) / closed - 1.0) < 2.0 * slope * mouth + 1e-8).all()
