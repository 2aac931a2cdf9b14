"""Modes and static states of a reduced model whose points are rows: of a body or of matrices."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import field
from typing import Any, ClassVar

import numpy as np

from ..bodies.finite_element_model import FiniteElementModel
from ..checks import integer
from ..contact.complementarity import Complementarity
from ..contact.friction import Memory, solve_contact
from ..errors import SolveError, at_point
from ..record.record import Record, derived, described, quantity
from .reduced_model import ReducedModel

# Frequencies that are printed.
SHOWN = 6
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
    body: FiniteElementModel | None = field(default=None, repr=False)
    shapes: np.ndarray | None = field(default=None, repr=False)

    def displacement(self, point: str) -> np.ndarray:
        """(n,): of a named point in each mode, along its own direction."""
        return at_point(self.point_shapes, point)

    def nodal(self, mode: int) -> np.ndarray:
        """(nodes, 3): a mode of a body, 0 the lowest, at all nodes in the order of `body.labels`.

        Raises
        ------
        SolveError
            If the shapes are not kept.
        """
        if self.body is None or self.shapes is None:
            raise SolveError("nodal: the modes are read from a file, or those of a model that kept no shapes")
        most = len(self.frequencies) - 1
        return self.body.nodal(self.shapes[:, integer("nodal", "mode", mode, least=0, most=most)])

    def __repr__(self) -> str:
        shown = ", ".join(f"{f:.6g}" for f in self.frequencies[:SHOWN])
        return (
            f"ReducedModal({len(self.frequencies)} frequencies: "
            f"{shown}{', ...' * (len(self.frequencies) > SHOWN)} Hz)"
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
    slip: np.ndarray | None = quantity(
        "m", "slips of the rows, where any rubs", "pair", kinds="f", default=None
    )
    friction_force: np.ndarray | None = quantity(
        "N", "friction of the rows, against the changes of their slips", "pair", kinds="f", default=None
    )
    friction_loss: float | None = quantity(
        "J", "lost to friction since the state before, or since rest", kinds="f", default=None
    )
    field: np.ndarray | None = quantity(
        "m", "displacements of all nodes of a body", "node xyz", detail=True, default=None, repr=False
    )

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
    slip: np.ndarray | None = quantity(
        "m", "slips of the rows, where any rubs", "time pair", kinds="f", default=None, detail=True
    )
    friction_force: np.ndarray | None = quantity(
        "N", "friction of the rows", "time pair", kinds="f", default=None, detail=True
    )
    friction_loss: np.ndarray | None = quantity(
        "J", "lost to friction so far", "time", kinds="f", default=None
    )

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
    whole = None if reduced.whole is None else reduced.whole.modes[:, keep]
    facts = f[keep], reduced.damping[keep], shapes, reduced.point_directions
    return ReducedModal(*facts, reduced.body, whole)


def at_rest(owner: str, reduced: ReducedModel, amplitudes: np.ndarray, contact: bool) -> ReducedStatic:
    """The static state under (loads,) amplitudes, in one step from rest; exact, for the residual flexibility
    is that of all modes left out.
    """
    return next(_states(owner, reduced, amplitudes[None], contact))


def _states(
    owner: str, reduced: ReducedModel, amplitudes: np.ndarray, contact: bool
) -> Iterator[ReducedStatic]:
    """The static states under (n, loads) amplitudes, each from the one before."""
    require_rows(owner, reduced)
    if not reduced.omega.all():
        raise ValueError(
            f"{owner}: the reduced model has rigid-body motions (0 Hz); hold it, say by weak springs"
        )
    give = 1.0 / reduced.omega**2
    rows, laws, friction, count = reduced.gap.modes, reduced.contact_laws, reduced.friction, reduced.gaps
    flexibility = reduced.gap.contact + (rows * give) @ rows.T
    memory = None if friction is None else Memory.none(laws, friction)
    for loads in amplitudes:
        modal_load = reduced.load_modes @ loads
        by_load = rows @ (give * modal_load) + reduced.gap.loads @ loads
        gap = by_load + reduced.initial_gap
        slip = np.empty(0) if memory is None else memory.slip
        found = Complementarity(np.zeros(len(gap)), gap, np.zeros(len(gap), dtype=np.int8), 0, slip)
        if contact and laws.touched(gap[:count]).any():
            found = solve_contact(flexibility, gap, laws, friction, memory)
        force, rubbed = found.force, dict[str, Any]()
        if friction is not None and memory is not None:
            former, memory = memory, Memory.of(found, count)
            lost = memory.lost_since(former, friction)
            rubbed = {"slip": memory.slip, "friction_force": memory.force, "friction_loss": lost}
        q = give * (modal_load + force @ rows)
        u = reduced.points(q[None], loads[None], force[None])[0, :, -1]
        by_loads = modal_load @ (give * modal_load) + loads @ reduced.load_flexibility @ loads
        energy = 0.5 * (by_loads + force @ flexibility @ force) + force @ by_load
        yield ReducedStatic(
            dict(zip(reduced.points.names, u.tolist())),
            force[:count],
            found.gap[:count],
            found.active[:count],
            float(energy),
            found.iterations,
            reduced.point_directions,
            field=reduced.field(q, loads, force).nodal if reduced.shows else None,
            **rubbed,
        )


def over_time(
    owner: str, reduced: ReducedModel, time: np.ndarray, amplitudes: np.ndarray, contact: bool
) -> ReducedLoadHistory:
    """The states at (n,) times under (n, loads) amplitudes."""
    states = list(_states(owner, reduced, amplitudes, contact))
    kept = ["contact_force", "gap", "strain_energy"]
    kept += ["slip", "friction_force"] * (reduced.friction is not None)
    found = {name: np.array([getattr(state, name) for state in states]) for name in kept}
    if reduced.friction is not None:
        found["friction_loss"] = np.cumsum([state.friction_loss for state in states])
    u = np.array([list(state.point_displacements.values()) for state in states])
    return ReducedLoadHistory(
        tuple(states[0].point_displacements), time, u, directions=states[0].directions, **found
    )
