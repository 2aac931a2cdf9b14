"""Results of nonlinear vibration in files: backbones, loci, basins, swept responses, quasi-periodic
motions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import h5py

from ..analysis.backbone import Backbone
from ..checks import shown
from ..continuation.line_file import FORM, VERSION, WHAT
from ..continuation.problems.curve_branch import QuasiPeriodicBranch
from ..continuation.problems.free import FreeSystem
from ..continuation.problems.free_stability import KINDS as FREE_KINDS
from ..continuation.problems.free_stability import FreeEvent
from ..continuation.problems.locus import KINDS, PARAMETERS, Locus
from ..continuation.problems.tones import QuasiPeriodic
from ..recording.backbones import write_backbone
from ..recording.hdf5 import new_hdf5, opened
from ..recording.loci import write_locus
from ..recording.reduced_models import read_reduced_model
from ..recording.sound import number, numbers, text, truth, whole
from ..recording.tori import write_torus, write_torus_branch
from .tori import torus_branch_in, torus_in

# Kinds of which a file may hold several.
LISTED = ("loci",)
# Most points of a branch.
MOST = 10**9


def save_result(result: Any, path: str) -> None:
    """Write a result of nonlinear vibration; the file takes its name when it is whole.

    Parameters
    ----------
    result : Backbone, Locus, QuasiPeriodic or QuasiPeriodicBranch
        Or a sequence of Locus.
    path : str

    Raises
    ------
    TypeError, ValueError
        If it cannot be written.
    """
    items = list(result) if isinstance(result, (list, tuple)) else [result]
    several = isinstance(result, (list, tuple))
    fits = [
        kind
        for kind, (of, *_) in _KINDS.items()
        if all(isinstance(item, of) for item in items) and (not several or kind in LISTED)
    ]
    if not fits:
        raise TypeError(
            f"save_result: result = {shown(result)} must be a Backbone, Locus, QuasiPeriodic or "
            "QuasiPeriodicBranch, or several Locus"
        )
    kind = fits[0]
    write = _KINDS[kind][1]
    with new_hdf5(path, WHAT, FORM, VERSION) as file:
        file.attrs["kind"], file.attrs["several"] = kind, several
        if kind in LISTED:
            group = file.create_group("items")
            for k, item in enumerate(items):
                write(group.create_group(f"{k:04d}"), item)
        else:
            write(file, result)
    return None


def read_result(path: str) -> Any:
    """Read what `save_result` wrote.

    Returns
    -------
    Backbone, Locus, QuasiPeriodic, QuasiPeriodicBranch, or a tuple

    Raises
    ------
    TypeError, ValueError
        If the file is missing, truncated, damaged or of another kind.
    """
    with opened(path, WHAT, {FORM: VERSION}) as file:
        kind, several = text(file, "kind"), truth(file, "several")
        if kind not in _KINDS or (several and kind not in LISTED):
            raise ValueError(f"kind = {kind!r} is none of {', '.join(_KINDS)}")
        read = _KINDS[kind][2]
        if kind not in LISTED:
            return read(file)
        found = tuple(read(file["items"][name]) for name in sorted(file["items"]))
        if not several and len(found) != 1:
            raise ValueError(f"it has {len(found)} items instead of one")
        return found if several else found[0]


# ---------------------------------------------------------------------- each kind
def _backbone_in(group: h5py.Group) -> Backbone:
    reduced = read_reduced_model(group["reduced_model"])
    modes, points = len(reduced.omega), len(reduced.points.names)
    count = len(numbers(group, "energy", None, least=0.0))
    mode, steps = whole(group, "mode", least=1, most=modes), whole(group, "steps", least=1, most=10**6)
    if not count:
        raise ValueError("'energy' is empty")
    return Backbone(
        mode=mode,
        energy=numbers(group, "energy", count),
        frequency=numbers(group, "frequency", count, least=1e-300),
        frequency_error=numbers(group, "frequency_error", count, finite=False),
        damping_ratio=numbers(group, "damping_ratio", count),
        damping_error=numbers(group, "damping_error", count, finite=False),
        energy_damping_ratio=numbers(group, "energy_damping_ratio", count),
        energy_damping_error=numbers(group, "energy_damping_error", count, finite=False),
        states=numbers(group, "states", count, 2 * modes),
        multipliers=numbers(group, "multipliers", count, None, kinds="c"),
        point_harmonics=numbers(group, "point_harmonics", count, points, 2, None, kinds="c"),
        point_amplitudes=numbers(group, "point_amplitudes", count, points, least=0.0),
        passed=tuple((float(one), float(other)) for one, other in numbers(group, "passed", None, 2)),
        events=tuple(_free_event_in(group["events"][name]) for name in sorted(group.get("events", ()))),
        damped=truth(group, "damped"),
        reason=text(group, "reason"),
        complete=truth(group, "complete"),
        _system=FreeSystem(reduced, mode - 1, steps),
        _excitation=numbers(group, "excitation", count),
        _own_frequency=numbers(group, "own_frequency", count, least=1e-300),
    )


def _free_event_in(group: h5py.Group) -> FreeEvent:
    kind = text(group, "kind")
    if kind not in FREE_KINDS:
        raise ValueError(f"an event is of the kind {kind!r}")
    return FreeEvent(
        kind,
        number(group, "energy", least=1e-300),
        number(group, "frequency", least=1e-300),
        complex(group.attrs["multiplier"]),
        whole(group, "after", most=MOST),
    )


def _locus_in(group: h5py.Group) -> Locus:
    kind, parameter = text(group, "kind"), text(group, "parameter")
    if kind not in KINDS or parameter not in PARAMETERS:
        raise ValueError(f"it is a line of {kind!r} over {parameter!r}")
    count = len(numbers(group, "value", None, least=0.0))
    return Locus(
        kind,
        parameter,
        numbers(group, "frequency", count, least=0.0),
        numbers(group, "value", count),
        numbers(group, "states", count, None),
        numbers(group, "multiplier", count, finite=False, kinds="c"),
        (text(group, "reason_begin"), text(group, "reason_end")),
        whole(group, "periods", least=1, most=10**7),
    )


# Kinds by the names in a file: what they are of, and what writes and reads one.
_KINDS: dict[str, tuple[type, Callable[[h5py.Group, Any], None], Callable[[h5py.Group], Any]]] = {
    "backbone": (Backbone, write_backbone, _backbone_in),
    "loci": (Locus, write_locus, _locus_in),
    "quasi-periodic": (QuasiPeriodic, write_torus, torus_in),
    "quasi-periodic branch": (QuasiPeriodicBranch, write_torus_branch, torus_branch_in),
}
