"""Steps of the unreduced model: one linear solve and one product with K each, everything else in a few
numbers a step.

A step solves for the increment d = u1 - u0, (4/h^2 M + 2/h C + K) d = 4/h M v0 - 2 K u0 + f0 + f1 + 2 G^T
force, in which less is lost to round-off than in u1. d and K d carry u, v, K u and M v on by sums: the
equation solved tells M d from K d, and a product with K, which leaves the auxiliary unknowns alone, costs a
third of one with M. Gaps, displacements of the named points and at the loads are a few rows of the unknowns
(probes); those of d alone are formed, and kept the same on every rank.

Modal damping, C = sum of 2 zeta omega (M phi)(M phi)^T over computed modes, touches only what the modes
carry, and there the equations of a step fall apart into single ones. The large vectors are therefore advanced
without it, the modes with and without it beside them, and the difference of the two, a few numbers, is added
to the probes and the energies in each step and to the large vectors now and then (`settle`).

The contact problem of a step needs the responses to contact forces at the probes alone. The large vector
follows from kept responses of all unknowns where the contact rows are few, else from a second solve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ...damping import modal_ratios
from ...loads import Load
from ...petsc import PETSc, free, stage, summed
from ...system.model import Model
from ...system.solve.modal_result import Modal
from ...system.solve.pencil import CondensedSolve, Pencil
from ...system.solve.static_solver import block_width
from ..integration import Steps
from .contact import StepContact
from .ground import Ground, SparseColumns, probe_rows
from .kernels import add_columns, advance, form

# Contact rows up to which the responses of all unknowns are kept: adding more vectors takes longer than a
# second solve does.
KEPT_RESPONSES = 200


@dataclass
class _Solved:
    """Solution of a step that is not yet taken: increments of probes and of modes, with damping and without,
    contact forces, gaps.
    """

    probes: np.ndarray
    modal: np.ndarray
    force: np.ndarray
    gap: np.ndarray


class UnreducedSteps:
    """State and constants of one run.

    Parameters
    ----------
    model : Model
    pencil : Pencil
        With all auxiliary unknowns.
    units : sequence of Load
    steps : Steps
    found : Modal or None
        The modes in which the model's damping ratios are met.

    Attributes
    ----------
    u, v : (local unknowns,) arrays
        This rank's state; that of the structure only after `settle`.
    work : (3,) or (4,) array
        Work of the loads, of damping, of contact since the start, and where faces rub what friction has
        taken, J.
    contact : StepContact
    q, p : (2, modes) arrays
        Modal coordinates and their rates, with damping and without.
    slope : (2 points + 2 supports,) array
        Means over the last step: accelerations of the named points, m/s^2, then what supports bear, N.
    ground : Ground
    amplitudes, rates : (loads,), (edges,) arrays
        Of the loads, and how fast prescribed displacements change.
    stored : float
        Energy in the contact rows' own flexibility, J.
    """

    def __init__(
        self, model: Model, pencil: Pencil, units: Sequence[Load], steps: Steps, found: Modal | None
    ):
        self.model, self.pencil = model, pencil
        step = self.step = steps.step
        a, b = self.rayleigh = model.rayleigh
        self.stretch, self.inertia = 1.0 + 2.0 * b / step, 4.0 / step**2 + 2.0 * a / step
        self.rate = 2.0 / step
        self.solve = CondensedSolve(pencil, -self.inertia / self.stretch, prefix="newmark_", what="transient")
        self.d, self.product, self.right = (pencil.stiffness.createVecRight() for _ in range(3))
        size = self.d.getLocalSize()
        self.u, self.v, self.mass_v, self.stiffness_u = (np.zeros(size) for _ in range(4))
        try:
            self._set_up(units, found, steps.contact)
        except BaseException:
            self.release()
            raise

    # ------------------------------------------------------------------ set-up
    def _set_up(self, units: Sequence[Load], found: Modal | None, contact: bool) -> None:
        """Everything but the large vectors and the factorisation."""
        self._probes(units, contact)
        self._modes(found)
        self._respond()
        flexibility = (
            self.probe_responses[: self.pairs]
            + (self.gap_modes * np.subtract(*1.0 / self.left)) @ self.gap_modes.T
        )
        # contact forces act at their full value over the step, as twice their mean among the loads
        self.contact = StepContact(
            flexibility + flexibility.T + self.own_flexibility,
            self.laws,
            self.model.contact.friction if contact else None,
        )
        self.q = self.p = np.zeros((2, len(self.omega)))
        self.work = np.zeros(3 if self.model.contact.friction is None else 4)
        self.slope = np.zeros(self.probes.shape[0] - self.pairs - self.loads)
        self.stored = 0.0
        self.settle(fold=False)

    def _probes(self, units: Sequence[Load], contact: bool) -> None:
        """Rows over this rank's unknowns: gaps, unit loads, x and y of the named points, momenta along what
        follows the supports.
        """
        gap = self.model.contact
        count = len(gap) if contact else 0
        self.gap0, self.own_flexibility = gap.initial[:count], gap.flexibility[:count, :count]
        self.laws = gap.laws.only(np.s_[:count])
        self.pairs, self.loads = count, len(units)
        columns = self.model.load_columns(units)
        ground = self.ground = Ground(self.model, self.pencil, units, columns)
        self.load_gaps, self.load_tips = columns.gaps.copy(), columns.tips.copy()
        self.load_gaps[:, ground.edges] += ground.gaps
        self.load_tips[:, ground.edges] += ground.tips
        self.pushing = np.delete(np.arange(self.loads), ground.edges)
        self.free_gap, self.force, self.amplitudes = self.gap0, np.zeros(count), np.zeros(self.loads)
        self.rates = np.zeros(len(ground.edges))
        gaps, forces, points = probe_rows(self.pencil, units, columns.forces, ground, gap.rows.matrix[:count])
        self.probes = sparse.vstack([gaps, forces, points, ground.rows], format="csr")
        self.gap_columns, self.load_columns = SparseColumns(gaps), SparseColumns(forces)

    @stage("Contact")
    def _respond(self) -> None:
        """Responses to unit contact forces within a step: at the probes, and if they are kept of all
        unknowns.
        """
        size, count = self.u.size, self.pairs
        kept = count <= KEPT_RESPONSES
        self.responses = np.empty((size, count), order="F") if kept else None
        self.probe_responses = np.empty((self.probes.shape[0], count))
        width = block_width(self.model.layout)
        for first in range(0, count, width):
            block = slice(first, min(first + width, count))
            found = self.solve.of_rows(self.model.contact.rows, block)
            found /= self.stretch
            self.probe_responses[:, block] = self.probes @ found
            if self.responses is not None:
                self.responses[:, block] = found
        self.probe_responses = self.summed(self.probe_responses)

    def _modes(self, found: Modal | None) -> None:
        """Modes over all unknowns, and the scalars of their steps."""
        pencil = self.pencil
        self.omega = 2.0 * np.pi * found.frequencies if found is not None else np.zeros(0)
        self.phi = np.zeros((self.u.size, 0))
        if found is not None:
            self.phi = pencil.full_shapes(found.shapes, self.omega)
        self.probe_modes = self.summed(self.probes @ self.phi)
        self.gap_modes = self.probe_modes[: self.pairs]
        self.tip_modes = self.model.tips.intensities.rows(self.phi[: pencil.owned])
        self.friction = 2.0 * modal_ratios(self.model.damping, self.omega) * self.omega
        left = self.inertia + self.stretch * self.omega**2
        self.left = np.array([left + self.rate * self.friction, left])

    def summed(self, array: np.ndarray) -> np.ndarray:
        """Sum over the ranks. Collective."""
        return summed(self.model.comm, array)

    def _times(self, matrix: PETSc.Mat, array: np.ndarray) -> np.ndarray:
        self.d.array = array
        matrix.mult(self.d, self.product)
        return self.product.array_r.copy()

    # ------------------------------------------------------------------ state
    def settle(self, fold: bool = True) -> None:
        """Bring the damping's share into the large vectors, and everything carried along beside u and v back
        to what follows from them.

        Called between chunks of steps: the continuation of a history depends on u and v alone, and round-off
        does not pile up. Without `fold`, u and v have been set to the structure's state.
        """
        if fold:
            self.u += self.phi @ np.subtract(*self.q)
            self.v += self.phi @ np.subtract(*self.p)
        self.mass_v, self.stiffness_u = (
            self._times(self.pencil.mass, self.v),
            self._times(self.pencil.stiffness, self.u),
        )
        self.at_u, self.at_v = self.summed(self.probes @ self.u), self.summed(self.probes @ self.v)
        self.q, self.p = (
            np.tile(self.summed(self.phi.T @ momentum), (2, 1))
            for momentum in (self._times(self.pencil.mass, self.u), self.mass_v)
        )
        self.contact.forget()

    def displacements(self) -> np.ndarray:
        """Probes of the displacement."""
        return self.at_u + self.probe_modes @ np.subtract(*self.q)

    def resting_insides(self) -> np.ndarray:
        """This rank's auxiliary unknowns at rest under the loads: a moving base pushes them, too."""
        rows = self.probes[self.pairs + self.pushing][:, self.pencil.owned :]
        return rows.T @ self.amplitudes[self.pushing] / self.pencil.auxiliary_diagonal(0.0)

    def whole(self) -> np.ndarray:
        """This rank's displacement unknowns, with what follows prescribed displacements, then auxiliary
        ones.
        """
        found = self.u + self.phi @ np.subtract(*self.q)
        found[: self.pencil.owned] += self.ground.owned @ self._moved
        return found

    def _against_supports(self) -> np.ndarray:
        """The same without what follows prescribed displacements."""
        count = self.pencil.owned
        return self.u[:count] + self.phi[:count] @ np.subtract(*self.q)

    @property
    def _moved(self) -> np.ndarray:
        """(edges,): prescribed displacements, m."""
        return self.amplitudes[self.ground.edges]

    def velocities(self) -> np.ndarray:
        """Probes of the velocity."""
        return self.at_v + self.probe_modes @ np.subtract(*self.p)

    def at_points(self) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (points, 2) of the named points."""
        first, points = self.pairs + self.loads, self.ground.points
        places, speeds = (
            part[first : first + len(points)] + points @ edges
            for part, edges in ((self.displacements(), self._moved), (self.velocities(), self.rates))
        )
        return places.reshape(-1, 2), speeds.reshape(-1, 2)

    def intensities(self) -> np.ndarray:
        """(tips, 2): K_I and K_II, Pa m^(1/2)."""
        tips = self.model.tips.intensities.rows
        if not len(tips):
            return np.zeros((0, 2))
        moved = tips(self._against_supports())
        inside = (
            self.model.tips.intensities.contact[:, : self.pairs] @ self.force
            + self.load_tips @ self.amplitudes
        )
        return (moved + inside).reshape(-1, 2)

    def padded(self, force: np.ndarray, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces and gaps of all contact rows, also where contact is switched off: no forces then."""
        operator = self.model.contact
        if self.pairs == len(operator):
            return force, gap
        free = operator.initial + self.load_gaps @ self.amplitudes
        return np.zeros(len(operator)), operator.rows(self._against_supports()) + free

    def energies(self) -> np.ndarray:
        """Kinetic and strain energy, J."""
        local = self.summed(np.array([self.v @ self.mass_v, self.u @ self.stiffness_u]))
        modal = [(part**2).sum(axis=1) for part in (self.p, self.omega * self.q)]
        energies = 0.5 * (local + np.subtract(*np.transpose(modal)))
        stored, ground = np.array([0.0, self.stored]), self.ground
        if len(self.rates):
            momentum = -self.velocities()[self.pairs + ground.edges] + 0.5 * ground.heavy @ self.rates
            stored += [self.rates @ momentum, 0.5 * self._moved @ ground.stiff @ self._moved]
        return energies + stored

    # ------------------------------------------------------------------ steps
    def advance(
        self, drive: np.ndarray, after: np.ndarray, rates: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """One step under load amplitudes whose mean is half of `drive`, and which are `after` at its end,
        prescribed displacements with their rates; contact forces and gaps there.
        """
        speed, before = self.velocities(), self._moved
        self.free_gap, self.amplitudes = self.free_gaps(after), after
        solved = self._take(self._driven(drive, rates))
        applied, gained = 2.0 * solved.force, self.velocities() - speed
        self.slope = self._slope(gained / self.step, drive, applied, rates)
        if len(rates):
            self._account(gained, drive, applied, rates, self._moved - before)
        self.rates = rates
        self.force = solved.force
        stored, self.stored = self.stored, self.stored_in(solved.force)
        # held over the step, friction takes its full value times the way, of what lands from there on
        lost = float(self.force[len(self.laws) :] @ (self.contact.kept - self.contact.slip))
        self.work[2:] += lost
        self.work[2] += self.stored - stored
        return solved.force, solved.gap

    def advance_linearised(self, acting: np.ndarray) -> None:
        """One step of a small disturbance of a motion whose rows `acting` (c,) keep their gaps in it."""
        self._take(np.zeros(self.loads), acting)

    def free_gaps(self, amplitudes: np.ndarray) -> np.ndarray:
        """(c,): gaps under load amplitudes while nothing moves against the supports, m."""
        return self.gap0 + (self.load_gaps @ amplitudes)[: self.pairs]

    def _driven(self, drive: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Twice the mean loads of a step: of prescribed displacements their acceleration, by the change of
        their rates to those at its end.
        """
        if not len(rates):
            return drive
        drive = drive.copy()
        drive[self.ground.edges] = self.rate * (rates - self.rates)
        return drive

    def _slope(
        self, gained: np.ndarray, drive: np.ndarray, applied: np.ndarray, rates: np.ndarray
    ) -> np.ndarray:
        """See `slope`, of a step with mean accelerations `gained` of the probes, loads and contact forces
        whose means are half of `drive` and `applied`, and the rates at its end.
        """
        turned, mean = rates - self.rates, 0.5 * (rates + self.rates)
        ground, edges = self.ground, self.ground.edges
        slope, points = gained[self.pairs + self.loads :].copy(), len(ground.points)
        slope[:points] += ground.points @ turned / self.step
        slope[points:] += 0.5 * (ground.loads @ drive + ground.contact[:, : self.pairs] @ applied)
        slope[points:] += ground.damping[:, edges] @ mean + ground.mass[:, edges] @ turned / self.step
        return slope

    def _account(
        self,
        gained: np.ndarray,
        drive: np.ndarray,
        applied: np.ndarray,
        rates: np.ndarray,
        change: np.ndarray,
    ) -> None:
        """Replace the work of what prescribed displacements do as loads by that of what supports bear, and
        contact's on what follows them, see `_slope`: of changes of velocities and of displacements.
        """
        turned, mean = rates - self.rates, 0.5 * (rates + self.rates)
        ground = self.ground
        at = self.pairs + ground.edges
        lost = self.step * mean @ ground.damped @ mean
        pressed = 0.5 * change @ ground.pressed[:, : self.pairs] @ applied
        self.work[0] += mean @ (ground.heavy @ turned - gained[at])
        self.work[0] += 0.5 * drive[ground.edges] @ ground.stiff @ change + lost + pressed
        self.work[1] += lost
        self.work[2] -= pressed

    def stored_in(self, force: np.ndarray) -> float:
        """Energy that contact forces store in the rows' own flexibility, J."""
        return 0.5 * float(force @ self.own_flexibility @ force)

    def _take(self, drive: np.ndarray, acting: np.ndarray | None = None) -> _Solved:
        """Solve a step and move the state."""
        solved = self.solve_step(drive, acting)
        self.pencil.stiffness.mult(self.d, self.product)
        lost = advance(
            (self.u, self.v, self.mass_v, self.stiffness_u),
            (self.d.array_r, self.product.array_r, self.right.array_r),
            (self.inertia, self.stretch, self.rate),
        )
        for place, velocity, change in (
            (self.at_u, self.at_v, solved.probes),
            (self.q, self.p, solved.modal),
        ):
            place += change
            velocity *= -1.0
            velocity += self.rate * change
        change = solved.probes + self.probe_modes @ np.subtract(*solved.modal)
        self.work[0] += 0.5 * drive[self.pushing] @ change[self.pairs + self.pushing]
        self.work[1] += self.friction @ solved.modal[0] ** 2 / self.step
        self.work[2] += solved.force @ change[: self.pairs]
        if any(self.rayleigh):
            # the large vectors moved as the undamped modes do: these are exchanged for the damped ones
            a, b = self.rayleigh
            local = float(self.summed(np.array([a * lost[0] + b * lost[1]]))[0])
            self.work[1] += (local + (a + b * self.omega**2) @ np.subtract(*solved.modal**2)) / self.step
        return solved

    def solve_step(self, drive: np.ndarray, acting: np.ndarray | None = None) -> _Solved:
        """Solve a step for `d` with its contact problem, whose forces join `right`; the state stays.

        With `acting` (c,) the problem is the linearised one: these rows keep their gaps, there are no others.
        """
        form(self.right.array, self.mass_v, self.stiffness_u, self.rate)
        if self.loads:
            self.load_columns.add(self.right.array, drive)
        self._solve_for_increment()
        probes = self.summed(self.probes @ self.d.array_r)
        modal_force = self.probe_modes[self.pairs : self.pairs + self.loads].T @ drive
        modal = self._modal(modal_force)
        force, gap = np.zeros(self.pairs), np.zeros(self.pairs)
        if self.pairs:
            gap = (self.displacements() + probes + self.probe_modes @ np.subtract(*modal))[: self.pairs]
            if acting is None:
                gap = gap + self.free_gap
                touched = self.laws.touched(gap[: len(self.laws)]).any()
            else:
                touched = acting.any()
            if touched:
                force, gap = self.contact.solve(gap) if acting is None else self.contact.held(gap, acting)
                self._push(2.0 * force)
                probes += self.probe_responses @ (2.0 * force)
                modal = self._modal(modal_force + self.gap_modes.T @ (2.0 * force))
            else:
                self.contact.open(gap)
        return _Solved(probes, modal, force, gap)

    def _solve_for_increment(self) -> None:
        """d of `right`."""
        self.solve.apply(None, self.right, self.d)
        if self.stretch != 1.0:
            self.d.scale(1.0 / self.stretch)

    def _push(self, force: np.ndarray) -> None:
        """Let contact forces join `right`, and what they do `d`."""
        if not force.any():
            return
        self.gap_columns.add(self.right.array, force)
        if self.responses is None:
            self._solve_for_increment()
        else:
            add_columns(self.d.array, self.responses, force)

    def _modal(self, force: np.ndarray) -> np.ndarray:
        """Increments of the modal coordinates, damped and not."""
        return (2.0 * (self.rate * self.p - self.omega**2 * self.q) + force) / self.left

    def first_slope(self, drive: np.ndarray, after: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """See `slope`, of the first step, see `advance`, which is not taken."""
        self.free_gap = self.free_gaps(after)
        gap = self.contact.gap
        solved = self.solve_step(self._driven(drive, rates))
        self.contact.open(gap)
        self.contact.forget()
        change = solved.probes + self.probe_modes @ np.subtract(*solved.modal)
        gained = self.rate * (change / self.step - self.velocities())
        return self._slope(gained, drive, 2.0 * solved.force, rates)

    def fingerprint(self) -> np.ndarray:
        """(probes, pairs + loads): responses of the probes to unit contact forces and unit loads within a
        step, which tell models apart. Collective.
        """
        responses = np.empty((self.u.size, self.loads))
        for k in range(self.loads):
            self.right.array = self.probes[[self.pairs + k]].toarray()[0]
            self._solve_for_increment()
            responses[:, k] = self.d.array_r
        return np.concatenate([self.probe_responses, self.summed(self.probes @ responses)], axis=1)

    def release(self) -> None:
        """Free the PETSc objects."""
        free(self.model.comm, self.d, self.product, self.right)
        self.solve.release()
