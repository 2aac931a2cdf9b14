"""Pictures of the whole body, deformed, in colours of its stresses or displacements.

Rank 0 draws; the other ranks send what they sampled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..bodies.finite_element_model import FiniteElementModel, nodal_field
from ..ranks.parallel import on_root
from ..record.units import place_unit
from ..system.model import Model
from .crack import LABELS, Notch, Window
from .drawing import WIDTH
from .outlines import Region, gather_outline, gather_region
from .picture import fields_by_name, one_of, picture
from .solids import Solid

# Inches beside a body.
MARGIN = 1.7


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
        if not model.elements:
            raise ValueError("plot_field: the body has no elements to draw; give elements= with its nodes")
        states = {name: nodal_field(model, "plot_field", name, given) for name, given in fields.items()}
        panels = ax.panels((len(states), 1), 2.4 * len(states))
        Solid(model, None).draw(panels, states, None, magnification)
        return panels
    view = Whole(model, colour)
    regions = {
        name: gather_region(model, field, view.tip, 2.0 * view.half, subdivisions=model.order, refine=1)
        for name, field in fields.items()
    }
    outline = gather_outline(model, list(fields.values()), max(2 * model.order, 8))

    def draw() -> list[Axes]:
        width, height = view.extent
        # beside labels and the colour bar, whose own label takes more than a slender body
        tall = min((WIDTH - MARGIN) * height / width, 4.5)
        wide, total = min(WIDTH, tall * width / height + MARGIN), max(len(regions) * (tall + 0.7), 1.6)
        panels = ax.panels((len(regions), 1), total, wide, sharex=True)
        view.draw(panels, regions, outline, magnification)
        return panels

    return on_root(model.comm, draw)


class Whole(Window):
    """A whole body."""

    reach, share, moved = 0.1, 0.99, "displacement"

    def __init__(self, model: Model, colour: str):
        lower, upper = model.extent
        self.extent, self.tip, self.colour = upper - lower, 0.5 * (lower + upper), colour
        self.half = 0.5 * float(self.extent.max())
        self.notches = [Notch(crack, crack.length) for crack in model.cracks]
        self.magnified = self.notches[0].magnified if self.notches else "displacement"

    @property
    def origin(self) -> np.ndarray:
        return np.zeros(2)

    def largest(self, states: Sequence[Region]) -> float:
        """Openings apart."""
        return max(float(np.linalg.norm(region.displacements, axis=1).max()) for region in states)

    def frame(self, axes: Axes) -> None:
        """In coordinates."""
        _, unit = place_unit(2.0 * self.half)
        axes.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")

    def _relative(self, region: Region) -> tuple[np.ndarray, Any, np.ndarray]:
        """All of it."""
        return np.ones(len(region.positions), dtype=bool), np.zeros_like, region.displacements
