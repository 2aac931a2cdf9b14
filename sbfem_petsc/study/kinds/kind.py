"""What every kind of analysis tells of itself: its table in a case file, and what runs, sweeps, reports and
estimates do with it.
"""

from __future__ import annotations

import functools
import inspect
import json
import math
import operator
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import sbfem_petsc as sb

from ...analysis.options import OfEither, driven_at
from ...contact.law import peak_of
from ...indicators.detection import contact_duty
from ...options import item, one_of
from ...progress import Progress
from ...record.about import Quantity
from ...record.found import Found, column, labelled, of_points
from ...record.record import Record
from ..case import objects
from ..case.tables import Names, Path, Problem, Table
from ..costs import Cost, Size

Values = dict[str, tuple[Any, str]]  # value and unit by name
Quantities = Iterable[Quantity | None]  # None stands for nothing
PERIODIC: tuple[str, ...] = ("harmonic", "constant")
# Harmonics of each point in a row of a sweep, and in a report.
ROW_HARMONICS, SHOWN = 21, 11
# Makes of a motion what is measured of it.
Measured = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Wanted:
    """What a row of a sweep is to hold of an analysis.

    Attributes
    ----------
    points : sequence of str
    noisy : callable or None
        Adds noise to a motion.
    histories : bool
        Keep the motion of the points too.
    healthy : callable
        Gives the result of the structure without faults, or None where there is none. Collective.
    """

    points: Sequence[str]
    noisy: Callable[[np.ndarray], np.ndarray] | None
    histories: bool
    healthy: Callable[[], Any]


# Pictures of faces that rub, and their captions.
RUBBING = {
    "slips": "where faces are apart, stick and slip",
    "hysteresis": "friction over slip",
    "friction_power": "power lost to friction",
}


@dataclass(frozen=True)
class Drawn:
    """What pictures of a result need beside it: the analysis' name, points that the case asks for, ranks."""

    title: str
    asked: Sequence[str]
    comm: Any

    @property
    def plot(self) -> Any:
        """Matplotlib comes with the first picture."""
        from ... import plot

        return plot

    def point(self, known: Any) -> str | None:
        """The point that a picture shows: the first that the case asks for, else the free end's corner."""
        known = list(known)
        chosen = [point for point in self.asked if point in known]
        return chosen[0] if chosen else "A" if "A" in known else known[0] if known else None


