"""Histories on disk: restart after a kill, Ctrl-C, full disks and lost folders, other models' files,
animations.
"""

import errno
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as xml

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.analysis import transient as module
from sbfem_petsc.results import history
from sbfem_petsc.results.animation import write_animation
from sbfem_petsc.results.history import IncompleteHistory, read_history
from tests.parallel import ROOT, answer, on_ranks

# The child's pause after a chunk leaves time for a signal; 40 chunks of 256 steps.
PROGRAM = """
import json, sys, time
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.analysis import transient as module
from tests.results.test_history import make, LOAD, RUN
module.CHUNK = 256
path, pause, restart = sys.argv[1], float(sys.argv[2]), sys.argv[3] == "restart"
def tell(done):
    print(f"done {done}", flush=True)
    time.sleep(pause)
found = sb.transient(make(), LOAD, progress=tell, file=path, restart=restart, **RUN)
if len(sys.argv) > 4:
    from sbfem_petsc.results.animation import write_animation
    write_animation(sys.argv[4], sb.modal(make(), 16), found, every=1000)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({"u": found.displacement("A")[-1].tolist()}))
"""
LOAD = sb.PointForce("A", fy=sb.ToneBurst(3000.0, 3000, 5))
RUN = {"duration": 0.01024, "step": 1e-6, "modes": 16, "decimation": 5}


def make(depth=0.0025):
    from meshing import Beam, VNotch

    beam = Beam(length=0.05, height=0.005, notches=[VNotch(x=0.02, depth=depth, opening=0.0458366)])
    return sb.Model(beam.mesh(order=3, tip_size=2e-4), sb.Material(70e9, 0.33, 2700), damping=0.002)


@pytest.fixture(scope="module")
def model():
    return make()


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr(module, "CHUNK", 256)


@pytest.fixture(scope="module")
def whole(model, tmp_path_factory):
    """The uninterrupted history, recorded as well."""
    previous, module.CHUNK = module.CHUNK, 256
    try:
        return sb.transient(model, LOAD, file=tmp_path_factory.mktemp("whole") / "h.h5", **RUN)
    finally:
        module.CHUNK = previous


def same(one, other):
    """Equal to the last bit."""
    for name in ("time", "modal_displacement", "modal_velocity", "amplitudes", "contact_force"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for name in ("kinetic", "strain", "external", "damping", "contact"):
        assert np.array_equal(getattr(one.energy, name), getattr(other.energy, name)), name
    assert one.exchanges == other.exchanges and one.step == other.step


def stopped(fraction):
    """A progress callback that raises Ctrl-C's error at a fraction of the run."""

    def tell(done):
        if done >= fraction:
            raise KeyboardInterrupt

    return tell


def child(path, pause, mode="new"):
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(path), str(pause), mode],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])},
    )


def test_a_file_holds_the_history(model, whole, small_chunks, tmp_path):
    path = tmp_path / "h.h5"
    same(sb.transient(model, LOAD, file=path, **RUN), whole)
    found = read_history(path)
    assert found.complete and whole.contact_resultant.max() > 100
    same(found, whole)
    np.testing.assert_array_equal(found.displacement("A"), whole.displacement("A"))
    unrecorded = sb.transient(model, LOAD, **RUN).modal_displacement
    np.testing.assert_allclose(unrecorded, whole.modal_displacement, atol=1e-10 * np.abs(unrecorded).max())
    with h5py.File(path) as file:
        assert file.attrs["complete"] and file["time"].attrs["unit"] == "s"
    same(sb.transient(model, LOAD, file=path, restart=True, **RUN), whole)  # nothing left to do


