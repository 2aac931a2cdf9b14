"""Many S-elements at once, beside each alone by ordered Schur forms and by the whole continued fraction."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Hole, Plate
from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement import solution
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import begun, inertia_of_stack, solve_selement, solve_stack
from sbfem_petsc.system.elements import shapes
from tests.selement.test_solution import polygon

MATERIALS = [Material(1.0, 0.3, 1.0), OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=20.0)]
FLAT = [(-1.0, -0.02), (1.0, -0.02), (1.0, 0.02), (-1.0, 0.02)]


def outlines(sides: int, order: int) -> np.ndarray:
    generator = np.random.default_rng(sides)
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    found = []
    for _ in range(5):
        radius = generator.uniform(0.8, 1.2, sides)
        turn = angles + generator.uniform(-0.2, 0.2, sides)
        found.append(polygon(radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1), order))
    return np.array(found)


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize("material", MATERIALS, ids=["isotropic", "orthotropic"])
@pytest.mark.parametrize(("sides", "order"), [(3, 5), (4, 1), (4, 5), (5, 3)])
def test_stacks_are_what_each_is_alone(sides, order, material):
    """Stiffness, mass, C C' and C J C' to 1e-12 of what ordered Schur forms of each give."""
    stack = outlines(sides, order)
    found = solve_stack(Sectors(stack, order, material.elasticity))
    inertia = inertia_of_stack(found, 1)
    for shape, element, moments in zip(stack, found, inertia):
        alone = solve_selement(Sectors(shape, order, material.elasticity), True, 1, method="schur")
        assert relative(element.stiffness, alone.stiffness) < 1e-12
        assert relative(moments.mass, alone.mass) < 1e-12
        assert relative(moments.second, alone.coupling @ alone.coupling.T) < 1e-12
        assert relative(moments.third, (alone.coupling * alone.inertia) @ alone.coupling.T) < 1e-12


def test_companions_change_nothing():
    """Bitwise, for ranks share stacks; a curved outline, and one that its centre does not see, are None."""
    stack, elasticity = outlines(4, 5), MATERIALS[0].elasticity
    whole = solve_stack(Sectors(stack, 5, elasticity))
    part = solve_stack(Sectors(stack[1:4], 5, elasticity))
    assert all((a.stiffness == b.stiffness).all() for a, b in zip(whole[1:4], part))
    both = inertia_of_stack(whole, 1)[1:4], inertia_of_stack(part, 1)
    assert all((a.third == b.third).all() for a, b in zip(*both))
    curved = stack * (1.0 + 0.02 * np.cos(3.0 * np.arange(20)))[:, None]
    mixed = np.array([stack[0], curved[0], stack[1]])
    first, none, last = solve_stack(Sectors(mixed, 5, elasticity))
    assert none is None and first.stiffness.tolist() == whole[0].stiffness.tolist()
    assert last.stiffness.tolist() == whole[1].stiffness.tolist()
    assert solve_stack(Sectors(np.array([stack[0], stack[1] + [3.0, 0.0]]), 5, elasticity)) == [
        None,
        None,
    ]
    assert inertia_of_stack(whole, 2) == [None] * len(whole)
    # on flat cells the polynomial modes depend on one another: 7e-10 would be left of C C'
    assert inertia_of_stack(solve_stack(Sectors(polygon(FLAT, 5)[None], 5, elasticity)), 1) == [None]


def test_what_both_begin_with_changes_nothing():
    """Bitwise, whether inertia begins anew or with what the stiffness has begun with."""
    stack = Sectors(outlines(4, 5), 5, MATERIALS[0].elasticity)
    start, anew = begun(stack), solve_stack(stack)
    found = solve_stack(stack, start)
    assert all((a.stiffness == b.stiffness).all() for a, b in zip(found, anew))
    for one, other in zip(inertia_of_stack(found, 1, start), inertia_of_stack(anew, 1)):
        for name in ("mass", "second", "third"):
            assert (getattr(one, name) == getattr(other, name)).all()


def test_model_begins_with_what_its_stiffness_has_begun_with(monkeypatch):
    """Cells are begun with once; of so many shapes that it would take memory, again for their inertia."""
    mesh = Plate([(0, 0), (1, 0), (1, 0.7), (0, 0.7)], holes=[Hole(0.4, 0.3, 0.2)]).mesh(order=3, size=0.2)
    steel, stacks = sb.Material(206e9, 0.3, 7850), []
    monkeypatch.setattr(shapes, "begun", lambda stack: stacks.append(begun(stack)) or stacks[-1])
    monkeypatch.setattr(solution, "begun", lambda stack: stacks.append(begun(stack)) or stacks[-1])
    found = {}
    for most in (1, 1000):
        monkeypatch.setattr(shapes, "STACK", most)
        model = sb.Model(mesh, steel, clamped="edge1")
        once = len(stacks)
        found[most] = [group.solution.mass for group in model.cells.moving]
        assert (len(stacks) == once) == (most > 1)
        stacks.clear()
    assert all((one == other).all() for one, other in zip(found[1], found[1000]))


def test_inertia_begins_anew_after_an_interruption(monkeypatch):
    """What is stopped in its second stack, in a notebook say, has not left its beginnings to other stacks."""
    mesh = Plate([(0, 0), (1, 0), (1, 0.7), (0, 0.7)], holes=[Hole(0.4, 0.3, 0.2)]).mesh(order=3, size=0.2)
    steel, calls = sb.Material(206e9, 0.3, 7850), []
    monkeypatch.setattr(shapes, "STACK", 1000)
    expected = [group.solution.mass for group in sb.Model(mesh, steel, clamped="edge1").cells.moving]

    def stopped(*given) -> list:
        calls.append(given)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return inertia_of_stack(*given)

    monkeypatch.setattr(shapes, "inertia_of_stack", stopped)
    model = sb.Model(mesh, steel, clamped="edge1")
    with pytest.raises(KeyboardInterrupt):
        _ = model.cells.moving
    found = [group.solution.mass for group in model.cells.moving]
    assert all((one == other).all() for one, other in zip(found, expected))


def test_modes_by_moments(monkeypatch):
    """Frequencies of a plate with a hole, whose cells are straight, curved and small, by the moments are
    those by the whole continued fraction of each cell: what is kept of either is the same space.
    """
    mesh = Plate([(0, 0), (1, 0), (1, 0.7), (0, 0.7)], holes=[Hole(0.4, 0.3, 0.2)]).mesh(order=4, size=0.2)
    steel = sb.Material(206e9, 0.3, 7850)

    def frequencies() -> tuple[np.ndarray, int]:
        with sb.Model(mesh, steel, clamped="edge1") as model:
            found = sb.modal(model, 12)
            return found.frequencies, found.unknowns

    expected, unknowns = frequencies()
    monkeypatch.setattr(shapes, "inertia_of_stack", lambda elements, *_: [None] * len(elements))
    found, as_many = frequencies()
    assert as_many == unknowns > 0
    np.testing.assert_allclose(expected, found, rtol=1e-11)


def test_triangles_of_order_one():
    """Polynomials are all their modes: no Schur form is left to take, and each is solved alone."""
    stack, elasticity = outlines(3, 1), MATERIALS[0].elasticity
    found = solve_stack(Sectors(stack, 1, elasticity))
    for shape, element in zip(stack, found):
        alone = solve_selement(Sectors(shape, 1, elasticity), True, 1, method="schur")
        assert relative(element.stiffness, alone.stiffness) < 1e-12
    assert inertia_of_stack(found, 1) == [None] * len(stack)
