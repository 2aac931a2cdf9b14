"""Pictures of the region around a crack, deformed, with its gap in sight.

Rank 0 draws; the other ranks send what they sampled.
"""

from __future__ import annotations

import abc
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from ..ranks.parallel import collective, on_root
from ..record.units import length_unit, place_unit, stress_unit
from ..system.model import Model
from .drawing import BLACK, bar
from .outlines import Piece, Region, gather_outline, gather_region
from .picture import fields_by_name, picture, require_crack


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
                window.draw([axes], {name: region}, outline, magnification, row)
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


# Stresses that colours may show, by their column in a `Region`; and how labels call what they show.
STRESSES = {"von_mises": 3, "stress_xx": 0, "stress_yy": 1, "stress_xy": 2}
LABELS = {
    "von_mises": "von Mises stress",
    "stress_xx": r"$\sigma_{xx}$",
    "stress_yy": r"$\sigma_{yy}$",
    "stress_xy": r"$\sigma_{xy}$",
    "displacement": "displacement",
}


class View(abc.ABC):
    """What panels show of states of a structure: displaced, in colours.

    Attributes
    ----------
    half : float
        Half its size, m.
    reach : float
        Of that: what the largest displacement is drawn as, at most.
    magnified : str
        What the magnification is of.
    """

    half: float
    reach: ClassVar[float] = 0.12
    magnified = "displacement"

    @abc.abstractmethod
    def largest(self, states: Sequence[Any]) -> float:
        """Largest displacement that is drawn, m."""

    @abc.abstractmethod
    def colours(self, states: Sequence[Any]) -> Colours:
        """One scale of colours for several states."""

    @abc.abstractmethod
    def frame(self, axes: Axes) -> None:
        """The axes around it."""

    @abc.abstractmethod
    def paint(
        self, axes: Axes, state: Any, outline: Any, row: int, *, factor: float, colours: Colours
    ) -> list[Any]:
        """Draw a state: displacements times `factor`; the outline's are those of its field `row`.

        Returns
        -------
        Artists, the coloured interior first
        """

    def magnification(self, states: Sequence[Any]) -> float:
        """One that suits some states."""
        return shown_best(self.reach * self.half, self.largest(states))

    def draw(
        self,
        panels: Sequence[Axes],
        states: Mapping[str, Any],
        outline: Any,
        magnification: float | None,
        first: int = 0,
    ) -> None:
        """A panel for each state, on one scale of colours; the outline's fields of them from `first` on."""
        colours = self.colours(list(states.values()))
        for row, (axes, (name, state)) in enumerate(zip(panels, states.items()), first):
            factor = magnification or self.magnification([state])
            painted = self.paint(axes, state, outline, row, factor=factor, colours=colours)
            self.frame(axes)
            axes.set_title(f"{f'{name}, ' if name else ''}{self.magnified} × {plain(factor)}")
        colours.bar(painted[0], panels)


class Window(View):
    """A square window around a crack's tip.

    Parameters
    ----------
    crack : Crack
    half : float
        Half its side, m.
    colour : {"von_mises", "displacement"}
    """

    gap = "gap at the mouth"
    # Of the area: where colours tell stresses apart, which have no bound at a tip.
    share: ClassVar[float] = 0.97
    moved = "displacement without rigid-body motion"

    def __init__(self, crack: Any, half: float, colour: str):
        self.tip, self.half, self.colour = np.array(crack.tip), float(half), colour
        self.notches = [Notch(crack, self.half)]
        self.magnified = self.notches[0].magnified

    def _opening(self, places: np.ndarray) -> np.ndarray:
        """See `Notch`."""
        return sum((notch.opening(places) for notch in self.notches), np.zeros(places.shape))

    def largest(self, states: Sequence[Region]) -> float:
        """In the window without its rigid-body motion, opening included."""
        found = 0.0
        for region in states:
            inside, _, relative = self._relative(region)
            found = max(found, float(np.abs(relative + self._opening(region.positions))[inside].max()))
        return found

    def colours(self, states: Sequence[Region]) -> Colours:
        """From zero, or as far to both sides of it where there are two signs."""
        inside, stress = self._relative(states[0])[0], self.colour in STRESSES
        share = self.share if stress else 1.0
        sizes = [np.abs(self._values(region)) for region in states]
        top = max(area_quantile(region, size, inside, share) for region, size in zip(states, sizes))
        factor, unit = (stress_unit if stress else length_unit)(top)
        least = -top * factor if stress and self.colour != "von_mises" else 0.0
        label = LABELS[self.colour] if stress else self.moved
        return Colours(Normalize(least, (top or 1.0) * factor), factor, f"{label} ({unit})", more=share < 1.0)

    def frame(self, axes: Axes) -> None:
        """In lengths from the tip."""
        scale, unit = place_unit(2.0 * self.half)
        side = (-self.half * scale, self.half * scale)
        labels = {f"{axis}label": f"{axis} from the tip ({unit})" for axis in "xy"}
        axes.set(xlim=side, ylim=side, aspect="equal", facecolor="white", **labels)

    def paint(
        self, axes: Axes, state: Region, outline: list[Piece], row: int, *, factor: float, colours: Colours
    ) -> list[Any]:
        """With the lines of the outline that are near."""
        _, motion, relative = self._relative(state)
        scale, _ = place_unit(2.0 * self.half)

        def drawn(places: np.ndarray, moved: np.ndarray) -> np.ndarray:
            moved_and_open = factor * moved + (factor - 1.0) * self._opening(places)
            return (places + moved_and_open - self.origin) * scale

        lines = (
            (piece.key[0] >= 0, drawn(at, piece.displacements[row] - motion(at - self.tip)))
            for piece in outline
            if (np.abs((at := piece.positions) - self.tip) <= 1.5 * self.half).all(axis=1).any()
        )
        places = drawn(state.positions, relative)
        return colours.paint(axes, places, state.triangles, self._values(state), lines, 0.8)

    @property
    def origin(self) -> np.ndarray:
        """Of the axes."""
        return self.tip

    def _relative(self, region: Region) -> tuple[np.ndarray, Any, np.ndarray]:
        """Points inside, rigid-body motion as a function of arms, displacements without it."""
        arms = region.positions - self.tip
        inside = (np.abs(arms) <= self.half).all(axis=1)
        motion = _rigid_motion(arms[inside], region.displacements[inside])
        return inside, motion, region.displacements - motion(arms)

    def _values(self, region: Region) -> np.ndarray:
        """What the colours show, Pa or m."""
        if self.colour in STRESSES:
            return region.stress[:, STRESSES[self.colour]]
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
