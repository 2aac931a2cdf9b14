"""What every kind of analysis tells of itself: its table in a case file, and what runs, sweeps, reports and
estimates do with it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import sbfem_petsc as sb

from ...analysis.options import driven_at
from ...indicators.detection import contact_duty
from ...options import item, one_of
from ...record.about import Quantity
from ...record.found import Found
from ...record.record import Record
from ..case import objects
from ..case.given import Given, Tables
from ..case.tables import Names, Path, Problem, Table
from ..costs import Cost, Size

Values = dict[str, tuple[Any, str]]  # value and unit by name
Quantities = Iterable[Quantity | None]  # None stands for nothing
PERIODIC: tuple[str, ...] = ("harmonic", "constant")


@dataclass(frozen=True)
class Run:
    """How an analysis is run.

    Attributes
    ----------
    file : str or None
        File from which an interrupted run goes on, of kinds with `running`.
    progress : callable or None
        Called with the fraction done where the analysis tells it.
    """

    file: str | None = None
    progress: Callable[[float], None] | None = None

    @property
    def kept(self) -> dict[str, Any]:
        """Arguments of an analysis that keeps what it has until it is told to go on."""
        return {"file": self.file, "resume": self.file is not None, "progress": self.progress}


@dataclass(frozen=True)
class Wanted:
    """What a row of a sweep is to hold of an analysis.

    Attributes
    ----------
    case : Given
        That of the row.
    points : sequence of str
    noisy : callable or None
        Adds noise to a motion.
    histories : bool
        Keep the motion of the points too.
    healthy : callable
        Gives the result of the structure without faults, or None where there is none. Collective.
    """

    case: Given
    points: Sequence[str]
    noisy: Callable[[np.ndarray], np.ndarray] | None
    histories: bool
    healthy: Callable[[], Any]


# Captions of `Drawn.rubbing`.
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

    def rubbing(self, result: Any) -> Iterator[tuple[str, Any]]:
        """Pictures of faces that rub, where any do. Collective."""
        if result.slip is not None and result.slip.size and len(result.time) > 1:
            for name in RUBBING:
                draw = getattr(self.plot, f"plot_{name}")
                yield name, draw(result, title=self.title, comm=self.comm)


class Kind(Table):
    """A table [analyses.NAME] and what is done with it.

    Attributes
    ----------
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
    alike : bool
        Whether loads have no part in it: one result serves all rows of a structure.
    moving : bool
        Whether its result is a motion, which can be animated.
    fields : bool
        Whether its result has fields for ParaView.
    running : bool
        Whether it is kept in a file while it runs, from which an interrupted run goes on.
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

    loads_in: ClassVar[tuple[str, ...]] = ()
    signals: ClassVar[tuple[str, ...] | None] = None
    free: ClassVar[bool] = False
    statics: ClassVar[bool] = False
    rubs: ClassVar[bool] = False
    alike: ClassVar[bool] = False
    moving: ClassVar[bool] = False
    fields: ClassVar[bool] = False
    running: ClassVar[bool] = False
    saved: ClassVar[bool] = False
    plane: ClassVar[tuple[str, ...]] = ("modes", "reduced")
    oscillates: ClassVar[bool] = False
    details: ClassVar[tuple[str, ...]] = ()
    captions: ClassVar[dict[str, str]] = {}

    def solve(self, case: Given, model: Any, run: Run) -> Any:
        """The result, on the case's model. Collective."""
        raise NotImplementedError

    def loads(self) -> list[str]:
        """Names of its loads."""
        return [name for key in self.loads_in for name in getattr(self, key)]

    @property
    def frictionless(self) -> str | None:
        """Which of it knows no friction, in words behind its name; None if it takes faces that rub."""
        return None if self.rubs else ""

    def against(self, case: Tables) -> Iterator[Problem]:
        """What contradicts the rest of the case, at paths within the table."""
        if not self.free and case.model.clamped == [] and not case.model.supports:
            yield Problem(
                ("kind",),
                f"= {self.kind!r} needs a structure held against every rigid-body motion, but "
                "model.clamped = [] and there are no supports; clamp an edge set",
            )
        fields = type(self).model_fields
        for key in self.plane if case.body is not None else ():
            if key in fields and getattr(self, key) != fields[key].default:
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
            yield from self._signals(key, loads)
            yield from self._still(key, loads) if self.oscillates else ()

    def _still(self, key: str, loads: dict[str, Any]) -> Iterator[Problem]:
        """Loads that do not oscillate."""
        given = [value for load in loads.values() for value in load.components.values()]
        if given and all(value == 0.0 or getattr(value, "kind", "") == "constant" for value in given):
            text = f"= {list(loads)} does not oscillate; give a number, the amplitude of sin(2 pi f t)"
            yield Problem((key,), text)
        if getattr(self, "factor", 1.0) == 0.0:
            yield Problem(("factor",), "= 0 leaves no load; give another factor")

    def _signals(self, key: str, loads: dict[str, Any]) -> Iterator[Problem]:
        """Signals that an analysis does not understand; and a number beside signals that vary, where numbers
        are amplitudes: it may be meant as a constant.
        """
        allowed = self.signals
        if allowed is None:
            return
        given = [
            (name, part, value) for name, load in loads.items() for part, value in load.components.items()
        ]
        kinds = [getattr(value, "kind", None) for _, _, value in given]
        for (name, part, _), kind in zip(given, kinds):
            if kind is not None and kind not in allowed:
                what = f"numbers and {' or '.join(allowed)}" if allowed else "numbers"
                yield Problem(
                    (key,),
                    f"= {name!r} has {part} of kind {kind!r}, but {self.kind} takes {what}; use "
                    "transient, or another load",
                )
        if "harmonic" not in allowed or all(kind in (None, "constant") for kind in kinds):
            return
        for name, part, value in given:
            if isinstance(value, float) and value != 0.0:
                yield Problem(
                    (key,),
                    f"= {name!r} has {part} = {value:g}, a number beside signals, which may be meant as a "
                    f'constant or as an amplitude; give {{ kind = "constant", value = {value:g} }} or '
                    f'{{ kind = "harmonic", amplitude = {value:g}, frequency = ... }}',
                )

    def places(self) -> Iterator[tuple[Path, str]]:
        """Points that must exist, by their paths within the table."""
        return iter(())

    def asked(self, case: Given, model: Any) -> Iterator[tuple[str, int]]:
        """Keys that ask for modes of the structure, and for how many; those of a body, without a model, are
        kept already. Collective.
        """
        yield "modes", getattr(self, "modes", None) or 0

    def lacking(self, case: Given, model: Any, most: int, words: str) -> Iterator[Problem]:
        """What a structure has not that is asked of it, before anything is solved. Collective.

        Parameters
        ----------
        case : Given
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
            model.checked_loads(objects.load(case, self.loads()), constant=False)

    def tones(self, case: Given, path: Path) -> None:
        """Refuse loads without the common period or the tones that the analysis needs, which a run would come
        to refuse behind the analyses before it.

        Parameters
        ----------
        case : Given
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
        """Name and axes of each picture. Collective."""
        return iter(())

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

    def summary_line(self, result: Any) -> str:
        """A line about a result."""
        return repr(result)

    def cost(self, size: Size) -> Cost:
        """What it takes."""
        raise NotImplementedError

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        """Heading and rows of tables in a report, beside that of all small quantities."""
        return iter(())


