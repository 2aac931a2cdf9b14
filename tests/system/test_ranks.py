"""Programs on two ranks that go wrong on one of them, or differently: all ranks end, with a sentence, or all
is right.

No program may hang, and none may compute with arguments that differ between its ranks.
"""

import json
import os
import signal
import subprocess
import sys

import pytest

from tests.parallel import ROOT, answer, on_ranks

BEGIN = """
import sys
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from meshing import Beam, VNotch
world = MPI.COMM_WORLD
rank = world.rank
def structure(comm=None, density=2700.0, **more):
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.05)]).mesh(order=1)
    return sb.Model(mesh, sb.Material(70e9, 0.33, density), comm=comm, **more)
push = sb.PointForce("A", fy=1.0)
one_fails = lambda t: 1.0 / 0.0 if world.rank == 1 and np.max(t) > 2e-4 else np.sin(t)
"""

# Program -> what its error must say. Each fails, on one rank or on all.
FAILING = {
    # before anything of PETSc is used
    "sb.Material(-1.0 if rank else 1.0, 0.3, 1.0); world.barrier()": "young = -1.0",
    "sb.Beam if rank else world.barrier()": "has no attribute 'Beam'",
    "raise RuntimeError('my own mistake') if rank else world.barrier()": "",
    "1 / 0 if rank else structure()": "division by zero",
    # leaving
    "sys.exit('enough') if rank else structure()": "enough",
    "sys.exit() if rank else structure()": "rank 1 has ended",
    "model = structure(); sb.modal(model, 2) if rank == 0 else None": "rank 1 has ended",
    "model = structure(); sb.static(model, push).stress((0.02, 0.005)) if rank else None": "rank 0 has ended",
    "u = sb.static(structure(), push); rank or u.displacement((0.02, 0.005))": "rank 1 has ended",
    "found = sb.static(structure(), push); found.stress((0.02, 0.005 + rank / 1e3))": "place differs",
    # errors on one rank inside what all of them do
    "structure(damping=2.0 if rank else 0.0)": "0.0 on rank 0, 2.0 on rank 1",
    "structure(comm='world' if rank else None)": "comm = 'world'",
    "sb.on_root(world, lambda: 1 / 0)": "division by zero",
    "found = sb.static(structure(), push); sb.on_root(world, lambda: sb.save('never.h5', found))": (
        "call it on all"
    ),
    "turned = world.Create_group(world.group.Incl([1, 0]))\n"
    "sb.save('never.h5', [sb.static(structure(comm), push) for comm in (world, turned)])": "or of other ones",
    "model = structure(); sb.on_root(world, lambda: sb.modal(model, 1))": "inside on_root",
    "sb.transient(structure(), sb.PointForce('A', fy=sb.Custom(one_fails)), 1e-3, 1e-4, modes=4)": "Custom",
    "sb.transient(structure(), sb.PointForce('A', fy=sb.Custom(one_fails)), 1e-3, 1e-4, reduction=None)": (
        "Custom"
    ),
    "sb.transient(structure(), push, 1e-3, 1e-4, reduction=None, progress=one_fails)": "division by zero",
    "sb.transient(structure(), push, 1e-3, 1e-4, modes=4, initial=(lambda x, y: one_fails(x), None))": (
        "initial"
    ),
    "model = structure(); sb.static(model, push)\nwith model: 1 / 0 if rank else world.barrier()": (
        "division by zero"
    ),
    "model = structure(); sb.static(model, push); sb.static(model, 5 if rank else push)": "5 on rank 1",
    "sb.static('?' if rank else structure(), push) if rank else structure()": "model = '?'",
    # communicators of their own
    "structure(MPI.COMM_SELF, damping=2.0 if rank else 0.0)\nworld.barrier()": "damping = 2.0",
    "half = world.Split(rank)\nsb.static(structure(half), sb.PointForce('Z' if rank else "
    "'A'))\nworld.barrier()": "'Z'",
}

