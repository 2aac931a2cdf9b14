"""What is seen of whole bodies, what moves them and what they are made of, beside dense computations."""

from __future__ import annotations

import meshio
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

import sbfem_petsc as sb
from sbfem_petsc import plot


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
    bare = sb.FiniteElementModel(
        body.mass, body.stiffness, body.unknowns, dict(zip(body.labels, body.places))
    )
    assert list(meshio.read(sb.write_vtu(str(tmp_path / "b.vtu"), bare, {})).cells_dict) == ["vertex"]


def test_without_shapes(body, tmp_path):
    end = body.at("RIGHT", "z")
    rom = sb.reduce(body, loads={"F": end}, points={"end": end}, modes=3, damping=0.01, shapes=False)
    assert sb.static(rom, 1.0).field is None
    orbit = sb.periodic(rom, 1.0, 100.0, steps=64)
    for call in (
        lambda: orbit.field(0.0),
        lambda: sb.modal(rom, 1).nodal(0),
        lambda: sb.write_animation(str(tmp_path), orbit),
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
    still = sb.transient(rom, sb.Harmonic(1e-6, 1000.0), 1e-3, initial="equilibrium")
    assert still.contact_resultant == pytest.approx(force.sum(), rel=1e-4)
