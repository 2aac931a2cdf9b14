"""Response curves and orbits in HDF5: written whole at each update, never half."""

from __future__ import annotations

import contextlib
import os
import time
import warnings
from collections.abc import Callable

import h5py
import numpy as np

from ..analysis.response import Branch
from ..dynamics.bifurcations import Bifurcation
from ..dynamics.continuation import FIRST
from ..dynamics.excitation import Excitation
from ..dynamics.shooting import Period
from ..errors import SolveError
from ..parallel import collective
from .history_file import close
from .reduction_file import difference, in_rows, read_reduction, write_reduction

FORMAT, FORMAT_VERSION = "sbfem-petsc response curve", 1
# Seconds between two updates of a file.
PAUSE = 2.0
_ARRAYS = {
    "value": ("forcing frequency (Hz) or factor on the oscillating loads", ""),
    "states": ("(Omega q, q') at t = 0", "m sqrt(kg)/s"),
    "point_harmonics": ("harmonics 0 to 20 of the points' displacements, (n, points, xy, k)", "m"),
    "point_amplitudes": ("half the peak-to-peak of u_y", "m"),
    "point_subharmonics": ("amplitudes at j f / periods", "m"),
    "contact_peak": ("largest contact resultant", "N"),
    "multipliers": ("Floquet multipliers", ""),
    "multiplier_error": ("uncertainty of their largest modulus, nan where it was not measured", ""),
    "iterations": ("Newton iterations", ""),
}


class IncompleteBranch(UserWarning):
    """The run that wrote the file has not reached the end of its range."""


class BranchFile:
    """The file of a curve under way.

    Attributes
    ----------
    former : (states (n, 2 m), values (n,), float) or None
        Points of the run that is resumed, and the length of its next step.
    reduction : Reduction
        Its reduction: states are in its modes.
    """

    def __init__(
        self,
        comm,
        path,
        resume: bool,
        period: Period,
        name: str,
        start: float,
        stop: float,
        frequency: float | None,
    ):
        self.comm, self.path, self.settings = (
            comm,
            os.path.abspath(os.fspath(path)),
            {"start": start, "stop": stop},
        )
        self.former, self.reduction, self.written = None, in_rows(period.reduction), -np.inf
        found = None
        with collective(comm):
            if comm.rank == 0:
                if resume and os.path.lexists(self.path):
                    found = self._read(period, name, start, stop, frequency)
                elif not os.access(os.path.dirname(self.path), os.W_OK):
                    raise ValueError(
                        f"curve file {self.path!r} cannot be written; name another folder or change its "
                        "permissions"
                    )
        found = comm.bcast(found)
        if found is not None:
            self.former, self.reduction = found

    def _read(self, period: Period, name: str, start: float, stop: float, frequency: float | None):
        with opened(self.path) as file:
            reduction = read_reduction(file["reduction"])
            other = difference(reduction, period.reduction)
            if other:
                raise ValueError(
                    f"curve file {self.path!r} was written for another model ({other}); resume with that "
                    "model, or name another file"
                )
            mine = {
                "parameter": name,
                "start": start,
                "stop": stop,
                "steps": period.steps,
                "periods": period.drive.periods,
                "fixed_frequency": frequency or 0.0,
                "contact": period.pairs > 0,
            }
            for key, value in mine.items():
                if not close(file.attrs[key], value):
                    raise ValueError(
                        f"curve file {self.path!r} was written with {key} = {file.attrs[key]}, not {value}; "
                        "resume with the same value, or name another file"
                    )
            if not close(file["drive/amplitudes"][()], period.drive.amplitudes):
                raise ValueError(
                    f"curve file {self.path!r} was written for other loads; resume with the same loads, or "
                    "name another file"
                )
            return (file["states"][()], file["value"][()], float(file.attrs["step"])), reduction

    def update(self, curve: Callable[[], Branch], step: float, last: bool = False) -> None:
        """Write the curve as it is and the length of its next step, at most every two seconds but for the
        last time.
        """
        with collective(self.comm):
            if self.comm.rank == 0 and (last or time.monotonic() - self.written > PAUSE):
                try:
                    save_curve(curve(), self.path, **self.settings, step=step)
                except OSError as error:
                    raise SolveError(
                        f"curve file {self.path!r} cannot be written any more ({error.strerror or error}); "
                        "what it holds stays readable, and resume=True continues from there"
                    ) from None
                self.written = time.monotonic()


