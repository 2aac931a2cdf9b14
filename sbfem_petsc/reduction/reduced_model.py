"""A structure in its lowest modes plus residual flexibility; contact carries no mass (MacNeal 1971)."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..bodies.finite_element_model import FiniteElementModel
from ..bodies.rows import Contact
from ..contact.closed_sets import ClosedSets, thin_factors
from ..contact.friction import Friction, refuse_friction, rubbing_of
from ..contact.law import RowLaws
from ..errors import at_point, failed_solve
from ..loads import Load
from ..petsc import MPI, summed
from ..record.record import Record, derived, described, quantity
from ..system.fields.places import Point
from ..system.fields.sampling import Field
from ..system.fields.tip_facts import TipFacts
from ..system.model import Model
from ..system.solve.modal_result import Modal
from .outputs import LinearOutput
from .supports import Supports

# What an analysis is of.
SYSTEM = "a Model, or a ReducedModel, which reduce makes of a body and reduce_matrices of M and K"
# Modes, and two more, of the model that tells what those do which are left out.
WIDER = 1.5


class OfReduced(Record):
    """A record of a reduced model, whose named points are its own."""

    labels: ClassVar = {"place": "points"}

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        names: tuple[str, ...] = self._reduced.points.names
        return names

    def _index(self, point: str) -> int:
        """The number of a named point."""
        return int(at_point({name: k for k, name in enumerate(self.points)}, point))

    def _at_place(
        self, place: tuple[float, float], found: Callable[[LinearOutput], np.ndarray]
    ) -> np.ndarray:
        """What is found of the displacement of a place (x, y) alone, kept for the next time. Collective."""
        known: dict[tuple[float, float], np.ndarray] = self.__dict__.setdefault("_places", {})
        if place not in known:
            of = self._reduced.output_at("displacement", place)
            known[place] = found(LinearOutput((), of.modes[None], of.loads[None], of.contact[None]))
        return known[place]


def wider_count(modes: int) -> int:
    """Modes of the model that tells what those beyond so many do."""
    return math.ceil(WIDER * modes) + 2


class Lag(NamedTuple):
    """How far what is left out of a reduced model is viscous, as Rayleigh's b K is: R / (1 + i omega b).

    Attributes
    ----------
    share : float
        Of the highest mode's damping that is b omega / 2.
    layers : (c,) array
        Compliance of the contact rows that follows at once, m/N: of layers and stops.
    """

    share: float
    layers: np.ndarray

    @classmethod
    def of(cls, b: float, omega: float, ratio: float, layers: np.ndarray) -> Lag | None:
        """By the highest mode; None without b."""
        return cls(0.5 * b * omega / ratio, layers) if b * omega > 0.0 else None

    def beyond(self, delay: float, omega: float, ratio: float) -> Lag:
        """The same, by a highest frequency (rad/s) of another damping ratio."""
        return self._replace(share=0.5 * delay * omega / ratio if ratio > 0.0 else self.share)


@described
class ReducedModel(Record):
    """A model in modal coordinates q with the static flexibility R = K^-1 - Phi Omega^-2 Phi^T of what is
    left out.

    q'' + 2 zeta Omega q' + Omega^2 q = load_modes s + gap.modes^T force,
    gap = gap.modes q + gap.contact force + gap.loads s + initial_gap,
    with the amplitudes s(t) of unit loads and the contact forces. Prescribed displacements are unit loads,
    too, whose rates act through 2 zeta / Omega load_modes beside them: what damps is the motion against the
    static displacement that follows the supports. It stands in the place of its model in
    `transient`, `periodic`, `frequency_response`, `load_response` and the analyses built on them. Where faces
    rub, the slips of contact rows stand behind all gaps, and their friction behind the other forces;
    `transient`, `static`, `load_history`, `periodic`, `frequency_response` and `load_response` take such a
    model.

    `loads` are the unit loads it was made for, none for a system of matrices; `model` and `modal`, the modes
    themselves, distributed, are None for such a system and for one read from a file. `whole` are the
    displacements of all unknowns of a system of matrices, `body` and `contact` the body that has them and its
    contact; `wider` makes such a system in more modes, see `build.wider`, None in files. `lag` is what the
    static flexibility lacks of Rayleigh's damping, of which errors are told. The last `vectors` of the modes
    are no natural ones: they stand for all that are left out, see `left_out`, of which `vector_shapes`
    (owned, vectors) are the displacements.
    """

    frequencies: np.ndarray = quantity("Hz", "natural frequencies", "mode", least=0.0)
    damping: np.ndarray = quantity("1", "modal damping ratios", "mode", least=0.0)
    gap: LinearOutput = quantity(
        "m", "gaps of the contact rows, node pairs first", "row", part="LinearOutput"
    )
    initial_gap: np.ndarray = quantity("m", "gaps of the contact rows at rest", "row")
    pairs: int = quantity("1", "contact rows that are node pairs", least=0)
    load_modes: np.ndarray = quantity("N/sqrt(kg)", "unit loads in the modes, Phi^T f", "mode load")
    load_flexibility: np.ndarray = quantity(
        "m/N", "residual flexibility at the loads, f^T R f", "load load_of"
    )
    points: LinearOutput = quantity("m", "displacements of the named points", "place xy", part="LinearOutput")
    tips: LinearOutput = quantity(
        "SI", "K_I and K_II of the crack tips", "tip component", part="LinearOutput"
    )
    translation: np.ndarray = quantity(
        "sqrt(kg)", "modal coordinates of a unit translation along x and y", "mode xy"
    )
    loads: tuple[Load, ...] = ()
    model: Model | None = field(default=None, repr=False)
    modal: Modal | None = field(default=None, repr=False)
    contact_laws: RowLaws = quantity(
        text="laws of the contact rows that are gaps, whose compliance is part of `gap`",
        part="RowLaws",
        default=None,
        repr=False,
    )
    tip_facts: TipFacts = field(default_factory=TipFacts.none, repr=False)
    friction: Friction | None = quantity(
        text="the contact rows that are slips, None where nothing rubs",
        part="Friction",
        default=None,
        repr=False,
    )
    directions: tuple[str, ...] | None = quantity(
        text="directions of the points of a body", dims="place", default=None, repr=False
    )
    whole: LinearOutput | None = field(default=None, repr=False)
    body: FiniteElementModel | None = field(default=None, repr=False)
    contact: Contact | None = field(default=None, repr=False)
    ranks: MPI.Comm | None = field(default=None, repr=False)
    supports: Supports | None = quantity(
        text="forces of the supports, and which unit loads are prescribed displacements; None of matrices",
        part="Supports",
        default=None,
        repr=False,
    )
    wider: Callable[[], ReducedModel | None] | None = field(default=None, repr=False)
    lag: Lag | None = field(default=None, repr=False)
    vectors: int = quantity("1", "modes that are no natural ones, behind these", least=0, default=0)
    vector_shapes: np.ndarray | None = field(default=None, repr=False)

    @derived(text="the unit loads", dims="load", kinds="U", detail=True)
    def unit_loads(self) -> np.ndarray | None:
        """(l,) texts, None for a system of matrices."""
        return np.array(list(map(repr, self.loads))) if self.loads else None

    @derived(text="kinds of the tips", part="TipFacts", back=True)
    def kinds_of_tips(self) -> TipFacts | None:
        """`tip_facts`, None without tips."""
        return None if self.tip_facts.contact_rows.tolist() == [0] else self.tip_facts

    @classmethod
    def _revived(cls, found: dict[str, Any]) -> ReducedModel:
        """From a file: without tips none are told of."""
        return cls(**found | {"tip_facts": found.pop("kinds_of_tips") or TipFacts.none()})

    def check(self) -> None:
        """Raise ValueError unless modes, rows and tips belong together."""
        if self.natural < 1 or self.pairs > len(self.initial_gap):
            raise ValueError(f"{self.natural} modes and {self.pairs} pairs are no reduced model")
        if {len(self.initial_gap)} != {part.contact.shape[-1] for part in (self.gap, self.points, self.tips)}:
            raise ValueError(f"its contact forces are not those of {len(self.initial_gap)} contact rows")
        if self.tip_facts.names != self.tips.names:
            raise ValueError(f"the tips are said to be {self.tip_facts.names} and {self.tips.names}")
        if self.tip_facts.contact_rows[-1] > self.gaps or len(self.contact_laws) != self.gaps:
            raise ValueError(f"contact laws or tips are not those of {self.gaps} contact rows")
        if self.gaps < self.pairs or (self.friction is not None and (self.friction.rows >= self.gaps).any()):
            raise ValueError(f"its slips are not those of {self.gaps} contact rows")
        shape = (len(self.omega), self.load_modes.shape[1], len(self.initial_gap))
        if self.supports is not None and self.supports.sizes != shape:
            raise ValueError(f"its supports' modes, loads and contact rows are not {shape}")

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled or copied: without what makes a wider one."""
        return self.__dict__ | {"wider": None}

    def __post_init__(self) -> None:
        if self.contact_laws is None:
            object.__setattr__(self, "contact_laws", RowLaws.unilateral(self.gaps))

    def _fingerprint(self) -> object:
        """What tells it from others, the same on all ranks."""
        own = self.frequencies, self.damping, self.gap, self.initial_gap, self.load_modes, self.contact_laws
        return self.model, self.loads, self.load_flexibility, self.points.names, own, self.friction

    @property
    def delay(self) -> float:
        """b of Rayleigh's damping, s, by which what is left out would follow its forces later."""
        if self.lag is None:
            return 0.0
        return 2.0 * self.lag.share * max(float(self.damping[-1]), 0.0) / float(self.omega[-1])

    @property
    def natural(self) -> int:
        """Natural modes."""
        return len(self.omega) - self.vectors

    @property
    def in_words(self) -> str:
        """What it moves in."""
        modes = f"{self.natural} modes" if self.natural > 1 else "1 mode"
        return f"{modes} and {self.vectors} vectors" if self.vectors else modes

    @property
    def homogeneous(self) -> bool:
        """Whether motions of any size are alike: neither gaps nor laws of contact have a length."""
        return not self.initial_gap.any() and self.contact_laws.homogeneous

    @property
    def of_rows(self) -> bool:
        """Whether it was made of a body or of matrices: a Model has a mass that moves along x and y."""
        return self.directions is not None or not self.translation.any()

    @property
    def point_directions(self) -> dict[str, str]:
        """Directions of the points of a body by their names."""
        return dict(zip(self.points.names, self.directions or ()))

    @property
    def shows(self) -> bool:
        """Whether it keeps the shapes of a body."""
        return self.body is not None and self.whole is not None

    @property
    def gaps(self) -> int:
        """Contact rows that are gaps; slips stand behind them."""
        return len(self.initial_gap) - (0 if self.friction is None else len(self.friction.rows))

    @functools.cached_property
    def flexibility(self) -> np.ndarray:
        """(l + c, l + c): of the displacements of unit loads and contact rows under their own forces, m/N."""
        return np.block([[self.load_flexibility, self.gap.loads.T], [self.gap.loads, self.gap.contact]])

    def require_frictionless(self, owner: str, why: str = "knows no friction yet") -> None:
        """Raise ValueError, on all ranks, where faces rub."""
        if self.friction is not None:
            refuse_friction(owner, "the contact rows of the reduced model rub", why)

    @functools.cached_property
    def edges(self) -> np.ndarray:
        """Unit loads that are prescribed displacements."""
        return np.zeros(0, dtype=int) if self.supports is None else self.supports.edges

    @property
    def rate_modes(self) -> np.ndarray:
        """(m, edges): rates of prescribed displacements in the modes, N s/(m sqrt(kg))."""
        omega = np.where(self.omega > 0.0, self.omega, np.inf)
        return (2.0 * self.damping / omega)[:, None] * self.load_modes[:, self.edges]

    @functools.cached_property
    def omega(self) -> np.ndarray:
        """(m,): rad/s."""
        return 2.0 * np.pi * self.frequencies

    @functools.cached_property
    def slip_units(self) -> np.ndarray:
        """(k,): of slips beside modal coordinates, m: roots of their compliance."""
        slack = np.diagonal(self.gap.contact)[self.gaps :]
        return np.asarray(np.sqrt(np.where(slack > 0.0, slack, 1.0)))

    @functools.cached_property
    def thin_gaps(self) -> tuple[np.ndarray, np.ndarray]:
        """U and V of `gap.modes`, see `thin_factors`."""
        return thin_factors(self.gap.modes)

    @functools.cached_property
    def closed_sets(self) -> ClosedSets:
        """The sets of rows in contact that motions of this model have met."""
        residual = np.ascontiguousarray(self.gap.contact)
        return ClosedSets(self.thin_gaps[0], residual, rubbing_of(self.friction, residual, self.gaps))

    @functools.cached_property
    def open(self) -> ReducedModel:
        """The same without contact."""
        return held_in(self, np.arange(0))

    @property
    def comm(self) -> MPI.Comm:
        """Ranks that work on it together; one without a model is each rank's own, but of a body."""
        return (self.ranks or MPI.COMM_SELF) if self.model is None else self.model.comm

    def output_at(self, kind: str, place: Point) -> LinearOutput:
        """Displacement (2 components, m) or stress (xx, yy, xy, Pa) at any point, kept for the next time.
        Collective.

        Parameters
        ----------
        kind : {"displacement", "stress"}
        place : str or (x, y)
            Name of a point of the model, or coordinates, m.

        Raises
        ------
        SolveError
            If it has no model; on all ranks.
        """
        model, _ = self._model(kind)
        # one from a file may have other signs of its modes
        modes = self.translation.tobytes(), self.load_modes.tobytes()
        return model.keep(
            ("output", kind, place, self.loads, modes), lambda: self.output_along(kind, [place])
        )

    def output_along(self, kind: str, places: Sequence[Point]) -> LinearOutput:
        """The components of several places one after the other, see `output_at`; not kept. Collective."""
        model, found = self._model(kind)
        form = getattr(model.places(places, inertia=True, moved=len(self.edges) > 0), kind)
        columns = model.load_columns(self.loads)
        # K is symmetric: the responses to the form's own forces give those of all loads and contact rows
        answers = model.solver.columns(form.rows.columns(slice(None)), kind)
        modes = form.modes(found.shapes, self.omega[: self.natural])
        if self.vector_shapes is not None:  # inside S-elements inertia follows natural modes alone
            still = np.zeros(self.vectors)
            modes = np.concatenate([modes, form.modes(self.vector_shapes, still)], axis=1)
        loads = summed(model.comm, answers.T @ columns.forces) + form.direct(columns)
        contact = model.contact.rows(answers).T + form.contact
        squares = self.omega[:, None] ** 2
        return LinearOutput((), modes[:, :0], loads, contact).with_modes(
            modes, self.load_modes / squares, self.gap.modes.T / squares
        )

    def _model(self, what: str) -> tuple[Model, Modal]:
        if self.model is None or self.modal is None:
            raise failed_solve(
                f"{what}: a reduced model of matrices, of a body (whose field alone shapes=True keeps) "
                "or read from a file knows its named points alone; name the place in points= of reduce"
            )
        return self.model, self.modal

    def field(self, q: np.ndarray, amplitudes: np.ndarray, force: np.ndarray) -> Field:
        """Displacements of this rank's nodes at one instant, residual flexibility included, and the forces
        inside the tips' S-elements. Collective.

        Parameters
        ----------
        q : (m,) array
        amplitudes : (l,) array
        force : (c,) array

        Raises
        ------
        SolveError
            If it has neither model nor body; on all ranks.
        """
        if self.body is not None and self.whole is not None:
            return Field(self.body.nodal(self.whole(q[None], amplitudes[None], force[None])[0]))
        model, found = self._model("field")
        load = model.load_columns(self.loads).combined(amplitudes)
        pulled = load.forces[:, 0] + model.contact.rows.forces(force)
        static = (self.load_modes @ amplitudes + force @ self.gap.modes) / self.omega**2
        owned = model.solver.columns(pulled, "field") + found.shapes @ (q - static)[: self.natural]
        if self.vector_shapes is not None:
            owned += self.vector_shapes @ (q - static)[self.natural :]
        return Field.of_forces(model.tips, model.nodal(owned, load), force, load)

    def __repr__(self) -> str:
        return (
            f"ReducedModel({self.in_words} up to {self.frequencies[-1]:.6g} Hz, {self.pairs} "
            f"contact pairs, {self.load_modes.shape[1]} unit loads)"
        )


