"""Warnings of numbers that are finite and seldom meant: wave speeds of another unit, displacements that are
not small.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from meshing.warnings import LargeDisplacementWarning, UnitWarning

from ...errors import warn
from .elements import Elements

# m/s, of sqrt(E / density): gels run at 50, diamond at 18,000
SLOWEST, FASTEST = 50.0, 20e3
# Share of the body beyond which displacements are not small.
LARGE = 0.05
# At which the lengths of sums of lines are looked at.
_PHASES = 2j * np.pi * np.arange(64) / 64


def warn_of_wave_speeds(elements: Elements) -> None:
    """Warn on rank 0 of materials in which waves are slower or faster than in any that is known.

    Warns
    -----
    UnitWarning
    """
    for name, material in zip(elements.layout.material_names, elements.materials):
        speed = math.sqrt(material.modulus / material.density)
        if elements.layout.comm.rank == 0 and not SLOWEST <= speed <= FASTEST:
            warn(
                f"Model: waves in the material {name!r} run at sqrt(E / density) = {speed:.3g} m/s, outside "
                f"of {SLOWEST:g} to {FASTEST:g} m/s, with E = {material.modulus:g} Pa and a density of "
                f"{material.density:g} kg/m^3; multiply MPa by 1e6, GPa by 1e9, g/cm^3 by 1e3, t/mm^3 by "
                "1e12",
                UnitWarning,
            )


def warn_if_large(owner: str, model: Any, result: Any) -> None:
    """Warn on rank 0 of a result, or several, in which displacements are above 5 % of the body. Collective.

    Parameters
    ----------
    owner : str
        The analysis.
    model : Model or None
        None: the size of the body is not known.
    result
        With a method ``_furthest(least)``: the largest displacement, m, or where that is known to be less
        than `least`, anything less. Others have no displacements.

    Warns
    -----
    LargeDisplacementWarning
    """
    if model is None:
        return
    size = float(np.max(model.extent[1] - model.extent[0]))
    found = [one for one in (result if isinstance(result, tuple) else (result,)) if hasattr(one, "_furthest")]
    largest = max((one._furthest(LARGE * size) for one in found), default=0.0)
    if model.comm.rank == 0 and largest > LARGE * size:
        warn(
            f"{owner}: displacements reach {largest:.3g} m, {100.0 * largest / size:.3g} % of the body's "
            f"{size:.3g} m, and the theory is that of small ones, below {LARGE:.0%}; check the units of "
            "loads (N for the model's thickness) and moduli (Pa), or give a smaller load or more damping",
            LargeDisplacementWarning,
        )


def furthest_of_lines(lines: np.ndarray, least: float) -> float:
    """The largest length of Re sum c_mn exp(i (m a + n b)) over all phases a and b, of (..., 2, k, l) lines
    of x and y, m from 0 on and n about 0; less than `least` where that is known to be so.
    """
    bound = np.linalg.norm(np.abs(lines).sum(axis=(-2, -1)), axis=-1)
    large = lines[bound >= least]
    if not len(large):
        return float(bound.max(initial=0.0))
    first, second = large.shape[2:]
    one = np.exp(_PHASES[:, None] * np.arange(first))
    two = np.exp(_PHASES[: None if second > 1 else 1, None] * (np.arange(second) - second // 2))
    return max(float(np.linalg.norm((one @ part @ two.T).real, axis=0).max()) for part in large)
