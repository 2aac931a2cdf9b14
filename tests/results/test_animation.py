"""Fields of motions for ParaView and as animated pictures: they are what the history says of points and
faces, contact included.
"""

from __future__ import annotations

import os
import pathlib
import xml.etree.ElementTree as xml

import meshio
import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter, PillowWriter
from PIL import Image

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.plot import animate_crack, animation
from sbfem_petsc.plot.animation import _instants
from sbfem_petsc.plot.drawing import figure
from sbfem_petsc.plot.views import Window
from sbfem_petsc.results.animation import write_animation
from sbfem_petsc.results.vtu import write_vtu
from sbfem_petsc.system.fields.outlines import gather_outline, gather_region
from tests.parallel import on_ranks

LOAD = sb.PointForce("A", fy=sb.ToneBurst(3000.0, 3000, 5))
PROGRAM = """
import sys
from tests.results.test_animation import LOAD, beam
import sbfem_petsc as sb
history = sb.transient(sb.Model(beam().mesh(order=3), sb.Material(70e9, 0.33, 2700)), LOAD, 1e-3, modes=16)
sb.write_animation(sys.argv[1], history, times=[0.0, 5e-4, 1e-3])
"""


def beam():
    return Beam(length=0.05, height=0.005, notches=[VNotch(x=0.02, depth=0.0025, opening=0.0458366)])


@pytest.fixture(scope="module")
def moved():
    """Mesh, history of a closing notch on few modes, where the residual flexibility matters."""
    mesh = beam().mesh(order=3, tip_size=2e-4)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), damping=0.002)
    return mesh, sb.transient(model, LOAD, 0.002, 1e-6, modes=16)


@pytest.mark.long
def test_contact_inside_the_tip_element(tmp_path):
    """In equilibrium a history's field is that of the static solution, between the faces' nodes too, and an
    orbit's field has it as well.
    """
    model = sb.Model(beam().mesh(order=3, tip_size=2e-4), sb.Material(70e9, 0.33, 2700), damping=0.05)
    push = sb.PointForce("A", fy=200.0)
    exact = sb.static(model, push).interior
    history = sb.transient(model, push, 1e-6, 1e-6, modes=16, initial="equilibrium")
    found = history.field(0.0)
    np.testing.assert_allclose(found, exact.nodal, atol=1e-8 * np.abs(exact.nodal).max())
    for number, forces in exact.tip_forces.items():
        assert forces.max() > 1.0
        np.testing.assert_allclose(found.tip_forces[number], forces, atol=1e-6 * forces.max())
    pieces = [
        meshio.read(write_vtu(str(tmp_path / name), model, {"u": field}))
        for name, field in (("history.vtu", found), ("static.vtu", exact))
    ]
    one, other = (piece.point_data["u (m)"] for piece in pieces)
    np.testing.assert_allclose(one, other, atol=1e-8 * np.abs(other).max())
    orbit = sb.periodic(model, push, 200.0, modes=16)
    peak = float(orbit.time[orbit.contact_resultant.argmax()])
    inside = orbit.states.contact[orbit.contact_resultant.argmax(), orbit.states.pairs :]
    assert orbit.field(peak).tip_forces[0][: len(inside)] == pytest.approx(inside)


@pytest.mark.long
def test_one_file_of_all_instants(moved, tmp_path):
    """VTK itself reads times, cells and values of the VTU files of the same instants."""
    pyvista = pytest.importorskip("pyvista")
    _, history = moved
    times = [0.0, 5e-4, 1e-3]
    file = write_animation(str(tmp_path / "film.vtkhdf"), history, times=times, stress=True)
    write_animation(str(tmp_path / "film"), history, times=times, stress=True)
    expected = entries(tmp_path / "film" / "history.pvd")
    vtk = pytest.importorskip("vtkmodules.vtkIOHDF")
    reader = vtk.vtkHDFReader()
    reader.SetFileName(file)
    reader.UpdateInformation()
    told = reader.GetOutputInformation(0)
    pipeline = pytest.importorskip("vtkmodules.vtkCommonExecutionModel").vtkStreamingDemandDrivenPipeline
    assert told.Get(pipeline.TIME_STEPS()) == pytest.approx([at for at, _ in expected], abs=1e-12)
    for at, grid in expected:
        reader.UpdateTimeStep(at)
        found = pyvista.wrap(reader.GetOutput())
        assert found.n_cells == sum(len(block.data) for block in grid.cells)
        np.testing.assert_allclose(found.points, grid.points, atol=1e-12)
        assert set(grid.point_data) <= set(found.point_data.keys())
        for name, values in grid.point_data.items():
            np.testing.assert_allclose(found.point_data[name], values, rtol=1e-6, atol=1e-12)
    assert found.cell_data["element"].tolist() == np.concatenate(grid.cell_data["element"]).tolist()


def entries(pvd):
    """Times and grids of a PVD file."""
    root = xml.parse(pvd).getroot()
    return [
        (float(e.get("timestep")), meshio.read(pathlib.Path(pvd).parent / e.get("file")))
        for e in root.findall("Collection/DataSet")
    ]


