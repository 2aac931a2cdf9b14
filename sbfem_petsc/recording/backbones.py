"""Backbones into files; `results.nonlinear` reads them."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from .hdf5 import put
from .reduced_models import write_reduced_model

_BACKBONE = {
    "energy": ("J", "energy of the motion"),
    "frequency": ("Hz", "its frequency"),
    "frequency_error": ("Hz", "estimate, nan where there is none"),
    "damping_ratio": ("1", "its damping ratio by the rate of decay"),
    "damping_error": ("1", "estimate, nan where there is none"),
    "energy_damping_ratio": ("1", "its damping ratio by the energy"),
    "energy_damping_error": ("1", "estimate, nan where there is none"),
    "states": ("m sqrt(kg)/s", "(Omega q, q') at t = 0"),
    "multipliers": ("1", "Floquet multipliers"),
    "point_harmonics": ("m", "harmonics 0 to 20 of the points' displacements, (n, points, xy, k)"),
    "point_amplitudes": ("m", "half the peak-to-peak of u_y"),
    "stable": ("1", "whether no multiplier is outside the unit circle"),
}


def write_backbone_alone(file: h5py.File, found: Any) -> None:
    """Fill a result file with one `analysis.backbone.Backbone`."""
    file.attrs["kind"], file.attrs["several"] = "backbone", False
    write_backbone(file, found)


def write_backbone(group: h5py.Group, found: Any) -> None:
    """Fill a group with a backbone."""
    group.attrs.update(
        {
            "mode": found.mode,
            "steps": found._system.steps,
            "damped": bool(found.damped),
            "complete": bool(found.complete),
            "reason": found.reason,
        }
    )
    for name, (unit, meaning) in _BACKBONE.items():
        put(group, name, getattr(found, name), unit, meaning)
    put(group, "passed", np.reshape(found.passed, (-1, 2)), "J", "energies beside interactions passed over")
    for k, event in enumerate(found.events):
        part = group.create_group(f"events/{k:03d}")
        part.attrs.update(event._asdict())
    put(group, "excitation", found._excitation, "1/s", "self-excitation that makes up for damping")
    put(group, "own_frequency", found._own_frequency, "Hz", "that of the steps")
    write_reduced_model(group.create_group("reduced_model"), found.reduced)