@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGINT])
def test_killed_and_restarted(model, whole, small_chunks, tmp_path, kind):
    """kill -9 and Ctrl-C after some chunks: readable, not complete; restarted it is the uninterrupted
    history, bit by bit.
    """
    path = tmp_path / "h.h5"
    run = child(path, 0.05)
    for _ in range(7):
        assert run.stdout.readline().startswith("done"), run.stderr.read()
    run.send_signal(kind)
    errors = run.communicate(timeout=30)[1]
    assert run.returncode != 0 and ("KeyboardInterrupt" in errors) == (kind == signal.SIGINT)
    with pytest.warns(IncompleteHistory, match="restart=True"):
        part = read_history(path)
    n = len(part.time)
    assert not part.complete and 7 * 256 // 5 < n < 39 * 256 // 5
    np.testing.assert_allclose(
        part.displacement("A"),
        whole.displacement("A")[:n],
        atol=1e-10 * np.abs(whole.displacement("A")).max(),
    )
    same(sb.transient(model, LOAD, file=path, restart=True, **RUN), whole)
    assert read_history(path).complete


def test_killed_at_any_moment(small_chunks, tmp_path):
    """A writer that does nothing but write, killed at four moments: always readable, and the rows are those
    of the state.
    """
    program = """
import sys, numpy as np, sbfem_petsc as sb
from sbfem_petsc.analysis import transient as module
from sbfem_petsc.reduction.reduced_model import reduce_matrices
module.CHUNK = 4
stiffness, load = np.diag([1.0, 4.0, 9.0]), np.eye(3)[:, :1]
r = reduce_matrices(np.eye(3), stiffness, np.zeros((0, 3)), np.zeros(0), load, {"x": 0}, 2)
from sbfem_petsc.results.history import HistoryFile
from mpi4py import MPI
signals, steps = [sb.Harmonic(1.0, 0.1)], 10**5
def tell(done):
    if done < 1e-4:
        print(flush=True)
comm, path = MPI.COMM_SELF, sys.argv[1]
with HistoryFile(comm, path, False, r, signals, steps, 0.01, True, "exact", "rest", 1) as record:
    module.integrate(r, signals, steps, 0.01, record=record, progress=tell)
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", program, str(tmp_path / f"{k}.h5")],
            env=environment,
            stdout=subprocess.PIPE,
        )
        for k in range(4)
    ]
    for k, run in enumerate(runs):
        run.stdout.readline()
        time.sleep(0.0317 * k)
        run.kill()
        run.wait()
        run.stdout.close()
        with pytest.warns(IncompleteHistory):
            found = read_history(tmp_path / f"{k}.h5")
        assert len(found.time) > 1 and np.array_equal(found.time, np.arange(len(found.time)) * 0.01)


@pytest.mark.parametrize("step", [1e-6, None])
def test_a_longer_run(model, whole, small_chunks, tmp_path, step):
    """A complete history of half of the time goes on to the whole, at its own step; a shorter one is not made
    of it.
    """
    path = tmp_path / "h.h5"
    half = sb.transient(model, LOAD, file=path, **{**RUN, "duration": 0.00512})
    assert read_history(path).complete
    found = sb.transient(model, LOAD, file=path, restart=True, **{**RUN, "step": step})
    same(found, whole)
    same(read_history(path), whole)
    assert (
        len(half.time) == 1025
        and read_history(path).complete
        and [p.name for p in tmp_path.iterdir()] == ["h.h5"]
    )
    with pytest.raises(ValueError, match="run of 0.01024 s, longer than 0.00512 s"):
        sb.transient(model, LOAD, file=path, restart=True, **{**RUN, "duration": 0.00512})


def test_a_killed_run_made_longer(model, whole, small_chunks, tmp_path):
    """The shorter run's step, 0.005 s / 5000, is another number in its last digit, and stays."""
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.6), **{**RUN, "duration": 0.005})
    found = sb.transient(model, LOAD, file=path, restart=True, **RUN)
    for values, exact in (
        (found.displacement("A"), whole.displacement("A")),
        (found.contact_force, whole.contact_force),
        (found.time, whole.time),
    ):
        np.testing.assert_allclose(values, exact, rtol=0, atol=1e-10 * np.abs(exact).max())


