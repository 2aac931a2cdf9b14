"""Coulomb friction at rest: closed forms, enumeration of states, uniform stress in bodies with any cracks."""

import itertools
import math
import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from sbfem_petsc.contact import friction_solve
from sbfem_petsc.contact.complementarity import Complementarity, solve_complementarity
from sbfem_petsc.contact.friction import STICKS, Friction, Memory, rubbing_of
from sbfem_petsc.contact.friction_solve import solve_friction
from sbfem_petsc.contact.law import FREE, RowLaws
from sbfem_petsc.contact.problem import Problem, empty_sets
from sbfem_petsc.contact.rubbing import rubbing_forces
from tests.validation.contact_cases import ray

SIDE = 0.1
ALUMINIUM = sb.Material(70e9, 0.33, 2700)


# ---------------------------------------------------------------------- rows
def problem(rng, count, most):
    """Rows of a random body, each with its own coefficient."""
    root = rng.normal(size=(2 * count, 2 * count + rng.integers(0, 3)))
    coefficients = rng.uniform(0.0, most, count)
    return 1e-9 * root @ root.T, Friction(np.arange(count), coefficients, coefficients)


def states_of_lemke(flexibility, free, laws, friction):
    """After slips of zero, by Lemke's method alone: without room for sets none are exchanged."""
    count, state = len(laws), np.zeros(len(free), dtype=np.int8)
    sets = empty_sets(len(free))._replace(seen=np.zeros(0, dtype=np.int64))
    rubbing, still, force = rubbing_of(friction, flexibility, count), np.zeros(len(free)), np.zeros(len(free))
    assert rubbing_forces(Problem(flexibility, free, still, laws.table, rubbing, state, sets, force)) == -1
    return state


def check(flexibility, free, friction, memory, found):
    """The law itself, row by row."""
    count = len(friction.rows)
    pressure, along = found.force[:count], found.force[count:]
    gap, moved = np.split(flexibility @ found.force + free, 2)
    moved = moved - memory.slip
    force = 1e-9 * np.abs(found.force).max()
    length = 1e-9 * max((np.abs(flexibility) @ np.abs(found.force)).max(), np.abs(free).max())
    assert (pressure >= -force).all() and (gap >= -length).all()
    assert ((pressure <= force) | (gap <= length)).all()
    bound = friction.kinetic * pressure
    assert (np.abs(along) <= bound + force).all()
    slips = np.abs(moved) > length
    assert np.abs(along + bound * np.sign(moved))[slips] == pytest.approx(0.0, abs=force)


def enumerated(flexibility, free, friction, memory):
    """All solutions, by trying every row apart, sticking, and slipping either way."""
    count, solutions = len(friction.rows), []
    for states in itertools.product(range(4), repeat=count):
        matrix, right = np.zeros((4 * count, 4 * count)), np.zeros(4 * count)
        # forces, then gap and slip
        matrix[: 2 * count, : 2 * count], matrix[: 2 * count, 2 * count :] = flexibility, -np.eye(2 * count)
        right[: 2 * count] = -free
        for k, state in enumerate(states):
            n, t, gap, slip = k, count + k, 2 * count + k, 3 * count + k
            first, second = 2 * count + k, 3 * count + k
            matrix[first, n if state == 0 else gap] = 1.0
            if state == 1:
                matrix[second, slip], right[second] = 1.0, memory.slip[k]
            else:
                matrix[second, t] = 1.0
                matrix[second, n] += {0: 0.0, 2: -1.0, 3: 1.0}[state] * friction.kinetic[k]
        scale = np.repeat([1e3, 1e-6], 2 * count)
        x = scale * np.linalg.solve(matrix * scale, right)
        n, t, gap, moved = np.split(x, 4)
        moved = moved - memory.slip
        state = np.array(states)
        stays = np.select(
            [state == 0, state == 1, state == 2],
            [
                gap >= 0,
                (n >= 0) & (np.abs(t) <= friction.kinetic * n),
                (n >= 0) & (moved <= 0),
            ],
            (n >= 0) & (moved >= 0),
        )
        if stays.all():
            solutions.append(x[: 2 * count])
    return solutions


@pytest.mark.parametrize("most", [0.5, 1.5])
def test_few_rows_against_enumeration(most):
    rng = np.random.default_rng(int(10 * most))
    for _ in range(40):
        flexibility, friction = problem(rng, int(rng.integers(1, 4)), most)
        memory = Memory.none(RowLaws.unilateral(len(friction.rows)), friction)
        for _ in range(2):
            free = 1e-6 * rng.normal(size=len(flexibility))
            found = solve_friction(
                flexibility, free, RowLaws.unilateral(len(friction.rows)), friction, memory
            )
            memory = memory._replace(slip=found.kept)
            check(flexibility, free, friction, memory, found)
            known = enumerated(flexibility, free, friction, memory)
            off = [np.abs(found.force - force).max() for force in known]
            assert min(off) <= 1e-8 * np.abs(found.force).max()
            memory = Memory.of(found, len(friction.rows))


