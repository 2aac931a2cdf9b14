"""Time histories of the unreduced model: average acceleration on PETSc (prefix ``newmark_``), contact
implicit.

A step solves (4/h^2 M + 2/h C + K) (u1 - u0) = 4/h M v0 - 2 K u0 + f0 + f1 + 2 G^T force with a matrix
factorised once (`unreduced_steps`). Nodes on crack faces have mass here. The contact force is that of the
step alone (Kane et al. 1999; Deuflhard, Krause and Ertel 2008): it is not carried into the next step's
acceleration, so contact dissipates and never feeds energy in. A node that closes loses the energy of its own
mass, however short the step: over the burst of a lightly damped cantilever 7e-3, 1.9e-3, 2.2e-3, 1.0e-3 and
1.2e-3 of what is supplied with 400, 800, 1600, 3200 and 6400 steps a period of the first mode. Halving steps,
as those of reduced models are, would not take this away.

The model's damping ratios are those of the computed modes, C = sum of 2 zeta omega (M phi)(M phi)^T;
everything above them is undamped but for Rayleigh's a M + b K.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...damping import DampingTable
from ...loads import Load
from ...petsc import stage
from ...signals.rate import rate_of
from ...system.fields.tips import warn_of_tips
from ...system.model import Model
from ...system.solve.demand import require_steps
from ...system.solve.modes import lowest_modes
from ...system.solve.pencil import Pencil
from ..drive import Drive
from ..energy import Energy
from ..history import History
from ..initial import unreduced_state
from ..integration import OfOtherRanks, Steps, Told
from ..loading import Loading
from ..states import Rows, SampledStates
from .kept_fields import KeptFields
from .ranks import layout_of, moved
from .steps import KEPT_RESPONSES, UnreducedSteps

# Steps between two settlements of the state, records on disk and reports of progress.
CHUNK = 256


class UnreducedIntegrator:
    """An unreduced model on its way; an `integration.Integrator`.

    Parameters
    ----------
    model : Model
    loads : Loading
    freed : ExitStack
        At whose end its matrices are freed.
    steps : Steps
    initial : {"rest", "equilibrium"} or (displacement, velocity)
        Functions of x and y (m, arrays) that give (u_x, u_y), or None for zero.
    modes : int
        Number of modes that are computed where the model has damping ratios.
    """

    exchanges = 0

    def __init__(
        self,
        model: Model,
        loads: Loading,
        freed: contextlib.ExitStack,
        *,
        steps: Steps,
        initial: str | Sequence[Callable | None],
        modes: int,
    ):
        model.require_support("the transient analysis")
        warn_of_tips("transient", model.tips)
        self.model, self.steps = model, steps
        units, self.loads = loads.units, len(loads.signals)
        # rates of prescribed displacements stand behind the loads
        rates = [rate_of(loads.signals[k], steps.step) for k in loads.edges]
        self.drive = Drive(model.comm, [*loads.signals, *rates], steps.step)
        self.comm, self.chunk = model.comm, CHUNK
        responses = min(len(model.contact), KEPT_RESPONSES)
        require_steps("transient", model.cells, modes if model.damping else 0, responses)
        found = lowest_modes(model, modes, auxiliary_tolerance=0.0) if model.damping else None
        self.pencil = freed.enter_context(Pencil(model.statics, 1.0, 0.0))
        self.march = UnreducedSteps(model, self.pencil, units, steps, found)
        freed.callback(self.march.release)
        self.fields = KeptFields(model, self.pencil, units, steps.kept)
        self.force = self._set_initial(units, initial)
        self.march.stored = self.march.stored_in(self.force)
        self.begun = initial if isinstance(initial, str) else "functions"

    def told(self) -> Told:
        """See `integration.Integrator`."""
        model, march = self.model, self.march
        head = vars(self.steps) | {
            "initial": self.begun,
            "initial_norms": np.sqrt(march.summed(np.array([march.u @ march.u, march.v @ march.v]))),
            "chunk": self.chunk,
            "damping": np.array(
                model.damping.points if isinstance(model.damping, DampingTable) else model.damping
            ),
            "damped_modes": len(march.omega),
            "rayleigh": np.array(model.rayleigh),
            "continued_fraction": model.continued_fraction,
            "unknowns": model.unknowns,
            "points": list(model.points),
            "tip_names": list(model.tips.intensities.names),
            "supports": list(march.ground.names),
            "fingerprint": march.fingerprint(),
        }
        friction = model.contact.friction
        if friction is not None:
            head["friction"] = np.array([friction.kinetic, friction.static])
            head["remembered"] = "gaps and slips"
        return Told(head, layout_of(self.pencil))

    def first(self) -> History:
        """See `integration.Integrator`."""
        march = self.march
        amplitudes, sums = self.drive.sums(0, 1)
        gap = march.displacements()[: march.pairs] + march.free_gaps(march.amplitudes)
        gap = gap + march.own_flexibility @ self.force
        if march.contact.friction is not None:
            count = len(march.laws)  # what touches lands no more
            touching = march.laws.acting(self.force[:count])
            march.contact.gap = np.append(np.where(touching, 0.0, gap[:count]), gap[count:])
        march.slope = march.first_slope(sums[0, : self.loads], *np.split(amplitudes[1], [self.loads]))
        rows = _stacked([self._row(0.0, march.slope, self.force, gap)])
        self._none = {name: values[:0] for name, values in rows.items()}
        states, energy = sampled(march, rows, self.fields), Energy(*rows["energies"].T)
        return History(rows["time"], states, energy, march.step, 0, len(march.omega))

    @stage("Steps")
    def advance(self, done: int, steps: int, decimation: int) -> Rows:
        """Take some steps, that end with a settled state; the rows of those that are kept."""
        march, kept = self.march, []
        time = (done + np.arange(steps + 1)) * march.step
        amplitudes, sums = self.drive.sums(done, steps)
        amplitudes, rates = np.split(amplitudes, [self.loads], axis=1)
        march.amplitudes, march.rates = amplitudes[0], rates[0]
        for k in range(steps):
            slope = march.slope
            force, gap = march.advance(sums[k, : self.loads], amplitudes[k + 1], rates[k + 1])
            if (done + k + 1) % decimation == 0:
                ahead = 1.5 * march.slope - 0.5 * slope
                kept.append(self._row(time[k + 1], ahead, force, gap))
        march.settle()
        return _stacked(kept) if kept else self._none

    def _row(self, time: float, slope: np.ndarray, force: np.ndarray, gap: np.ndarray) -> Rows:
        """Values at the present instant, with accelerations and what supports bear as in `slope`."""
        march = self.march
        row = row_of(march, force, gap)
        accelerations, borne = np.split(slope.reshape(-1, 2), [len(row["displacement"])])
        if self.fields.wanted:
            self.fields.add(march.whole(), march.amplitudes)
        energies = np.concatenate([march.energies(), march.work])
        slopes = {"acceleration": accelerations, "reactions": borne}
        return {"time": np.float64(time), **row, **slopes, "energies": energies}

    def checkpoint(self) -> list[Any]:
        """This rank's state, and what every rank knows of the account of work."""
        march = self.march
        contact = march.contact
        return [march.stored, march.work, march.slope, contact.state, contact.gap, march.u, march.v]

    def restore(self, checkpoint: Sequence[Any] | OfOtherRanks) -> None:
        """Go on from a checkpoint, bit by bit; from one of another number of ranks to round-off."""
        march = self.march
        if isinstance(checkpoint, OfOtherRanks):
            states = [np.stack(part[-2:], axis=1) for part in checkpoint.parts]
            own = moved(self.pencil, checkpoint.layouts, states)
            numbers = [*checkpoint.parts[0][:-2], *own.T]
        else:
            numbers = list(checkpoint)
        march.stored, march.work[:], slope, march.contact.state[:], gap, march.u[:], march.v[:] = numbers
        march.slope, march.contact.gap = slope.copy(), gap.copy()
        self.fields.wanted = False  # those of the former run are gone
        march.settle(fold=False)

    def _set_initial(self, units: Sequence[Load], initial: str | Sequence[Callable | None]) -> np.ndarray:
        """Set the state at t = 0; the contact forces there."""
        model, march = self.model, self.march
        force = np.zeros(march.pairs)
        march.amplitudes, march.rates = np.split(self.drive(np.zeros(1))[0], [self.loads])
        if not isinstance(initial, str):
            for state, function, what in zip((march.u, march.v), initial, ("displacement", "velocity")):
                state[:] = unreduced_state(self.pencil, function, what)
        elif initial == "equilibrium" and units:
            columns = model.load_columns(units)
            found = model.equilibrium(columns.combined(march.amplitudes), self.steps.contact)
            march.u[: self.pencil.owned] = found.owned
            march.u[self.pencil.owned :] = march.resting_insides()
            force = found.force[: march.pairs].copy()
        ground = march.ground
        march.u[: self.pencil.owned] -= ground.owned @ march.amplitudes[ground.edges]
        march.v[: self.pencil.owned] -= ground.owned @ march.rates
        march.force = force
        march.settle(fold=False)
        return force


