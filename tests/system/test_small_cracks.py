"""Cracks much smaller than the body they are in, on the default mesh: K and T of the infinite plate."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import CrackLine, Plate

pytestmark = pytest.mark.slow

STRESS = 1e6


def pulled(crack: CrackLine) -> tuple[np.ndarray, np.ndarray]:
    """K_I and K_II, and T, of each tip in units of the stress, of a square of 1 m under tension along y."""
    mesh = Plate([(0, 0), (1, 0), (1, 1), (0, 1)], cracks=[crack]).mesh()
    weak = [sb.Support("edge1", x=1e4, y=1e4)]
    with sb.Model(mesh, sb.Material(70e9, 0.3, 2700), None, supports=weak) as model:
        found = sb.static(model, sb.EdgeLoad("edge3", ty=STRESS) + sb.EdgeLoad("edge1", ty=-STRESS))
        return tuple(
            np.array(list(item.values())) / STRESS for item in (found.stress_intensity, found.t_stress)
        )


@pytest.mark.parametrize(
    "x, y, angle, a",
    [
        (0.7215, 0.5057, 0.0, 0.0003125),
        (0.5335, 0.4654, 0.0, 0.0003125),
        (0.6021, 0.5808, 0.0828, 0.0003125),
        (0.6125, 0.5206, 0.0, 0.00125),
        (0.6125, 0.5206, 0.5, 0.00125),
    ],
)
def test_a_small_crack_within_a_plate(x, y, angle, a):
    """K_I = sigma cos^2 sqrt(pi a), K_II = sigma cos sin sqrt(pi a), T = -sigma cos(2 angle), to what order 5
    leaves around the tips; the plate's edges, 400 times as far, change them by 8e-6.
    """
    c, s = np.cos(angle), np.sin(angle)
    factors, stresses = pulled(CrackLine([(x - a * c, y - a * s), (x + a * c, y + a * s)]))
    np.testing.assert_allclose(factors / np.sqrt(np.pi * a), [[c * c, c * s]] * 2, atol=3e-5)
    np.testing.assert_allclose(stresses, [-np.cos(2.0 * angle)] * 2, atol=3e-5)


@pytest.mark.parametrize("y, a", [(0.61, 0.0025), (0.37, 0.0006)])
def test_a_small_crack_from_an_edge(y, a):
    """K_I = 1.12152 sigma sqrt(pi a) of the half-plane, and (a / width)^2 = 6e-6 times some 20 more."""
    factors, _ = pulled(CrackLine([(0.0, y), (a, y)]))
    np.testing.assert_allclose(factors / np.sqrt(np.pi * a), [[1.12152, 0.0]], atol=1e-5 + 20.0 * a**2)
