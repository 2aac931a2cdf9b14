"""The file of a branch of periodic motions: written whole at each update, never half."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import h5py
import numpy as np

from ..parallel import on_root
from ..petsc import MPI
from ..reduction.comparison import adopted, in_rows
from ..reduction.reduced_model import ReducedModel
from .excitations import read_excitation, write_excitation
from .hdf5 import new_hdf5, opened, put, put_texts
from .kept_file import KeptFile
from .reduced_models import read_reduced_model, write_reduced_model
from .sound import number, numbers, text, texts, truth, whole

WHAT, FORM, VERSION = "branch file", "sbfem-petsc branch", 2
PARAMETERS = "frequency", "load", "damping", "gap"
# Length of the next step of a branch that nobody follows.
NO_STEP = 0.05
ARRAYS = {
    "value": ("", "forcing frequency (Hz) or factor on the oscillating loads, damping or gaps"),
    "states": ("m sqrt(kg)/s", "(Omega q, q') at t = 0"),
    "point_harmonics": ("m", "harmonics 0 to 20 of the points' displacements, (n, points, xy, k)"),
    "point_amplitudes": ("m", "half the peak-to-peak of u_y"),
    "point_subharmonics": ("m", "amplitudes at j f / periods"),
    "contact_peak": ("N", "largest contact resultant"),
    "multipliers": ("1", "Floquet multipliers"),
    "multiplier_error": ("1", "uncertainty of their largest modulus, nan where not measured, inf: unknown"),
    "iterations": ("1", "Newton iterations"),
}


def write_branch(
    branch,
    path: Any,
    start: float | None = None,
    stop: float | None = None,
    length: float = NO_STEP,
    unreduced: Mapping[str, Any] | None = None,
) -> None:
    """Write a `continuation.branch.Branch`; the file takes its name when it is whole.

    Parameters
    ----------
    branch : Branch
    path : str
    start, stop : float, optional
        The range; default: the branch's ends.
    length : float
        Of the continuation's next step.
    unreduced : dict, optional
        What a branch of an unreduced model under way is gone on with: numbers and arrays by their names.
    """
    period = branch.map
    with new_hdf5(path, WHAT, FORM, VERSION) as file:
        file.attrs.update(
            {
                "parameter": branch.parameter,
                "complete": branch.complete,
                "reason": branch.reason,
                "start": branch.value[0] if start is None else start,
                "stop": branch.value[-1] if stop is None else stop,
                "periods": branch.periods,
                "fixed_frequency": branch.fixed_frequency or 0.0,
                "length": length,
            }
        )
        for name, (unit, meaning) in ARRAYS.items():
            put(file, name, getattr(branch, name), unit or _unit(branch.parameter), meaning)
        put(file, "stable", branch.stable, "1", "whether small disturbances die out")
        put(file, "undecided", branch.undecided, "1", "whether the uncertainty leaves that open")
        if period is None:
            group = file.create_group("unreduced_model")
            put_texts(group, "points", branch.points)
            for name, value in (unreduced or {}).items():
                put(group, name, value, "SI", "what the run is gone on with")
        else:
            file.attrs.update({"steps": period.steps, "contact": period.pairs > 0})
            write_excitation(file.create_group("excitation"), period.excitation)
            write_reduced_model(file.create_group("reduced_model"), period.reduced)
        for k, item in enumerate(branch.bifurcations):
            group = file.create_group(f"bifurcations/{k:03d}")
            group.attrs.update(
                {
                    name: getattr(item, name)
                    for name in ("kind", "value", "multiplier", "after", "own_value", "error")
                }
            )
            if item.row is not None:
                group.attrs["row"] = item.row
            put(group, "state", item.state, "m sqrt(kg)/s", "(Omega q, q') at t = 0")
            put(group, "direction", item.direction, "m sqrt(kg)/s", "Floquet direction")


class BranchFile(KeptFile):
    """The file of a branch under way; a `branch_following.BranchRecorder` and a context manager.

    Parameters
    ----------
    comm : Comm
    path : str
    resume : bool
        Continue the file if it exists; False: replace it.

    Attributes
    ----------
    former : (states (n, 2 m), values (n,), float, str) or None
        Points of the run that is resumed, the length of its next step and why it ended.

    Raises
    ------
    TypeError, ValueError
        See `KeptFile`.
    """

    def __init__(self, comm: MPI.Comm, path: Any, *, resume: bool = False):
        self.former: tuple[np.ndarray, np.ndarray, float, str] | None = None
        self._finished, self._range, self._unreduced = False, (0.0, 0.0), dict[str, Any]()
        super().__init__(comm, path, WHAT, FORM, VERSION, resume=resume)

    def begin(self, period, parameter, any_steps: bool = False) -> tuple[ReducedModel, int]:
        """Note what is followed, and read the points of a former run under the same conditions. Collective.

        Parameters
        ----------
        period : motion.period_map.Period
        parameter : continuation.problems.driven_orbits.ParameterRange
        any_steps : bool
            Go on in the steps of the former run, whatever they are.

        Returns
        -------
        ReducedModel, int
            The one to go on with: the file's own, whose modes its states are in; and the steps.

        Raises
        ------
        ValueError
            If the file was written for another model, load or range.
        """
        self._range = parameter.start, parameter.stop
        found = on_root(
            self.comm, lambda: self._read(period, parameter, any_steps) if self.continued else None
        )
        found = self.comm.bcast(found)
        if found is None:
            return in_rows(period.reduced), period.steps
        stored, steps, self.former, self._finished = found
        return in_rows(adopted(stored, period.reduced)), steps

    def _read(self, period, parameter, any_steps: bool):
        with opened(self.path, WHAT, self.forms) as file:
            contents = read_branch_file(file)
            if contents["reduced"] is None:
                raise ValueError(f"{WHAT} {self.path!r} is of an unreduced model; name another file")
            mine = {
                "parameter": parameter.name,
                "start": parameter.start,
                "stop": parameter.stop,
                "steps": contents["steps"] if any_steps else period.steps,
                "periods": period.excitation.periods,
                "fixed_frequency": parameter.frequency or 0.0,
                "contact": period.pairs > 0,
                "loads": period.excitation.amplitudes,
            }
            stored = {**file.attrs, "loads": contents["excitation"]["amplitudes"]}
            self.require_same((contents["reduced"], period.reduced), stored, mine)
            finished = contents["complete"] and contents["multipliers"].shape[1] > 0
            former = (
                contents["states"],
                contents["value"],
                float(file.attrs["length"]),
                contents["reason"],
            )
            return contents["reduced"], contents["steps"], former, finished

    def begin_unreduced(self, period, parameter) -> None:
        """The same of motions of a `motion.unreduced.period.UnreducedPeriod`, on as many ranks as the run
        that is gone on with began with. Collective.
        """
        self._range = parameter.start, parameter.stop
        march = period.march(parameter.frequency or parameter.start)
        self._unreduced = {
            "parameter": parameter.name,
            "start": parameter.start,
            "stop": parameter.stop,
            "steps": period.steps,
            "ranks": self.comm.size,
            "periods": period.excitation.periods,
            "fixed_frequency": parameter.frequency or 0.0,
            "contact": period.contact,
            "loads": period.excitation.amplitudes,
            "model": march.fingerprint(),
        }
        found = self.comm.bcast(on_root(self.comm, self._read_unreduced if self.continued else lambda: None))
        if found is not None:
            self.former, self._finished = found

    def _read_unreduced(self):
        with opened(self.path, WHAT, self.forms) as file:
            contents, group = read_branch_file(file), file.get("unreduced_model", {})
            if "unknowns" not in group:
                raise ValueError(
                    f"{WHAT} {self.path!r} is of a reduced model, or of no run; name another file"
                )
            stored = {**file.attrs, **{name: item[()] for name, item in group.items()}}
            self.require_same(None, stored, self._unreduced)
            unknowns = numbers(group, "unknowns", len(contents["value"]), None)
            former = unknowns, contents["value"], float(file.attrs["length"]), contents["reason"]
            return former, contents["complete"]

    def update(self, branch: Callable[[], Any], line: Any, last: bool = False) -> None:
        """Write the branch as it is and the `continuation.follow.Line` it is made of, at most every two
        seconds but for the last time; a finished one stays as it is. Collective.
        """
        if self._finished or not self.due(last):
            return
        further = None
        if self._unreduced:
            kept = [line.problem.whole(point.u)[:-1] for point in line.points]
            further = {
                **{name: self._unreduced[name] for name in ("steps", "ranks", "contact", "loads", "model")},
                "unknowns": kept,
            }
        self.save(lambda: write_branch(branch(), self.path, *self._range, line.length, further), last)


def _unit(parameter: str) -> str:
    return "Hz" if parameter == "frequency" else "1"


def read_branch_file(file: h5py.File) -> dict[str, Any]:
    """What a branch is made of, by the names in `Branch`, but for its map: that as "reduced", None for an
    unreduced model, "steps", "contact" and "excitation".

    Raises
    ------
    ValueError
        If it does not fit together.
    """
    reduced, modes = None, 0
    if "unreduced_model" in file:
        names = texts(file["unreduced_model"], "points")
    else:
        reduced = read_reduced_model(file["reduced_model"])
        names, modes = reduced.points.names, len(reduced.omega)
    count, points = len(numbers(file, "value", None, least=0.0)), len(names)
    periods = whole(file, "periods", least=1, most=10**7)
    parameter = text(file, "parameter")
    if not count or parameter not in PARAMETERS:
        raise ValueError(f"it is over {parameter!r} and has {count} points")
    lines = numbers(file, "point_harmonics", count, points, 2, None, kinds="c").shape[-1]
    arrays = {
        "value": numbers(file, "value", count),
        "states": numbers(file, "states", count, 2 * modes),
        "point_harmonics": numbers(file, "point_harmonics", count, points, 2, lines, kinds="c"),
        "point_amplitudes": numbers(file, "point_amplitudes", count, points),
        "point_subharmonics": numbers(file, "point_subharmonics", count, points, 2, None, kinds="c"),
        "contact_peak": numbers(file, "contact_peak", count),
        "multipliers": numbers(file, "multipliers", count, None, kinds="c"),
        "multiplier_error": numbers(file, "multiplier_error", count, finite=False),
        "iterations": numbers(file, "iterations", count, kinds="iu"),
    }
    number(file, "length", least=0.0)
    for name in ("start", "stop"):
        number(file, name, least=0.0)
    found: dict[str, Any] = {
        **arrays,
        "parameter": parameter,
        "periods": periods,
        "reason": text(file, "reason"),
        "complete": truth(file, "complete"),
        "fixed_frequency": number(file, "fixed_frequency", least=0.0) or None,
        "names": names,
        "reduced": reduced,
    }
    if reduced is not None:
        steps, loads = whole(file, "steps", least=1, most=10**9), reduced.load_modes.shape[1]
        found |= {"steps": steps, "contact": truth(file, "contact")}
        found["excitation"] = read_excitation(file["excitation"], loads, steps)
    return found