class Kind(Table):
    """A table [analyses.NAME] and what is done with it.

    Attributes
    ----------
    function : str
        Public function that it is solved by, if that has another name than the kind.
    pictured : dict of str to str
        Its pictures of a point, and the functions of `sbfem_petsc.plot` that draw them.
    loads_in : tuple of str
        Keys that name loads.
    signals : tuple of str or None
        Kinds of signals that its loads may have beside numbers; None: all.
    free : bool
        Whether the structure may have rigid-body motions.
    statics : bool
        Whether it takes memory as statics do, and not as modes.
    rubs : bool
        Whether it takes faces that rub.
    moving : bool
        Whether its result is a motion, which can be animated.
    fields : bool
        Whether its result has fields for ParaView.
    saved : bool
        Whether its result is written to a file of its own, unless it has been kept.
    plane : tuple of str
        Keys that are not for a body of another code.
    oscillates : bool
        Whether a load must: constant ones alone are refused.
    details : tuple of str
        Quantities that are kept, but stand in no summary or table.
    captions : dict of str to str
        What its pictures show, where their names do not say it.
    """

    if TYPE_CHECKING:
        kind: Any  # the name in a case file, of each kind its own

    function: ClassVar[str] = ""
    pictured: ClassVar[dict[str, str]] = {}
    loads_in: ClassVar[tuple[str, ...]] = ()
    signals: ClassVar[tuple[str, ...] | None] = None
    free: ClassVar[bool] = False
    statics: ClassVar[bool] = False
    rubs: ClassVar[bool] = True
    moving: ClassVar[bool] = False
    fields: ClassVar[bool] = False
    saved: ClassVar[bool] = False
    plane: ClassVar[tuple[str, ...]] = ("modes", "reduced")
    oscillates: ClassVar[bool] = False
    details: ClassVar[tuple[str, ...]] = ()
    captions: ClassVar[dict[str, str]] = {}

    def solve(self, case: Any, model: Any, file: str | None = None, progress: Progress = None) -> Any:
        """The result, on the case's model: of a public function, whose arguments are what is given and keys
        of the table. Collective.

        Parameters
        ----------
        case : Case
        model : Model or ReducedModel
        file : str, optional
            Where it is kept while it runs, if the function does so, and from where an interrupted run goes
            on.
        progress : callable, "auto" or None
            Called with the fraction done where the function tells it.
        """
        function = getattr(sb, self.function or self.kind)
        kept = {"file": file, "resume": file is not None, "progress": progress}
        arguments = {**dict(self), **kept, **self.given(case)}
        known = inspect.signature(function).parameters
        return function(model, **{name: value for name, value in arguments.items() if name in known})

    def given(self, case: Any) -> dict[str, Any]:
        """Arguments of the function that the table's keys do not give as they are."""
        return {"load": self.acting(case)} if self.loads_in else {}

    def acting(self, case: Any, frequency: float | None = None) -> Any:
        """Its loads; numbers are amplitudes at the frequency of their key, KEY_frequency, or at one that is
        given, Hz, if there is any.
        """
        own = vars(self)
        at = {key: own.get(f"{key}_frequency", frequency) for key in self.loads_in}
        parts = [objects.load(case, own[key], own.get("factor", 1.0), tone) for key, tone in at.items()]
        return functools.reduce(operator.add, parts)

    def loads(self) -> list[str]:
        """Names of its loads."""
        return [name for key in self.loads_in for name in getattr(self, key)]

    @property
    def frictionless(self) -> str | None:
        """Which of it knows no friction, in words behind its name; None if it takes faces that rub."""
        return None if self.rubs else ""

    def against(self, case: Any) -> Iterator[Problem]:
        """What contradicts the rest of the case, at paths within the table."""
        if not self.free and case.model.clamped == [] and not case.model.supports:
            yield Problem(
                ("kind",),
                f"= {self.kind!r} needs a structure held against every rigid-body motion, but "
                "model.clamped = [] and there are no supports; clamp an edge set",
            )
        for key in self.plane:
            if case.body is not None and key in self.model_fields_set:
                more = "give body.modes" if key == "modes" else "leave it out"
                yield Problem((key,), f"is not for a [body], which is reduced once; {more}")
        for key in self.loads_in:
            names = getattr(self, key)
            yield from (
                Problem((key,), f"= {name!r} is no load; {one_of(case.loads, name)}")
                for name in names
                if name not in case.loads
            )
            loads = {name: case.loads[name] for name in names if name in case.loads}
            yield from (Problem((key,), text) for text in self._unfit(loads))
        if self.oscillates and vars(self).get("factor") == 0.0:
            yield Problem(("factor",), "= 0 leaves no load; give another factor")

    def _unfit(self, loads: dict[str, Any]) -> Iterator[str]:
        """Signals that an analysis does not understand; a number beside signals that vary, where numbers are
        amplitudes: it may be meant as a constant; and loads that do not oscillate.
        """
        given = [
            (f"= {name!r} has {part}", value, getattr(value, "kind", ""))
            for name, load in loads.items()
            for part, value in load.components.items()
        ]
        allowed = self.signals
        for words, _, kind in given:
            if kind and allowed is not None and kind not in allowed:
                takes = f"takes numbers{' and ' * bool(allowed)}{' or '.join(allowed)}"
                yield f"{words} of kind {kind!r}, but {self.kind} {takes}; use transient, or another load"
        varies = any(kind not in ("", "constant") for *_, kind in given)
        for words, value, kind in given if varies and "harmonic" in (allowed or ()) else ():
            if not kind and value != 0.0:
                yield (
                    f"{words} = {value:g}, a number beside signals, which may be meant as a constant or as "
                    f'an amplitude; give {{ kind = "constant", value = {value:g} }} or {{ kind = "harmonic", '
                    f"amplitude = {value:g}, frequency = ... }}"
                )
        if self.oscillates and given and all(value == 0.0 or kind == "constant" for _, value, kind in given):
            yield f"= {list(loads)} does not oscillate; give a number, the amplitude of sin(2 pi f t)"

    def places(self) -> Iterator[tuple[Path, str]]:
        """Points that must exist, by their paths within the table."""
        return iter(())

    def asked(self, case: Any, model: Any) -> Iterator[tuple[str, int]]:
        """Keys that ask for modes of the structure, and for how many; those of a body, without a model, are
        kept already. Collective.
        """
        yield "modes", getattr(self, "modes", None) or 0

    def lacking(self, case: Any, model: Any, most: int, words: str) -> Iterator[Problem]:
        """What a structure has not that is asked of it, before anything is solved. Collective.

        Parameters
        ----------
        case : Case
        model : Model or None
            None: a body, which is not reduced yet.
        most : int
            Modes that there are.
        words : str
            What these are, and what to do for more.

        Raises
        ------
        ValueError, TypeError, KeyError
            For loads that the model does not take.
        """
        for key, count in self.asked(case, model):
            if count > most:
                text = f"= {getattr(self, key)} asks for {count:,d} modes, and there are {most:,d}, {words}"
                yield Problem((key,), text)
        if model is not None and self.loads_in:
            model.checked_loads(self.acting(case), constant=False)

    def tones(self, case: Any, path: Path) -> None:
        """Refuse loads without the common period or the tones that the analysis needs, which a run would come
        to refuse behind the analyses before it.

        Parameters
        ----------
        case : Case
        path : tuple
            Of the table.

        Raises
        ------
        CaseError
        """

    def found(self, result: Any, points: Sequence[str]) -> Found:
        """Quantities of a result: those that its class says, and more. Collective."""
        return Found.of(result, points, *self.more(result, points), details=self.details)

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        """What a case keeps beside that, also columns of a sweep. Collective."""
        return ()

    def row(self, result: Any, wanted: Wanted) -> Values:
        """What a row of a sweep keeps of a result: what its class and `more` say. Collective."""
        own = result.sweep_row(wanted.points) if isinstance(result, Record) else {}
        return own | Found(self.more(result, wanted.points)).sweep_row()

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        """Name and axes of each picture: those that are `pictured`. Collective."""
        point = drawn.point(result.points) if self.pictured else None
        if point is not None:
            for name, draw in self.pictured.items():
                yield name, getattr(drawn.plot, draw)(result, point, title=drawn.title, comm=drawn.comm)

    def write_fields(self, result: Any, path: str, model: Any) -> None:
        """Write fields for ParaView, of kinds with `fields`; `model` may be reduced, a body's. Collective."""
        raise NotImplementedError

    def save(self, result: Any, path: str) -> None:
        """Write the result itself, of kinds with `saved`, unless there is none or it has been kept.
        Collective over the ranks that share it.

        Parameters
        ----------
        path : str
            Of its file, without an ending.
        """
        if self.saved and result != () and not os.path.isfile(f"{path}.journal"):
            sb.save(f"{path}.h5", result)

    def cost(self, size: Size) -> Cost:
        """What it takes."""
        raise NotImplementedError

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        """Heading and rows of tables in a report, beside that of all small quantities."""
        return iter(())