class UnderLoad(Kind):
    """A kind under loads that act together."""

    loads_in = ("load",)
    load: Names = item(text="name of a load, or several that act together")

    def acting(self, case: Given, frequency: float | None = None) -> Any:
        """The loads; numbers are amplitudes at a frequency, Hz, if one is given."""
        return objects.load(case, self.load, vars(self).get("factor", 1.0), frequency)


class Loaded(UnderLoad):
    """A kind under loads with a factor on them."""

    factor: float = item(1.0, text="factor on the load")


class Moved(Kind):
    """A kind whose result has instants, and faces that may rub."""

    captions = RUBBING

    def row(self, result: Any, wanted: Wanted) -> Values:
        """What contact and supports bear at most over time, too; of motions how long contact lasts; where
        histories are kept, the points' displacements.
        """
        values = super().row(result, wanted)
        values["peak_contact_resultant"] = (float(result.contact_resultant.max(initial=0.0)), "N")
        if self.moving and result.contact_force.shape[1]:
            values["contact_duty"] = (contact_duty(result.time, result.contact_force).any, "1")
        if result.reactions is not None:  # those of unreduced models are
            peaks = zip(result.supports, abs(result.reactions).max(0))
            values |= {f"peak_reactions/{name}": (peak, "N") for name, peak in peaks}
        if wanted.histories:
            values |= {f"displacement/{point}": (result.displacement(point), "m") for point in wanted.points}
            values["time"] = (result.time, "s")
        return values


