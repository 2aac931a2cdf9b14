"""Pictures of mode shapes, crack regions and contact forces.

Rank 0 draws; the other ranks send sampled outlines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from ..analysis.static import Static
from ..parallel import on_root
from ..system.model import Model
from ..system.modes import Modal
from .drawing import BLACK, BLUE, CYCLE, MARKERS, SKY, WIDTH, crack_title, figure, fill, style
from .outlines import Piece, Region, contact_lengths, gather_outline, gather_region, loops
from .units import frequency_unit, length_unit, place_unit, stress_unit


# ---------------------------------------------------------------------- mode shapes
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
    chosen = list(range(min(12, len(modal.frequencies))) if modes is None else modes)
    wrong = [m for m in chosen if not 0 <= m < len(modal.frequencies)]
    if not chosen or wrong:
        raise ValueError(
            f"plot_modes: modes = {modes!r} must be numbers from 0 to {len(modal.frequencies) - 1}"
        )
    if not isinstance(modal.model, Model):
        raise TypeError("plot_modes: modal must be the modes of a Model")
    pieces = gather_outline(modal.model, [modal.nodal(m) for m in chosen], max(2 * modal.model.order, 8))
    return on_root(modal.model.comm, lambda: _draw_modes(pieces, modal.frequencies, chosen, columns))


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
    tone, tone_unit = frequency_unit(float(frequencies[modes].max()))
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
            colour="none",
            edge="#999999",
            width=0.4,
            line=(0, (3, 2)),
        )
        fill(
            axes,
            [[pieces[i].positions + scale * pieces[i].displacements[k] for i in loop] for loop in order],
            scale_drawn,
            colour=SKY,
            edge=BLUE,
            width=0.6,
        )
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


# ---------------------------------------------------------------------- crack region
def plot_crack(
    model: Model,
    fields: Mapping[str, Any],
    crack: int = 0,
    *,
    colour: str = "von_mises",
    magnification: float | None = None,
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

    Returns
    -------
    Axes, two a field, on rank 0, None elsewhere; `save_picture` writes them
    """
    if not fields:
        raise ValueError("plot_crack: no displacement field is given")
    if not 0 <= crack < len(model.cracks):
        raise ValueError(f"plot_crack: crack = {crack} does not exist; the model has {len(model.cracks)}")
    if colour not in ("von_mises", "displacement"):
        raise ValueError(f'plot_crack: colour = {colour!r} is unknown; use "von_mises" or "displacement"')
    facts = model.cracks[crack]
    tip, half = np.array(facts.tip), np.array([1.1, 0.11]) * facts.length
    regions = {name: [gather_region(model, field, tip, h) for h in half] for name, field in fields.items()}
    outline = gather_outline(model, list(fields.values()), max(2 * model.order, 8))
    return on_root(model.comm, lambda: _draw_crack(regions, outline, facts, half, colour, magnification))


def _draw_crack(
    regions: dict[str, list[Region | None]],
    outline: list[Piece] | None,
    crack,
    halves: np.ndarray,
    colour: str,
    magnification: float | None,
) -> list[Axes]:
    tip = np.array(crack.tip)
    drawing = figure(3.15 * len(regions) + 0.15)
    grid = drawing.subplots(len(regions), 2, squeeze=False)
    for row, (name, panels) in enumerate(regions.items()):
        for axes, region, half in zip(grid[row], panels, halves):
            assert region is not None and outline is not None  # on rank 0
            inside = (np.abs(region.positions - tip) <= half).all(axis=1)
            motion = _rigid_motion(region.positions[inside] - tip, region.displacements[inside])
            own = _Notch(crack, half)
            relative = region.displacements - motion(region.positions - tip)
            largest = np.abs(relative + own.opening(region.positions))[inside].max()
            factor = magnification or _round(0.12 * half / largest)
            scale, unit = place_unit(2.0 * float(half))
            place = (own.drawn(region.positions, relative, factor) - tip) * scale
            if colour == "von_mises":
                largest_shown = _area_quantile(region, region.stress[:, 3], inside, 0.97)
                in_unit, stress_name = stress_unit(largest_shown)
                values, label, top = region.stress[:, 3] * in_unit, f"von Mises stress ({stress_name})", 0.97
            else:
                moves = np.linalg.norm(relative, axis=1)
                in_unit, length_name = length_unit(float(moves[inside].max()))
                label, top = f"displacement without rigid-body motion ({length_name})", 1.0
                values = moves * in_unit
            norm = Normalize(0.0, _area_quantile(region, values, inside, top))
            shown = axes.tripcolor(
                *place.T,
                region.triangles,
                values,
                shading="gouraud",
                cmap="viridis",
                norm=norm,
                rasterized=True,
            )
            bar = drawing.colorbar(
                shown, ax=axes, extend="max" if top < 1.0 else "neither", shrink=0.85, pad=0.02
            )
            bar.set_label(label, size=7)
            bar.ax.tick_params(labelsize=6)
            bar.locator = MaxNLocator(5)
            bar.update_ticks()
            for piece in outline:
                if (np.abs(piece.positions - tip) <= 1.5 * half).all(axis=1).any():
                    moved = own.drawn(
                        piece.positions, piece.displacements[row] - motion(piece.positions - tip), factor
                    )
                    axes.plot(
                        *((moved - tip) * scale).T,
                        color=BLACK,
                        linewidth=0.8,
                        linestyle="-" if piece.key[0] >= 0 else (0, (2, 1)),
                    )
            axes.set_xlim(-half * scale, half * scale)
            axes.set_ylim(-half * scale, half * scale)
            axes.set_aspect("equal")
            axes.set_facecolor("white")
            axes.set_title(f"{name}, {own.magnified} × {_plain(factor)}", fontsize=8)
            axes.set_xlabel(f"x from the tip ({unit})")
            axes.set_ylabel(f"y from the tip ({unit})")
            style(axes)
    return list(grid.flat)