class Loaded(Kind):
    """A kind under loads that act together, with a factor on them."""

    loads_in = ("load",)
    load: Names = item(text="name of a load, or several that act together")
    factor: float = item(1.0, text="factor on the load")


class Moved(Kind):
    """A kind whose result has instants, and faces that may rub."""

    captions = RUBBING

    def row(self, result: Any, wanted: Wanted) -> Values:
        """What contact and supports bear at most over time, too; of motions how long contact lasts; where
        histories are kept, the points' displacements.
        """
        values = super().row(result, wanted)
        values["peak_contact_resultant"] = (peak_of(result.contact_resultant), "N")
        if self.moving and result.contact_force.shape[1]:
            values["contact_duty"] = (contact_duty(result.time, result.contact_force).any, "1")
        if result.reactions is not None:  # those of unreduced models are
            peaks = zip(result.supports, abs(result.reactions).max(0))
            values |= {f"peak_reactions/{name}": (peak, "N") for name, peak in peaks}
        if wanted.histories:
            values |= {f"displacement/{point}": (result.displacement(point), "m") for point in wanted.points}
            values["time"] = (result.time, "s")
        return values

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        """Of faces that rub, too, where any do."""
        yield from super().pictures(result, drawn)
        if result.slip is not None and result.slip.size and len(result.time) > 1:
            for name in RUBBING:
                draw = getattr(drawn.plot, f"plot_{name}")
                yield name, draw(result, title=drawn.title, comm=drawn.comm)


