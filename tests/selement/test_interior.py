"""Interior fields against closed forms: patch test, pure bending, crack-tip fields, turned copies, curved
edges.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshing.gll import gll_nodes, shape_functions
from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement.coefficients import edge_nodes
from sbfem_petsc.selement.congruence import placements
from sbfem_petsc.selement.interior import (
    Located,
    fields_at,
    in_own_frames,
    radial_displacement,
    static_fields,
)
from sbfem_petsc.selement.rigid_motions import translations
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement

STEEL = Material(young=2.0e11, poisson=0.3, density=7800.0)
AT = np.linspace(-1.0, 1.0, 5)
LEVELS = np.array([1.0, 0.7, 0.3, 0.05, 1e-3])


def polygon(corners, order, closed=True):
    """Nodes of straight edges between `corners`, counter-clockwise."""
    corners = np.asarray(corners, dtype=float)
    ends = np.roll(corners, -1, axis=0) if closed else corners[1:]
    fraction = 0.5 * (1.0 + gll_nodes(order)[:-1])
    nodes = [a + f * (b - a) for a, b in zip(corners, ends) for f in fraction]
    return np.array(nodes if closed else nodes + [corners[-1]])


def pentagon(order):
    angle = 0.3 + 2.0 * np.pi * np.arange(5) / 5
    return polygon(0.02 * np.stack([np.cos(angle), 0.8 * np.sin(angle) + 0.1], axis=1), order)


def crack_square(order):
    """Open element with its scaling centre on the tip of a crack along the negative x axis."""
    corners = [(-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)]
    return polygon(corners, order, closed=False)


def evaluate(outline, order, closed, material, displacement, centre=(0.0, 0.0), levels=LEVELS):
    """Positions, displacement and stress of one element whose nodes follow `displacement(x, y)`."""
    centre = np.asarray(centre, dtype=float)
    placement = placements(outline[None], order, closed, material.isotropic)[0]
    solution = solve_selement(Sectors(placement.shape, order, material.elasticity), closed, 0)
    sizes, rotations = np.array([placement.size]), placement.rotation[None]
    boundary = displacement(*(outline + centre).T)[placement.permutation][None]
    sectors = Sectors(placement.shape, order, material.elasticity)
    found = sampled(solution.radial, sectors, closed, levels, (boundary, sizes, rotations))
    return found[0][0] + centre, found[1][0], found[2][0] * material.modulus


def sampled(radial, sectors, closed, levels, copies):
    """(k, l, edges, q, ...) places, displacement and stress over E, at levels and at AT on all edges."""
    boundary, sizes, rotations = copies
    edges = edge_nodes(len(sectors.shape), sectors.order, closed)
    grid = np.meshgrid(np.arange(len(levels)), np.arange(len(edges)), AT, indexing="ij")
    which, edge, eta = (axis.ravel() for axis in grid)
    columns = np.einsum("kij,knj->nik", rotations, boundary).reshape(len(radial), -1)
    located = Located(edge, eta, levels[which])
    fields = static_fields(radial, columns, levels, levels)
    moved, stress = in_own_frames(*fields_at(sectors, closed, located, fields, which), rotations)
    outline = shape_functions(sectors.order, AT)[0] @ sectors.shape[edges]
    places = np.einsum("k,l,eqi,kij->kleqj", sizes, levels, outline, rotations)
    size = (len(sizes), *grid[0].shape, -1)
    return places, moved.reshape(size), (stress / sizes[:, None, None]).reshape(size)


def linear(gradient):
    return lambda x, y: np.stack([x, y], axis=-1) @ np.asarray(gradient).T + np.array([3.0e-6, -1.0e-6])


GRADIENT = np.array([[1.0e-4, 4.0e-5], [-2.0e-5, -3.0e-5]])
STRAIN = np.array([GRADIENT[0, 0], GRADIENT[1, 1], GRADIENT[0, 1] + GRADIENT[1, 0]])


@pytest.mark.parametrize("order", [1, 3, 8])
@pytest.mark.parametrize(
    "material",
    [
        STEEL,
        Material(2.0e11, 0.3, 7800.0, plane="strain"),
        OrthotropicMaterial(1.4e11, 1.0e10, 0.3, 5.0e9, 1600.0, angle=25.0),
    ],
    ids=["stress", "strain", "orthotropic"],
)
def test_patch_test_in_a_pentagon(order, material):
    at, displacement, stress = evaluate(
        pentagon(order), order, True, material, linear(GRADIENT), centre=(0.4, 0.002)
    )
    exact = linear(GRADIENT)(at[..., 0], at[..., 1])
    assert np.abs(displacement - exact).max() < 1e-12 * np.abs(exact).max()
    expected = material.modulus * material.elasticity @ STRAIN
    # the smallest xi divides round-off of the displacement by 1e-3 of the size
    assert np.abs(stress - expected).max() < 1e-8 * np.abs(expected).max()
    assert np.abs(stress[:3] - expected).max() < 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("order", [2, 5])
def test_pure_bending(order):
    curvature = 0.02

    def bending(x, y):
        return np.stack([-curvature * x * y, 0.5 * curvature * (x**2 + STEEL.poisson * y**2)], axis=-1)

    at, displacement, stress = evaluate(
        pentagon(order), order, True, STEEL, bending, centre=(0.01, 0.003), levels=LEVELS[:4]
    )
    exact = bending(at[..., 0], at[..., 1])
    assert np.abs(displacement - exact).max() < 1e-12 * np.abs(exact).max()
    expected = -STEEL.young * curvature * at[..., 1]
    scale = np.abs(expected).max()
    assert np.abs(stress[..., 0] - expected).max() < 1e-9 * scale
    assert np.abs(stress[..., 1:]).max() < 1e-9 * scale


def williams(x, y):
    """Displacement of a unit mode I field, plane stress, crack on the negative x axis (without the factor 1 /
    2G sqrt(2 pi)).
    """
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    kappa = (3.0 - STEEL.poisson) / (1.0 + STEEL.poisson)
    return np.sqrt(r)[..., None] * np.stack(
        [np.cos(angle / 2) * (kappa - np.cos(angle)), np.sin(angle / 2) * (kappa - np.cos(angle))], axis=-1
    )


def test_crack_tip_field_and_its_exponent():
    def field(x, y):
        values = williams(x, y)
        # the first node lies on the lower face, where the angle is -pi and not +pi
        values[0] = williams(x[:1], np.array([-1e-300]))[0]
        return values

    levels = np.geomspace(1.0, 1e-6, 7)
    at, displacement, stress = evaluate(crack_square(10), 10, False, STEEL, field, levels=levels)
    inner = np.abs(at[..., 1]) > 1e-12 * levels[:, None, None]
    exact = williams(at[..., 0], at[..., 1])
    error = np.abs(displacement - exact).max(axis=-1)[inner]
    assert error.max() < 1e-6 * np.abs(exact).max()
    size = np.abs(displacement).max(axis=(1, 2, 3))
    slopes = np.diff(np.log(size)) / np.diff(np.log(levels))
    assert np.abs(slopes[2:] - 0.5).max() < 1e-5
    # sigma_yy ahead of the tip is K_I / sqrt(2 pi r); the field above is that of K_I / (2 G sqrt(2 pi)) = 1
    shear = STEEL.young / (2.0 * (1.0 + STEEL.poisson))
    ahead = (np.abs(at[..., 1]) < 1e-12) & (at[..., 0] > 0)
    ratio = stress[..., 1][ahead] * np.sqrt(at[..., 0][ahead]) / (2.0 * shear)
    assert len(ratio) and np.abs(ratio - 1.0).max() < 2e-4


def test_crack_tip_exponents_of_any_boundary_displacement():
    outline = crack_square(4)
    shape = outline / np.sqrt((outline**2).sum(axis=1)).max()
    solution = solve_selement(Sectors(shape, 4, STEEL.elasticity), False, 0)
    boundary = np.random.default_rng(1).standard_normal((2 * len(shape), 1))
    levels = np.array([1e-4, 1e-6, 1e-8, 0.0])
    field = radial_displacement(solution.radial, boundary, levels)[..., 0]
    distance = np.abs(field[:3] - field[3]).max(axis=1)
    slopes = np.diff(np.log(distance)) / np.diff(np.log(levels[:3]))
    assert np.abs(slopes - 0.5).max() < 2e-2 and abs(slopes[1] - 0.5) < 2e-4
    centre = field[3].reshape(-1, 2)
    assert np.abs(centre - centre[0]).max() < 1e-12


def test_turned_and_mirrored_copies_share_one_sampler():
    order = 4
    outline = pentagon(order) + 0.15 * 0.02 * np.array([0.3, -0.2])
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    mirror = np.array([[1.0, 0.0], [0.0, -1.0]]) @ turn
    copies = [outline, 3.0 * outline @ turn.T, (0.5 * outline @ mirror.T)[::-1]]
    copies[2] = np.roll(copies[2], 1, axis=0)  # start at a corner

    def bump(x, y):
        return np.stack([np.sin(70.0 * x + 20.0 * y), np.cos(50.0 * x * y / 0.02) + 30.0 * y], axis=-1)

    base = bump(outline[:, 0], outline[:, 1])
    fields = [base, base @ turn.T, np.roll((base @ mirror.T)[::-1], 1, axis=0)]
    transforms, scales = [np.eye(2), turn, mirror], [1.0, 3.0, 0.5]
    placed = placements(np.stack(copies), order, True, True)
    assert all(np.abs(p.shape - placed[0].shape).max() < 1e-12 for p in placed)
    solution = solve_selement(Sectors(placed[0].shape, order, STEEL.elasticity), True, 0)
    boundary = np.stack([f[p.permutation] for f, p in zip(fields, placed)])
    sizes, rotations = np.array([p.size for p in placed]), np.stack([p.rotation for p in placed])
    sectors = Sectors(placed[0].shape, order, STEEL.elasticity)
    at, displacement, stress = sampled(solution.radial, sectors, True, LEVELS, (boundary, sizes, rotations))
    stress = stress * STEEL.modulus
    tensor = stress[..., [0, 2, 2, 1]].reshape(*stress.shape[:-1], 2, 2)
    for copy, (q, scale) in enumerate(zip(transforms, scales)):
        assert np.abs(at[copy] - scale * at[0] @ q.T).max() < 1e-14
        assert np.abs(displacement[copy] - displacement[0] @ q.T).max() < 1e-11
        # at the smallest xi the difference of nearly equal displacements is divided by 1e-3
        assert (
            np.abs(scale * tensor[copy][:4] - q @ tensor[0][:4] @ q.T).max()
            < 1e-10 * np.abs(tensor[0][:4]).max()
        )


def test_curved_edges():
    order = 6
    angles = np.concatenate(
        [a + 0.5 * np.pi * 0.5 * (1.0 + gll_nodes(order)[:-1]) for a in 0.5 * np.pi * np.arange(4)]
    )
    disc = 0.01 * np.stack([np.cos(angles), np.sin(angles)], axis=1) + np.array([0.002, 0.001])
    at, displacement, stress = evaluate(disc, order, True, STEEL, linear(GRADIENT), levels=LEVELS[:4])
    exact = linear(GRADIENT)(at[..., 0], at[..., 1])
    expected = STEEL.modulus * STEEL.elasticity @ STRAIN
    assert np.abs(displacement - exact).max() < 1e-12 * np.abs(exact).max()
    assert np.abs(stress - expected).max() < 1e-9 * np.abs(expected).max()


def test_levels_out_of_range_and_stress_at_the_centre():
    outline = pentagon(2)
    with pytest.raises(ValueError, match="between 0 .* and 1"):
        evaluate(outline, 2, True, STEEL, linear(GRADIENT), levels=np.array([1.0, 1.5]))
    stress = evaluate(outline, 2, True, STEEL, linear(GRADIENT), levels=np.array([1.0, 0.0]))[2]
    assert np.isnan(stress[-1]).all() and np.isfinite(stress[:-1]).all()


def test_semigroup_without_a_basis_of_eigenvectors():
    """xi^A applied in one step and in many agree, and a Jordan block is handled."""
    block = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
    _, rest = translations(6)
    radial = rest @ block @ rest.T
    boundary = rest @ np.array([[0.0], [0.0], [0.0], [1.0]])
    level = 0.2
    log = np.log(level)
    exact = rest @ (level * np.array([log**3 / 6, log**2 / 2, log, 1.0]))[:, None]
    assert np.abs(radial_displacement(radial, boundary, np.array([level]))[0] - exact).max() < 1e-14
    assert np.abs(radial_displacement(radial, boundary, np.array([0.2, 0.9, 0.5]))[0] - exact).max() < 1e-14
