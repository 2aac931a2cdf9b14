"""Chains of springs between 1 and 1e14 N/m: frequencies beside exact arithmetic, and what rounding takes."""

import warnings
from fractions import Fraction

import numpy as np
import pytest
from scipy import sparse

import sbfem_petsc as sb
from meshing.warnings import RoundOffWarning

DECADES = [10.0**k for k in range(0, 15, 2)]


def stiffness(springs):
    """Of masses in a row, the first one held by the first spring."""
    result = np.diag(springs) + np.diag([*springs[1:], 0.0])
    return result - np.diag(springs[1:], 1) - np.diag(springs[1:], -1)


def below(springs, value):
    """Squares of frequencies of unit masses below one, by the signs of pivots, without any rounding."""
    count, pivot, matrix = 0, Fraction(1), stiffness(springs)
    for row in range(len(springs)):
        off = Fraction(matrix[row, row - 1]) if row else Fraction(0)
        pivot = Fraction(matrix[row, row]) - Fraction(value) - off**2 / pivot
        count += pivot < 0
    return count


def reduced(matrix, kind, modes=None):
    """All modes but one by default."""
    n = len(matrix)
    return sb.reduce_matrices(
        kind(np.eye(n)),
        kind(matrix),
        np.zeros((0, n)),
        np.zeros(0),
        loads=np.eye(n)[:, :1],
        sensors={"1": 0},
        modes=modes or n - 1,
    )


def told(springs, kind, factor=1.0, modes=None):
    """The frequencies, rad/s, and sentences on rounding."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        omega = reduced(factor * stiffness(springs), kind, modes).omega
    return omega, [str(item.message) for item in found if issubclass(item.category, RoundOffWarning)]


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_matrix])
def test_softer_from_the_ground_on(kind):
    """Round-off in the highest ones had been 3e-7 where the matrices are dense."""
    omega, warned = told(DECADES[::-1], kind)
    for place, value in enumerate(omega):
        assert below(DECADES[::-1], (value * (1.0 - 1e-10)) ** 2) == place
        assert below(DECADES[::-1], (value * (1.0 + 1e-10)) ** 2) == place + 1
    assert not warned


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_matrix])
def test_stiffer_from_the_ground_on(kind):
    """Rounding of 1e14, some .02, is a fifth of the lowest square, .124, of which 0 had been told without a
    word, and where the matrices are dense also of the next one, of 10.7 rad/s.
    """
    omega, warned = told(DECADES, kind)
    for place, value in enumerate(omega[1:], start=1):
        assert below(DECADES, (value * (1.0 - 1e-5)) ** 2) == place
        assert below(DECADES, (value * (1.0 + 1e-5)) ** 2) == place + 1
    assert len(warned) == 1 and "mode 1, told at 0 Hz, at up to" in warned[0]
    most = 2.0 * np.pi * float(warned[0].split("at up to ")[1].split()[0])
    assert below(DECADES, most**2) == 1 and below(DECADES, (most / 4.0) ** 2) == 0


def test_lowest_mode_alone():
    """It had been told at 0 without a word where none that vibrates is kept; that of free chains is at 0."""
    omega, warned = told(DECADES, np.asarray, modes=1)
    assert omega.tolist() == [0.0] and "mode 1, told at 0 Hz, at up to 0.059" in warned[0]
    for factor in (1.0, 1.0 - 3e-13 * np.eye(21)):
        omega, warned = told([0.0, *[1e6] * 20], np.asarray, factor, modes=1)
        assert omega.tolist() == [0.0] and not warned


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_matrix])
def test_free_chains_are_not_warned_of(kind):
    springs = [0.0, *[1.0] * 200]
    omega, warned = told(springs, kind)
    exact = 2.0 * np.sin(0.5 * np.pi * np.arange(200) / 201)
    np.testing.assert_allclose(omega, exact, rtol=1e-9, atol=1e-12)
    assert omega[0] == 0.0 and not warned


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_matrix])
def test_free_chains_of_fewer_digits_are_free(kind):
    """As superelements and files give them: 3e-13 of the diagonal less had been told to be indefinite where
    the matrices are dense.
    """
    springs = [0.0, *[1e6] * 20]
    omega, warned = told(springs, kind, 1.0 - 3e-13 * np.eye(21))
    exact = 2e3 * np.sin(0.5 * np.pi * np.arange(20) / 21)
    np.testing.assert_allclose(omega, exact, rtol=1e-9, atol=1e-9)
    assert omega[0] == 0.0 and not warned
