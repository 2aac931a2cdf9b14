"""Options of the analyses: those of their functions and of their tables in a case file.

One word has one meaning. This module is light, for a case is checked before PETSc reads its own options.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, Literal

from ..motion.factors import FACTORS, WORDS
from ..options import Options, Pair, item

# Hz: no structure has a frequency beyond, and what a structure can be driven at.
HIGHEST, SLOWEST, FASTEST = 1e30, 1e-12, 1e15
# More steps, modes, points or periods, samples of a curve, or steps of a sweep are a slip.
MOST, SAMPLES, LONGEST = 10**7, 10**5, 10**9
_STEPS = "time steps a forcing period; default: 512 or more"
_MODES = "modes; default: as accuracy needs, or all up to 8 times the loads' highest frequency, at least 80"
_LONGEST = "most forcing periods in one period of a motion, or in the common period of its tones"
_FACTOR: Any = Literal[tuple(FACTORS)]
_PARAMETER: Any = Literal[("frequency", *FACTORS)]
FACTOR = f"what a factor is on: {WORDS}"
_CONTACT = "false: crack faces may overlap"


def driven_at(text: str) -> Any:
    """Option of a frequency that a structure can be driven at."""
    return item(text=text, unit="Hz", ge=SLOWEST, le=FASTEST)


def _counted(text: str, default: int | None = None, least: int = 1, most: int = MOST) -> Any:
    return item(default, text=text, ge=least, le=most)


def _accuracy(default: float | None = None) -> Any:
    text = "relative error asked for: finer meshes are made until two of them agree"
    return item(default, text=text, ge=1e-13, le=0.1)


_ORBITS = "1e-3 where neither modes nor steps are given"
_OF_MANY = f"{_ORBITS}, in 160 modes at most"


def _harmonics(default: str = _ORBITS) -> Any:
    text = (
        "relative error of harmonics 1 to 4 of points and resultant asked for: default modes and steps are "
        f"as many as it needs; default: {default}"
    )
    return item(None, text=text, ge=1e-8, le=0.1)


def _largest_step(what: str, unit: str = "") -> Any:
    return item(None, text=f"largest change of the {what} from a point to the next", unit=unit, gt=0)


class Ranged(Options):
    """A range, `start` to `stop`; what is told of one whose ends are one value."""

    instead: ClassVar[str] = "give a range, or use periodic"

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A range of one value."""
        yield from super().contradictions()
        start, stop = (vars(self)[end] for end in ("start", "stop"))
        if start == stop:
            yield "stop", f"= {stop:g} is start itself; {self.instead}"


def even(samples: int) -> Iterator[tuple[str, str]]:
    """The contradiction of phases of an unknown tone that are an even number."""
    if samples % 2 == 0:
        yield "samples", f"= {samples} must be odd; give {samples + 1}"


class OfEither(Options):
    """Options of motions of reduced and of unreduced models.

    Attributes
    ----------
    of_reduced : dict of str to tuple
        Those that are for the reduced model, and the values that the unreduced one takes of them.
    """

    of_reduced: ClassVar[dict[str, tuple[Any, ...]]] = {"accuracy": (None,)}


class ModalOptions(Options):
    """Options of `modal`."""

    count: int | None = _counted("number of lowest frequencies")
    band: Pair | None = item(
        None, text="two frequencies 0 <= low < high, between which all are wanted", unit="Hz"
    )
    auxiliary_tolerance: float = item(
        1e-5, text="inertia terms that matter less to the band are left out", ge=0, lt=1
    )
    verify: bool = item(True, text="count the eigenvalues, so that none of a multiple one is missed")
    accuracy: float | None = _accuracy()

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Count and band, and a band that holds nothing."""
        if (self.count is None) == (self.band is None):
            yield "", "needs count (number of lowest frequencies) or band, low and high, and not both"
        elif self.band is not None and not 0.0 <= self.band[0] < self.band[1] <= HIGHEST:
            yield "band", f"= {self.band} must be 0 <= low < high, at most {HIGHEST:g}, in Hz"


class StaticOptions(Options):
    """Options of `static`."""

    contact: bool = item(True, text=_CONTACT)
    accuracy: float | None = _accuracy()


class LoadHistoryOptions(Options):
    """Options of `load_history`."""

    contact: bool = item(True, text=_CONTACT)


class TransientOptions(OfEither):
    """Options of `transient`."""

    duration: float = item(text="length of the history", unit="s", gt=0)
    step: float | None = item(
        None,
        text="time step; default: 1/320 of the loads' shortest period, with contact at most 0.8 of the "
        "highest mode's",
        unit="s",
        gt=0,
    )
    modes: int | None = _counted(_MODES)
    contact: bool = item(True, text=_CONTACT)
    scheme: Literal["exact", "newmark"] = item("exact", text="time integration")
    decimation: int | None = _counted("every so many steps are kept; default: all that 1 GB holds")
    accuracy: float | None = item(
        None,
        text="relative error of the displacements of points over time asked for: default modes and step are "
        "as many, or as short, as it needs",
        ge=1e-8,
        le=0.1,
    )

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A step that is longer than the history."""
        if self.step is not None and self.step > self.duration:
            yield "step", f"= {self.step:g} s is longer than duration = {self.duration:g} s"


