"""Lines of every family in files: killed and resumed to the same points; refused for other runs."""

import functools
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

import sbfem_petsc as sb
from tests.continuation.families import FAMILIES, curve, locus, unreduced, values
from tests.parallel import ROOT, answer, on_ranks
from tests.results.same import inverted
from tests.systems import beside_another

# Each in a process of its own, forked from one that has imported and solved what all of them begin with.
KILLED = """
import os, sys
from tests.continuation.families import body, curve, killed, motion
for case in sys.argv[2:]:
    {"locus": curve, "tori": motion, "unreduced": body}.get(case.split("-")[0], int)()
for case in sys.argv[2:]:
    kind, after = case.split("-")
    child = os.fork()
    if not child:
        killed(kind, os.path.join(sys.argv[1], f"{case}.h5"), int(after))
        os._exit(0)
    print(case, os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
CASES = [("backbone", 7)]
LONG_CASES = [("response", 6), ("locus", 3), ("damping", 6), ("unreduced", 3), ("leaps", 9), ("tori", 5)]


@functools.cache
def uninterrupted(kind):
    """What a family finds, why it ends, and how often it is told of."""
    told: list[float] = []
    found, reasons = FAMILIES[kind](progress=told.append)
    return found, reasons, len(told)


@pytest.fixture(scope="module")
def left(tmp_path_factory, request):
    """The files that killed runs leave, of the kinds that are asked for."""
    folder = tmp_path_factory.mktemp("left")
    same = (item for item in request.session.items if item.path == request.path)
    asked = [item.callspec.params for item in same if "left" in item.fixturenames]
    cases = [f"{given['kind']}-{given.get('after') or uninterrupted(given['kind'])[2]}" for given in asked]
    run = [sys.executable, "-c", KILLED, str(folder), *cases]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.splitlines() == [f"{case} {-signal.SIGKILL}" for case in cases], done.stderr
    return folder


@pytest.mark.filterwarnings(
    "ignore::meshing.warnings.BranchWarning", "ignore::meshing.warnings.IncompleteBranch"
)
@pytest.mark.parametrize(
    ("kind", "after"), CASES + [pytest.param(*case, marks=pytest.mark.long) for case in LONG_CASES]
)
def test_killed_and_resumed(kind, after, left):
    """SIGKILL on either side of the first point, or of a change of samples: what the file holds is read, and
    gone on with to the same points, bit by bit.
    """
    path = str(left / f"{kind}-{after}.h5")
    expected, reasons, _ = uninterrupted(kind)
    assert 0 < len(values(path)) < len(expected)
    found, told = FAMILIES[kind](file=path, resume=True)
    np.testing.assert_array_equal(found, expected)
    assert told == reasons
    np.testing.assert_array_equal(values(path), found[:, -1])
    again, told = FAMILIES[kind](file=path, resume=True)
    np.testing.assert_array_equal(again, expected)
    assert told == reasons


RANKS = """
import json, sys
from sbfem_petsc.petsc import MPI
from tests.continuation.families import killed, unreduced
if len(sys.argv) > 2:
    killed("unreduced", sys.argv[1], 1, points=3)
