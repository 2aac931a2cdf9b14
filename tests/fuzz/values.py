"""Values that are put in the place of every argument of every public function, and which of them must be
refused.
"""

from __future__ import annotations

import cmath
import fractions
import inspect
import math
import numbers
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np

USERS = "a user's own mistake"


@numbers.Integral.register
class Bare:
    """An integer that can be converted and nothing else, as NumPy's short ones overflow in arithmetic."""

    def __index__(self) -> int:
        return 2


def _fails(*_: Any) -> float:
    raise ZeroDivisionError(USERS)


VALUES: dict[str, Any] = {
    "None": None,
    "True": True,
    "False": False,
    "0": 0,
    "1": 1,
    "-1": -1,
    "2": 2,
    "10**9": 10**9,
    "10**30": 10**30,
    "10**400": 10**400,
    "10**5000": 10**5000,
    "-0.0": -0.0,
    "0.5": 0.5,
    "1.5": 1.5,
    "-2.5": -2.5,
    "nan": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "1e308": 1e308,
    "1e-320": 1e-320,
    "1j": 1j,
    "nan j": complex(math.nan, 1.0),
    "np.float64(2.5)": np.float64(2.5),
    "np.float32(2.5)": np.float32(2.5),
    "np.int64(2)": np.int64(2),
    "np.uint8(3)": np.uint8(3),
    "bare integer 2": Bare(),
    "np.bool_(True)": np.bool_(True),
    "Fraction(1, 2)": fractions.Fraction(1, 2),
    "''": "",
    "'a'": "a",
    "'no'": "no",
    "'False'": "False",
    "'1'": "1",
    "'nul\\0byte'": "nul\0byte",
    "'surrogate'": "\udcff",
    "b'x'": b"x",
    "Path('folder')": pathlib.Path("folder"),
    "'/dev/null'": "/dev/null",
    "'missing/x.h5'": "missing/x.h5",
    "[]": [],
    "[1]": [1],
    "['a']": ["a"],
    "[[1, 2], [3]]": [[1, 2], [3]],
    "(1, 2)": (1, 2),
    "(nan, 1)": (math.nan, 1.0),
    "('a', 'b')": ("a", "b"),
    "{}": {},
    "{'a': 1}": {"a": 1},
    "{1: 'a'}": {1: "a"},
    "set": {1},
    "range": range(3),
    "object": object(),
    "class": int,
    "function": lambda x: x,
    "failing function": _fails,
    "module": cmath,
    "array(1.0)": np.array(1.0),
    "array([1, nan])": np.array([1.0, math.nan]),
    "array of bools": np.array([True, False]),
    "array of objects": np.array([None, "a"], dtype=object),
    "complex array": np.array([1j, 2.0]),
    "zeros(0)": np.zeros(0),
    "zeros((2, 2))": np.zeros((2, 2)),
}

# Those that what draws, or works through whole analyses, is given.
FEW = (
    "None",
    "True",
    "-1",
    "0.5",
    "nan",
    "10**30",
    "10**400",
    "1j",
    "''",
    "'a'",
    "'nul\\0byte'",
    "b'x'",
    "[]",
    "[1]",
    "{}",
    "{'a': 1}",
    "{1: 'a'}",
    "object",
    "failing function",
    "array([1, nan])",
)
SLOW = ("plot.", "results.", "estimate", "sweep")

# Kinds of parameters by what their annotation says, None and signals apart.
NUMBER, WHOLE, FLAG, TEXT, PATH, OTHER = "number", "whole number", "flag", "text", "path", "other"


def kind(parameter: inspect.Parameter) -> str:
    """What a parameter takes."""
    words = {word.strip() for word in str(parameter.annotation).split("|")} - {
        "None",
        "Signal",
        "os.PathLike[str]",
    }
    if words == {"str"} and parameter.name in ("path", "file", "folder", "output"):
        return PATH
    return {
        ("float",): NUMBER,
        ("int",): WHOLE,
        ("bool",): FLAG,
        ("str",): TEXT,
    }.get(tuple(sorted(words)), OTHER)


def must_be_refused(parameter: inspect.Parameter, value: Any) -> bool:
    """Whether a value cannot have a meaning for a parameter."""
    what = str(parameter.annotation)
    if value is None:
        return "None" not in what and kind(parameter) != OTHER and parameter.default is not None
    refuses: dict[str, Callable[[Any], bool]] = {
        NUMBER: lambda v: not _is_number(v) or math.isnan(v),
        WHOLE: lambda v: not isinstance(v, numbers.Integral) or isinstance(v, bool),
        FLAG: lambda v: not isinstance(v, (bool, np.bool_)),
        TEXT: lambda v: not isinstance(v, str),
        PATH: lambda v: not isinstance(v, (str, pathlib.Path)) or v == "" or "\0" in str(v),
        OTHER: lambda v: False,
    }
    if "Signal" in what and callable(value):
        return False
    return refuses[kind(parameter)](value)


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, (bool, np.bool_))
