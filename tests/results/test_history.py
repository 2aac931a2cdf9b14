"""Histories on disk: restart after a kill, Ctrl-C, full disks and lost folders, other models' files, changed
bytes, two writers.
"""

import contextlib
import errno
import os
import shutil
import signal
import stat
import struct
import subprocess
import sys
import warnings
import zlib
from dataclasses import replace

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from meshing.warnings import IncompleteHistory
from sbfem_petsc.motion import reduced_history as module
from sbfem_petsc.ranks import capacity
from sbfem_petsc.record import journal
from tests.parallel import ROOT, answer, in_session, interruptible, on_ranks
from tests.results.same import inverted
from tests.systems import same_products

# 40 chunks of 256 steps; after the seventh the child waits for a signal, if it is to.
PROGRAM = """
import json, sys
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.motion import reduced_history as module
from tests.results.test_history import make, LOAD, RUN
from tests.parallel import wait_for_a_signal
module.CHUNK = 256
path, wait, restart = sys.argv[1], sys.argv[2] == "wait", sys.argv[3] == "restart"
def tell(done):
    print(f"done {done}", flush=True)
    if wait and done > 6.9 / 40:
        wait_for_a_signal()
found = sb.transient(make(), LOAD, progress=tell, file=path, resume=restart, **RUN)
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
    """States to the last bit; energies are products."""
    assert np.array_equal(one.time, other.time)
    for name in ("q", "v", "amplitudes", "contact"):
        assert np.array_equal(getattr(one.states, name), getattr(other.states, name)), name
    for name in ("kinetic", "strain", "external", "damping", "contact"):
        same_products(getattr(one.energy, name), getattr(other.energy, name), name)
    assert one.exchanges == other.exchanges and one.step == other.step


def stopped(fraction):
    """A progress callback that raises Ctrl-C's error at a fraction of the run."""

    def tell(done):
        if done >= fraction:
            raise KeyboardInterrupt

    return tell


def child(path, wait, mode="new"):
    return in_session([sys.executable, "-c", PROGRAM, str(path), wait, mode], preexec_fn=interruptible)


def test_a_file_holds_the_history(model, whole, small_chunks, tmp_path):
    path = tmp_path / "h.h5"
    same(sb.transient(model, LOAD, file=path, **RUN), whole)
    found = sb.read(path)
    assert found.complete and whole.contact_resultant.max() > 100
    same(found, whole)
    same_products(found.displacement("A"), whole.displacement("A"))
    unrecorded = sb.transient(model, LOAD, **RUN).states.q
    np.testing.assert_allclose(unrecorded, whole.states.q, atol=1e-10 * np.abs(unrecorded).max())
    assert sorted(os.listdir(tmp_path)) == ["h.h5", "h.h5.state"]
    same(sb.transient(model, LOAD, file=path, resume=True, **RUN), whole)  # nothing left to do


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param(signal.SIGKILL, marks=pytest.mark.long), signal.SIGINT])
def test_killed_and_restarted(model, whole, small_chunks, tmp_path, kind):
    """kill -9 and Ctrl-C after some chunks: readable, not complete; restarted it is the uninterrupted
    history, bit by bit.
    """
    path = tmp_path / "h.h5"
    run = child(path, "wait")
    for _ in range(7):
        assert run.stdout.readline().startswith("done"), run.stderr.read()
    run.send_signal(kind)
    errors = run.communicate(timeout=300)[1]
    assert run.returncode != 0 and ("KeyboardInterrupt" in errors) == (kind == signal.SIGINT)
    with pytest.warns(IncompleteHistory, match="resume=True"):
        part = sb.read(path)
    n = len(part.time)
    assert not part.complete and 6 * 256 // 5 < n < 9 * 256 // 5
    np.testing.assert_allclose(
        part.displacement("A"),
        whole.displacement("A")[:n],
        atol=1e-10 * np.abs(whole.displacement("A")).max(),
    )
    same(sb.transient(model, LOAD, file=path, resume=True, **RUN), whole)
    assert sb.read(path).complete


@pytest.mark.parametrize("step", [1e-6, None])
def test_a_longer_run(model, whole, small_chunks, tmp_path, step):
    """A complete history of half of the time goes on to the whole, at its own step; a shorter one is not made
    of it.
    """
    path = tmp_path / "h.h5"
    half = sb.transient(model, LOAD, file=path, **{**RUN, "duration": 0.00512})
    assert sb.read(path).complete
    found = sb.transient(model, LOAD, file=path, resume=True, **{**RUN, "step": step})
    same(found, whole)
    same(sb.read(path), whole)
    assert (
        len(half.time) == 1025
        and sb.read(path).complete
        and {p.name for p in tmp_path.iterdir()} == {"h.h5", "h.h5.state"}
    )
    with pytest.raises(ValueError, match="run of 0.01024 s, longer than 0.00512 s"):
        sb.transient(model, LOAD, file=path, resume=True, **{**RUN, "duration": 0.00512})


