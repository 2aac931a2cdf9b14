"""Pictures of results: every function returns matplotlib's axes, and `save_picture` writes them."""

from __future__ import annotations

import importlib
from typing import Any

from ..working_directory import unread

try:
    with unread("matplotlibrc", "matplotlib"):
        import matplotlib  # noqa: F401 - the one place that says what is missing
except ImportError as error:  # pragma: no cover - depends on the machine
    raise ImportError(
        f"pictures need matplotlib ({error}); install it with `pip install 'sbfem-petsc[plot]'`"
    ) from error

_HOME = {
    "Panel": "histories",
    "animate_crack": "animation",
    "plot_backbone": "tones",
    "plot_basins": "basins",
    "plot_branches": "branches",
    "plot_contact": "fields",
    "plot_crack": "crack",
    "plot_detection": "detection",
    "plot_discretisation": "meshes",
    "plot_field": "bodies",
    "plot_friction_power": "rubbing",
    "plot_harmonics": "orbits",
    "plot_histories": "histories",
    "plot_history": "histories",
    "plot_hysteresis": "rubbing",
    "plot_lines": "tones",
    "plot_load_history": "histories",
    "plot_loci": "loci",
    "plot_losses": "rubbing",
    "plot_modes": "fields",
    "plot_multipliers": "orbits",
    "plot_orbit": "orbits",
    "plot_quasi_periodic": "tones",
    "plot_sidebands": "tones",
    "plot_slips": "rubbing",
    "plot_spectra": "histories",
    "plot_swept": "sweeps",
    "save_picture": "drawing",
    "save_pictures": "drawing",
}

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
