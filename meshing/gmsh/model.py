"""What a file holds, as plain data: the child process' answer."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Block:
    """Elements of one type in one entity.

    Attributes
    ----------
    dimension, entity : int
    name : str
        gmsh's name of the type.
    order, corners : int
        Of the elements; a line has two corners.
    nodes : (n, count) int array
        Node tags, corners first.
    """

    dimension: int
    entity: int
    name: str
    order: int
    corners: int
    nodes: np.ndarray


@dataclass(frozen=True)
class FileModel:
    """A user's model as it was read, coordinates in m.

    Attributes
    ----------
    geometry : bool
        It was meshed here; `curved_points` then lie on the true curves.
    unnamed : bool
        The format has no groups; all names are made from numbers.
    groups : list of (int, str, list of int)
        Dimension, name and entities of each physical group.
    empty : list of (int, str)
        Dimension and name of groups that hold nothing.
    skipped : list of (int, int, str)
        Dimension and number of entities that do not exist, and the group that names them.
    log : list of str
        gmsh's warnings.
    merged_step : str or None
        A STEP file that a script reads, whose lengths gmsh converts to m.
    where : dict of int to (3,) array
        Positions of the nodes by tag, m.
    blocks : list of Block
    points : dict of int to list of int
        Node tags of each point entity.
    curved_ends : (n, 2) int array
        Node tags of the line elements on curved geometry.
    curved_points : (n, order + 1, 2) array
        GLL nodes on the true curve, m.
    whole : dict of int to list of int or None
        Surfaces that are one S-element each, and the curves around those of a geometry, negative where they
        run the other way.
    sizes : dict of int to float
        Sizes that a geometry gives at points, by their node tags, m.
    """

    geometry: bool
    unnamed: bool
    groups: list[tuple[int, str, list[int]]]
    empty: list[tuple[int, str]]
    skipped: list[tuple[int, int, str]]
    log: list[str]
    merged_step: str | None
    where: dict[int, np.ndarray]
    blocks: list[Block]
    points: dict[int, list[int]]
    curved_ends: np.ndarray
    curved_points: np.ndarray
    whole: dict[int, list[int] | None] = field(default_factory=dict)
    sizes: dict[int, float] = field(default_factory=dict)

    def entities(self, dimension: int) -> dict[str, list[int]]:
        """Entities of the groups of a dimension by the groups' names."""
        found: dict[str, list[int]] = {}
        for own, name, entities in self.groups:
            if own == dimension:
                known = found.setdefault(name, [])
                known += [entity for entity in entities if entity not in known]
        return found

    def blocks_of(self, dimension: int, entity: int) -> list[Block]:
        """Elements of an entity."""
        return self._blocks.get((dimension, entity), [])

    @cached_property
    def _blocks(self) -> dict[tuple[int, int], list[Block]]:
        found: dict[tuple[int, int], list[Block]] = {}
        for block in self.blocks:
            found.setdefault((block.dimension, block.entity), []).append(block)
        return found


def from_answer(told: dict[str, Any], arrays: dict[str, np.ndarray], scale: float) -> FileModel:
    """The answer of `meshing.gmsh.describe`, and of who opened a file, its lengths times `scale`."""
    positions = arrays["node_positions"] * scale
    if len(positions):  # z from round-off, e.g. of a rotation, is none
        flat = np.abs(positions[:, 2]) <= 1e-9 * np.ptp(positions, axis=0).max()
        positions[flat, 2] = 0.0
    points = {int(tag): nodes for tag, nodes in told["points"].items()}
    outlines = told.get("outlines") or [None] * len(told.get("whole", ()))
    return FileModel(
        geometry=bool(told["geometry"]),
        unnamed=bool(told.get("unnamed")),
        groups=[(int(d), str(name), [int(e) for e in entities]) for d, name, entities in told["groups"]],
        empty=[(int(d), str(name)) for d, name in told.get("empty", ())],
        skipped=[(int(d), int(entity), str(name)) for d, entity, name in told.get("skipped", ())],
        log=[str(line) for line in told.get("log", ())],
        merged_step=told.get("merged_step"),
        where=dict(zip(arrays["node_tags"].tolist(), positions)),
        blocks=[
            Block(dimension, entity, name, order, corners, arrays[f"block{i}"])
            for i, (dimension, entity, name, order, corners) in enumerate(told["blocks"])
        ],
        points=points,
        curved_ends=arrays.get("curved_ends", np.zeros((0, 2), int)),
        curved_points=arrays.get("curved_points", np.zeros((0, 2, 2))) * scale,
        whole=dict(zip(told.get("whole", ()), outlines)),
        sizes={
            node: size * scale
            for tag, size in told.get("sizes", {}).items()
            for node in points.get(int(tag), ())
        },
    )