def test_a_killed_run_made_longer(model, whole, small_chunks, tmp_path):
    """The shorter run's step, 0.005 s / 5000, is another number in its last digit, and stays."""
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.6), **{**RUN, "duration": 0.005})
    found = sb.transient(model, LOAD, file=path, resume=True, **RUN)
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
    half = sb.transient(model, LOAD, file=path, resume=True, **short)
    assert all(isinstance(values, np.memmap) for values in (half.states.q, half.states.contact, half.time))
    same_products(half.displacement("A"), whole.displacement("A")[:1025])
    found = sb.transient(model, LOAD, file=path, resume=True, in_memory=False, **RUN)
    same(found, whole)
    same_products(half.displacement("A"), whole.displacement("A")[:1025])  # of the file before
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
        ({"initial": "equilibrium"}, "initial"),
        ({"reduction": None}, "that of a reduced model, not of an unreduced one"),
    ):
        given = {"model": model, "load": LOAD, **RUN, **options}
        with pytest.raises(ValueError, match=words):
            sb.transient(file=path, resume=True, **given)
    assert path.read_bytes() == content and sorted(os.listdir(tmp_path)) == ["h.h5", "h.h5.state"]
    with pytest.raises(ValueError, match="resume = True needs the file"):
        sb.transient(model, LOAD, resume=True, **RUN)


def test_lost_files(tmp_path):
    """Missing, truncated, no HDF5, another kind: one sentence."""
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = 1.0
    (tmp_path / "text.h5").write_text("time, u\n")
    (tmp_path / "short.h5").write_bytes(other.read_bytes()[:900])
    for name, words in (
        ("missing.h5", "does not exist"),
        ("text.h5", "truncated, damaged or no HDF5"),
        ("short.h5", "truncated"),
        ("other.h5", "another kind"),
    ):
        with pytest.raises(ValueError, match=words):
            sb.read(tmp_path / name)


def test_a_state_that_is_gone(model, tmp_path):
    """A run that would begin anew over what stands in the journal says so, and leaves it as it is."""
    path, run = tmp_path / "h.h5", {"duration": 50e-6, "step": 1e-6, "modes": 16, "decimation": 1}
    history = sb.transient(model, LOAD, file=path, **run)
    content = path.read_bytes()
    os.remove(f"{path}.state")
    with pytest.raises(ValueError, match=r"the file beside it, '.*h\.h5\.state', is missing; put it back"):
        sb.transient(model, LOAD, file=path, resume=True, **run)
    assert path.read_bytes() == content and os.listdir(tmp_path) == ["h.h5"]
    same(sb.transient(model, LOAD, file=path, **run), history)


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


def full_disk(patch, name, room):
    """After so many bytes of a file the system has no place."""
    real, left = os.write, [room]

    def write(handle, data):
        if not os.readlink(f"/proc/self/fd/{handle}").endswith(name):
            return real(handle, data)
        if left[0] <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = real(handle, data[: left[0]])
        left[0] -= written
        return written

    patch.setattr(os, "write", write)


def test_full_disk(model, whole, small_chunks, tmp_path, monkeypatch):
    """What was written stays readable and can be continued."""
    path = tmp_path / "h.h5"
    with monkeypatch.context() as patch:
        full_disk(patch, "h.h5", 400_000)
        with pytest.raises(sb.SolveError, match="No space left.*stays readable"):
            sb.transient(model, LOAD, file=path, **RUN)
    with pytest.warns(IncompleteHistory):
        part = sb.read(path)
    assert len(part.time) > 256 // 5
    np.testing.assert_array_equal(part.states.q, whole.states.q[: len(part.time)])
    same(sb.transient(model, LOAD, file=path, resume=True, **RUN), whole)


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0 or shutil.which("mount") is None, reason="needs root"
)
def test_full_tmpfs(model, small_chunks, tmp_path, monkeypatch):
    folder = tmp_path / "small"
    folder.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=512k", "none", str(folder)], capture_output=True
    ).returncode:
        pytest.skip("mount is not allowed")
    try:
        with pytest.raises(ValueError, match="would take .* of disk"):
            sb.transient(model, LOAD, file=folder / "h.h5", **RUN)
        others = open(folder / "others", "wb", buffering=0)

        def fill(done):
            """Another program takes the rest of the disk."""
            with contextlib.suppress(OSError):
                while done > 0.1:
                    others.write(bytes(4096))

        with monkeypatch.context() as patch, others:
            patch.setattr(capacity.shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(0, 0, 10**9))
            with pytest.raises(sb.SolveError, match="No space left"):
                sb.transient(model, LOAD, file=folder / "h.h5", progress=fill, **RUN)
        with pytest.warns(IncompleteHistory):
            assert len(sb.read(folder / "h.h5").time) > 50
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.long
def test_two_ranks_continue_a_serial_run(model, whole, small_chunks, tmp_path):
    """The file's own reduction goes on, so the number of ranks does not matter."""
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.3), **RUN)
    done = on_ranks(2, PROGRAM, str(path), "go", "restart")
    np.testing.assert_allclose(answer(done)["u"], whole.displacement("A")[-1], rtol=1e-10)
    same(sb.read(path), whole)


