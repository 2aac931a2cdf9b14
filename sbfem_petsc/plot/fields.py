"""Pictures of mode shapes and contact forces.

Rank 0 draws; the other ranks send sampled outlines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..analysis.static import Static
from ..checks import instance, integer, shown
from ..parallel import agreed, collective, on_root
from ..system.modal_result import Modal
from ..system.model import Model
from .arguments import check
from .drawing import BLUE, CYCLE, MARKERS, SKY, WIDTH, by_name, crack_title, figure, fill, style
from .outlines import Piece, contact_lengths, gather_outline, loops
from .units import frequency_unit, length_unit, place_unit, stress_unit


# ---------------------------------------------------------------------- mode shapes
@agreed()
def plot_modes(modal: Modal, modes: Sequence[int] | None = None, *, columns: int = 2) -> list[Axes] | None:
    """Mode shapes on the structure's outline, the frequency in each title. Collective.

    Parameters
    ----------
    modal : Modal
    modes : sequence of int, optional
        Modes to draw, 0 the lowest; default: the first twelve.
    columns : int

    Returns
    -------
    Axes of the modes on rank 0, None elsewhere; `save_picture` writes them
    """
    instance("plot_modes", "modal", modal, Modal, "a Modal")
    model = modal.model
    if not isinstance(model, Model):
        raise TypeError("plot_modes: modal must be the modes of a Model")
    with collective(model.comm):
        check("plot_modes", columns=columns)
        chosen = _chosen(modes, len(modal.frequencies))
    pieces = gather_outline(model, [modal.nodal(m) for m in chosen], max(2 * model.order, 8))
    return on_root(model.comm, lambda: _draw_modes(pieces, modal.frequencies, chosen, columns))


def _chosen(modes: Sequence[int] | None, count: int) -> list[int]:
    """Numbers of the modes to draw."""
    if modes is None:
        return list(range(min(12, count)))
    if not isinstance(modes, (list, tuple, range, np.ndarray)) or not len(modes):
        raise TypeError(f"plot_modes: modes = {shown(modes)} must be a sequence of numbers")
    return [integer("plot_modes", f"modes[{k}]", m, least=0, most=count - 1) for k, m in enumerate(modes)]


def _draw_modes(
    pieces: list[Piece] | None, frequencies: np.ndarray, modes: list[int], columns: int
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
    aside = 0.04 * size if slender else 1.15 * amplitude
    width, tall = extent[0] + 2.0 * aside, extent[1] + 2.3 * amplitude
    height = (WIDTH - 0.7) / columns * tall / width + 0.26
    drawing = figure(rows * height + 0.35)
    grid = drawing.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    order = loops(pieces)
    scale_drawn, unit = place_unit(float(size))
    for axes, (k, mode) in zip(grid.flat, enumerate(modes)):
        shape = np.concatenate([p.displacements[k] for p in pieces])
        largest = np.abs(shape).max(axis=0)
        scale = amplitude / largest.max()
        if slender:
            axial = largest[int(np.argmax(extent))]
            bending = largest[int(np.argmin(extent))] > axial
            scale = min(scale, 0.8 * extent.min() / axial) if bending else 0.03 * size / axial
        # the sign of a mode is arbitrary: cracks are drawn open if that shows, else the largest displacement
        # upwards or to the right
        opening = _opening(pieces, k)
        scale = np.copysign(
            scale,
            opening
            if not slender and abs(opening) * scale > 0.005 * size
            else shape.flat[np.abs(shape).argmax()],
        )
        fill(
            axes,
            [[pieces[i].positions for i in loop] for loop in order],
            scale_drawn,
            facecolor="none",
            edgecolor="#999999",
            linewidth=0.4,
            linestyle=(0, (3, 2)),
        )
        fill(
            axes,
            [[pieces[i].positions + scale * pieces[i].displacements[k] for i in loop] for loop in order],
            scale_drawn,
            facecolor=SKY,
            edgecolor=BLUE,
            linewidth=0.6,
        )
        tone, tone_unit = frequency_unit(float(frequencies[mode]))
        value = f"{frequencies[mode] * tone:#.5g}".rstrip(".")
        axes.set_title(f"mode {mode + 1}:  {value} {tone_unit}", fontsize=8, pad=2)
        axes.set_aspect("equal")
        margin = 1.15 * amplitude
        axes.set_xlim((lower[0] - aside) * scale_drawn, (upper[0] + aside) * scale_drawn)
        axes.set_ylim((lower[1] - margin) * scale_drawn, (upper[1] + margin) * scale_drawn)
        axes.yaxis.set_major_locator(MaxNLocator(3))
        style(axes)
    for axes in list(grid.flat)[len(modes) :]:
        axes.set_axis_off()
    for axes in grid[-1]:
        axes.set_xlabel(f"x ({unit})")
    for axes in grid[:, 0]:
        axes.set_ylabel(f"y ({unit})")
    return list(grid.flat)[: len(modes)]


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
@agreed()
def plot_contact(cases: Static | Mapping[str, Static], crack: int = 0) -> list[Axes] | None:
    """Contact pressure and gap along a crack for several static cases. Collective.

    The pressure of a pair is its force divided by its share of the face. The pair on the tip element's
    boundary has no such share: it stands in for the whole face of the tip element, which has no pairs; its
    force counts in the resultant but is not drawn.

    Parameters
    ----------
    cases : Static or dict of str to Static
        By the name of the load, of one model.
    crack : int
        Number of the crack, from 0.

    Returns
    -------
    [pressure, gap] on rank 0, None elsewhere; `save_picture` writes them
    """
    cases = {"load": cases} if isinstance(cases, Static) else by_name("plot_contact", cases, Static)
    if not cases:
        raise ValueError("plot_contact: no static case is given")
    model = next(iter(cases.values())).model
    with collective(model.comm):
        check("plot_contact", crack=crack)
        if crack >= len(model.cracks):
            raise ValueError(
                f"plot_contact: crack = {crack} does not exist; the model has {len(model.cracks)}"
            )
    lengths = contact_lengths(model)
    return on_root(model.comm, lambda: _draw_contact(model, cases, lengths, crack))


def _draw_contact(model: Model, cases: Mapping[str, Static], lengths: np.ndarray, crack: int) -> list[Axes]:
    pairs, length = model.pairs, model.cracks[crack].length
    rows = np.flatnonzero(pairs.crack == crack)
    drawn = lengths[rows].copy()
    if model.cracks[crack].tip_element >= 0 and len(rows):
        drawn[np.argmin(pairs.position[rows])] = np.nan
    along, along_unit = length_unit(length)
    distance = pairs.position[rows] * length * along
    pressures = {name: case.contact_force[rows] / (drawn * model.thickness) for name, case in cases.items()}
    press, press_unit = stress_unit(max(float(np.nanmax(p, initial=0.0)) for p in pressures.values()))
    gaps = [pairs.gap[rows], *(case.gap[rows] for case in cases.values())]
    wide, wide_unit = length_unit(max(float(np.abs(gap).max(initial=0.0)) for gap in gaps))
    drawing = figure(4.6)
    pressure_axes, gap_axes = drawing.subplots(2, 1, sharex=True)
    gap_axes.plot(
        distance,
        pairs.gap[rows] * wide,
        color="#777777",
        linestyle=(0, (4, 2)),
        linewidth=0.9,
        label="initial",
    )
    for (name, case), colour, marker in zip(
        cases.items(), CYCLE * (1 + len(cases) // len(CYCLE)), MARKERS * (1 + len(cases) // len(MARKERS))
    ):
        shown = dict(color=colour, marker=marker, markersize=3, linewidth=1.0)
        force = case.contact_force[rows].sum()
        # of several cracks it is not known apart
        inside = case.contact_resultant - force if len(model.cracks) == 1 else 0.0
        beside = f", the tip element's faces {inside:,.0f} N" if inside >= 0.5 else ""
        pressure_axes.plot(
            distance,
            pressures[name] * press,
            label=f"{name}  ({case.active[rows].sum()} of {len(rows)} pairs carry {force:,.0f} N{beside})",
            **shown,
        )
        gap_axes.plot(distance, case.gap[rows] * wide, label=name, **shown)
    pressure_axes.set_ylabel(f"contact pressure ({press_unit})")
    pressure_axes.set_ylim(bottom=0.0)
    pressure_axes.set_title(
        f"{crack_title(model.cracks[crack])}: nodal contact force per area of the face", fontsize=8
    )
    gap_axes.set_ylabel(f"gap ({wide_unit})")
    gap_axes.set_xlabel(f"distance from the tip along the crack ({along_unit})")
    gap_axes.set_xlim(0.0, length * along * 1.02)
    for axes in (pressure_axes, gap_axes):
        style(axes)
        axes.grid(color="#DDDDDD", linewidth=0.4)
        axes.set_axisbelow(True)
        axes.legend(fontsize=7, frameon=False)
    return [pressure_axes, gap_axes]
