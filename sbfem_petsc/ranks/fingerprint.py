"""Fingerprints of arguments: equal on ranks that were given the same."""

from __future__ import annotations

import contextlib
import dataclasses
import dis
import enum
import functools
import hashlib
import numbers
import os
import pickle
import types
from collections.abc import Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

# Integers up to here are floating-point numbers too.
EXACT = 2**53
# Objects inside one another, and all of them, that are looked at.
DEEPEST, LARGEST = 60, 10**6
# Packages whose classes are the same on all ranks.
SAME = ("builtins", "functools", "numpy", "scipy", "numba", "meshing", __package__.partition(".")[0])


@dataclasses.dataclass(frozen=True)
class Fingerprint:
    """What an argument is, without the numbers in it, and the numbers.

    Attributes
    ----------
    structure : bytes
    numbers : (n,) array
    """

    structure: bytes
    numbers: np.ndarray

    @property
    def digest(self) -> bytes:
        """16 bytes."""
        found = hashlib.blake2b(self.structure, digest_size=16)
        found.update(self.numbers.data)  # without a copy
        return found.digest()

    def same(self, other: Fingerprint, tolerance: float) -> bool:
        """Whether another one differs by no more than rounding."""
        if self.structure != other.structure or self.numbers.shape != other.numbers.shape:
            return False
        return bool(np.allclose(self.numbers, other.numbers, rtol=tolerance, atol=0.0, equal_nan=True))


def fingerprint(value: Any) -> Fingerprint:
    """The fingerprint of an argument.

    Functions count with their code, its constants and names, their defaults, attributes, closures and the
    global values that they read by name (not by `globals()`, nor those of another module); objects with their
    attributes, those that can be called with the code and the values of their classes. Classes whose content
    is shared out over the ranks say what they are by a method `_fingerprint`.
    """
    collected = _Collected()
    collected.add(value)
    found = collected.numbers
    return Fingerprint(collected.structure.digest(), np.concatenate(found) if found else np.zeros(0))


