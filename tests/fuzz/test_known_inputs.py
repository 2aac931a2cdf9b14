"""Inputs that once ended in an error from below, in a wrong number or never: each gets a sentence, or is
legitimate for a reason.

`known_inputs.txt` has them one a line, as expressions. What was done to files byte by byte stands with what
reads them (`tests/results/test_strangers_files.py`, `tests/system/test_faults.py`, `tests/meshing`).
"""

from __future__ import annotations

import linecache
import os
import pathlib
import traceback
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, BoundaryMesh, VNotch, read_gmsh
from sbfem_petsc import indicators, plot

from .cases import KINDS, ROOMS, Late, _limited
from .examples import matrices as oscillator

pytestmark = pytest.mark.filterwarnings("ignore")
SECONDS = 20.0
# What is right as it is -> why.
_BOTH = "a motion to begin from is a guess alone, and this is of the same model: both answers are the same"
_UNUSED = "how many periods are looked through is a bound; the load needs one"
LEGITIMATE = {
    'sb.save(W+"/r.h5",orb)': "a steady state is a result",
    "sb.Samples([0,1e-9,1.],[0,1,0]).highest_frequency": "of a fall over a second 99.99 % is below 6 kHz",
    "sb.Custom(sb.Harmonic(1,1))": "a signal is a function of time",
    "sb.Harmonic(1,1)([nan])": "what is not a number stays so, as in NumPy",
    'sb.transient(model,FH,1e-4,reduction=None,modes=5,step=1e-5,scheme="exact")': (
        "the default's name, which stands for the unreduced model's own scheme"
    ),
    "sb.periodic(model,F,1e15,modes=6,steps=64)": "it hardly moves, and a warning says where the modes end",
    "sb.periodic(model,F,300.,modes=6, steps=64, longest=10**9)": _UNUSED,
    "sb.periodic(model,F,300.,modes=6, steps=64, longest=10**30)": _UNUSED,
    'sb.load_response(model,sb.PointForce("A",fy=sb.Harmonic(1,300.)),300.,0.5,stop=1.,modes=6,steps=64,'
    "points=4)": "a tone at the frequency of the curve",
    "matrices(damping=np.array([0.05,0.05]))": "ratios of each mode",
    "matrices(gap=[-0.01])": "a stop that presses at rest",
    "sb.periodic(model,F,300.,modes=6,steps=64,stability=None)": "the default: of a reduced model",
    "sb.frequency_response(model,F,300.,320.,modes=6,steps=64,points=4,stability=None)": "the same",
    "sb.load_response(model,F,300.,0.5,stop=1.,modes=6,steps=64,points=4,stability=None)": "the same",
    "[sb.periodic(model,sb.EdgeLoad('top',ty=10.),300.,modes=6,steps=64,guess=r).amplitude('A') "
    "for r in (orb,None)]": _BOTH,
    "[sb.periodic(model,sb.SupportMotion(ay=10.),300.,modes=6,steps=64,guess=r).amplitude('A') "
    "for r in (orb,None)]": _BOTH,
    'sb.write_animation(W+"/anim",orb)': "steady states move too",
}
# Python's own sentences for a call with other arguments than there are.
ITS_OWN = ("unexpected keyword argument", "positional argument")


