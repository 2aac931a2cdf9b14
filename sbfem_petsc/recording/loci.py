"""Loci of bifurcations into files; `results.nonlinear` reads them."""

from __future__ import annotations

from typing import Any

import h5py

from .hdf5 import put

_LOCUS = {
    "frequency": ("Hz", "forcing frequency"),
    "value": ("1", "factor on the second parameter"),
    "states": ("m sqrt(kg)/s", "(Omega q, q') at t = 0"),
    "multiplier": ("1", "the one on the unit circle, nan for grazing"),
}


def write_locus_alone(file: h5py.File, line: Any) -> None:
    """Fill a result file with one `continuation.problems.locus.Locus`."""
    file.attrs["kind"], file.attrs["several"] = "loci", False
    write_locus(file.create_group("items/0000"), line)


def write_locus(group: h5py.Group, line: Any) -> None:
    """Fill a group with a locus."""
    group.attrs.update(
        {
            "kind": line.kind,
            "parameter": line.parameter,
            "periods": line.periods,
            "reason_begin": line.reasons[0],
            "reason_end": line.reasons[1],
        }
    )
    for name, (unit, meaning) in _LOCUS.items():
        put(group, name, getattr(line, name), unit, meaning)