class _Collected:
    """What has been seen of an argument: words in a hash, and numbers."""

    def __init__(self) -> None:
        self.structure = hashlib.blake2b(digest_size=16)
        self.numbers: list[np.ndarray] = []
        self.within: set[int] = set()  # objects that are being looked at, which may contain themselves
        self.looks = 0

    def word(self, *parts: Any) -> None:
        self.structure.update(repr(parts).encode(errors="surrogatepass"))

    def add(self, value: Any) -> None:
        """Add a value."""
        self.looks += 1
        if value is None or isinstance(value, (str, bytes)):
            self.word(value)
        elif isinstance(value, (bool, np.bool_)):
            self.word("truth", bool(value))
        elif isinstance(value, enum.Enum):
            self.word(type(value).__name__, value.name)
        elif isinstance(value, numbers.Number):
            self._add_number(value)
        elif id(value) in self.within or len(self.within) > DEEPEST or self.looks > LARGEST:
            self.word("deep", type(value).__name__)
        else:
            self.within.add(id(value))
            self._add_object(value)
            self.within.discard(id(value))

    def _add_number(self, value: Any) -> None:
        if isinstance(value, numbers.Integral) and abs(int(value)) > EXACT:
            self.word("int", hex(value))
        elif isinstance(value, (numbers.Real, numbers.Complex)):
            self.word("number", isinstance(value, numbers.Real))
            number = complex(value)
            self.numbers.append(np.array([number.real, number.imag]))
        else:
            self.word("number", str(value))

    def _add_object(self, value: Any) -> None:
        own = getattr(type(value), "_fingerprint", None)
        if own is not None:
            self.word(type(value).__name__)
            self.add(own(value))
        elif isinstance(value, np.ndarray):
            self._add_array(value)
        elif hasattr(value, "tocsr"):  # of SciPy, which notes in a matrix what it has found out of it
            entries = value.tocsr(copy=True)
            entries.sum_duplicates()
            self.add((entries.shape, entries.indptr, entries.indices, entries.data))
        elif isinstance(value, os.PathLike):
            self.word("path", os.fspath(value))
        elif isinstance(value, Mapping):
            self.word("dict", len(value))
            for key, item in value.items():
                self.add(key)
                self.add(item)
        elif isinstance(value, (list, tuple, range)):
            self.word("sequence", len(value))
            for item in value:
                self.add(item)
        elif isinstance(value, (set, frozenset)):
            self.word("set", sorted(fingerprint(item).digest for item in value))
        elif isinstance(value, (type, types.ModuleType)):
            self.word("name", getattr(value, "__module__", ""), value.__name__)
        elif isinstance(value, MPI.Comm):
            self.word("communicator", value.size if value != MPI.COMM_NULL else 0)
        elif isinstance(value, functools.partial):
            self.add(("partial", value.func, value.args, value.keywords))
        elif isinstance(value, types.MethodType):
            self.add(("method", value.__self__, value.__func__))
        elif isinstance(value, (types.BuiltinFunctionType, np.ufunc)):
            self.add(("built in", value.__name__, getattr(value, "__self__", None)))
        elif isinstance(value, types.FunctionType):
            self._add_function(value)
        else:
            self._add_attributes(value)

    def _add_array(self, array: np.ndarray) -> None:
        self.word("array", array.shape, array.dtype.kind)
        if array.dtype.kind == "f":
            self.numbers.append(np.ascontiguousarray(array, dtype=float).ravel())
        elif array.dtype.kind == "c":
            self.numbers.append(np.ascontiguousarray(array, dtype=complex).ravel().view(float))
        elif array.dtype.kind == "O":
            self.add(array.tolist())
        else:
            self.structure.update(np.ascontiguousarray(array).tobytes())

    def _add_function(self, function: types.FunctionType) -> None:
        self.word("function", function.__qualname__)
        self._add_code(function.__code__)
        self.add((function.__defaults__, function.__kwdefaults__, function.__dict__))
        for cell in function.__closure__ or ():
            try:
                self.add(cell.cell_contents)
            except ValueError:  # not yet given
                self.word("empty")
        for name in sorted(_globals_of(function.__code__)):
            if name in function.__globals__:
                self.word(name)
                self.add(function.__globals__[name])

    def _add_code(self, code: types.CodeType) -> None:
        self.word("code", code.co_code, code.co_names, code.co_freevars, code.co_argcount, code.co_flags)
        for constant in code.co_consts:
            self._add_code(constant) if isinstance(constant, types.CodeType) else self.add(constant)

    def _add_attributes(self, value: Any) -> None:
        """Of an object: the fields that are compared of a data class, all attributes of another one, and
        what is pickled of one without any.
        """
        kind = type(value)
        self.word("object", kind.__module__, kind.__qualname__)
        slots = {name for base in kind.__mro__ for name in _slots(base)}
        if dataclasses.is_dataclass(value):
            for field in dataclasses.fields(value):
                if field.compare:
                    self.add(getattr(value, field.name, None))
        elif hasattr(value, "py_func"):  # compiled by Numba
            self.add(value.py_func)
        elif hasattr(value, "__dict__") or slots:
            self.add(dict(getattr(value, "__dict__", {})))
            self.add({name: getattr(value, name, None) for name in sorted(slots)})
        else:
            with contextlib.suppress(Exception):  # whatever a foreign class does when it is copied
                self.structure.update(pickle.dumps(value, protocol=4))
        if callable(value):
            for base in kind.__mro__:
                if base.__module__.partition(".")[0] not in SAME:
                    self._add_class(base)

    def _add_class(self, kind: type) -> None:
        """What is defined in a class: functions, also behind decorators, and plain values."""
        for name, item in sorted(vars(kind).items()):
            inside = getattr(item, "fget", getattr(item, "__func__", item))
            if isinstance(inside, types.FunctionType) or not (
                name.startswith("__") or hasattr(item, "__get__")
            ):
                self.word(name)
                self.add(inside)


def _slots(kind: type) -> tuple[str, ...]:
    """Names of the attributes of a class that has no dict for them."""
    found = kind.__dict__.get("__slots__", ())
    return (found,) if isinstance(found, str) else tuple(found)


def _globals_of(code: types.CodeType) -> set[str]:
    """Names of a module's values that code reads, that of functions inside it included."""
    found = {item.argval for item in dis.get_instructions(code) if item.opname == "LOAD_GLOBAL"}
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            found |= _globals_of(constant)
    return found
