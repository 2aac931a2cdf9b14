"""What is seen of whole bodies, what moves them and what they are made of, beside dense computations."""

from __future__ import annotations

import functools
import io
import warnings
from pathlib import Path

import meshio
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse

import sbfem_petsc as sb
from sbfem_petsc import plot
from sbfem_petsc.bodies.readers import read_deck

DECK = Path(__file__).parent / "calculix" / "blocks.inp"


@pytest.fixture(scope="module")
def crack(body):
    end = body.at((0.08, 0.01, 0.01), "z")
    pairs = body.contact("LEFT", "RIGHT", normal="x", gap=2e-6)
    return sb.reduce(body, contact=pairs, loads={"F": end}, points={"tip": end}, modes=10, damping=0.01)


def dense(parts):
    """Mass and stiffness in SI, and the rows of nodes and directions."""
    place = {tuple(pair): k for k, pair in enumerate(parts["unknowns"].tolist())}
    return 1e3 * parts["mass"].toarray(), 1e3 * parts["stiffness"].toarray(), place


def test_fields_beside_dense(parts, body, crack):
    """Of a static state, a mode and a steady state at all nodes; what is held does not move."""
    m, k, place = dense(parts)
    f = body.at((0.08, 0.01, 0.01), "z").weights.toarray()[0]
    field = sb.static(crack, -300.0).field
    u = np.linalg.solve(k, -300.0 * f)
    for row, label in enumerate(body.labels.tolist()):
        own = [u[place[label, d]] if (label, d) in place else 0.0 for d in range(3)]
        assert field[row] == pytest.approx(own, rel=1e-6, abs=1e-9 * np.abs(u).max())
    shape = scipy.linalg.eigh(k, m)[1][:, 0]
    found = sb.modal(crack, 2).nodal(0)
    rows = [(int(np.flatnonzero(body.labels == a)[0]), d) for a, d in place]
    found = np.array([found[row] for row in rows])
    assert found * np.sign(found @ m @ shape) == pytest.approx(
        shape, rel=1e-5, abs=1e-6 * np.abs(shape).max()
    )
    orbit = sb.periodic(crack, 300.0, 1000.0, steps=64)
    tip = np.flatnonzero((np.abs(body.places - (0.08, 0.01, 0.01)) < 1e-9).all(axis=1))[0]
    at = orbit.field(orbit.time[20]).nodal
    assert at[tip, 2] == pytest.approx(orbit.displacement("tip")[20], rel=1e-9)


def test_files_of_the_whole(body, crack, tmp_path):
    """Elements, places and numbers of a VTU file are the body's; modes, an orbit over time and a GIF."""
    found = sb.static(crack, 300.0)
    read = meshio.read(sb.write_vtu(str(tmp_path / "push.vtu"), body, {"push": found}))
    assert read.points == pytest.approx(body.places, abs=1e-15)
    assert read.point_data["push (m)"] == pytest.approx(found.field, rel=1e-12)
    corners = read.points[read.cells_dict["hexahedron"]]
    edges = corners[:, [1, 3, 4]] - corners[:, :1]
    assert np.linalg.det(edges).sum() == pytest.approx(8e-6, rel=1e-9)  # m^3, of right-handed cells
    modes = meshio.read(sb.write_modes(str(tmp_path / "modes.vtu"), sb.modal(crack, 2), [1]))
    assert [name for name in modes.point_data if "Hz" in name][0].startswith("mode 2, ")
    orbit = sb.periodic(crack, 300.0, 1000.0, steps=64)
    sb.write_animation(str(tmp_path / "film"), orbit, every=32)
    assert len(list((tmp_path / "film").glob("*.vtu"))) == 2
    plot.animate_crack(orbit, str(tmp_path / "film.gif"), frames=2)
    from PIL import Image

    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 2
    push, mode = plot.plot_field(body, {"push": found, "mode 1": sb.modal(crack, 1).nodal(0)})
    assert len(push.collections[0].get_paths()) == 2 * 16 + 2 * 8 + 2 * 2 + 2 and "×" in mode.get_title()
    bare = sb.FiniteElementModel(
        body.mass, body.stiffness, body.unknowns, dict(zip(body.labels, body.places))
    )
    assert list(meshio.read(sb.write_vtu(str(tmp_path / "b.vtu"), bare, {})).cells_dict) == ["vertex"]


