"""Options of analyses: signature, docstring and class say the same, they are frozen, checked once, and
loaded when they are used.
"""

from __future__ import annotations

import inspect
import math
import re
import subprocess
import sys
import typing
from fractions import Fraction

import numpy as np
import pytest
from pydantic import Field, ValidationError

import sbfem_petsc as sb
from sbfem_petsc.options import Options, item

ANALYSES = {
    name: function
    for name, function in ((name, getattr(sb, name)) for name in sb.__all__)
    if hasattr(function, "options")
}


def test_every_analysis_has_options():
    """Every public function of the room of analyses."""
    public = {name for name in sb.__all__ if inspect.isfunction(getattr(sb, name))}
    assert set(ANALYSES) == {
        name
        for name in public
        if inspect.unwrap(getattr(sb, name)).__module__.startswith("sbfem_petsc.analysis")
    }
    assert len(ANALYSES) >= 18


def described(function) -> dict[str, str]:
    """What follows the colon behind each name in a docstring's "Parameters"."""
    text = inspect.getdoc(function).split("Parameters\n----------\n")[1]
    text = re.split(r"\n\n[A-Z]\w+\n-+\n", text)[0]
    found = {}
    for names, kind in re.findall(r"^(\w[\w, ]*?)(?: : (.+))?$", text, re.MULTILINE):
        found |= dict.fromkeys((name.strip() for name in names.split(",")), kind)
    return found


@pytest.mark.parametrize("name", ANALYSES)
def test_signature_and_docstring(name):
    """Every option is an argument with the class' default; "optional" is what has None; words are listed."""
    function = ANALYSES[name]
    parameters, words = inspect.signature(function).parameters, described(function)
    assert set(words) == set(parameters)
    for option, field in function.options.model_fields.items():
        default = inspect.Parameter.empty if field.is_required() else field.default
        given = parameters[option].default
        assert (list(given) if isinstance(given, tuple) else given) == default, option
        if words[option]:  # some refer to another function
            assert words[option].endswith("optional") == (default is None), option
        kinds = typing.get_args(field.annotation)
        if typing.get_origin(field.annotation) is typing.Literal and words[option]:
            assert re.findall(r'"([^"]+)"', words[option]) == list(kinds), option


class Sizes(Options):
    """Options of every type."""

    width: float = item(text="width", unit="m", gt=0)
    count: int | None = item(None, text="count", ge=1, le=9)
    exact: bool = item(True, text="whether")
    way: typing.Literal["up", "down"] = item("up", text="way")
    span: typing.Annotated[list[float], Field(min_length=2, max_length=2)] | None = item(
        None, text="two lengths", unit="m"
    )
    ways: list[typing.Literal["up", "down"]] = item(["up"], text="ways", min_length=1)


@pytest.mark.parametrize(
    "name, value, kind, sentence",
    [
        ("width", 0.0, ValueError, "width = 0.0 must be above 0, in m$"),
        ("width", math.nan, ValueError, "width = nan must be a finite number, in m$"),
        ("width", Fraction(10**400), TypeError, "must be a number"),
        ("width", "1", TypeError, "width = '1' must be a number, in m$"),
        ("width", np.array(1.0), TypeError, r"width = array\(1.\) must be a number, in m$"),
        ("width", True, TypeError, "width = True must be a number, in m$"),
        ("count", 10, ValueError, "count = 10 must be at most 9$"),
        ("count", 10**400, ValueError, r"count = 10+ \.\.\. must be at most 9$"),
        ("count", 0, ValueError, "count = 0 must be at least 1$"),
        ("count", 2.0, TypeError, "count = 2.0 must be a whole number$"),
        ("exact", 1, TypeError, "exact = 1 must be true or false$"),
        ("way", "Up", ValueError, "way = 'Up' is unknown; did you mean 'up'[?] Valid are 'up', 'down'$"),
        ("way", 3, ValueError, "way = 3 is unknown; valid are 'up', 'down'$"),
        ("span", 3.0, TypeError, r"span = 3.0 must be an array, \[...\], in m$"),
        ("span", (1.0, "2"), TypeError, r"span\[1\] = '2' must be a number, in m$"),
        ("span", (1.0,), ValueError, "span has 1 entries; at least 2 expected, in m$"),
        ("ways", (), ValueError, "ways has 0 entries; at least 1 expected$"),
        ("ways", ("left",), ValueError, r"ways\[0\] = 'left' is unknown; valid are 'up', 'down'$"),
        ("ways", "up", TypeError, r"ways = 'up' must be an array, \[...\]$"),
    ],
)
def test_sentences(name, value, kind, sentence):
    """One sentence, the same as of a case; a TypeError for what is of another type."""
    with pytest.raises(kind, match=sentence) as raised:
        Sizes.checked("f", {"width": 1.0, name: value})
    assert str(raised.value).startswith("f: ")


def test_values():
    """NumPy's numbers and arrays are taken; what is made is frozen."""
    found = Sizes.checked(
        "f",
        {
            "width": np.float32(0.5),
            "count": np.int64(3),
            "exact": np.bool_(False),
            "span": np.array([1.0, 2.0]),
        },
    )
    assert (found.width, found.count, found.exact, found.span) == (0.5, 3, False, [1.0, 2.0])
    assert type(found.count) is int and type(found.width) is float
    with pytest.raises(ValidationError, match="frozen"):
        found.width = 2.0
    assert Sizes.checked("f", {"width": Fraction(1, 2)}).width == 0.5


def test_python_refuses_arguments_itself():
    """In one error, without that of our own look at them."""
    with pytest.raises(TypeError, match="unexpected keyword argument 'width'") as raised:
        sb.transient(None, None, 1.0, width=3)
    assert raised.value.__context__ is None


def test_nothing_is_loaded_early():
    """`import sbfem_petsc` loads no pydantic, and a case's options neither MPI nor PETSc."""
    program = (
        "import sys, sbfem_petsc; print('pydantic' in sys.modules); import sbfem_petsc.analysis.options; "
        "print(any(name.split('.')[0] in ('mpi4py', 'petsc4py') for name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == ["False", "False"], done.stderr