class Steady(Moved):
    """A kind whose result is one periodic motion."""

    moving = saved = True
    details = ("contact_force", "slip", "friction_force", "displacement", "reactions")
    captions = Moved.captions | {
        "orbit": "phase plane; gaps and contact resultant over a period",
        "multipliers": "Floquet multipliers",
    }

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        text = "stability, None if it was not asked for or is not known"
        yield labelled("stable", result.stable, text=text)
        yield column(labelled("iterations", int(result.iterations), text="Newton iterations"))
        yield column(labelled("residual", float(result.residuals[-1]), "m sqrt(kg)/s", "the last residual"))
        if len(result.multipliers):
            modulus = float(np.abs(result.multipliers[0]))
            yield column(labelled("largest_multiplier", modulus, text="largest Floquet multiplier's modulus"))
        if result.periods > 1:
            text = "complex amplitudes of u_y at j f / periods"
            yield of_points("subharmonics", points, result.subharmonics, "m", text, "subharmonic")

    def row(self, result: Any, wanted: Wanted) -> Values:
        values = super().row(result, wanted) | self.heard(result, wanted.points, np.asarray, "")
        if wanted.noisy is not None:
            values |= self.heard(result, wanted.points, wanted.noisy, "_noisy")
        return values

    def heard(self, result: Any, points: Sequence[str], measured: Measured, ending: str) -> Values:
        """What is read from the motion as it is measured, by names with an ending."""
        values: Values = {}
        for point in points:
            u = measured(along(result.displacement(point)))
            c = np.fft.rfft(u)[:: result.periods][:ROW_HARMONICS] / len(u)
            c[1:] *= 2.0
            values[f"harmonics{ending}/{point}"] = (c, "m")
        return values

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        # one that is held has no harmonics
        point = drawn.point(point for point in result.points if along(result.displacement(point)).any())
        if point is None:
            return
        yield "harmonics", drawn.plot.plot_harmonics({drawn.title: result}, point, comm=drawn.comm)
        if result.reduced is not None:
            yield "orbit", drawn.plot.plot_orbit(result, point, title=drawn.title, comm=drawn.comm)
        if len(result.multipliers):
            yield "multipliers", drawn.plot.plot_multipliers(result, title=drawn.title, comm=drawn.comm)
        yield from super().pictures(result, drawn)

    def save(self, result: Any, path: str) -> None:
        if result.reduced is not None:
            super().save(result, path)

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        if "harmonics" in found:
            # of rows of a body those alone, else of u_y
            of = {name: c if c.ndim == 1 else c[:, 1] for name, c in found["harmonics"].by_name()}
            heading = ("harmonic", *(f"|{symbol(found, point)}|, µm" for point in of))
            yield heading, list(zip(range(SHOWN), *(1e6 * abs(c) for c in of.values())))


class Forced(Loaded):
    """A kind under periodic loads with a forcing frequency."""

    signals = PERIODIC

    def tones(self, case: Any, path: Path) -> None:
        keys = vars(self)
        found = self.acting(case, keys["frequency"])
        common_period(case, (*path, "load"), found, keys["frequency"], keys.get("periods"))


