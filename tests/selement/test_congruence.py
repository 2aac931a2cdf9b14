"""Congruent S-elements share one solution; shapes that only look alike do not."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.selement.congruence import placements, same_shape, shape_key
from tests.selement.test_solution import polygon

CORNERS = np.array([[-1.0, -0.7], [0.9, -1.0], [1.2, 0.3], [0.2, 1.1], [-0.8, 0.9]])


def copies(order, seed=0):
    """A pentagon, and eight copies: moved start, turned, scaled, mirrored."""
    generator = np.random.default_rng(seed)
    base = polygon(CORNERS, order)
    result = [base]
    for k in range(8):
        angle, scale = generator.uniform(0, 2 * np.pi), 10.0 ** generator.uniform(-4, 2)
        turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        nodes = np.roll(base, k * order, axis=0)
        if k % 2:
            nodes = np.roll(nodes[::-1] * [-1.0, 1.0], 1, axis=0)
        result.append(nodes @ turn.T)
    return np.stack(result)


@pytest.mark.parametrize("order", [1, 2, 5])
def test_copies_have_one_shape(order):
    placed = placements(copies(order), order, True, True)
    for p, outline in zip(placed, copies(order)):
        assert same_shape(p.shape, placed[0].shape, 1e-12) and shape_key(p.shape) == shape_key(
            placed[0].shape
        )
        np.testing.assert_allclose(p.size * p.shape @ p.rotation, outline[p.permutation], atol=1e-12 * p.size)


def test_anisotropic_copies_are_not_turned():
    """Without isotropy only scaled copies (of any start vertex) are alike."""
    placed = placements(copies(2), 2, True, False)
    assert not any(same_shape(p.shape, placed[0].shape, 1e-6) for p in placed[1:])
    scaled = placements(np.stack([copies(2)[0], 3.0 * np.roll(copies(2)[0], 4, axis=0)]), 2, True, False)
    assert same_shape(scaled[0].shape, scaled[1].shape, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("difference", [1e-4, 1e-7, 1e-9])
def test_near_copies_stay_apart(difference):
    """Two beams whose notches differ by a hair: a derivative by differences sees the difference."""
    base = sb.modal(
        sb.Model(Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 1.0)]).mesh(order=3), sb.Material(70e9, 0.33, 2700)),
        3,
    ).frequencies
    beam = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 1.0), VNotch(0.2, 0.0025, 1.0 + difference)])
    model = sb.Model(beam.mesh(order=3), sb.Material(70e9, 0.33, 2700))
    alike = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 1.0), VNotch(0.2, 0.0025, 1.0)])
    shared = sb.Model(alike.mesh(order=3), sb.Material(70e9, 0.33, 2700))
    assert model.shapes > shared.shapes
    assert sb.modal(shared, 3).frequencies[0] < base[0]
