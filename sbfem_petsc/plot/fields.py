"""Pictures of fields: mode shapes, deformed structures in colours of their stresses or displacements, whole
and around a crack with its gap in sight, contact along a crack.

Rank 0 draws; the other ranks send what they sampled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..analysis.static import Static
from ..bodies.finite_element_model import FiniteElementModel, nodal_field
from ..ranks.parallel import collective, on_root
from ..record.units import frequency_unit, place_unit
from ..system.fields.outlines import Piece, gather_outline, gather_region, loops
from ..system.model import Model
from ..system.solve.modal_result import Modal, chosen_modes
from .drawing import BLUE, MARKED, SKY, WIDTH, Scale, Sheet, crack_title, curves, fill
from .picture import fields_by_name, named, one_of, picture, require_crack
from .views import LABELS, Solid, Whole, Window, draw_states

# Inches beside a body.
MARGIN = 1.7


# ---------------------------------------------------------------------- mode shapes
@picture(Modal)
def plot_modes(
    modal: Modal, modes: Sequence[int] | None = None, *, columns: int = 2, ax: Any = None
) -> list[Axes] | None:
    """Mode shapes on the structure's outline, the frequency in each title. Collective.

    Parameters
    ----------
    modal : Modal
    modes : sequence of int, optional
        Modes to draw, 0 the lowest; default: the first twelve.
    columns : int
    ax : axes, sequence of axes, figure or subfigure of Matplotlib, optional
        What is drawn on; in fewer axes than there are panels the first of these. Default: a new figure.

    Returns
    -------
    Axes of the modes on rank 0, None elsewhere; `save_picture` writes them
    """
    model = modal.model
    if not isinstance(model, Model):
        raise TypeError("plot_modes: modal must be the modes of a Model")
    with collective(model.comm):
        count = len(modal.frequencies)
        chosen = chosen_modes("plot_modes", range(min(12, count)) if modes is None else modes, count)
    pieces: Any = gather_outline(model, [modal.nodal(m) for m in chosen])
    tones = [(mode, float(modal.frequencies[mode])) for mode in chosen]
    return on_root(model.comm, lambda: _draw_modes(ax, pieces, tones, columns))


def _draw_modes(
    sheet: Sheet, pieces: list[Piece], tones: Sequence[tuple[int, float]], columns: int
) -> list[Axes]:
    """Modes and their frequencies, Hz."""
    points = np.concatenate([p.positions for p in pieces])
    lower, upper = points.min(axis=0), points.max(axis=0)
    extent = upper - lower
    # A slender beam is drawn bent by a tenth of its length at most; steep waves of high modes by less, so
    # that the sections' rotation stays legible.
    size, slender = extent.max(), extent.max() > 8.0 * extent.min()
    amplitude = (0.08 if slender else 0.1) * size
    rows = -(-len(tones) // columns)
    margin = np.array([0.04 * size if slender else 1.15 * amplitude, 1.15 * amplitude])
    width, tall = extent + 2.0 * margin
    height = (WIDTH - 0.7) / columns * tall / width + 0.26
    panels = sheet.panels((rows, columns), rows * height + 0.35, sharex=True, sharey=True)
    order = loops(pieces)
    units, unit = place_unit(float(size))
    window = np.transpose([lower - margin, upper + margin]) * units
    frame = {"xlim": window[0], "ylim": window[1], "xlabel": f"x ({unit})", "ylabel": f"y ({unit})"}
    at_rest: dict[str, Any] = {"facecolor": "none", "edgecolor": "#999999", "linestyle": (0, (3, 2))}
    for k, (axes, (mode, frequency)) in enumerate(zip(panels, tones)):
        scale = _magnification(pieces, k, extent, amplitude)
        rest = [[pieces[i].positions for i in loop] for loop in order]
        moved = [[pieces[i].positions + scale * pieces[i].displacements[k] for i in loop] for loop in order]
        fill(axes, rest, units, linewidth=0.4, **at_rest)
        fill(axes, moved, units, facecolor=SKY, edgecolor=BLUE, linewidth=0.6)
        tone, tone_unit = frequency_unit(frequency)
        value = f"{frequency * tone:#.5g}".rstrip(".")
        axes.set_title(f"mode {mode + 1}:  {value} {tone_unit}", pad=2)
        axes.set(aspect="equal", **frame)
        axes.yaxis.set_major_locator(MaxNLocator(3))
    for axes in panels[len(tones) :]:
        axes.set_axis_off()
    return panels[: len(tones)]


def _magnification(pieces: list[Piece], field: int, extent: np.ndarray, amplitude: float) -> float:
    """Factor on a mode's displacements, with the sign in which cracks are drawn open if that shows, else the
    largest displacement upwards or to the right: that of a mode is arbitrary.
    """
    shape = np.concatenate([p.displacements[field] for p in pieces])
    largest, size = np.abs(shape).max(axis=0), extent.max()
    scale, slender = amplitude / largest.max(), size > 8.0 * extent.min()
    if slender:
        axial = largest[int(np.argmax(extent))]
        bending = largest[int(np.argmin(extent))] > axial
        scale = min(scale, 0.8 * extent.min() / axial) if bending else 0.03 * size / axial
    opening = _opening(pieces, field)
    shows = not slender and abs(opening) * scale > 0.005 * size
    return float(np.copysign(scale, opening if shows else shape.flat[np.abs(shape).argmax()]))


def _opening(pieces: list[Piece], field: int) -> float:
    """Opening of the cracks in a displacement field, m, where their tip elements end; 0 without such
    elements.
    """
    total = 0.0
    for piece in pieces:
        if piece.key[0] < 0:  # from the right face over the tip to the left one
            outwards = piece.positions[[0, -1]].sum(axis=0) - 2.0 * piece.positions[len(piece.positions) // 2]
            across = np.array([outwards[1], -outwards[0]]) / np.linalg.norm(outwards)
            total += float(across @ (piece.displacements[field][0] - piece.displacements[field][-1]))
    return total


# ---------------------------------------------------------------------- deformed, in colours
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
    outline = gather_outline(model, fields.values())

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
    outline = gather_outline(model, fields.values())

    def draw() -> list[Axes]:
        width, height = view.extent
        # beside labels and the colour bar, whose own label takes more than a slender body
        tall = min((WIDTH - MARGIN) * height / width, 4.5)
        wide, total = min(WIDTH, tall * width / height + MARGIN), max(len(regions) * (tall + 0.8), 1.6)
        panels = ax.panels((len(regions), 1), total, wide, sharex=True)
        draw_states(view, panels, regions, outline, magnification)
        return panels

    return on_root(model.comm, draw)


# ---------------------------------------------------------------------- contact along the crack
@picture(Static, several=True)
def plot_contact(
    cases: Static | Mapping[str, Static], crack: int = 0, *, ax: Any = None
) -> list[Axes] | None:
    """Contact pressure and gap along a crack for several static cases. Collective.

    The pressure of a pair is its force divided by its share of the face. The pair on the tip element's
    boundary has no such share: it stands in for the whole face of the tip element, which has no pairs; its
    force counts in the resultant but is not drawn.

    Parameters
    ----------
    cases : Static or dict of str to Static
        By the name of the load, of one model; none that was read from a file.
    crack : int
        Number of the crack, from 0.
    ax
        As for `plot_modes`.

    Returns
    -------
    [pressure, gap] on rank 0, None elsewhere; `save_picture` writes them
    """
    of_loads = {name or "load": case for name, case in named(cases).items()}
    for name, case in of_loads.items():
        if case.model is None:
            raise ValueError(
                f"plot_contact: the static solution {name!r} was read from a file, which keeps no model "
                "and so no areas of the faces; solve it again"
            )
    model = next(iter(of_loads.values())).model
    with collective(model.comm):
        require_crack("plot_contact", crack, len(model.cracks))
    return on_root(model.comm, lambda: _draw_contact(ax, model, of_loads, crack))


def _draw_contact(sheet: Sheet, model: Model, cases: Mapping[str, Static], crack: int) -> list[Axes]:
    pairs, length = model.pairs, model.cracks[crack].length
    rows = np.flatnonzero(pairs.crack == crack)
    drawn = pairs.weight[rows] * model.thickness
    if model.cracks[crack].tip_element >= 0 and len(rows):
        drawn[np.argmin(pairs.position[rows])] = np.nan
    distance = pairs.position[rows] * length
    pressures, gaps = {}, {}
    for name, case in cases.items():
        force = case.contact_force[rows].sum()
        # of several cracks it is not known apart
        inside = case.contact_resultant - force if len(model.cracks) == 1 else 0.0
        beside = f", the tip element's faces {inside:,.0f} N" if inside >= 0.5 else ""
        carried = f"{name}  ({case.active[rows].sum()} of {len(rows)} pairs carry {force:,.0f} N{beside})"
        pressures[carried] = distance, case.contact_force[rows] / drawn
        gaps[name] = distance, case.gap[rows]
    along = Scale.of("distance from the tip along the crack", "m", length)
    pressure = Scale.of("contact pressure", "Pa", *(values for _, values in pressures.values()))
    gap = Scale.of("gap", "m", pairs.gap[rows], *(values for _, values in gaps.values()))
    panels = sheet.panels((2, 1), 4.6, sharex=True)
    panels[0].set_title(f"{crack_title(model.cracks[crack])}: nodal contact force per area of the face")
    initial: Any = {"color": "#777777", "linestyle": (0, (4, 2)), "linewidth": 0.9, "label": "initial"}
    panels[1].plot(along(distance), gap(pairs.gap[rows]), **initial)
    for axes, shown, up in zip(panels, (pressures, gaps), (pressure, gap)):
        curves(axes, shown, along, up, MARKED, markersize=3, linewidth=1.0)
        axes.set_xlim(0.0, along(length) * 1.02)
        axes.grid()
        axes.legend()
    panels[0].set_ylim(bottom=0.0)
    return panels
