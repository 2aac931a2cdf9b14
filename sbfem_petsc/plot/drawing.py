"""Figures on the Agg canvas: palette, style, sheets to draw on, saving as files.

Matplotlib's settings hold while a picture is drawn; there is no display.
"""

from __future__ import annotations

import functools
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from cycler import Cycler, cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import ScalarFormatter

from meshing.whole_file import destination, replaced

from ..checks import path as checked_path
from ..checks import shown
from ..record.units import suited

# Okabe and Ito's palette: told apart by colour-blind readers.
CYCLE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK = CYCLE
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
MATERIAL, GRID, GREY = "#E8EDF2", "#DDDDDD", "#8A8A8A"
DASHED: Any = (0, (3.0, 1.6))
# What tells curves apart: a call gives one after the other without end. Of those that lie over each other
# the first alone is whole.
COLOURED = cycler(color=CYCLE)
MARKED = COLOURED + cycler(marker=MARKERS)
BROKEN = COLOURED + cycler(linestyle=["-", *3 * [DASHED, (0, (1, 1))]])
WIDTH = 7.2  # inches: two columns of a journal
RESOLUTION, INLINE = 200, 100  # dots per inch, of files and in notebooks
FORMATS = ("png", "svg", "pdf")
# Matplotlib's settings while a picture is drawn: small type; values are read off as they are.
STYLE: Any = {
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "figure.titlesize": 8,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "grid.color": GRID,
    "grid.linewidth": 0.4,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
}
# Rows and columns of panels, or their names as in Matplotlib's `subplot_mosaic`.
Layout = tuple[int, int] | Sequence[Sequence[str]]


class Sheet:
    """What a picture is drawn on: a figure of its own, a given figure, or given axes.

    Parameters
    ----------
    owner : str
        The picture, for messages.
    target : Axes, sequence of Axes, Figure, SubFigure or None
        In fewer axes than there are panels the first of these are drawn.
    """

    def __init__(self, owner: str, target: Any):
        self.owner, self.shared, self.columns, self.alone = owner, False, 1, target is None
        self.own: list[Axes] = []
        self.figure: Any = target if isinstance(target, FigureBase) else None
        self.given: list[Axes] = []
        if target is None or self.figure is not None:
            return
        self.given = each(target)
        if not self.given or not all(isinstance(axes, Axes) for axes in self.given):
            raise TypeError(f"{owner}: ax = {shown(target)} must be axes of Matplotlib, several, or a figure")

    def panels(self, layout: Layout, height: float, width: float = WIDTH, **options) -> list[Axes]:
        """Axes to draw in.

        Parameters
        ----------
        layout : (rows, columns), or names of the panels
        height, width : float
            Of a figure of its own, inches.
        **options
            Of `subplot_mosaic`.
        """
        names: Any = layout
        if isinstance(layout, tuple):
            names = np.arange(np.prod(layout)).reshape(layout).tolist()
        drawing: Any = self.figure or figure(height, width)
        made = list(drawing.subplot_mosaic(names, **options).values())
        if len(self.given) > len(made):
            raise ValueError(
                f"{self.owner}: ax has {len(self.given)} axes, and the picture {len(made)}; give {len(made)}"
            )
        self.shared, self.columns = "sharex" in options, len(names[0])
        if not self.given:
            self.figure, self.own = drawing, made
        return [*self.given, *made[len(self.given) :]]

    def finished(self, drawn: Any, title: str) -> Any:
        """The axes to give back, with the style and the title; those that were given keep their own style."""
        for axes in self.own:
            style(axes)
            if self.shared:
                axes.label_outer()
        if title:
            if self.figure is not None and self.columns > 1:
                self.figure.suptitle(title, x=0.01, horizontalalignment="left")
            else:
                (self.own or self.given)[0].set_title(title, loc="left")
        if isinstance(drawn, list):
            return Panels(drawn) if self.alone else drawn[: len(self.given) or None]
        if self.alone and drawn is not None:  # a figure that no display of Matplotlib knows of
            drawn._repr_png_ = functools.partial(png, drawn)
        return drawn


