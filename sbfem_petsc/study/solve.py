"""One analysis of a case on a model that analyses share."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

import sbfem_petsc as sb

from ..analysis.options import (
    BackboneOptions,
    BasinsOptions,
    FrequencyRange,
    FrequencyResponseOptions,
    LineOptions,
    LoadHistoryOptions,
    LoadResponseOptions,
    ModalOptions,
    PeriodicOptions,
    QuasiPeriodicOptions,
    StaticOptions,
    SweptOptions,
    SwitchOptions,
    TorusCurveOptions,
    TransientOptions,
)
from ..errors import SolveError
from ..indicators.lines import sidebands
from .case import objects
from .case.case import Case
from .case.parameters import grid
from .quantities import Tree
from .summaries import tree_of

Progress = Callable[[float], None] | None
# Share of a period that counts as none when whole periods are counted.
ROUNDING = 1e-9


class Structure:
    """A model, which keeps its modes and reductions, for cases that differ in loads and analyses only.

    Parameters
    ----------
    case : Case
    comm : mpi4py communicator
    mesh : BoundaryMesh, optional
        On rank 0 at least. Default: made.
    """

    def __init__(self, case: Case, comm: Any, mesh: Any = None):
        self.comm = comm
        self.model = objects.model(case, comm, mesh)

    def points(self, case: Case) -> tuple[str, ...]:
        """Points whose motion is kept."""
        chosen = case.tables.output.points
        return tuple(self.model.points) if chosen is None else tuple(chosen)

    def solve(self, case: Case, name: str, *, file: str | None = None, progress: Progress = None) -> Any:
        """Result of an analysis. Collective.

        Parameters
        ----------
        case : Case
            Of this structure.
        name : str
            Analysis.
        file : str, optional
            File of a history or curve, from which an interrupted one goes on.
        progress : callable, optional
            Called with the fraction done where the analysis tells it.
        """
        table = case.tables.analyses[name]
        function = objects.analysis_function(case, name)
        return getattr(self, f"_{table.kind}")(case, table, function, file, progress)

    def tree(self, case: Case, name: str, result: Any) -> Tree:
        """Quantities of a result of `solve`. Collective."""
        table = case.tables.analyses[name]
        further: dict[str, Any] = {}
        if table.kind == "static":
            further["stress"] = stresses(table, result)
        if getattr(table, "accuracy", None) is not None:
            further["estimate"] = result.estimate
        if table.kind == "modulation":
            further = modulation(table, result)
        if table.kind == "swept_response":
            further["least"] = table.least
        if table.kind == "locus":
            further["none"] = no_locus(table)
        if table.kind in ("quasi_periodic", "quasi_periodic_response"):
            further["order"] = table.order
        return tree_of(table.kind, result, self.points(case), **further)

    def release(self, result: Any) -> None:
        """Free the finer model that a result of an accuracy asked for was computed on."""
        if getattr(result, "estimate", None) is not None and result.model is not self.model:
            result.model.destroy()

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.model.destroy()

    # ------------------------------------------------------------------ the kinds
    def _modal(self, case: Case, table: Any, function: Any, file: str | None, progress: Progress) -> Any:
        return function(self.model, **table.of(ModalOptions))

    def _static(self, case: Case, table: Any, function: Any, file: str | None, progress: Progress) -> Any:
        load = objects.load(case, table.load, table.factor)
        return function(self.model, load, **table.of(StaticOptions))

    def _load_history(
        self, case: Case, table: Any, function: Any, file: str | None, progress: Progress
    ) -> Any:
        load = objects.load(case, table.load, table.factor)
        return function(self.model, load, grid(table.times), **table.of(LoadHistoryOptions))

    def _transient(self, case: Case, table: Any, function: Any, file: str | None, progress: Progress) -> Any:
        return function(
            self.model,
            objects.load(case, table.load, table.factor),
            **table.of(TransientOptions),
            initial=table.initial,
            progress=progress,
            reduction="modes" if table.reduced else None,
            file=file,
            resume=file is not None,
        )

    def _periodic(self, case: Case, table: Any, function: Any, file: str | None, progress: Progress) -> Any:
        load, reduction = objects.load(case, table.load, table.factor), "modes" if table.reduced else None
        return function(self.model, load, **table.of(PeriodicOptions), reduction=reduction)

    def _modulation(self, case: Case, table: Any, function: Any, file: str | None, progress: Progress) -> Any:
        pump = objects.load(case, table.pump, 1.0, table.pump_frequency)
        probe = objects.load(case, table.probe, 1.0, table.probe_frequency)
        return function(
            self.model,
            [*_listed(pump), *_listed(probe)],
            table.pump_frequency,
            steps=table.steps or steps_of_two_tones(table.pump_frequency, table.probe_frequency),
            modes=table.modes,
            contact=table.contact,
            stability=table.stability,
            longest=table.longest,
        )

    def _frequency_response(
        self, case: Case, table: Any, function: Any, file: str | None, progress: Progress
    ) -> Any:
        load, keep = objects.load(case, table.load, table.factor), _kept(file if table.contact else None)
        return function(self.model, load, **table.of(FrequencyResponseOptions), **keep, progress=progress)

    def _load_response(
        self, case: Case, table: Any, function: Any, file: str | None, progress: Progress
    ) -> Any:
        load = objects.load(case, table.load)
        return function(self.model, load, **table.of(LoadResponseOptions), **_kept(file), progress=progress)

    def _swept_response(
        self, case: Case, table: Any, function: Any, file: str | None, progress: Progress
    ) -> Any:
        load = objects.load(case, table.load, table.factor)
        there, back = table.of(SweptOptions), {"start": table.stop, "stop": table.start}
        ways = [there, {**there, **back}][: 1 + table.back]
        return tuple(function(self.model, load, **way, progress=progress) for way in ways)

    def _basins(self, case: Case, table: Any, function: Any, file: str | None, progress: Progress) -> Any:
        starts = [
            sb.StartAxis(
                tuple(map(float, grid(axis.values))),
                axis.kind,
                axis.mode,
                axis.point,
                direction=axis.direction,
            )
            for axis in table.starts
        ]
        load = objects.load(case, table.load, table.factor)
        return function(self.model, load, starts=starts, **table.of(BasinsOptions), progress=progress)

    def _locus(self, case: Case, table: Any, function: Any, file: str | None, progress: Progress) -> Any:
        load, kinds = objects.load(case, table.load, table.factor), tuple(table.bifurcations)
        curve = sb.frequency_response(self.model, load, **table.of(FrequencyRange), progress=progress)
        options = table.of(LineOptions)
        return function(curve, table.least, table.most, kinds=kinds, **options, progress=progress)

    def _quasi_periodic(
        self, case: Case, table: Any, function: Any, file: str | None, progress: Progress
    ) -> Any:
        probe = objects.load(case, table.probe, 1.0, table.probe_frequency)
        pump = objects.load(case, table.pump, 1.0, table.pump_frequency)
        return function(
            self.model,
            [*_listed(probe), *_listed(pump)],
            (table.probe_frequency, table.pump_frequency),
            **table.of(QuasiPeriodicOptions),
        )

    def _quasi_periodic_response(
        self, case: Case, table: Any, function: Any, file: str | None, progress: Progress
    ) -> Any:
        load = objects.load(case, table.load, table.factor)
        curve = sb.frequency_response(self.model, load, **table.of(FrequencyRange), progress=progress)
        found = [item for item in curve.bifurcations if item.kind == "Neimark-Sacker"]
        if len(found) < table.bifurcation:
            raise SolveError(
                f"quasi_periodic_response: the curve from {table.start:g} to {table.stop:g} Hz has "
                f"{len(found)} Neimark-Sacker points, not {table.bifurcation}; give another bifurcation, "
                "range or load"
            )
        guess = sb.switch_branch(curve, found[table.bifurcation - 1], **table.of(SwitchOptions))
        return function(
            guess,
            table.end,
            largest_step=table.largest_step,
            **table.of(TorusCurveOptions),
            progress=progress,
        )

    def _backbone(self, case: Case, table: Any, function: Any, file: str | None, progress: Progress) -> Any:
        return function(self.model, **table.of(BackboneOptions), progress=progress)


def _listed(loads: Any) -> list[Any]:
    return loads if isinstance(loads, list) else [loads]


def stresses(table: Any, result: Any) -> dict[str, np.ndarray]:
    """Stress (xx, yy, xy), Pa, at the places that a static analysis names. Collective."""
    return {
        place: result.stress(at if isinstance(at, str) else tuple(at))
        for place, at in table.stress_at.items()
    }


def _kept(file: str | None) -> dict[str, Any]:
    """Where a curve is kept, and that it goes on from there."""
    return {"file": file, "resume": file is not None}


def steps_of_two_tones(low: float, high: float) -> int:
    """Time steps a period of the low tone that give the high one 64."""
    return max(512, math.ceil(64.0 * high / low))


def common_period(low: float, high: float, longest: int) -> float:
    """Common period of two tones, s."""
    ratio = Fraction(high / low).limit_denominator(longest)
    return ratio.denominator / low


def modulation(
    table: Any, result: Any, noisy: Callable[[np.ndarray], np.ndarray] | None = None
) -> dict[str, Any]:
    """Sidebands of a modulation, read from the motion or from what `noisy` makes of it."""
    values = result.displacement(table.point)[:, "xy".index(table.direction)]
    period = common_period(table.pump_frequency, table.probe_frequency, table.longest)
    # sidebands ask for two periods of the low tone at least, which a periodic motion has
    repeats = max(1, math.ceil(2.0 / (period * table.pump_frequency) - ROUNDING))
    values = np.tile(values, repeats)
    if noisy is not None:
        values = noisy(values)
    time = np.arange(len(values)) * (repeats * period / len(values))
    return {
        "sidebands": sidebands(time, values, table.probe_frequency, table.pump_frequency, order=table.pairs),
        "common_period": period,
    }


def no_locus(table: Any) -> str:
    """Why the table of an analysis has led to no line of bifurcations."""
    kinds = table.bifurcations
    listed = " or ".join(filter(None, (", ".join(kinds[:-1]), kinds[-1])))
    return (
        f"no {listed} that can be followed was found on the curve from {table.start:g} to {table.stop:g} Hz"
        f"{f' at {table.factor:g} times the load' if table.factor != 1.0 else ''}"
    )