def test_a_frame_and_a_state_half_written(model, whole, small_chunks, tmp_path):
    """A kill in the middle of either leaves the state before, from which the history goes on."""
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.3), **RUN)
    (tmp_path / ".h.h5.state.abcdefgh.part").mkdir()
    torn = journal.HEAD.pack(10**5, zlib.crc32(struct.pack("<Q", 10**5)), 0) + bytes(999)
    path.write_bytes(path.read_bytes() + torn)
    with pytest.warns(IncompleteHistory):
        assert len(sb.read(path).time) == 1 + 12 * 256 // 5
    same(sb.transient(model, LOAD, file=path, resume=True, **RUN), whole)
    assert sorted(os.listdir(tmp_path)) == ["h.h5", "h.h5.state"]


@pytest.mark.long
def test_error_of_rank_0_on_both_ranks(tmp_path):
    """Both ranks end, neither by the other's abort, and the sentence is printed once."""
    done = on_ranks(2, PROGRAM, str(tmp_path / "missing" / "h.h5"), "go", "new", check=False, timeout=300)
    sentences = [line for line in done.stderr.splitlines() if line.startswith("ValueError: history file")]
    assert done.returncode != 0 and len(sentences) == 1 and "cannot be written" in sentences[0]
    assert "all ranks are stopped" not in done.stderr


# ---------------------------------------------------------------------- conditions of a run
def test_the_continued_history_keeps_its_fields(model, whole, small_chunks, tmp_path):
    """A restart goes on with the file's modes, whose signs another solve may have turned round; the fields
    are those of the history all the same.
    """
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.3), **RUN)
    other = make()
    turned = sb.reduce(other, LOAD, modes=16)
    signs = np.where(np.arange(16) % 3, 1.0, -1.0)
    turned = replace(
        turned,
        gap=replace(turned.gap, modes=turned.gap.modes * signs),
        points=replace(turned.points, modes=turned.points.modes * signs),
        tips=replace(turned.tips, modes=turned.tips.modes * signs),
        load_modes=turned.load_modes * signs[:, None],
        translation=turned.translation * signs[:, None],
        modal=replace(
            turned.modal,
            shapes=turned.modal.shapes * signs,
            point_shapes={p: s * signs[:, None] for p, s in turned.modal.point_shapes.items()},
        ),
    )
    run = {name: value for name, value in RUN.items() if name != "modes"}
    found = sb.transient(turned, LOAD, file=path, resume=True, **run)
    same(found, whole)
    peak = float(whole.time[whole.contact_resultant.argmax()])
    np.testing.assert_allclose(
        found.field(peak), whole.field(peak), atol=1e-9 * np.abs(whole.field(peak)).max()
    )


def test_the_last_step_is_kept(model):
    """Whatever the decimation, the history ends at the end and its instants are equally far apart."""
    for decimation in (1, 7, 20):
        history = sb.transient(
            model, LOAD, 0.001, 1e-6, modes=16, decimation=decimation, contact=False, progress=None
        )
        assert history.time[-1] == pytest.approx(0.001, rel=1e-12) and history.step <= 1e-6
        np.testing.assert_allclose(np.diff(history.time), decimation * history.step, rtol=1e-9)


def test_long_histories_are_decimated_with_a_warning(model, monkeypatch):
    """A limit of 200 kB in place of 1 GB; an explicit decimation keeps what it says."""
    monkeypatch.setattr(capacity, "KEPT", 200_000)
    row = 8 * (1 + 16 + 16 + 1 + len(model.contact) + 5)
    with pytest.warns(sb.StepWarning, match="every [0-9]+ are kept"):
        history = sb.transient(model, LOAD, 0.002, 1e-6, modes=16, contact=False)
    assert 100_000 < len(history.time) * row <= 200_000 + row
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "reduce: around the tip .* edges of order")
        assert len(sb.transient(model, LOAD, 0.002, 1e-6, modes=16, contact=False, decimation=1).time) == 2001


