"""Backbones: free periodic motions of one mode, its frequency and damping over the energy."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..continuation.line_file import LineFile
from ..continuation.problems.free import FreeMotions, FreeSystem
from ..continuation.problems.free_branch import HARMONICS, PACE, Backbone, Rows, follow_backbone
from ..errors import SolveError, on_all_ranks
from ..motion.loading import communicator
from ..motion.preparation import period_memory
from ..motion.step_plan import contact_steps
from ..progress import Progress
from ..ranks.capacity import points_in_room, require_compiler
from ..ranks.parallel import collective
from ..reduction.build import reduced
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .analysis import analysis
from .options import BackboneOptions

# Steps a period, and modes kept beside three for each up to the followed one.
STEPS, MODES = 1024, 20


@analysis(BackboneOptions, rubs=True)
def backbone(
    model: Model | ReducedModel,
    mode: int,
    start: float,
    stop: float,
    *,
    damping: bool = False,
    modes: int | None = None,
    steps: int | None = None,
    points: int = 200,
    largest_step: float | None = None,
    largest_change: float = 0.4,
    interactions: bool = False,
    refine: bool = True,
    stability: bool = True,
    file: str | None = None,
    resume: bool = False,
    progress: Progress = "auto",
) -> Backbone:
    """Follow the free periodic motions that begin as one mode of the open structure, over their energy.

    Parameters
    ----------
    model : Model or ReducedModel
    mode : int
        Counted from 1.
    start, stop : float
        Energies, J; `stop` below `start` goes down.
    damping : bool
        False: without damping, the nonlinear normal mode. True: with the model's, under a self-excitation
        proportional to the velocity that makes up for it: the motion a force reaches that is everywhere in
        phase with the velocity (phase resonance); gives the damping ratios over the energy.
    modes : int, optional
        Modes kept. Default: three for each up to the followed one, and 20.
    steps : int, optional
        Time steps a period, all of one length. Default: 1024, or as many as keep the step below 0.8 of the
        shortest modal period; they are not halved where contact does work, for what twice the steps change
        is told and taken off (`refine`).
    points : int
        Points at most.
    largest_step : float, optional
        Largest change of the energy (J) from a point to the next one, for a finer branch.
    largest_change : float
        Largest change of the state from a point to the next one, relative.
    interactions : bool
        Follow the narrow tongues along which the branch turns back in energy where a multiple of its
        frequency meets that of a higher mode; by default those that can be are passed over, and noted in
        `passed`.
    refine : bool
        Solve every point once more with half the step and extrapolate frequency and damping ratios.
    stability : bool
        Compute Floquet multipliers.
    file : str, optional
        Journal that is kept up to date (`read`).
    resume : bool
        Go on from `file` if it exists, with the same model, mode, range and settings.
    progress : callable, "auto" or None
        As for `transient`; the fraction of the range in logarithms that the branch has come.

    Raises
    ------
    ValueError, TypeError
        For input that makes no sense, and if not even a short branch would find room in the free memory.
    SolveError
        If no motion is found at `start`, or the branch ends between the energies; the points so far are its
        attribute `backbone`.
    """
    reduction = _reduction(model, mode, modes)
    if not damping:
        reduction = replace(reduction, damping=np.zeros(len(reduction.omega)))
    own = float(reduction.frequencies[mode - 1])
    if steps is None:
        steps = max(STEPS, contact_steps(reduction, own))
    comm = communicator(model)
    require_compiler("backbone", comm)
    most = _room_for(reduction, steps, points)
    with LineFile(comm, file, resume=resume, task="backbone", progress=progress) as run:
        told: dict[str, Any] = {"mode": mode, "start": start, "stop": stop, "steps": steps}
        told |= {"damped": damping, "interactions": interactions, "refine": refine, "stability": stability}
        told |= {"largest_step": largest_step or "none", "largest_change": largest_change}
        reduction, _ = run.begin(reduction, told, np.array([start, stop]))
        system = FreeSystem(reduction, mode - 1, steps)
        rows = Rows(system, refine, stability, damping, interactions)
        pace = replace(
            PACE,
            points=most,
            first=min(PACE.first, largest_change),
            largest=largest_change,
            largest_step=largest_step or math.inf,
        )
        result = follow_backbone(rows, start, stop, pace, run)
    if not result.complete:
        more = "raise points" if most == points else "there is no memory for more points"
        failure = SolveError(
            f"backbone: the branch of mode {mode} ends at {result.energy[-1]:.6g} J after "
            f"{len(result.energy)} points, before {stop:.6g} J: {result.reason}; {more}, {FreeMotions.advice}"
            f"{'' if interactions or damping else ', or follow interactions (interactions=True)'}"
        )
        failure.backbone = result  # type: ignore[attr-defined]
        raise on_all_ranks(failure)
    return result


def _reduction(model: Model | ReducedModel, mode: int, modes: int | None) -> ReducedModel:
    """The reduced model whose motions are followed from one of its elastic modes. Collective."""
    kept = modes or 3 * mode + MODES
    with collective(communicator(model)):
        model.require_frictionless("backbone", "follows free motions, which friction brings to rest")
        if isinstance(model, ReducedModel) and modes is not None:
            raise ValueError(
                f"backbone: modes = {modes} has no meaning beside a reduced model; reduce it to so many"
            )
        if isinstance(model, Model) and kept > model.boundary_unknowns // 2:
            raise ValueError(
                f"backbone: {kept} modes are more than half of the {model.boundary_unknowns} unknowns; give "
                "fewer modes, or refine the mesh"
            )
    found = model if isinstance(model, ReducedModel) else reduced(model, (), kept)
    with collective(communicator(model)):
        if (found.initial_gap < 0.0).any():
            raise ValueError(
                f"backbone: contact rows overlap at rest, by {-found.initial_gap.min():g} m; free motions "
                "are followed around a place that nothing presses: give gaps of 0 or more"
            )
        if mode > found.natural or found.omega[mode - 1] == 0.0:
            raise ValueError(
                f"backbone: mode = {mode} must be an elastic one of the {found.natural} modes kept"
            )
    return found


def _room_for(reduction: ReducedModel, steps: int, points: int) -> int:
    """Points that there is memory for: few branches take as many as they may. Collective."""
    size, named = 2 * len(reduction.omega), len(reduction.points.names)
    # the monodromy of each, its state, its multipliers and its harmonics
    each = 8.0 * (size**2 + 4 * size + 4 * named * (HARMONICS + 2))
    return points_in_room(
        "backbone",
        reduction.comm,
        points,
        (each, period_memory(reduction, steps, 1)),
        what=f"{{}} motions of {steps:,d} steps and {len(reduction.omega)} modes",
        remedy="give fewer steps or modes",
    )