files = ({}, {"file": sys.argv[1], "resume": True}, {"file": f"{sys.argv[1]}.moved", "resume": True})
tables = [unreduced(3 + ("moved" in str(file)), **file)[0].tolist() for file in files]
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({"tables": tables}))
"""


@pytest.mark.long
def test_killed_and_resumed_on_two_ranks(tmp_path):
    """The unreduced model's curve, whose states are distributed; what two have left goes on on one, and with
    that on two again, to 1e-6.
    """
    path = str(tmp_path / "line.h5")
    assert on_ranks(2, RANKS, path, "killed", check=False, timeout=900).returncode != 0
    for ending in ("", ".state"):
        shutil.copy(f"{path}{ending}", f"{path}.moved{ending}")
    assert 0 < len(values(path)) < 3
    whole = unreduced(4)[0]
    np.testing.assert_allclose(unreduced(3, file=f"{path}.moved", resume=True)[0], whole[:3], rtol=1e-6)
    resumed = answer(on_ranks(2, RANKS, path, timeout=900))["tables"]
    np.testing.assert_allclose(resumed[1], resumed[0], rtol=1e-12)
    np.testing.assert_allclose(resumed[2], whole, rtol=1e-6)


SHARED = """
import json, sys
from mpi4py import MPI
from sbfem_petsc.reduction.reduced_model import ReducedModel
ReducedModel.comm = property(lambda self: MPI.COMM_WORLD)
"""
RESUMED = """
from tests.continuation.families import FAMILIES, killed
if sys.argv[3:]:
    killed(sys.argv[1], sys.argv[2], 4)
one, _ = FAMILIES[sys.argv[1]](file=sys.argv[2], resume=True)
other, _ = FAMILIES[sys.argv[1]]()
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({"one": one.tolist(), "other": other.tolist()}))
"""


@pytest.mark.long
@pytest.mark.parametrize("kind", ["tori", "locus"])
def test_killed_and_resumed_by_two_ranks(kind, tmp_path):
    """Tori, whose samples the ranks share, and lines that both follow: to the same points, 1e-12 of each
    number.
    """
    path = str(tmp_path / "line.h5")
    assert on_ranks(2, SHARED + RESUMED, kind, path, "killed", check=False).returncode
    begun = values(path)
    found = answer(on_ranks(2, SHARED + RESUMED, kind, path))
    assert 0 < len(begun) < len(found["one"]) == len(found["other"])
    np.testing.assert_allclose(found["one"], found["other"], rtol=1e-12)


def test_another_run_is_refused(tmp_path):
    path = str(tmp_path / "line.h5")
    locus(file=path)
    point = next(item for item in curve().bifurcations if item.kind == "Neimark-Sacker")
    with pytest.raises(ValueError, match="was written with stop = 1.1, not 1.2; resume with the same value"):
        sb.locus(curve(), point, 0.9, 1.2, file=path, resume=True)
    with pytest.raises(ValueError, match="was written with largest_step = none, not 0.01"):
        sb.locus(curve(), point, 0.9, 1.1, largest_step=0.01, file=path, resume=True)
    with pytest.raises(ValueError, match="was written with parameter = load, not damping"):
        sb.locus(curve(), point, 0.9, 1.1, parameter="damping", file=path, resume=True)
    sb.save(path, sb.read(path))
    with pytest.raises(ValueError, match="is no file of a run; name another file"):
        sb.locus(curve(), point, 0.9, 1.1, file=path, resume=True)
    with pytest.raises(ValueError, match="locus: resume = True needs the file"):
        sb.locus(curve(), point, 0.9, 1.1, resume=True)


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize("ending", ["", ".state"])
@pytest.mark.parametrize("words", [b"pw: 1", b"my own notes of a year"])
def test_files_of_the_users_stay(words, ending, resume, tmp_path):
    """Whatever is no file of a run is refused in the place of one, and of what stands beside it."""
    path = tmp_path / "notes"
    mine = tmp_path / f"notes{ending}"
    mine.write_bytes(words)
    with pytest.raises(ValueError, match="is no file of a run; name another file"):
        locus(file=str(path), resume=resume)
    assert mine.read_bytes() == words and os.listdir(tmp_path) == [mine.name]


def test_the_state_that_is_missing_is_named(tmp_path):
    """A journal that was copied without the file beside it."""
    path = tmp_path / "line.journal"
    locus(file=str(path))
    os.remove(f"{path}.state")
    with pytest.raises(ValueError, match=r"line\.journal\.state', in which it stands, is missing"):
        sb.read(path)


@pytest.mark.parametrize("ending", ["", ".state"])
def test_changed_bytes_are_told(ending, tmp_path):
    """Some bytes of a line's journal, of its points and of the result made of them."""
    path = str(tmp_path / "line.journal")
    locus(file=path)
    told, without, silent = inverted(f"{path}{ending}", lambda _: sb.read(path), every=43)
    assert silent == [] and without == 0 and told > 50


