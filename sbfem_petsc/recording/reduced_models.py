"""Reduced models in HDF5, and whether two of them are of the same structure and loads."""

from __future__ import annotations

from dataclasses import fields, replace

import h5py
import numpy as np

from ..contact.law import RowLaws, Table
from ..reduction.outputs import LinearOutput
from ..reduction.reduced_model import ReducedModel
from .hdf5 import put, put_texts
from .sound import numbers, texts, truth, whole
from .tip_facts import read_tip_facts, write_tip_facts

# Relative differences of the same model on other numbers of ranks.
SAME = 1e-5

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


def in_rows(reduced: ReducedModel) -> ReducedModel:
    """The same with all arrays contiguous, row by row, as they come from a file: BLAS rounds products of
    others differently.
    """

    def rows(item):
        if isinstance(item, np.ndarray):
            return np.ascontiguousarray(item)
        if isinstance(item, LinearOutput):
            return LinearOutput(item.names, *(np.ascontiguousarray(getattr(item, s)) for s in _SHARES))
        return item

    return replace(reduced, **{f.name: rows(getattr(reduced, f.name)) for f in fields(reduced)})


def difference(one: ReducedModel, other: ReducedModel) -> str:
    """What tells two reduced models apart, "" if nothing; signs of modes and rounding by other numbers of
    ranks do not.
    """
    if one.points.names != other.points.names or one.tips.names != other.tips.names:
        return "its points or cracks differ"
    for text, a, b in (
        ("modes", one.omega, other.omega),
        ("contact rows", one.initial_gap, other.initial_gap),
        ("loads", one.load_modes.T, other.load_modes.T),
    ):
        if len(a) != len(b):
            return f"{len(a)} {text}, not {len(b)}"
    if not np.allclose(
        one.frequencies, other.frequencies, rtol=SAME, atol=SAME * other.frequencies[-1] * 1e-3
    ):
        worst = int(np.argmax(np.abs(one.frequencies - other.frequencies)))
        return (
            f"frequency {worst + 1} is {one.frequencies[worst]:.7g} Hz, not {other.frequencies[worst]:.7g} Hz"
        )
    if not one.contact_laws.same(other.contact_laws):
        return "its contact laws differ"
    if not close(one.damping, other.damping):
        return "its damping differs"
    # static compliances, modes and residual together: the same whatever the signs of the modes
    for text, of in (
        ("initial gaps", lambda r: r.initial_gap),
        ("contact rows' compliance", lambda r: _compliance(r.gap.modes, r.omega) + r.gap.contact),
        ("loads' compliance", lambda r: _compliance(r.load_modes.T, r.omega) + r.load_flexibility),
        ("loads on the pairs", lambda r: _compliance(r.gap.modes, r.omega, r.load_modes.T) + r.gap.loads),
    ):
        if not close(of(one), of(other)):
            return f"its {text} differ"
    return ""


def adopted(stored: ReducedModel, given: ReducedModel) -> ReducedModel:
    """A reduced model from a file with the model, modes and loads of an equal one that was made anew.

    Modes whose sign another solve has turned round are turned back; where they cannot be (multiple
    frequencies) the result has no model, and so no fields.
    """
    if given.model is None or given.modal is None:
        return replace(stored, loads=given.loads)

    def seen(r: ReducedModel) -> np.ndarray:
        """What of the modes does not depend on where they are computed."""
        parts = (r.points.modes, r.gap.modes, r.load_modes.T, r.translation.T)
        flat = [part.reshape(-1, len(r.omega)) for part in parts]
        return np.concatenate([part / max(np.abs(part).max(initial=0.0), 1e-300) for part in flat])

    mine, other = seen(stored), seen(given)
    signs = np.where((mine * other).sum(axis=0) < 0.0, -1.0, 1.0)
    if not close(signs * other, mine):
        return replace(stored, loads=given.loads)
    modal = replace(
        given.modal,
        shapes=given.modal.shapes * signs,
        point_shapes={name: shape * signs[:, None] for name, shape in given.modal.point_shapes.items()},
        auxiliary_inertia=given.modal.auxiliary_inertia * signs[:, None],
    )
    return replace(stored, loads=given.loads, model=given.model, modal=modal)


def close(one, other) -> bool:
    """Whether two settings are the same: numbers to 1e-9, arrays to `SAME` of their largest value."""
    if isinstance(one, str) or isinstance(other, str):
        return bool(one == other)
    one, other = 1.0 * np.asarray(one), 1.0 * np.asarray(other)
    scale = SAME * np.abs(other).max(initial=0.0) if one.ndim else 0.0
    return one.shape == other.shape and bool(
        np.allclose(one, other, rtol=1e-9 if one.ndim == 0 else SAME, atol=scale)
    )


def _compliance(left: np.ndarray, omega: np.ndarray, right: np.ndarray | None = None) -> np.ndarray:
    elastic = omega > 1e-6 * omega[-1]
    return (left[:, elastic] / omega[elastic] ** 2) @ (left if right is None else right)[:, elastic].T