@pytest.mark.parametrize("count", [100, pytest.param(600, marks=pytest.mark.long)])
def test_sequences_of_random_problems(count):
    """Each solution obeys the law, and there is none that is not found, coefficients of 1.5 included."""
    rng = np.random.default_rng(7)
    for _ in range(count):
        rows = int(rng.integers(1, 21))
        flexibility, friction = problem(rng, rows, rng.choice([0.5, 1.5]))
        laws = RowLaws.unilateral(rows)
        memory = Memory.none(laws, friction)
        for _ in range(3):
            free = 1e-6 * rng.normal(size=2 * rows)
            found = solve_friction(flexibility, free, laws, friction, memory)
            check(flexibility, free, friction, memory._replace(slip=found.kept), found)
            memory = Memory.of(found, rows)


def test_rows_that_move_by_fewer_motions_than_they_are():
    """As gaps and slips around one node: gaps are those of the forces, or no solution is told."""
    told = 0
    for seed in range(460, 590):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(2, 5))
        root = rng.standard_normal((2 * count, int(rng.integers(2, 2 * count + 1))))
        flexibility = 1e-9 * root @ root.T + (1e-16 if rng.random() < 0.5 else 0.0) * np.eye(2 * count)
        within = rng.random() < 0.7
        free = 1e-6 * (
            root @ rng.standard_normal(root.shape[1]) if within else rng.standard_normal(2 * count)
        )
        coefficients = rng.uniform(0.8, 2.5, count)
        friction, laws = Friction(np.arange(count), coefficients, coefficients), RowLaws.unilateral(count)
        try:
            found = solve_friction(flexibility, free, laws, friction, Memory.none(laws, friction))
        except sb.SolveError:
            told += 1
            continue
        missed = flexibility @ found.force + free - found.gap
        assert np.abs(missed).max() <= 1e-6 * np.abs(free).max()  # of huge forces that take no part, rounding
        check(flexibility, free, friction, Memory.none(laws, friction)._replace(slip=found.kept), found)
    assert told < 13  # large coefficients, which may have none


@pytest.mark.parametrize(
    "each, draws",
    [
        ([sb.Coulomb(0.9), sb.Tied(), sb.Clearance(width=2e-7), sb.Coulomb(1.2), sb.Unilateral()], 200),
        # tied rows that Lemke's method pressed and pulled at once left it without a solution in 4 of these
        ([*map(sb.Coulomb, (2.5, 3.0, 3.5)), *[sb.Tied()] * 3, sb.Unilateral()], 300),
    ],
)
def test_rows_of_other_laws_beside_those_that_rub(each, draws):
    """Tied rows and rows with play, which do not rub, from Lemke's states: the same with each of them
    condensed by what it does; where that is the only solution, what is found from states that suit none.
    """
    rng = np.random.default_rng(5)
    laws, count = RowLaws.of(each), len(each)
    rows = np.array([k for k, law in enumerate(each) if law.rubs])
    others, own = np.setdiff1d(np.arange(count), rows), np.append(rows, count + np.arange(len(rows)))
    friction, pair = Friction.of(each, rows), Friction.of([each[k] for k in rows], np.arange(len(rows)))
    memory, apart = Memory.none(laws, friction), Memory.none(RowLaws.unilateral(len(rows)), pair)
    total = count + len(rows)
    for _ in range(draws):
        root = rng.normal(size=(total, total + (friction.kinetic.max() < 2.0)))
        flexibility, free = 1e-9 * root @ root.T, 1e-6 * rng.normal(size=total)
        states = states_of_lemke(flexibility, free, laws, friction)
        begun = memory._replace(normal=states[:count], tangential=states[count:])
        lemke = solve_friction(flexibility, free, laws, friction, begun)
        force, own_rows = lemke.force, Complementarity(lemke.force[own], lemke.gap[own], lemke.state[own], 1)
        assert lemke.iterations == 1  # Lemke's states are a solution's: one exchange shows it
        if friction.kinetic.max() < 2.0:
            found = solve_friction(flexibility, free, laws, friction, memory)
            assert force == pytest.approx(found.force, rel=1e-6, abs=1e-9)
        acting = free + flexibility[:, own] @ force[own]
        alone = solve_complementarity(
            flexibility[np.ix_(others, others)], acting[others], RowLaws.of([each[k] for k in others])
        )
        assert alone.force == pytest.approx(force[others], abs=1e-9 * np.abs(force).max())
        acting = (free + flexibility[:, others] @ force[others])[own]
        check(flexibility[np.ix_(own, own)], acting, pair, apart, own_rows)


