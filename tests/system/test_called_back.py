"""Errors and Ctrl-C inside Python that PETSc and SLEPc call: told as they are, and the program then ends."""

import pytest

from tests.parallel import on_ranks

# Errors are kept, with all that their tracebacks hold, until PETSc has ended. A new model follows on each:
# for it PETSc frees what all ranks have let go of.
PROGRAM = """
import sys, warnings
from itertools import product
import sbfem_petsc as sb
from meshing import Beam, VNotch
from mpi4py import MPI
from petsc4py import PETSc
from sbfem_petsc.continuation import multipliers as of_motions
from sbfem_petsc.continuation import linear, shooting as fixed_points
from sbfem_petsc.continuation.problems import unreduced as unreduced_shooting
from sbfem_petsc.system.contact import dual_contact
from sbfem_petsc.system.solve import krylov_step
from tests.systems import two_masses

warnings.simplefilter("ignore")
PETSc.Options().setValue("contact_dual", "true")
notched = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.0)]).mesh(order=2)
push = sb.PointForce("A", fy=1000.0)

def body(**given):
    return sb.Model(notched, sb.Material(70e9, 0.33, 2700), **given)

def shooting(jacobian):
    sb.periodic(body(damping=0.02), push, 700.0, modes=4, steps=64, jacobian=jacobian)

def unreduced():
    sb.periodic(body(rayleigh=(1.0, 1e-6)), push, 700.0, modes=4, steps=64, reduction=None, stability=False)

def multipliers():
    of_motions.WHOLE = 0
    sb.periodic(two_masses(), sb.Harmonic(2.0, 0.1), 0.1, steps=64)

def tones():
    both = sb.Harmonic(2.0, 0.1) + sb.Harmonic(0.5, 0.1317)
    sb.quasi_periodic(two_masses(), both, frequencies=(0.1, 0.1317), samples=9, steps=64)

CALLS = [
    (krylov_step.KrylovStep, "apply", 1, lambda: sb.modal(body(), 4)),
    (krylov_step.KrylovStep, "apply", 8, lambda: sb.modal(body(), 4)),
    (dual_contact.Dual, "mult", 2, lambda: sb.static(body(), push)),
    (fixed_points.Shooting, "_function", 2, lambda: shooting("auto")),
    (fixed_points.Shooting, "_jacobian", 1, lambda: shooting("dense")),
    (linear.Operator, "mult", 3, lambda: shooting("matrix-free")),
    (linear.Operator, "apply", 3, lambda: shooting("matrix-free")),
    (unreduced_shooting.UnreducedSteady, "_function", 2, unreduced),
    (linear.Operator, "mult", 2, unreduced),
    (linear.Operator, "apply", 2, unreduced),
    (linear.Operator, "mult", 2, tones),
    (linear.Operator, "apply", 2, tones),
    (linear.Operator, "mult", 1, multipliers),
]
kept = []

def tell(*words):
    if MPI.COMM_WORLD.rank == 0:
        print(*words, flush=True)

first, last = map(int, sys.argv[1:3])
for kind, (owner, name, after, solve) in product(sys.argv[3:], CALLS[first:last]):
    whole, calls = getattr(owner, name), 0

    def fails(*arguments):
        global calls
        calls += 1
        if calls == after:
            raise {"Ctrl-C": KeyboardInterrupt, "error": ArithmeticError}[kind]
        return whole(*arguments)

    setattr(owner, name, fails)
    try:
        solve()
    except BaseException as error:
        tell(owner.__name__, name, after, type(error).__name__)
        kept.append(error)
    setattr(owner, name, whole)
    body()
PETSc.Options().setValue("shooting_ksp_type", "nonsense")
for solve in (lambda: shooting("matrix-free"), unreduced):
    try:
        solve()
    except (sb.SolveError, sb.SolverFailure) as error:
        tell("option", type(error).__name__)
        kept.append(error)
PETSc.Options().delValue("shooting_ksp_type")
tell(f"{sb.modal(body(), 1).frequencies[0]:.6g}")
"""
EXPECTED = """\
KrylovStep apply 1
KrylovStep apply 8
Dual mult 2
Shooting _function 2
Shooting _jacobian 1
Operator mult 3
Operator apply 3
UnreducedSteady _function 2
Operator mult 2
Operator apply 2
Operator mult 2
Operator apply 2
Operator mult 1
"""


NAMES = {"error": "ArithmeticError", "Ctrl-C": "KeyboardInterrupt"}
ALL, UNREDUCED = (0, 13), (7, 10)  # of the calls


def check(ranks, kinds, chosen):
    """Nothing replaces the error, what is computed afterwards is right, and what the traceback keeps does not
    crash PETSc's end.
    """
    done = on_ranks(ranks, PROGRAM, *map(str, chosen), *kinds)
    calls = [f"{call} {NAMES[kind]}" for kind in kinds for call in EXPECTED.splitlines()[slice(*chosen)]]
    told = done.stdout.replace("\033[0m", "").splitlines()
    assert told[: len(calls)] == calls, done.stderr
    after = told[len(calls) :][:3]  # newer PETSc tells of unused options behind it
    assert after == ["option PetscFailure", "option PetscFailure", "761.538"], done.stderr
    assert "PETSC ERROR" not in done.stderr


@pytest.mark.long
@pytest.mark.parametrize(
    "ranks, kinds",
    [
        (1, ["error"]),
        (2, ["Ctrl-C"]),
    ],
)
def test_errors_inside_calls(ranks, kinds):
    """Of each part in Python of a solver."""
    check(ranks, kinds, ALL)


@pytest.mark.long
def test_errors_inside_calls_that_are_compiled(tmp_path, monkeypatch):
    """The compiler of loops leaves cycles of references to frames, and to what PETSc has handed to them: in
    steps of the unreduced model, whose loops are compiled in the least time.
    """
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    check(1, ["error"], UNREDUCED)