# A brick of 2 x 1 x 1 m, its edges, and of each solid of CalculiX the corners, in its order, and the volume.
BRICK = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (2, 0), (2, 1), (0, 1))], dtype=float)
SOLIDS = [
    ("C3D4", "0125", "", 1 / 3),
    ("C3D10", "0125", "01 12 20 03 13 23", 1 / 3),
    ("C3D6", "012456", "", 1.0),
    ("C3D15", "012456", "01 12 20 34 45 53 03 14 25", 1.0),
    ("C3D8", "01234567", "", 2.0),
    ("C3D20R", "01234567", "01 12 23 30 45 56 67 74 04 15 26 37", 2.0),
]


@pytest.mark.parametrize(("kind", "corners", "edges", "volume"), SOLIDS)
def test_solids_of_a_deck_in_paraview(tmp_path, kind, corners, edges, volume):
    """VTK's own volume of each, which is negative where nodes stand in another order: the first three of
    wedges with six nodes look away from the others there.
    """
    pyvista = pytest.importorskip("pyvista")
    places = BRICK[[int(k) for k in corners]]
    places = np.vstack([places, *(places[[int(a), int(b)]].mean(axis=0) for a, b in edges.split())])
    nodes = "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(places, 1))
    labels = [str(k) for k in range(1, len(places) + 1)]
    rows = ", ".join(labels[:15]) + (",\n" + ", ".join(labels[15:]) if labels[15:] else "")
    (tmp_path / "one.inp").write_text(f"*NODE\n{nodes}*ELEMENT, TYPE={kind}\n1, {rows}\n")
    deck = read_deck("test", str(tmp_path / "one.inp"))
    eye = scipy.sparse.identity(3 * len(places))
    unknowns = [(label, d) for label in deck["nodes"] for d in range(3)]
    body = sb.FiniteElementModel(1e3 * eye, 1e9 * eye, unknowns, **deck)
    cells = pyvista.read(sb.write_vtu(str(tmp_path / "one.vtu"), body, {}))
    assert cells.n_cells == 1 and cells.compute_cell_sizes()["Volume"][0] == pytest.approx(volume, rel=1e-6)
    plot.plot_field(body, {"": np.ones((len(places), 3))})


def test_without_shapes(body, tmp_path):
    end = body.at("RIGHT", "z")
    rom = sb.reduce(body, loads={"F": end}, points={"end": end}, modes=3, damping=0.01, shapes=False)
    assert sb.static(rom, 1.0).field is None
    orbit = sb.periodic(rom, 1.0, 100.0, steps=64)
    for call in (
        lambda: orbit.field(0.0),
        lambda: sb.modal(rom, 1).nodal(0),
        lambda: sb.write_animation(str(tmp_path), orbit),
        lambda: sb.write_vtu(str(tmp_path / "a.vtu"), body, {"a": sb.static(rom, 1.0)}),
    ):
        with pytest.raises(RuntimeError, match="shapes"):
            call()