@pytest.mark.parametrize("most", [0.5, 3.0])
def test_states_of_lemkes_method(most):
    """They are those of a solution, which one set shows, and one of those that trying all states finds: rows
    that stick while both senses of friction are basic, too.
    """
    rng = np.random.default_rng(7)
    for _ in range(400):
        count = int(rng.integers(1, 4))
        flexibility, friction = problem(rng, count, most)
        laws, free = RowLaws.unilateral(count), 1e-6 * rng.normal(size=2 * count)
        memory, state = Memory.none(laws, friction), states_of_lemke(flexibility, free, laws, friction)
        begun = memory._replace(normal=state[:count], tangential=state[count:])
        found = solve_friction(flexibility, free, laws, friction, begun)
        assert found.iterations == 1 and (found.state == state).all()
        known = enumerated(flexibility, free, friction, memory)
        assert min(np.abs(found.force - force).max() for force in known) <= 1e-8 * np.abs(found.force).max()


def test_rows_that_are_held_twice():
    """Tied rows that are the same, beside rows that rub: what one of them alone does, which they share."""
    rng, each = np.random.default_rng(3), [*map(sb.Coulomb, (0.2, 0.5, 1.2)), *[sb.Tied()] * 3]
    twice = np.array([0, 1, 2, 3, 4, 3, 5, 6, 7])  # the fourth row stands for the sixth, too
    for _ in range(100):
        root = rng.normal(size=(8, 8))
        flexibility, free, found = 1e-9 * root @ root.T, 1e-6 * rng.normal(size=8), []
        for order, laws in ((np.arange(8), RowLaws.of(each[:5])), (twice, RowLaws.of(each))):
            friction = Friction.of(each, np.arange(3))
            given = flexibility[np.ix_(order, order)], free[order], laws, friction
            found.append(solve_friction(*given, Memory.none(laws, friction)).force)
        expected, force = found
        assert np.delete(force, [3, 5]) == pytest.approx(np.delete(expected, 3), rel=1e-7, abs=1e-9)
        assert force[3] + force[5] == pytest.approx(expected[3], rel=1e-7, abs=1e-9)


def test_steady_states_with_rows_that_are_held_twice():
    """A tied row given twice beside one that rubs: motion and multipliers as if it were given once, and
    a slip more that nothing remembers.
    """
    size, found = 6, []
    unit = np.eye(size)
    for times in (1, 2):
        reduced = sb.reduce_matrices(
            unit,
            2.0 * unit - np.eye(size, k=1) - np.eye(size, k=-1),
            np.concatenate([unit[[1]], *[unit[[3]] - unit[[4]]] * times]),
            np.array([0.3, *[0.0] * times]),
            loads=unit,
            sensors={"x": 1},
            modes=4,
            damping=0.1,
            compliance=[1e-3, *[0.0] * times],
            contact_laws=[sb.Coulomb(0.4), *[sb.Tied()] * times],
            tangent_rows=np.concatenate([unit[[2]], *[0.0 * unit[:1]] * times]),
        )
        waves = {1: sb.Harmonic(2.0, 0.11), 2: sb.Harmonic(0.7, 0.11, phase=40.0), 4: sb.Harmonic(0.3, 0.11)}
        load = [waves.get(k, sb.Constant(0.0)) for k in range(size)]
        found.append(sb.periodic(reduced, load, 0.11, steps=256))
    once, twice = found
    assert twice.displacement("x") == pytest.approx(once.displacement("x"), abs=1e-9)
    for multiplier in once.multipliers:
        assert np.abs(twice.multipliers - multiplier).min() < 1e-7


def landing_slips(flexibility, free, friction, memory):
    """Slips where rows that stood apart land, by each solution without them that trying all states finds."""
    count = len(friction.rows)
    stay = np.flatnonzero((memory.gap == 0.0) | (memory.normal != FREE))
    both, slips = np.append(stay, count + stay), []
    coefficients = friction.kinetic[stay]
    rest = Friction(np.arange(len(stay)), coefficients, coefficients)
    for force in enumerated(
        flexibility[np.ix_(both, both)], free[both], rest, memory._replace(slip=memory.slip[stay])
    ):
        gap, slip = np.split(flexibility[:, both] @ force + free, 2)
        share = memory.gap / np.maximum(memory.gap - np.minimum(gap, 0.0), 1e-300)
        slips.append(memory.slip + share * (slip - memory.slip))
    return slips


