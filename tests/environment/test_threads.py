"""What threads may do: import any module; PETSc works for one of them."""

import subprocess
import sys
import threading
import warnings
from pathlib import Path

import numpy as np
import pytest

import sbfem_petsc as sb
from tests.fuzz import cases, examples

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@pytest.mark.parametrize("pairs", ["4", pytest.param("100", marks=pytest.mark.long)])
def test_two_threads_import_any_two_modules(pairs):
    """With the race between the threads forced."""
    program = [sys.executable, str(Path(__file__).with_name("race.py")), pairs, "0"]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, timeout=500)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


class Elsewhere:
    """A call in a thread of its own: what it touches of PETSc, and its error."""

    def __init__(self, call, given):
        self.call, self.given = call, given
        self.touched, self.error = [], None
        thread = threading.Thread(target=self._work, name="elsewhere")
        thread.start()
        thread.join()

    def _work(self):
        sys.setprofile(self._see)
        try:
            self.call(**self.given)
        except Exception as error:
            self.error = error
        finally:
            sys.setprofile(None)

    def _see(self, frame, event, function):
        owner = type(getattr(function, "__self__", None))
        if event == "c_call" and owner.__module__.startswith(("petsc4py", "slepc4py")):
            self.touched.append(
                f"{owner.__name__}.{function.__name__} at line {frame.f_lineno} of {frame.f_code}"
            )


def refused(call: Elsewhere) -> bool:
    return isinstance(call.error, RuntimeError) and "needs PETSc, which works for" in str(call.error)


def test_petsc_belongs_to_one_thread():
    model = examples.model()
    found = Elsewhere(sb.static, {"model": model, "load": examples.PUSH})
    assert not found.touched
    assert str(found.error) == (
        "a call in the thread 'elsewhere' needs PETSc, which works for 'MainThread' alone as long as that "
        "thread lives: call it there, or start a process for it"
    )


SUCCESSORS = """
import threading
results = []
def of(work):
    def told():
        try:
            results.append(work())
        except RuntimeError as error:
            results.append(str(error).split("needs")[0])
    thread = threading.Thread(target=told, name=work.__name__)
    thread.start()
    return thread
def imports():
    import sbfem_petsc.petsc
def model():
    import sbfem_petsc as sb
    from meshing import Beam
    made = sb.Model(Beam(0.1, 0.01).mesh(order=1), sb.Material(70e9, 0.3, 2700.0))
    return len(sb.modal(made, 1).frequencies)
def lasting():
    results.append(model())
    of(model).join()
of(imports).join()  # PETSc is started, and nothing is called
of(model).join()
of(lasting).join()  # the one before has ended
print(results)
"""


@pytest.mark.slow
def test_a_thread_succeeds_one_that_has_ended():
    done = subprocess.run([sys.executable, "-c", SUCCESSORS], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "[None, 1, 1, \"a call in the thread 'model' \", None]", done.stderr


def test_what_does_not_need_petsc_works_in_any_thread():
    """Histories of a reduced model; rounding of products goes on from step to step."""
    reduced, results = examples.oscillator(), []
    threads = [
        threading.Thread(target=lambda: results.append(sb.transient(reduced, 20.0, 0.1, 1e-3)))
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    expected = examples.history()
    for result in results:
        scale = np.abs(expected.states.q).max()
        np.testing.assert_allclose(result.states.q, expected.states.q, rtol=0.0, atol=1e-11 * scale)
    assert len(results) == 2


@pytest.mark.long
def test_each_public_call_either_works_in_any_thread_or_is_refused(tmp_path, monkeypatch):
    """Before it touches PETSc, as the interpreter sees calls of it."""
    monkeypatch.chdir(tmp_path)
    warnings.simplefilter("ignore")
    examples.write_files()
    public = examples.public()
    calls = [(name, public[name], make()) for name, makes in examples.CALLS.items() for make in makes]
    for name, make in examples.OBJECTS.items():
        calls += [(f"{name}.{method}", call, given) for method, call, given in cases.methods(name, make())]
    assert Elsewhere(examples.model().stiffness.norm, {}).touched  # so the interpreter does see them
    names = set()
    for name, call, given in calls:
        found = Elsewhere(call, given)
        assert not found.touched, name
        names |= {name} if refused(found) else set()
    assert {"Model", "modal", "static", "periodic", "frequency_response", "reduce"} <= names
