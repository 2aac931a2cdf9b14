"""Periodic motions of the unreduced model: shooting without a matrix, on PETSc (prefix ``shooting_``).

The period map is that of `UnreducedSteps`, the state (u, v) of all unknowns is distributed. A product with
its derivative is one linearised period: the same steps without loads, in which the rows that touched in each
step keep their gaps. GMRES is preconditioned by the motion without contact in the lowest modes, closed form;
what lies above them dies out within the period, as stiffness-proportional damping makes it. Only what is
stiffer than the time steps resolve does not: average acceleration turns its sign in each step and leaves its
size. The number of steps is therefore odd, so that Phi - 1 is about -2 there and not about 0.
"""

from __future__ import annotations

import numpy as np

from ...capacity import require_compiler, require_memory
from ...checks import positive
from ...errors import SolveError, on_all_ranks
from ...motion.excitation import Excitation
from ...motion.integration import Steps, row_size
from ...motion.loading import loading, warn_of_unreduced
from ...motion.preparation import STEPS, PeriodSettings
from ...motion.states import SampledStates
from ...motion.unreduced.history import unreduced_columns
from ...motion.unreduced.kept_fields import KeptFields
from ...motion.unreduced.steps import KEPT_RESPONSES, UnreducedSteps
from ...parallel import collective
from ...petsc import PETSc, configure, finite, free, scripted, solving, stage
from ...signals.waves import Harmonic
from ...system.demand import require_steps
from ...system.model import Model
from ...system.modes import lowest_modes
from ...system.pencil import Pencil
from ..orbit import Orbit
from ..shooting import PREFIX, snes_reason

# The linear solves need no more than Newton's next iterate is good for.
RELATIVE, LINEAR, ITERATIONS, RESTART = 1e-8, 1e-4, 20, 100
# Residual relative to the state that the round-off of a period's steps may leave: 4e-12 was measured.
ROUND_OFF = 1e-11


# Periods integrated before another search, where Newton's method fails from the linear steady state: bodies
# that overlap in it are thrown apart, and no iterate shows how the motion settles.
SETTLING = (10, 40)

# Modes of the preconditioner and of the first guess by default.
MODES = 40


def unreduced_periodic(model: Model, load, frequency: float, *, settings: PeriodSettings) -> Orbit:
    """Find the periodic response of the unreduced model; see `analysis.periodic.periodic` for the arguments.

    Its steps are one more in all if they are even in number; its modes are those of the preconditioner and of
    the first guess, and those that have the model's modal damping ratio.

    Notes
    -----
    What lies above the computed modes is damped by the model's Rayleigh part alone: without `rayleigh` its
    motion never dies out, and the linear solves do not converge.

    Raises
    ------
    SolveError
        If Newton's method or a linear solve does not converge.
    """
    model.require_support("periodic")
    with collective(model.comm):
        positive("periodic", "frequency", frequency, "Hz")
        loads = loading("periodic", model, load, lambda value: Harmonic(value, frequency))
        excitation = Excitation.of(loads.signals, frequency, settings.periods, settings.longest)
        if model.rayleigh[1] == 0.0:
            raise ValueError(
                "periodic: the unreduced model needs stiffness-proportional damping, Model(rayleigh=(a, b)) "
                "with b > 0: without it motions above the computed modes never die out, and no steady state "
                "is reached"
            )
    count = (settings.steps or STEPS) * excitation.periods | 1
    excitation = excitation.below(0.5 * count)
    modes = settings.modes or MODES
    _require_room(model, count, modes)
    warn_of_unreduced("periodic", model, loads, modes)
    found = lowest_modes(model, modes, auxiliary_tolerance=0.0)
    pencil = Pencil(model, 1.0, 0.0)
    try:
        step = excitation.periods / frequency / count
        steps = Steps(count, step, settings.contact, "implicit", 1)
        march = UnreducedSteps(model, pencil, loads.units, steps, found)
        try:
            fields = KeptFields(model, loads.units, count)
            return _UnreducedPeriod(march, excitation, frequency, count, fields=fields).solve()
        finally:
            march.release()
    finally:
        pencil.destroy()