def test_base_motion_beside_dense(whole):
    """Relative to the base, by the inertia of consistent matrices, which held nodes share: a steady state of
    all modes, and rest under gravity.
    """
    body, (m, k, place) = sb.FiniteElementModel(**whole), dense(whole)
    held = {(node, d) for node, d in whole["fixed"]}
    free = [row for pair, row in place.items() if pair not in held]
    towards = np.array([0.6, 0.0, 0.8])
    rigid = np.array([towards[d] for _, d in place])
    force = -(m @ rigid)[free]
    m, k = m[np.ix_(free, free)], k[np.ix_(free, free)]
    shake = sb.SupportMotion(ax=0.6, az=0.8)
    end = body.at((0.08, 0.01, 0.01), "z")
    rom = sb.reduce(body, loads={"base": shake}, points={"end": end}, modes=40, rayleigh=(20.0, 1e-6))
    seen = end.weights.toarray()[0]
    assert sb.static(rom, 9.81).displacement("end") == pytest.approx(
        9.81 * seen @ np.linalg.solve(k, force), rel=1e-7
    )
    w = 2.0 * np.pi * 2000.0
    answer = seen @ np.linalg.solve(k - w * w * m + 1j * w * (20.0 * m + 1e-6 * k), force)
    found = sb.periodic(rom, 5.0, 2000.0).harmonics("end")[1]
    assert abs(found) == pytest.approx(5.0 * abs(answer), rel=1e-5)
    with pytest.raises(ValueError, match="az = 1.0 is out of the plane"):
        sb.SupportMotion(az=1.0)._check_place(None)


@pytest.mark.parametrize("lumped", [False, True])
def test_free_body_beside_dense(whole, lumped):
    """Held by nothing: six motions of 0 Hz, the others' frequencies, and the residual flexibility; where mass
    is lumped, and none at one node, those of the condensed matrices.
    """
    given = {**whole, "fixed": ()}
    if lumped:
        weights = np.asarray(given["mass"].sum(axis=1)).ravel()
        weights[whole["unknowns"][:, 0] == 1] = 0.0
        given["mass"] = scipy.sparse.diags(weights).tocsr()
    body, (m, k, place) = sb.FiniteElementModel(**given), dense(given)
    end = body.at((0.08, 0.01, 0.01), "z")
    rom = sb.reduce(
        body,
        contact=body.contact("LEFT", "RIGHT", normal="x", gap=1e-6),
        loads={"F": end},
        points={"end": end},
        modes=16,
    )
    assert (rom.frequencies[:6] == 0.0).all()
    heavy = np.flatnonzero(m.diagonal())
    light = np.setdiff1d(np.arange(len(m)), heavy)
    full = np.zeros((len(m), len(heavy)))
    full[heavy, range(len(heavy))] = 1.0
    if len(light):
        full[light] = -np.linalg.solve(k[np.ix_(light, light)], k[np.ix_(light, heavy)])
    values, shapes = scipy.linalg.eigh(full.T @ k @ full, m[np.ix_(heavy, heavy)])
    assert rom.omega[6:] ** 2 == pytest.approx(values[6:16], rel=1e-8)
    # the flexibility of self-equilibrated forces, without the kept modes
    phi = full @ shapes
    out = np.eye(len(m)) - phi[:, :16] @ phi[:, :16].T @ m
    left = out @ np.linalg.pinv(k, rcond=1e-12, hermitian=True) @ out.T
    f = end.weights.toarray()[0]
    assert rom.load_flexibility[0, 0] == pytest.approx(f @ left @ f, rel=1e-6)
    push = sb.transient(rom, sb.Harmonic(10.0, 1000.0), 5e-4)
    upwards = np.array([float(d == 2) for _, d in place])
    momentum = upwards @ m @ rom.whole.modes @ push.states.v[-1]
    assert momentum == pytest.approx(10.0 / (np.pi * 1000.0), rel=1e-4)  # of half a sine


def test_free_body_in_a_steady_state(whole):
    """Pulled along and pushed: displacements of dense matrices within what is told, which is no warning."""
    given = {**whole, "fixed": ()}
    body, (m, k, _) = sb.FiniteElementModel(**given), dense(given)
    end = body.at((0.08, 0.01, 0.01), "z")
    rom = sb.reduce(body, loads={"F": end}, points={"end": end}, modes=16, damping=0.02)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        orbit = sb.periodic(rom, 5.0, 1000.0)
    values, shapes = scipy.linalg.eigh(k, m)
    values[:6], w, f = 0.0, 2.0 * np.pi * 1000.0, end.weights.toarray()[0]
    modal = 5.0 * (f @ shapes) / (values - w**2 + 0.04j * np.sqrt(values) * w)
    right = np.abs(f @ shapes @ modal)
    assert np.abs(orbit.harmonics("end"))[1] == pytest.approx(right, rel=1e-5)
    assert np.abs(np.abs(orbit.harmonics("end"))[1] - right) < orbit.mode_error[1]


