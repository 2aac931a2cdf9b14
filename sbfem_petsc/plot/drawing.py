"""Figures on the Agg canvas: palette, style, saving.

Through matplotlib's object-oriented interface alone: no display, no global state.
"""

from __future__ import annotations

import os

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

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
MILLI = 1e3


def figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure on the Agg canvas; inches."""
    result = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(result)
    return result


def save(drawing: Figure, path: str) -> str:
    """Write a PNG, whole or not at all.

    Raises
    ------
    ValueError
        If it cannot be written.
    """
    temporary = f"{path}.part"
    try:
        drawing.savefig(temporary, format="png", dpi=RESOLUTION)
        os.replace(temporary, path)
    except OSError as error:
        raise ValueError(f"picture {path!r} cannot be written: {error.strerror or error}") from None
    return path


def style(axes) -> None:
    """Small, plain axes."""
    axes.tick_params(labelsize=7, width=0.6, length=2.5)
    for side in axes.spines.values():
        side.set_linewidth(0.6)
    axes.xaxis.get_offset_text().set_size(7)
    axes.yaxis.get_offset_text().set_size(7)
    axes.xaxis.label.set_size(8)
    axes.yaxis.label.set_size(8)


def crack_title(crack) -> str:
    """A crack's name, recognisable as one: a user's model may call it anything."""
    return crack.name if crack.name.startswith("crack") else f"crack {crack.name}"


def fill(axes, rings, colour, edge, width, line="-") -> None:
    """Closed loops, holes running the other way round, as one filled shape; metres in, millimetres drawn."""
    vertices, codes = [], []
    for ring in rings:
        points = np.concatenate(ring) * MILLI
        vertices.append(np.vstack([points, points[:1]]))
        codes += [Path.MOVETO] + [Path.LINETO] * (len(points) - 1) + [Path.CLOSEPOLY]
    axes.add_patch(
        PathPatch(
            Path(np.concatenate(vertices), codes),
            facecolor=colour,
            edgecolor=edge,
            linewidth=width,
            linestyle=line,
        )
    )
