"""Static solution and what it is asked."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import field as attribute
from typing import Any, ClassVar

import numpy as np

from ..errors import SolveError, at_point
from ..loads import Loads
from ..petsc import MPI
from ..ranks.parallel import agreed, whole
from ..record.record import Record, derived, described, quantity
from ..system.fields.fracture import contact_pressure, unresolved_contact
from ..system.fields.places import PlaceRows, Places, Point, checked_line, checked_place
from ..system.fields.sampling import Field
from ..system.fields.tip_facts import TipFacts
from ..system.loads import LoadColumns
from ..system.model import Model
from ..system.solve.equilibrium import Equilibrium

# Tips whose factors are printed.
SHOWN = 4


@described
class Static(Record):
    """Static solution.

    K_I and K_II are in Pa m^(1/2), in Pa m^(1 - exponent) at an open notch or a crack that ends at an
    interface. Of a crack along an interface, whose stresses oscillate as r^(i eps), they are Re and Im of
    Rice's K in SI units, ``sigma_yy + i sigma_xy = K r^(i eps) / sqrt(2 pi r)``: those for another reference
    length L turn by eps ln(L / 1 m).

    `load` and `model` are what it was computed of (with an accuracy asked for, the finest model), `columns`
    what the loads do, `equilibrium` the solution in this rank's unknowns; all None of one that was read,
    whose `field` is that of all nodes, elsewhere of this rank's.
    """

    coordinates: ClassVar = ("pair_cracks",)

    point_displacements: dict[str, np.ndarray] = quantity(
        "m", "displacement", "place xy", called="displacement", row=True
    )
    contact_force: np.ndarray = quantity(
        "N", "contact forces, compression positive, all cracks in order", "pair"
    )
    gap: np.ndarray = quantity("m", "gaps of the contact pairs", "pair")
    active: np.ndarray = quantity("1", "pairs in contact", "pair", kinds="b")
    contact_resultant: float = quantity(
        "N", "sum of the contact forces, those inside tip elements included", row=True
    )
    field: np.ndarray = quantity("m", "displacements of the nodes", "node xy", distributed=True)
    iterations: int = quantity("1", "iterations of the active set")
    solver: str = quantity(text="what has solved it")
    residual: float = quantity("1", "||K u - f - G' force|| / ||f||", least=0.0, row=True)
    stress_intensity: dict[str, tuple[float, float]] = quantity(
        "Pa m^(1 - exponent)",
        "K_I and K_II of each crack tip with a tip element",
        "tip component",
        row=True,
        finite=False,
        unit_of=lambda found: found.tip_facts.by_tip,
    )
    energy_release_rate: dict[str, float] = quantity(
        "J/m^2",
        "G of each crack tip that grows straight ahead; nan at open notches and at cracks that end at an "
        "interface",
        "tip",
        finite=False,
    )
    t_stress: dict[str, float] = quantity(
        "Pa",
        "stress along each crack at its tip that the singular stresses leave; nan at open notches and "
        "interfaces",
        "tip",
        finite=False,
    )
    reactions: dict[str, np.ndarray] = quantity(
        "N", "force of each support on the structure", "support xy", row=True
    )
    load: Loads
    model: Model
    columns: LoadColumns = attribute(repr=False)
    equilibrium: Equilibrium = attribute(repr=False)
    estimate: Any = quantity(text="errors, where an accuracy was asked for", part="Estimate", default=None)
    notes: tuple[str, ...] = quantity(
        text="what K, G, T and forces of single pairs do not tell by themselves", dims="note", default=()
    )
    tip_facts: TipFacts = quantity(
        text="kinds of the tips", part="TipFacts", detail=True, default_factory=TipFacts.none
    )
    pair_cracks: tuple[str, ...] = quantity(text="crack of each pair", dims="pair", default=())
    slip: np.ndarray | None = quantity(
        "m",
        "slips of the pairs, along the normal turned clockwise, where faces of the model rub",
        "pair",
        kinds="f",
        default=None,
    )
    friction_force: np.ndarray | None = quantity(
        "N", "friction of the pairs, against the change of their slips", "pair", kinds="f", default=None
    )
    slid: np.ndarray | None = quantity(
        "m",
        "ways that the pairs have slid since the state before, or since rest, what lands from where it lands",
        "pair",
        kinds="f",
        default=None,
    )
    friction_loss: float | None = quantity(
        "J", "lost to friction since the state before, or since rest", kinds="f", default=None
    )
    loads: tuple[str, ...] = quantity(text="loads", dims="load", detail=True, default=())

    @agreed()
    def _gathered(self) -> dict[str, Any]:
        """The field, on rank 0. Collective."""
        if self.model is None:
            return {"field": self.field}
        part = self.model.layout.part
        return {"field": whole(self.model.comm, part.nodes, self.field)}

    @property
    def _solved(self) -> Model:
        """The model; SolveError without one."""
        if self.model is None:
            raise SolveError(
                "a static solution that was read from a file knows its named points, pairs, tips and nodes "
                "alone; solve it again"
            )
        return self.model

    def _fingerprint(self) -> object:
        """What tells it from others, the same on all ranks."""
        return self.model, self.load, self.point_displacements, self.contact_force, self.residual

    def displacement(self, point: str | tuple[float, float]) -> np.ndarray:
        """(2,): displacement of a named point, or of any point (x, y) in m, in m. Collective for (x, y).

        Under a point force it has no limit, see `PointForce`.
        """
        if isinstance(point, str):
            return at_point(self.point_displacements, point)
        return self._displacement_at(checked_place("displacement", point))

    @agreed()
    def _displacement_at(self, place: tuple[float, float]) -> np.ndarray:
        """(2,): displacement at a place, m. Collective."""
        return self._at(self._places([place]).displacement, 2)[0]

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a node, m. Collective."""
        largest = float(np.linalg.norm(self.field, axis=1).max(initial=0.0))
        return self._solved.comm.allreduce(largest, MPI.MAX)

    @agreed()
    def stress(self, place: str | tuple[float, float]) -> np.ndarray:
        """(3,): stress xx, yy, xy at a point, Pa; nan at a crack tip. Collective.

        On an edge between S-elements, and at coordinates where two closed faces of a crack coincide, it is
        that of one side, of the S-element with the lower number: ask beside a face, 1e-6 of its length away,
        for the other's. A `PlaceWarning` tells of faces. The corners of a mouth, "crack1_left" and
        "crack1_right", have each the stress of their own face.
        Under a point force it has no limit.
        """
        if isinstance(place, str):
            at_point(self._solved.points, place)
        else:
            place = checked_place("stress", place)
        return self._at(self._places([place]).stress, 3)[0]

    @agreed()
    def along(
        self, start: tuple[float, float], end: tuple[float, float], count: int = 101
    ) -> tuple[np.ndarray, ...]:
        """Displacement and stress along a straight line. Collective.

        Returns
        -------
        places, displacement, stress : (count, 2), (count, 2), (count, 3) arrays
            m, m and Pa.
        """
        line, points = checked_line(start, end, count)
        return line, *self.at_places(self._places(points))

    def at_places(self, places: Places) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (places, 2), m, and stress (places, 3), Pa. Collective."""
        return self._at(places.displacement, 2), self._at(places.stress, 3)

    def _places(self, points: Sequence[Point]) -> Places:
        """Forms at points, for `at_places`: with what the inertia of moving supports does inside, and
        edges that are moved. Collective.
        """
        model, columns = self._solved, self.columns
        inertia, moved = bool(columns.acceleration.any()), columns.lift is not None
        return model.places(points, inertia=inertia, moved=moved)

    def _at(self, forms: PlaceRows, components: int) -> np.ndarray:
        """(places, components) of displacement or stress."""
        found = self.equilibrium
        direct = forms.direct(self.columns)[:, 0]
        flat = forms.rows(found.owned) + forms.contact @ found.force + direct
        return flat.reshape(-1, components)

    @property
    def interior(self) -> Field:
        """What determines displacement and stress inside the S-elements of this rank."""
        return Field.of_forces(self._solved.tips, self.field, self.equilibrium.force, self.columns)

    def contact_pressure(self, crack: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Contact pressure along a crack, the first one by default: positions (m from its tip, of several
        its first) and pressure (Pa).

        A crack that branches is gone through line by line, as `ContactPairs.arc` of the mesh counts.
        Forces of the pairs over the length of face that each stands for, and the traction on the faces inside
        the tip element.
        """
        return contact_pressure(self._solved.tips, self.equilibrium.force, crack)

    @functools.cached_property
    @agreed()
    def strain_energy(self) -> float:
        """J, that of elastic supports included. Collective."""
        found, columns, gap = self.equilibrium, self.columns, self._solved.contact
        # the forces on the free unknowns are in balance with K u
        by_loads = self._solved.comm.allreduce(float(columns.forces[:, 0] @ found.owned))
        by_contact = float(found.force @ gap.rows(found.owned))
        inside = float(found.force @ gap.flexibility @ found.force + columns.flexibility[0, 0])
        whole = 0.5 * (by_loads + by_contact + inside) + float(found.force @ columns.gaps[:, 0])
        if columns.lift is None:
            return whole
        # supports that move are no springs: what they pull with and the gaps they open store nothing
        pulled = self._solved.comm.allreduce(float(columns.lift.forces[:, 0] @ found.owned))
        return whole - pulled - float(found.force @ columns.lift.gaps[:, 0])

    @functools.cached_property
    @agreed()
    def unresolved_contact(self) -> dict[str, float]:
        """Contact next to the tip of each V-notch that neither pairs nor pressure modes carry, N; in closed
        form from the K_I that they leave. `contact_resultant` is too small by about their sum; a negative one
        stands for modes that carry too much, where the contact ends inside a tip's S-element. Collective.
        """
        return unresolved_contact(self._solved.tips, self.stress_intensity, self.equilibrium.force)

    def __repr__(self) -> str:
        points = ", ".join(f"{n}: ({u[0]:.6g}, {u[1]:.6g})" for n, u in self.point_displacements.items())
        forces = ", ".join(f"{n}: ({f[0]:.6g}, {f[1]:.6g})" for n, f in self.reactions.items())
        told = [
            *([f"{points} m"] if points else []),
            f"{int(self.active.sum())} of {len(self.gap)} pairs in contact, resultant "
            f"{self.contact_resultant:.6g} N",
            *self._tips_in_words(),
            *([f"reactions {forces} N"] if forces else []),
            self.solver,
            *self.notes,
        ]
        return f"Static({'; '.join(told)})"

    def _tips_in_words(self) -> Iterator[str]:
        """K, G and T of the first tips, those that they have."""
        for name, (first, second) in list(self.stress_intensity.items())[:SHOWN]:
            text = f"{name}: K = ({first:.6g}, {second:.6g}) {self.tip_facts.unit(name)}"
            for letter, values, unit in (
                ("G", self.energy_release_rate, "J/m^2"),
                ("T", self.t_stress, "Pa"),
            ):
                text += "" if math.isnan(values[name]) else f", {letter} = {values[name]:.6g} {unit}"
            yield text
        if len(self.stress_intensity) > SHOWN:
            yield f"{len(self.stress_intensity) - SHOWN} more tips"


@described
class ReducedStatic(Record):
    """Static solution of a reduced model of a body or of matrices."""

    point_displacements: dict[str, float] = quantity(
        "m", "displacement along the own direction of each point", "place", called="displacement", row=True
    )
    contact_force: np.ndarray = quantity("N", "contact forces, compression positive", "pair")
    gap: np.ndarray = quantity("m", "gaps of the contact rows", "pair")
    active: np.ndarray = quantity("1", "rows in contact", "pair", kinds="b")
    strain_energy: float = quantity("J", "that of elastic stops included", row=True)
    iterations: int = quantity("1", "iterations of the active set", least=0)
    directions: dict[str, str] = quantity(
        text="directions of the points of a body", dims="place", kinds="U", default_factory=dict
    )
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
