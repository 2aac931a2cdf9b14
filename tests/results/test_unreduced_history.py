"""Files of the unreduced model's histories: restarts after kills on one and several ranks, longer runs, other
runs' files.
"""

import contextlib
import dataclasses
import pathlib
import shutil
import signal
import sys

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam
from meshing.warnings import IncompleteHistory
from sbfem_petsc.motion.unreduced import history as module
from sbfem_petsc.motion.unreduced import ranks
from sbfem_petsc.system.solve.pencil import Pencil
from tests.parallel import answer, in_session, interruptible, on_ranks
from tests.results.test_history import full_disk

PROGRAM = """
import json, os, signal, sys
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.motion.unreduced import history as module
from tests.results.test_unreduced_history import make, LOAD, RUN
from tests.parallel import wait_for_a_signal
module.CHUNK = 32
path, wait, restart, kill = sys.argv[1], sys.argv[2] == "wait", sys.argv[3] == "restart", len(sys.argv) > 4
def tell(done):
    if MPI.COMM_WORLD.rank == 0:
        print(f"done {done}", flush=True)
        if kill and done > 0.4:
            os.kill(os.getpid(), signal.SIGKILL)
    if wait and done > 0.29:
        wait_for_a_signal()
found = sb.transient(make(), LOAD, progress=tell, file=path, resume=restart, **RUN)
if MPI.COMM_WORLD.rank == 0:
    force = found.contact_resultant.tolist()
    print(json.dumps({"u": found.displacement("A").tolist(), "force": force, "complete": True}))
"""
LOAD = sb.PointForce("A", fy=sb.ToneBurst(3000.0, 3000, 3))
RUN = {"duration": 0.00064, "step": 2e-6, "modes": 12, "decimation": 5, "reduction": None}
COUNT = 320


def make(damping=0.01):
    from meshing import Beam, VNotch

    beam = Beam(length=0.05, height=0.005, notches=[VNotch(x=0.02, depth=0.0025, opening=0.0458366)])
    return sb.Model(
        beam.mesh(order=3, tip_size=2e-4), sb.Material(70e9, 0.33, 2700), damping=damping, rayleigh=(5.0, 0.0)
    )


@pytest.fixture(scope="module")
def model():
    return make()


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr(module, "CHUNK", 32)


@pytest.fixture(scope="module")
def whole(model):
    """The uninterrupted history, not recorded."""
    previous, module.CHUNK = module.CHUNK, 32
    try:
        return sb.transient(model, LOAD, **RUN)
    finally:
        module.CHUNK = previous


def close(found, whole, rows=None, slopes=1e-10):
    """Within 1e-10 of the uninterrupted history, accelerations within `slopes`."""
    rows = len(whole.time) if rows is None else rows
    for values, exact in (
        (found.time, whole.time),
        (found.contact_force, whole.contact_force),
        (found.gap, whole.gap),
        (found.energy.damping, whole.energy.damping),
        (found.energy.kinetic, whole.energy.kinetic),
        (found.stress_intensity(), whole.stress_intensity()),
        (found.displacement("A"), whole.displacement("A")),
        (found.velocity("A"), whole.velocity("A")),
    ):
        assert len(values) == rows
        np.testing.assert_allclose(values, exact[:rows], rtol=0, atol=1e-10 * np.abs(exact).max())
    slope, exact = found.acceleration("A"), whole.acceleration("A")[:rows]
    np.testing.assert_allclose(slope, exact, rtol=0, atol=slopes * np.abs(whole.acceleration("A")).max())


def stopped(fraction):
    def tell(done):
        if done >= fraction:
            raise KeyboardInterrupt

    return tell


@pytest.mark.long
def test_recorded_history_is_the_same(model, whole, tmp_path):
    path = tmp_path / "h.h5"
    close(sb.transient(model, LOAD, file=path, **RUN), whole)
    found = sb.read(path)
    assert found.complete and found.reduced is None and whole.contact_resultant.max() > 100
    close(found, whole)
    assert found.damped_modes == 12 and found.points == whole.points
    close(sb.transient(model, LOAD, file=path, resume=True, **RUN), whole)  # nothing left to do


@pytest.mark.long
@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGINT])
def test_killed_and_restarted(model, whole, tmp_path, kind):
    path = tmp_path / "h.h5"
    run = in_session([sys.executable, "-c", PROGRAM, str(path), "wait", "new"], preexec_fn=interruptible)
    for _ in range(3):
        assert run.stdout.readline().startswith("done"), run.stderr.read()
    run.send_signal(kind)
    run.communicate(timeout=300)
    assert run.returncode != 0
    with pytest.warns(IncompleteHistory, match="resume=True"):
        part = sb.read(path)
    assert not part.complete and 3 * 32 // 5 < len(part.time) < COUNT // 5
    close(part, whole, len(part.time))
    close(sb.transient(model, LOAD, file=path, resume=True, **RUN), whole)
    assert sb.read(path).complete


