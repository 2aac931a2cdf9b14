"""Pictures of the region around a crack, deformed, with its gap in sight.

Rank 0 draws; the other ranks send what they sampled.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from ..ranks.parallel import collective, on_root
from ..record.units import length_unit, place_unit, stress_unit
from ..system.model import Model
from .drawing import BLACK, Sheet, bar
from .outlines import Piece, Region, gather_outline, gather_region
from .picture import fields_by_name, picture


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
        if crack >= len(model.cracks):
            raise ValueError(f"plot_crack: crack = {crack} does not exist; the model has {len(model.cracks)}")
    facts = model.cracks[crack]
    tip, half = np.array(facts.tip), np.array([1.1, 0.11]) * facts.length
    regions = {name: [gather_region(model, field, tip, h) for h in half] for name, field in fields.items()}
    outline = gather_outline(model, list(fields.values()), max(2 * model.order, 8))

    def draw() -> list[Axes]:
        panels = Sheet.of(ax).panels((len(regions), 2), 3.15 * len(regions) + 0.15)
        windows = [Window(facts, h, colour) for h in half]
        for number, axes in enumerate(panels):
            name, window = list(regions)[number // 2], windows[number % 2]
            region = regions[name][number % 2]
            assert region is not None and outline is not None  # on rank 0
            factor = magnification or shown_best(0.12 * window.half, window.largest([region]))
            colours = window.colours([region])
            painted = window.paint(axes, region, outline, number // 2, factor=factor, colours=colours)
            colours.bar(painted[0], axes)
            window.frame(axes)
            axes.set_title(f"{name}, {window.magnified} × {plain(factor)}")
        return panels

    return on_root(model.comm, draw)


# Lines of an outline: whole ones, and broken ones of faces without pairs.
Lines = Iterable[tuple[bool, np.ndarray]]


@dataclass(frozen=True)
class Colours:
    """A scale of colours: its range, in units of 1 / factor; its label; whether some values are above it."""

    norm: Normalize
    factor: float
    label: str
    more: bool

    def paint(
        self,
        axes: Axes,
        places: np.ndarray,
        faces: np.ndarray,
        values: np.ndarray,
        lines: Lines,
        width: float,
    ) -> list[Any]:
        """Draw (n, 2) places and triangles between them in colours of their values, Pa or m, and lines.

        Returns
        -------
        Artists, the coloured interior first
        """
        style: Any = {"shading": "gouraud", "norm": self.norm, "rasterized": True}
        style["cmap"] = "RdBu_r" if self.signed else "viridis"
        painted: list[Any] = [
            axes.tripcolor(Triangulation(places[:, 0], places[:, 1], faces), values * self.factor, **style)
        ]
        for whole, line in lines:
            dashes: Any = "-" if whole else (0, (2, 1))
            painted += axes.plot(*line.T, color=BLACK, linewidth=width, linestyle=dashes)
        return painted

    @property
    def signed(self) -> bool:
        """Whether values have two signs."""
        return self.norm.vmin != 0.0

    def bar(self, painted: Any, axes: Axes | Sequence[Axes]) -> None:
        """A colour bar beside the axes."""
        extend: Any = "neither" if not self.more else "both" if self.signed else "max"
        drawn = bar(painted, axes, self.label, extend=extend, shrink=0.85, pad=0.02)
        drawn.locator = MaxNLocator(5)
        drawn.update_ticks()


class Window:
    """A square window around a crack's tip.

    Parameters
    ----------
    crack : Crack
    half : float
        Half its side, m.
    colour : {"von_mises", "displacement"}
    """

    gap = "gap at the mouth"

    def __init__(self, crack: Any, half: float, colour: str):
        self.tip, self.half, self.colour = np.array(crack.tip), float(half), colour
        self.notch = Notch(crack, self.half)

    @property
    def magnified(self) -> str:
        """What the magnification is of."""
        return self.notch.magnified

    def largest(self, regions: Sequence[Region]) -> float:
        """Largest displacement in the window without its rigid-body motion, opening included, m."""
        found = 0.0
        for region in regions:
            inside, _, relative = self._relative(region)
            found = max(found, float(np.abs(relative + self.notch.opening(region.positions))[inside].max()))
        return found

    def colours(self, regions: Sequence[Region]) -> Colours:
        """One scale of colours for several states."""
        inside = self._relative(regions[0])[0]
        values = [self._values(region) for region in regions]
        if self.colour == "von_mises":
            top = max(area_quantile(region, v, inside, 0.97) for region, v in zip(regions, values))
            factor, name = stress_unit(top)
            return Colours(Normalize(0.0, top * factor), factor, f"von Mises stress ({name})", more=True)
        top = max(area_quantile(region, v, inside, 1.0) for region, v in zip(regions, values))
        factor, name = length_unit(max(float(v[inside].max()) for v in values))
        label = f"displacement without rigid-body motion ({name})"
        return Colours(Normalize(0.0, top * factor), factor, label, more=False)

    def frame(self, axes: Axes) -> None:
        """Axes of the window, in lengths from the tip."""
        scale, unit = place_unit(2.0 * self.half)
        axes.set_xlim(-self.half * scale, self.half * scale)
        axes.set_ylim(-self.half * scale, self.half * scale)
        axes.set_aspect("equal")
        axes.set_facecolor("white")
        axes.set_xlabel(f"x from the tip ({unit})")
        axes.set_ylabel(f"y from the tip ({unit})")

    def paint(
        self, axes: Axes, region: Region, outline: list[Piece], row: int, *, factor: float, colours: Colours
    ) -> list[Any]:
        """Draw a state: displacements times `factor`; the outline's are those of its field `row`.

        Returns
        -------
        Artists, the coloured interior first
        """
        _, motion, relative = self._relative(region)
        scale, _ = place_unit(2.0 * self.half)

        def drawn(places: np.ndarray, moved: np.ndarray) -> np.ndarray:
            return (places + factor * moved + (factor - 1.0) * self.notch.opening(places) - self.tip) * scale

        lines = (
            (piece.key[0] >= 0, drawn(at, piece.displacements[row] - motion(at - self.tip)))
            for piece in outline
            if (np.abs((at := piece.positions) - self.tip) <= 1.5 * self.half).all(axis=1).any()
        )
        places = drawn(region.positions, relative)
        return colours.paint(axes, places, region.triangles, self._values(region), lines, 0.8)

    def _relative(self, region: Region) -> tuple[np.ndarray, Any, np.ndarray]:
        """Points inside, rigid-body motion as a function of arms, displacements without it."""
        arms = region.positions - self.tip
        inside = (np.abs(arms) <= self.half).all(axis=1)
        motion = _rigid_motion(arms[inside], region.displacements[inside])
        return inside, motion, region.displacements - motion(arms)

    def _values(self, region: Region) -> np.ndarray:
        """What the colours show, Pa or m."""
        if self.colour == "von_mises":
            return region.stress[:, 3]
        return np.linalg.norm(self._relative(region)[2], axis=1)


class Notch:
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


def _rigid_motion(arms: np.ndarray, displacements: np.ndarray):
    """Best translation and small rotation of displaced points, as a function of the arms (n, 2)."""
    mean_arm, mean = arms.mean(axis=0), displacements.mean(axis=0)
    a, d = arms - mean_arm, displacements - mean
    turn = float((a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]).sum() / (a**2).sum())
    return lambda at: mean + turn * np.stack([-(at - mean_arm)[:, 1], (at - mean_arm)[:, 0]], axis=1)


def area_quantile(region: Region, values: np.ndarray, inside: np.ndarray, share: float) -> float:
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


def plain(value: float) -> str:
    """A factor in a title: whole from 1 on."""
    return f"{value:,.0f}" if value >= 1.0 else f"{value:.3g}"


def shown_best(size: float, largest: float) -> float:
    """The magnification, of 1, 2, 5, 10, 20, ..., in which the largest displacement is drawn up to this size;
    1 of what is at rest.
    """
    if not largest > 0.0:
        return 1.0
    value = size / largest * (1.0 + 1e-9)  # one of them itself, but for round-off
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (0.5, 1.0, 2.0, 5.0) if m * power <= value))
