"""Pictures of motions of two tones, of branches of them, and of free motions over their energy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..continuation.problems.curve_branch import QuasiPeriodicBranch
from ..continuation.problems.free_branch import Backbone
from ..continuation.problems.tones import QuasiPeriodic
from ..indicators.lines import Sidebands
from ..motion.states import Point
from ..petsc import MPI
from ..record.units import frequency_unit, length_unit
from .branches import draw_parts, name_verdicts, smooth, split
from .drawing import CYCLE, Sheet, dots, note, stems
from .picture import named, picture, place_name, symbol, whole

# Orders up to which a line is named in the picture.
NAMED = 2
# Lines this far below the highest are the rounding of the linear response.
ROUND_OFF = 1e-12
# Frequencies that differ by less, relative, are drawn as one.
FLAT = 1e-5


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
    comm: MPI.Comm | None = None,
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
    top = max(height for lines in found.values() for _, height in lines.values())
    if not top > 0.0:
        raise ValueError(f"plot_lines: point {point!r} does not move in {direction}")
    least = max(ROUND_OFF, 10.0**-decades) * top
    seen = {name: {line: at for line, at in lines.items() if at[1] > least} for name, lines in found.items()}
    factor, unit = length_unit(top)
    along, name_of_unit = frequency_unit(max(f for lines in found.values() for f, _ in lines.values()))
    scale = np.array([[along], [factor]])
    curves: Any = {name: scale * np.reshape([*lines.values()], (-1, 2)).T for name, lines in seen.items()}
    axes = stems(Sheet.of(ax), curves, 3.2, 40.0, 3.5)
    for line, (f, height) in _highest(seen).items():
        note(axes, _line_name(*line), (f * along, height * factor), 4, rotation=90, fontsize=6)
    axes.set_xlim(left=0.0)
    label = f"$|{symbol(motions, direction, point)}|$({place_name(point)}) ({unit})"
    axes.set(xlabel=f"frequency ({name_of_unit})", ylabel=label)
    return axes


Lines = dict[tuple[int, int], tuple[float, float]]


def _lines(motion: QuasiPeriodic, point: Point, direction: str, order: int) -> Lines:
    """Frequency (Hz) and height (m) of each line m f1 + n f2 up to an order."""
    first, second = motion.frequencies
    around = range(-order, order + 1)
    places = {(m, n): m * first + n * second for m in around for n in around if m or n}
    return {line: (f, abs(motion.line(*line, point, direction))) for line, f in places.items() if f > 0.0}


def _highest(seen: Mapping[str, Lines]) -> Lines:
    """Where to name the lines of low order: at the highest of several motions."""
    result: Lines = {}
    for lines in seen.values():
        for line, at in lines.items():
            if max(map(abs, line)) <= NAMED and at[1] > result.get(line, (0.0, 0.0))[1]:
                result[line] = at
    return result


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
    sidebands: Sidebands | Mapping[str, Sidebands],
    *,
    title: str = "",
    ax: Any = None,
    comm: MPI.Comm | None = None,
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
    found = named(sidebands)
    heights = {name: np.abs([*s.lower[::-1], s.centre, *s.upper]) for name, s in found.items()}
    top = max(float(h.max()) for h in heights.values())
    if not top > 0.0:
        raise ValueError("plot_sidebands: there is neither a carrier nor a sideband")
    factor, unit = length_unit(top)
    along, name_of_unit = frequency_unit(max(s.carrier for s in found.values()))
    curves, orders = {}, []
    for name, h in heights.items():
        seen = np.flatnonzero(h > ROUND_OFF * top)
        orders.append(seen - len(h) // 2)
        places = found[name].carrier + orders[-1] * found[name].modulation
        curves[name] = places * along, h[seen] * factor
    axes = stems(Sheet.of(ax), curves, 2.9, 8.0)
    for at, level, n in zip(*next(iter(curves.values())), orders[0]):
        words = f"{'+' if n > 0 else '−'}{abs(n)}" if n else "carrier"
        note(axes, words, (at, level), 5, va="baseline")
    ends = [s.carrier + way * 1.1 * len(s.upper) * s.modulation for s in found.values() for way in (-1, 1)]
    axes.set(xlim=(min(ends) * along, max(ends) * along))
    axes.set(xlabel=f"frequency ({name_of_unit})", ylabel=f"amplitude ({unit})")
    return axes


@picture(Backbone, several=True)
def plot_backbone(
    backbones: Backbone | Mapping[str, Backbone],
    *,
    title: str = "",
    ax: Any = None,
    comm: MPI.Comm | None = None,
) -> Axes | None:
    """Draw frequencies of free motions over their energy, broken where they are unstable, and below them the
    damping ratios where there are damped motions; monotone cubics between their points. Collective.

    Parameters
    ----------
    backbones : Backbone or dict of str to Backbone
        On rank 0 at least.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes of the frequencies on rank 0, None elsewhere; `save_picture` writes the whole picture
    """
    curves = named(backbones)
    factor, unit = frequency_unit(max(float(b.frequency.max()) for b in curves.values()))
    damped, broken = any(backbone.damped for backbone in curves.values()), False
    panels = Sheet.of(ax).panels((1 + damped, 1), 4.6 if damped else 3.0, sharex=True)
    axes = panels[0]
    for k, (name, backbone) in enumerate(curves.items()):
        colour = CYCLE[k % len(CYCLE)]
        axes.plot([], [], color=colour, linewidth=1.2, label=name or "_")
        drawn = [backbone.frequency * factor] + [backbone.damping_ratio] * backbone.damped
        for panel, values in zip(panels, drawn):
            parts = smooth(split(np.log10(backbone.energy), values, ~backbone.unstable))
            drawn_parts = [(stable, 10.0**energy, value) for stable, energy, value in parts]
            broken |= draw_parts(panel, drawn_parts, colour, 1.2)
    name_verdicts(axes, broken)
    for panel, label in zip(panels, (f"frequency of free vibration ({unit})", "damping ratio (decay)")):
        panel.set(xscale="log", xlabel="energy (J)", ylabel=label)
        panel.tick_params(axis="x", which="minor", labelsize=7)
        panel.margins(y=0.1)
    if any(curves) or broken:
        axes.legend()
    low, high = axes.get_ylim()
    middle, half = 0.5 * (low + high), 0.5 * max(high - low, FLAT * high)
    axes.set_ylim(middle - half, middle + half)
    return axes


@picture(QuasiPeriodicBranch, several=True, harmonic=whole(1, 20))
def plot_quasi_periodic(
    branches: QuasiPeriodicBranch | Mapping[str, QuasiPeriodicBranch],
    point: Point = "A",
    direction: str = "y",
    *,
    harmonic: int = 1,
    title: str = "",
    ax: Any = None,
    comm: MPI.Comm | None = None,
) -> list[Axes] | None:
    """Draw branches of motions with a tone of their own: the tone's amplitude and, below it, its frequency
    over the branch's parameter; unstable parts dashed. Collective.

    Parameters
    ----------
    branches : QuasiPeriodicBranch or dict of str to QuasiPeriodicBranch
        All over the frequency, or all over the load; on rank 0 at least, on all ranks for a place (x, y).
    point : str or (x, y)
        Name, or m. Motions at a place are integrated again.
    direction : {"y", "x"}
    harmonic : int
        The multiple of the own tone whose amplitude is drawn.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Two axes on rank 0, None elsewhere; `save_picture` writes them
    """
    curves = named(branches)
    if len({branch.parameter for branch in curves.values()}) != 1:
        raise ValueError(
            "plot_quasi_periodic: branches of one parameter, frequency or load, are expected; draw others "
            "apart"
        )
    heights = {name: np.abs(branch.line(0, harmonic, point, direction)) for name, branch in curves.items()}
    factor, unit = length_unit(max(float(h.max()) for h in heights.values()))
    times, unit_of_tone = frequency_unit(max(float(b.frequencies[:, 1].max()) for b in curves.values()))
    along, label = 1.0, "factor on the load"
    if next(iter(curves.values())).parameter == "frequency":
        along, name = frequency_unit(max(float(b.value.max()) for b in curves.values()))
        label = f"forcing frequency ({name})"
    panels = Sheet.of(ax).panels((2, 1), 4.6, sharex=True)
    broken = False
    for k, (name, branch) in enumerate(curves.items()):
        colour, x = CYCLE[k % len(CYCLE)], branch.value * along
        panels[0].plot([], [], color=colour, linewidth=1.2, label=name or "_")
        for axes, values in zip(panels, (heights[name] * factor, branch.frequencies[:, 1] * times)):
            broken |= draw_parts(axes, smooth(split(x, values, ~branch.unstable)), colour, 1.2)
            dots(axes, (x, values), ".", 3, colour)
    name_verdicts(panels[0], broken)
    of = "" if harmonic == 1 else f"harmonic {harmonic} of the "
    panels[0].set(
        xlabel=label,
        ylabel=f"{of}own tone of ${symbol(curves, direction, point)}$({place_name(point)}) ({unit})",
    )
    panels[1].set(xlabel=label, ylabel=f"its frequency ({unit_of_tone})")
    panels[0].set_ylim(bottom=0.0)
    if any(curves) or broken:
        panels[0].legend()
    return panels