def test_rows_left_in_the_file(model, whole, small_chunks, tmp_path):
    """in_memory=False: the same history, its arrays read from the file; stopped, continued and made longer as
    well.
    """
    path, short = tmp_path / "h.h5", {**RUN, "duration": 0.00512, "in_memory": False}
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.4), **short)
    half = sb.transient(model, LOAD, file=path, restart=True, **short)
    assert all(
        isinstance(values, np.memmap) for values in (half.modal_displacement, half.contact_force, half.time)
    )
    np.testing.assert_array_equal(half.displacement("A"), whole.displacement("A")[:1025])
    found = sb.transient(model, LOAD, file=path, restart=True, in_memory=False, **RUN)
    same(found, whole)
    np.testing.assert_array_equal(
        half.displacement("A"), whole.displacement("A")[:1025]
    )  # of the file before
    with pytest.raises(ValueError, match="in_memory = False needs a file"):
        sb.transient(model, LOAD, in_memory=False, **RUN)


def test_another_models_file_is_refused(model, whole, small_chunks, tmp_path):
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.1), **RUN)
    content = path.read_bytes()
    for options, words in (
        ({"model": make(0.002)}, "another model"),
        ({"step": 2e-6}, "step"),
        ({"decimation": 2}, "decimation"),
        ({"scheme": "newmark"}, "scheme"),
        ({"modes": 12}, "another model"),
        ({"load": sb.PointForce("A", fy=sb.ToneBurst(2000.0, 3000, 5))}, "other load signals"),
        ({"load": sb.PointForce("A", fx=sb.ToneBurst(3000.0, 3000, 5))}, "another model"),
        ({"start": "equilibrium"}, "start"),
    ):
        given = {"model": model, "load": LOAD, **RUN, **options}
        with pytest.raises(ValueError, match=words):
            sb.transient(file=path, restart=True, **given)
    assert path.read_bytes() == content
    with pytest.raises(ValueError, match="restart = True needs the file"):
        sb.transient(model, LOAD, restart=True, **RUN)


def test_lost_files(tmp_path):
    """Missing, truncated, no HDF5, another kind: one sentence."""
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = 1.0
    (tmp_path / "text.h5").write_text("time, u\n")
    (tmp_path / "short.h5").write_bytes(other.read_bytes()[:900])
    for name, words in (
        ("missing.h5", "does not exist"),
        ("text.h5", "truncated or no HDF5"),
        ("short.h5", "truncated"),
        ("other.h5", "another kind"),
    ):
        with pytest.raises(ValueError, match=words):
            read_history(tmp_path / name)


def test_unwritable_folder(model, tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "missing" / "h.h5", tmp_path / "file" / "h.h5"):
        with pytest.raises(ValueError, match="cannot be written"):
            sb.transient(model, LOAD, file=path, **RUN)


def test_folder_gone(model, small_chunks, tmp_path):
    (tmp_path / "gone").mkdir()

    def remove(done):
        shutil.rmtree(tmp_path / "gone", ignore_errors=True)

    with pytest.raises(sb.SolveError, match="removed or replaced"):
        sb.transient(model, LOAD, file=tmp_path / "gone" / "h.h5", progress=remove, **RUN)


def test_full_disk(model, whole, small_chunks, tmp_path, monkeypatch):
    """What was written stays readable and can be continued."""
    path, real, left = tmp_path / "h.h5", os.pwrite, [400_000]

    def full(handle, data, place):
        if left[0] <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = real(handle, data[: left[0]], place)
        left[0] -= written
        return written

    monkeypatch.setattr(history.os, "pwrite", full)
    with pytest.raises(sb.SolveError, match="No space left.*stays readable"):
        sb.transient(model, LOAD, file=path, **RUN)
    monkeypatch.setattr(history.os, "pwrite", real)
    with pytest.warns(IncompleteHistory):
        part = read_history(path)
    assert len(part.time) > 256 // 5
    np.testing.assert_array_equal(part.modal_displacement, whole.modal_displacement[: len(part.time)])
    same(sb.transient(model, LOAD, file=path, restart=True, **RUN), whole)


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0 or shutil.which("mount") is None, reason="needs root"
)
def test_full_tmpfs(model, small_chunks, tmp_path):
    folder = tmp_path / "small"
    folder.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=512k", "none", str(folder)], capture_output=True
    ).returncode:
        pytest.skip("mount is not allowed")
    try:
        with pytest.raises(sb.SolveError, match="No space left"):
            sb.transient(model, LOAD, file=folder / "h.h5", **RUN)
        with pytest.warns(IncompleteHistory):
            assert len(read_history(folder / "h.h5").time) > 50
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_two_ranks_continue_a_serial_run(model, whole, small_chunks, tmp_path):
    """The file's own reduction goes on, so the number of ranks does not matter."""
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.3), **RUN)
    done = on_ranks(2, PROGRAM, str(path), "0", "restart", str(tmp_path / "film"))
    np.testing.assert_allclose(answer(done)["u"], whole.displacement("A")[-1], rtol=1e-10)
    same(read_history(path), whole)
    files = [
        e.get("file")
        for e in xml.parse(tmp_path / "film" / "history.pvd").getroot().findall("Collection/DataSet")
    ]
    assert files == [f"history_{k:04d}.pvtu" for k in range(3)] and all(
        (tmp_path / "film" / f).exists() for f in files
    )