class Forced(UnderLoad):
    """A kind under periodic loads with a forcing frequency."""

    signals = PERIODIC

    def tones(self, case: Given, path: Path) -> None:
        self.common_period(case, path)

    def common_period(self, case: Given, path: Path) -> int:
        """Forcing periods in the common period of the load and the frequency.

        Raises
        ------
        CaseError
            If there is none.
        """
        from ...motion.excitation import common_periods
        from ...motion.preparation import LONGEST

        keys = vars(self)
        found = self.acting(case, keys["frequency"])
        with objects.located(case, *path, "load"):
            signals = objects.signals_of(found)
            return common_periods(signals, keys["frequency"], keys.get("periods"), LONGEST)


class Reducible(Kind):
    """A kind whose model may be unreduced.

    Attributes
    ----------
    of_reduced : dict of str to tuple
        Options that are for the reduced model, and the values that the unreduced one takes of them.
    settles : bool
        Whether its motions are steady states, for which all modes of the unreduced model must be damped.
    """

    reduced: bool = item(True, text="false: the unreduced model")
    of_reduced: ClassVar[dict[str, tuple[Any, ...]]] = {"accuracy": (None,)}
    settles: ClassVar[bool] = False

    @property
    def reduction(self) -> str | None:
        """Argument of the function."""
        return "modes" if self.reduced else None

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """What the unreduced model has not, too."""
        yield from super().contradictions()
        for name, taken in () if self.reduced else self.of_reduced.items():
            value = getattr(self, name)
            if value not in taken:
                words = f"= {json.dumps(value)} is for the reduced model; leave out reduced = false or {name}"
                yield name, words

    def against(self, case: Tables) -> Iterator[Problem]:
        """Motions of the unreduced model that never settle, too."""
        yield from super().against(case)
        given = case.model.rayleigh
        if self.settles and not self.reduced and (given is None or isinstance(given, list) and not given[1]):
            text = (
                "= false needs damping of all motions, not of the modes alone; give model.rayleigh with b > 0"
            )
            yield Problem(("reduced",), text)


class TwoTones(Kind):
    """A kind under two loads, `loads_in`, each with a tone of its own, NAME_frequency."""

    probe: Names = item(text="load of the tone whose sidebands are wanted")
    probe_frequency: float = driven_at("tone whose sidebands are wanted")
    pump: Names = item(text="load of the tone that modulates it")
    pump_frequency: float = driven_at("tone that modulates it")
    loads_in = ("probe", "pump")
    saved = rubs = True

    def acting(self, case: Given) -> Any:
        """The loads, in the order of `loads_in`; numbers are amplitudes of their tone."""
        first, second = (
            objects.load(case, getattr(self, name), frequency=getattr(self, f"{name}_frequency"))
            for name in self.loads_in
        )
        return first + second


def along(u: np.ndarray, direction: str = "y") -> np.ndarray:
    """Of a point's motion that along x or y; of a body's point, which has one direction, that."""
    return u if u.ndim == 1 else u[:, "xy".index(direction)]
