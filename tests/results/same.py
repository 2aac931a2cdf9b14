"""Whether two records hold the same, and what becomes of changed bytes of a file."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path

import numpy as np

from sbfem_petsc.record.record import Record, entries


def same(one, other, depth: int = 0) -> None:
    """Assert that all that is kept is equal, to the last bit, nan beside nan."""
    assert type(one) is type(other)
    if isinstance(one, tuple):
        assert len(one) == len(other)
        for pair in zip(one, other):
            same(*pair)
        return
    whole, again = one._gathered(), other._gathered()
    named = {f.name for f in dataclasses.fields(one)}
    for name, about in entries(type(one)).items():
        if not about.stored or not (about.back or name in named):
            continue
        a, b = (getattr(item, name) for item in (one, other))
        if about.distributed:
            a, b = whole.get(name), again.get(name)
        if about.part and a is not None:
            same(a, b, depth + 1)
        elif isinstance(a, dict):
            assert list(a) == list(b)
            for key in a:
                np.testing.assert_array_equal(a[key], b[key], err_msg=name)
        else:
            assert (a is None) == (b is None), name
            if a is not None:
                np.testing.assert_array_equal(a, b, err_msg=name)
                assert np.asarray(a).dtype.kind == np.asarray(b).dtype.kind, name


def inverted(path, read, every: int = 1, first: int = 0) -> tuple[int, int, list[int]]:
    """Invert bytes of a file one by one: how many were told of, had no effect, and changed what is read."""
    file = Path(path)
    data, expected = bytearray(file.read_bytes()), read(path)
    told, without, silent = 0, 0, []
    for k in range(first, len(data), every):
        data[k] ^= 0xFF
        file.write_bytes(data)
        data[k] ^= 0xFF
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = read(path)
        except ValueError as error:
            assert "\n" not in str(error)
            told += 1
            continue
        try:
            compared(expected, found)
            without += 1
        except AssertionError:
            silent.append(k)
    file.write_bytes(data)
    return told, without, silent


def compared(one, other) -> None:
    """`same` of results, sequences and dicts of them, and equality of bytes."""
    assert type(one) is type(other)
    if isinstance(one, Record):
        same(one, other)
    elif isinstance(one, bytes):
        assert one == other
    else:
        assert len(one) == len(other)
        for a, b in zip(*(item.values() if isinstance(item, dict) else item for item in (one, other))):
            compared(a, b)