def near(found, whole):
    """What other ranks have gone on with: to 1e-6 of the whole history."""
    for values, exact in (
        (found.displacement("A"), whole.displacement("A")),
        (found.velocity("A"), whole.velocity("A")),
        (found.contact_resultant, whole.contact_resultant),
        (found.stress_intensity(), whole.stress_intensity()),
    ):
        np.testing.assert_allclose(values, exact, rtol=0, atol=1e-6 * np.abs(exact).max())


def test_goes_on_in_another_basis(whole, tmp_path):
    """Other BLAS kernels, as of another processor, find vectors of the auxiliary unknowns of other signs."""
    path, other = tmp_path / "h.h5", make()
    with pytest.raises(KeyboardInterrupt):
        sb.transient(make(), LOAD, file=path, progress=stopped(0.5), **RUN)
    for group in other.cells.moving:
        fraction = group.solution._fraction
        signs = np.where(np.arange(len(fraction.inertia)) % 3, 1.0, -1.0)
        group.solution.__dict__["_fraction"] = dataclasses.replace(
            fraction, coupling=fraction.coupling * signs
        )
    near(sb.transient(other, LOAD, file=path, resume=True, **RUN), whole)


@pytest.mark.long
def test_two_ranks_killed_and_restarted(model, whole, tmp_path):
    """Each rank continues from its own part; one continues what two have left, and two what one has."""
    path = tmp_path / "h.h5"
    assert on_ranks(2, PROGRAM, str(path), "go", "new", "kill", check=False, timeout=300).returncode != 0
    with pytest.warns(IncompleteHistory):
        part = sb.read(path)
    assert 0.4 * COUNT // 5 < len(part.time) < COUNT // 5
    for ending in ("", ".state"):
        shutil.copy(f"{path}{ending}", tmp_path / f"moved.h5{ending}")
    other = tmp_path / "moved.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=other, resume=True, progress=stopped(0.7), **RUN)
    on_ranks(2, PROGRAM, str(other), "go", "restart")
    near(sb.read(other), whole)
    continued, straight = (
        answer(on_ranks(2, PROGRAM, str(where), "go", mode))
        for where, mode in ((path, "restart"), (tmp_path / "other.h5", "new"))
    )
    for name in ("u", "force"):
        np.testing.assert_allclose(
            continued[name], straight[name], rtol=0, atol=1e-10 * np.abs(straight[name]).max()
        )
    # MUMPS on two ranks does not add in the same order every time: two uninterrupted runs differ by 1e-11,
    # their accelerations by 1e-10
    close(sb.read(path), sb.read(tmp_path / "other.h5"), slopes=1e-8)
    np.testing.assert_allclose(
        continued["u"], whole.displacement("A"), rtol=0, atol=1e-6 * np.abs(whole.displacement("A")).max()
    )


@pytest.mark.slow
@pytest.mark.parametrize("step", [2e-6, None])
def test_a_longer_run(model, whole, tmp_path, step):
    """A complete history of half of the time goes on to the whole; a shorter one is not made of it."""
    path = tmp_path / "h.h5"
    sb.transient(model, LOAD, file=path, **{**RUN, "duration": 0.00032})
    assert sb.read(path).complete
    close(sb.transient(model, LOAD, file=path, resume=True, **{**RUN, "step": step}), whole)
    close(sb.read(path), whole)
    assert sb.read(path).complete and {p.name for p in tmp_path.iterdir()} == {"h.h5", "h.h5.state"}
    with pytest.raises(ValueError, match="longer than 0.00032 s"):
        sb.transient(model, LOAD, file=path, resume=True, **{**RUN, "duration": 0.00032})


@pytest.mark.slow
def test_rows_left_in_the_file(model, whole, tmp_path):
    path, short = tmp_path / "h.h5", {**RUN, "duration": 0.00032, "in_memory": False}
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.4), **short)
    half = sb.transient(model, LOAD, file=path, resume=True, **short)
    assert isinstance(half.contact_force, np.memmap)
    close(half, whole, 33)
    close(sb.transient(model, LOAD, file=path, resume=True, in_memory=False, **RUN), whole)


@pytest.mark.slow
def test_another_runs_file_is_refused(model, tmp_path):
    path = tmp_path / "h.h5"
    with pytest.raises(KeyboardInterrupt):
        sb.transient(model, LOAD, file=path, progress=stopped(0.3), **RUN)
    content = path.read_bytes()
    for options, words in (
        ({"model": make(0.02)}, "damping"),
        ({"step": 1e-6}, "step"),
        ({"decimation": 2}, "decimation"),
        ({"load": sb.PointForce("A", fy=sb.ToneBurst(2000.0, 3000, 3))}, "other load signals"),
        ({"initial": (None, lambda x, y: (0.0, x))}, "initial"),
        ({"load": sb.PointForce("A", fx=sb.ToneBurst(3000.0, 3000, 3))}, "another model"),
        ({"reduction": "modes"}, "that of an unreduced model, not of a reduced one"),
        ({"initial": "equilibrium"}, "initial"),
        ({"load": [LOAD, sb.EdgeMotion("left", uy=sb.Harmonic(1e-6, 500.0))]}, "model or other loads"),
    ):
        with pytest.raises(ValueError, match=words):
            sb.transient(**{"model": model, "load": LOAD, "file": path, "resume": True, **RUN, **options})
    assert path.read_bytes() == content