class Reducible(OfEither, Kind):
    """A kind whose model may be unreduced.

    Attributes
    ----------
    settles : bool
        Whether its motions are steady states, for which all modes of the unreduced model must be damped.
    """

    reduced: bool = item(True, text="false: the unreduced model")
    settles: ClassVar[bool] = False

    def given(self, case: Any) -> dict[str, Any]:
        return super().given(case) | {"reduction": "modes" if self.reduced else None}

    @property
    def frictionless(self) -> str | None:
        """The unreduced model in steady states."""
        return " of the unreduced model" if self.settles and not self.reduced else super().frictionless

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """What the unreduced model has not, too."""
        yield from super().contradictions()
        for name, taken in () if self.reduced else self.of_reduced.items():
            value = vars(self).get(name, taken[0])
            if value not in taken:
                words = f"= {json.dumps(value)} is for the reduced model; leave out reduced = false or {name}"
                yield name, words

    def against(self, case: Any) -> Iterator[Problem]:
        """Motions of the unreduced model that never settle, too."""
        yield from super().against(case)
        given = case.model.rayleigh
        if self.settles and not self.reduced and (given is None or isinstance(given, list) and not given[1]):
            text = "needs damping of all motions, not of the modes alone; give model.rayleigh with b > 0"
            yield Problem(("reduced",), f"= false {text}")


class Curve(Reducible):
    """A kind whose result is a response curve."""

    settles = oscillates = True
    saved = True
    details = ("harmonics",)
    pictured, captions = {"curve": "plot_branches"}, {"curve": "response curve"}

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        yield from size_of(result)
        yield column(labelled("bifurcation_count", len(result.bifurcations), text="number of bifurcations"))
        if result.parameter != "frequency":
            last = lambda point: result.amplitude(point)[-1]
            yield column(of_points("last_amplitude", points, last, "m", "amplitude at the last point"))
            return
        for told in zip(*(result.peak(point).quantities() for point in points)):
            value = dict(zip(points, (q.value for q in told))).__getitem__
            yield column(of_points(told[0].name, points, value, told[0].unit, told[0].about.text))

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        rows = [(entry["kind"].value, entry["value"].value) for entry in found["bifurcations"]]
        yield ("bifurcation", "at"), rows


class TwoTones(Kind):
    """A kind under two loads, `loads_in`, each with a tone of its own, NAME_frequency."""

    probe: Names = item(text="load of the tone whose sidebands are wanted")
    probe_frequency: float = driven_at("tone whose sidebands are wanted")
    pump: Names = item(text="load of the tone that modulates it")
    pump_frequency: float = driven_at("tone that modulates it")
    loads_in = ("probe", "pump")
    saved = True


def common_period(
    case: Any, path: Path, loads: Any, frequency: float, periods: int | None, longest: int | None = None
) -> int:
    """Forcing periods, at most `longest` where that is told, in the common period of loads and a
    frequency, Hz.

    Raises
    ------
    CaseError
        At a path, if there is none.
    """
    from ...motion.excitation import common_periods
    from ...motion.preparation import LONGEST

    with objects.located(case, *path):
        return common_periods(objects.signals_of(loads), frequency, periods, longest or LONGEST)


def along(u: np.ndarray, direction: str = "y") -> np.ndarray:
    """Of a point's motion that along x or y; of a body's point, which has one direction, that."""
    return u if u.ndim == 1 else u[:, "xy".index(direction)]


def symbol(found: Found, point: str) -> str:
    """A point's displacement in the heading of a table: u_y, or along its own direction."""
    along = found["direction"][point].value if "direction" in found else "y"
    return f"u_{along}({point})" if along else f"u({point})"


def size_of(result: Any) -> Quantities:
    """Points of a curve, and how many of them are unstable."""
    unstable = float(result.unstable.sum()) if result.stability_known else math.nan
    yield column(labelled("curve_points", len(result), text="points of the curve"))
    yield column(labelled("unstable_points", unstable, text="unstable ones, nan where that is unknown"))


def estimated_error(table: Any, result: Any) -> Quantity | None:
    """Error of an analysis that an accuracy is asked of."""
    if table.accuracy is None:
        return None
    return column(labelled("estimated_error", float(result.estimate.error), text="estimated error"))