class _Notch:
    """Draws a narrow V-notch as if it had opened from a closed slit, so that one magnification serves gap and
    displacement.
    """

    def __init__(self, crack, half: float):
        self.tip, self.axis, self.half = np.array(crack.tip), np.array(crack.axis), half
        self.slope = np.tan(0.5 * crack.opening)
        if self.slope > 0.02:
            self.slope = 0.0  # wide enough to be seen: left as it is
        self.magnified = "displacement and opening" if self.slope else "displacement"

    def opening(self, positions: np.ndarray) -> np.ndarray:
        """(n, 2): displacement from the slit to the notch, fading away from the faces."""
        across = np.array([self.axis[1], -self.axis[0]])
        along, side = (positions - self.tip) @ self.axis, (positions - self.tip) @ across
        amount = self.slope * np.maximum(along, 0.0)
        fade = np.clip(1.0 - (np.abs(side) - amount) / self.half, 0.0, 1.0)
        return (np.sign(side) * amount * fade)[:, None] * across

    def drawn(self, positions: np.ndarray, displacements: np.ndarray, factor: float) -> np.ndarray:
        """Where points are drawn."""
        return positions + factor * displacements + (factor - 1.0) * self.opening(positions)


def _rigid_motion(arms: np.ndarray, displacements: np.ndarray):
    """Best translation and small rotation of displaced points, as a function of the arms (n, 2)."""
    mean_arm, mean = arms.mean(axis=0), displacements.mean(axis=0)
    a, d = arms - mean_arm, displacements - mean
    turn = float((a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]).sum() / (a**2).sum())
    return lambda at: mean + turn * np.stack([-(at - mean_arm)[:, 1], (at - mean_arm)[:, 0]], axis=1)


def _area_quantile(region: Region, values: np.ndarray, inside: np.ndarray, share: float) -> float:
    """Value that is not exceeded on a share of the area: the points crowd at the tip, where the stress has no
    bound.
    """
    triangles = region.triangles[inside[region.triangles].all(axis=1)]
    a, b, c = (region.positions[triangles[:, k]] for k in range(3))
    area = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    mean = values[triangles].mean(axis=1)
    order = np.argsort(mean)
    share_below = np.cumsum(area[order]) / area.sum()
    return float(mean[order][min(np.searchsorted(share_below, share), len(order) - 1)])


def _plain(value: float) -> str:
    return f"{value:,.0f}" if value >= 1.0 else f"{value:.3g}"


def _round(value: float) -> float:
    """The next lower of 1, 2, 5, 10, 20, ..."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (1.0, 2.0, 5.0) if m * power <= value))


# ---------------------------------------------------------------------- contact along the crack
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
    cases = {"load": cases} if isinstance(cases, Static) else cases
    if not cases:
        raise ValueError("plot_contact: no static case is given")
    model = next(iter(cases.values())).model
    if not 0 <= crack < len(model.cracks):
        raise ValueError(f"plot_contact: crack = {crack} does not exist; the model has {len(model.cracks)}")
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
        pressure_axes.plot(
            distance,
            pressures[name] * press,
            label=f"{name}  (resultant {force:,.0f} N, {case.active[rows].sum()} of {len(rows)} pairs)",
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
