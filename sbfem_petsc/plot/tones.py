"""Pictures of motions under two tones, and of free motions over their energy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from ..analysis.backbone import Backbone
from ..continuation.problems.tones import QuasiPeriodic
from ..indicators.lines import Sidebands
from ..parallel import agreed, on_root
from ..petsc import MPI
from .arguments import check
from .branches import DASHED
from .drawing import BLACK, CYCLE, by_name, figure, finish_stems, stems, style
from .units import frequency_unit, length_unit

# Orders up to which a line is named in the picture.
NAMED = 2
# Lines this far below the highest are the rounding of the linear response.
ROUND_OFF = 1e-12
# Frequencies that differ by less, relative, are drawn as one.
FLAT = 1e-5


@agreed("motions")
def plot_lines(
    motions: QuasiPeriodic | Mapping[str, QuasiPeriodic],
    point: str = "A",
    direction: str = "y",
    *,
    order: int = 3,
    decades: float = 6.0,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> Axes | None:
    """Draw the lines m f1 + n f2 of motions under two tones as stems over their frequencies. Collective.

    Parameters
    ----------
    motions : QuasiPeriodic or dict of str to QuasiPeriodic
        On rank 0 at least.
    point : str
    direction : {"y", "x"}
    order : int
        Lines up to this \\|m\\| and \\|n\\|.
    decades : float
        Below the largest line; what is smaller is left out.
    title, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    check(
        "plot_lines", point=point, direction=direction, order=order, decades=decades, title=title, comm=comm
    )
    named = by_name("plot_lines", motions, QuasiPeriodic)
    return on_root(
        comm or MPI.COMM_WORLD, lambda: _draw_lines(named, point, direction, order, decades, title)
    )


def _draw_lines(
    motions: Mapping[str, QuasiPeriodic], point: str, direction: str, order: int, decades: float, title: str
) -> Axes:
    if not motions:
        raise ValueError("plot_lines: no motion is given")
    numbers = [(m, n) for m in range(-order, order + 1) for n in range(-order, order + 1) if m or n]
    found = {}
    for name, motion in motions.items():
        first, second = motion.frequencies
        at = {(m, n): m * first + n * second for m, n in numbers if m * first + n * second > 0.0}
        found[name] = [(f, abs(motion.line(*line, point, direction)), line) for line, f in at.items()]
    top = max(height for lines in found.values() for _, height, _ in lines)
    if not top > 0.0:
        raise ValueError(f"plot_lines: point {point!r} does not move in {direction}")
    factor, unit = length_unit(top)
    least = max(ROUND_OFF, 10.0**-decades) * top
    along, name_of_unit = frequency_unit(max(f for lines in found.values() for f, _, _ in lines))
    floor = factor * 10.0 ** np.floor(
        np.log10(0.7 * min(h for lines in found.values() for _, h, _ in lines if h > least))
    )
    drawing = figure(3.2)
    axes = drawing.subplots()
    for k, (name, lines) in enumerate(found.items()):
        x, y = np.array([(f, height) for f, height, _ in lines if height > least]).T
        stems(axes, x * along, y * factor, floor=floor, curve=(k, name), size=3.5)
    highest: dict[tuple[int, int], tuple[float, float]] = {}
    for lines in found.values():
        for f, height, line in lines:
            if height > least and max(map(abs, line)) <= NAMED and height > highest.get(line, (0.0, 0.0))[1]:
                highest[line] = (f, height)
    for line, (f, height) in highest.items():
        axes.annotate(
            _line_name(*line),
            (f * along, height * factor),
            xytext=(0, 4),
            textcoords="offset points",
            rotation=90,
            fontsize=6,
            ha="center",
            va="bottom",
        )
    axes.set(yscale="log", ylim=(floor, 40.0 * top * factor), xlabel=f"frequency ({name_of_unit})")
    axes.set_xlim(left=0.0)
    axes.set_ylabel(f"$|u_{direction}|$({point}) ({unit})")
    finish_stems(axes, found, title)
    return axes


def _line_name(m: int, n: int) -> str:
    """A line's numbers as a sum of tones: f1, 2 f2, f1 - f2."""

    def times(count: int, tone: str) -> str:
        return tone if abs(count) == 1 else f"{abs(count)} {tone}"

    # what is added stands before what is taken away
    parts = sorted(
        ((count, tone) for count, tone in ((m, "$f_1$"), (n, "$f_2$")) if count),
        key=lambda part: part[0] < 0,
    )
    text = ("−" if parts[0][0] < 0 else "") + times(*parts[0])
    for count, tone in parts[1:]:
        text += f" {'−' if count < 0 else '+'} {times(count, tone)}"
    return text


