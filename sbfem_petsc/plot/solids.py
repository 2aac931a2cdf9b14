"""Bodies in three dimensions: their surface, deformed, in colours of the displacement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize

from ..bodies.cells import surface
from ..bodies.finite_element_model import FiniteElementModel
from ..bodies.rows import Contact
from ..record.units import length_unit, place_unit
from .crack import Colours, View

# Where it is looked at from, degrees about z and above the plane.
TURNED, ABOVE = -60.0, 25.0
# Of the largest side of the faces: what is drawn beyond them.
AROUND = 0.75


class Solid(View):
    """What an animation draws of a body, from one side, without perspective: what lies around its contact,
    without its rigid-body motion; all of it where there is none.

    Parameters
    ----------
    body : FiniteElementModel
        With elements.
    contact : Contact or None
    """

    reach, gap = 0.1, "widest gap"

    def __init__(self, body: FiniteElementModel, contact: Contact | None):
        self.places, cells, near = body.places, body.elements, np.ones(len(body.places), dtype=bool)
        if contact is not None:
            faces = body.nodal(abs(contact.rows).sum(axis=0).A1).any(axis=1)
            lower, upper = self.places[faces].min(axis=0), self.places[faces].max(axis=0)
            size = AROUND * float((upper - lower).max())
            near = (self.places >= lower - size).all(axis=1) & (self.places <= upper + size).all(axis=1)
            cells = {kind: rows[near[rows].any(axis=1)] for kind, rows in cells.items()}
        self.faces = surface(cells)
        self.drawn = np.unique(np.concatenate([face.ravel() for face in self.faces]))
        self.half = 0.5 * float(np.ptp(self.places[self.drawn], axis=0).max())
        arms = self.places[self.drawn] - self.places[self.drawn].mean(axis=0)
        rigid = [np.tile(axis, (len(arms), 1)) for axis in np.eye(3)] + [np.cross(e, arms) for e in np.eye(3)]
        motions = np.stack([motion.ravel() for motion in rigid], axis=1)
        self.rigid = np.linalg.qr(motions)[0] if not near.all() else motions[:, :0]
        a, b = np.radians(TURNED), np.radians(ABOVE)
        self.view = np.array(
            [
                [-np.sin(a), np.cos(a), 0.0],
                [-np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)],
                [np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)],  # towards the eye
            ]
        )

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
        factor, name = length_unit(top := self.largest(states))
        what = "displacement without rigid-body motion" if self.rigid.size else "displacement"
        return Colours(Normalize(0.0, (top or 1.0) * factor), factor, f"{what} ({name})", more=False)

    def frame(self, axes: Axes) -> None:
        """Axes without a scale, but for the length that is said."""
        scale, unit = place_unit(2.0 * self.half)
        axes.set_aspect("equal")
        axes.margins(0.15)
        axes.set(xticks=[], yticks=[])
        axes.set_xlabel(f"{2.0 * self.half * scale:.4g} {unit} long")
        axes.update_datalim(self.places[self.drawn] @ self.view[:2].T)
        axes.autoscale_view()

    def paint(
        self, axes: Axes, state: np.ndarray, outline: Any, row: int, *, factor: float, colours: Colours
    ) -> list[Any]:
        """Draw a state, displacements times `factor`, what is nearer over what is behind."""
        state = self._relative(state)
        points = (self.places + factor * state) @ self.view.T
        values = np.linalg.norm(state, axis=1) * colours.factor
        drawn = [
            (points[face, 2].mean(), points[face, :2], values[face].mean())
            for faces in self.faces
            for face in faces
        ]
        drawn.sort(key=lambda face: face[0])
        painted = PolyCollection([polygon for _, polygon, _ in drawn], cmap="viridis", norm=colours.norm)
        painted.set(array=np.array([value for *_, value in drawn]), edgecolor="#00000055", linewidth=0.2)
        axes.add_collection(painted)
        return [painted]
