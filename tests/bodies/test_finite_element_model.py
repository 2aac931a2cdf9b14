"""Bodies of other codes against scikit-fem's matrices and dense computations of the test's own."""

from __future__ import annotations

import csv
import warnings

import h5py
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
import scipy.spatial

import sbfem_petsc as sb
from sbfem_petsc import plot
from sbfem_petsc.bodies.rows import Row


def test_rows_and_contact_beside_dense(parts, body):
    """Frequencies in Hz, the flexibility of gaps, loads and sensors in m/N, and a steady state are those of
    dense SI matrices with rows written by hand.
    """
    k, m = 1e3 * parts["stiffness"].toarray(), 1e3 * parts["mass"].toarray()
    place = {tuple(pair): i for i, pair in enumerate(parts["unknowns"])}
    n = len(place)
    rows = np.zeros((2, n))
    x = parts["nodes"]
    for row, left in zip(rows, parts["sets"]["LEFT"], strict=True):
        right = next(r for r in parts["sets"]["RIGHT"] if x[r] == x[left])
        row[place[right, 0]], row[place[left, 0]] = 1.0, -1.0
    end = next(label for label, at in x.items() if at == (80.0, 10.0, 10.0))
    tip, oblique = np.zeros(n), np.zeros(n)
    tip[place[end, 2]] = 1.0
    oblique[place[end, 1]], oblique[place[end, 2]] = 0.6, 0.8

    crack = body.contact("LEFT", "RIGHT", normal=(1, 0, 0), gap=2e-6)
    at = body.at((0.08, 0.01, 0.01), "z")
    points = {
        "tip": at,
        "oblique": body.at(end, (0, 3, 4)),
        "opening": body.at("RIGHT", "x") - body.at("LEFT", "x"),
    }
    given = {"modes": 20, "damping": 0.01}
    found = sb.reduce(body, contact=crack, loads={"F": at}, points=points, **given)
    seen = {"tip": tip, "oblique": oblique, "opening": rows.mean(axis=0)}
    dense = sb.reduce_matrices(m, k, rows, [2e-6, 2e-6], loads=tip[:, None], sensors=seen, **given)

    own = np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)[:20]) / (2 * np.pi)
    assert found.frequencies == pytest.approx(own, rel=1e-9)
    whole = found.gap.contact + (found.gap.modes / found.omega**2) @ found.gap.modes.T
    assert whole == pytest.approx(rows @ np.linalg.solve(k, rows.T), rel=1e-8)
    share = found.points.loads[:, 0, 0] + found.points.modes[:, 0] @ (found.load_modes[:, 0] / found.omega**2)
    assert share == pytest.approx(np.array([*seen.values()]) @ np.linalg.solve(k, tip), rel=1e-7)

    one, other = (sb.periodic(rom, 400.0, 0.4 * own[0]) for rom in (found, dense))
    assert one.contact_force.max() > 1.0
    for name in seen:
        first, second = one.harmonics(name)[:4], other.harmonics(name)[:4]
        assert np.abs(first - second).max() < 1e-6 * np.abs(second).max()


@pytest.fixture(scope="module")
def cracked(body):
    """Twelve modes, the residual flexibility of the others; the tip is pushed along z and the right end along
    x.
    """
    end = body.at((0.08, 0.01, 0.01), "z")
    return sb.reduce(
        body,
        contact=body.contact("LEFT", "RIGHT", normal="x", gap=np.array([1e-6, 3e-6])),
        loads={"F": end, "P": body.at((0.08, 0.0, 0.0), "x")},
        points={"tip": end, "mouth": body.at("RIGHT", "x") - body.at("LEFT", "x")},
        modes=12,
        damping=0.01,
    )


