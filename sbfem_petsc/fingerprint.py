"""Fingerprints of arguments: equal on ranks that were given the same."""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import numbers
import os
from collections.abc import Mapping
from typing import Any

import numpy as np


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
        return hashlib.blake2b(self.structure + self.numbers.tobytes(), digest_size=16).digest()

    def same(self, other: Fingerprint, tolerance: float) -> bool:
        """Whether another one differs by no more than rounding."""
        if self.structure != other.structure or self.numbers.shape != other.numbers.shape:
            return False
        return bool(np.allclose(self.numbers, other.numbers, rtol=tolerance, atol=0.0, equal_nan=True))


def fingerprint(value: Any) -> Fingerprint:
    """The fingerprint of an argument; of objects whose content is not known, that of their class."""
    structure = hashlib.blake2b(digest_size=16)
    found: list[np.ndarray] = []
    _add(value, structure, found, 0)
    return Fingerprint(structure.digest(), np.concatenate(found) if found else np.zeros(0))


def _add(value: Any, structure: Any, found: list[np.ndarray], depth: int) -> None:
    """Add a value to a fingerprint."""

    def word(*parts: Any) -> None:
        structure.update(repr(parts).encode())

    own = getattr(type(value), "_fingerprint", None)
    if depth > 12:
        word("deep", type(value).__name__)
    elif own is not None:
        _add(own(value), structure, found, depth + 1)
    elif value is None or isinstance(value, (bool, np.bool_, str, bytes, enum.Enum)):
        word(type(value).__name__, value)
    elif isinstance(value, numbers.Integral):
        word("int", int(value))
    elif isinstance(value, numbers.Real):
        word("float")
        found.append(np.array([float(value)]))
    elif isinstance(value, np.ndarray):
        _add_array(value, word, found)
    elif isinstance(value, os.PathLike):
        word("path", os.fspath(value))
    elif isinstance(value, Mapping):
        word("dict", len(value))
        for key, item in value.items():
            _add(key, structure, found, depth + 1)
            _add(item, structure, found, depth + 1)
    elif isinstance(value, (list, tuple)):
        word("sequence", len(value))
        for item in value:
            _add(item, structure, found, depth + 1)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        word(type(value).__name__)
        for field in dataclasses.fields(value):
            if field.compare:
                _add(getattr(value, field.name), structure, found, depth + 1)
    elif callable(value):
        code = getattr(value, "__code__", None)
        word("function", getattr(value, "__qualname__", type(value).__name__), code and code.co_code)
    else:
        word("object", type(value).__name__)


def _add_array(array: np.ndarray, word: Any, found: list[np.ndarray]) -> None:
    word("array", array.shape, array.dtype.kind)
    if array.dtype.kind == "f":
        found.append(np.ascontiguousarray(array, dtype=float).ravel())
    elif array.dtype.kind == "c":
        found.append(np.ascontiguousarray(array, dtype=complex).ravel().view(float))
    elif array.dtype.kind in "biu":
        word(hashlib.blake2b(np.ascontiguousarray(array).tobytes()).digest())
    else:
        word(array.tolist())