def test_offset_and_interference(parts, body):
    """Half thicknesses are taken off gaps; a press fit's forces are those of dense matrices at no load."""
    open_faces = body.contact("LEFT", "RIGHT", normal="x", gap=5e-6)
    assert body.contact("LEFT", "RIGHT", normal="x", offset=1e-3, interference=True).gap == pytest.approx(
        -1e-3
    )
    with pytest.raises(ValueError, match="overlap by 1e-06 m.* interference=True"):
        body.contact("LEFT", "RIGHT", normal="x", gap=-1e-6)
    pressed = body.contact("LEFT", "RIGHT", normal="x", gap=-1e-6, interference=True)
    end = body.at((0.08, 0.01, 0.01), "z")
    rom = sb.reduce(body, contact=pressed, loads={"F": end}, points={"end": end}, modes=10, damping=0.02)
    _, k, _ = dense(parts)
    rows = open_faces.rows.toarray()
    force = np.linalg.solve(rows @ np.linalg.solve(k, rows.T), [1e-6, 1e-6])
    found = sb.static(rom, 0.0)
    assert found.contact_force == pytest.approx(force, rel=1e-6) and (force > 0.0).all()
    with pytest.raises(ValueError, match="overlap at rest"):
        sb.backbone(rom, 1, 1e-6, 1e-3)
    still = sb.transient(rom, sb.Harmonic(1e-6, 1000.0), 1e-3, initial="equilibrium")
    assert still.contact_resultant == pytest.approx(force.sum(), rel=1e-4)


def test_press_fit_in_motion():
    """That never opens: the steady state of dense matrices with tied faces; the difference, 1.1e-6, falls
    with more modes and steps.
    """
    body = sb.read_calculix(DECK)
    pressed = body.contact("LEFT", "RIGHT", normal="x", gap=-5e-6, interference=True)
    end = body.at((0.08, 0.01, 0.01), "z")
    rom = sb.reduce(
        body, contact=pressed, loads={"F": end}, points={"end": end}, modes=40, rayleigh=(20.0, 1e-6)
    )
    m, k, w = body.mass.toarray(), body.stiffness.toarray(), 2.0 * np.pi * 1500.0
    tied = scipy.linalg.null_space(pressed.rows.toarray())
    damped = tied.T @ (k - w * w * m + 1j * w * (20.0 * m + 1e-6 * k)) @ tied
    seen = tied.T @ end.weights.toarray()[0]
    found = sb.periodic(rom, 0.2, 1500.0).harmonics("end")[1]
    assert abs(found) == pytest.approx(0.2 * abs(seen @ np.linalg.solve(damped, seen)), rel=5e-6)


