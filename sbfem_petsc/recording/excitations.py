"""Periodic loads in files: their lines, and the jumps that these do not hold."""

from __future__ import annotations

from typing import Any

import h5py

from ..capacity import available_memory
from .hdf5 import put
from .sound import numbers

# Lines up to which motions over time are products with their waves, of so many bytes an instant and line; of
# more, Fourier transforms.
LINES, WAVES = 64, 64
_UNIT = "unit of the load"


def write_excitation(group: h5py.Group, excitation) -> None:
    """Write a `motion.excitation.Excitation`, but for its number of periods."""
    put(group, "orders", excitation.orders, "1", "multiples of f / periods in the loads")
    put(group, "amplitudes", excitation.amplitudes, _UNIT, "one-sided")
    if excitation.jumps is not None:
        put(group, "jumps/instants", excitation.jumps.instants, "1", "as shares of the common period")
        put(group, "jumps/sizes", excitation.jumps.sizes, _UNIT, "of the jumps")
    if excitation.further is not None:
        write_excitation(group.create_group("further"), excitation.further)


def read_excitation(group: h5py.Group, loads: int, steps: int) -> dict[str, Any]:
    """What `write_excitation` wrote, by the names of the fields, of so many loads: parts as dicts themselves.

    Raises
    ------
    ValueError
        If it does not fit together, or its motion in so many steps would not fit into memory.
    """
    orders = numbers(group, "orders", None, kinds="iu", least=0)
    found: dict[str, Any] = {"orders": orders}
    found["amplitudes"] = numbers(group, "amplitudes", len(orders), loads, kinds="c")
    if WAVES * steps * min(len(orders), LINES) > available_memory():
        raise ValueError(f"{steps} steps a period of {len(orders)} harmonics need more memory than is free")
    if "jumps" in group:
        instants = numbers(group, "jumps/instants", None, least=0.0)
        found["jumps"] = {"instants": instants, "sizes": numbers(group, "jumps/sizes", len(instants), loads)}
    if "further" in group:
        found["further"] = read_excitation(group["further"], loads, steps)
    return found