def save_curve(
    curve: Branch, path: str, start: float | None = None, stop: float | None = None, step: float = FIRST
) -> None:
    """Write a curve; the file takes its name when it is whole."""
    period = curve.period
    with replaced(path) as file:
        file.attrs.update(
            {
                "format": FORMAT,
                "format_version": FORMAT_VERSION,
                "parameter": curve.parameter,
                "complete": curve.complete,
                "reason": curve.reason,
                "start": curve.value[0] if start is None else start,
                "stop": curve.value[-1] if stop is None else stop,
                "steps": period.steps,
                "periods": curve.periods,
                "contact": period.pairs > 0,
                "fixed_frequency": curve.fixed_frequency or 0.0,
                "step": step,
            }
        )
        for name, (text, unit) in _ARRAYS.items():
            data = file.create_dataset(name, data=getattr(curve, name))
            data.attrs["description"], data.attrs["unit"] = text, unit
        file.create_dataset("stable", data=curve.stable)
        file["drive/orders"], file["drive/amplitudes"] = period.drive.orders, period.drive.amplitudes
        write_reduction(file.create_group("reduction"), curve.reduction)
        for k, item in enumerate(curve.bifurcations):
            group = file.create_group(f"bifurcations/{k:03d}")
            group.attrs.update(
                {"kind": item.kind, "value": item.value, "multiplier": item.multiplier, "after": item.after}
            )
            group["state"], group["direction"] = item.state, item.direction


@contextlib.contextmanager
def replaced(path: str):
    """A new HDF5 file that takes its name when it is whole."""
    path = os.path.abspath(os.fspath(path))
    temporary = os.path.join(os.path.dirname(path), f".{os.path.basename(path)}.{os.getpid()}.part")
    try:
        with h5py.File(temporary, "w") as file:
            yield file
        with open(temporary, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(temporary, path)
    finally:
        if os.path.exists(temporary):
            os.remove(temporary)


def read_curve(path: str) -> Branch:
    """Read a curve, also one whose run has not ended.

    Raises
    ------
    ValueError
        If the file is missing, truncated or of another kind.

    Warns
    -----
    IncompleteBranch
        If the curve has not reached the end of its range.
    """
    path = os.fspath(path)
    with opened(path) as file:
        drive = Excitation(file["drive/orders"][()], file["drive/amplitudes"][()], int(file.attrs["periods"]))
        period = Period(
            read_reduction(file["reduction"]), drive, int(file.attrs["steps"]), bool(file.attrs["contact"])
        )
        arrays = {name: file[name][()] for name in _ARRAYS}
        groups = [file["bifurcations"][name] for name in sorted(file.get("bifurcations", ()))]
        found = tuple(
            Bifurcation(
                str(g.attrs["kind"]),
                float(g.attrs["value"]),
                complex(g.attrs["multiplier"]),
                g["state"][()],
                g["direction"][()],
                int(g.attrs["after"]),
            )
            for g in groups
        )
        curve = Branch(
            parameter=str(file.attrs["parameter"]),
            **arrays,
            bifurcations=found,
            reason=str(file.attrs["reason"]),
            complete=bool(file.attrs["complete"]),
            periods=drive.periods,
            period=period,
            fixed_frequency=float(file.attrs["fixed_frequency"]) or None,
        )
        stop = float(file.attrs["stop"])
    if not curve.complete:
        warnings.warn(
            f"curve file {path!r} is incomplete: it ends at {curve.value[-1]:.8g} of {stop:.8g}; resume=True "
            "continues it",
            IncompleteBranch,
            stacklevel=2,
        )
    return curve


@contextlib.contextmanager
def opened(path: str, what: str = "curve", form: str = FORMAT, version: int = FORMAT_VERSION):
    """A file of one form open for reading; every failure as a ValueError of one sentence."""
    if not os.path.isfile(path):
        raise ValueError(f"{what} file {path!r} does not exist")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != form:
                raise ValueError(f"{path!r} is an HDF5 file of another kind, not {form}")
            if int(file.attrs["format_version"]) > version:
                raise ValueError(
                    f"{what} file {path!r} has format version {file.attrs['format_version']}, newer than "
                    f"this program's {version}"
                )
            yield file
    except (OSError, KeyError, RuntimeError, IndexError) as error:
        raise ValueError(f"{what} file {path!r} is truncated or no HDF5 file ({error})") from None
