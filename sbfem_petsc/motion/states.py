"""How the instants of a motion are kept: in modal coordinates, or as samples of an unreduced model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..errors import at_point, failed_solve
from ..record.record import Record, described, quantity
from ..reduction.outputs import LinearOutput
from ..reduction.reduced_model import OfReduced, ReducedModel
from ..system.fields.places import Point as Point
from ..system.fields.places import checked_place
from ..system.fields.sampling import Field
from ..system.fields.tip_facts import TipFacts
from .unreduced.kept_fields import KeptFields

# Values at instants by the names of columns, as they are while a motion is integrated.
Rows = dict[str, np.ndarray]
Kind = TypeVar("Kind", bound="States")

# Instants whose modal accelerations are held at a time.
BLOCK = 8192

NOT_KEPT = (
    "a motion of an unreduced model keeps its fields up to 256 MB a rank, and neither in files nor when it "
    "goes on from one; name further points, keep fewer steps (decimation), or use the reduced model"
)


class States(Record):
    """Instants of a motion.

    Attributes
    ----------
    columns : dict of str to str
        Names of what is kept of each, and the attributes that hold it.
    """

    columns: ClassVar[Mapping[str, str]] = {}

    def instants(self) -> Rows:
        """What is kept, by the names of the columns."""
        found = {name: getattr(self, at) for name, at in self.columns.items()}
        return {name: values for name, values in found.items() if values is not None}

    def of_instants(self: Kind, rows: Rows) -> Kind:
        """Other instants of the same motion."""
        return replace(self, **{at: rows[name] for name, at in self.columns.items() if name in rows})


@described
class ModalStates(States, OfReduced):
    """Instants of a reduced model's motion."""

    columns: ClassVar = {
        "modal_displacement": "q",
        "modal_velocity": "v",
        "amplitudes": "amplitudes",
        "edge_rates": "edge_rates",
        "contact_force": "contact",
    }

    q: np.ndarray = quantity("m sqrt(kg)", "modal coordinates", "time mode")
    v: np.ndarray = quantity("m sqrt(kg)/s", "rates of the modal coordinates", "time mode")
    amplitudes: np.ndarray = quantity("unit of the load", "load signals", "time load")
    contact: np.ndarray = quantity("N", "forces of the contact rows, compression positive", "time row")
    reduced: ReducedModel = quantity(text="the reduced model", part="ReducedModel")
    edge_rates: np.ndarray | None = quantity(
        "SI",
        "rates of prescribed displacements (m/s), then their accelerations (m/s^2)",
        "time edge",
        kinds="f",
        default=None,
    )

    def check(self) -> None:
        """Raise ValueError unless rates are those of its prescribed displacements."""
        given = 0 if self.edge_rates is None else self.edge_rates.shape[1]
        if given != 2 * len(self.reduced.edges):
            raise ValueError(f"{given} rates are not those of {len(self.reduced.edges)} moved edges")

    @property
    def tips(self) -> tuple[str, ...]:
        """Names of the crack tips."""
        return self.reduced.tips.names

    @property
    def tip_facts(self) -> TipFacts:
        """What kind of tips they are."""
        return self.reduced.tip_facts

    @property
    def pairs(self) -> int:
        """Number of contact rows that are node pairs."""
        return self.reduced.pairs

    @property
    def gaps(self) -> int:
        """Contact rows that are gaps, behind which slips stand."""
        return self.reduced.gaps

    @property
    def gap(self) -> np.ndarray:
        """(n, c): gaps of all contact rows, m."""
        return self.reduced.gap(self.q, self.amplitudes, self.contact) + self.reduced.initial_gap

    @property
    def strain_energy(self) -> np.ndarray:
        """(n,): J, that of the residual flexibility included."""
        drive = np.concatenate([self.amplitudes, self.contact], axis=1)
        stored = np.einsum("ni,ni->n", drive, drive @ self.reduced.flexibility)
        return 0.5 * (stored + ((self.reduced.omega * self.q) ** 2).sum(axis=1))

    @property
    def modal_acceleration(self) -> np.ndarray:
        """(n, m): second derivative of q, from the equations of motion."""
        return self._modal_acceleration(slice(None))

    def _modal_acceleration(self, part: slice) -> np.ndarray:
        r = self.reduced
        forces = self.amplitudes[part] @ r.load_modes.T + self.contact[part] @ r.gap.modes
        if self.edge_rates is not None:
            forces += self._of_edges(0)[part] @ r.rate_modes.T
        return forces - 2.0 * r.damping * r.omega * self.v[part] - r.omega**2 * self.q[part]

    def _of_edges(self, order: int) -> np.ndarray:
        """(n, edges): rates (order 0) or accelerations (1) of prescribed displacements."""
        if self.edge_rates is None:
            return np.zeros((len(self.q), 0))
        return np.split(self.edge_rates, 2, axis=1)[order]

    @property
    def supports(self) -> tuple[str, ...]:
        """What is supported; of matrices nothing."""
        return () if self.reduced.supports is None else self.reduced.supports.names

    def reactions(self) -> np.ndarray | None:
        """(n, supports, 2): forces of the supports, N; None of matrices."""
        supports, edges = self.reduced.supports, self.reduced.edges
        if supports is None:
            return None
        output = LinearOutput(supports.names, supports.inertia, supports.loads, supports.contact)
        total = np.empty((len(self.q), len(supports.names), 2))
        for first in range(0, len(total), BLOCK):
            part = slice(first, first + BLOCK)
            total[part] = output(self._modal_acceleration(part), self.amplitudes[part], self.contact[part])
        for order, table in enumerate((supports.damping, supports.mass)):
            total += np.einsum("sxe,ne->nsx", table[..., edges], self._of_edges(order))
        return total

    def _output(self, point: Point) -> LinearOutput:
        if isinstance(point, str):
            return self.reduced.points.of(point, "point")
        return self.reduced.output_at("displacement", checked_place("displacement", point))

    def displacement(self, point: Point) -> np.ndarray:
        """(n, 2), m."""
        return self._output(point)(self.q, self.amplitudes, self.contact)

    def bound(self) -> float:
        """No named point moves further, m: by the largest of each coordinate, load and contact force, which
        is a fraction of the work that their displacements are.
        """
        output, total = self.reduced.points, 0.0
        for rows, values in (
            (output.modes, self.q),
            (output.loads, self.amplitudes),
            (output.contact, self.contact),
        ):
            largest = np.maximum(values.max(axis=0, initial=0.0), -values.min(axis=0, initial=0.0))
            total = total + np.abs(rows) @ largest
        return float(np.linalg.norm(total, axis=-1).max(initial=0.0))

    def velocity(self, point: Point) -> np.ndarray:
        """(n, 2), m/s, of the modes and of what follows prescribed displacements: other residual flexibility
        moves without inertia and is left out.
        """
        return self._rates(point, self.v, 0)

    def acceleration(self, point: Point) -> np.ndarray:
        """(n, 2), m/s^2, of the modes (see `velocity`)."""
        return self._rates(point, self.modal_acceleration, 1)

    def _rates(self, point: Point, modal: np.ndarray, order: int) -> np.ndarray:
        output = self._output(point)
        return output.rates(modal) + self._of_edges(order) @ output.loads[:, self.reduced.edges].T

    def stress(self, place: Point) -> np.ndarray:
        """(n, 3): xx, yy, xy, Pa. Collective."""
        if isinstance(place, str):
            self.reduced.points.of(place, "point")
        else:
            place = checked_place("stress", place)
        output = self.reduced.output_at("stress", place)
        return output(self.q, self.amplitudes, self.contact)

    def along(self, points: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (n, points, 2), m, and stress (n, points, 3), Pa. Collective."""
        u, stress = (
            self.reduced.output_along(kind, points)(self.q, self.amplitudes, self.contact)
            for kind in ("displacement", "stress")
        )
        return u.reshape(len(u), len(points), 2), stress.reshape(len(u), len(points), 3)

    def stress_intensity(self, tip: str) -> np.ndarray:
        """(n, 2): K_I and K_II, Pa m^(1/2)."""
        return self.reduced.tips.of(tip, "crack tip")(self.q, self.amplitudes, self.contact)

    def field(self, instant: int) -> Field:
        """Displacements of this rank's nodes, residual flexibility included, and what contact does inside the
        tips' S-elements. Collective.
        """
        return self.reduced.field(self.q[instant], self.amplitudes[instant], self.contact[instant])


@described
class SampledStates(States):
    """Instants of an unreduced model's motion: what was sampled while it ran, and `fields` for any other
    place, which no file keeps. `points` and `supports` are the names of places and of what is supported.
    """

    labels: ClassVar = {"place": "points", "support": "supports", "tip": "tips"}
    columns: ClassVar = {
        "displacement": "displacements",
        "velocity": "velocities",
        "acceleration": "accelerations",
        "contact_force": "contact",
        "gap": "gap",
        "stress_intensity": "intensities",
        "reactions": "borne",
    }

    points: tuple[str, ...]
    supports: tuple[str, ...]
    displacements: np.ndarray = quantity("m", "displacement", "time place xy")
    velocities: np.ndarray = quantity("m/s", "velocity", "time place xy")
    accelerations: np.ndarray = quantity("m/s^2", "acceleration", "time place xy")
    contact: np.ndarray = quantity(
        "N", "forces of the contact rows, means over the step that ends at the instant", "time row"
    )
    gap: np.ndarray = quantity("m", "gaps of the contact rows", "time row")
    pairs: int = quantity("1", "contact rows that are node pairs", least=0)
    intensities: np.ndarray = quantity(
        "Pa m^(1 - exponent)",
        "K_I and K_II of the crack tips",
        "time tip component",
        unit_of=lambda states: states.tip_facts.by_tip,
    )
    borne: np.ndarray = quantity(
        "N",
        "force of each support on the structure, extrapolated from the means over the last two steps",
        "time support xy",
    )
    tip_facts: TipFacts = quantity(text="kinds of the tips", part="TipFacts")
    gaps: int | None = quantity(
        "1", "contact rows that are gaps, behind which slips stand, where faces rub", default=None, least=0
    )
    fields: KeptFields | None = None

    def check(self) -> None:
        """Raise ValueError unless pairs and tips are those of its rows."""
        if self.pairs > self.contact.shape[1] or self.tip_facts.contact_rows[-1] > self.contact.shape[1]:
            raise ValueError(f"pairs or tips are not those of {self.contact.shape[1]} contact rows")
        if len(self.tips) != self.intensities.shape[1]:
            raise ValueError(f"the tips are said to be {self.tips} and {self.intensities.shape[1]}")

    def of_instants(self, rows: Rows) -> SampledStates:
        """Other instants of the same motion, with their fields if all are kept."""
        fields = self.fields and self.fields.complete(len(rows["gap"]))
        return replace(super().of_instants(rows), fields=fields)

    def _fingerprint(self) -> object:
        """What tells it from others, the same on all ranks."""
        return self.displacements, self.contact, self.gap

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled or copied: without the fields, which are those of a model in this process."""
        return {**self.__dict__, "fields": None}

    @property
    def tips(self) -> tuple[str, ...]:
        """Names of the crack tips."""
        return self.tip_facts.names

    def reactions(self) -> np.ndarray | None:
        """(n, supports, 2): forces of the supports, N; None without supports."""
        return self.borne if self.supports else None

    def displacement(self, point: Point) -> np.ndarray:
        """(n, 2), m. Collective for a place (x, y)."""
        if isinstance(point, str):
            return self._at(self.displacements, point)
        place = checked_place("displacement", point)
        return self._kept("displacement").along("displacement", [place], self.contact)[:, 0]

    def bound(self) -> float:
        """No named point moves further, m."""
        return float(np.linalg.norm(self.displacements, axis=-1).max(initial=0.0))

    def velocity(self, point: Point) -> np.ndarray:
        """(n, 2), m/s."""
        return self._at(self.velocities, point)

    def acceleration(self, point: Point) -> np.ndarray:
        """(n, 2), m/s^2, extrapolated from the mean ones of the last two steps; at first the mean of the
        first step.
        """
        return self._at(self.accelerations, point)

    def stress_intensity(self, tip: str) -> np.ndarray:
        """(n, 2): K_I and K_II, Pa m^(1/2)."""
        return self._at(self.intensities, tip, "crack tip")

    def stress(self, place: Point) -> np.ndarray:
        """(n, 3): xx, yy, xy, Pa. Collective.

        Raises
        ------
        SolveError
            If the fields are not kept; on all ranks.
        """
        fields = self._kept("stress")
        if isinstance(place, str):
            self._at(self.displacements, place)
        else:
            place = checked_place("stress", place)
        return fields.along("stress", [place], self.contact)[:, 0]

    def along(self, points: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (n, points, 2), m, and stress (n, points, 3), Pa. Collective.

        Raises
        ------
        SolveError
            If the fields are not kept; on all ranks.
        """
        fields = self._kept("along")
        u, stress = (fields.along(kind, points, self.contact) for kind in ("displacement", "stress"))
        return u, stress

    def field(self, instant: int) -> Field:
        """Displacements of this rank's nodes, and what contact does inside the tips' S-elements. Collective.

        Raises
        ------
        SolveError
            If the fields are not kept; on all ranks.
        """
        return self._kept("field").field(instant, self.contact[instant])

    def _kept(self, what: str) -> KeptFields:
        if self.fields is None:
            raise failed_solve(f"{what}: {NOT_KEPT}")
        return self.fields

    def _at(self, table: np.ndarray, name: Any, kind: str = "point") -> np.ndarray:
        """(n, 2): what a table holds of a point or tip."""
        if kind == "point" and not isinstance(name, str):
            raise failed_solve(
                f"point {name!r}: an unreduced model's motion keeps velocities and accelerations of named "
                "points alone; name it in points of the mesh, or use the reduced model"
            )
        names = self.points if kind == "point" else self.tips
        return table[:, at_point({own: k for k, own in enumerate(names)}, name, kind)]
