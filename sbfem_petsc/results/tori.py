"""Quasi-periodic motions and their branches from groups of files that `recording.tori` writes."""

from __future__ import annotations

from dataclasses import replace

import h5py

from ..continuation.problems.curve_branch import QuasiPeriodicBranch
from ..continuation.problems.own_tone import OwnTone
from ..continuation.problems.tones import QuasiPeriodic
from ..motion.excitation import Excitation
from ..motion.period_map import Period
from ..recording.excitations import read_excitation
from ..recording.reduced_models import read_reduced_model
from ..recording.sound import number, numbers, text, truth, whole
from ..reduction.reduced_model import ReducedModel

# Parameters of a branch.
PARAMETERS = ("frequency", "load", "damping", "gap")
# Most steps a period, samples.
MOST = 10**6


def torus_in(group: h5py.Group) -> QuasiPeriodic:
    """What `write_torus` wrote.

    Raises
    ------
    ValueError
        If it does not fit together.
    """
    reduced = read_reduced_model(group["reduced_model"])
    own = _map_in(group["own"], reduced) if "own" in group else None
    return _curve_in(group, reduced, own)


def torus_branch_in(group: h5py.Group) -> QuasiPeriodicBranch:
    """What `write_torus_branch` wrote.

    Raises
    ------
    ValueError
        If it does not fit together.
    """
    reduced = read_reduced_model(group["reduced_model"])
    own = _map_in(group["own"], reduced)
    names, parameter = sorted(group["motions"]), text(group, "parameter")
    value = numbers(group, "value", len(names), least=1e-300)
    motions = tuple(
        _curve_in(group["motions"][name], reduced, own.at(at)) for name, at in zip(names, value.tolist())
    )
    if not motions or parameter != own.parameter:
        raise ValueError(f"it is over {parameter!r} and has {len(motions)} motions")
    return QuasiPeriodicBranch(parameter, value, motions, text(group, "reason"), truth(group, "complete"))


def _curve_in(group: h5py.Group, reduced: ReducedModel, own: OwnTone | None) -> QuasiPeriodic:
    samples = whole(group, "samples", least=3, most=MOST)
    lines = numbers(group, "lines", None, None, len(reduced.points.names), 2, kinds="c")
    if lines.shape[1] != 2 * (samples // 2) + 1 or not len(lines):
        raise ValueError(f"'lines' is of shape {lines.shape}, {samples} samples give another one")
    pair = numbers(group, "frequencies", 2, least=1e-300)
    return QuasiPeriodic(
        frequencies=(float(pair[0]), float(pair[1])),
        samples=samples,
        steps=whole(group, "steps", least=1, most=MOST),
        reduced=reduced,
        states=numbers(group, "states", samples, 2 * len(reduced.omega)),
        residuals=tuple(numbers(group, "residuals", None).tolist()),
        exponents=numbers(group, "exponents", None, finite=False),
        contact_peak=number(group, "contact_peak", least=0.0),
        _lines=lines,
        _swapped=truth(group, "swapped"),
        load_factor=number(group, "load_factor", least=0.0),
        own=None if own is None else replace(own, samples=samples),
    )


def _map_in(group: h5py.Group, reduced: ReducedModel) -> OwnTone:
    periods, steps = whole(group, "periods", least=1, most=10**7), whole(group, "steps", least=1, most=10**9)
    excitation = Excitation.of_file(periods, **read_excitation(group, reduced.load_modes.shape[1], steps))
    parameter = text(group, "parameter")
    frequency = number(group, "fixed_frequency", least=0.0) or None
    if parameter not in PARAMETERS or (parameter != "frequency") != (frequency is not None):
        raise ValueError(f"it is over {parameter!r} at a fixed frequency of {frequency} Hz")
    period = Period(reduced, excitation, steps, truth(group, "contact"))
    factors = {name: number(group, name, least=0.0) for name in PARAMETERS[1:]}
    return OwnTone(period, parameter, frequency, 3, reduced.comm, **factors)
