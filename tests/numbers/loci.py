"""Bifurcations over two parameters, and grazing."""

from __future__ import annotations

import functools

import numpy as np

import sbfem_petsc as sb
from tests.numbers.table import Group
from tests.systems import one_mass, two_masses

GROUP = Group("loci", 1e-08, "1e-8: bifurcations, found by secants.")
TURN = 2.0 * np.pi


def of(locus):
    order = np.argsort(locus.value)
    yield "ends", [locus.value.min(), locus.value.max()]
    yield "at_ends", locus.frequency[order[[0, -1]]]
    yield "begin", np.abs(locus.multiplier[order[0]])


@functools.cache
def curve():
    return sb.frequency_response(two_masses(0.02, compliance=0.1), [0.1], 0.6 / TURN, 0.62 / TURN, steps=128)


@GROUP.case
def neimark_sacker():
    point = next(item for item in curve().bifurcations if item.kind == "Neimark-Sacker")
    yield "from", point.value
    yield from of(sb.locus(curve(), point, 0.97, 1.03))


@functools.cache
def folded():
    return sb.frequency_response(one_mass(1.0, 0.03), 0.15, 0.9 / TURN, 1.3 / TURN, steps=128)


@GROUP.case
def folds():
    for k, point in enumerate(item for item in folded().bifurcations if item.kind == "fold"):
        for name, *value in of(sb.locus(folded(), point, 0.9, 1.1, points=20)):
            yield f"{k + 1}.{name}", *value


@GROUP.case
def folds_over_damping():
    point = next(item for item in folded().bifurcations if item.kind == "fold")
    yield from of(sb.locus(folded(), point, 0.9, 1.1, parameter="damping", points=20))


@GROUP.case
def grazing():
    found = sb.grazing_points(folded())
    yield "count", len(found)
    yield "at", [item.value for item in found]
