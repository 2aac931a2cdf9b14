"""What a file or gmsh holds, as plain data; also the answer of the child process that reads a file."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np


class Block(NamedTuple):
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
    """A user's model as it was read, or a drawing as gmsh has meshed it.

    Attributes
    ----------
    geometry : bool
        gmsh has meshed it here; `curved_points` then lie on the true curves.
    groups : list of (int, str, list of int)
        Dimension, name and entities of each physical group.
    blocks : list of Block
    node_tags : (n,) int array
    node_positions : (n, 3) array
        Of these nodes, m.
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
    unnamed : bool
        The format has no groups; all names are made from numbers.
    empty : list of (int, str)
        Dimension and name of groups that hold nothing.
    skipped : list of (int, int, str)
        Dimension and number of entities that do not exist, and the group that names them.
    log : list of str
        gmsh's warnings.
    merged_step : str or None
        A STEP file that a script reads, whose lengths gmsh converts to m.
    """

    geometry: bool
    groups: list[list[Any]]
    blocks: list[Block]
    node_tags: np.ndarray
    node_positions: np.ndarray
    points: dict[int, list[int]]
    curved_ends: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    curved_points: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 2)))
    whole: dict[int, list[int] | None] = field(default_factory=dict)
    sizes: dict[int, float] = field(default_factory=dict)
    unnamed: bool = False
    empty: list[list[Any]] = field(default_factory=list)
    skipped: list[list[Any]] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    merged_step: str | None = None

    def packed(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Facts that JSON knows, and arrays."""
        told = {item.name: getattr(self, item.name) for item in fields(self)}
        arrays = {name: told.pop(name) for name in list(told) if isinstance(told[name], np.ndarray)}
        told["blocks"] = [block[:-1] for block in self.blocks]
        return told, arrays | {f"block{i}": block.nodes for i, block in enumerate(self.blocks)}

    @classmethod
    def unpacked(cls, told: dict[str, Any], arrays: dict[str, np.ndarray], scale: float) -> FileModel:
        """The model that was packed, its lengths times `scale`."""
        blocks = [Block._make([*facts, arrays.pop(f"block{i}")]) for i, facts in enumerate(told["blocks"])]
        by_tag = {
            name: {int(tag): value for tag, value in told[name].items()}
            for name in ("points", "whole", "sizes")
        }
        by_tag["sizes"] = {tag: size * scale for tag, size in by_tag["sizes"].items()}
        for name in ("node_positions", "curved_points"):
            arrays[name] = arrays[name] * scale
        positions = arrays["node_positions"]
        if len(positions):  # z from round-off, e.g. of a rotation, is none
            flat = np.abs(positions[:, 2]) <= 1e-9 * np.ptp(positions, axis=0).max()
            positions[flat, 2] = 0.0
        return cls(**{**told, **arrays, **by_tag, "blocks": blocks})

    @cached_property
    def where(self) -> dict[int, np.ndarray]:
        """Positions of the nodes by tag, m."""
        return dict(zip(self.node_tags.tolist(), self.node_positions))

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
