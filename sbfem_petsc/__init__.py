"""sbfem-petsc: scaled boundary finite elements with unilateral crack contact on PETSc and SLEPc.

Names are loaded when first used, so that a program can read its command line and hand PETSc's options over
(`sbfem_petsc.command_line`) before PETSc starts.
"""

from __future__ import annotations

import importlib

__version__ = "0.1.0"

_HOME = {
    "Material": "material",
    "OrthotropicMaterial": "material",
    "PointForce": "loads",
    "EdgeLoad": "loads",
    "SupportMotion": "loads",
    "Loads": "loads",
    "Support": "supports",
    "SolveError": "errors",
    "UnknownName": "errors",
    "Model": "system.model",
    "rayleigh_factors": "system.model",
    "modal": "analysis.modal",
    "Modal": "analysis.modal",
    "static": "analysis.static",
    "Static": "analysis.static",
    "transient": "analysis.transient",
    "Transient": "analysis.transient",
    "estimate_error": "analysis.transient",
    "StepWarning": "analysis.transient",
    "periodic": "analysis.periodic",
    "Orbit": "analysis.periodic",
    "frequency_response": "analysis.response",
    "load_response": "analysis.response",
    "Curve": "analysis.response",
    "CurveWarning": "analysis.response",
    "doubled": "analysis.branching",
    "backbone": "analysis.backbone",
    "Backbone": "analysis.backbone",
    "quasi_periodic": "analysis.quasi_periodic",
    "QuasiPeriodic": "analysis.quasi_periodic",
    "Reduction": "reduction",
    "reduce_matrices": "reduction",
    "read_history": "results.history",
    "save_curve": "results.curves",
    "read_curve": "results.curves",
    "save_orbit": "results.orbits",
    "read_orbit": "results.orbits",
    "write_animation": "results.animation",
    "Harmonic": "signals",
    "ToneBurst": "signals",
    "Chirp": "signals",
    "Step": "signals",
    "Samples": "signals",
    "Custom": "signals",
    "Constant": "signals",
    "on_root": "parallel",
}

__all__ = ["__version__", *_HOME]


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module 'sbfem_petsc' has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