class ErrorOptions(Options):
    """Options of `estimate_error`."""

    contact: bool = item(True, text=_CONTACT)
    scheme: Literal["exact", "newmark"] = item("exact", text="time integration")
    decimation: int | None = _counted("every so many steps are kept")


class Integration(Options):
    """How motions under periodic loads are integrated."""

    steps: int | None = _counted(_STEPS, least=48)
    modes: int | None = _counted(_MODES)


class PeriodicOptions(OfEither, Integration):
    """Options of `periodic`."""

    of_reduced = {
        "segments": (1,),
        "tolerance": (None,),
        "accuracy": (None,),
        "stability": (None, False),
        "jacobian": ("auto", "matrix-free"),
    }

    frequency: float = driven_at("forcing frequency")
    periods: int | None = _counted("forcing periods in a period of the motion; default: the fewest that fit")
    contact: bool = item(True, text=_CONTACT)
    jacobian: Literal["auto", "dense", "matrix-free", "differences"] = item(
        "auto", text="derivative of the shooting Newton iteration"
    )
    stability: bool | None = item(
        None, text="compute the Floquet multipliers; default: of a reduced model, of which alone they can be"
    )
    longest: int = _counted(_LONGEST, 64)
    tolerance: float | None = item(
        None, text="double the steps until displacements change by less (relative)", gt=0, lt=1
    )
    accuracy: float | None = _harmonics()
    segments: int = _counted(
        "multiple shooting over so many parts of a long period, of which the steps are a multiple",
        1,
        most=10**4,
    )

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Multiple shooting has a derivative of its own and tells no errors; a tolerance asks for steps."""
        for name, given in (("segments", self.segments > 1), ("tolerance", self.tolerance is not None)):
            if self.accuracy is not None and given:
                yield "accuracy", f"= {self.accuracy:g} is not for {name}; leave one of them out"
        if self.segments > 1 and self.jacobian != "auto":
            yield (
                "jacobian",
                f"= {self.jacobian!r} is not for segments = {self.segments}; leave one of them out",
            )


class FrequencyRange(Ranged, Integration):
    """The forcing frequencies of a curve."""

    start: float = driven_at("first frequency")
    stop: float = driven_at("last frequency")
    largest_step: float | None = _largest_step("frequency", "Hz")


class CurveOptions(OfEither, Integration):
    """What response curves over any parameter have in common."""

    # damping and gaps are in the matrices of an unreduced model
    of_reduced = {"parameter": ("frequency", "load"), "accuracy": (None,), "stability": (None, False)}

    periods: int | None = _counted("forcing periods in a period of the motion; default: 1, or those of guess")
    points: int = _counted("points at most", 400, least=2)
    stability: bool | None = item(
        None, text="compute Floquet multipliers and bifurcations; default: of a reduced model"
    )
    accuracy: float | None = _harmonics(_OF_MANY)


class FrequencyResponseOptions(CurveOptions, FrequencyRange):
    """Options of `frequency_response`."""

    of_reduced = CurveOptions.of_reduced | {"contact": (True,)}
    contact: bool = item(True, text="false: the linear response")


class LoadResponseOptions(Ranged, CurveOptions):
    """Options of `load_response`."""

    of_reduced = CurveOptions.of_reduced | {"parameter": ("load",)}
    frequency: float = driven_at("forcing frequency")
    start: float = item(0.0, text="first factor", ge=0, le=1e15)
    stop: float = item(1.0, text="last factor", ge=0, le=1e15)
    parameter: _FACTOR = item("load", text=FACTOR)
    largest_step: float | None = _largest_step("factor")


class SwitchOptions(Options):
    """Options of `switch_branch`."""

    size: float | None = item(
        None, text="distance from the branch relative to the state; default: several are tried", gt=0
    )
    samples: int = _counted("phases of the motion's own tone; odd", 21, least=3)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Phases of an unknown tone are an odd number."""
        yield from super().contradictions()
        yield from even(self.samples)


class LineOptions(Options):
    """What lines of bifurcations are followed over, and how far."""

    parameter: _FACTOR = item("load", text=FACTOR)
    points: int = _counted("points to either side of a bifurcation at most", 100)


