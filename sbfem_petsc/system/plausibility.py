"""Warnings of numbers that are finite and seldom meant: wave speeds of another unit, displacements that are
not small.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from meshing.warnings import LargeDisplacementWarning, UnitWarning

from ..errors import caller_level

# m/s, of sqrt(E / density): gels run at 50, diamond at 18,000
SLOWEST, FASTEST = 50.0, 20e3
# Share of the body beyond which displacements are not small.
LARGE = 0.05


def warn_of_wave_speeds(model: Any) -> None:
    """Warn on rank 0 of materials in which waves are slower or faster than in any that is known.

    Warns
    -----
    UnitWarning
    """
    for name, material in zip(model.material_names, model.materials):
        speed = math.sqrt(material.modulus / material.density)
        if model.comm.rank == 0 and not SLOWEST <= speed <= FASTEST:
            warnings.warn(
                f"Model: waves in the material {name!r} run at sqrt(E / density) = {speed:.3g} m/s, outside "
                f"of {SLOWEST:g} to {FASTEST:g} m/s, with E = {material.modulus:g} Pa and a density of "
                f"{material.density:g} kg/m^3; multiply MPa by 1e6, GPa by 1e9, g/cm^3 by 1e3, t/mm^3 by "
                "1e12",
                UnitWarning,
                stacklevel=caller_level(),
            )


def warn_of_motion(owner: str, model: Any, motion: Any) -> None:
    """`warn_if_large` of a history or an orbit at its named points; `model` may be a reduced one."""
    body = getattr(model, "model", model)
    if body is not None and motion.states.bound() > LARGE * _size(body):
        largest = [np.linalg.norm(motion.displacement(name), axis=-1).max() for name in motion.points]
        warn_if_large(owner, body, float(max(largest, default=0.0)))


def warn_of_amplitudes(owner: str, curve: Any) -> None:
    """`warn_if_large` of a curve at its named points."""
    largest = [float(curve.amplitude(name).max()) for name in curve.points]
    warn_if_large(owner, curve.reduced.model, max(largest, default=0.0))


def warn_if_large(owner: str, model: Any, largest: float) -> None:
    """Warn on rank 0 of displacements above 5 % of the body.

    Parameters
    ----------
    owner : str
        The analysis.
    model : Model or None
        None: the size of the body is not known.
    largest : float
        Largest displacement, m, the same on all ranks.

    Warns
    -----
    LargeDisplacementWarning
    """
    if model is None or model.comm.rank > 0:
        return
    size = _size(model)
    if largest > LARGE * size:
        warnings.warn(
            f"{owner}: displacements reach {largest:.3g} m, {100.0 * largest / size:.3g} % of the body's "
            f"{size:.3g} m, and the theory is that of small ones, below {LARGE:.0%}; check the units of "
            "loads (N for the model's thickness) and moduli (Pa), or give a smaller load or more damping",
            LargeDisplacementWarning,
            stacklevel=caller_level(),
        )


def _size(model: Any) -> float:
    return float(np.max(model.extent[1] - model.extent[0]))
