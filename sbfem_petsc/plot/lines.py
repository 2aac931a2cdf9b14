"""Pictures of lines of a spectrum as stems: harmonics, sums of two tones, sidebands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from ..continuation.orbit import Orbit
from ..continuation.problems.tones import QuasiPeriodic
from ..indicators.lines import Sidebands
from ..motion.states import Point
from .drawing import MARKED, Scale, legend, note
from .picture import Comm, divisors, named, picture, place_name, symbol

# Orders up to which a line is named in the picture.
NAMED = 2
# What is this far below the highest line is the rounding of the linear response.
ROUND_OFF = 1e-12
# A line: its place, its height (m), and what is written above it.
Line = tuple[float, float, str]
Lines = Mapping[str, list[Line]]


def _above(found: Lines, share: float, still: str) -> dict[str, list[Line]]:
    """Lines higher than a share of the highest; ValueError, in these words, where nothing moves."""
    top = max((height for lines in found.values() for _, height, _ in lines), default=0.0)
    if not top > 0.0:
        raise ValueError(still)
    return {name: [line for line in lines if line[1] > share * top] for name, lines in found.items()}


def _floor(seen: Lines) -> float:
    """The power of ten below the lowest line, on which stems stand: a logarithmic scale has no zero."""
    return float(10.0 ** np.floor(np.log10(0.7 * min(line[1] for lines in seen.values() for line in lines))))


def _stems(
    axes: Axes, seen: Lines, across: tuple[str, str], up: tuple[str, str], room: float, **look: Any
) -> None:
    """Lines as stems on a logarithmic scale, of each motion in its colour, up to `room` times the highest;
    words stand at the highest of several motions. `across` and `up` are what the axes show, and its unit.
    """
    lines = sorted((line for some in seen.values() for line in some), key=lambda line: line[1])
    x, y = (Scale.of(*what, [line[k] for line in lines]) for k, what in enumerate((across, up)))
    floor = y(_floor(seen))
    for style, (name, some) in zip(MARKED(), seen.items()):
        places, heights = x([line[0] for line in some]), y([line[1] for line in some])
        axes.vlines(places, floor, heights, color=style["color"], linewidth=1.4)
        axes.plot(places, heights, label=name, linestyle="none", markersize=4, **style)
    highest = {words: (x(place), y(height)) for place, height, words in lines}
    for words, at in sorted(highest.items(), key=lambda item: item[1]):
        note(axes, words, at, **look)
    axes.set(yscale="log", ylim=(floor, room * y(lines[-1][1])), xlabel=x.label, ylabel=y.label)
    axes.yaxis.set_major_locator(LogLocator(numticks=12))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y")
    legend(axes, loc="upper right")


@picture(Orbit, several=True)
def plot_harmonics(
    orbits: Orbit | Mapping[str, Orbit],
    point: Point = "A",
    direction: str = "y",
    *,
    count: int = 10,
    decades: float = 5.0,
    forces: Mapping[str, float] | None = None,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> Axes | None:
    """Draw the moduli of the harmonics of several periodic motions as stems on a logarithmic scale.
    Collective.

    Parameters
    ----------
    orbits : Orbit or dict of str to Orbit
        On rank 0 at least; on all ranks for a place (x, y).
    point : str or (x, y)
        Name, or m.
    direction : {"y", "x"}
    count : int
        Highest harmonic.
    decades : float
        Below the largest harmonic at least that are shown, to a power of ten.
    forces : dict of str to float, optional
        N: harmonics are divided by them.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    divisor, found = divisors("plot_harmonics", named(orbits), forces), {}
    apart = min(0.2, 0.7 / len(divisor))
    for k, (name, orbit) in enumerate(named(orbits).items()):
        heights = np.abs(orbit.harmonics(point, direction)[: count + 1]) / divisor[name]
        places = np.arange(len(heights)) + apart * (k - 0.5 * (len(divisor) - 1))
        kept = heights > ROUND_OFF * heights.max()  # rounding is no harmonic
        found[name] = [(float(at), float(height), "") for at, height in zip(places[kept], heights[kept])]
    still = f"plot_harmonics: point {point!r} does not move in {direction}"
    least = _floor(_above(found, 10.0**-decades, still)) / 0.7
    seen = {name: [line for line in lines if line[1] > least] for name, lines in found.items()}
    label = f"$|{symbol(orbits, direction, point)}|$({place_name(point)})"
    label += " (m)" if forces is None else " / force (m/N)"
    (axes,) = ax.panels((1, 1), 2.9)
    _stems(axes, seen, ("harmonic number", ""), (label, ""), 4.0)
    axes.set(xlim=(-0.6, count + 0.6), xticks=range(count + 1))
    return axes


