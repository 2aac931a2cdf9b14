"""Static solution and what it is asked."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from dataclasses import field as attribute
from typing import Any

import numpy as np

from ..errors import at_point
from ..loads import Loads
from ..parallel import agreed
from ..petsc import MPI
from ..system.boundary import LoadColumns
from ..system.equilibrium import Equilibrium
from ..system.fracture import (
    contact_nodal_forces,
    contact_pressure,
    energy_release_rates,
    t_stresses,
    unresolved_contact,
)
from ..system.model import Model
from ..system.places import PlaceRows, Places, checked_line, checked_place
from ..system.reactions import reactions
from ..system.sampling import Field
from ..writing import write_table


@dataclass(frozen=True, eq=False)
class Static:
    """Static solution.

    Attributes
    ----------
    point_displacements : dict of str to (2,) array
        m, on all ranks.
    contact_force : (pairs,) array
        N, compression positive, all cracks in order.
    gap : (pairs,) array
        m.
    active : (pairs,) bool array
    contact_resultant : float
        Sum of all contact forces, those inside the tip elements included, N.
    field : (m, 2) array
        Displacements of this rank's nodes, m.
    iterations : int
        Of the active set.
    solver : str
    residual : float
        ||K u - f - G' force|| / ||f||.
    stress_intensity : dict of str to (float, float)
        K_I and K_II of each crack tip with a tip element, Pa m^(1/2) (Pa m^(1 - lambda) at an open notch or a
        crack that ends at an interface). Of a crack along an interface, whose stresses oscillate as r^(i
        eps), they are Re and Im of Rice's K in SI units, ``sigma_yy + i sigma_xy = K r^(i eps) / sqrt(2 pi
        r)``: those for another reference length L turn by eps ln(L / 1 m).
    load : Loads
    model : Model
        With an accuracy asked for, the finest one.
    columns : LoadColumns
        What the loads do, one column.
    equilibrium : Equilibrium
        The solution in this rank's unknowns.
    estimate : Estimate or None
        Errors, where an accuracy was asked for.
    notes : tuple of str
        What K, G and T of its tips do not tell by themselves: units at notches, that of a closed crack along
        an interface G alone means something, which T it is where faces are pressed. They are printed too.
    """

    point_displacements: dict[str, np.ndarray]
    contact_force: np.ndarray
    gap: np.ndarray
    active: np.ndarray
    contact_resultant: float
    field: np.ndarray
    iterations: int
    solver: str
    residual: float
    stress_intensity: dict[str, tuple[float, float]]
    load: Loads
    model: Model
    columns: LoadColumns = attribute(repr=False)
    equilibrium: Equilibrium = attribute(repr=False)
    estimate: Any = attribute(default=None, repr=False)
    notes: tuple[str, ...] = ()

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
        return self.model.comm.allreduce(largest, MPI.MAX)

    @agreed()
    def stress(self, place: str | tuple[float, float]) -> np.ndarray:
        """(3,): stress xx, yy, xy at a point, Pa; nan at a crack tip. Collective.

        On an edge between S-elements, and where two closed faces of a crack coincide, it is that of one side,
        of the S-element with the lower number: ask beside a face, 1e-6 of its length away, for the other's. A
        `PlaceWarning` tells of faces.
        Under a point force it has no limit.
        """
        if isinstance(place, str):
            place = at_point({name: at for name, (at, _, _) in self.model.points.items()}, place)
        return self._at(self._places([checked_place("stress", place)]).stress, 3)[0]

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

    def _places(self, points: list[tuple[float, float]]) -> Places:
        """Forms at points (m), for `at_places`: with what the inertia of moving supports does inside.
        Collective.
        """
        return self.model.places(points, inertia=bool(self.columns.acceleration.any()))

    def _at(self, forms: PlaceRows, components: int) -> np.ndarray:
        """(places, components) of displacement or stress."""
        found = self.equilibrium
        direct = forms.direct(self.model, self.columns)[:, 0]
        flat = forms.rows(found.owned) + forms.contact @ found.force + direct
        return flat.reshape(-1, components)

    @property
    def interior(self) -> Field:
        """What determines displacement and stress inside the S-elements of this rank."""
        loads = {number: forces[:, 0] for number, forces in self.columns.tip_forces.items()}
        return Field.of_forces(self.model, self.field, self.equilibrium.force, loads)

    def contact_pressure(self, crack: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Contact pressure along a crack, the first one by default: positions (m from its tip, of several
        its first) and pressure (Pa).

        A crack that branches is gone through line by line, as `ContactPairs.arc` of the mesh counts.
        Forces of the pairs over the length of face that each stands for, and the traction on the faces inside
        the tip element.
        """
        return contact_pressure(self.model, self.equilibrium.force, crack)

    @functools.cached_property
    @agreed()
    def reactions(self) -> dict[str, np.ndarray]:
        """Force of each support on the structure, (2,), N. Collective."""
        model = self.model
        nodal = self.columns.nodal[..., 0] + contact_nodal_forces(model, self.equilibrium.force)
        return reactions(model, self.field, nodal)

    @functools.cached_property
    @agreed()
    def strain_energy(self) -> float:
        """J, that of elastic supports included. Collective."""
        found, columns, gap = self.equilibrium, self.columns, self.model.gap_operator
        # the forces on the free unknowns are in balance with K u
        by_loads = self.model.comm.allreduce(float(columns.forces[:, 0] @ found.owned))
        by_contact = float(found.force @ gap.rows(found.owned))
        inside = float(found.force @ gap.flexibility @ found.force + columns.flexibility[0, 0])
        return 0.5 * (by_loads + by_contact + inside) + float(found.force @ columns.gaps[:, 0])

    @functools.cached_property
    @agreed()
    def energy_release_rate(self) -> dict[str, float]:
        """G of each crack tip that grows straight ahead, J/m^2; nan at open notches and at cracks that end at
        an interface. Collective.
        """
        return energy_release_rates(self.model, self.stress_intensity)

    @functools.cached_property
    @agreed()
    def unresolved_contact(self) -> dict[str, float]:
        """Contact next to the tip of each V-notch that neither pairs nor pressure modes carry, N; in closed
        form from the K_I that they leave. `contact_resultant` is too small by about their sum; a negative one
        stands for modes that carry too much, where the contact ends inside a tip's S-element. Collective.
        """
        return unresolved_contact(self.model, self.stress_intensity, self.equilibrium.force)

    @functools.cached_property
    @agreed()
    def t_stress(self) -> dict[str, float]:
        """Stress along each crack at its tip that the singular stresses leave, Pa; nan at open notches and
        interfaces. Collective.
        """
        return t_stresses(self.model, self.field, self.equilibrium.force, self.columns.tip_forces)

    def to_csv(self, path: str) -> None:
        """Write displacements of the named points, stress intensity factors and contact pairs as
        comma-separated values: quantity, where, number of the pair, value, unit.

        The file takes its name when it is whole.

        Raises
        ------
        TypeError, ValueError
            If it cannot be written.
        """
        rows: list[tuple[str, str, str, float, str]] = []
        for point, u in self.point_displacements.items():
            rows += [(name, point, "", float(value), "m") for name, value in zip(("u_x", "u_y"), u)]
        for tip, factors in self.stress_intensity.items():
            units = self.model.tips.units(tip)
            rows += [(name, tip, "", float(k), u) for name, k, u in zip(("K_I", "K_II"), factors, units)]
        rows.append(("contact_resultant", "", "", self.contact_resultant, "N"))
        crack_of = [self.model.cracks[k].name for k in self.model.pairs.crack]
        for name, values, unit in (("contact_force", self.contact_force, "N"), ("gap", self.gap, "m")):
            rows += [(name, at, str(k), float(v), unit) for k, (at, v) in enumerate(zip(crack_of, values), 1)]
        write_table(path, dict(zip(("quantity", "where", "pair", "value", "unit"), zip(*rows))))

    def __repr__(self) -> str:
        points = ", ".join(f"{n}: ({u[0]:.6g}, {u[1]:.6g})" for n, u in self.point_displacements.items())
        return (
            f"Static({points} m; {int(self.active.sum())} of {len(self.gap)} pairs in contact, resultant "
            f"{'; '.join([f'{self.contact_resultant:.6g} N', self.solver, *self.notes])})"
        )