# Calls with arguments that differ between the ranks -> what both ranks are told.
DIFFERENT = {
    "structure(density=7800.0 if rank else 2700.0)": "material differs between the ranks",
    "structure(damping=0.02 if rank else 0.01)": "damping differs between the ranks",
    "structure(clamped='right' if rank else 'left')": "clamped differs between the ranks",
    "structure(tip_modes=3 + rank)": "tip_modes differs between the ranks",
    "sb.Model(Beam(0.1, 0.01 + 1e-3 * rank).mesh(order=1), sb.Material(70e9, 0.3, 1.0))": (
        "mesh differs between the ranks"
    ),
    "sb.Model(Beam(0.1, 0.01).mesh(order=1 + rank), sb.Material(70e9, 0.3, 1.0))": (
        "mesh differs between the ranks"
    ),
    "sb.modal(structure(), 2 + rank)": "count differs between the ranks",
    "sb.modal(structure(), **({'band': (0.0, 1e4)} if rank else {'count': 2}))": "differs between the ranks",
    "sb.static(structure(), sb.PointForce('A', fy=1.0 + rank))": "load differs between the ranks",
    "sb.static(structure(), push, contact=rank == 0)": "contact differs between the ranks",
    "sb.reduce(structure(), push, modes=4 + rank)": "modes differs between the ranks",
    "sb.transient(structure(), push, 1e-3 * (1 + rank), 1e-4, modes=4)": "duration differs between the ranks",
    "sb.transient(structure(), push, 1e-3, 1e-4, modes=4, file='h.h5' if rank else None)": "file differs",
    "sb.periodic(structure(damping=0.02), push, 300.0 + rank, modes=4, steps=64)": "frequency differs",
    "sb.periodic(structure(damping=0.02), push, 300.0, modes=4, steps=64 + rank)": "steps differs",
    "sb.periodic(model, push, 300.0 + 10.0 * rank, reduction=None, steps=64)": "frequency differs",
    "sb.periodic(model, sb.PointForce('A', fy=10.0 + rank), 300.0, reduction=None, steps=64)": "load differs",
    "sb.periodic(model, push, 300.0, reduction=None, steps=64 + rank)": "steps differs",
    "sb.periodic(model, push, 300.0, reduction=None, steps=64, contact=rank == 0)": "contact differs",
    "sb.transient(model, sb.PointForce('A', fy=sb.Custom(waves[rank])), 1e-3, 1e-4, modes=4)": "load differs",
    "sb.transient(model, push, 1e-3, 1e-4, modes=4, initial=(waves[rank], None))": "initial differs",
    "sb.static(others[rank], push)": "model differs",
    "sb.estimate(lambda mesh, **o: model, size, accuracy=1e-2 * (1 + rank))": "accuracy differs",
    "sb.estimate(lambda mesh, **o: model, sizes[rank])": "quantity differs",
    "sb.static(model, sb.PointForce('A', fy=1.0 + rank)).stress((0.02, 0.005))": "load differs",
    "pushes[rank].stress((0.02, 0.005))": "self differs",
    "pushes[rank].displacement((0.02, 0.005))": "self differs",
    "pushes[0].displacement((0.02, 0.005 + rank / 1e3))": "place differs",
    "sb.frequency_response(structure(), push, 300.0, 310.0 + rank, modes=4)": "stop differs",
    "sb.modal(model, 2) if rank else sb.static(model, push)": "call the same on all ranks",
}

# Programs that are right, one after another, and one of which a rank has its end before the other begins.
RIGHT = [
    "model = structure(damping=0.01 * (1.0 + 1e-14 * rank)); print('fine')",
    "sb.static(structure(MPI.COMM_SELF, density=2700.0 + rank), push); world.barrier(); print('fine')",
    # a place that one rank holds, of what has asked for no contact yet
    "found = sb.modal(structure(), 2).displacement((0.08, 0.004)); alone = sb.modal(structure("
    "MPI.COMM_SELF), 2).displacement((0.08, 0.004))\n"
    "np.testing.assert_allclose(abs(found), abs(alone), rtol=1e-5); print('fine')",
    # a state on a model like its own that has asked for no contact yet, and its field, of each rank's nodes
    "import tempfile; from sbfem_petsc.plot import plot_field\n"
    "state = sb.static(structure(), push); path = world.bcast(tempfile.mkdtemp()) + '/other.vtu'\n"
    "sb.write_vtu(path, structure(), {'u': state}); drawn = plot_field(structure(), {'u': state.interior})\n"
    "own = structure(MPI.COMM_SELF); whole = plot_field(own, {'u': sb.static(own, push).interior})\n"
    "shown = [np.sort(a[0].collections[0].get_array()) for a in (drawn, whole) if a]\n"
    "assert len(shown) == 2 - rank; np.testing.assert_allclose(*shown[::-1][:2], rtol=1e-6, atol=1e-6) "
    "if rank == 0 else None; print('fine')",
    "half = world.Split(rank); f = sb.modal(structure(half, density=2700.0 + rank), 1); print('fine')",
    "sb.on_root(world, lambda: sb.modal(structure(MPI.COMM_SELF), 1)); sb.modal(structure(), 1); "
    "print('fine')",
    # one's own beside what is shared: one file, of rank 0
    "import tempfile, time; found = [sb.static(structure(c), push) for c in (MPI.COMM_SELF, world)]\n"
    "path = world.bcast(tempfile.mkdtemp()) + '/both.h5'; time.sleep(0.2 * rank)\n"
    "sb.save(path, found); both = sb.read(path) if rank == 0 else None; world.barrier()\n"
    "assert rank or np.allclose(both[0].field, both[1].field); print('fine')",
    "sb.Model(sb.on_root(world, lambda: Beam(0.1, 0.01).mesh(order=1)), sb.Material(70e9, 0.3, 1.0)); "
    "print('fine')",
    # errors keep their type and attributes, also one whose arguments do not make it again
    "import json\n"
    "try: sb.on_root(world, lambda: json.loads('{'))\n"
    "except json.JSONDecodeError as error: print('fine' if error.pos == 1 else error)\n",
    "class Odd(KeyError):\n"
    "    def __init__(self, one, two): super().__init__(f'{one}-{two}')\n"
    "try: sb.on_root(world, lambda: (_ for _ in ()).throw(Odd(1, 2)))\n"
    "except KeyError as error: print('fine' if '1-2' in str(error) else error)\n",
]
RIGHT_ALONE = ["sb.modal(structure(MPI.COMM_SELF), 1) if rank else None; print('fine')"]