@picture(QuasiPeriodic, several=True)
def plot_lines(
    motions: QuasiPeriodic | Mapping[str, QuasiPeriodic],
    point: Point = "A",
    direction: str = "y",
    *,
    order: int = 3,
    decades: float = 6.0,
    title: str = "",
    ax: Any = None,
    comm: Comm = None,
) -> Axes | None:
    """Draw the lines m f1 + n f2 of motions under two tones as stems over their frequencies. Collective.

    Parameters
    ----------
    motions : QuasiPeriodic or dict of str to QuasiPeriodic
        On rank 0 at least; on all ranks for a place (x, y).
    point : str or (x, y)
        Name, or m. Motions with a tone of their own are integrated again at a place; of those under two given
        tones named points alone are kept.
    direction : {"y", "x"}
    order : int
        Lines up to this \\|m\\| and \\|n\\|.
    decades : float
        Below the largest line; what is smaller is left out.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    found = {name: _lines(motion, point, direction, order) for name, motion in named(motions).items()}
    still = f"plot_lines: point {point!r} does not move in {direction}"
    seen = _above(found, max(ROUND_OFF, 10.0**-decades), still)
    label = f"$|{symbol(motions, direction, point)}|$({place_name(point)})"
    (axes,) = ax.panels((1, 1), 3.2)
    _stems(axes, seen, ("frequency", "Hz"), (label, "m"), 40.0, lift=4.0, rotation=90, fontsize=6)
    axes.set_xlim(left=0.0)
    return axes


def _lines(motion: QuasiPeriodic, point: Point, direction: str, order: int) -> list[Line]:
    """The lines m f1 + n f2 up to an order, Hz; those of low order by name."""
    (first, second), around = motion.frequencies, range(-order, order + 1)
    places = {(m, n): m * first + n * second for m in around for n in around if m or n}
    return [
        (
            f,
            float(abs(motion.line(m, n, point, direction))),
            _line_name(m, n) if max(abs(m), abs(n)) <= NAMED else "",
        )
        for (m, n), f in places.items()
        if f > 0.0
    ]


def _line_name(m: int, n: int) -> str:
    """A line's numbers as a sum of tones: f1, 2 f2, f1 - f2."""
    tones = [(count, tone) for count, tone in ((m, "$f_1$"), (n, "$f_2$")) if count]
    words = ""
    for count, tone in sorted(tones, key=lambda part: part[0] < 0):  # what is added before what is taken away
        sign = (" − " if words else "−") if count < 0 else " + " if words else ""
        words += f"{sign}{'' if abs(count) == 1 else f'{abs(count)} '}{tone}"
    return words


@picture(Sidebands, several=True)
def plot_sidebands(
    sidebands: Sidebands | Mapping[str, Sidebands], *, title: str = "", ax: Any = None, comm: Comm = None
) -> Axes | None:
    """Draw a carrier and its sidebands as stems over their frequencies. Collective.

    Parameters
    ----------
    sidebands : Sidebands or dict of str to Sidebands
        On rank 0 at least.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    found = {}
    for name, s in named(sidebands).items():
        heights = enumerate(np.abs([*s.lower[::-1], s.centre, *s.upper]), -len(s.lower))
        found[name] = [(s.carrier + n * s.modulation, float(height), _side_name(n)) for n, height in heights]
    seen = _above(found, ROUND_OFF, "plot_sidebands: there is neither a carrier nor a sideband")
    (axes,) = ax.panels((1, 1), 2.9)
    _stems(axes, seen, ("frequency", "Hz"), ("amplitude", "m"), 8.0, lift=5.0, va="baseline")
    return axes


def _side_name(n: int) -> str:
    return f"{n:+}".replace("-", "−") if n else "carrier"