def row_size(model: Model) -> int:
    """Bytes of an instant."""
    names = 3 * len(model.points) + len(model.tips.intensities.names) + len(model.support_forces.names)
    energies = 5 if model.contact.friction is None else 6
    return 8 * (1 + 2 * names + 2 * len(model.contact) + energies)


def row_of(march: UnreducedSteps, force: np.ndarray, gap: np.ndarray) -> Rows:
    """What is sampled at the present instant under contact forces and gaps."""
    names = "displacement", "velocity", "contact_force", "gap", "stress_intensity"
    return dict(zip(names, (*march.at_points(), *march.padded(force, gap), march.intensities())))


def _stacked(rows: Sequence[Rows]) -> Rows:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def sampled(march: UnreducedSteps, rows: Rows, fields: KeptFields | None) -> SampledStates:
    """Instants by what was sampled at them, and their fields."""
    model, gaps = march.model, len(march.model.contact.laws)
    return SampledStates(
        tuple(model.points),
        march.ground.names,
        rows["displacement"],
        rows["velocity"],
        rows["acceleration"],
        rows["contact_force"],
        rows["gap"],
        model.contact.pairs,
        rows["stress_intensity"],
        rows["reactions"],
        model.tips.intensities.facts,
        gaps if gaps < len(model.contact) else None,
        fields,
    )