@pytest.mark.parametrize("load", [(900.0, 0.0), (900.0, -2e4), (-900.0, 0.0)])
def test_static_beside_dense(parts, cracked, load):
    """Of the four sets of closed pairs the one that neither pulls nor overlaps, from dense SI matrices."""
    k = 1e3 * parts["stiffness"].toarray()
    place = {tuple(pair): i for i, pair in enumerate(parts["unknowns"])}
    x = parts["nodes"]
    corner = {at: label for label, at in x.items()}
    f, rows = np.zeros(len(k)), np.zeros((2, len(k)))
    f[place[corner[80.0, 10.0, 10.0], 2]], f[place[corner[80.0, 0.0, 0.0], 0]] = load
    for row, left in zip(rows, parts["sets"]["LEFT"], strict=True):
        right = next(r for r in parts["sets"]["RIGHT"] if x[r] == x[left])
        row[place[right, 0]], row[place[left, 0]] = 1.0, -1.0
    gap, right = np.array([1e-6, 3e-6]), []
    for closed in ([], [0], [1], [0, 1]):
        force = np.zeros(2)
        flexibility = rows @ np.linalg.solve(k, rows.T)
        free = rows @ np.linalg.solve(k, f) + gap
        force[closed] = np.linalg.solve(flexibility[np.ix_(closed, closed)], -free[closed])
        if (force >= 0.0).all() and (flexibility @ force + free >= -1e-15).all():
            right.append((np.linalg.solve(k, f + rows.T @ force), force))
    ((u, force),) = right
    found = sb.static(cracked, list(load))
    assert found.active.tolist() == (force > 0.0).tolist() and force.any() == (load[0] > 0.0)
    assert found.contact_force == pytest.approx(force, rel=1e-7, abs=1e-9)
    assert found.contact_resultant == pytest.approx(force.sum(), rel=1e-7, abs=1e-9)
    assert found.gap == pytest.approx(rows @ u + gap, rel=1e-7, abs=1e-15)
    tip = u[place[corner[80.0, 10.0, 10.0], 2]]
    assert found.displacement("tip") == pytest.approx(tip, rel=1e-7)
    assert found.displacement("mouth") == pytest.approx((rows @ u).mean(), rel=1e-7, abs=1e-15)
    assert found.strain_energy == pytest.approx(0.5 * u @ k @ u, rel=1e-7)
    linear = sb.static(cracked, list(load), contact=False)
    assert linear.displacement("mouth") == pytest.approx((rows @ np.linalg.solve(k, f)).mean(), rel=1e-7)


def test_loads_of_an_array(cracked):
    """As a list of the same numbers; one that does not fit is told as such."""
    for load in (np.array([900.0, -2e4]), np.array([900, -20000])):
        found, same = sb.static(cracked, load), sb.static(cracked, load.tolist())
        assert found.displacement("tip") == same.displacement("tip") != 0.0
    orbits = [sb.periodic(cracked, load, 900.0).harmonics("tip") for load in (load, load.tolist())]
    assert (orbits[0] == orbits[1]).all()
    with pytest.raises(ValueError, match="has 2 unit loads, the load has 3"):
        sb.static(cracked, np.ones(3))
    with pytest.raises(TypeError, match="must be a number or signal for each of the 2 unit loads"):
        sb.static(cracked, np.ones((1, 2)))


def test_load_history_is_statics_in_time(cracked):
    times, push = [0.0, 0.1, 0.25], [sb.Harmonic(900.0, 1.0), -2e4]
    found = sb.load_history(cracked, push, times)
    for k, t in enumerate(times):
        one = sb.static(cracked, [900.0 * np.sin(2.0 * np.pi * t), -2e4])
        assert found.displacement("tip")[k] == pytest.approx(one.displacement("tip"), rel=1e-12)
        assert found.contact_resultant[k] == pytest.approx(one.contact_resultant, rel=1e-12)
    assert repr(found).startswith("ReducedLoadHistory(3 states from 0 to 0.25 s, peak contact resultant ")


def test_modal_is_what_is_kept(parts, cracked):
    """Frequencies, and mass-normalised shapes but for their signs."""
    k, m = 1e3 * parts["stiffness"].toarray(), 1e3 * parts["mass"].toarray()
    values, shapes = scipy.linalg.eigh(k, m)
    own = np.sqrt(values) / (2 * np.pi)
    place = {tuple(pair): i for i, pair in enumerate(parts["unknowns"])}
    end = next(label for label, at in parts["nodes"].items() if at == (80.0, 10.0, 10.0))
    found = sb.modal(cracked, 10)
    assert found.frequencies == pytest.approx(own[:10], rel=1e-9)
    assert np.abs(found.displacement("tip")) == pytest.approx(np.abs(shapes[place[end, 2], :10]), rel=1e-6)
    within = sb.modal(cracked, band=((1.0 - 1e-6) * own[1], (1.0 + 1e-6) * own[3]))
    assert within.frequencies == pytest.approx(own[1:4], rel=1e-9)


def test_labels_out_of_a_table_of_floats(parts, body):
    """As `numpy.loadtxt` and pandas give them, beside integers in unknowns and sets: the same body."""
    table = {float(label): place for label, place in parts["nodes"].items()}
    found = sb.FiniteElementModel(**{**parts, "nodes": table})
    assert found.labels.dtype.kind == "i" and found.labels.tolist() == body.labels.tolist()
    assert found.sets == body.sets and (found.at(5, "z").weights != body.at(5, "z").weights).nnz == 0


def moved(body, to=lambda places: places + 1.0):
    """A body elsewhere, with the same unknowns."""
    nodes = dict(zip(body.labels.tolist(), to(body.places)))
    return sb.FiniteElementModel(
        body.mass, body.stiffness, body.unknowns, nodes, sets=body.sets, fixed=body.fixed
    )