def test_join_beside_dense(parts, body):
    """A body and its mirror image behind a stop: labels, sets and places of both; the force between them by
    hand, and none where the stop is wide.
    """
    places = dict(zip(body.labels.tolist(), body.places * [-1.0, 1.0, 1.0] + [0.16, 0.0, 0.0]))
    turned = scipy.sparse.diags(np.where(body.unknowns[:, 1] == 0, -1.0, 1.0))
    k2, m2 = (turned @ matrix @ turned for matrix in (body.stiffness, body.mass))
    other = sb.FiniteElementModel(m2, k2, body.unknowns, places, sets=body.sets, fixed=body.fixed)
    both = sb.join(body, other)
    assert both.sets["LEFT.2"] == tuple(100 + label for label in body.sets["LEFT"])
    assert len(both.labels) == 2 * len(body.labels) and both.elements["hexahedron"].shape == (16, 8)
    one, two = ([int(a) for a in b.labels[np.abs(b.places[:, 0] - 0.08) < 1e-9]] for b in (body, other))
    stop = both.contact(one, [100 + label for label in two], normal="x", gap=1e-6)
    end = both.at(one[0], "x")
    for a in one[1:]:
        end = end + both.at(a, "x")
    rom = sb.reduce(
        both, contact=stop, loads={"F": end}, points={"end": both.at(two[0] + 100, "x")}, modes=20
    )
    n = len(body.unknowns)
    k = 1e3 * parts["stiffness"].toarray()
    flexible, rows, f = np.zeros((2 * n, 2 * n)), stop.rows.toarray(), end.weights.toarray()[0]
    flexible[:n, :n], flexible[n:, n:] = np.linalg.inv(k), np.linalg.inv(k2.toarray())
    free = rows @ flexible @ (1e4 * f) + 1e-6
    force = np.linalg.solve(rows @ flexible @ rows.T, -free)
    assert (force > 0.0).all()
    found = sb.static(rom, 1e4)
    assert found.contact_force == pytest.approx(force, rel=1e-6)
    u = flexible @ (1e4 * f + rows.T @ force)
    assert found.displacement("end") == pytest.approx(
        u[both.at(two[0] + 100, "x").weights.indices[0]], rel=1e-6
    )
    assert sb.static(rom, -1e4).contact_resultant == 0.0
    assert both.inertia[:n] == pytest.approx(body.inertia)
    three = sb.join(both, body)  # no set is lost, nor a label, of whatever sign
    assert three.sets["LEFT.2"] == both.sets["LEFT.2"] and len(three.sets) == 3 * len(body.sets)
    row = sb.join(*[body] * 20)  # labels had been ten times as large with each, and at last none of any array
    assert row.labels.reshape(20, -1).tolist() == (body.labels + 100 * np.arange(20)[:, None]).tolist()
    again = functools.reduce(sb.join, [body] * 20)
    assert again.labels.tolist() == row.labels.tolist() and again.inertia.tolist() == row.inertia.tolist()
    below = sb.FiniteElementModel(
        *(body.mass, body.stiffness, body.unknowns - [16, 0]),
        {label - 16: place for label, place in zip(body.labels.tolist(), body.places)},
        fixed=[(label - 16, d) for label, d in body.fixed],
    )
    assert len(set(sb.join(below, below).labels.tolist())) == 2 * len(body.labels)
    with pytest.raises(TypeError, match="body 2 = 3 must be a FiniteElementModel"):
        sb.join(body, 3)


def abaqus(file, matrix, unknowns):
    """Text of *MATRIX OUTPUT, FORMAT=MATRIX INPUT: the upper triangle, directions from 1; 1e36 is held."""
    upper = scipy.sparse.triu(matrix).tocoo()
    lines = ["** MATRIX INPUT"]
    for row, column, value in zip(upper.row, upper.col, upper.data):
        (a, i), (b, j) = unknowns[row], unknowns[column]
        lines.append(f"{a},{i + 1}, {b},{j + 1}, {float(value)!r}")
    file.write_text("\n".join(lines) + "\n")


@pytest.fixture
def files(parts, tmp_path):
    """The same matrices in all kinds of files, those of Abaqus with what is held."""
    from petsc4py import PETSc

    for name in ("stiffness", "mass"):
        matrix = parts[name]
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix, symmetry="symmetric", precision=16)
        scipy.sparse.save_npz(tmp_path / f"{name}.npz", matrix)
        made = PETSc.Mat().createAIJ(
            matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=PETSc.COMM_SELF
        )
        viewer = PETSc.Viewer().createBinary(str(tmp_path / f"{name}.petsc"), "w", comm=PETSc.COMM_SELF)
        made.view(viewer)
        viewer.destroy()
        held = scipy.sparse.diags(np.full(len(parts["fixed"]), 1e36 if name == "stiffness" else 0.5))
        whole = scipy.sparse.block_diag([matrix, held])
        abaqus(tmp_path / f"{name}.txt", whole, [*map(tuple, parts["unknowns"].tolist()), *parts["fixed"]])
    return tmp_path


