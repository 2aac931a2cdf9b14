"""What pictures show of deformed structures, in colours: a window around a crack's tip, a whole body, a body
in three dimensions.

Of these views `half` is half the size, m; `reach` what of that the largest displacement is drawn as, at most;
`magnified` what the magnification is of.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation
from scipy.spatial.transform import Rotation

from meshing.vectors import cross, polygon_area

from ..bodies.cells import corners, outer_faces
from ..bodies.finite_element_model import FiniteElementModel
from ..bodies.rows import Contact
from ..record.units import place_unit
from ..system.fields.outlines import Piece, Region
from ..system.model import Model
from .drawing import BLACK, Scale, bar

# Stresses that colours may show, by their column in a `Region`; and how labels call what they show.
STRESSES = {"von_mises": 3, "stress_xx": 0, "stress_yy": 1, "stress_xy": 2}
LABELS = {
    "von_mises": "von Mises stress",
    "stress_xx": r"$\sigma_{xx}$",
    "stress_yy": r"$\sigma_{yy}$",
    "stress_xy": r"$\sigma_{xy}$",
    "displacement": "displacement",
}


@dataclass(frozen=True)
class Colours:
    """A scale of colours.

    Attributes
    ----------
    scale : Scale
        Of the values, Pa or m.
    top : float
        Of its range, as drawn.
    signed : bool
        Whether it begins as far below zero, not at zero.
    more : bool
        Whether some values are beyond it.
    """

    scale: Scale
    top: float
    signed: bool = False
    more: bool = False

    @property
    def look(self) -> Any:
        """As Matplotlib takes it."""
        norm = Normalize(-self.top if self.signed else 0.0, self.top)
        return {"norm": norm, "cmap": "RdBu_r" if self.signed else "viridis"}

    def bar(self, painted: Any, axes: Axes | Sequence[Axes]) -> None:
        """A colour bar beside the axes."""
        extend = "neither" if not self.more else "both" if self.signed else "max"
        look: Any = {"extend": extend, "shrink": 0.85, "pad": 0.02, "ticks": MaxNLocator(5)}
        bar(painted, axes, self.scale.label, **look)


def magnification_of(view: Window | Solid, states: Sequence[Any]) -> float:
    """The one of 1, 2, 5, 10, 20, ... in which the largest displacement is drawn within the view's reach; 1
    of what is at rest.
    """
    largest = view.largest(states)
    if not largest > 0.0:
        return 1.0
    value = view.reach * view.half / largest * (1.0 + 1e-9)  # one of them itself, but for round-off
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (0.5, 1.0, 2.0, 5.0) if m * power <= value))


def draw_states(
    view: Window | Solid,
    panels: Sequence[Axes],
    states: Mapping[str, Any],
    outline: Any,
    magnification: float | None,
    first: int = 0,
) -> None:
    """A panel for each state, on one scale of colours; the outline's fields of them from `first` on."""
    colours = view.colours(list(states.values()))
    for row, (axes, (name, state)) in enumerate(zip(panels, states.items()), first):
        factor = magnification or magnification_of(view, [state])
        painted = view.paint(axes, state, outline, row, factor=factor, colours=colours)
        view.frame(axes)
        axes.set_title(f"{f'{name}, ' if name else ''}{view.magnified} × {plain(factor)}")
    colours.bar(painted[0], panels)


