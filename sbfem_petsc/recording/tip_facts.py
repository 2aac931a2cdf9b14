"""What the crack tips of a model are, in files that hold their stress intensity factors."""

from __future__ import annotations

import h5py
import numpy as np

from ..system.tip_facts import TipFacts
from .hdf5 import put, put_texts
from .sound import numbers, texts


def write_tip_facts(group: h5py.Group, facts: TipFacts) -> None:
    """Names, exponents, interfaces and contact rows, and the units that follow, for information."""
    put_texts(group, "names", facts.names)
    put_texts(group, "units", [facts.unit(name) for name in facts.names])
    put(group, "exponents", facts.exponents, "1", "of the displacement at the tips; K in Pa m^(1 - exponent)")
    put(group, "interfaces", facts.interfaces, "1", "whether several materials meet at the tip")
    put(group, "contact_rows", facts.contact_rows, "1", "first contact row of each tip's S-element, and all")


def read_tip_facts(group: h5py.Group, rows: int) -> TipFacts:
    """What `write_tip_facts` wrote, of a model with so many contact rows.

    Raises
    ------
    ValueError
        If it does not fit together.
    """
    names = texts(group, "names")
    first = numbers(group, "contact_rows", len(names) + 1, kinds="iu", least=0)
    if (np.diff(first) < 0).any() or first[-1] > rows:
        raise ValueError(f"'contact_rows' are not those of {rows} contact rows")
    return TipFacts(
        names,
        numbers(group, "exponents", len(names), 2),
        numbers(group, "interfaces", len(names), kinds="b"),
        first,
    )