@pytest.mark.parametrize("ending", ["mtx", "npz", "petsc", "txt"])
def test_files_of_matrices(parts, body, files, ending):
    given = {"sets": parts["sets"], "units": "mm-N-t"}
    if ending != "txt":
        given |= {"unknowns": parts["unknowns"], "fixed": parts["fixed"]}
    found = sb.read_matrices(files / f"stiffness.{ending}", files / f"mass.{ending}", parts["nodes"], **given)
    order = [found.unknowns.tolist().index(pair) for pair in body.unknowns.tolist()]
    for one, other in ((found.stiffness, body.stiffness), (found.mass, body.mass)):
        assert abs(one[order][:, order] - other).max() <= 1e-12 * abs(other).max()
    assert found.fixed == body.fixed and found.sets == body.sets


def test_a_deck_for_nodes(tmp_path):
    """Sets, elements and supports of CalculiX's blocks beside its matrices."""
    right = sb.read_calculix(DECK)
    for name in ("stiffness", "mass"):
        scipy.sparse.save_npz(tmp_path / f"{name}.npz", getattr(right, name) / 1e3)
    found = sb.read_matrices(
        tmp_path / "stiffness.npz", tmp_path / "mass.npz", DECK, right.unknowns, units="mm-N-t"
    )
    with pytest.raises(TypeError, match="must be a dict of labels to places, or a deck"):
        sb.read_matrices(tmp_path / "stiffness.npz", tmp_path / "mass.npz", right.places, right.unknowns)
    assert found.sets == right.sets and found.fixed == right.fixed
    assert found.elements["tetra"].tolist() == right.elements["tetra"].tolist()
    assert abs(found.stiffness - right.stiffness).max() <= 1e-12 * abs(right.stiffness).max()


def compressed(part: str, value: int) -> bytes:
    """A .npz of columns whose second index, or beginning of a column, is another one: such a one ended the
    program, as SciPy believes what it reads.
    """
    made, file = scipy.sparse.identity(150, format="csc"), io.BytesIO()
    getattr(made, part)[1] = value
    scipy.sparse.save_npz(file, made)
    return file.getvalue()


WRONG = [
    ("mtx", lambda text: text[:200], "stiffness.mtx is missing or cut"),
    ("npz", lambda text: text[:100], "stiffness.npz is missing or cut"),
    ("petsc", lambda text: text[:-8], "stiffness.petsc is missing or cut.*has no 150 rows"),
    ("txt", lambda text: text[:-30], "stiffness.txt is missing or cut"),
    ("txt", lambda text: text.replace(b"\n", b"\n-7,1, -7,1, 1.0\n", 1), "node -7 is an internal one"),
    ("txt", lambda text: text + text, r"stiffness.txt has \d+ entries twice; is it of two runs\?"),
    ("txt", lambda text: b"1 2 3\n", "lines of node, direction, node, direction, value were expected"),
    ("txt", lambda text: b"1 2\n", "lines of node, direction, node, direction, value were expected"),
    ("txt", lambda text: b"", "lines of node, direction, node, direction, value were expected"),
    ("txt", lambda text: b"99999999999999999999,1, 1,1, 1.0\n", "lines of node, .* were expected"),
    (
        "mtx",
        lambda text: text.replace(b"150 150", b"9" * 11 + b" " + b"9" * 11),
        "mtx is missing or cut.*alloc",
    ),
    (
        "mtx",
        lambda text: b"%%MatrixMarket matrix coordinate pattern symmetric\n3 3 3\n1 1\n2 2\n3 3\n",
        r"mtx is missing or cut.*\(its field is pattern, places without values; write it with field real",
    ),
    ("npz", lambda text: compressed("indices", 150), r"npz is missing or cut.*indices must be < 150"),
    ("npz", lambda text: compressed("indices", -1), r"npz is missing or cut.*indices must be >= 0"),
    ("npz", lambda text: compressed("indptr", 150), r"npz is missing or cut.*"),
]


