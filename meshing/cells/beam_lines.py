"""Blocks of a beam with cracks that are no notches from its top edge: gmsh fills the whole block."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from meshing.cells.arrangement import CrackPath, arrange
from meshing.cells.beam_layout import Block, Feature
from meshing.cells.crack_meshing import CrackMeshing
from meshing.cells.crack_opening import open_cracks
from meshing.cells.crack_splitting import add_cracks
from meshing.cells.plate_cells import add_circle
from meshing.cells.region import divide_line, fill_region, plan_region
from meshing.cells.skeleton import Skeleton
from meshing.shapes.features import CrackLine, VNotch


class BlockRegion:
    """A block with its cracks as a plane graph."""

    def __init__(self, skeleton: Skeleton, block: Block) -> None:
        beam = skeleton.beam
        self.skeleton, self.block = skeleton, block
        corners = [(block.low, 0.0), (block.high, 0.0), (block.high, beam.height), (block.low, beam.height)]
        self.corners = [skeleton.vertex(*corner) for corner in corners]
        # What neighbours and users have put on the sides is there already.
        sides = skeleton.chain([*self.corners, self.corners[0]])[:-1]
        given = {f"side {v}": skeleton.cells.vertices[v] for v in sides}
        given |= {name: skeleton.inputs.points[name] for name in block.inner_points}
        self.holes = [f for f in block.features if not f.is_notch and not f.is_line]
        self.cracks: list[CrackPath] = []
        self.openings: dict[str, float] = {}
        self.mouths: dict[str, Feature] = {}
        names = beam.crack_names()
        for feature in block.features:
            shape = feature.shape
            if isinstance(shape, VNotch):
                name = names[feature.index]
                mouth = np.add(feature.centre, np.multiply(shape.axis, shape.length))
                mouth[1] = beam.height if shape.edge == "top" else 0.0
                self.cracks.append(CrackPath(name, np.array([feature.centre, mouth])))
                self.mouths[name] = feature
            elif isinstance(shape, CrackLine):
                name = names[len(beam.notches) + feature.index]
                self.cracks.append(CrackPath(name, np.array(shape.points[::-1])))
            else:
                continue
            self.openings[name] = shape.opening
        circles = [((f.hole.x, f.hole.y), f.hole.radius) for f in self.holes]
        self.body = arrange(np.array(corners), circles, self.cracks, given)
        self.plan = plan_region(self.body, skeleton.edge_limit)
        self.lines: list[list[int]] = []

    def divide_sides(self) -> None:
        """Put vertices on the block's sides."""
        for side in self.body.sides:
            for a, b in pairwise(side):
                start, stop = (np.array(self.body.vertices[v]) for v in (a, b))
                for place in [start, *divide_line(start, stop, self.plan.sizes), stop]:
                    self.skeleton.vertex(*map(float, place))

    def fill(self) -> None:
        """Make the cells."""
        cells, skeleton = self.skeleton.cells, self.skeleton
        vertex_of = {v: skeleton.vertex(*self.body.vertices[v]) for side in self.body.sides for v in side}
        loops = [skeleton.chain([*self.corners, self.corners[0]])[:-1]]
        for number, feature in enumerate(self.holes):
            loops.append(add_circle(cells, self.body, self.plan, number, vertex_of))
            edges = list(zip(loops[-1], loops[-1][1:] + loops[-1][:1]))
            cells.edge_sets[f"hole{feature.index + 1}"] = edges
        self.lines = fill_region(cells, loops, self.body, self.plan, vertex_of)
        for name in self.block.inner_points:
            cells.points[name] = vertex_of[self.body.points[name]]


def add_lines(skeleton: Skeleton, regions: list[BlockRegion]) -> None:
    """Separate the faces of the cracks of all such blocks; the cracks are put in the beam's order."""
    cells, inputs, beam = skeleton.cells, skeleton.inputs, skeleton.beam
    groups = {
        f"crack:{crack.name}": list(pairwise(line))
        for region in regions
        for crack, line in zip(region.cracks, region.lines)
    }
    meshing = CrackMeshing(
        tip_size=inputs.tip_size,
        grading=inputs.grading,
        face_size=inputs.face_size,
        face_edges=inputs.face_edges,
    )
    add_cracks(cells, groups, meshing, "beam")
    open_cracks(cells, {name: angle for region in regions for name, angle in region.openings.items()})
    order = {name: place for place, name in enumerate(beam.crack_names())}
    cells.cracks.sort(key=lambda faces: order[faces.name])
    for region in regions:
        for name, feature in region.mouths.items():
            faces = next(faces for faces in cells.cracks if faces.name == name)
            faces.length = feature.notch.length
            start = faces.paths[0].start
            ends = [cells.points.pop(f"{name}_{side}", -1) for side in ("right", "left")]
            if start is None or -1 in ends:
                raise ValueError(f"beam: another crack meets {name!r}; draw notches that meet as cracks.")
            start.axis = feature.notch.axis
            if feature.notch.edge == "bottom":
                ends.reverse()
            suffix = str(feature.index + 1) if feature.index else ""
            cells.points[f"B{suffix}"], cells.points[f"C{suffix}"] = ends