def held(grid, place):
    """Whether a file has a point at a place of the structure."""
    return np.linalg.norm(grid.points[:, :2] - place, axis=1).min() < 1e-9


def at(grid, place):
    """Displacement in a file at a place of the structure."""
    distance = np.linalg.norm(grid.points[:, :2] - place, axis=1)
    assert distance.min() < 1e-9
    return grid.point_data["displacement (m)"][distance.argmin(), :2]


def test_faces_do_not_overlap(moved, tmp_path):
    """Gaps of all pairs in the files are the history's, closed ones included; the modes alone would
    overlap.
    """
    mesh, history = moved
    peak = int(history.contact_resultant.argmax())
    chosen = [0.0, float(history.time[peak]), 0.002]
    pairs, initial = mesh.pairs, history.reduced.initial_gap[: history.reduced.pairs]
    scale = np.abs(history.gap).max()
    closed = 0
    for time, grid in entries(write_animation(tmp_path / "film", history, times=chosen)):
        k = int(np.abs(history.time - time).argmin())
        assert time == history.time[k]
        # the ends of the faces' edges are points of the file; inner nodes lie between the equal subdivisions
        ends = [row for row, nodes in enumerate(pairs.nodes) if all(held(grid, mesh.nodes[n]) for n in nodes)]
        gap = np.array(
            [
                (at(grid, mesh.nodes[a]) - at(grid, mesh.nodes[b])) @ pairs.normal[row] + initial[row]
                for row, (a, b) in ((row, pairs.nodes[row]) for row in ends)
            ]
        )
        assert len(ends) > 5 and mesh.points["B"] in pairs.nodes[ends]
        np.testing.assert_allclose(gap, history.gap[k, ends], rtol=0.0, atol=1e-7 * scale)
        assert gap.min() > -1e-7 * scale
        closed += int((history.gap[k, ends] < 1e-9 * scale).sum())
        for point in ("A", "B", "C"):
            place = mesh.nodes[mesh.points[point]]
            np.testing.assert_allclose(
                at(grid, place), history.displacement(point)[k], rtol=0.0, atol=1e-7 * scale
            )
    assert closed > 3
    modal = history.states.q[peak] @ history.reduced.gap.modes.T[:, : history.reduced.pairs]
    assert (modal + initial).min() < -1e-3 * scale


def test_orbits_move_too(moved, tmp_path):
    _, history = moved
    orbit = sb.periodic(history.reduced, sb.PointForce("A", fy=300.0), 3000.0, stability=False)
    found = entries(write_animation(tmp_path / "film", orbit, every=128, name="period"))
    np.testing.assert_allclose([time for time, _ in found], orbit.time[::128])


def test_instants(moved, tmp_path):
    _, history = moved
    assert len(entries(write_animation(tmp_path / "film", history, every=1000, name="few"))) == 3
    names = sorted(p.name for p in (tmp_path / "film").iterdir())
    assert names == ["few.pvd", *(f"few_{k:04d}.vtu" for k in range(3))]
    for options, error, words in (
        ({"times": [1.0]}, ValueError, "between"),
        ({"every": 0}, ValueError, "at least 1"),
        ({"every": 1.5}, TypeError, "integer"),
        ({"times": [0.0], "every": 2}, ValueError, "not both"),
    ):
        with pytest.raises(error, match=words):
            write_animation(tmp_path / "film", history, **options)


def test_motions_without_fields(moved, tmp_path):
    _, history = moved
    path = tmp_path / "orbit.h5"
    orbit = sb.periodic(history.reduced, sb.PointForce("A", fy=300.0), 3000.0, stability=False)
    sb.save(path, orbit)
    with pytest.raises(sb.SolveError, match="keeps no fields"):
        write_animation(tmp_path / "film", sb.read(path))
    with pytest.raises(TypeError, match="neither a History nor an Orbit"):
        write_animation(tmp_path / "film", history.reduced)


@pytest.mark.long
def test_two_ranks(tmp_path):
    on_ranks(2, PROGRAM, str(tmp_path))
    files = [e.get("file") for e in xml.parse(tmp_path / "history.pvd").getroot().iter("DataSet")]
    assert files == [f"history_{k:04d}.pvtu" for k in range(3)]
    assert all((tmp_path / name).exists() for name in files)


@pytest.fixture(scope="module")
def orbit(moved):
    model = moved[1].reduced.model
    return sb.periodic(model, sb.PointForce("A", fy=300.0), 1000.0, modes=12, steps=64, stability=False)


