"""Motions of a structure, reduced or not: time histories, and what they share with steady states."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from meshing.warnings import IncompleteHistory

from ..bodies.finite_element_model import FiniteElementModel
from ..checks import Bounds, real, shown
from ..contact.law import peak_of
from ..errors import UnknownName, at_point, failed_solve, warn, wrong_input
from ..ranks.parallel import agreed
from ..record.record import Record, derived, described, quantity
from ..reduction.reduced_model import ReducedModel
from ..system.fields.places import checked_line
from ..system.fields.sampling import Field
from ..system.model import Model
from .energy import ROUND_OFF, Energy
from .states import ModalStates, Point, Rows, SampledStates

# Supports whose forces are printed.
SHOWN = 4


@described
class Motion(Record):
    """Instants of a motion."""

    labels: ClassVar = {"place": "points", "support": "supports", "tip": "tips"}
    coordinates: ClassVar = ("time",)

    time: np.ndarray = quantity("s", "instants", "time")
    states: ModalStates | SampledStates = quantity(
        text="how they are kept: of a reduced or of an unreduced model",
        part="ModalStates SampledStates",
        detail=True,
    )

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return self.states.points

    @property
    def tips(self) -> tuple[str, ...]:
        """Names of the crack tips with a tip element."""
        return self.states.tips

    @property
    def supports(self) -> tuple[str, ...]:
        """Names of what is supported; none where no reactions are told."""
        return self.states.supports

    @property
    def reduced(self) -> ReducedModel | None:
        """The reduced model that moves, None for an unreduced one."""
        return self.states.reduced if isinstance(self.states, ModalStates) else None

    @derived("m", "displacement", "time place xy", called="displacement")
    def point_displacements(self) -> np.ndarray:
        """(n, points, 2): displacements of the named points, m."""
        found = [self.states.displacement(point) for point in self.points]
        return np.stack(found, axis=1) if found else np.zeros((len(self.time), 0, 2))

    @derived("N", "force of each support on the structure", "time support xy")
    def reactions(self) -> np.ndarray | None:
        """(n, supports, 2): N, in the order of `supports`; None of matrices."""
        return self.states.reactions()

    def reaction(self, support: str) -> np.ndarray:
        """(n, 2): force of a support on the structure, N."""
        table = self.reactions
        if table is None:
            raise failed_solve("reaction: motions of matrices and of older files do not tell it")
        return at_point(dict(zip(self.supports, np.moveaxis(table, 1, 0))), support, "support")

    @derived(
        "Pa m^(1 - exponent)",
        "K_I and K_II of each crack tip",
        "time tip component",
        called="stress_intensity",
        unit_of=lambda motion: motion.states.tip_facts.by_tip,
    )
    def stress_intensities(self) -> np.ndarray | None:
        """(n, tips, 2): as `stress_intensity` of one tip; None without tips."""
        found = [self.states.stress_intensity(tip) for tip in self.tips]
        return np.stack(found, axis=1) if found else None

    @derived("N", "contact forces, compression positive", "time pair", detail=True, stored=False)
    def contact_force(self) -> np.ndarray:
        """(n, pairs): forces of the contact pairs, N, compression positive; those of an unreduced model are
        means over the step that ends at the instant.
        """
        return self.states.contact[:, : self.states.pairs]

    @derived("N", "sum of the contact forces, those inside tip elements included", "time")
    def contact_resultant(self) -> np.ndarray:
        """(n,): sum of all contact forces, those inside the tip elements included, N."""
        return self.states.contact[:, : self.states.gaps].sum(axis=1)

    @derived("m", "gaps of the contact pairs", "time pair", detail=True, stored=False)
    def gap(self) -> np.ndarray:
        """(n, pairs): gaps of the contact pairs, m."""
        return self.states.gap[:, : self.states.pairs]

    @derived("m", "slips of the pairs, where faces of the model rub", "time pair", detail=True, stored=False)
    def slip(self) -> np.ndarray | None:
        """(n, pairs): m, of the right faces against the left ones, along the normal turned clockwise."""
        return self._of_slips(self.states.gap)

    @derived("N", "friction of the pairs", "time pair", detail=True, stored=False)
    def friction_force(self) -> np.ndarray | None:
        """(n, pairs): N, against the changes of the slips."""
        return self._of_slips(self.states.contact)

    def _of_slips(self, rows: np.ndarray) -> np.ndarray | None:
        """The tangential rows of the pairs; None where nothing rubs."""
        first = self.states.gaps
        return None if first in (None, rows.shape[1]) else rows[:, first:][:, : self.states.pairs]

    @derived(text="what K of the tips does not tell by itself", dims="note", kept=True)
    def notes(self) -> tuple[str, ...]:
        """What K of the tips does not tell by itself: units at notches, that of a crack along an interface
        that closes G alone means something. They are printed too.
        """
        return self.states.tip_facts.notes(self.states.contact)

    def check(self) -> None:
        """Raise ValueError unless time rises."""
        if not len(self.time) or (np.diff(self.time) <= 0.0).any():
            raise ValueError("'time' does not rise")

    def displacement(self, point: Point) -> np.ndarray:
        """(n, 2): displacement of a named point, or of any point (x, y) in m, in m. Collective for (x, y).
        (n,) of a row of a body, along its own direction, as velocities and accelerations are.
        """
        return _alone(
            self.states.displacement(point) if isinstance(point, str) else self._displacement_at(point)
        )

    @agreed()
    def _displacement_at(self, place: tuple[float, float]) -> np.ndarray:
        """(n, 2): displacement at a place, m. Collective."""
        return self.states.displacement(place)

    def velocity(self, point: Point) -> np.ndarray:
        """(n, 2): velocity of a named point, m/s; that of a reduced model's modes."""
        return _alone(self.states.velocity(point))

    def acceleration(self, point: Point) -> np.ndarray:
        """(n, 2): acceleration of a named point, m/s^2; that of a reduced model's modes."""
        return _alone(self.states.acceleration(point))

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
            if not self.tips:
                raise UnknownName("stress_intensity: the model has no crack tip with a tip element")
            tip = self.tips[0]
        return self.states.stress_intensity(tip)

    def _borne(self) -> list[str]:
        """The largest reactions, in words."""
        table = self.reactions
        if table is None or not table.size:
            return []
        peaks = zip(self.supports, np.abs(table).max(axis=0))
        told = [f"{name}: ({x:.6g}, {y:.6g})" for name, (x, y) in peaks]
        return [f"peak reactions {', '.join(told[:SHOWN])} N"]

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a named point, m; less than `least` where that is known to be so."""
        bound = self.states.bound()
        if bound < least:
            return bound
        moves = (np.linalg.norm(self.states.displacement(name), axis=-1).max() for name in self.points)
        return float(max(moves, default=0.0))

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


@described
class History(Motion):
    """A time history; its instants are the kept steps, from t = 0."""

    energy: Energy = quantity(text="energies and work", part="Energy", detail=True)
    step: float = quantity("s", "time step of the integration", least=0.0)
    exchanges: int = quantity(
        "1",
        "exchanges of active sets in all steps; 0 for an unreduced model, which does not count them",
        default=0,
    )
    damped_modes: int = quantity(
        "1",
        "modes in which the model's damping ratio is met: all of a reduced model's, the computed ones of an "
        "unreduced one",
        default=0,
    )
    complete: bool = quantity("1", "whether the run that made it has reached its end", default=True)
    mode_error: float = quantity(
        "1",
        "error of the displacements of all named points over time, relative L2, by left-out modes and the "
        "steps; inf where it is not found, nan where no accuracy was asked for",
        default=math.nan,
        finite=False,
        row=True,
    )

    @derived(
        "1",
        "largest imbalance of energies, relative to the loads' work or the kinetic energy, the larger one",
        row=True,
    )
    def energy_error(self) -> float:
        """0 where it is rounding of the energies themselves, as at rest under constant loads."""
        energy = self.energy
        moved = max(float(np.abs(part).max(initial=0.0)) for part in (energy.external, energy.kinetic))
        error = float(np.abs(energy.balance).max()) - ROUND_OFF * float(energy.total.max())
        return error / moved if error > 0.0 else 0.0

    def instants(self) -> Rows:
        """What is kept of the instants, by the names of columns."""
        return {"time": self.time, **self.states.instants(), "energies": self.energy.instants()}

    def _warn_incomplete(self, path: str) -> None:
        """Warn of a run that has not ended."""
        if not self.complete:
            warn(
                f"history file {path!r} is incomplete: it ends at {self.time[-1]:.6g} s, before its run "
                "does; resume=True continues from there",
                IncompleteHistory,
            )

    def __repr__(self) -> str:
        kind = self.reduced.in_words if self.reduced is not None else "unreduced model"
        told = "" if math.isnan(self.mode_error) else f"error of displacements {self.mode_error:.2g}, "
        return (
            f"History({len(self.time)} instants to {self.time[-1]:.6g} s, step {self.step:.3g} s, {kind}, "
            f"{self.states.pairs} pairs, {told}peak contact resultant "
            f"{peak_of(self.contact_resultant):.6g} N, largest energy error "
            f"{'; '.join([f'{np.abs(self.energy.balance).max():.2e} J', *self._borne(), *self.notes])})"
        )


def of_instants(history: History, rows: Rows, **facts: Any) -> History:
    """The same with other instants, and other facts."""
    states, energy = history.states.of_instants(rows), Energy(*rows["energies"].T)
    return replace(history, time=rows["time"], states=states, energy=energy, **facts)


def _alone(values: np.ndarray) -> np.ndarray:
    """A row's one component without an axis."""
    return values[:, 0] if values.shape[1] == 1 else values


def model_with_fields(owner: str, motion: object) -> Model | FiniteElementModel:
    """The model or body whose fields a motion keeps.

    Raises
    ------
    TypeError, SolveError
        On all ranks: for something else than a motion, and for one without fields.
    """
    if not isinstance(motion, Motion):
        raise wrong_input(f"{owner}: motion = {shown(motion)} is neither a History nor an Orbit", TypeError)
    states = motion.states
    model: Model | FiniteElementModel | None
    if isinstance(states, ModalStates):
        model = states.reduced.body if states.reduced.whole is not None else states.reduced.model
    else:
        model = None if states.fields is None else states.fields.model
    if model is None:
        raise failed_solve(
            f"{owner}: the motion keeps no fields, being that of matrices, of a body without shapes, of "
            "an unreduced model with too many instants, or read from a file; give one that transient or "
            "periodic has just made of a Model or a body"
        )
    return model
