"""Periodic motions in files, of reduced and of unreduced models."""

from __future__ import annotations

from typing import Any

import h5py

from ..checks import shown
from ..dynamics.orbit import Orbit
from ..dynamics.states import ModalStates, SampledStates
from ..recording.hdf5 import new_hdf5, opened, put, put_texts
from ..recording.reduced_models import read_reduced_model, write_reduced_model

WHAT, FORM, VERSION = "orbit file", "sbfem-petsc orbit", 2

_MODAL = {
    "q": ("m sqrt(kg)", "modal coordinates"),
    "v": ("m sqrt(kg)/s", "their derivatives"),
    "amplitudes": ("unit of the load", "load signals"),
    "contact": ("N", "forces of the contact rows, compression positive"),
}
_SAMPLED = {
    "contact": ("N", "forces of the contact rows, compression positive"),
    "gap": ("m", "gaps of the contact rows"),
}
# Data of the named points and tips, by their names in `SampledStates`.
_SAMPLES = {
    "displacements": ("m", "displacement of a named point"),
    "velocities": ("m/s", "velocity of a named point"),
    "accelerations": ("m/s^2", "acceleration of a named point"),
    "intensities": ("Pa m^(1/2)", "K_I and K_II of a crack tip"),
}
_OWN = {
    "time": ("s", "instants of one period"),
    "state": ("m sqrt(kg)/s", "(Omega q, q') at t = 0"),
    "multipliers": ("1", "Floquet multipliers"),
    "residuals": ("m sqrt(kg)/s", "norm of x(T) - x(0) at each Newton iterate"),
}
_NUMBERS = {
    "frequency": float,
    "periods": int,
    "path": str,
    "multiplier_error": float,
    "products": int,
    "converged": bool,
    "step_error": float,
}


def save_orbit(orbit: Orbit, path: str) -> None:
    """Write a periodic motion, with displacement and harmonics of every named point for other programs; the
    file takes its name when it is whole.

    Raises
    ------
    TypeError, ValueError
        If it cannot be written.
    """
    if not isinstance(orbit, Orbit):
        raise TypeError(f"save_orbit: orbit = {shown(orbit)} is not an Orbit")
    with new_hdf5(path, WHAT, FORM, VERSION) as file:
        file.attrs.update({name: getattr(orbit, name) for name in _NUMBERS})
        file.attrs["stable"] = str(orbit.stable)
        for name, (unit, text) in _OWN.items():
            put(file, name, getattr(orbit, name), unit, text)
        _write_states(file.create_group("states"), orbit.states)
        for k, point in enumerate(orbit.points):
            group = file.create_group(f"points/{k:03d}")
            group.attrs["name"] = point
            put(group, "displacement", orbit.displacement(point), "m", "u_x and u_y")
            for axis in "xy":
                put(group, f"harmonics_{axis}", orbit.harmonics(point, axis), "m", f"of u_{axis}, one-sided")


def read_orbit(path: str) -> Orbit:
    """Read a periodic motion.

    Raises
    ------
    TypeError, ValueError
        If the file is missing, truncated, damaged or of another kind.
    """
    with opened(path, WHAT, {FORM: VERSION}) as file:
        own = {name: file[name][()] for name in _OWN}
        numbers = {name: kind(file.attrs[name]) for name, kind in _NUMBERS.items()}
        residuals = tuple(own.pop("residuals").tolist())
        uncertainty = numbers.pop("multiplier_error")
        states = _read_states(file["states"])
        return Orbit(states=states, residuals=residuals, uncertainty=uncertainty, **own, **numbers)


def _write_states(group: h5py.Group, states: ModalStates | SampledStates) -> None:
    modal = isinstance(states, ModalStates)
    group.attrs["kind"] = "modal" if modal else "sampled"
    for name, (unit, text) in (_MODAL if modal else _SAMPLED).items():
        put(group, name, getattr(states, name), unit, text)
    if isinstance(states, ModalStates):
        write_reduced_model(group.create_group("reduced_model"), states.reduced)
        return
    group.attrs["pairs"] = states.pairs
    for name, (unit, text) in _SAMPLES.items():
        table, part = getattr(states, name), group.create_group(name)
        put_texts(part, "names", tuple(table))
        for k, values in enumerate(table.values()):
            put(part, f"{k:03d}", values, unit, text)


def _read_states(group: h5py.Group) -> ModalStates | SampledStates:
    if group.attrs["kind"] == "modal":
        arrays = {name: group[name][()] for name in _MODAL}
        return ModalStates(**arrays, reduced=read_reduced_model(group["reduced_model"]))
    tables: dict[str, Any] = {
        name: {str(key): group[name][f"{k:03d}"][()] for k, key in enumerate(group[name].attrs["names"])}
        for name in _SAMPLES
    }
    arrays = {name: group[name][()] for name in _SAMPLED}
    return SampledStates(**tables, **arrays, pairs=int(group.attrs["pairs"]))
