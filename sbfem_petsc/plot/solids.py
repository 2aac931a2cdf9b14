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
from ..record.units import length_unit, place_unit
from .crack import Colours

# Where it is looked at from, degrees about z and above the plane.
TURNED, ABOVE = -60.0, 25.0


class Solid:
    """What an animation draws of a body: all of its surface, from one side, without perspective.

    Parameters
    ----------
    body : FiniteElementModel
        With elements.
    """

    magnified, gap = "displacement", "widest gap"

    def __init__(self, body: FiniteElementModel):
        self.places, self.faces = body.places, surface(body.elements)
        self.half = 0.5 * float(np.ptp(body.places, axis=0).max())
        a, b = np.radians(TURNED), np.radians(ABOVE)
        self.view = np.array(
            [
                [-np.sin(a), np.cos(a), 0.0],
                [-np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)],
                [np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)],  # towards the eye
            ]
        )

    def largest(self, states: Sequence[np.ndarray]) -> float:
        """Largest displacement, m."""
        return max(float(np.linalg.norm(state, axis=1).max()) for state in states)

    def colours(self, states: Sequence[np.ndarray]) -> Colours:
        """One scale of colours for several states."""
        factor, name = length_unit(top := self.largest(states))
        return Colours(Normalize(0.0, (top or 1.0) * factor), factor, f"displacement ({name})", more=False)

    def frame(self, axes: Axes) -> None:
        """Axes without a scale, but for the length that is said."""
        scale, unit = place_unit(2.0 * self.half)
        axes.set_aspect("equal")
        axes.margins(0.15)
        axes.set(xticks=[], yticks=[])
        axes.set_xlabel(f"length {2.0 * self.half * scale:.4g} {unit}")
        axes.update_datalim(self.places @ self.view[:2].T)
        axes.autoscale_view()

    def paint(
        self, axes: Axes, state: np.ndarray, outline: Any, row: int, *, factor: float, colours: Colours
    ) -> list[Any]:
        """Draw a state, displacements times `factor`, what is nearer over what is behind."""
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
