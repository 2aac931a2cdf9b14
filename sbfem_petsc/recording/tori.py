"""Quasi-periodic motions and their branches into groups of files; `results.tori` reads them."""

from __future__ import annotations

from typing import Any

import h5py

from .excitations import write_excitation
from .hdf5 import put
from .reduced_models import write_reduced_model


def write_torus_branch_alone(file: h5py.File, branch: Any) -> None:
    """Fill a result file with one `continuation.problems.curve_branch.QuasiPeriodicBranch`."""
    file.attrs["kind"], file.attrs["several"] = "quasi-periodic branch", False
    write_torus_branch(file, branch)


def write_torus(group: h5py.Group, motion: Any) -> None:
    """A quasi-periodic motion with the reduced model and, where its second tone is its own, the map."""
    write_reduced_model(group.create_group("reduced_model"), motion.reduced)
    if motion.own is not None:
        _write_map(group.create_group("own"), motion.own)
    _write_curve(group, motion)


def write_torus_branch(group: h5py.Group, branch: Any) -> None:
    """A branch of motions with a tone of their own, which share their map."""
    first = branch.motions[0]
    assert first.own is not None  # those of a branch have one
    group.attrs.update(
        {"parameter": branch.parameter, "reason": branch.reason, "complete": bool(branch.complete)}
    )
    put(group, "value", branch.value, _unit(branch.parameter), "forcing frequency, or factor on the load")
    put(group, "stable", branch.stable, "1", "whether small disturbances die out")
    write_reduced_model(group.create_group("reduced_model"), first.reduced)
    _write_map(group.create_group("own"), first.own)
    for k, motion in enumerate(branch.motions):
        _write_curve(group.create_group(f"motions/{k:04d}"), motion)


def _unit(parameter: str) -> str:
    return "Hz" if parameter == "frequency" else "1"


def _write_curve(group: h5py.Group, motion: Any) -> None:
    group.attrs.update(
        {
            "samples": motion.samples,
            "steps": motion.steps,
            "contact_peak": motion.contact_peak,
            "load_factor": motion.load_factor,
            "swapped": motion._swapped,
            "stable": str(motion.stable),
        }
    )
    put(group, "frequencies", motion.frequencies, "Hz", "both tones")
    put(group, "states", motion.states, "m sqrt(kg)/s", "(Omega q, q') less the linear response, by phase")
    put(group, "residuals", motion.residuals, "1", "of Newton's method, relative to the linear response")
    put(group, "exponents", motion.exponents, "1/s", "largest Lyapunov exponents")
    put(
        group,
        "lines",
        motion._lines,
        "m",
        "multiples of the faster tone from 0, of the slower one about 0, points, xy",
    )


def _write_map(group: h5py.Group, own: Any) -> None:
    """The map of a motion with a tone of its own."""
    period = own.period
    group.attrs.update(
        {
            "parameter": own.parameter,
            "fixed_frequency": own.frequency or 0.0,
            "steps": period.steps,
            "periods": period.excitation.periods,
            "contact": period.pairs > 0,
            "load": own.load,
            "damping": own.damping,
            "gap": own.gap,
        }
    )
    write_excitation(group, period.excitation)