def warped(body):
    """Its cross sections, flat before, by less than what a normal of three digits makes of flat ones."""
    return moved(body, lambda at: at + 0.3 * at[:, [1]] * at[:, [2]] * [1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda r: sb.modal(r, 13), "count = 13 is more than the 12 modes"),
        (lambda r: sb.modal(r, band=(0.0, 1e7)), "where the modes of the reduced model end"),
        (lambda r: sb.modal(r, 2, accuracy=1e-3), "accuracy is of a Model"),
        (lambda r: sb.static(r, 1.0), "has 2 unit loads, the load has 1"),
        (lambda r: sb.static(r, [1.0, sb.Harmonic(1.0, 2.0)]), "changes in time"),
        (lambda r: sb.static(r, [1.0, 1.0], accuracy=1e-3), "accuracy is of a Model"),
        (lambda r: sb.static(r, [1.0, 1.0]).displacement("top"), "point 'top' does not exist"),
        (lambda r: sb.load_history(r, [1.0, 1.0], []), "time is empty"),
    ],
)
def test_wrong_questions(cracked, call, sentence):
    with pytest.raises((ValueError, TypeError, KeyError), match=sentence):
        call(cracked)


def test_points_stand_by_their_names(cracked, tmp_path):
    """A point of a body is one number, in tables, summaries, xarray and pictures; no x or y is made up."""
    orbit = sb.periodic(cracked, [10.0, 0.0], 300.0, steps=64)
    u = orbit.displacement("tip")
    assert u.shape == orbit.velocity("tip").shape == orbit.acceleration("tip").shape == (64,)
    assert orbit.amplitude("tip") == 0.5 * np.ptp(u)
    files = orbit.to_csv(str(tmp_path / "orbit.csv"))
    with open(files[0], newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["displacement_tip [m]"]) for row in rows] == u.tolist()
    assert not [name for name in rows[0] if name.endswith(("_x [m]", "_y [m]"))]
    assert orbit.summary()["harmonics"]["tip"]["magnitude"][1] == pytest.approx(
        abs(orbit.harmonics("tip")[1]), rel=1e-12
    )
    sb.save(tmp_path / "orbit.h5", orbit)
    again = sb.read(tmp_path / "orbit.h5")
    assert again.tables()["time"]["displacement_tip [m]"].tolist() == u.tolist()
    assert again.displacement("tip").tolist() == u.tolist()
    assert again.summary()["direction"] == {"tip": "z", "mouth": "x"}
    with h5py.File(tmp_path / "orbit.h5") as file:
        assert (
            file["displacement"].shape == (64, 2)
            and "u_y" not in file["amplitude"].attrs["long_name"].decode()
        )
        assert [name.decode() for name in file["states/reduced/directions"]] == ["z", "x"]
    with pytest.raises(ValueError, match="direction = 'x', but the point is a row"):
        orbit.harmonics("tip", "x")
    (axes, *_) = plot.plot_history(orbit, "tip")
    assert [line.get_label() for line in axes.get_lines()][0] == "$u_z$"
    assert not [line.get_label() for line in axes.get_lines() if "u_x" in line.get_label()]
    assert plot.plot_harmonics(orbit, "tip").get_ylabel() == "$|u_z|$(tip) (m)"
    assert repr(sb.static(cracked, [1.0, 0.0])).startswith("ReducedStatic(tip along z: ")


def test_gaps_walls_and_sums(body):
    """A function, an array and a number give the same gaps; walls take the normal towards them; sums are
    both.
    """
    faces = body.contact("LEFT", "RIGHT", normal="x")
    assert faces.gap.tolist() == [0.0, 0.0]
    wedge = body.contact("LEFT", "RIGHT", normal="x", gap=lambda x, y, z: 1e-3 * (z - 0.005))
    assert wedge.gap == pytest.approx([5e-6, 5e-6], rel=1e-12)
    assert body.contact("LEFT", "RIGHT", normal="x", gap=wedge.gap).gap.tolist() == wedge.gap.tolist()
    end = body.at((0.08, 0.01, 0.01), "z")
    label = body.unknowns[end.weights.indices[0]][0]
    wall = body.contact([label], normal="z", gap=1e-4)
    assert not (wall.rows + end.weights).toarray().any()
    both = faces + wall
    assert both.rows.shape == (3, len(body.unknowns)) and both.gap.tolist() == [0.0, 0.0, 1e-4]


def test_undamped_by_default(body):
    at = body.at("RIGHT", "z")
    for given in ({}, {"damping": 0.0}):
        rom = sb.reduce(body, loads={"F": at}, points={"mouth": at}, modes=3, **given)
        assert rom.pairs == 0 and rom.damping.tolist() == [0.0, 0.0, 0.0]


def test_one_triangle(parts, body):
    """Symmetric storage is told apart."""
    lower = sb.FiniteElementModel(**{**parts, "stiffness": scipy.sparse.tril(parts["stiffness"])})
    assert np.abs((lower.stiffness - body.stiffness).toarray()).max() < 1e-12 * abs(body.stiffness).max()


