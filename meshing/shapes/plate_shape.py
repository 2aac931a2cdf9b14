"""The geometry of a plane body with a polygon as its outline, validated."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import shapely

from meshing.input_checks import check_fields, said, shown
from meshing.shapes.features import CrackLine, Hole, corners_of, described, lists_of, refuse_close

_FARTHEST = 3e6  # coordinates, relative to the body's diagonal


@dataclass(frozen=True)
class PlateShape:
    """What describes a plate; `meshing.Plate` adds the mesh."""

    outline: Sequence[tuple[float, float]] = field(
        metadata=said('corners counter-clockwise; its sides are the edge sets "edge1", "edge2", ...', "m")
    )
    holes: Sequence[Hole] = field(default=(), metadata=said("holes"))
    cracks: Sequence[CrackLine] = field(default=(), metadata=said("cracks"))
    edge_names: tuple[str, ...] | None = field(
        default=None,
        metadata=said(
            'edge set of each side in the outline\'s order; sides may share one; default "edge1", ...'
        ),
    )

    def __post_init__(self) -> None:
        lists = lists_of(holes=Hole, cracks=CrackLine)
        check_fields(self, "Plate", {"outline": partial(corners_of, least=3), **lists})
        self._check_outline()
        self._check_names()
        self._check_holes()

    def __repr__(self) -> str:
        low, high = np.min(self.outline, axis=0), np.max(self.outline, axis=0)
        sides = f"{len(self.outline)} sides in [{low[0]:g}, {high[0]:g}] x [{low[1]:g}, {high[1]:g}] m"
        return f"Plate({sides}{described(holes=self.holes, cracks=self.cracks)})"

    @property
    def area(self) -> float:
        """Area of the material with closed cracks, m2."""
        return shapely.Polygon(self.outline).area - sum(math.pi * hole.radius**2 for hole in self.holes)

    @property
    def diagonal(self) -> float:
        """Of the bounding box, m."""
        return float(np.hypot(*np.ptp(np.array(self.outline), axis=0)))

    @property
    def side_names(self) -> tuple[str, ...]:
        """Edge set of each side of the outline."""
        return self.edge_names or tuple(f"edge{i}" for i in range(1, len(self.outline) + 1))

    def crack_names(self) -> tuple[str, ...]:
        """Of all cracks in order."""
        return tuple(crack.name or f"crack{i}" for i, crack in enumerate(self.cracks, 1))

    def _check_outline(self) -> None:
        corners = np.array(self.outline)
        away = float(np.abs(corners).max())
        if not away <= _FARTHEST * self.diagonal:
            raise ValueError(
                f"Plate: the outline of size {self.diagonal:g} m reaches to {away:g} m from the origin, more "
                f"than {_FARTHEST:g} times as far, where coordinates have too few digits; move it to the "
                "origin."
            )
        least = 1e-6 * self.diagonal
        for i, (first, second) in enumerate(zip(corners, np.roll(corners, -1, axis=0)), 1):
            if math.dist(first, second) <= least:
                raise ValueError(
                    f"Plate: corners {i} and {i % len(corners) + 1} of the outline coincide at "
                    f"({first[0]:g}, {first[1]:g}) m; leave one out (the first corner is not repeated)."
                )
        ring = shapely.LinearRing(corners)
        if not ring.is_simple or not shapely.Polygon(corners).is_valid:
            reason = shapely.is_valid_reason(shapely.Polygon(corners))
            where = reason[reason.find("[") :] if "[" in reason else ""
            raise ValueError(
                f"Plate: the outline crosses or touches itself {where}; give its corners in order."
            )
        if not ring.is_ccw:
            raise ValueError("Plate: the outline runs clockwise; give its corners counter-clockwise.")

    def _check_names(self) -> None:
        if self.edge_names is not None:
            if isinstance(self.edge_names, str) or not isinstance(self.edge_names, (list, tuple)):
                raise TypeError(
                    f"Plate: edge_names is {shown(self.edge_names)}, a list of names was expected."
                )
            names = tuple(self.edge_names)
            if len(names) != len(self.outline) or not all(isinstance(n, str) and n for n in names):
                raise ValueError(
                    f"Plate: edge_names has {len(names)} entries {list(names)!r}, a name for each of the "
                    f"{len(self.outline)} sides was expected (sides may share one)."
                )
            object.__setattr__(self, "edge_names", names)
        faces = [f"{crack}_{side}" for crack in self.crack_names() for side in ("left", "right")]
        holes = [f"hole{i}" for i in range(1, len(self.holes) + 1)]
        taken = [*self.crack_names(), *dict.fromkeys(self.side_names), *holes, *faces]
        for name, count in Counter(taken).items():
            if count > 1:
                raise ValueError(f"Plate: the name {name!r} is given twice; choose another.")

    def _check_holes(self) -> None:
        body = shapely.Polygon(self.outline)
        edge = body.exterior
        centres = shapely.points([(hole.x, hole.y) for hole in self.holes] or np.zeros((0, 2)))
        for i, (hole, centre) in enumerate(zip(self.holes, centres), 1):
            gap = edge.distance(centre) - hole.radius
            if not body.contains(centre) or gap < hole.wall(self.diagonal):
                raise ValueError(
                    f"Plate: hole {i} ({hole!r}) leaves or touches the outline or leaves too thin a wall; "
                    "move it inside or make it smaller."
                )
        refuse_close("Plate: ", [], self.holes, self.diagonal)
