"""Pictures of the whole body, deformed, in colours of its stresses or displacements.

Rank 0 draws; the other ranks send what they sampled.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from ..bodies.finite_element_model import FiniteElementModel, nodal_field
from ..ranks.parallel import on_root
from ..record.units import length_unit, place_unit, stress_unit
from ..system.model import Model
from .crack import Colours, Notch, area_quantile, plain, shown_best
from .drawing import WIDTH, Sheet
from .outlines import Region, gather_outline, gather_region
from .picture import fields_by_name, one_of, picture
from .solids import Solid

# What the colours show, and how the label calls it; stresses by their column in a `Region`.
STRESSES = {"von_mises": 3, "stress_xx": 0, "stress_yy": 1, "stress_xy": 2}
LABELS = {
    "von_mises": "von Mises stress",
    "stress_xx": r"$\sigma_{xx}$",
    "stress_yy": r"$\sigma_{yy}$",
    "stress_xy": r"$\sigma_{xy}$",
    "displacement": "displacement",
}
# Share of the area whose stresses the colours tell apart: those of crack tips have no bound.
SHARE = 0.99
# Inches beside a body.
MARGIN = 1.7
# Of the body's largest side: what the largest displacement is drawn as.
DRAWN = 0.05


@picture(Model, FiniteElementModel, fields=fields_by_name, colour=one_of(*LABELS))
def plot_field(
    model: Model | FiniteElementModel,
    fields: Mapping[str, Any],
    *,
    colour: str = "von_mises",
    magnification: float | None = None,
    ax: Any = None,
) -> list[Axes] | None:
    """The whole body, deformed, in colours of its stresses or displacements. Collective.

    All fields have one scale of colours; values on the hundredth of the area where they are largest, next to
    crack tips for one, have its last colour. Narrow slits are drawn as in `plot_crack`.

    Parameters
    ----------
    model : Model or FiniteElementModel
        A body of another code needs elements; its colours are those of the displacement.
    fields : dict of str to Static, Field or (m, 2) array
        One panel each, as for `plot_crack`; of a body as for `write_vtu`.
    colour : {"von_mises", "stress_xx", "stress_yy", "stress_xy", "displacement"}
        What the colours show.
    magnification : float, optional
        Of the displacements. Default: chosen for each panel and written into it.
    ax
        As for `plot_modes`.

    Returns
    -------
    Axes, one a field, on rank 0, None elsewhere; `save_picture` writes them
    """
    if isinstance(model, FiniteElementModel):
        return _draw_solid(model, fields, magnification, Sheet.of(ax))
    lower, upper = model.extent
    middle, size = 0.5 * (lower + upper), float((upper - lower).max())
    regions = {
        name: gather_region(model, field, middle, size, subdivisions=model.order, refine=1)
        for name, field in fields.items()
    }
    outline = gather_outline(model, list(fields.values()), max(2 * model.order, 8))
    notches = [Notch(crack, crack.length) for crack in model.cracks]

    def draw() -> list[Axes]:
        assert outline is not None  # on rank 0
        found = {name: region for name, region in regions.items() if region is not None}
        (width, height), (scale, unit) = upper - lower, place_unit(size)
        colours = _colours(list(found.values()), colour)

        def drawn(places: np.ndarray, moved: np.ndarray, factor: float) -> np.ndarray:
            opened = sum((notch.opening(places) for notch in notches), np.zeros(places.shape))
            return (places + factor * moved + (factor - 1.0) * opened) * scale

        # beside labels and the colour bar, whose own label takes more than a slender body
        tall = min((WIDTH - MARGIN) * height / width, 4.5)
        total = max(len(found) * (tall + 0.7), 1.6)
        wide = min(WIDTH, tall * width / height + MARGIN)
        panels = Sheet.of(ax).panels((len(found), 1), total, wide, sharex=True)
        for row, (axes, (name, region)) in enumerate(zip(panels, found.items())):
            furthest = float(np.linalg.norm(region.displacements, axis=1).max())
            factor = magnification or shown_best(DRAWN * size, furthest)
            lines = ((True, drawn(piece.positions, piece.displacements[row], factor)) for piece in outline)
            places = drawn(region.positions, region.displacements, factor)
            painted = colours.paint(axes, places, region.triangles, _values(region, colour), lines, 0.6)
            magnified = notches[0].magnified if notches else "displacement"
            axes.set_title(f"{f'{name}, ' if name else ''}{magnified} × {plain(factor)}")
            axes.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")
        colours.bar(painted[0], panels)
        return panels

    return on_root(model.comm, draw)


def _draw_solid(
    body: FiniteElementModel, fields: Mapping[str, Any], magnification: float | None, sheet: Sheet
) -> list[Axes]:
    """A panel for each state of a body in space."""
    if not body.elements:
        raise ValueError("plot_field: the body has no elements to draw; give elements= with its nodes")
    solid = Solid(body, None)
    states = {name: nodal_field(body, "plot_field", name, given) for name, given in fields.items()}
    colours, panels = solid.colours(list(states.values())), sheet.panels((len(states), 1), 2.4 * len(states))
    for axes, (name, state) in zip(panels, states.items()):
        factor = magnification or shown_best(2.0 * DRAWN * solid.half, solid.largest([state]))
        painted = solid.paint(axes, state, None, 0, factor=factor, colours=colours)
        solid.frame(axes)
        axes.set_title(f"{f'{name}, ' if name else ''}displacement × {plain(factor)}")
    colours.bar(painted[0], panels)
    return panels


def _values(region: Region, colour: str) -> np.ndarray:
    """What the colours show, Pa or m."""
    if colour == "displacement":
        return np.linalg.norm(region.displacements, axis=1)
    return region.stress[:, STRESSES[colour]]


def _colours(regions: list[Region], colour: str) -> Colours:
    """One scale for several states: from zero, or as far to both sides of it where there are two signs."""
    sizes = [np.abs(_values(region, colour)) for region in regions]
    share = 1.0 if colour == "displacement" else SHARE
    everywhere = [np.ones(len(size), dtype=bool) for size in sizes]
    top = max(area_quantile(*each, share) for each in zip(regions, sizes, everywhere))
    factor, unit = (length_unit if colour == "displacement" else stress_unit)(top)
    signed = colour not in ("displacement", "von_mises")
    norm = Normalize(-top * factor if signed else 0.0, (top or 1.0) * factor)
    return Colours(norm, factor, f"{LABELS[colour]} ({unit})", more=share < 1.0)