def test_state_half_written(model, whole, small_chunks, tmp_path):
    """A kill in the middle of a state leaves the one before, from which the history goes on."""
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.3), **RUN)
    with h5py.File(path, "r+") as file:
        newer = max("AB", key=lambda slot: file["state"][slot][0])
        file["state"][newer][20:] = 0.0
    with pytest.warns(IncompleteHistory):
        assert len(read_history(path).time) == 1 + 11 * 256 // 5
    same(sb.transient(model, LOAD, file=path, restart=True, **RUN), whole)


def test_error_of_rank_0_on_both_ranks(tmp_path):
    """Both ranks end, neither by the other's abort, and the sentence is printed once."""
    done = on_ranks(2, PROGRAM, str(tmp_path / "missing" / "h.h5"), "0", "new", check=False, timeout=60)
    sentences = [line for line in done.stderr.splitlines() if line.startswith("ValueError: history file")]
    assert done.returncode != 0 and len(sentences) == 1 and "cannot be written" in sentences[0]
    assert "all ranks are stopped" not in done.stderr


def test_animation(model, whole, tmp_path):
    """Displacements at the free end's corner are those of the modes; a mode turned round by another solve
    does no harm.
    """
    from dataclasses import replace

    import meshio

    modes = sb.modal(model, 16)
    turned = replace(
        modes,
        shapes=modes.shapes * np.where(np.arange(16) % 3, 1.0, -1.0),
        point_shapes={
            p: s * np.where(np.arange(16) % 3, 1.0, -1.0)[:, None] for p, s in modes.point_shapes.items()
        },
    )
    pvd = write_animation(tmp_path / "film", turned, whole, times=[0.0, 0.0005, 0.001])
    entries = xml.parse(pvd).getroot().findall("Collection/DataSet")
    assert [float(e.get("timestep")) for e in entries] == pytest.approx([0.0, 0.0005, 0.001], abs=3e-6)
    for entry in entries:
        grid = meshio.read(pathlib.Path(pvd).parent / entry.get("file"))
        corner = np.argmin(np.linalg.norm(grid.points[:, :2] - model.points["A"][0], axis=1))
        k = int(np.argmin(np.abs(whole.time - float(entry.get("timestep")))))
        expected = (
            whole.reduction.sensor_modes[whole.reduction.points.index("A")] @ whole.modal_displacement[k]
        )
        np.testing.assert_allclose(
            grid.point_data["displacement"][corner, :2], expected, rtol=1e-6, atol=1e-12
        )
    assert (
        len(
            xml.parse(write_animation(tmp_path / "film", modes, whole, every=1000, name="few"))
            .getroot()
            .findall("Collection/DataSet")
        )
        == 3
    )
    for options, words in (
        ({"times": [1.0]}, "between"),
        ({"every": 0}, "positive"),
        ({"times": [0.0], "every": 2}, "not both"),
    ):
        with pytest.raises(ValueError, match=words):
            write_animation(tmp_path / "film", modes, whole, **options)
    with pytest.raises(ValueError, match="not those"):
        write_animation(tmp_path / "film", sb.modal(make(0.002), 16), whole, every=1000)