@agreed("sidebands")
def plot_sidebands(
    sidebands: Sidebands | Mapping[str, Sidebands],
    *,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> Axes | None:
    """Draw a carrier and its sidebands as stems over their frequencies. Collective.

    Parameters
    ----------
    sidebands : Sidebands or dict of str to Sidebands
        On rank 0 at least.
    title, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them
    """
    check("plot_sidebands", title=title, comm=comm)
    named = by_name("plot_sidebands", sidebands, Sidebands)
    return on_root(comm or MPI.COMM_WORLD, lambda: _draw_sidebands(named, title))


def _draw_sidebands(sidebands: Mapping[str, Sidebands], title: str) -> Axes:
    if not sidebands:
        raise ValueError("plot_sidebands: no sidebands are given")
    heights = {name: np.abs([*s.lower[::-1], s.centre, *s.upper]) for name, s in sidebands.items()}
    top = max(float(h.max()) for h in heights.values())
    if not top > 0.0:
        raise ValueError("plot_sidebands: there is neither a carrier nor a sideband")
    factor, unit = length_unit(top)
    along, name_of_unit = frequency_unit(max(s.carrier for s in sidebands.values()))
    least = min(float(h[h > ROUND_OFF * top].min()) for h in heights.values())
    floor = factor * 10.0 ** np.floor(np.log10(0.7 * least))
    drawing = figure(2.9)
    axes = drawing.subplots()
    for k, (name, found) in enumerate(sidebands.items()):
        height = heights[name] * factor
        order = np.arange(len(height)) - len(height) // 2
        x = (found.carrier + order * found.modulation) * along
        stems(axes, x, height, floor=floor, curve=(k, name))
        if k:
            continue
        for at, level, n in zip(x, height, order):
            words = "carrier" if n == 0 else f"{'+' if n > 0 else '−'}{abs(n)}"
            axes.annotate(
                words, (at, level), xytext=(0, 5), textcoords="offset points", fontsize=7, ha="center"
            )
    axes.set(yscale="log", ylim=(floor, 8.0 * top * factor), xlabel=f"frequency ({name_of_unit})")
    axes.set_ylabel(f"amplitude ({unit})")
    finish_stems(axes, sidebands, title)
    return axes


@agreed("backbones")
def plot_backbone(
    backbones: Backbone | Mapping[str, Backbone],
    *,
    title: str = "",
    comm: MPI.Comm | None = None,
) -> Axes | None:
    """Draw frequencies of free motions over their energy, broken where they are unstable, and below them the
    damping ratios where there are damped motions. Collective.

    Parameters
    ----------
    backbones : Backbone or dict of str to Backbone
        On rank 0 at least.
    title, comm
        As for `plot_branches`.

    Returns
    -------
    Axes of the frequencies on rank 0, None elsewhere; `save_picture` writes the whole picture
    """
    check("plot_backbone", title=title, comm=comm)
    named = by_name("plot_backbone", backbones, Backbone)
    return on_root(comm or MPI.COMM_WORLD, lambda: _draw_backbones(named, title))


def _draw_backbones(backbones: Mapping[str, Backbone], title: str) -> Axes:
    if not backbones:
        raise ValueError("plot_backbone: no backbone is given")
    factor, unit = frequency_unit(max(float(b.frequency.max()) for b in backbones.values()))
    damped = any(backbone.damped for backbone in backbones.values())
    drawing = figure(4.6 if damped else 3.0)
    panels = drawing.subplots(1 + damped, sharex=True, squeeze=False)[:, 0]
    axes, broken = panels[0], False
    for k, (name, backbone) in enumerate(backbones.items()):
        colour = CYCLE[k % len(CYCLE)]
        verdict = (
            np.asarray(backbone.stable) if len(backbone.multipliers) else np.ones(len(backbone.energy), bool)
        )
        axes.plot([], [], color=colour, linewidth=1.2, label=name or "_")
        steady = verdict[:-1] & verdict[1:]
        broken = broken or not steady.all()
        _draw_pieces(axes, (backbone.energy, backbone.frequency * factor), steady, colour)
        if backbone.damped:
            _draw_pieces(panels[1], (backbone.energy, backbone.damping_ratio), steady, colour)
    if broken:
        axes.plot([], [], color=BLACK, linewidth=1.2, linestyle=DASHED, label="unstable")
    axes.set(ylabel=f"frequency of free vibration ({unit})")
    if damped:
        panels[1].set(ylabel="damping ratio (decay)")
    panels[-1].set(xscale="log", xlabel="energy (J)")
    panels[-1].tick_params(axis="x", which="minor", labelsize=7)
    axes.set_title(title, fontsize=8, loc="left")
    if any(backbones) or broken:
        axes.legend(fontsize=7, frameon=False)
    for panel in panels:
        panel.margins(y=0.1)
        style(panel)
    low, high = axes.get_ylim()
    middle, half = 0.5 * (low + high), 0.5 * max(high - low, FLAT * high)
    axes.set_ylim(middle - half, middle + half)
    return axes


def _draw_pieces(axes: Axes, places: tuple[np.ndarray, np.ndarray], steady: np.ndarray, colour: str) -> None:
    """A line from point to point, broken where motions are unstable."""
    across, up = places
    for i, holds in enumerate(steady):
        axes.plot(
            across[i : i + 2],
            up[i : i + 2],
            color=colour,
            linewidth=1.2,
            linestyle="-" if holds else DASHED,
        )