class Window:
    """A square window around a crack's tip.

    Parameters
    ----------
    crack : Crack
    half : float
        Half its side, m.
    colour : {"von_mises", "displacement"}
    """

    reach, gap = 0.12, "gap at the mouth"
    # Of the area: where colours tell stresses apart, which have no bound at a tip.
    share = 0.97
    moved = "displacement without rigid-body motion"

    def __init__(self, crack: Any, half: float, colour: str):
        self.tip, self.half, self.colour = np.array(crack.tip), float(half), colour
        self.origin = self.tip  # of the axes
        self.cracks: Sequence[Any] = (crack,)
        self.fades = [self.half]

    @property
    def magnified(self) -> str:
        """In words."""
        return "displacement and opening" if any(map(_slope, self.cracks)) else "displacement"

    def _opening(self, places: np.ndarray) -> np.ndarray:
        """(n, 2): displacement from closed slits to the narrow notches, fading away from their faces: one
        magnification serves gap and displacement as if they had opened from these.
        """
        found = np.zeros(places.shape)
        for crack, reach in zip(self.cracks, self.fades):
            axis, arms = np.array(crack.axis), places - np.array(crack.tip)
            across = np.array([axis[1], -axis[0]])
            side, amount = arms @ across, _slope(crack) * np.maximum(arms @ axis, 0.0)
            fade = np.clip(1.0 - (np.abs(side) - amount) / reach, 0.0, 1.0)
            found += (np.sign(side) * amount * fade)[:, None] * across
        return found

    def largest(self, states: Sequence[Region]) -> float:
        """In the window without its rigid-body motion, opening included."""
        found = 0.0
        for region in states:
            inside, _, relative = self._relative(region)
            found = max(found, float(np.abs(relative + self._opening(region.positions))[inside].max()))
        return found

    def colours(self, states: Sequence[Region]) -> Colours:
        """One scale of colours for several states."""
        inside, stress = self._relative(states[0])[0], self.colour in STRESSES
        share = self.share if stress else 1.0
        top = max(area_quantile(state, np.abs(self._values(state)), inside, share) for state in states)
        scale = Scale.of(LABELS[self.colour] if stress else self.moved, "Pa" if stress else "m", top)
        signed = stress and self.colour != "von_mises"
        return Colours(scale, scale(top or 1.0), signed, more=share < 1.0)

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

        places = drawn(state.positions, relative)
        mesh = Triangulation(places[:, 0], places[:, 1], state.triangles)
        values = colours.scale(self._values(state))
        painted: list[Any] = [
            axes.tripcolor(mesh, values, shading="gouraud", rasterized=True, **colours.look)
        ]
        for piece in outline:
            arms = piece.positions - self.tip
            if (np.abs(arms) <= 1.5 * self.half).all(axis=1).any():
                line = drawn(piece.positions, piece.displacements[row] - motion(arms))
                dashes: Any = "-" if piece.key[0] >= 0 else (0, (2, 1))  # of faces without pairs
                painted += axes.plot(*line.T, color=BLACK, linewidth=0.8, linestyle=dashes)
        return painted

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


def _slope(crack: Any) -> float:
    """Of the faces of a narrow V-notch; 0 of one wide enough to be seen, which is left as it is."""
    slope = float(np.tan(0.5 * crack.opening))
    return slope if slope <= 0.02 else 0.0


def _rigid_motion(arms: np.ndarray, displacements: np.ndarray):
    """Best translation and small rotation of displaced points, as a function of the arms (n, 2)."""
    mean_arm, mean = arms.mean(axis=0), displacements.mean(axis=0)
    a, d = arms - mean_arm, displacements - mean
    turn = float(cross(a, d).sum() / (a**2).sum())
    return lambda at: mean + turn * (at - mean_arm)[:, ::-1] * [-1.0, 1.0]


def area_quantile(region: Region, values: np.ndarray, inside: np.ndarray, share: float) -> float:
    """Value that is not exceeded on a share of the area: the points crowd at the tip, where the stress has no
    bound.
    """
    triangles = region.triangles[inside[region.triangles].all(axis=1)]
    area = np.abs(polygon_area(region.positions[triangles]))
    mean = values[triangles].mean(axis=1)
    order = np.argsort(mean)
    share_below = np.cumsum(area[order]) / area.sum()
    return float(mean[order][min(np.searchsorted(share_below, share), len(order) - 1)])


def plain(value: float) -> str:
    """A factor in a title: whole from 1 on."""
    return f"{value:,.0f}" if value >= 1.0 else f"{value:.3g}"


class Whole(Window):
    """A whole body."""

    reach, share, moved = 0.1, 0.99, "displacement"

    def __init__(self, model: Model, colour: str):
        lower, upper = model.extent
        self.extent, self.tip, self.colour = upper - lower, 0.5 * (lower + upper), colour
        self.half, self.origin = 0.5 * float(self.extent.max()), np.zeros(2)
        self.cracks, self.fades = model.cracks, [crack.length for crack in model.cracks]

    def frame(self, axes: Axes) -> None:
        """In coordinates."""
        _, unit = place_unit(2.0 * self.half)
        axes.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")

    def _relative(self, region: Region) -> tuple[np.ndarray, Any, np.ndarray]:
        """All of it."""
        return np.ones(len(region.positions), dtype=bool), np.zeros_like, region.displacements


