"""Figures on the Agg canvas: palette, style, saving as files.

Through matplotlib's object-oriented interface alone: no display, no global state.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from ..checks import path as checked_path
from ..checks import shown
from ..writing import destination, replaced

# Okabe and Ito's palette: told apart by colour-blind readers.
BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE, BLACK = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#E69F00",
    "#56B4E9",
    "#CC79A7",
    "#000000",
)
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
MATERIAL = "#E8EDF2"
WIDTH = 7.2  # inches: two columns of a journal
RESOLUTION = 200  # dots per inch
FORMATS = ("png", "svg", "pdf")

Subject = TypeVar("Subject")


def figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure on the Agg canvas; inches."""
    result = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(result)
    return result


def save_picture(drawing: Axes | Figure | Sequence[Axes] | None, path: str) -> str | None:
    """Write a picture, whole or not at all: PNG, SVG or PDF by the name's ending.

    Parameters
    ----------
    drawing : axes, several of one figure, or the figure; None on ranks that drew nothing
    path : str

    Returns
    -------
    str, None on ranks that drew nothing

    Raises
    ------
    TypeError, ValueError
        If it is no drawing, or cannot be written.
    """
    checked_path("save_picture", "path", path)
    if drawing is None:
        return None
    several: Any = drawing
    first = drawing if isinstance(drawing, (Axes, Figure)) else next(iter(np.ravel(several)), None)
    picture = first.figure if isinstance(first, Axes) else first
    if not isinstance(picture, Figure):
        raise TypeError(f"save_picture: {drawing!r} is neither axes nor a figure")
    place = destination(path, "picture")
    form = os.path.splitext(place)[1].lower()[1:]
    if form not in FORMATS:
        raise ValueError(f"picture {path!r} must end in one of {', '.join('.' + f for f in FORMATS)}")
    with replaced(path, "picture") as temporary:
        picture.savefig(temporary, format=form, dpi=RESOLUTION)
    return os.fspath(path)


def save_pictures(folder: str, **drawings: Axes | Figure | Sequence[Axes] | None) -> None:
    """Write several pictures into a folder, each as a PNG file of its name.

    Parameters
    ----------
    folder : str
    **drawings
        See `save_picture`.

    Raises
    ------
    TypeError, ValueError
        If one is no drawing, or cannot be written.
    """
    checked_path("save_pictures", "folder", folder)
    for name, drawing in drawings.items():
        save_picture(drawing, os.path.join(folder, f"{name}.png"))


def style(axes) -> None:
    """Small, plain axes."""
    axes.tick_params(labelsize=7, width=0.6, length=2.5)
    for side in axes.spines.values():
        side.set_linewidth(0.6)
    for axis in (axes.xaxis, axes.yaxis):
        axis.get_offset_text().set_size(7)
        axis.label.set_size(8)
        formatter = axis.get_major_formatter()
        if isinstance(formatter, ScalarFormatter):
            formatter.set_useOffset(False)  # values are read off as they are


def by_name(
    owner: str, subjects: Subject | Mapping[str, Subject], kind: type[Subject]
) -> Mapping[str, Subject]:
    """What is to be drawn by its names in the legend; one alone has none."""
    if isinstance(subjects, kind):
        return {"": subjects}
    wanted = f"give one {kind.__name__}, or a dict of them by name"
    if not isinstance(subjects, Mapping):
        raise TypeError(f"{owner}: {shown(subjects)} cannot be drawn; {wanted}")
    for name, item in subjects.items():
        if not isinstance(name, str) or not isinstance(item, kind):
            raise TypeError(f"{owner}: {shown(name)}: {shown(item)} cannot be drawn; {wanted}")
    return subjects


def stems(axes: Axes, x, heights, *, floor: float, curve: tuple[int, str], size: float = 4.0) -> None:
    """Stems from a floor, which logarithmic scales need, with the colour, marker and name of a curve, told by
    number and name.
    """
    number, name = curve
    colour, marker = CYCLE[number % len(CYCLE)], MARKERS[number % len(MARKERS)]
    axes.vlines(x, floor, heights, color=colour, linewidth=0.35 * size)
    axes.plot(x, heights, linestyle="none", marker=marker, markersize=size, color=colour, label=name or "_")


def finish_stems(axes: Axes, names: Mapping[str, object], title: str) -> None:
    """Ticks and grid of stems on a logarithmic scale, title, and a legend where there are names."""
    axes.yaxis.set_major_locator(LogLocator(numticks=12))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y", color="#E2E2E2", linewidth=0.4)
    axes.set_axisbelow(True)
    axes.set_title(title, fontsize=8, loc="left")
    if any(names):
        axes.legend(fontsize=7, frameon=False, loc="upper right")
    style(axes)


def crack_title(crack) -> str:
    """A crack's name, recognisable as one: a user's model may call it anything."""
    return crack.name if crack.name.startswith("crack") else f"crack {crack.name}"


def fill(axes: Axes, rings, scale: float, **style) -> None:
    """Closed loops (m), holes running the other way round, as one filled shape in a style of
    Matplotlib's; drawn in units of 1 / scale.
    """
    vertices, codes = [], []
    for ring in rings:
        points = np.concatenate(ring) * scale
        vertices.append(np.vstack([points, points[:1]]))
        codes += [Path.MOVETO] + [Path.LINETO] * (len(points) - 1) + [Path.CLOSEPOLY]
    axes.add_patch(PathPatch(Path(np.concatenate(vertices), codes), **style))