def test_summary(parts, body):
    """56 nodes of which 6 are held."""
    lines = body.summary().splitlines()
    assert lines[:3] == [
        "150 free unknowns of 56 nodes",
        "size 0.08 x 0.01 x 0.01 m",
        "18 unknowns held",
    ]
    along = (parts["unknowns"][:, 1] == 0).astype(float)
    assert lines[3] == f"mass {1e3 * along @ parts['mass'] @ along:.6g} kg of what is free"
    assert lines[4:] == ["set LEFT: 2 nodes", "set RIGHT: 2 nodes"]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"units": "inch"}, "units = 'inch'"),
        ({"mass": scipy.sparse.eye(3)}, "mass has shape"),
        ({"mass": np.eye(3)}, "must be a real sparse matrix"),
        ({"unknowns": [[1, 0]]}, "unknowns has shape"),
        ({"nodes": {1: (0.0, 0.0, 0.0)}}, "which the body has not; is it internal"),
        ({"nodes": {1.5: (0.0, 0.0, 0.0)}}, r"labels of nodes = \[1.5\] must be whole numbers"),
        ({"nodes": {2**54: (0.0, 0.0, 0.0)}}, "must be whole numbers up to 2.53"),
        ({"nodes": {1: (0.0, 1e200, 0.0)}}, r"nodes has places 1e\+197 m off; give them in units = 'mm-N-t'"),
        ({"nodes": {"1": (0.0, 0.0, 0.0)}}, r"labels of nodes = \['1'\] must be an array of real numbers"),
        ({"sets": {"A": [99999]}}, r"sets\['A'\] has node 99999"),
        ({"fixed": [(99999, 0)]}, "fixed has node 99999"),
        ({"fixed": [(5, 6)]}, r"fixed has \[5\.0, 6\.0\], not a node's label and a direction, 0 to 5"),
        ({"mass": scipy.sparse.csr_matrix((3, 4))}, r"mass of shape \(3, 4\) is not square, or is empty"),
    ],
)
def test_wrong_models(parts, change, sentence):
    with pytest.raises((ValueError, TypeError), match=sentence):
        sb.FiniteElementModel(**{**parts, **change})


def test_matrices_and_unknowns_that_make_no_body(parts):
    """One sentence for each, which names the matrix or the unknowns, and what is wrong with them."""
    eye, unknowns = scipy.sparse.identity(len(parts["unknowns"]), format="csr"), parts["unknowns"]
    twice, one = unknowns.copy(), scipy.sparse.csr_matrix(([1e3], ([0], [1])), eye.shape)
    twice[1] = twice[0]
    for change, sentence in (
        ({"mass": -parts["mass"]}, r"mass is negative, -\S+ kg on its diagonal"),
        ({"stiffness": parts["stiffness"] + 1e5 * one}, "stiffness is not symmetric, entries differ by up"),
        ({"unknowns": twice}, "unknowns has a node and direction twice; each has one row"),
        ({"fixed": unknowns.tolist()}, "fixed holds all unknowns; leave some free"),
    ):
        with pytest.raises(ValueError, match=sentence):
            sb.FiniteElementModel(**{**parts, **change})