@pytest.mark.slow
def test_animated_picture(moved, orbit, tmp_path):
    """As many frames as asked for, in the time asked for, that repeat without end."""
    path = tmp_path / "crack.gif"
    assert animate_crack(orbit, str(path), frames=3, seconds=1.5) == str(path)
    with Image.open(path) as film:
        assert film.n_frames == 3 and film.info["loop"] == 0 and film.info["duration"] == 500
        states = []
        for frame in range(3):
            film.seek(frame)
            states.append(np.asarray(film.convert("L"), dtype=float))
    apart = [np.abs(a - b).mean() for a, b in zip(states, states[1:])]
    assert min(apart) > 0.1  # of 255 levels
    between = (0.0005, 0.0010)
    assert list(_instants(moved[1], between, 3)) == [500, 750, 1000]
    assert list(_instants(orbit, None, 4)) == [0, 16, 32, 48]  # the end is the start
    assert [file.name for file in tmp_path.iterdir()] == ["crack.gif"]


def test_lips_are_drawn_as_far_apart_as_the_gap_says(moved, orbit):
    """Distance of the notch's corners in the picture: the gap times the magnification, at both instants."""
    mesh, model, factor = moved[0], orbit.reduced.model, 200.0
    crack = model.cracks[0]
    corners = [mesh.nodes[mesh.points[name]] for name in "BC"]
    across = np.array([crack.axis[1], -crack.axis[0]])
    mouth = int(np.argmax(model.pairs.position))
    for instant in (0, 32):
        field = orbit.field(float(orbit.time[instant]))
        half = 1.1 * crack.length
        region, outline = (
            gather_region(model, field, np.array(crack.tip), half),
            gather_outline(model, [field]),
        )
        window = Window(crack, half, "von_mises")
        axes = figure(3.0).add_subplot()
        colours = window.colours([region])
        interior, *lines = window.paint(axes, region, outline, 0, factor=factor, colours=colours)
        near = [p for p in outline if (np.abs(p.positions - crack.tip) <= 1.5 * half).all(axis=1).any()]
        assert len(near) == len(lines)
        lips = []
        for corner in corners:
            piece, line = next(
                (p, line) for p, line in zip(near, lines) if np.abs(p.positions - corner).sum(1).min() < 1e-12
            )
            lips.append(line.get_xydata()[np.abs(piece.positions - corner).sum(1).argmin()])
        drawn = abs((lips[0] - lips[1]) @ across) * 1e-3  # mm
        assert drawn == pytest.approx(factor * orbit.gap[instant, mouth], rel=1e-6)


@pytest.mark.parametrize(
    "options, error, sentence",
    [
        ({"path": "a.avi"}, ValueError, "must end in .gif or .mp4"),
        ({"path": "a.mp4"}, sb.SolveError, "needs the program ffmpeg"),
        ({"crack": 1}, ValueError, "crack = 1 does not exist; the model has 1"),
        ({"frames": 1}, ValueError, "frames = 1 must be between 2 and 1000"),
        ({"between": (1.0, 0.5)}, ValueError, "must be two times from 0 to"),
        ({"between": 3.0}, TypeError, "must be two times, s"),
        ({"colour": "red"}, ValueError, "must be one of 'von_mises', 'displacement'"),
        ({"magnification": 0.0}, ValueError, "magnification = 0.0 must be finite and above 0"),
        ({"motion": 1}, TypeError, "neither a History nor an Orbit"),
    ],
)
def test_wrong_animations(orbit, tmp_path, monkeypatch, options, error, sentence):
    monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda: False)
    given = {"motion": orbit, "path": "a.gif", **options}
    with pytest.raises(error, match=sentence):
        animate_crack(given.pop("motion"), str(tmp_path / given.pop("path")), **given)
    assert not list(tmp_path.iterdir())


class Stopping(PillowWriter):
    """Fails at its second frame, as on a full disk, by a signal, or by a mistake in a picture."""

    error: type[BaseException] = OSError

    def grab_frame(self, **options):
        if self._frames:
            raise self.error("stopped")
        super().grab_frame(**options)


@pytest.mark.slow
@pytest.mark.parametrize("error, told", [(OSError, ValueError), (KeyboardInterrupt, KeyboardInterrupt)])
def test_a_film_that_is_not_ended(orbit, tmp_path, monkeypatch, error, told):
    """The former film stays as it was, and nothing else is there."""
    path = tmp_path / "crack.gif"
    path.write_bytes(b"former")
    monkeypatch.setattr(animation, "PillowWriter", Stopping)
    monkeypatch.setattr(Stopping, "error", error)
    with pytest.raises(told, match="stopped"):
        animate_crack(orbit, str(path), frames=3)
    assert path.read_bytes() == b"former" and list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_ffmpeg_that_fails(orbit, tmp_path, monkeypatch):
    """Its own last words in one sentence; nothing is left behind."""
    program = tmp_path / "bin" / "ffmpeg"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\ncat > /dev/null\necho first >&2\necho 'unknown encoder' >&2\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    folder = tmp_path / "out"
    folder.mkdir()
    with pytest.raises(sb.SolveError, match=r"ffmpeg ended with code 3 \(unknown encoder\)"):
        animate_crack(orbit, str(folder / "crack.mp4"), frames=3)
    assert not list(folder.iterdir())