@pytest.mark.parametrize("most", [0.8, 3.0])
def test_rows_land_where_gap_and_slip_go_linearly(most):
    """What a row keeps that lands is its slip where its gap closes on the way from the state before to that
    without the rows that stood apart, beside trying all states; Lemke's states of large coefficients too.
    """
    rng, states = np.random.default_rng(7), 0
    for _ in range(140):
        count = int(rng.integers(2, 5))
        flexibility, friction = problem(rng, count, most)
        laws = RowLaws.unilateral(count)
        memory = Memory.none(laws, friction)
        for _ in range(4):
            free = 1e-6 * rng.normal(size=2 * count)
            found = solve_friction(flexibility, free, laws, friction, memory)
            check(flexibility, free, friction, memory._replace(slip=found.kept), found)
            lands = (memory.gap > 0.0) & (memory.normal == FREE) & found.active[:count]
            if lands.any():
                told = landing_slips(flexibility, free, friction, memory)
                assert min(np.abs(slips - found.kept)[lands].max() for slips in told) < 1e-12
                states += 1
            memory = Memory.of(found, count)
    assert states > 200, states


def test_rows_that_hardly_rub_are_rows_that_do_not():
    """Beside others that rub, also where they land: a coefficient of 1e-12 has the forces of none."""
    rng, landed = np.random.default_rng(2), 0
    for _ in range(150):
        count = int(rng.integers(2, 13))
        flexibility, friction = problem(rng, count, 0.5)
        none = np.where(np.arange(count) < count // 2, 0.0, friction.kinetic)
        laws, memories = RowLaws.unilateral(count), [Memory.none(RowLaws.unilateral(count), friction)] * 2
        for _ in range(3):
            free, found = 1e-6 * rng.normal(size=2 * count), []
            for k, each in enumerate((none, np.maximum(none, 1e-12))):
                rubs = Friction(friction.rows, each, each)
                found.append(solve_friction(flexibility, free, laws, rubs, memories[k]))
            scale = np.abs(found[0].force).max()
            assert found[1].force == pytest.approx(found[0].force, abs=1e-9 * scale)
            lands = (memories[0].gap > 0.0) & (memories[0].normal == FREE) & found[0].active[:count]
            landed += lands[: count // 2].any() and lands[count // 2 :].any()
            memories = [Memory.of(each, count) for each in found]
    assert landed > 50, landed


def swept(flexibility, free, friction, slip, times):
    """Forces by nonsmooth Gauss-Seidel: each pair of rows exactly under the forces of others."""
    count, force = len(slip), np.zeros(len(free))
    for _ in range(times):
        for i in range(count):
            pair = [i, count + i]
            own = flexibility[np.ix_(pair, pair)]
            rest = (free + flexibility @ force)[pair] - own @ force[pair] - [0.0, slip[i]]
            mu, found = friction.kinetic[i], np.linalg.solve(own, -rest)
            if abs(found[1]) > mu * found[0]:
                pull = np.sign(own[0, 1] * rest[0] - own[0, 0] * rest[1]) * mu
                found = -rest[0] / (own[0, 0] + pull * own[0, 1]) * np.array([1.0, pull])
            force[pair] = found if rest[0] < 0.0 else 0.0
    return force


def test_sweeps_settle_on_the_solution():
    """Gauss-Seidel as another method, of rows with friction and without."""
    rng = np.random.default_rng(4)
    for _ in range(30):
        count = int(rng.integers(1, 6))
        flexibility, friction = problem(rng, count, 0.5)
        flexibility += 1e-9 * count * np.eye(2 * count)
        friction.kinetic[count // 2 + 1 :] = 0.0  # static is the same array
        laws, free = RowLaws.unilateral(count), 1e-6 * rng.normal(size=2 * count)
        memory = Memory.none(laws, friction)._replace(slip=1e-7 * rng.normal(size=count))
        found = solve_friction(flexibility, free, laws, friction, memory)
        check(flexibility, free, friction, memory, found)
        expected = swept(flexibility, free, friction, memory.slip, 300)
        assert found.force == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_static_coefficient():
    """One row under a pressure that stays: it sticks up to the larger coefficient and slips at the other."""
    friction, laws = Friction(np.zeros(1, dtype=int), np.array([0.2]), np.array([0.3])), RowLaws.unilateral(1)
    memory, flexibility = Memory.none(laws, friction), 1e-9 * np.eye(2)
    for shear, expected in [(0.25, -0.25), (0.31, -0.2), (0.25, -0.14), (0.05, 0.06), (-0.3, 0.2)]:
        free = 1e-9 * np.array([-1.0, shear])
        found = solve_friction(flexibility, free, laws, friction, memory)
        assert found.force == pytest.approx([1.0, expected], rel=1e-12)
        memory = Memory.of(found, 1)


# ---------------------------------------------------------------------- bodies
LINES = {
    "kink": [[(0.05, 0.1), (0.05, 0.07), (0.065, 0.045)]],
    "embedded": [[(0.03, 0.04), (0.07, 0.06)]],
    "crossing": [[(0.03, 0.045), (0.07, 0.055)], [(0.05, 0.03), (0.055, 0.07)]],
    "T": [[(0.03, 0.045), (0.07, 0.055)], [(0.05, 0.1), (0.05, 0.05)]],
    "star": [ray(0.3), ray(2.4), ray(4.5)],
}


def square(lines, law, side=SIDE, material=ALUMINIUM, **options):
    """A square plate on rollers below and at its left."""
    corners = [(0, 0), (side, 0), (side, side), (0, side)]
    plate = Plate(corners, cracks=[CrackLine(points) for points in lines])
    return sb.Model(
        plate.mesh(points={"O": (0, 0), "P": (side, side)}, **options),
        material,
        clamped=None,
        supports=[sb.Support("edge1", x=False, y=True), sb.Support("O", x=True, y=False)],
        contact_laws=law,
    )


def told_of_shared_forces(found):
    """Whether it is told that single forces are not determined, as the rank of the rows that hold tells."""
    told, memory = ["one set of several" in note for note in found.notes], found.equilibrium.memory
    held = np.append(memory.normal != FREE, memory.tangential == STICKS)
    rows = found.model.contact.rows.matrix[held]
    rank = np.linalg.matrix_rank(rows[:, np.unique(rows.indices)].toarray())
    assert any(told) == (rank < held.sum())
    return any(told)


@pytest.mark.parametrize("name", LINES)
def test_faces_that_stick_carry_a_uniform_stress(name):
    """Under unequal pressures, whose shear on every face friction can hold: that of the body without cracks,
    to the tips, in any path. A tenth of the coefficient lets faces slip.
    """
    pressures = {2: 1.0e6, 4: 1.0e6, 3: 1.6e6}
    load = [sb.EdgeLoad(f"edge{side}", pressure=value) for side, value in pressures.items()]
    with square(LINES[name], sb.Coulomb(0.3), order=3) as model:
        found = sb.static(model, load)
        strains = np.array([-1.0e6 + 0.33 * 1.6e6, -1.6e6 + 0.33 * 1.0e6]) / 70e9
        assert found.displacement("P") == pytest.approx(strains * SIDE, rel=1e-9)
        assert np.abs(found.slip).max() < 1e-9 * np.abs(found.displacement("P")).max()
        for factors in found.stress_intensity.values():
            assert np.abs(factors).max() < 1e-9 * 1.6e6 * math.sqrt(math.pi * 0.04)
        assert found.stress((0.051, 0.062)) == pytest.approx([-1.0e6, -1.6e6, 0.0], abs=1e-3)
        assert told_of_shared_forces(found) == (name != "embedded")
    with square(LINES[name], sb.Coulomb(0.03), order=3) as model:
        found = sb.static(model, load)
        assert np.abs(found.slip).max() > 1e-7 * SIDE
        assert (np.abs(found.friction_force) <= 0.03 * found.contact_force * (1 + 1e-9) + 1e-9).all()
        # the reactions are in balance with the loads
        assert sum(found.reactions.values()) == pytest.approx([0.0, 1.6e6 * SIDE], abs=1e-6 * 1.6e6 * SIDE)


def test_forces_around_a_node_are_those_of_lapack(monkeypatch):
    """Of all rows of a kink, which stick: their slack is 5e-9 and 3e-10 of their flexibility, by which
    rounding is multiplied (4e-5 and, by LAPACK, 2e-6 beside numbers of 19 digits).
    """
    problems = []

    def solved(flexibility, free, *rest):
        problems.append((flexibility, free))
        return solve_friction(flexibility, free, *rest)

    monkeypatch.setattr(friction_solve, "solve_friction", solved)
    load = [sb.EdgeLoad(f"edge{side}", pressure=value) for side, value in ((2, 1e6), (4, 1e6), (3, 1.6e6))]
    with square(LINES["kink"], sb.Coulomb(0.3), order=2, size=0.03) as model:
        memory = sb.static(model, load).equilibrium.memory
        expected = -np.linalg.solve(*problems[0])
        assert memory.normal.all() and (memory.tangential == STICKS).all() and len(problems) == 1
        found = np.append(memory.pressing, memory.force)
        assert found == pytest.approx(expected, abs=1.5e-4 * expected.max())


@pytest.mark.parametrize("name", ["kink", pytest.param("crossing", marks=pytest.mark.long)])
def test_faces_that_stick_around_a_node_stay_at_rest(name):
    """Around a node of several pairs gaps and slips are more than there are motions: steps hold them all, and
    where they stood. Forces are those of statics but for rounding over the slack of such rows, 1e-7.
    """
    load = [sb.EdgeLoad(f"edge{side}", pressure=value) for side, value in ((2, 1e6), (4, 1e6), (3, 1.6e6))]
    with square(LINES[name], sb.Coulomb(0.3), order=2, size=0.03) as model:
        expected = sb.static(model, load)
        found = sb.transient(model, load, 8e-6, 2e-6, modes=8, initial="equilibrium")
        at_rest = np.broadcast_to(expected.displacement("P"), (5, 2))
        assert found.displacement("P") == pytest.approx(at_rest, rel=1e-11)
        assert np.abs(found.slip).max() < 1e-12 * np.abs(at_rest).max()
        largest = expected.contact_force.max()
        assert np.abs(found.contact_force - expected.contact_force).max() < 1e-4 * largest
        assert np.abs(found.friction_force - expected.friction_force).max() < 1e-4 * largest


def test_faces_that_meet_without_friction_beside():
    """A crossing crack with a clearance that is closed: its gaps alone depend on what the other one holds."""
    laws = {"crack1": sb.Coulomb(0.3), "crack2": sb.Clearance(width=1e-4)}
    load = [sb.EdgeLoad(f"edge{side}", pressure=1e6) for side in (2, 3, 4)]
    with square(LINES["crossing"], laws, order=2) as model:
        assert told_of_shared_forces(sb.static(model, load))


def test_loads_on_faces_that_stick():
    """Opposite tractions along the faces that friction holds, the ones inside tip elements included, move
    nothing; three times as large they slip.
    """
    load = [sb.EdgeLoad(f"edge{side}", pressure=1e6) for side in (2, 3, 4)]
    with square([[(0.05, 0.1), (0.05, 0.06)]], sb.Coulomb(0.5), order=3) as model:
        for shear in (0.4e6, 1.2e6):
            faces = [sb.EdgeLoad("crack1_left", ty=shear), sb.EdgeLoad("crack1_right", ty=-shear)]
            found = sb.static(model, [*load, *faces])
            (factors,) = found.stress_intensity.values()
            scale = 1e6 * math.sqrt(math.pi * 0.04)
            if shear < 0.5e6:
                assert np.abs(factors).max() < 1e-9 * scale
                assert np.abs(found.slip).max() < 1e-14
                assert np.abs(found.friction_force).max() > 0.0
            else:
                assert np.abs(factors[1]) > 0.1 * scale


@pytest.mark.parametrize(
    "name, coefficient", [pytest.param("T", 0.05, marks=pytest.mark.long), ("crossing", 0.8), ("star", 0.3)]
)
def test_cracks_that_meet_in_a_history(name, coefficient):
    """Loads that come, go and change sign: every row obeys the law in each state, and nothing is gained."""
    levels = 1e6 * np.array([0, 1, 0.3, 0.8, 0.1, 0.5, -0.2, 1.5, 0.3])
    time = np.arange(len(levels), dtype=float)
    loads = [sb.EdgeLoad("edge3", pressure=sb.Samples(time, levels)), sb.EdgeLoad("edge2", pressure=2e5)]
    with square(LINES[name], sb.Coulomb(coefficient), order=3) as model:
        found = sb.load_history(model, loads, time)
        friction, count = model.contact.friction, len(model.contact.laws)
        for state in found.states:
            force, gap = state.equilibrium.force, state.equilibrium.gap
            rows = np.concatenate([friction.rows, count + np.arange(len(friction.rows))])
            flexibility = model.compliance.gaps
            free = (gap - flexibility @ force)[rows]
            result = Complementarity(force[rows], gap[rows], state.equilibrium.active, 1)
            beside = Friction(np.arange(len(friction.rows)), friction.kinetic, friction.static)
            memory = state.equilibrium.memory
            check(flexibility[np.ix_(rows, rows)], free, beside, memory._replace(slip=memory.kept), result)
    assert (np.diff(found.friction_loss) >= 0.0).all()


@pytest.mark.parametrize("degrees", [30, pytest.param(45, marks=pytest.mark.long), 60])
def test_an_oblique_crack_in_compression(degrees):
    """K_I = 0 and K_II = (tau - mu sigma) sqrt(pi a); the plate of 40 half-lengths has 1.65e-3 more."""
    angle, half, stress = math.radians(degrees), 0.01, 100e6
    centre, along = np.full(2, 0.2), half * np.array([math.cos(angle), math.sin(angle)])
    normal, shear = stress * math.cos(angle) ** 2, stress * math.sin(angle) * math.cos(angle)
    whole = stress * math.sqrt(math.pi * half)
    for coefficient in (0.2, 0.4, 0.8):
        with square([[tuple(centre - along), tuple(centre + along)]], sb.Coulomb(coefficient), 0.4) as model:
            found = sb.static(model, sb.EdgeLoad("edge3", pressure=stress))
            expected = max(shear - coefficient * normal, 0.0) * math.sqrt(math.pi * half)
            for first, second in found.stress_intensity.values():
                assert abs(first) < 1e-9 * whole
                assert abs(second) == pytest.approx(expected, rel=1.75e-3, abs=1e-9 * whole)


GEOS = sb.Material(25.000833e9, 0.2500417, 2700, plane="strain")


@pytest.fixture(scope="module")
def slanted():
    """F1 and F2: a crack of 2 m at 20 degrees to the compression, in a plate of 40 m."""
    angle = math.radians(70)
    along = np.array([math.cos(angle), math.sin(angle)])
    with pytest.warns(sb.UnitWarning, match="40"):
        model = square(
            [[tuple(np.full(2, 20.0) - along), tuple(np.full(2, 20.0) + along)]],
            sb.Coulomb(math.tan(math.radians(30))),
            40.0,
            GEOS,
        )
    yield model
    model.destroy()


def test_slanted_crack_of_geos(slanted):
    """Published: Phan, Napier, Gray and Kaplan (2003), and GEOS' singleFracCompression."""
    found = sb.static(slanted, sb.EdgeLoad("edge3", pressure=100e6))
    _, pressure = found.contact_pressure()
    assert pressure == pytest.approx(11.69778e6, rel=2e-3)
    slip = np.abs(found.slip)
    assert slip.max() == pytest.approx(3.807638e-3, rel=2e-3)
    place = slanted.pairs.arc - 1.0
    assert slip == pytest.approx(3.807638e-3 * np.sqrt(1.0 - place**2), rel=2e-3, abs=2e-3 * slip.max())
    for first, second in found.stress_intensity.values():
        assert abs(first) < 1e-6 * 44.99492e6
        assert abs(second) == pytest.approx(44.99492e6, rel=2e-3)


@pytest.mark.parametrize(
    "least, lost",
    [
        (0.0, 33379.77),
        *(pytest.param(*case, marks=pytest.mark.long) for case in ((0.1, 32596.24), (0.2, 30245.68))),
        (0.3, 26328.07),
    ],
)
def test_walshs_loop(slanted, least, lost):
    """Loaded, unloaded to a share of the load, and loaded again: the loss of a cycle; back-slip from .652704
    of the peak.
    """
    levels = np.linspace(1.0, least, 41)
    levels = np.concatenate([levels, levels[-2::-1]])
    loads = sb.EdgeLoad("edge3", pressure=sb.Samples(np.arange(len(levels)), 100e6 * levels))
    found = sb.load_history(slanted, loads, np.arange(len(levels), dtype=float))
    assert found.friction_loss[-1] - found.friction_loss[0] == pytest.approx(lost, rel=5e-3)
    assert (np.diff(found.friction_loss) >= -1e-9 * lost).all()
    middle = np.abs(found.slip[0]).argmax()
    stuck = found.slip[:41, middle] == found.slip[0, middle]
    assert (stuck == (levels[:41] >= 0.652704)).all()
    assert found.slip[-1] == pytest.approx(found.slip[0], rel=1e-9)


def test_layers_give_way_before_they_slip():
    """Along the faces as across them: a crack through the whole plate under pressure and shear of its two
    halves, on whose layer a uniform friction acts.
    """
    law = sb.Coulomb(0.5, compliance=2e-13, tangential_compliance=3e-13)
    beam = Beam(length=0.04, height=0.01, notches=[VNotch(0.02, 0.005, 0.0)])
    with sb.Model(beam.mesh(order=3), ALUMINIUM, contact_laws=law) as model:
        load = [sb.EdgeLoad("right", tx=-1e6), sb.PointForce("A", fy=-50.0)]
        found = sb.static(model, load)
        operator, count = model.contact, len(model.contact.laws)
        assert found.active.any()
        pairs = operator.pairs
        sticks = found.active & (np.abs(found.friction_force) < 0.499 * found.contact_force)
        rows = operator.rows(found.equilibrium.owned)
        area = model.pairs.weight * model.thickness
        # faces that stick slide by what their layer gives way
        given = rows[count : count + pairs] + 3e-13 * found.friction_force / area
        assert sticks.any()
        assert given[sticks] == pytest.approx(0.0, abs=1e-9 * np.abs(rows).max())


def test_without_friction_nothing_changes():
    """Coefficients of zero are the frictionless law, bit by bit."""
    beam = Beam(length=0.2, height=0.006, notches=[VNotch(0.08, 0.003, 0.1)]).mesh(order=3)
    load = sb.PointForce("A", fy=1e3)
    found = []
    for law in (None, sb.Coulomb(0.0)):
        with sb.Model(beam, ALUMINIUM, contact_laws=law) as model:
            found.append(sb.static(model, load))
    one, other = found
    assert one.slip is None and other.slip is None
    assert np.array_equal(one.contact_force, other.contact_force)
    assert np.array_equal(one.field, other.field)
    assert one.stress_intensity == other.stress_intensity


def test_results_hold_slips(tmp_path, slanted):
    found = sb.load_history(slanted, sb.EdgeLoad("edge3", pressure=1e8), [0.0, 1.0])
    sb.save(tmp_path / "history.h5", found)
    read = sb.read(tmp_path / "history.h5")
    for name in ("slip", "friction_force", "friction_loss"):
        assert np.array_equal(getattr(read, name), getattr(found, name)), name


# ---------------------------------------------------------------------- input
@pytest.mark.parametrize(
    "given, told",
    [
        (dict(friction=-0.1), "friction"),
        (dict(friction=math.nan), "friction"),
        (dict(friction=0.3, static_friction=0.2), "at least friction"),
        (dict(friction=0.3, compliance=-1.0), "compliance"),
        (dict(friction=0.3, tangential_compliance=-1.0), "tangential_compliance"),
    ],
)
def test_values_that_make_no_sense(given, told):
    with pytest.raises(ValueError, match=told):
        sb.Coulomb(**given)


def test_what_takes_no_friction_says_so():
    beam = Beam(length=0.2, height=0.006, notches=[VNotch(0.08, 0.003, 0.1)]).mesh(order=3)
    load = sb.PointForce("A", fy=sb.Harmonic(1.0, 100.0))
    with sb.Model(beam, ALUMINIUM, damping=0.01, contact_laws=sb.Coulomb(0.3)) as model:
        calls = [
            lambda: sb.periodic(model, load, 100.0, reduction=None),
            lambda: sb.frequency_response(model, sb.PointForce("A", fy=1.0), 90.0, 110.0, reduction=None),
        ]
        for call in calls:
            with pytest.raises(ValueError, match="knows no friction yet"):
                call()
        assert len(sb.modal(model, 2).frequencies) == 2
    for given, told in [
        (dict(tangent_rows=None), "rubs; give tangent_rows"),
        (dict(tangent_rows=np.eye(2)), "tangent_rows has shape"),
        (dict(contact_laws=sb.Tied()), "tangent_rows say how faces slip, and none of contact_laws rubs"),
        (dict(tangent_compliance=np.ones(2)), "tangent_compliance has shape"),
        (dict(tangent_compliance=[-1.0]), "tangent_compliance -1 m/N is negative"),
        (dict(tangent_compliance=[0.0]), "contact row 0: a rigid slip.*tangent_compliance"),
        (dict(contact_laws=sb.Coulomb(0.3, tangential_compliance=1e-12)), "is a layer in m.3/N"),
    ]:
        with pytest.raises(ValueError, match=told):
            rubbing_mass(**given)
    assert rubbing_mass(contact_laws=sb.Coulomb(0.0), tangent_rows=None).friction is None


def rubbing_mass(**given):
    """A mass on a spring and an elastic slider."""
    one = np.eye(1)
    rubbing = dict(compliance=[1.0], contact_laws=sb.Coulomb(0.3), tangent_rows=one, tangent_compliance=[1.0])
    return sb.reduce_matrices(one, one, one, np.zeros(1), loads=one, sensors={"x": 0}, **rubbing | given)


def test_losses_where_the_slip_turns():
    """One state a reversal, under a pressure that stays: the friction's force times each slip."""
    plate = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=[CrackLine([(0, 0.09), (0.1, 0.09)])])
    held = [sb.Support("edge1", x=True, y=True), sb.Support("edge3", x=1e10, y=1e9)]
    steel = sb.Material(70e12, 0.0, 2700)
    model = sb.Model(plate.mesh(order=2), steel, clamped=None, supports=held, contact_laws=sb.Coulomb(0.3))
    shear = sb.Samples(np.arange(5.0), 1e6 * np.array([0.0, 1.0, -1.0, 1.0, -1.0]))
    load = sb.EdgeLoad("edge3", pressure=1e6) + sb.EdgeLoad("edge3", tx=shear)
    history = sb.load_history(model, load, np.arange(5.0))
    assert history.friction_loss == pytest.approx([0.0, 2.1, 6.3, 10.5, 14.7], rel=2e-3, abs=1e-6)


def test_laws_of_a_model_stay():
    """What has been computed is kept: a law that is set later would be ignored."""
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.05)]).mesh(order=1)
    model = sb.Model(mesh, sb.Material(70e9, 0.3, 2700.0))
    with pytest.raises(AttributeError):
        model.contact_laws = {"crack1": sb.Coulomb(0.3)}
    with pytest.raises(TypeError):
        model.contact_laws["crack1"] = sb.Coulomb(0.3)


def test_faces_that_close_in_one_step_are_told():
    """A notch whose faces stand apart; closed ones, and those that no load closes, are not."""
    closes, opens = sb.PointForce("A", fy=1e3), sb.PointForce("A", fy=-1e3)
    for opening, load, told in ((0.05, closes, True), (0.05, opens, False), (0.0, closes, False)):
        mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, opening)]).mesh(order=2)
        model = sb.Model(mesh, ALUMINIUM, contact_laws=sb.Coulomb(0.3))
        with model, warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            sb.static(model, load)
        assert any("close in this one step" in str(item.message) for item in found) == told