def share_modes(one: ReducedModel, other: ReducedModel) -> bool:
    """Whether two of the same structure have the same modes and vectors."""
    own, its = one.frequencies, other.frequencies
    return one.vectors == other.vectors and len(own) == len(its) and np.allclose(own, its, rtol=1e-6)


def held_in(reduced: ReducedModel, rows: np.ndarray) -> ReducedModel:
    """The same in whose other contact rows faces may overlap; friction is that of all rows or none."""

    def columns(output: LinearOutput) -> LinearOutput:
        return replace(output, contact=output.contact[..., rows])

    gap = columns(reduced.gap)
    return replace(
        reduced,
        gap=replace(gap, modes=gap.modes[rows], loads=gap.loads[rows], contact=gap.contact[rows]),
        initial_gap=reduced.initial_gap[rows],
        pairs=int((rows < reduced.pairs).sum()),
        points=columns(reduced.points),
        tips=columns(reduced.tips),
        contact_laws=reduced.contact_laws.only(rows),
        friction=reduced.friction if len(rows) else None,
        lag=None if reduced.lag is None else reduced.lag._replace(layers=reduced.lag.layers[rows]),
    )


def require_rows(owner: str, reduced: ReducedModel) -> None:
    """Refuse that of a Model, whose points have two components and whose fields tell more."""
    if not reduced.of_rows:
        raise ValueError(f"{owner}: {reduced!r} is that of a Model; give the Model itself")
