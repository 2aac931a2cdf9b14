"""Pictures of deformed structures in colours of their stresses or displacements: the region around a crack,
with its gap in sight, and whole bodies.

Rank 0 draws; the other ranks send what they sampled.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..bodies.finite_element_model import FiniteElementModel, nodal_field
from ..ranks.parallel import collective, on_root
from ..system.model import Model
from .drawing import WIDTH
from .outlines import gather_outline, gather_region
from .picture import fields_by_name, one_of, picture, require_crack
from .views import LABELS, Solid, Whole, Window, draw_states

# Inches beside a body.
MARGIN = 1.7


@picture(Model, fields=fields_by_name)
def plot_crack(
    model: Model,
    fields: Mapping[str, Any],
    crack: int = 0,
    *,
    colour: str = "von_mises",
    magnification: float | None = None,
    ax: Any = None,
) -> list[Axes] | None:
    """Deformed region of a crack, whole and around its tip, with the gap visible. Collective.

    The displacement is drawn without the window's rigid-body motion. The opening of a slit too narrow to be
    seen is magnified like the displacement, as if it had opened from a closed one: where its faces touch,
    they touch in the picture. The faces of the tip element, dashed, have no contact pairs: where they overlap
    they are drawn so.

    Parameters
    ----------
    model : Model
    fields : dict of str to Static, Field or (m, 2) array
        One row of the picture each: ``{"100 N": push}``, ``{"5 ms": history.field(5e-3)}``. An array holds
        displacements of this rank's nodes alone, m, without what contact and loads on the faces inside tip
        elements add there.
    crack : int
        Number of the crack, from 0.
    colour : {"von_mises", "displacement"}
        What the colours show.
    magnification : float, optional
        Default: chosen for each panel and written into it.
    ax
        As for `plot_modes`.

    Returns
    -------
    Axes, two a field, on rank 0, None elsewhere; `save_picture` writes them
    """
    with collective(model.comm):
        require_crack("plot_crack", crack, len(model.cracks))
    facts = model.cracks[crack]
    tip, half = np.array(facts.tip), np.array([1.1, 0.11]) * facts.length
    regions = {name: [gather_region(model, field, tip, h) for h in half] for name, field in fields.items()}
    outline = gather_outline(model, list(fields.values()), max(2 * model.order, 8))

    def draw() -> list[Axes]:
        panels = ax.panels((len(regions), 2), 3.15 * len(regions) + 0.15)
        windows = [Window(facts, h, colour) for h in half]
        for row, (name, pair) in enumerate(regions.items()):
            for axes, window, region in zip(panels[2 * row :], windows, pair):
                draw_states(window, [axes], {name: region}, outline, magnification, row)
        return panels

    return on_root(model.comm, draw)


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
        draw_states(Solid(model, None), panels, states, None, magnification)
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
        draw_states(view, panels, regions, outline, magnification)
        return panels

    return on_root(model.comm, draw)
