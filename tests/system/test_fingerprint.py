"""Fingerprints of arguments: whatever makes a difference to a result tells arguments apart."""

import functools
import math
from fractions import Fraction

import numba
import numpy as np
import pytest
from scipy import sparse
from scipy.interpolate import CubicSpline

import sbfem_petsc as sb
from sbfem_petsc.ranks.fingerprint import fingerprint

SIZE = 1.0


def reads_a_global(t):
    return SIZE * t


def within(size):
    return lambda t: size * t


def deep(size):
    def outer(t):
        def inner(t):
            return size * t

        return inner(t)

    return outer


def with_default(size):
    def found(t, size=size):
        return size * t

    return found


def with_keyword(size):
    def found(t, *, size=size):
        return size * t

    return found


class Called:
    def __init__(self, size):
        self.size = size

    def __call__(self, t):
        return self.size * t


def of_a_class(size):
    """An object whose class says the size, as it may on ranks that read different files."""

    class Sized:
        share = size

        def __call__(self, t):
            return self.share * t

    return Sized()


def of_a_code(doubled):
    """An object whose class' code says the size."""
    if doubled:

        class Sized:
            def __call__(self, t):
                return 2.0 * t

    else:

        class Sized:
            def __call__(self, t):
                return 1.0 * t

    return Sized()


def with_attribute(size):
    def found(t):
        return found.size * t

    found.size = size
    return found


class Slotted:
    __slots__ = ("size",)

    def __init__(self, size):
        self.size = size


# Pairs that differ -> how each is made.
DIFFERENT = {
    "constants": (lambda t: 1.0 * t, lambda t: 2.0 * t),
    "constants of a function inside": (
        lambda t: (lambda s: 1.0 * s)(t),
        lambda t: (lambda s: 2.0 * s)(t),
    ),
    "names": (lambda t: np.sin(t), lambda t: np.cos(t)),
    "code": (lambda t: t + t, lambda t: t * t),
    "closures": (within(1.0), within(2.0)),
    "closures of closures": (deep(1.0), deep(2.0)),
    "defaults": (with_default(1.0), with_default(2.0)),
    "defaults of keywords": (with_keyword(1.0), with_keyword(2.0)),
    "partial": (functools.partial(pow, 2.0), functools.partial(pow, 3.0)),
    "functions by name": (math.sin, math.cos),
    "NumPy's functions": (np.sin, np.cos),
    "objects that are called": (Called(1.0), Called(2.0)),
    "values of their classes": (of_a_class(1.0), of_a_class(2.0)),
    "code of their classes": (of_a_code(False), of_a_code(True)),
    "attributes of functions": (with_attribute(1.0), with_attribute(2.0)),
    "their methods": (Called(1.0).__call__, Called(2.0).__call__),
    "slots": (Slotted(1.0), Slotted(2.0)),
    "splines": (CubicSpline([0, 1, 2], [0, 1, 4]), CubicSpline([0, 1, 2], [0, 1, 5])),
    "compiled functions": (numba.njit(lambda t: 1.0 * t), numba.njit(lambda t: 2.0 * t)),
    "arrays in lists": ([np.zeros(2)], [np.ones(2)]),
    "arrays of objects": (np.array([1.0, "a"], object), np.array([1.0, "b"], object)),
    "complex numbers": (1.0 + 1.0j, 1.0 + 2.0j),
    "large integers": (10**400, 10**400 + 1),
    "sets": ({1, 2}, {1, 3}),
    "sparse matrices": (sparse.eye(2).tocsr(), 2.0 * sparse.eye(2).tocsr()),
    "classes": (Called, Slotted),
    "generators": (np.random.default_rng(1), np.random.default_rng(2)),
    "signals": (
        sb.PointForce("A", fy=sb.Custom(within(1.0))),
        sb.PointForce("A", fy=sb.Custom(within(2.0))),
    ),
}


@pytest.mark.parametrize("what", DIFFERENT)
def test_a_difference_is_seen(what):
    one, other = DIFFERENT[what]
    assert not fingerprint(one).same(fingerprint(other), 1e-9)
    assert fingerprint(one).digest == fingerprint(one).digest


def test_a_global_value_that_is_read(monkeypatch):
    before = fingerprint(reads_a_global)
    monkeypatch.setitem(globals(), "SIZE", 2.0)
    assert not before.same(fingerprint(reads_a_global), 1e-9)


def unit(looked_at):
    """A sparse matrix, which may have been asked for its order."""
    matrix = sparse.csr_matrix((np.ones(2), np.arange(2), np.arange(3)))
    assert not looked_at or matrix.has_canonical_format
    return matrix


SAME = {
    "sparse matrices, one of which notes its order": (unit(False), unit(True)),
    "functions made again": (within(1.0), within(1.0)),
    "objects made again": (Called(1.0), Called(1.0)),
    "objects of classes made again": (of_a_class(1.0), of_a_class(1.0)),
    "integers and floats": (2, 2.0),
    "NumPy's numbers": (np.int64(2), 2),
    "truths": (np.bool_(True), True),
    "rounding": (1.0, 1.0 + 1e-15),
    "fractions": (Fraction(1, 2), 0.5),
    "lists and tuples": ([1.0], (1.0,)),
}


@pytest.mark.parametrize("what", SAME)
def test_the_same_is_the_same(what):
    one, other = SAME[what]
    assert fingerprint(one).same(fingerprint(other), 1e-9)


def test_what_contains_itself_ends(monkeypatch):
    monkeypatch.setattr("sbfem_petsc.ranks.fingerprint.LARGEST", 10_000)
    ring = [1.0]
    ring.append(ring)
    wide = [0.0]
    for _ in range(50):  # 2**50 ways through it
        wide = [wide, wide]
    assert fingerprint(ring).digest and fingerprint(wide).digest