def sections() -> dict[str, list[str]]:
    """The expressions by their headings."""
    found: dict[str, list[str]] = {}
    for line in pathlib.Path(__file__).with_name("known_inputs.txt").read_text().splitlines():
        if line.startswith("# "):
            lines = found.setdefault(line[2:], [])
        elif line:
            lines.append(line)
    return found


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What the expressions speak of."""
    folder = tmp_path_factory.mktemp("known")
    (folder / "notes.txt").write_text("no folder\n")
    beam = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.05)])
    mesh, mat = beam.mesh(order=2), sb.Material(70e9, 0.33, 2700)
    model = sb.Model(mesh, mat, damping=0.02)
    push, burst = sb.PointForce("A", fy=10.0), sb.PointForce("A", fy=sb.Harmonic(10.0, 500.0))
    given = oscillator()
    time = np.linspace(0.0, 0.1, 1001)[:-1]
    reading = (sb.read, sb.read, sb.read, sb.read, sb.read)

    def matrices(**changes: Any) -> sb.ReducedModel:
        return sb.reduce_matrices(**{**given, **changes})

    def finite(*values: Any) -> tuple[str, float]:
        assert all(np.isfinite(value).all() for value in values)
        return "finite", float(np.abs(values[0]).max())

    def steady(*arguments: Any, **options: Any) -> Any:
        found = sb.periodic(*arguments, 300.0, **{"modes": 6, "steps": 64, **options})
        return finite(found.displacement("A"), found.contact_force)

    def moved(*arguments: Any, **options: Any) -> Any:
        found = sb.transient(*arguments, 1e-3, **{"modes": 6, **options})
        return finite(found.displacement("A"), found.contact_force)

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.chdir(folder)
        yield {
            "sb": sb,
            "np": np,
            "os": os,
            "nan": np.nan,
            "inf": np.inf,
            "Beam": Beam,
            "VNotch": VNotch,
            "read_gmsh": read_gmsh,
            "ind": indicators,
            "plot": plot,
            "write_vtu": sb.write_vtu,
            "W": str(folder),
            "READ": dict(
                zip(
                    ("mesh", "hist", "full", "curve", "orbit", "results"),
                    (BoundaryMesh.load, *reading),
                )
            ),
            "beam": beam,
            "mesh": mesh,
            "mat": mat,
            "model": model,
            "F": push,
            "FH": burst,
            "M2": given["mass"],
            "K2": given["stiffness"],
            "matrices": matrices,
            "osc": matrices(),
            "red": sb.reduce(model, push, modes=8),
            "md": sb.modal(model, 8),
            "st": sb.static(model, push),
            "hist": sb.transient(model, burst, 1e-3, modes=6),
            "orb": sb.periodic(model, push, 300.0, modes=6, steps=64),
            "cur": sb.frequency_response(model, push, 300.0, 302.0, modes=6, steps=64, points=5),
            "T": time,
            "U": np.sin(2.0 * np.pi * 100.0 * time),
            "PER": steady,
            "TRN": moved,
            "MO": lambda found: finite(sb.modal(found, 4).frequencies),
        }


def outcome(line: str, names: dict[str, Any]) -> str:
    """ "sentence", or what became of an expression."""
    try:
        with _limited(SECONDS):
            result = eval(line, names)
            repr(result)
    except Late:
        return f"no answer in {SECONDS:g} s"
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        ours = frame.filename.startswith(ROOMS) or "<string>" in frame.filename
        raised = "raise" in linecache.getline(frame.filename, frame.lineno or 0)
        if isinstance(error, ZeroDivisionError) and frame.filename == "<string>":
            return "sentence"  # the user's own function fails
        refused = frame.filename == "<string>" or frame.line == "return function(*args, **kwargs)"
        if isinstance(error, TypeError) and refused:
            return "sentence" if any(words in str(error) for words in ITS_OWN) else f"TypeError: {error}"
        if isinstance(error, KINDS) and ours and raised and "\n" not in str(error) and len(str(error)) < 600:
            return "sentence"
        said = " ".join(str(error).split())[:120]
        return f"{type(error).__name__}: {said} @ {frame.filename[-40:]}:{frame.lineno}"
    return f"result {' '.join(repr(result).split())[:120]}"


LONG = ("Files that are written", "Results of other models")


@pytest.mark.parametrize(
    "section", [pytest.param(s, marks=pytest.mark.long if s in LONG else ()) for s in sections()]
)
def test_sentence_or_legitimate(section, names):
    failed = []
    for line in sections()[section]:
        found = outcome(line, names)
        if found != "sentence" and not (found.startswith("result") and line in LEGITIMATE):
            failed.append(f"{line}  ->  {found}")
    assert not failed, "\n".join(failed)


def test_every_reason_has_a_line():
    known = {line for lines in sections().values() for line in lines}
    assert len(known) >= 494 and set(LEGITIMATE) <= known and all(LEGITIMATE.values())
