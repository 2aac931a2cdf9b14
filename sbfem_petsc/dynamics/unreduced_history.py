"""Time histories of the unreduced model: Newmark's average acceleration on PETSc (prefix ``newmark_``),
contact implicit in each step.

A step solves (4/h^2 M + 2/h C + K) (u1 - u0) = 4/h M v0 - 2 K u0 + f0 + f1 + 2 G^T force with a matrix
factorised once (`full_march`). Nodes on crack faces have mass here. The contact force is that of the step
alone (Kane et al. 1999; Deuflhard, Krause and Ertel 2008): it is not carried into the next step's
acceleration, so contact dissipates and never feeds energy in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from ..analysis.modal import modal
from ..analysis.static import static
from ..errors import UnknownName, at_point
from ..loads import Loads, separate
from ..system.model import Model
from ..system.pencil import Pencil
from .energy import Energy
from .initial import nodal_field, owned_values
from .unreduced_steps import FullMarch

# Steps between two settlements of the state, records on disk and reports of progress.
CHUNK = 256


@dataclass(frozen=True, eq=False)
class FullTransient:
    """A time history of the unreduced model.

    Attributes
    ----------
    time : (n,) array
        s, from 0.
    point_displacements, point_velocities, point_accelerations : dict of str to (n, 2) array
        m, m/s and m/s^2, on all ranks.
    contact_force, gap : (n, pairs) arrays
        N (mean of the step that ends at the instant) and m.
    energy : Energy
        The contact's work is what it dissipates, with a minus sign.
    step : float
        Time step of the integration, s.
    damping : float
        Modal damping ratio met in the lowest `damped_modes` modes.
    damped_modes : int
    rayleigh : (float, float)
        a (1/s) and b (s) of the damping matrix a M + b K beside it.
    tip_intensities : dict of str to (n, 2) array
        K_I and K_II, Pa m^(1/2).
    """

    time: np.ndarray
    point_displacements: dict[str, np.ndarray]
    point_velocities: dict[str, np.ndarray]
    point_accelerations: dict[str, np.ndarray]
    contact_force: np.ndarray
    gap: np.ndarray
    energy: Energy
    step: float
    damping: float
    damped_modes: int
    rayleigh: tuple[float, float]
    tip_intensities: dict[str, np.ndarray]

    def displacement(self, point: str) -> np.ndarray:
        """(n, 2): displacement of a named point, m."""
        return at_point(self.point_displacements, point)

    def velocity(self, point: str) -> np.ndarray:
        """(n, 2): velocity of a named point, m/s."""
        return at_point(self.point_velocities, point)

    def acceleration(self, point: str) -> np.ndarray:
        """(n, 2): acceleration of a named point, m/s^2, extrapolated from the mean ones of the last two
        steps; at first the mean of the first step.
        """
        return at_point(self.point_accelerations, point)

    def stress_intensity(self, crack: str = "crack1") -> np.ndarray:
        """(n, 2): K_I and K_II of a tip, Pa m^(1/2)."""
        if crack not in self.tip_intensities:
            raise UnknownName(
                f"crack {crack!r} does not exist; the model has "
                f"{', '.join(map(repr, self.tip_intensities)) or 'none'}"
            )
        return self.tip_intensities[crack]

    @property
    def contact_resultant(self) -> np.ndarray:
        """(n,): sum of the contact forces, N."""
        return self.contact_force.sum(axis=1)

    def __repr__(self) -> str:
        damped = f", damping ratio {self.damping:g} in {self.damped_modes} modes" if self.damping else ""
        return (
            f"{type(self).__name__}({len(self.time)} instants to {self.time[-1]:.6g} s, step {self.step:.3g} "
            f"s{damped}, "
            f"peak contact resultant {self.contact_resultant.max(initial=0.0):.6g} N, largest energy error "
            f"{np.abs(self.energy.balance).max():.2e} J)"
        )


def full_transient(
    model: Model,
    load,
    count: int,
    step: float,
    contact: bool = True,
    scheme: str = "implicit",
    decimation: int = 1,
    start="rest",
    modes: int = 0,
    progress: Callable[[float], None] | None = None,
    file: str | None = None,
    restart: bool = False,
    in_memory: bool = True,
) -> FullTransient:
    """Integrate the unreduced model over `count` steps.

    Parameters
    ----------
    model : Model
        Its damping ratio is that of the `modes` lowest modes, C = sum of 2 zeta omega (M phi)(M phi)^T, and
        everything above them is undamped but for Rayleigh's a M + b K. Two frequencies met by a M + b K
        instead are `Model(rayleigh=rayleigh_factors(ratio, low, high))`.
    load : loads with numbers or signals
    count : int
    step : float
        s.
    contact : bool
    scheme : {"implicit", "paper"}
        "paper": eqs. (28)-(34) of Sepehry et al.: pairs that penetrate are tied in one pass, tension allowed,
        and the multiplier is carried in the acceleration. It is there to be compared with: contact feeds
        energy in without bound, the sooner the smaller the step. On the default mesh of the paper's beam,
        burst of 300 N and 33 ms: +1.4 % at 2 us (10 times the work supplied at 81 ms, long after the load),
        +2.9 % at 1 us, stopped at 26 ms at 0.5 us; without continued fraction at 29 ms at 2 us.
    decimation : int
    start : {"rest", "equilibrium"} or (displacement, velocity)
        Functions of x and y (m, arrays) that give (u_x, u_y), or None for zero, see `transient`.
    modes : int
        Number of modes that are computed where the model has a damping ratio.
    progress : callable, optional
    file, restart, in_memory
        See `transient`; a restart needs the same number of ranks.

    Raises
    ------
    SolveError
        If a linear or contact solve fails, or the energy of the paper's scheme has run away.
    """
    model.require_support("the transient analysis")
    units, signals = separate(load)
    found = modal(model, modes, auxiliary_tolerance=0.0) if model.damping else None
    pencil = Pencil(model, 1.0, 0.0)
    march = FullMarch(model, pencil, units, step, found, contact, scheme)
    rows = _Rows(model, march, found)
    try:
        force = _set_start(march, units, signals, contact, start)
        march.initial = float(march.energies().sum())
        if file is None:
            return _integrate(march, rows, signals, force, count, decimation, progress)
        from ..results.full_history import FullHistoryFile  # stands above this module

        with FullHistoryFile(
            march, file, restart, signals, count, contact, start, decimation, in_memory
        ) as record:
            return _integrate(march, rows, signals, force, count, decimation, progress, record)
    finally:
        rows.release()
        march.release()
        pencil.destroy()


class _Rows:
    """What is kept of an instant: time, displacements, velocities and accelerations of the points, contact
    forces, gaps, energies, stress intensities.
    """

    def __init__(self, model: Model, march: FullMarch, found):
        self.model, self.march = model, march
        tips = len(model.tips.names)
        self.tip_modes = np.zeros((tips, 2, len(march.omega)))
        if tips:
            for k in range(len(march.omega)):
                self.tip_modes[:, :, k] = list(model.tips.evaluate(found.nodal(k)).values())
        self.vector = model.stiffness.createVecRight()

    def row(
        self, time: float, acceleration: np.ndarray, force: np.ndarray, gap: np.ndarray, energies: np.ndarray
    ) -> tuple:
        """Values at the present instant."""
        march = self.march
        places, speeds = (
            part[march.pairs + march.loads :].reshape(-1, 2)
            for part in (march.displacements(), march.velocities())
        )
        intensity = np.zeros((len(self.tip_modes), 2))
        if len(intensity):
            self.vector.array = march.u[: march.pencil.owned]
            intensity = np.array(
                list(self.model.tips.evaluate(self.model.nodal(self.vector)).values())
            ) + self.tip_modes @ (march.q - march.q0)
        return (
            np.float64(time),
            places,
            speeds,
            acceleration,
            force,
            gap,
            np.concatenate([energies, march.work]),
            intensity,
        )

    def history(self, parts: list[tuple]) -> FullTransient:
        """The history of chunks of rows, each an array for every name."""
        model, march = self.model, self.march
        arrays = [part[0] if len(part) == 1 else np.concatenate(part) for part in zip(*parts)]
        return assembled(
            arrays,
            tuple(model.points),
            model.tips.names,
            march.step,
            model.damping,
            len(march.omega),
            model.rayleigh,
        )

    def release(self) -> None:
        """Free the vector."""
        self.vector.destroy()


def assembled(
    rows, points, tips, step, damping, modes, rayleigh, kind=FullTransient, **more
) -> FullTransient:
    """A history from its rows, an array for each of what `_Rows.row` gives."""
    time, places, speeds, accelerations, force, gap, energies, intensity = rows
    at = [{name: field[:, k] for k, name in enumerate(points)} for field in (places, speeds, accelerations)]
    return kind(
        time,
        *at,
        force,
        gap,
        Energy(*energies.T),
        step,
        damping,
        modes,
        rayleigh,
        {name: intensity[:, k] for k, name in enumerate(tips)},
        **more,
    )


def _integrate(
    march: FullMarch,
    rows: _Rows,
    signals,
    force: np.ndarray,
    count: int,
    decimation: int,
    progress,
    record=None,
) -> FullTransient:
    """All steps, in chunks that end with a settled state."""
    step = march.step

    def loads(time):
        return np.stack([s(time) for s in signals], axis=-1) if signals else np.zeros((len(time), 0))

    done, parts = record.resume() if record is not None else (0, [])
    if not parts:
        slope = march.first_slope(loads(np.array([0.0, step])).sum(axis=0))
        march.slope = slope
        gap = march.displacements()[: march.pairs] + march.gap0
        parts = [_stacked([rows.row(0.0, slope, force, gap, march.energies())])]
        if record is not None:
            record.append(0, parts[0])
    while done < count:
        steps = min(CHUNK, count - done)
        time = (done + np.arange(steps + 1)) * step
        amplitudes, chunk = loads(time), []
        for k in range(steps):
            slope = march.slope
            force, gap = march.advance(amplitudes[k], amplitudes[k + 1])
            kept = (done + k + 1) % decimation == 0
            if kept or march.scheme == "paper":
                energies = march.energies()
                if march.scheme == "paper" and done + k > 20:
                    march.check_energy(energies, time[k + 1])
                if kept:
                    chunk.append(rows.row(time[k + 1], 1.5 * march.slope - 0.5 * slope, force, gap, energies))
        march.settle()
        done += steps
        parts.append(_stacked(chunk) if chunk else tuple(part[:0] for part in parts[0]))
        if record is not None:
            record.append(done, parts[-1])
            if not record.in_memory:
                parts[:] = [tuple(part[:0] for part in parts[0])]
        if progress is not None:
            progress(done / count)
    return rows.history(parts if record is None or record.in_memory else record.history())


def _stacked(chunk: list[tuple]) -> tuple:
    return tuple(np.array(part) for part in zip(*chunk))


def _set_start(march: FullMarch, units, signals, contact: bool, start) -> np.ndarray:
    """Set the state at t = 0; the contact forces there."""
    model, force = march.model, np.zeros(march.pairs)
    if isinstance(start, str):
        if start == "rest" or not units:
            return force
        now = Loads(
            tuple(_scaled(unit, float(signal(np.zeros(1))[0])) for unit, signal in zip(units, signals))
        )
        found = static(model, now, contact=contact)
        march.u[: march.pencil.owned] = owned_values(model, found.field)
        force = found.contact_force[: march.pairs].copy()
    else:
        # zero auxiliary unknowns: inside the S-elements the static displacement of their boundaries' one
        for state, function, what in zip((march.u, march.v), start, ("displacement", "velocity")):
            state[: march.pencil.owned] = owned_values(model, nodal_field(model, function, what))
    march.settle(fold=False)
    return force


def _scaled(unit, factor: float):
    return replace(
        unit,
        **{
            f.name: factor * getattr(unit, f.name)
            for f in fields(unit)
            if isinstance(getattr(unit, f.name), (int, float))
        },
    )
