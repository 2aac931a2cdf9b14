"""Motions of a structure, reduced or not: time histories, and what they share with steady states."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ..checks import Bounds, names_of, real, shown
from ..errors import SolveError, UnknownName, on_all_ranks
from ..parallel import agreed
from ..system.model import Model
from ..system.places import checked_line
from ..system.sampling import Field
from ..writing import write_table
from .energy import Energy
from .states import ModalStates, Point, SampledStates


@dataclass(frozen=True, eq=False)
class Motion:
    """Instants of a motion.

    Attributes
    ----------
    time : (n,) array
        s.
    states : ModalStates or SampledStates
        How they are kept: of a reduced or of an unreduced model.
    """

    time: np.ndarray
    states: ModalStates | SampledStates

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return self.states.points

    @property
    def reduced(self):
        """The reduced model that moves, None for an unreduced one."""
        return self.states.reduced if isinstance(self.states, ModalStates) else None

    @property
    def contact_force(self) -> np.ndarray:
        """(n, pairs): forces of the contact pairs, N, compression positive; those of an unreduced model are
        means over the step that ends at the instant.
        """
        return self.states.contact[:, : self.states.pairs]

    @property
    def contact_resultant(self) -> np.ndarray:
        """(n,): sum of all contact forces, those inside the tip elements included, N."""
        return self.states.contact.sum(axis=1)

    @property
    def gap(self) -> np.ndarray:
        """(n, pairs): gaps of the contact pairs, m."""
        return self.states.gap[:, : self.states.pairs]

    def displacement(self, point: Point) -> np.ndarray:
        """(n, 2): displacement of a named point, or of any point (x, y) in m, in m. Collective for (x, y)."""
        return self.states.displacement(point) if isinstance(point, str) else self._displacement_at(point)

    @agreed()
    def _displacement_at(self, place: tuple[float, float]) -> np.ndarray:
        """(n, 2): displacement at a place, m. Collective."""
        return self.states.displacement(place)

    def velocity(self, point: Point) -> np.ndarray:
        """(n, 2): velocity of a named point, m/s; that of a reduced model's modes."""
        return self.states.velocity(point)

    def acceleration(self, point: Point) -> np.ndarray:
        """(n, 2): acceleration of a named point, m/s^2; that of a reduced model's modes."""
        return self.states.acceleration(point)

    @agreed()
    def stress(self, place: Point) -> np.ndarray:
        """(n, 3): stress xx, yy, xy at a named point or at any point (x, y) in m, Pa. Collective."""
        return self.states.stress(place)

    @agreed()
    def along(
        self, start: tuple[float, float], end: tuple[float, float], count: int = 101
    ) -> tuple[np.ndarray, ...]:
        """Displacement and stress along a straight line. Collective.

        Returns
        -------
        places, displacement, stress : (count, 2), (n, count, 2), (n, count, 3) arrays
            m, m and Pa.

        Raises
        ------
        SolveError
            For the motion of an unreduced model that keeps no fields.
        """
        line, points = checked_line(start, end, count)
        return line, *self.states.along(points)

    def stress_intensity(self, tip: str | None = None) -> np.ndarray:
        """(n, 2): K_I and K_II of a crack tip, the first one by default, Pa m^(1/2) (at open notches as
        `notes` says).
        """
        if tip is None:
            if not self.states.tips:
                raise UnknownName("stress_intensity: the model has no crack tip with a tip element")
            tip = self.states.tips[0]
        return self.states.stress_intensity(tip)

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a named point, m; less than `least` where that is known to be so, and 0 of
        a history whose arrays are left in its file.
        """
        if isinstance(self.states.contact, np.memmap):
            return 0.0
        bound = self.states.bound()
        if bound < least:
            return bound
        moves = (np.linalg.norm(self.displacement(name), axis=-1).max() for name in self.points)
        return float(max(moves, default=0.0))

    @functools.cached_property
    def notes(self) -> tuple[str, ...]:
        """What K of the tips does not tell by itself: units at notches, that of a crack along an interface
        that closes G alone means something. They are printed too.
        """
        return self.states.tip_facts.notes(self.states.contact)

    @agreed()
    def field(self, time: float) -> Field:
        """The displacement field at the kept instant next to a time (s), for `plot_crack`, `write_vtu`, or,
        as an array (nodes, 2), m, that of this rank's nodes. Collective.

        Raises
        ------
        SolveError
            For the motion of an unreduced model that keeps no fields.
        """
        end = float(self.time[-1])
        at = real(
            "field", "time", time, "s", within=Bounds(least=float(self.time[0]), most=end * (1.0 + 1e-9))
        )
        return self.states.field(int(np.argmin(np.abs(self.time - at))))

    def to_csv(self, path: str, points: tuple[str, ...] | None = None) -> None:
        """Write time, displacements of points (default: all) and the contact resultant as comma-separated
        values.

        The file takes its name when it is whole.

        Raises
        ------
        TypeError, ValueError, KeyError
            If it cannot be written, or for an unknown point.
        """
        chosen = self.points if points is None else names_of("to_csv", "points", points)
        columns = {"time_s": self.time}
        for point in chosen:
            u = self.displacement(point)
            columns |= {f"ux_{point}_m": u[:, 0], f"uy_{point}_m": u[:, 1]}
        columns["contact_resultant_N"] = self.contact_resultant
        write_table(path, columns)


@dataclass(frozen=True, eq=False)
class History(Motion):
    """A time history; its instants are the kept steps, from t = 0.

    Attributes
    ----------
    energy : Energy
    step : float
        Time step of the integration, s.
    exchanges : int
        Exchanges of active sets in all steps; 0 for an unreduced model, which does not count them.
    damped_modes : int
        Modes in which the model's damping ratio is met: all of a reduced model's, the computed ones of an
        unreduced one.
    complete : bool
        Whether the run that made it has reached its end; False only for one read from an unfinished file.
    """

    energy: Energy
    step: float
    exchanges: int = 0
    damped_modes: int = 0
    complete: bool = True

    def __repr__(self) -> str:
        kind = f"{len(self.reduced.omega)} modes" if self.reduced is not None else "unreduced model"
        return (
            f"History({len(self.time)} instants to {self.time[-1]:.6g} s, step {self.step:.3g} s, {kind}, "
            f"{self.states.pairs} pairs, peak contact resultant "
            f"{self.contact_resultant.max(initial=0.0):.6g} N, largest energy error "
            f"{'; '.join([f'{np.abs(self.energy.balance).max():.2e} J', *self.notes])})"
        )


def model_with_fields(owner: str, motion: object) -> Model:
    """The model whose fields a motion keeps.

    Raises
    ------
    TypeError, SolveError
        On all ranks: for something else than a motion, and for one without fields.
    """
    if not isinstance(motion, Motion):
        raise on_all_ranks(TypeError(f"{owner}: motion = {shown(motion)} is neither a History nor an Orbit"))
    states = motion.states
    if isinstance(states, ModalStates):
        model = states.reduced.model
    else:
        model = None if states.fields is None else states.fields.model
    if model is None:
        raise on_all_ranks(
            SolveError(
                f"{owner}: the motion keeps no fields, being that of matrices, of an unreduced model with "
                "too many instants, or read from a file; give one that transient or periodic has just made "
                "of a Model"
            )
        )
    return model