def test_directions_that_count_from_1(parts):
    """As CalculiX and Abaqus number them; a frame in the plane of y and z has no others."""
    unknowns = parts["unknowns"] + [0, 1]
    with pytest.raises(ValueError, match="directions 1, 2 and 3; give 0, 1 and 2 for x, y and z"):
        sb.FiniteElementModel(**{**parts, "unknowns": unknowns, "fixed": ()})
    plane = {label: (0.0, y, x + z) for label, (x, y, z) in parts["nodes"].items()}
    frame = {**parts, "unknowns": unknowns, "nodes": plane, "fixed": (), "elements": {}}
    assert len(sb.FiniteElementModel(**frame).unknowns) == len(unknowns)
    eye, corners = scipy.sparse.identity(8, format="csr"), [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    flat = [(node, direction) for node in range(4) for direction in (1, 2)]
    for z in (0.0, 1e-17):  # of a turned drawing
        nodes = {k: (x, y, k * z) for k, (x, y) in enumerate(corners)}
        with pytest.raises(ValueError, match="directions 1 and 2; give 0 and 1 for x and y"):
            sb.FiniteElementModel(eye, 1e9 * eye, flat, nodes)
    sb.FiniteElementModel(eye, 1e9 * eye, flat, {k: (0.0, x, y) for k, (x, y) in enumerate(corners)})


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda b: b.at("TOP", "x"), "set 'TOP' does not exist"),
        (lambda b: b.contact([], normal="x"), r"left = \[\] has no nodes"),
        (lambda b: b.at("LEFT", "x") + 1.0, "row: 1.0 does not add to Row.*; give a row of the same body"),
        (lambda b: b.at((80, 10, 10), "z"), "coordinates are in m"),
        (lambda b: b.at(10**6, "z"), "place has node 1000000, which the body has not"),
        (lambda b: b.at(None, "z"), "place = None must be a label, a set or x, y, z in m"),
        (lambda b: b.at(5, "z") * "a", "row: factor = 'a' must be a number"),
        (
            lambda b: sb.reduce(b, loads={"F": b.at("LEFT", "x") - b.at("LEFT", "x")}, points={}),
            r"loads\['F'\] = Row.* is zero whatever moves",
        ),
        (
            lambda b: sb.reduce(b, loads={"F": moved(b).at("LEFT", "x")}, points={"P": b.at("LEFT", "x")}),
            r"loads\['F'\] is of another body",
        ),
        (lambda b: b.at("LEFT", "x") - moved(b).at("LEFT", "x"), "give a row of the same body"),
        (lambda b: b.at("LEFT", "w"), "direction = 'w' must be one of 'x', 'y', 'z'"),
        (lambda b: b.at("LEFT", 2), "direction = 2 must be 'x', 'y', 'z' or three numbers that are not all"),
        (
            lambda b: b.at("LEFT", (0, 0, 0)),
            r"direction = \(0, 0, 0\) must be 'x', 'y', 'z' or three numbers",
        ),
        (lambda b: sb.static(b, 1.0), "must be a Model, or a ReducedModel, which reduce makes of a body"),
        (lambda b: sb.periodic(b, 1.0, 9.0), "must be a Model, or a ReducedModel, which reduce makes of"),
        (lambda b: b.at((0, 0, 0), "z"), "is held along"),
        (lambda b: b.at((0.04, 0.0, 0.01), "z"), "2 nodes lie at"),
        (lambda b: b.contact("LEFT", "RIGHT"), "do not tell their side"),
        (lambda b: b.contact("LEFT", [5, 6], normal="x"), "have no partner"),
        (
            lambda b: b.contact("LEFT", [*b.sets["RIGHT"], *b.labels[b.places[:, 0] > 0.0401]], normal="x"),
            "has two right nodes before it, which lie behind each other",
        ),
        (
            lambda b: b.contact(b.labels[(b.places[:, 1:] < 1e-9).all(axis=1)], "RIGHT"),
            "left nodes lie on a line, and tell no normal; give normal, left to right",
        ),
        (
            lambda b: b.contact(b.labels, "RIGHT"),
            "up to 0.0.* m off a plane, and tell no normal; give normal",
        ),
        (lambda b: b.contact("LEFT"), "nor does a wall; give a normal"),
        (
            lambda b: b.contact(b.labels, normal=(0, 0, -1)),
            "left nodes lie up to 0.01 m behind each other along the normal",
        ),
        (
            lambda b: warped(b).contact(b.labels[b.places[:, 0] > 0.079], normal="x"),
            "left nodes lie up to 3e-05 m behind each other along the normal",
        ),
        (lambda b: b.contact("LEFT", normal="x", gap=[1e-6]), r"gap has shape \(1,\), \(2,\) was expected"),
        (lambda b: b.contact("LEFT", normal="x", gap=-1e-6), "overlap"),
        (
            lambda b: b.contact("LEFT", normal="x", gap=lambda x, y, z: 1e-6 if z > 0.005 else 0.0),
            "gap = <function .* failed as a function of arrays x, y and z: ValueError: The truth value",
        ),
        (lambda b: b.contact("LEFT", normal="x", offset=1e-6), "at a wall or beside a gap"),
        (
            lambda b: b.contact("LEFT", "RIGHT", normal="x", gap=2e-6, offset=1e-6),
            "beside a gap give what is left",
        ),
        (
            lambda b: b.contact("LEFT", "RIGHT", normal="x", offset=1e-3),
            "overlap by 0.001 m, with offset = 0.001 m between nodes 0 m apart",
        ),
        (lambda b: sb.reduce(b, loads={"F": b.at("LEFT", "x")}), "points = None must be a dict"),
        (
            lambda b: sb.reduce(b, loads={"F": sb.SupportMotion()}, points={"p": b.at("LEFT", "x")}),
            "moves nothing; give an acceleration",
        ),
    ],
)
def test_wrong_calls(body, call, sentence):
    with pytest.raises((ValueError, TypeError, KeyError), match=sentence):
        call(body)


def test_an_inclined_wall_of_three_digits(parts):
    """A body turned by 15 degrees stands on it without a gap, all nodes of its lower face."""
    turn = scipy.spatial.transform.Rotation.from_euler("y", 15.0, degrees=True).as_matrix()
    turned = sb.FiniteElementModel(**{**parts, "nodes": {k: turn @ at for k, at in parts["nodes"].items()}})
    held = {node for node, _ in parts["fixed"]}
    face = [k for k, at in parts["nodes"].items() if abs(at[2]) < 1e-9 and k not in held]
    wall = turned.contact(face, normal=(-0.259, 0.0, -0.966))
    assert len(wall.gap) == len(face) and not wall.gap.any()