def test_too_little_memory(model, monkeypatch):
    sb.transient(model, LOAD, 0.001, 1e-6, modes=16, decimation=1)  # the model has its modes
    monkeypatch.setattr(capacity, "available_memory", lambda: 1_000_000)
    with pytest.raises(ValueError, match="10,001 instants of .* of memory, 900 kB are free; keep every .*th"):
        sb.transient(model, LOAD, 0.01, 1e-6, modes=16, decimation=1)
    sb.transient(model, LOAD, 0.001, 1e-6, modes=16, decimation=1)


def test_too_small_a_disk(model, monkeypatch, tmp_path):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(capacity.shutil, "disk_usage", lambda folder: usage._replace(free=1_000_000))
    with pytest.raises(ValueError, match="would take .* of disk, 900 kB are free in .*decimation"):
        sb.transient(model, LOAD, 0.01, 1e-6, modes=16, file=tmp_path / "h.h5", in_memory=False)
    assert os.listdir(tmp_path) == []


def test_free_memory_is_the_systems():
    """Between nothing and all of it; a limit on the address space counts."""
    free = capacity.available_memory()
    assert 0 < free <= os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    program = (
        "import resource; from sbfem_petsc.ranks import capacity; "
        "used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize(); "
        "resource.setrlimit(resource.RLIMIT_AS, (used + 10**8, -1)); print(capacity.available_memory())"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    told = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    assert 0 < int(told.stdout) <= 10**8, told.stderr


# ---------------------------------------------------------------------- the file itself
def test_two_writers(model, small_chunks, tmp_path):
    """The second run is refused while the first one writes, and may when it has ended."""
    path, seen = tmp_path / "h.h5", []

    def second(done):
        if not seen:
            with pytest.raises(ValueError, match="is being written by another run"):
                sb.transient(model, LOAD, file=path, **RUN)
            with pytest.warns(IncompleteHistory):  # but it can be read
                seen.append(len(sb.read(path).time))

    sb.transient(model, LOAD, file=path, progress=second, **RUN)
    assert seen and sb.read(path).complete and sorted(os.listdir(tmp_path)) == ["h.h5", "h.h5.state"]
    sb.transient(model, LOAD, file=path, **{**RUN, "duration": 0.001})


@pytest.mark.long
@pytest.mark.parametrize("ending", ["", ".state"])
def test_changed_bytes_are_told(model, ending, tmp_path):
    """Any byte that is inverted is told of: every one of the state and 61st of the rows."""
    path, run = tmp_path / "h.h5", {"duration": 1e-4, "step": 1e-6, "modes": 6}
    sb.transient(model, LOAD, file=path, **run)
    changed = tmp_path / f"h.h5{ending}"
    told, without, silent = inverted(changed, lambda _: sb.read(path), every=1 if ending else 61)
    assert told > 500 and (without, silent) == (0, [])


@pytest.mark.parametrize("ending", ["", ".state"])
def test_a_changed_byte_cuts_nothing(model, monkeypatch, ending, tmp_path):
    """It is told of by reading and by a run that would go on, which leaves the file as it is."""
    monkeypatch.setattr(module, "CHUNK", 50)
    path, run = tmp_path / "h.h5", {"duration": 250e-6, "step": 1e-6, "modes": 16, "decimation": 1}
    history = sb.transient(model, LOAD, file=path, **run)
    changed = tmp_path / f"h.h5{ending}"
    data = bytearray(changed.read_bytes())
    data[len(data) // 2] ^= 0x10
    changed.write_bytes(data)
    for attempt in (lambda: sb.read(path), lambda: sb.transient(model, LOAD, file=path, resume=True, **run)):
        with pytest.raises(ValueError, match="damaged at byte .*: its checksum does not fit; run it"):
            attempt()
    assert changed.read_bytes() == data
    same(sb.transient(model, LOAD, file=path, **run), history)


@pytest.mark.parametrize("kind", ["device", "folder", "pipe", "link to a device", "no path"])
def test_nothing_but_files_is_replaced(model, tmp_path, kind):
    place = {
        "device": "/dev/null",
        "folder": tmp_path / "folder",
        "pipe": tmp_path / "pipe",
        "link to a device": tmp_path / "link",
        "no path": 3,
    }[kind]
    if kind == "folder":
        place.mkdir()
    elif kind == "pipe":
        os.mkfifo(place)
    elif kind == "link to a device":
        place.symlink_to("/dev/null")
    error, words = (TypeError, "must be a string") if kind == "no path" else (ValueError, "name another one")
    with pytest.raises(error, match=words):
        sb.transient(model, LOAD, file=place, **RUN)
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_a_link_stays_a_link(model, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "h.h5").symlink_to(tmp_path / "elsewhere" / "goal.h5")
    sb.transient(model, LOAD, 0.001, 1e-6, modes=16, file=tmp_path / "h.h5")
    assert (tmp_path / "h.h5").is_symlink() and sb.read(tmp_path / "elsewhere" / "goal.h5").complete
