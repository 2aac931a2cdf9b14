"""Periodic motions in HDF5."""

from __future__ import annotations

import os

from ..analysis.periodic import Orbit
from .curves import opened, replaced
from .reduction_file import read_reduction, write_reduction

FORMAT, FORMAT_VERSION = "sbfem-petsc orbit", 1
_ARRAYS = {
    "time": ("instants of one period", "s"),
    "modal_displacement": ("modal displacement q", "m sqrt(kg)"),
    "modal_velocity": ("dq/dt", "m sqrt(kg)/s"),
    "amplitudes": ("load signals", "unit of the loads"),
    "contact_force": ("contact forces, compression positive", "N"),
    "state": ("(Omega q, q') at t = 0", "m sqrt(kg)/s"),
    "multipliers": ("Floquet multipliers", ""),
}
_NUMBERS = ("frequency", "periods", "multiplier_error", "path", "step_error")


def save_orbit(orbit: Orbit, path: str) -> None:
    """Write a periodic motion, with displacement and harmonics of every named point for other programs; the
    file takes its name when it is whole.
    """
    with replaced(path) as file:
        file.attrs.update(
            {
                "format": FORMAT,
                "format_version": FORMAT_VERSION,
                **{name: getattr(orbit, name) for name in _NUMBERS},
                "residuals": orbit.residuals,
                "stable": str(orbit.stable),
            }
        )
        for name, (text, unit) in _ARRAYS.items():
            data = file.create_dataset(name, data=getattr(orbit, name))
            data.attrs["description"], data.attrs["unit"] = text, unit
        write_reduction(file.create_group("reduction"), orbit.reduction)
        for k, point in enumerate(orbit.reduction.points):
            group = file.create_group(f"points/{k:03d}")
            group.attrs["name"] = point
            for name, values in (
                ("displacement", orbit.displacement(point)),
                ("harmonics_x", orbit.harmonics(point, "x")),
                ("harmonics_y", orbit.harmonics(point, "y")),
            ):
                group.create_dataset(name, data=values).attrs["unit"] = "m"


def read_orbit(path: str) -> Orbit:
    """Read a periodic motion.

    Raises
    ------
    ValueError
        If the file is missing, truncated or of another kind.
    """
    with opened(os.fspath(path), "orbit", FORMAT, FORMAT_VERSION) as file:
        numbers = {name: file.attrs[name] for name in _NUMBERS}
        return Orbit(
            **{name: file[name][()] for name in _ARRAYS},
            reduction=read_reduction(file["reduction"]),
            frequency=float(numbers["frequency"]),
            periods=int(numbers["periods"]),
            multiplier_error=float(numbers["multiplier_error"]),
            path=str(numbers["path"]),
            step_error=float(numbers["step_error"]),
            residuals=tuple(float(r) for r in file.attrs["residuals"]),
        )