@pytest.mark.parametrize("reduction", ["modes", None])
def test_another_motion_of_a_support_is_told_as_another_load(reduction, tmp_path):
    """Its velocity at the beginning makes another initial state too."""
    model = sb.Model(Beam(0.1, 0.01).mesh(order=2), sb.Material(70e9, 0.33, 2700))
    for amplitude, resume in ((1e-6, False), (2e-6, True)):
        load = sb.EdgeMotion("left", uy=sb.Harmonic(amplitude, 500.0))
        told = pytest.raises(ValueError, match="other load signals") if resume else contextlib.nullcontext()
        with told:
            run = {"reduction": reduction, "file": tmp_path / "h.h5", "resume": resume}
            sb.transient(model, load, 1e-4, 1e-5, **run)


@pytest.mark.slow
def test_another_continued_fraction_is_refused(tmp_path):
    """Of a body that answers alike within a step, with states of another size."""
    load, path = sb.PointForce("A", fy=sb.Harmonic(1.0, 500.0)), tmp_path / "h.h5"
    mesh, content = Beam(0.1, 0.01).mesh(order=3), b""
    for terms in (2, 3, 1):
        other = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), continued_fraction=terms)
        if not content:
            sb.transient(other, load, 2e-3, 1e-4, reduction=None, file=path)
            content = path.read_bytes()
            continue
        with pytest.raises(ValueError, match=f"continued_fraction = 2, not {terms}"):
            sb.transient(other, load, 2e-3, 1e-4, reduction=None, file=path, resume=True)
        assert path.read_bytes() == content


@pytest.mark.slow
def test_full_disk(model, whole, tmp_path, monkeypatch):
    path = tmp_path / "h.h5"
    with monkeypatch.context() as patch:
        full_disk(patch, "h.h5", 215_000)
        with pytest.raises(sb.SolveError, match="No space left.*stays readable"):
            sb.transient(model, LOAD, file=path, **RUN)
    with pytest.warns(IncompleteHistory):
        part = sb.read(path)
    close(part, whole, len(part.time))
    close(sb.transient(model, LOAD, file=path, resume=True, **RUN), whole)
    with pytest.raises(ValueError, match="cannot be written"):
        sb.transient(model, LOAD, file=pathlib.Path(tmp_path) / "missing" / "h.h5", **RUN)


@pytest.mark.parametrize("terms", [1, 2])
def test_states_of_another_basis(terms):
    """Auxiliary unknowns of other signs, in other frames, with the nodes in another order, and unknowns in
    another order are found again.
    """
    mesh = Beam(length=0.05, height=0.005).mesh(order=2)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), continued_fraction=terms)
    pencil, random = Pencil(model.statics, 1.0, 0.0), np.random.default_rng(1)
    try:
        here, count = ranks.layout_of(pencil), pencil.owned
        state = random.normal(size=(count + len(pencil.auxiliary_inertia()), 2))
        there, given = dict(here), state.copy()
        mixed = random.permutation(count)
        there["labels"], given[:count] = here["labels"][mixed], state[:count][mixed]
        turns, signs = {}, {}
        for name in [name for name in here if name.endswith("/coupling")]:
            c, s = np.cos(0.3 + len(turns)), np.sin(0.3 + len(turns))
            turns[name], coupling = np.array([[c, -s], [s, c]]), here[name]
            signs[name] = np.sign(random.normal(size=coupling.shape[1]))
            moved = turns[name] @ np.roll(coupling.reshape(len(coupling) // 2, 2, -1), 1, axis=0)
            there[name] = signs[name] * moved.reshape(coupling.shape)
        for k in range(sum(name.endswith("/nodes") for name in here)):
            shape = f"{int(here[f'{k}/like'][0])}/coupling"
            there[f"{k}/nodes"] = np.roll(here[f"{k}/nodes"], 1, axis=1)
            there[f"{k}/rotations"] = turns[shape] @ here[f"{k}/rotations"]
            numbers = count + here[f"{k}/numbers"]
            given[numbers] = signs[shape][:, None] * state[numbers]
        found = ranks.moved(pencil, [there], [given])
        np.testing.assert_array_equal(found[:count], state[:count])
        np.testing.assert_allclose(found, state, rtol=0, atol=1e-7)
    finally:
        pencil.destroy()
        model.destroy()
