"""Two ranks: whatever one of them is given, whether it takes part or not, no rank hangs and no result is a
mixture.
"""

import inspect
import json

import pytest

import sbfem_petsc as sb
from tests.fuzz import examples
from tests.parallel import ROOT, on_ranks

from . import two_ranks

# What rank 1 does instead of calling -> what is told.
INSTEAD = {
    "pass": "rank 1 has ended",
    "sys.exit(3)": "rank 1 of 2 has left by sys.exit(3)|rank 1 has ended",
    "raise RuntimeError('my own mistake')": "my own mistake",
    "sb.Material(-1.0, 0.3, 1.0)": "young = -1.0",
    "sb.modal(examples.model(), 1)": "RanksDiffer",
}
ANALYSES = {
    "Model": 0,
    "modal": 0,
    "static": 0,
    "load_history": 0,
    "transient": 1,
    "periodic": 1,
    "frequency_response": 1,
    "load_response": 1,
    "reduce": 0,
}
PROGRAM = """
import os, sys, tempfile, warnings
warnings.simplefilter("ignore")
import sbfem_petsc as sb
from mpi4py import MPI
from tests.fuzz import examples
os.chdir(tempfile.mkdtemp(dir=sys.argv[-1]))
owner, call, ready = sys.argv[1], int(sys.argv[2]), sys.argv[3] == "ready"
if ready:
    examples.model()
if MPI.COMM_WORLD.rank == 0:
    getattr(sb, owner)(**examples.CALLS[owner][call]())
else:
    INSTEAD
"""
ANOTHER = """
import json, os, sys, tempfile, warnings
warnings.simplefilter("ignore")
import sbfem_petsc as sb
from mpi4py import MPI
from tests.fuzz import examples
os.chdir(tempfile.mkdtemp(dir=sys.argv[-1]))
model = examples.model()
for owner, call in json.loads(sys.argv[1]).items():
    try:
        if owner == "Model":
            continue
        if MPI.COMM_WORLD.rank == 0:
            getattr(sb, owner)(**examples.CALLS[owner][call]())
        elif owner == "static":
            sb.modal(model, 1)
        else:
            sb.static(model, examples.PUSH)
    except ValueError as error:
        sys.stdout.write(f"{owner}: {type(error).__name__}: {error}\\n")
sys.stdout.write("fine\\n")
"""
# Each half has a model of its own, with other numbers, on one of two kinds of communicators in turn; the
# frequencies are those of one rank alone.
HALVES = """
import json, os, sys, tempfile, warnings
warnings.simplefilter("ignore")
import sbfem_petsc as sb
from mpi4py import MPI
from tests.fuzz import examples
world = MPI.COMM_WORLD
halves = world.Split(world.rank), MPI.COMM_SELF
os.chdir(tempfile.mkdtemp(dir=sys.argv[-1]))
steel = sb.Material(70e9, 0.33, 2700 * (1 + world.rank))
model = lambda half: sb.Model(examples.mesh(), steel, damping=0.02, comm=half)
for number, (owner, call) in enumerate(json.loads(sys.argv[1]).items()):
    one, other = halves[number % 2], halves[1 - number % 2]
    if owner != "Model":
        getattr(sb, owner)(**{**examples.CALLS[owner][call](), "model": model(one)})
    found = world.allgather(sb.modal(model(other), 1).frequencies[0])
    assert abs(found[0] / found[1] / 2**0.5 - 1.0) < 1e-9, (owner, found)
print("fine", flush=True)
"""


# Public functions that each rank calls for itself: they work on files, arrays or what rank 0 alone has.
FOR_ITSELF = {
    "rayleigh_factors", "on_root", "read_gmsh", "read_calculix", "read_matrices", "join",
    "read", "plot.save_picture", "plot.save_pictures",
}  # fmt: skip


def test_every_public_function_compares_its_arguments():
    """A new one fails here until it does, or stands among those that each rank calls for itself."""
    functions = {
        name
        for name, item in examples.public().items()
        if inspect.isfunction(item) and not name.startswith("indicators.")
    }
    assert functions - FOR_ITSELF == set(two_ranks.compared()) - {"Model"}
    assert two_ranks.compares(sb.Model)


def test_every_collective_method_compares_its_arguments():
    """Of results; those of models are called by analyses."""
    results = {name: make for name, make in examples.OBJECTS.items() if name not in ("Model", "ReducedModel")}
    for name, make in results.items():
        for method, call in inspect.getmembers(type(make()), inspect.isfunction):
            told = inspect.getdoc(call) or ""
            hidden = method.startswith("_") or method in examples.INTERNAL.get(name, ())
            if "Collective." in told and not hidden:
                assert two_ranks.compares(call), f"{name}.{method}"


@pytest.mark.long
def test_every_argument_on_one_rank(tmp_path):
    """Another and a wrong value of each: both ranks have the sentence that names it, and go on."""
    mixtures, hangs, first, told, functions = [], [], 0, 0, set()
    while True:
        done = on_ranks(
            2, ROOT / "tests/system/two_ranks.py", str(first), str(tmp_path), check=False, timeout=300
        )
        lines = [line for line in done.stdout.replace("\033[0m", "").splitlines() if line.startswith("{")]
        begun = ended = None
        for entry in map(json.loads, lines):
            if "functions" in entry:
                functions = set(entry["functions"])
            elif "begun" in entry:
                begun = entry
            else:
                ended, told = entry, told + 1
                said = entry["said"]
                if said[0] != said[1] or f"{begun['name']} differs between the ranks" not in said[0]:
                    mixtures.append((begun, said))
        if done.returncode == 0:
            break
        assert begun is not None and (ended is None or ended["ended"] < begun["begun"]), done.stderr
        hangs.append((begun, done.stderr[-2000:]))
        first = begun["begun"] + 1
    assert not hangs and not mixtures
    assert functions >= set(two_ranks.compared()) and told > 500


# A call of each kind waits for one that is not made; what else a rank may do is shown with one of them.
LEFT_ALONE = [(owner, "pass") for owner in ("Model", "static", "transient", "frequency_response")]
LEFT_ALONE += [("static", instead) for instead in INSTEAD if instead != "pass"]


@pytest.mark.long
@pytest.mark.parametrize(("owner", "instead"), LEFT_ALONE)
def test_rank_that_does_not_call(owner, instead, tmp_path):
    """Both end with a sentence, from the first call of the package on and later."""
    program = PROGRAM.replace("INSTEAD", instead)
    ready = "new" if owner == "Model" else "ready"
    done = on_ranks(2, program, owner, str(ANALYSES[owner]), ready, str(tmp_path), check=False, timeout=300)
    assert done.returncode != 0, done.stdout + done.stderr
    said = INSTEAD.get(instead, "RanksDiffer").split("|")
    assert any(words in done.stderr for words in said), done.stderr


@pytest.mark.long
def test_rank_that_calls_another(tmp_path):
    """Both have the sentence, from each call, and go on."""
    done = on_ranks(2, ANOTHER, json.dumps(ANALYSES), str(tmp_path))
    told = [line for line in done.stdout.splitlines() if "RanksDiffer" in line]
    assert len(told) == 2 * (len(ANALYSES) - 1) and done.stdout.count("fine") == 2, done.stdout


@pytest.mark.long
def test_communicators_of_their_own(tmp_path):
    done = on_ranks(2, HALVES, json.dumps(ANALYSES), str(tmp_path), timeout=300)
    assert done.stdout.count("fine") == 2