# Where it is looked at from, degrees about z and above the plane.
TURNED, ABOVE = -60.0, 25.0
# Of the largest side of the faces: what is drawn beyond them.
AROUND = 0.75


class Solid:
    """What an animation draws of a body, from one side, without perspective: what lies around its contact,
    without its rigid-body motion; all of it where there is none.

    Parameters
    ----------
    body : FiniteElementModel
        With elements.
    contact : Contact or None
    """

    reach, gap, magnified = 0.1, "widest gap", "displacement"

    def __init__(self, body: FiniteElementModel, contact: Contact | None):
        self.places, cells, near = body.places, body.elements, np.ones(len(body.places), dtype=bool)
        if contact is not None:
            faces = body.nodal(abs(contact.rows).sum(axis=0).A1).any(axis=1)
            lower, upper = self.places[faces].min(axis=0), self.places[faces].max(axis=0)
            size = AROUND * float((upper - lower).max())
            near = (self.places >= lower - size).all(axis=1) & (self.places <= upper + size).all(axis=1)
            cells = {kind: rows[near[rows].any(axis=1)] for kind, rows in cells.items()}
        self.faces = [face[: corners(face)] for face in outer_faces(cells)]
        self.drawn = np.unique(np.concatenate(self.faces))
        self.half = 0.5 * float(np.ptp(self.places[self.drawn], axis=0).max())
        arms = self.places[self.drawn] - self.places[self.drawn].mean(axis=0)
        rigid = [np.tile(axis, (len(arms), 1)) for axis in np.eye(3)] + [np.cross(e, arms) for e in np.eye(3)]
        motions = np.stack([motion.ravel() for motion in rigid], axis=1)
        self.rigid = np.linalg.qr(motions)[0] if not near.all() else motions[:, :0]
        # across, up, towards the eye
        self.view = Rotation.from_euler("zx", [-90.0 - TURNED, ABOVE - 90.0], degrees=True).as_matrix()

    def _relative(self, state: np.ndarray) -> np.ndarray:
        """(nodes, 3): without rigid-body motion, zero where nothing is drawn."""
        found, flat = np.zeros(state.shape), state[self.drawn].ravel()
        found[self.drawn] = (flat - self.rigid @ (self.rigid.T @ flat)).reshape(-1, 3)
        return found

    def largest(self, states: Sequence[np.ndarray]) -> float:
        """Largest displacement, m."""
        return max(float(np.linalg.norm(self._relative(state), axis=1).max()) for state in states)

    def colours(self, states: Sequence[np.ndarray]) -> Colours:
        """One scale of colours for several states."""
        what = "displacement without rigid-body motion" if self.rigid.size else "displacement"
        top = self.largest(states)
        scale = Scale.of(what, "m", top)
        return Colours(scale, scale(top or 1.0))

    def frame(self, axes: Axes) -> None:
        """Axes without a scale, but for the length that is said."""
        scale, unit = place_unit(2.0 * self.half)
        axes.set(aspect="equal", xticks=[], yticks=[], xlabel=f"{2.0 * self.half * scale:.4g} {unit} long")
        axes.margins(0.15)
        axes.update_datalim(self.places[self.drawn] @ self.view[:2].T)
        axes.autoscale_view()

    def paint(
        self, axes: Axes, state: np.ndarray, outline: Any, row: int, *, factor: float, colours: Colours
    ) -> list[Any]:
        """Draw a state, displacements times `factor`, what is nearer over what is behind."""
        state = self._relative(state)
        points = (self.places + factor * state) @ self.view.T
        values = colours.scale(np.linalg.norm(state, axis=1))
        faces = sorted(self.faces, key=lambda face: points[face, 2].mean())
        look = colours.look | {"array": [values[face].mean() for face in faces], "linewidth": 0.2}
        painted = PolyCollection([points[face, :2] for face in faces], edgecolor="#00000055", **look)
        axes.add_collection(painted)
        return [painted]
