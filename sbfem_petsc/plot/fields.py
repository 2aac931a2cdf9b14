"""Pictures of mode shapes and contact forces.

Rank 0 draws; the other ranks send sampled outlines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..analysis.static import Static
from ..ranks.parallel import collective, on_root
from ..record.units import frequency_unit, place_unit
from ..system.model import Model
from ..system.solve.modal_result import Modal, chosen_modes
from .drawing import BLUE, MARKED, SKY, WIDTH, Scale, Sheet, crack_title, curves, fill
from .outlines import Piece, gather_outline, loops
from .picture import named, picture, require_crack


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
    pieces = gather_outline(model, [modal.nodal(m) for m in chosen], max(2 * model.order, 8))
    return on_root(model.comm, lambda: _draw_modes(ax, pieces, modal.frequencies, chosen, columns))


def _draw_modes(
    sheet: Sheet, pieces: list[Piece] | None, frequencies: np.ndarray, modes: list[int], columns: int
) -> list[Axes]:
    assert pieces is not None  # on rank 0
    points = np.concatenate([p.positions for p in pieces])
    lower, upper = points.min(axis=0), points.max(axis=0)
    extent = upper - lower
    # A slender beam is drawn bent by a tenth of its length at most; steep waves of high modes by less, so
    # that the sections' rotation stays legible.
    size, slender = extent.max(), extent.max() > 8.0 * extent.min()
    amplitude = (0.08 if slender else 0.1) * size
    rows = -(-len(modes) // columns)
    aside, margin = 0.04 * size if slender else 1.15 * amplitude, 1.15 * amplitude
    width, tall = extent[0] + 2.0 * aside, extent[1] + 2.0 * margin
    height = (WIDTH - 0.7) / columns * tall / width + 0.26
    panels = sheet.panels((rows, columns), rows * height + 0.35, sharex=True, sharey=True)
    order = loops(pieces)
    units, unit = place_unit(float(size))
    at_rest: dict[str, Any] = {"facecolor": "none", "edgecolor": "#999999", "linestyle": (0, (3, 2))}
    for axes, (k, mode) in zip(panels, enumerate(modes)):
        scale = _magnification(pieces, k, extent, amplitude)
        rest = [[pieces[i].positions for i in loop] for loop in order]
        moved = [[pieces[i].positions + scale * pieces[i].displacements[k] for i in loop] for loop in order]
        fill(axes, rest, units, linewidth=0.4, **at_rest)
        fill(axes, moved, units, facecolor=SKY, edgecolor=BLUE, linewidth=0.6)
        tone, tone_unit = frequency_unit(float(frequencies[mode]))
        value = f"{frequencies[mode] * tone:#.5g}".rstrip(".")
        axes.set_title(f"mode {mode + 1}:  {value} {tone_unit}", pad=2)
        axes.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")
        axes.set_xlim((lower[0] - aside) * units, (upper[0] + aside) * units)
        axes.set_ylim((lower[1] - margin) * units, (upper[1] + margin) * units)
        axes.yaxis.set_major_locator(MaxNLocator(3))
    for axes in panels[len(modes) :]:
        axes.set_axis_off()
    return panels[: len(modes)]


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