def test_more_points_go_on(tmp_path):
    """A line that was given few points is resumed with more of them."""
    path = str(tmp_path / "line.h5")
    point = next(item for item in curve().bifurcations if item.kind == "Neimark-Sacker")
    few = sb.locus(curve(), point, 0.9, 1.1, points=2, file=path)
    assert few.reasons == ("2 points", "2 points") and len(few) == 1 + 2 * 2
    more = sb.locus(curve(), point, 0.9, 1.1, points=6, file=path, resume=True)
    np.testing.assert_array_equal(more.states, locus()[0][:, :-2])


def test_largest_step_of_a_locus():
    point = next(item for item in curve().bifurcations if item.kind == "Neimark-Sacker")
    told: list[float] = []
    line = sb.locus(curve(), point, 0.97, 1.03, largest_step=0.004, progress=told.append)
    assert np.abs(line.value - 1.0).min() < 1e-12  # it begins at the curve's own loads
    assert told == sorted(told) and told[-1] == 1.0
    assert np.abs(np.diff(line.value)).max() < 0.0041 and len(line) >= 15


@pytest.mark.parametrize(
    "kind", ["response", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("backbone", "damping"))]
)
def test_a_line_that_had_come_to_its_end(kind, left):
    """Killed at the last point of the range: what is left is what lies between the points."""
    expected, reasons, last = uninterrupted(kind)
    path = str(left / f"{kind}-{last}.h5")
    assert kind != "response" or len(values(path)) < len(expected)
    found, again = FAMILIES[kind](file=path, resume=True)
    np.testing.assert_array_equal(found, expected)
    assert again == reasons


def test_another_backbone_is_refused(tmp_path):
    path = str(tmp_path / "line.h5")
    FAMILIES["leaps"](file=path)
    with pytest.raises(ValueError, match="was written for another model"):
        FAMILIES["backbone"](file=path, resume=True)
    with pytest.raises(
        ValueError, match="was written with stop = 20.0, not 21.0; resume with the same value"
    ):
        sb.backbone(beside_another(0.01, 3.5), 1, 0.4, 21.0, steps=256, refine=False, file=path, resume=True)


ON_RANKS = """
import os, sys
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.motion.files import run_file
from tests.numbers import bodies
run_file.PAUSE, told = 0.0, []

def tell(done):
    told.append(done)
    if sys.argv[3:] and len(told) == 5:
        os._exit(9)

def points(**file):
    asked = {"modes": 4, "steps": 128, "refine": False, "stability": False}
    found = sb.backbone(bodies.beam(), 1, 1e-3, 3e-2, progress=tell, **asked, **file)
    return np.column_stack([found.states, found.frequency, found.energy])

resumed = points(file=sys.argv[1], resume=True)
whole = points()
if MPI.COMM_WORLD.rank == 0:
    np.save(sys.argv[2], [resumed, whole])
"""


@pytest.mark.long
def test_a_backbone_on_two_ranks(tmp_path):
    """The same points to 1e-12 of their size: the model is another run's, reduced again."""
    path, found = str(tmp_path / "line.h5"), str(tmp_path / "found.npy")
    assert on_ranks(2, ON_RANKS, path, found, "killed", check=False).returncode
    begun = len(sb.read(path))
    on_ranks(2, ON_RANKS, path, found)
    found, expected = np.load(found)
    assert 0 < begun < len(found)
    sizes = np.abs(expected[:, :-2]).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found[:, :-2] / sizes, expected[:, :-2] / sizes, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found[:, -2:], expected[:, -2:], rtol=1e-12)
