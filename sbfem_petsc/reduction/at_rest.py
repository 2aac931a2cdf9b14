"""Modes and static states of a reduced model whose points are rows: of a body or of matrices."""

from __future__ import annotations

import functools
from typing import ClassVar

import numpy as np

from ..contact.complementarity import solve_complementarity
from ..errors import at_point
from ..record.record import Record, derived, described, quantity
from .reduced_model import ReducedModel

# Frequencies that are printed.
TOLD = 6
_ALONG = "displacement along the own direction of each point"
_directions = functools.partial(
    quantity, text="directions of the points of a body", dims="place", kinds="U", default_factory=dict
)


@described
class ReducedModal(Record):
    """Modes that a reduced model of a body or of matrices keeps, lowest first, mass-normalised."""

    frequencies: np.ndarray = quantity("Hz", "natural frequencies, open contact", "mode", least=0.0, row=True)
    damping: np.ndarray = quantity("1", "modal damping ratios", "mode", least=0.0)
    point_shapes: dict[str, np.ndarray] = quantity(
        "1/sqrt(kg)", f"{_ALONG} in each mode", "mode place", called="displacement", by="place"
    )
    directions: dict[str, str] = _directions()

    def displacement(self, point: str) -> np.ndarray:
        """(n,): of a named point in each mode, along its own direction."""
        return at_point(self.point_shapes, point)

    def __repr__(self) -> str:
        shown = ", ".join(f"{f:.6g}" for f in self.frequencies[:TOLD])
        return (
            f"ReducedModal({len(self.frequencies)} frequencies: "
            f"{shown}{', ...' * (len(self.frequencies) > TOLD)} Hz)"
        )


@described
class ReducedStatic(Record):
    """Static solution of a reduced model of a body or of matrices."""

    point_displacements: dict[str, float] = quantity("m", _ALONG, "place", called="displacement", row=True)
    contact_force: np.ndarray = quantity("N", "contact forces, compression positive", "pair")
    gap: np.ndarray = quantity("m", "gaps of the contact rows", "pair")
    active: np.ndarray = quantity("1", "rows in contact", "pair", kinds="b")
    strain_energy: float = quantity("J", "that of elastic stops included", row=True)
    iterations: int = quantity("1", "iterations of the active set", least=0)
    directions: dict[str, str] = _directions()

    @derived("N", "sum of the contact forces", row=True)
    def contact_resultant(self) -> float:
        """N."""
        return float(self.contact_force.sum())

    def displacement(self, point: str) -> float:
        """Of a named point along its own direction, m."""
        return at_point(self.point_displacements, point)

    def __repr__(self) -> str:
        along = {name: f" along {d}" for name, d in self.directions.items() if d}
        points = ", ".join(f"{n}{along.get(n, '')}: {u:.6g}" for n, u in self.point_displacements.items())
        return (
            f"ReducedStatic({points} m; {int(self.active.sum())} of {len(self.gap)} pairs in contact, "
            f"resultant {self.contact_resultant:.6g} N)"
        )


@described
class ReducedLoadHistory(Record):
    """Static states of a reduced model of a body or of matrices at given times."""

    labels: ClassVar = {"place": "points"}
    coordinates: ClassVar = ("time",)

    points: tuple[str, ...]
    time: np.ndarray = quantity("s", "times of the states", "time")
    point_displacements: np.ndarray = quantity("m", _ALONG, "time place", called="displacement")
    contact_force: np.ndarray = quantity(
        "N", "contact forces, compression positive", "time pair", detail=True
    )
    gap: np.ndarray = quantity("m", "gaps of the contact rows", "time pair", detail=True)
    strain_energy: np.ndarray = quantity("J", "that of elastic stops included", "time")
    directions: dict[str, str] = _directions()

    @derived("N", "sum of the contact forces", "time")
    def contact_resultant(self) -> np.ndarray:
        """(n,): N."""
        return self.contact_force.sum(axis=1)

    def displacement(self, point: str) -> np.ndarray:
        """(n,): of a named point along its own direction, m."""
        return at_point(dict(zip(self.points, self.point_displacements.T)), point)

    def __repr__(self) -> str:
        return (
            f"ReducedLoadHistory({len(self.time)} states from {self.time[0]:.6g} to {self.time[-1]:.6g} s, "
            f"peak contact resultant {self.contact_resultant.max():.6g} N)"
        )


def require_rows(owner: str, reduced: ReducedModel) -> None:
    """Refuse the reduced model of a Model, whose points have two components and whose fields tell more."""
    if not reduced.of_rows:
        raise ValueError(f"{owner}: {reduced!r} is that of a Model; give the Model itself")


def kept_modes(reduced: ReducedModel, count: int | None, band: tuple[float, float] | None) -> ReducedModal:
    """Those of a number or of a band in Hz, of the modes that are kept."""
    require_rows("modal", reduced)
    f = reduced.frequencies
    if count is not None and count > len(f):
        raise ValueError(
            f"modal: count = {count} is more than the {len(f)} modes of the reduced model; keep more"
        )
    if band is not None and band[1] > f[-1]:
        raise ValueError(
            f"modal: band = {band} goes beyond {f[-1]:.6g} Hz, where the modes of the reduced model end; "
            "reduce it with more"
        )
    keep = np.arange(len(f))[:count] if band is None else np.flatnonzero((f >= band[0]) & (f <= band[1]))
    shapes = {name: reduced.points.modes[k, -1, keep] for k, name in enumerate(reduced.points.names)}
    return ReducedModal(f[keep], reduced.damping[keep], shapes, reduced.point_directions)


def at_rest(owner: str, reduced: ReducedModel, amplitudes: np.ndarray, contact: bool) -> ReducedStatic:
    """The static state under (loads,) amplitudes; exact, for the residual flexibility is that of all modes
    left out.
    """
    require_rows(owner, reduced)
    reduced.require_frictionless(f"{owner} of a reduced model")
    if not reduced.omega.all():
        raise ValueError(
            f"{owner}: the reduced model has rigid-body motions (0 Hz); hold it, say by weak springs"
        )
    give = 1.0 / reduced.omega**2
    rows = reduced.gap.modes
    flexibility = reduced.gap.contact + (rows * give) @ rows.T
    modal_load = reduced.load_modes @ amplitudes
    by_load = rows @ (give * modal_load) + reduced.gap.loads @ amplitudes
    gap, laws = by_load + reduced.initial_gap, reduced.contact_laws
    force, active, iterations = np.zeros(len(gap)), np.zeros(len(gap), dtype=bool), 0
    if contact and laws.touched(gap).any():
        found = solve_complementarity(flexibility, gap, laws)
        force, gap, active, iterations = found.force, found.gap, found.active, found.iterations
    q = give * (modal_load + force @ rows)
    u = reduced.points(q[None], amplitudes[None], force[None])[0, :, -1]
    by_loads = modal_load @ (give * modal_load) + amplitudes @ reduced.load_flexibility @ amplitudes
    energy = 0.5 * (by_loads + force @ flexibility @ force) + force @ by_load
    names = reduced.points.names
    return ReducedStatic(
        dict(zip(names, u.tolist())), force, gap, active, float(energy), iterations, reduced.point_directions
    )


def over_time(time: np.ndarray, states: list[ReducedStatic]) -> ReducedLoadHistory:
    """The states of some times."""
    return ReducedLoadHistory(
        tuple(states[0].point_displacements),
        time,
        np.array([list(state.point_displacements.values()) for state in states]),
        np.array([state.contact_force for state in states]),
        np.array([state.gap for state in states]),
        np.array([state.strain_energy for state in states]),
        states[0].directions,
    )