def each(drawn: Any) -> list[Any]:
    """One or several, in arrays too, as a list."""
    return list(np.ravel(np.array(drawn, dtype=object)))


class Panels(list[Axes]):
    """Axes of one figure, which a notebook shows."""

    def _repr_png_(self) -> bytes:
        return png(self[0])


def png(axes: Axes) -> bytes:
    """The figure of some axes as PNG."""
    buffer, picture = io.BytesIO(), axes.get_figure()
    assert isinstance(picture, Figure)
    picture.savefig(buffer, format="png", dpi=INLINE)
    return buffer.getvalue()


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
    first = next(iter(each(drawing)), None)
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


def legend(axes: Axes | Sequence[Axes], on: Any = None, **options) -> None:
    """A legend of what has names in one or several axes, each once, in the first of them or on a figure; none
    where there are no names.
    """
    several = each(axes)
    named = {name: item for one in several for item, name in zip(*one.get_legend_handles_labels())}
    if named:
        (on or several[0]).legend(named.values(), named.keys(), **options)


def above(axes: Axes, **options) -> None:
    """A legend in one line above the axes, where curves leave no corner free."""
    place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0}
    legend(axes, ncols=10, columnspacing=1.0, **place | options)


@dataclass(frozen=True)
class Scale:
    """Of an axis: the unit that suits the largest of its values. A call gives values as they are drawn.

    Attributes
    ----------
    factor : float
    label : str
        With the unit.
    unit : str
    """

    factor: float
    label: str
    unit: str = ""

    @classmethod
    def of(cls, words: str, unit: str, *values: Any, per: str = "") -> Scale:
        """For some values in a unit of `suited`; `per` stands behind the unit."""
        factor, name = suited(unit, np.hstack([0.0, *map(np.ravel, values)]))
        return cls(factor, f"{words} ({name}{per})" if name else words, name)

    def __call__(self, values: Any) -> Any:
        return np.asarray(values) * self.factor


def curves(
    axes: Axes, drawn: Mapping[str, Any], across: Scale, up: Scale, styles: Cycler = COLOURED, **style
) -> None:
    """Draw pairs of values, places and what is over them, as curves by their names, and label the axes."""
    for own, (name, (x, y)) in zip(styles(), drawn.items()):
        axes.plot(across(x), up(y), label=name, **{"linewidth": 1.1} | own | style)
    axes.set(xlabel=across.label, ylabel=up.label)


def bar(painted: Any, panels: Axes | Sequence[Axes], label: str, **options) -> Any:
    """A colour bar beside one or several panels."""
    beside = [axes for axes in each(panels) if axes.figure is painted.axes.figure]
    drawn = painted.axes.figure.colorbar(painted, ax=beside, **options)
    drawn.set_label(label, size=7)
    drawn.ax.tick_params(labelsize=6, which="both")
    return drawn


def dots(axes: Axes, at: Any, marker: str | tuple, size: float, colour: str, **style: Any) -> None:
    """Marks at (2, n) places, without a line between them."""
    axes.plot(*at, linestyle="none", marker=marker, markersize=size, color=colour, **style)


def note(axes: Axes, words: str, at: Any, lift: float = 2.0, **style: Any) -> None:
    """Words some points above a place, or beside it as a style of Matplotlib's says."""
    usual: Any = {"xytext": (0, lift), "fontsize": 7, "ha": "center", "va": "bottom"}
    axes.annotate(words, at, textcoords="offset points", annotation_clip=False, **usual | style)


def crack_title(crack) -> str:
    """A crack's name, recognisable as one: a user's model may call it anything."""
    return crack.name if crack.name.startswith("crack") else f"crack {crack.name}"


def fill(axes: Axes, rings, scale: float, **style) -> None:
    """Closed loops (m), holes running the other way round, as one filled shape in a style of
    Matplotlib's; drawn in units of 1 / scale.
    """
    loops = [Path(np.concatenate([*ring, ring[0][:1]]) * scale, closed=True) for ring in rings]
    axes.add_patch(PathPatch(Path.make_compound_path(*loops), **style))
