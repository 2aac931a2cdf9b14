"""Reduced models in HDF5."""

from __future__ import annotations

import h5py
import numpy as np

from ..contact.law import RowLaws, Table
from ..reduction.outputs import LinearOutput
from ..reduction.reduced_model import ReducedModel
from .hdf5 import put, put_texts
from .sound import numbers, texts, truth, whole
from .tip_facts import read_tip_facts, write_tip_facts

_ARRAYS = {
    "frequencies": ("Hz", "natural frequencies"),
    "damping": ("1", "modal damping ratios"),
    "initial_gap": ("m", "gaps of the contact rows, node pairs first"),
    "load_modes": ("N/sqrt(kg)", "unit loads in the modes"),
    "load_flexibility": ("m/N", "residual flexibility at the unit loads"),
    "translation": ("sqrt(kg)", "modal coordinates of a unit translation along x and y"),
}
_OUTPUTS = {
    "gap": "gaps of the contact rows",
    "points": "displacements of the named points",
    "tips": "K_I and K_II of the crack tips",
}
_TABLE = {
    "place": "gap that is kept",
    "least": "least force or free gap",
    "most": "largest force or free gap",
}
_SHARES = {
    "modes": "of modal coordinates",
    "loads": "of unit loads, residual",
    "contact": "of contact forces",
}


def write_reduced_model(group: h5py.Group, reduced: ReducedModel) -> None:
    """All arrays; the unit loads as texts, for information."""
    for name, (unit, description) in _ARRAYS.items():
        put(group, name, getattr(reduced, name), unit, description)
    for name, description in _OUTPUTS.items():
        output, part = getattr(reduced, name), group.create_group(name)
        put_texts(part, "names", output.names)
        for share, of in _SHARES.items():
            put(part, share, getattr(output, share), "SI", f"{description}, share {of}")
    laws = group.create_group("contact_laws")
    for name, values in reduced.contact_laws.table._asdict().items():
        put(laws, name, values, "SI", f"{_TABLE[name]}, of contact rows that are free, pressed, pulled")
    laws.attrs["dissipative"] = reduced.contact_laws.dissipative
    write_tip_facts(group.create_group("tip_facts"), reduced.tip_facts)
    group.attrs["pairs"] = reduced.pairs
    put_texts(group, "loads", [repr(load) for load in reduced.loads])


def read_reduced_model(group: h5py.Group) -> ReducedModel:
    """What `write_reduced_model` wrote: without a model, modes and loads as objects.

    Raises
    ------
    ValueError
        If its arrays do not fit together or hold what no reduced model has.
    """
    modes = len(numbers(group, "frequencies", None))
    rows, loads = len(numbers(group, "initial_gap", None)), numbers(group, "load_modes", modes, None).shape[1]
    if modes == 0:
        raise ValueError("'frequencies' is empty")
    arrays = {
        "frequencies": numbers(group, "frequencies", modes, least=0.0),
        "damping": numbers(group, "damping", modes, least=0.0),
        "initial_gap": numbers(group, "initial_gap", rows),
        "load_modes": numbers(group, "load_modes", modes, loads),
        "load_flexibility": numbers(group, "load_flexibility", loads, loads),
        "translation": numbers(group, "translation", modes, 2),
    }
    outputs = {}
    for name in _OUTPUTS:
        part = group[name]
        names = texts(part, "names")
        first = (rows,) if name == "gap" else (len(names), 2)
        shares = (numbers(part, share, *first, n) for share, n in zip(_SHARES, (modes, loads, rows)))
        outputs[name] = LinearOutput(names, *shares)
    part = group["contact_laws"]
    table = Table(*(numbers(part, name, 3, rows, finite=False) for name in _TABLE))
    if any(np.isnan(values).any() for values in table):  # bounds may be infinite
        raise ValueError("'contact_laws' has values that are no numbers")
    laws = RowLaws(table, truth(part, "dissipative"))
    pairs = whole(group, "pairs", most=rows)
    facts = read_tip_facts(group["tip_facts"], rows)
    if facts.names != outputs["tips"].names:
        raise ValueError(f"the tips are said to be {facts.names} and {outputs['tips'].names}")
    kept = {"contact_laws": laws, "tip_facts": facts}
    return ReducedModel(pairs=pairs, **kept, **arrays, **outputs)  # type: ignore[arg-type]