class LocusOptions(Ranged, LineOptions):
    """Options of `locus`."""

    instead = "give a range of factors"
    start: float = item(text="first factor on the second parameter", ge=0, le=1e15)
    stop: float = item(text="last factor on the second parameter", ge=0, le=1e15)
    largest_step: float | None = _largest_step("factor")


class LociOptions(LocusOptions):
    """Options of `loci`."""

    kinds: list[Literal["fold", "period doubling", "Neimark-Sacker", "grazing"]] = item(
        ["fold", "period doubling", "Neimark-Sacker"], text="which kinds are followed", min_length=1
    )

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A range that leaves out what the branch was computed with."""
        yield from super().contradictions()
        if not min(self.start, self.stop) <= 1.0 <= max(self.start, self.stop):
            yield "stop", f"= {self.stop:g}: the factor 1 must lie between start = {self.start:g} and stop"


class GrazingOptions(Options):
    """Options of `grazing_points`."""

    every: bool = item(False, text="of every contact row; false: the ends of the motions without any contact")


class SweptOptions(Ranged):
    """Options of `swept_response`."""

    start: float = driven_at("first frequency")
    stop: float = driven_at("last frequency")
    duration: float = item(text="length of the sweep, one way", unit="s", gt=0)
    steps: int | None = _counted(
        "time steps a period of the higher frequency; default: 320 or more", least=48
    )
    modes: int | None = _counted(_MODES)
    accuracy: float | None = _harmonics(_OF_MANY)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A range of one value, and sweeps that are over before they begin, or never."""
        yield from super().contradictions()
        cycles = 0.5 * (self.start + self.stop) * self.duration
        if not 2.0 <= cycles <= LONGEST:
            text = f"= {self.duration:g} s holds {cycles:.3g} cycles; give 2 or more, at most {LONGEST:g}"
            yield "duration", text


class BasinsOptions(Integration):
    """Options of `basins`."""

    frequency: float = driven_at("forcing frequency")
    longest: int = _counted(_LONGEST, 8, most=1000)
    tolerance: float = item(
        1e-7, text="relative change of the state below which it has settled", ge=1e-13, le=1e-2
    )
    limit: int = _counted("periods that a history is followed at most", 2000)


class QuasiPeriodicOptions(Options):
    """Options of `quasi_periodic`."""

    samples: int = _counted("phases of the slower tone: half as many of its multiples", 21, 3, SAMPLES)
    steps: int | None = _counted(
        "time steps a period of the faster tone; default: 512 or more", None, 48, SAMPLES
    )
    modes: int | None = _counted(_MODES, most=SAMPLES)
    stability: bool = item(True, text="compute the largest Lyapunov exponents")
    accuracy: float | None = _harmonics(_OF_MANY)


class TorusCurveOptions(Options):
    """How many quasi-periodic motions a curve has, and what is told of them."""

    points: int = _counted("quasi-periodic motions at most", 60, least=2)
    stability: bool = item(True, text="compute the largest Lyapunov exponents")


class QuasiPeriodicResponseOptions(TorusCurveOptions):
    """Options of `quasi_periodic_response`."""

    parameter: _PARAMETER | None = item(
        None, text="what changes: the forcing frequency, or a factor on the loads, damping ratios or gaps"
    )
    stop: float = item(text="forcing frequency (Hz) or factor at which it ends", gt=0, le=1e15)
    largest_step: float | None = _largest_step("frequency or factor")


class BackboneOptions(Ranged):
    """Options of `backbone`."""

    instead = "give a range of energies"
    mode: int = item(text="number of the mode, from 1", ge=1, le=10**6)
    start: float = item(text="first energy", unit="J", gt=0)
    stop: float = item(text="last energy", unit="J", gt=0)
    damping: bool = item(
        False, text="true: with the model's damping, under a self-excitation that makes up for it"
    )
    modes: int | None = _counted("modes; default: three for each up to the followed one, and 20")
    steps: int | None = _counted("time steps a period; default: 1024 or more", least=48)
    points: int = _counted("points at most", 200, least=2)
    largest_step: float | None = _largest_step("energy", "J")
    largest_change: float = item(
        0.4, text="largest change of the state from a point to the next, relative", gt=0
    )
    interactions: bool = item(
        False, text="follow the narrow tongues where a multiple of the frequency meets that of a higher mode"
    )
    refine: bool = item(True, text="solve every point with half the step too and extrapolate the frequency")
    stability: bool = item(True, text="compute Floquet multipliers")

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A range of one value, and a mode that is not kept."""
        yield from super().contradictions()
        if self.modes is not None and self.mode > self.modes:
            yield "mode", f"= {self.mode} must be one of the modes = {self.modes}"


class EstimateOptions(Options):
    """Options of `estimate`."""

    accuracy: float = _accuracy(1e-4)
    levels: int = item(6, text="most levels", ge=2, le=8)