def test_normals_of_any_length(body):
    """Squares of their components may be beyond the range of numbers."""
    right = body.contact("LEFT", "RIGHT", normal=(1.0, 1.0, 0.0)).rows
    for size in (1e-200, 1e200):
        assert abs(body.contact("LEFT", "RIGHT", normal=(size, size, 0.0)).rows - right).max() < 1e-15


def test_a_negative_row_looks_the_other_way(body):
    """What it gives is the displacement along the opposite vector, and its direction says so."""
    place = int(body.unknowns[-1, 0])
    for direction, opposite in (("z", (0, 0, -1)), ((1.0, 2.0, -2.0), (-1.0, -2.0, 2.0))):
        row, turned = body.at(place, direction), body.at(place, opposite)
        assert np.abs((-1.0 * row - turned).weights.toarray()).max() < 1e-15
        assert (-1.0 * row).direction == turned.direction
        assert (-2.0 * turned).direction == row.direction == (3.0 * row).direction
        assert (row - row).direction == row.direction


def test_unknowns_in_another_order(body):
    """Nodes from the last one on, or all x first, are warned of: turning the body meets forces everywhere."""
    both = sb.join(body, body)
    given = dict(zip(both.labels.tolist(), both.places)), dict(fixed=both.fixed)
    count = len(both.unknowns)
    along = np.stack([np.tile(both.unknowns[::3, 0], 3), np.repeat([0, 1, 2], count // 3)], axis=1)
    for unknowns in (both.unknowns[::-1], along):
        with pytest.warns(sb.MeshWarning, match="at 2.. of 264 unknowns away from supports; are unk"):
            sb.FiniteElementModel(both.mass, both.stiffness, unknowns, given[0], **given[1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb.FiniteElementModel(both.mass, both.stiffness, both.unknowns, given[0], **given[1])


@pytest.mark.filterwarnings("error")
def test_rotations_in_millimetres():
    """Beams of unequal lengths, aslant in their plane, by the book, in m and in mm, where moments are N mm:
    they are one body in N m, of which no warning is right (of another order, in mm).
    """
    lengths, (c, s) = np.random.default_rng(0).uniform(0.5, 1.5, 71), (0.6, 0.8)
    turn, bodies = np.kron(np.eye(2), [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]), []
    for units, size, force, inert in (
        ("SI", 1.0, 1.0, 1.0),
        ("mm-N-t", 1e3, 1.0, 1e-3),
        ("mm-kg-mN", 1e3, 1e3, 1.0),
    ):
        mass, stiffness, along = np.zeros((216, 216)), np.zeros((216, 216)), size * np.cumsum(lengths)
        for e, own in enumerate(size * lengths):
            k = np.zeros((6, 6))
            k[np.ix_([0, 3], [0, 3])] = 2e8 * force / own * np.array([[1, -1], [-1, 1]])
            bending = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
            arms = np.array([1.0, own, 1.0, own])
            k[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = (
                1e6 * force * size**2 / own**3 * np.outer(arms, arms) * bending
            )
            stiffness[3 * e : 3 * e + 6, 3 * e : 3 * e + 6] += turn.T @ k @ turn
            mass[3 * e : 3 * e + 6, 3 * e : 3 * e + 6] += (
                50.0 * inert * own / size * np.diag([1, 1, 0, 1, 1, 0])
            )
        at = np.append(0.0, along)
        nodes = {k: (c * x, s * x, 0.0) for k, x in enumerate(at)}
        unknowns = [(k, d) for k in nodes for d in (0, 1, 5)]
        matrices = map(scipy.sparse.csr_matrix, (mass, stiffness))
        bodies.append(sb.FiniteElementModel(*matrices, unknowns, nodes, units=units))
    for other in bodies[1:]:
        for name in ("mass", "stiffness"):
            one, two = (getattr(body, name).toarray() for body in (bodies[0], other))
            assert two == pytest.approx(one, rel=1e-12, abs=1e-12 * np.abs(one).max())


def test_few_unknowns_in_another_order(parts):
    """Of a body of solid elements 50 unknowns away from supports are enough; such a one may be written
    by hand without elements.
    """
    turned = {**parts, "unknowns": parts["unknowns"][::-1]}
    with pytest.warns(
        sb.MeshWarning, match="at 106 of 114 unknowns away from supports; are unknowns and nodes"
    ):
        sb.FiniteElementModel(**turned)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb.FiniteElementModel(**{**turned, "elements": {}})


def test_long_cells_that_are_held_at_an_end():
    """Nodes of a cell that is longer than some cells are wide meet forces of its held end, though other nodes
    are nearer to them than that.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    width = np.linspace(0.0, 0.01, 6)
    box = skfem.MeshHex.init_tensor(np.array([0.0, 0.1]), width, width)
    moved = np.random.default_rng(0).uniform(-0.15, 0.15, box.p.shape) * [[0.1], [0.002], [0.002]]
    mesh = skfem.MeshHex(box.p + moved, box.t)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()))
    stiffness = linear_elasticity(*lame_parameters(210e9, 0.3)).assemble(basis).tocsr()
    mass = 0.0785 / mesh.nvertices * scipy.sparse.identity(basis.N, format="csr")
    every = np.zeros((basis.N, 2), dtype=int)
    for d, rows in enumerate(basis.nodal_dofs):
        every[rows] = np.stack([np.arange(mesh.nvertices), np.full(mesh.nvertices, d)], axis=1)
    held = every[box.p[0, every[:, 0]] < 1e-9].tolist()
    cells = {"hexahedron": mesh.t[[0, 3, 6, 2, 1, 5, 7, 4]].T}  # skfem's order as VTK's
    given = mass, stiffness, every, dict(enumerate(mesh.p.T))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb.FiniteElementModel(*given, fixed=held, elements=cells)


@pytest.mark.parametrize("thick", [2e-4, 1e-3, 4e-3])
def test_plates_that_are_held_over_a_face(thick):
    """One element thick, cells of 1 mm: all free nodes are beside held ones, and nothing is told of their
    order; held at an edge alone it is, and all x first are warned of.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    lines = np.linspace(0.0, 0.012, 13), np.linspace(0.0, 0.012, 13), np.array([0.0, thick])
    mesh = skfem.MeshHex.init_tensor(*lines)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()))
    stiffness = linear_elasticity(*lame_parameters(210e9, 0.3)).assemble(basis).tocsr()
    mass = 7850.0 * 0.012**2 * thick / mesh.nvertices * scipy.sparse.identity(basis.N)
    every = np.zeros((basis.N, 2), dtype=int)
    for d, rows in enumerate(basis.nodal_dofs):
        every[rows] = np.stack([np.arange(mesh.nvertices), np.full(mesh.nvertices, d)], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for axis in (0, 2):
            free = mesh.p[axis, every[:, 0]] > 1e-9
            parts = mass.tocsr()[free][:, free], stiffness[free][:, free]
            sb.FiniteElementModel(*parts, every[free], dict(enumerate(mesh.p.T)), fixed=every[~free].tolist())
            if axis == 0:
                wrong = (
                    parts,
                    every[free][np.argsort(every[free][:, 1], kind="stable")],
                    every[~free].tolist(),
                )
    with pytest.warns(sb.MeshWarning, match="unknowns away from supports"):
        sb.FiniteElementModel(*wrong[0], wrong[1], dict(enumerate(mesh.p.T)), fixed=wrong[2])


@pytest.mark.parametrize(
    "rounded",
    [np.float32, *(lambda values, n=n: [float(f"{value:.{n}e}") for value in values] for n in (3, 4, 6, 9))],
    ids=["single", "four", "five", "seven", "ten"],
)
def test_stiffness_of_few_digits(body, rounded):
    """Single precision, and numbers written with four to ten digits, are warned of by what is left of forces
    of a body that moves as a whole; a mass of such, and chains on springs, are right.
    """

    def few(matrix):
        matrix = matrix.tocsr()
        return scipy.sparse.csr_matrix((rounded(matrix.data), matrix.indices, matrix.indptr), matrix.shape)

    both = sb.join(body, body)
    given = both.unknowns, dict(zip(both.labels.tolist(), both.places))
    for own in (body, both):
        places = own.unknowns, dict(zip(own.labels.tolist(), own.places))
        with pytest.warns(
            sb.MeshWarning, match="entries of stiffness are rounded, as in single precision: moved"
        ):
            sb.FiniteElementModel(own.mass, few(own.stiffness), *places, fixed=own.fixed)
    whole = few(
        body.stiffness / 1e3
    )  # N/mm: those of four and five digits are whole numbers, as single precision has
    whole.data[np.abs(whole.data) < 1e3] = 0.0
    whole.eliminate_zeros()
    places = body.unknowns, dict(zip(body.labels.tolist(), 1e3 * body.places))
    with pytest.warns(sb.MeshWarning, match="entries of stiffness are rounded"):
        sb.FiniteElementModel(body.mass / 1e3, whole, *places, fixed=body.fixed, units="mm-N-t")
    eye = scipy.sparse.identity(300, format="csr")
    chain = scipy.sparse.diags([-1e6, 2e6, -1e6], [-1, 0, 1], eye.shape) + 0.5 * eye
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb.FiniteElementModel(few(both.mass), both.stiffness, *given, fixed=both.fixed)
        nodes, unknowns = {k: (0.01 * k, 0.0, 0.0) for k in range(300)}, [(k, 0) for k in range(300)]
        sb.FiniteElementModel(1e-4 * eye, chain, unknowns, nodes)
        sb.FiniteElementModel(1e-4 * eye, chain + 9999.5 * eye, unknowns, nodes)  # of three digits


@pytest.mark.parametrize(
    ("young", "poisson", "height", "digits"), [(70e9, 0.33, 0.05, 3), (210e9, 0.3, 0.1, 4)]
)
def test_stiffness_of_equal_cells_and_few_digits(young, poisson, height, digits):
    """Where all cells are alike rounding pushes all nodes one way, as springs to the ground do: lowest
    frequencies of these are 64 and 5.4 times as high. Springs beside bars of few digits are what they are.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import linear_elasticity

    mesh = skfem.MeshQuad.init_tensor(0.1 * np.arange(31), height * np.arange(4))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad1()))
    share = 0.5 * young / (1.0 + poisson)  # Lame's constants of plane stress
    exact = linear_elasticity(2.0 * share * poisson / (1.0 - poisson), share).assemble(basis).tocsr()
    few = exact.copy()
    few.data = np.array([float(f"{value:.{digits - 1}e}") for value in few.data])
    every = np.zeros((basis.N, 2), dtype=int)
    for d, rows in enumerate(basis.nodal_dofs):
        every[rows] = np.stack([np.arange(mesh.nvertices), np.full(mesh.nvertices, d)], axis=1)
    places = {k: (*place, 0.0) for k, place in enumerate(mesh.p.T)}
    mass = 5e3 * 0.1 * height * scipy.sparse.identity(basis.N, format="csr")
    with pytest.warns(sb.MeshWarning, match="entries of stiffness are rounded"):
        sb.FiniteElementModel(mass, few, every, places)
    nodes, unknowns = {k: (0.01 * k, 0.0, 0.0) for k in range(300)}, [(k, 0) for k in range(300)]
    bars = scipy.sparse.diags([-123e6, 246e6, -123e6], [-1, 0, 1], (300, 300))
    eye = 1e-3 * scipy.sparse.identity(300, format="csr")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb.FiniteElementModel(mass, exact, every, places)
        sb.FiniteElementModel(eye, bars + 100.0 * scipy.sparse.identity(300), unknowns, nodes)


def test_nodes_of_nothing_do_not_make_the_body_larger(parts):
    """A node far off, which no unknown has, does not let `at` take a node beside the place."""
    far = {**parts, "nodes": {**parts["nodes"], 10_000: (1e6, 0.0, 0.0)}}
    body = sb.FiniteElementModel(**far)
    assert "size 0.08 x 0.01 x 0.01 m" in body.summary()
    with pytest.raises(ValueError, match="the nearest node"):
        body.at((0.081, 0.01, 0.01), "z")


def test_rounding_of_places_is_no_gap(body):
    """A body turned and moved in space: each pair alone has gap 0, and the two nodes of a place are told."""
    turn = scipy.linalg.expm([[0.0, -0.3, 0.2], [0.3, 0.0, -0.5], [-0.2, 0.5, 0.0]])
    noise = np.random.default_rng(0).uniform(-1.0, 1.0, body.places.shape) * 1e-15
    places = dict(zip(body.labels.tolist(), body.places @ turn.T + [1.0, 2.0, 3.0] + noise))
    parts = body.mass, body.stiffness, body.unknowns, places
    turned = sb.FiniteElementModel(*parts, sets=body.sets, fixed=body.fixed)
    for label in body.sets["LEFT"]:
        assert turned.contact([label], "RIGHT", normal=turn[:, 0]).gap == [0.0]
        with pytest.raises(ValueError, match="2 nodes lie at"):
            turned.at(places[label], "z")


def test_normals_that_look_into_the_body(body):
    """Of faces that coincide, and of a wall, the elements tell the side."""
    for left, normal in (("LEFT", (-1, 0.2, 0)), ("RIGHT", "x")):
        with pytest.raises(ValueError, match="the normal looks into the elements of the left face"):
            body.contact(left, "RIGHT" if left == "LEFT" else "LEFT", normal=normal, gap=0.0)
        with pytest.raises(ValueError, match="looks into the elements of the left face; is it from"):
            body.contact(left, normal=normal, gap=1e-6)
    crack = body.contact("RIGHT", "LEFT", normal=(-1, 0, 0), gap=0.0)
    assert crack.rows.shape[0] == len(body.sets["LEFT"])


def test_bodies_of_rows_made_by_hand_and_of_zeros_of_either_sign():
    """A row by hand, put before that of another body, leaves it known; -0.0 is the same place as 0.0."""

    def body(x=0.0):
        places, unit = {1: (x, 0.0, 0.0), 2: (0.1, 0.0, 0.0)}, scipy.sparse.identity(6, format="csr")
        return sb.FiniteElementModel(unit, 1e6 * unit, [(n, k) for n in (1, 2) for k in range(3)], places)

    own, by_hand = body(), Row(scipy.sparse.csr_matrix(np.eye(6)[[5]]))
    given = {"modes": 2, "points": {"P": own.at(2, "z")}}
    assert sb.reduce(body(-0.0), loads={"F": by_hand + own.at(2, "z")}, **given).load_modes.shape == (2, 1)
    with pytest.raises(ValueError, match="is of another body"):
        sb.reduce(own, loads={"F": by_hand + body(0.05).at(2, "z")}, **given)
