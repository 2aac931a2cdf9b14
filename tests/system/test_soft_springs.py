"""Bodies that soft springs alone hold: loads in balance turn them by their rounding, which is told."""

import re
import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Plate
from meshing.warnings import RoundOffWarning

YOUNG, POISSON = 70e9, 0.33


def polygon(rng) -> np.ndarray:
    """Corners of a convex polygon of some size and slenderness."""
    count = rng.integers(3, 7)
    angles = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    corners = np.stack([np.cos(angles), 10.0 ** rng.uniform(-0.7, 0.0) * np.sin(angles)], axis=1)
    return 10.0 ** rng.uniform(-2.0, 1.0) * corners


def rigid(places, length: float) -> np.ndarray:
    """(n, 2, 3): two translations and a rotation."""
    one, zero = np.ones(len(places)), np.zeros(len(places))
    x, y = places.T / length
    return np.stack([np.stack([one, zero, -y], axis=1), np.stack([zero, one, x], axis=1)], axis=1)


def exact(corners, strain, held: dict[int, tuple[float, float]]) -> np.ndarray:
    """Displacements of the corners under uniform strain, moved so that soft springs are in balance."""
    length, matrix, right = np.abs(corners).max(), np.zeros((3, 3)), np.zeros(3)
    for side, springs in held.items():
        along = np.roll(corners, -1, axis=0)[side] - corners[side]
        places = corners[side] + np.outer([0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5], along)
        motions, stiff = rigid(places, length), np.array(springs) * np.linalg.norm(along) / 2.0
        matrix += np.einsum("nik,i,nil->kl", motions, stiff, motions)
        right -= np.einsum("nik,i,ni->k", motions, stiff, places @ strain)
    return corners @ strain + rigid(corners, length) @ np.linalg.solve(matrix, right)


def error_and_told(seed: int, stiffness: float) -> tuple[float, float]:
    """Greatest error of a corner's displacement, relative, and what a warning tells of it; 0 without one."""
    rng = np.random.default_rng(seed)
    corners = polygon(rng)
    xx, yy, xy = rng.normal(size=3) * 1e6
    shear = (1.0 + POISSON) * xy
    strain = np.array([[xx - POISSON * yy, shear], [shear, yy - POISSON * xx]]) / YOUNG
    sides = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / np.linalg.norm(sides, axis=1)[:, None]
    tractions = normals @ [[xx, xy], [xy, yy]]
    names = [f"edge{k + 1}" for k in range(len(corners))]
    sprung = rng.choice(len(corners), rng.integers(1, len(corners)), replace=False)
    held = {int(k): tuple(stiffness * 10.0 ** rng.uniform(-1.0, 1.0, 2)) for k in sprung}
    mesh = Plate(corners.tolist()).mesh(
        order=int(rng.integers(1, 5)),
        size=np.abs(corners).max() / 3.0,
        points={f"V{k}": tuple(corners[k]) for k in range(len(corners))},
    )
    springs = [sb.Support(names[k], x=x, y=y) for k, (x, y) in held.items()]
    model = sb.Model(mesh, sb.Material(YOUNG, POISSON, 2700.0), clamped=None, supports=springs)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = sb.static(
            model, [sb.EdgeLoad(name, tx=x, ty=y) for name, (x, y) in zip(names, tractions.tolist())]
        )
    told = [str(item.message) for item in said if item.category is RoundOffWarning]
    assert len(told) <= 1
    right = exact(corners, strain, held)
    moved = np.array([found.displacement(f"V{k}") for k in range(len(corners))])
    error = float(np.abs(moved - right).max() / np.abs(right).max())
    text = re.search("off by (.*) of themselves, though stresses", told[0]) if told else None
    return error, 0.0 if text is None else 1.0 if "tenth" in text[1] else float(text[1])


@pytest.mark.parametrize("stiffness", [1e2, 1.0, 1e-2])
def test_turned_by_rounding(stiffness):
    """What soft springs lose is told, within a factor of ten, or of a tenth; by chance it may be less."""
    errors, told = np.array([error_and_told(seed, stiffness) for seed in range(8)]).T
    assert (errors > 1e-5).sum() > 2  # which were passed over without a word
    assert (told > 0.0)[errors > 3e-5].all()
    assert (np.minimum(errors, 1.0) < 10.0 * np.maximum(told, 3e-6)).all()
    off = (errors > 1e-5) & (errors < 0.1)
    assert 0.3 < np.median(told[off] / errors[off]) < 10.0


def test_held():
    """Springs of a usual stiffness are not warned of."""
    errors, told = np.array([error_and_told(seed, 1e5) for seed in range(6)]).T
    assert errors.max() < 2e-4 and not told.any()  # what springs take up of the loads