def _require_room(model: Model, count: int, modes: int) -> None:
    """Refuse a period whose instants, or whose matrices and Krylov vectors, would take more memory than is
    free. Collective.
    """
    require_compiler("periodic", model.comm)
    # lists of small arrays, then arrays of all, rolled
    row = 3 * row_size(unreduced_columns(model)) + 1000
    require_memory(
        "periodic",
        model.comm,
        float(count * row),
        f"{count:,d} steps a period",
        lambda share: f"give at most {int(share * count):,d}",
    )
    # GMRES keeps two vectors (u, v) an iteration; few take more than a quarter of its most
    require_steps("periodic", model, modes, KEPT_RESPONSES, vectors=RESTART // 2)


class _UnreducedPeriod:
    """The period map of a march, its derivative and its fixed point."""

    def __init__(
        self,
        march: UnreducedSteps,
        excitation: Excitation,
        frequency: float,
        count: int,
        *,
        fields: KeptFields,
    ):
        self.fields = fields
        self.march, self.excitation, self.frequency, self.count = march, excitation, frequency, count
        self.amplitudes = excitation.loads(count)
        # displacements are weighed with the forcing frequency to be velocities
        self.weight, self.size = 2.0 * np.pi * frequency, march.u.size
        self.products, self.residuals = 0, list[float]()
        self.key: np.ndarray | None = None

    @stage("Steps")
    def run(self, state: np.ndarray, record: bool = False):
        """x(T) of x(0) = (weight u, v), this rank's part; the pairs that touch in each step; with `record`
        also displacements of the points, forces and gaps.
        """
        march, sets, rows = self.march, np.zeros((self.count, self.march.pairs), dtype=bool), []
        self._set(state)
        march.contact.open()
        for k in range(self.count):
            force, gap = march.advance(self.amplitudes[k] + self.amplitudes[k + 1], self.amplitudes[k + 1])
            sets[k] = march.laws.acting(force)
            if record:
                places, speeds = march.at_points()
                rows.append((places, speeds, *march.padded(force, gap), march.intensities()))
                if self.fields.wanted:
                    self.fields.add(march.owned(), march.amplitudes)
        march.settle()
        return self._get(), sets, rows

    @stage("Steps")
    def linearised(self, vector: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """dx(T) along dx(0)."""
        self._set(vector)
        for acting in sets:
            self.march.advance_linearised(acting)
        self.march.settle()
        self.products += 1
        return self._get()

    def _set(self, state: np.ndarray) -> None:
        self.march.u[:], self.march.v[:] = state[: self.size] / self.weight, state[self.size :]
        self.march.settle(fold=False)

    def _get(self) -> np.ndarray:
        return np.concatenate([self.weight * self.march.u, self.march.v])

    # ------------------------------------------------------------------ the lowest modes without contact
    def _modal_map(self) -> np.ndarray:
        """(m, 2, 2): the period map of each computed mode without loads and contact, in (weight q, p)."""
        march = self.march
        # d = q1 - q0 of a free step, p1 = 2 d / h - p0
        to_q, to_p = -2.0 * march.omega**2 / march.left_damped, 2.0 * march.rate / march.left_damped
        step = np.moveaxis(
            np.array(
                [[1.0 + to_q, self.weight * to_p], [march.rate * to_q / self.weight, march.rate * to_p - 1.0]]
            ),
            2,
            0,
        )
        return np.linalg.matrix_power(step, self.count)

    def precondition(self, vector: np.ndarray) -> np.ndarray:
        """(Phi - 1)^-1 of the motion without contact: closed form in the modes, -1 above them."""
        march = self.march
        parts = [part.copy() for part in np.split(vector, 2)]
        modal_parts = np.stack(
            [march.summed(march.phi.T @ march._times(march.pencil.mass, part)) for part in parts], axis=1
        )
        solved = np.linalg.solve(self._map - np.eye(2), modal_parts[..., None])[..., 0] + modal_parts
        return np.concatenate([march.phi @ solved[:, k] - parts[k] for k in (0, 1)])

    def first_guess(self) -> np.ndarray:
        """x(0) of the linear steady state in the computed modes."""
        march = self.march
        forces = self.excitation.amplitudes @ march.probe_modes[march.pairs : march.pairs + march.loads]
        rates = 2.0 * np.pi * self.excitation.orders[:, None] * self.frequency / self.excitation.periods
        a, b = march.rayleigh
        q = forces / (march.omega**2 - rates**2 + 1j * rates * (march.friction + a + b * march.omega**2))
        return np.concatenate(
            [self.weight * (march.phi @ q.sum(axis=0).real), march.phi @ (1j * rates * q).sum(axis=0).real]
        )

    # ------------------------------------------------------------------ Newton's method
    def solve(self) -> Orbit:
        """The fixed point."""
        comm = self.march.model.comm
        self._map = self._modal_map()
        x = PETSc.Vec().createMPI((2 * self.size, None), comm=comm)
        f = x.duplicate()
        x.array = self.first_guess()
        snes = PETSc.SNES().create(comm)
        snes.setOptionsPrefix(PREFIX)
        sizes = x.getSizes()
        matrix = PETSc.Mat().createPython([sizes, sizes], context=_Products(self), comm=comm)
        matrix.setUp()
        snes.setFunction(self._function, f)
        snes.setJacobian(self._jacobian, matrix)
        ksp = snes.getKSP()
        ksp.setType(PETSc.KSP.Type.FGMRES)
        ksp.setGMRESRestart(RESTART)
        ksp.setTolerances(rtol=LINEAR, max_it=3 * RESTART)
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(_Precondition(self))
        norm = float(np.sqrt(self.march.summed(np.array([x.array_r @ x.array_r]))[0]))
        guess, path = x.array_r.copy(), "Newton"
        snes.setTolerances(
            rtol=RELATIVE, atol=finite(ROUND_OFF * max(norm, 1e-300)), stol=0.0, max_it=ITERATIONS
        )
        snes.setMonitor(lambda _, iteration, value: self.residuals.append(float(value)))
        try:
            with solving("periodic"), scripted(matrix, pc):
                configure(snes)
                snes.solve(None, x)
                for periods in SETTLING:
                    if snes.getConvergedReason() > 0:
                        break
                    for _ in range(periods):
                        guess = self.run(guess)[0]
                    x.array, path = guess, "history"
                    self.residuals.clear()
                    snes.solve(None, x)
            reason = snes.getConvergedReason()
            if reason <= 0:
                raise on_all_ranks(
                    SolveError(
                        "periodic: Newton's method on the unreduced model did not converge "
                        f"({snes_reason(reason)} after {snes.getIterationNumber()} iterations): x(T) - x(0) "
                        "is at "
                        f"{self.residuals[-1] / max(self.residuals[0], 1e-300):.2e} of the first one; more "
                        f"modes, more stiffness-proportional damping, or see -{PREFIX}snes_..., "
                        f"-{PREFIX}ksp_..."
                    )
                )
            state, _, rows = self.run(x.array_r.copy(), record=True)
        finally:
            free(comm, snes, ksp, pc, x, f, matrix)
        march = self.march
        # the last instant is the first one: the rows begin after it
        places, speeds, forces, gaps, intensities = (
            np.roll(np.array(part), 1, axis=0) for part in zip(*rows)
        )
        # the mean of the accelerations of the two steps beside an instant
        slopes = (np.roll(speeds, -1, axis=0) - np.roll(speeds, 1, axis=0)) / (2.0 * march.step)
        names, tips = march.model.points, march.model.tips.facts
        at_places, at_speeds, at_slopes = (
            {name: part[:, k] for k, name in enumerate(names)} for part in (places, speeds, slopes)
        )
        states = SampledStates(
            at_places,
            at_speeds,
            at_slopes,
            forces,
            gaps,
            march.model.gap_operator.pairs,
            {name: intensities[:, k] for k, name in enumerate(tips.names)},
            tips,
            self.fields.rolled(1).complete(self.count) if self.fields.wanted else None,
        )
        return Orbit(
            np.arange(self.count) * march.step,
            states,
            self.frequency,
            self.excitation.periods,
            tuple(self.residuals),
            path,
            products=self.products,
        )

    def _motion(self, array: np.ndarray):
        same = self.key is not None and np.array_equal(self.key, array)
        if not self.march.summed(np.array([float(same)]))[0] == self.march.model.comm.size:
            self.key, self.kept = array.copy(), self.run(array)
        return self.kept

    def _function(self, snes, x, f) -> None:
        array = x.array_r.copy()
        f.array = self._motion(array)[0] - array

    def _jacobian(self, snes, x, matrix, preconditioner) -> None:
        matrix.getPythonContext().sets = self._motion(x.array_r.copy())[1]
        matrix.assemble()


class _Products:
    """Phi - 1 as products: one linearised period each."""

    sets: np.ndarray

    def __init__(self, period: _UnreducedPeriod):
        self.period = period

    def mult(self, matrix, x, y) -> None:
        vector = x.array_r.copy()
        y.array = self.period.linearised(vector, self.sets) - vector


class _Precondition:
    """The motion without contact in the lowest modes."""

    def __init__(self, period: _UnreducedPeriod):
        self.period = period

    def setUp(self, pc) -> None:
        pass

    def apply(self, pc, x, y) -> None:
        y.array = self.period.precondition(x.array_r)