ALL_DIFFERENT = """
import json
model, said = structure(), {}
others = model, structure()
waves = [lambda t, a=a: a * np.sin(t) for a in (1.0, 2.0)]
sizes = [lambda model, a=a: a * model.unknowns for a in (1.0, 2.0)]
size = sizes[0]
pushes = [sb.static(model, sb.PointForce("A", fy=fy)) for fy in (1.0, 2.0)]
for case in json.loads(sys.argv[1]):
    try:
        eval(case)
        mine = "no error"
    except ValueError as error:
        mine = str(error)
    said[case] = world.allgather(mine)
if rank == 0:
    print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def said():
    return answer(on_ranks(2, BEGIN + ALL_DIFFERENT, json.dumps(list(DIFFERENT)), timeout=300))


@pytest.mark.slow
@pytest.mark.parametrize("case", DIFFERENT)
def test_arguments_that_differ_are_told(said, case):
    first, second = said[case]
    assert first == second
    assert DIFFERENT[case] in first and "\n" not in first


def run(program: str) -> subprocess.CompletedProcess[str]:
    return on_ranks(2, BEGIN + program, check=False, timeout=300)


# In the ordinary suite every twelfth, and what once hung; all by -m long.
SAMPLE = [*list(FAILING)[::12], "sys.exit() if rank else structure()"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "program", [pytest.param(p, marks=() if p in SAMPLE else pytest.mark.long) for p in FAILING]
)
def test_failure_ends_all_ranks(program):
    done = run(program)
    assert done.returncode != 0, done.stdout + done.stderr
    assert FAILING[program] in done.stderr, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "programs",
    [
        pytest.param(RIGHT, id="one after another"),
        pytest.param(RIGHT_ALONE, id="alone", marks=pytest.mark.long),
    ],
)
def test_right_programs_are_left_alone(programs):
    done = run("\n".join(programs))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("fine") == 2 * len(programs)


@pytest.mark.slow
def test_exit_code_is_kept():
    """Of all, and of one that leaves amid the others' solves; `sys.exit` is Python's own."""
    leaves = "progress=lambda *_: sys.exit(3) if rank else None"
    program = f"sb.transient(structure(), push, 1e-3, 1e-4, reduction=None, {leaves})"
    assert run(f"assert type(sys.exit) is type(len)\n{program}").returncode == 3
    assert run("structure(); sys.exit(7)").returncode == 7


@pytest.mark.slow
def test_exit_beside_a_barrier_of_the_program():
    """Which Python tells nobody: `python -m mpi4py` stops all ranks, with the library loaded too."""
    leaves = f"{BEGIN}\nsys.exit(3) if rank else world.barrier()"
    program = "import sys; from mpi4py.run import main; sys.argv = ['mpi4py', '-c', sys.argv[1]]; main()"
    done = on_ranks(2, program, leaves, check=False, timeout=60)
    assert done.returncode == 3, done.stderr


@pytest.mark.long
def test_error_known_to_all_is_printed_once():
    done = run("sb.modal(structure(), 0)")
    assert done.returncode == 1
    assert done.stderr.count("modal: count = 0") == 1


@pytest.mark.slow
def test_excepthook_of_the_program_is_kept():
    """A program's own hook prints, and is called under mpiexec too."""
    program = (
        "import sys\nsys.excepthook = lambda *error: sys.stderr.write('mine: ' + str(error[1]) + '\\n')\n"
    )
    done = on_ranks(2, program + BEGIN + "sb.modal(structure(), 0)", check=False, timeout=300)
    assert done.stderr.count("mine: modal: count = 0") == 1


def test_alone_without_a_launcher():
    """One process is left as it is: hook, exit code, nothing of MPI started by the import."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI", "PMI"))}
    program = (
        "import sys; before = sys.excepthook, sys.exit; import sbfem_petsc\n"
        "assert before == (sys.excepthook, sys.exit) and 'mpi4py' not in sys.modules\nsys.exit(5)"
    )
    assert subprocess.run([sys.executable, "-c", program], env=environment).returncode == 5


UNANSWERED = """
import time
from sbfem_petsc.ranks import abort
class World:
    def Abort(self, code):
        time.sleep(60.0)
abort.UNANSWERED = 1
abort._stop(World(), 1)
"""


@pytest.mark.slow
def test_a_launcher_that_does_not_answer():
    """A rank whose wish to end all ranks is not heard dies: the launcher sees that."""
    done = subprocess.run([sys.executable, "-c", UNANSWERED], cwd=ROOT, timeout=300)
    assert done.returncode == -signal.SIGALRM
