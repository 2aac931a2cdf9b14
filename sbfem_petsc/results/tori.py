"""Quasi-periodic motions and their branches in groups of files."""

from __future__ import annotations

from dataclasses import replace

import h5py

from ..continuation.problems.own_tone import OwnTone
from ..continuation.problems.own_tone_branch import QuasiPeriodicBranch
from ..continuation.problems.tones import QuasiPeriodic
from ..motion.excitation import Excitation
from ..motion.period_map import Period
from ..recording.excitations import read_excitation, write_excitation
from ..recording.hdf5 import put
from ..recording.reduced_models import read_reduced_model, write_reduced_model
from ..recording.sound import number, numbers, text, truth, whole
from ..reduction.reduced_model import ReducedModel

# Parameters of a branch.
PARAMETERS = ("frequency", "load")
# Most steps a period, samples.
MOST = 10**6


def write_torus(group: h5py.Group, motion: QuasiPeriodic) -> None:
    """A quasi-periodic motion with the reduced model and, where its second tone is its own, the map."""
    write_reduced_model(group.create_group("reduced_model"), motion.reduced)
    if motion.own is not None:
        _write_map(group.create_group("own"), motion.own)
    _write_curve(group, motion)


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


def write_torus_branch(group: h5py.Group, branch: QuasiPeriodicBranch) -> None:
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


def torus_branch_in(group: h5py.Group) -> QuasiPeriodicBranch:
    """What `write_torus_branch` wrote.

    Raises
    ------
    ValueError
        If it does not fit together.
    """
    reduced = read_reduced_model(group["reduced_model"])
    own = _map_in(group["own"], reduced)
    motions = tuple(_curve_in(group["motions"][name], reduced, own) for name in sorted(group["motions"]))
    value, parameter = numbers(group, "value", len(motions), least=1e-300), text(group, "parameter")
    if not motions or parameter != own.parameter:
        raise ValueError(f"it is over {parameter!r} and has {len(motions)} motions")
    return QuasiPeriodicBranch(parameter, value, motions, text(group, "reason"), truth(group, "complete"))


def _unit(parameter: str) -> str:
    return "Hz" if parameter == "frequency" else "1"


def _write_curve(group: h5py.Group, motion: QuasiPeriodic) -> None:
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


def _write_map(group: h5py.Group, own: OwnTone) -> None:
    """The map of a motion with a tone of its own."""
    period = own.period
    group.attrs.update(
        {
            "parameter": own.parameter,
            "fixed_frequency": own.frequency or 0.0,
            "steps": period.steps,
            "periods": period.excitation.periods,
            "contact": period.pairs > 0,
        }
    )
    write_excitation(group, period.excitation)


def _map_in(group: h5py.Group, reduced: ReducedModel) -> OwnTone:
    periods, steps = whole(group, "periods", least=1, most=10**7), whole(group, "steps", least=1, most=10**9)
    excitation = Excitation.of_file(periods, **read_excitation(group, reduced.load_modes.shape[1], steps))
    parameter = text(group, "parameter")
    frequency = number(group, "fixed_frequency", least=0.0) or None
    if parameter not in PARAMETERS or (parameter == "load") != (frequency is not None):
        raise ValueError(f"it is over {parameter!r} at a fixed frequency of {frequency} Hz")
    period = Period(reduced, excitation, steps, truth(group, "contact"))
    return OwnTone(period, parameter, frequency, 3, reduced.comm)
