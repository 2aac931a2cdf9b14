"""Periodic motions in files, of reduced and of unreduced models."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from ..checks import shown
from ..continuation.orbit import Orbit
from ..motion.states import ModalStates, SampledStates
from ..recording.hdf5 import new_hdf5, opened, put, put_texts
from ..recording.reduced_models import read_reduced_model, write_reduced_model
from ..recording.sound import number, numbers, text, texts, truth, whole
from ..recording.tip_facts import read_tip_facts, write_tip_facts

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
    "intensities": ("Pa m^(1 - exponent)", "K_I and K_II of a crack tip, see tip_facts"),
}
_OWN = {
    "time": ("s", "instants of one period"),
    "state": ("m sqrt(kg)/s", "(Omega q, q') at t = 0"),
    "multipliers": ("1", "Floquet multipliers"),
    "residuals": ("m sqrt(kg)/s", "norm of x(T) - x(0) at each Newton iterate"),
}
_NUMBERS = (
    "frequency",
    "periods",
    "path",
    "multiplier_error",
    "products",
    "converged",
    "step_error",
)


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
        write_orbit(file, orbit)


def read_orbit(path: str) -> Orbit:
    """Read a periodic motion.

    Raises
    ------
    TypeError, ValueError
        If the file is missing, truncated, damaged or of another kind.
    """
    with opened(path, WHAT, {FORM: VERSION}) as file:
        return orbit_in(file)


def write_orbit(group: h5py.Group, orbit: Orbit) -> None:
    """A periodic motion in a group of its own."""
    group.attrs.update({name: getattr(orbit, name) for name in _NUMBERS})
    group.attrs["stable"] = str(orbit.stable)
    put_texts(group, "notes", orbit.notes)
    for name, (unit, meaning) in _OWN.items():
        put(group, name, getattr(orbit, name), unit, meaning)
    _write_states(group.create_group("states"), orbit.states)
    for k, point in enumerate(orbit.points):
        part = group.create_group(f"points/{k:03d}")
        part.attrs["name"] = point
        put(part, "displacement", orbit.displacement(point), "m", "u_x and u_y")
        for axis in "xy":
            put(part, f"harmonics_{axis}", orbit.harmonics(point, axis), "m", f"of u_{axis}, one-sided")


def orbit_in(group: h5py.Group) -> Orbit:
    """What `write_orbit` wrote.

    Raises
    ------
    ValueError
        If it does not fit together.
    """
    time = numbers(group, "time", None)
    if not len(time) or (np.diff(time) <= 0.0).any():
        raise ValueError("'time' does not rise")
    states = _read_states(group["states"], len(time))
    size = 2 * states.q.shape[1] if isinstance(states, ModalStates) else 0
    residuals = numbers(group, "residuals", None)
    return Orbit(
        time=time,
        states=states,
        state=numbers(group, "state", size),
        multipliers=numbers(group, "multipliers", None, kinds="fc"),
        residuals=tuple(residuals.tolist()),
        frequency=number(group, "frequency", least=1e-300),
        periods=whole(group, "periods", least=1, most=len(time)),
        path=text(group, "path"),
        uncertainty=number(group, "multiplier_error", finite=False),
        products=whole(group, "products"),
        converged=truth(group, "converged"),
        step_error=number(group, "step_error", finite=False),
    )


def _write_states(group: h5py.Group, states: ModalStates | SampledStates) -> None:
    modal = isinstance(states, ModalStates)
    group.attrs["kind"] = "modal" if modal else "sampled"
    for name, (unit, meaning) in (_MODAL if modal else _SAMPLED).items():
        put(group, name, getattr(states, name), unit, meaning)
    if isinstance(states, ModalStates):
        write_reduced_model(group.create_group("reduced_model"), states.reduced)
        return
    group.attrs["pairs"] = states.pairs
    for name, (unit, meaning) in _SAMPLES.items():
        table, part = getattr(states, name), group.create_group(name)
        put_texts(part, "names", tuple(table))
        for k, values in enumerate(table.values()):
            put(part, f"{k:03d}", values, unit, meaning)
    write_tip_facts(group.create_group("tip_facts"), states.tip_facts)


def _read_states(group: h5py.Group, instants: int) -> ModalStates | SampledStates:
    if text(group, "kind") == "modal":
        reduced = read_reduced_model(group["reduced_model"])
        modes, loads = reduced.load_modes.shape
        lengths = {"q": modes, "v": modes, "amplitudes": loads, "contact": len(reduced.initial_gap)}
        arrays = {name: numbers(group, name, instants, length) for name, length in lengths.items()}
        return ModalStates(**arrays, reduced=reduced)
    tables: dict[str, Any] = {}
    for name in _SAMPLES:
        part = group[name]
        keys = texts(part, "names")
        tables[name] = {key: numbers(part, f"{k:03d}", instants, 2) for k, key in enumerate(keys)}
    rows = numbers(group, "contact", instants, None)
    gap = numbers(group, "gap", *rows.shape)
    facts = read_tip_facts(group["tip_facts"], rows.shape[1])
    if facts.names != tuple(tables["intensities"]):
        raise ValueError(f"the tips are said to be {facts.names} and {tuple(tables['intensities'])}")
    pairs = whole(group, "pairs", most=rows.shape[1])
    return SampledStates(**tables, contact=rows, gap=gap, pairs=pairs, tip_facts=facts)