@pytest.mark.parametrize(("ending", "change", "sentence"), WRONG)
def test_wrong_files_of_matrices(parts, files, ending, change, sentence):
    file = files / f"stiffness.{ending}"
    file.write_bytes(change(file.read_bytes()))
    given = {} if ending == "txt" else {"unknowns": parts["unknowns"]}
    with pytest.raises(ValueError, match=sentence) as raised:
        sb.read_matrices(file, files / f"mass.{ending}", parts["nodes"], **given)
    assert "\n" not in str(raised.value)


def test_mass_that_is_cut(parts, files):
    """Text of Abaqus that ends behind some line is as right as any; without the mass of a few nodes on
    springs, or of rotations, nothing is told.
    """
    text = (files / "mass.txt").read_text().splitlines(keepends=True)
    (files / "mass.txt").write_text("".join(text[: len(text) // 2]))
    with pytest.warns(sb.MeshWarning, match=r"mass couples unknowns, but \d+ displacements have none; is it"):
        sb.read_matrices(files / "stiffness.txt", files / "mass.txt", parts["nodes"], units="mm-N-t")
    springs = scipy.sparse.block_diag([parts["stiffness"], 1e3 * scipy.sparse.identity(6)])
    mass = scipy.sparse.block_diag([parts["mass"], scipy.sparse.csr_matrix((6, 6))])
    ends = np.array([(label, d) for label in (901, 902) for d in range(3)])
    nodes = parts["nodes"] | {901: (0.0, 20.0, 0.0), 902: (80.0, 20.0, 0.0)}
    given = {**parts, "mass": mass, "stiffness": springs, "nodes": nodes}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb.FiniteElementModel(**{**given, "unknowns": np.vstack([parts["unknowns"], ends])})


def test_sets_and_supports_beside_files(parts, files):
    """Those of another kind are told, as by the body itself."""
    given = files / "stiffness.npz", files / "mass.npz", parts["nodes"], parts["unknowns"]
    for wrong, sentence in (
        ({"sets": [1]}, r"read_matrices: sets = \[1\] must be a dict of names to labels"),
        ({"fixed": 3}, r"read_matrices: fixed = 3 must be pairs \(node, direction\)"),
    ):
        with pytest.raises(TypeError, match=sentence):
            sb.read_matrices(*given, **wrong)


def test_corners_of_eight_node_faces():
    """They are warned of where a face touches with the nodes between them, of wedges, too; those between them
    alone, an edge, and faces of six nodes are not.
    """
    nodes = {k + 1: (float(k), 0.0, 0.0) for k in range(20)}
    unknowns = [(label, 0) for label in nodes]
    eye = scipy.sparse.identity(20, format="csr")
    body = sb.FiniteElementModel(eye, 1e6 * eye, unknowns, nodes, elements={"hexahedron20": [list(nodes)]})
    wedge = {"wedge15": [list(nodes)[:15]]}
    wedge = sb.FiniteElementModel(eye, 1e6 * eye, unknowns, nodes, elements=wedge)
    for one, face in ((body, [1, 2, 3, 4, 9, 10, 11, 12]), (wedge, [1, 2, 5, 4, 7, 14, 10, 13])):
        with pytest.warns(sb.MeshWarning, match="4 nodes are corners of eight-node faces"):
            one.contact(face, normal=(-1, 0, 0), gap=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for one, touching in ((body, [9, 10]), (body, [2, 3, 10]), (wedge, [1, 2, 3, 7, 8, 9])):
            one.contact(touching, normal=(-1, 0, 0), gap=1e-3)
