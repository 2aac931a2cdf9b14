"""Units in which values are written with few digits before and behind the point."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

Unit = tuple[float, str]
# Factors on values by their unit, and how large the largest value is to be drawn or told at least.
_OF: dict[str, tuple[float, tuple[Unit, ...]]] = {
    "m": (0.5, ((1.0, "m"), (1e3, "mm"), (1e6, "µm"), (1e9, "nm"))),
    "m/s": (0.5, ((1.0, "m/s"), (1e3, "mm/s"), (1e6, "µm/s"), (1e9, "nm/s"))),
    # drawings are read in mm up to 2 m
    "place": (2.0, ((1.0, "m"), (1e3, "mm"), (1e6, "µm"))),
    "N s": (0.5, ((1e-3, "kN s"), (1.0, "N s"), (1e3, "mN s"), (1e6, "µN s"))),
    "s": (1.0, ((1.0, "s"), (1e3, "ms"), (1e6, "µs"))),
    "Hz": (1.0, ((1e-6, "MHz"), (1e-3, "kHz"), (1.0, "Hz"))),
    "N": (1.0, ((1e-6, "MN"), (1e-3, "kN"), (1.0, "N"))),
    "Pa": (1.0, ((1e-9, "GPa"), (1e-6, "MPa"), (1e-3, "kPa"), (1.0, "Pa"))),
    "Pa m^(1/2)": (0.0, ((1e-6, "MPa m^(1/2)"),)),
}


def _largest(unit: str, top: float) -> Unit:
    """The largest unit, by factor and name, in which values up to `top` are large enough."""
    least, units = _OF[unit]
    return next((found for found in units if top * found[0] >= least), units[-1])


place_unit, frequency_unit = (functools.partial(_largest, unit) for unit in ("place", "Hz"))


def suited(unit: str, values: Any) -> Unit:
    """Factor and name for values of any unit; 1 and the unit itself where there is no other."""
    finite = np.asarray(values)
    top = float(np.abs(finite).max(initial=0.0, where=np.isfinite(finite)))
    return _largest(unit, top) if unit in _OF and top > 0.0 else (1.0, unit)
