"""The checker of boundary meshes: arrays that fit together, a topology, star-convex elements, contact pairs,
cracks and tips.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import NoReturn

import numpy as np

from meshing.gll import gll_nodes, lagrange_slopes
from meshing.mesh_arrays import MeshArrays
from meshing.vectors import cross

_UNIT = 1e-6  # how far a unit vector's length may be from one
_PLACE = 1e-6  # how far a tip may be from its element's centre, relative to the mesh's extent
_FOLDED = 1e-12  # smallest swept area, relative to the square of the edge's distance from the centre


class BadMesh(ValueError):
    """Arrays that do not describe a boundary mesh."""


def check_mesh(mesh: MeshArrays) -> None:
    """Check that a mesh's arrays describe one.

    Raises
    ------
    BadMesh
        Arrays of other shapes or kinds of numbers than they are documented to have, or that refer to what
        does not exist; elements whose edges are not a chain or loop, or do not lie around their scaling
        centre; edges used by more than two elements or twice in the same direction; pairs of a node with
        itself, normals that are no unit vectors, gaps and positions that are negative, weights that are not
        positive; cracks and tips with such numbers, or whose element is none, closed or elsewhere.
    """
    elements, uses = len(mesh.closed), len(mesh.element_edges)
    sizes = {"2": 2, "points": mesh.order + 1, "starts": elements + 1, "ends": uses + 1}
    sizes |= {"elements": elements, "uses": uses, "materials": len(mesh.material_names)}
    sizes |= {name: len(getattr(mesh, name)) for name in ("nodes", "edges", "pairs", "cracks")}
    if mesh.order < 1:
        _fail(f"its order is {mesh.order}, at least 1 was expected")
    for name, values, shape, of in _arrays(mesh):
        _check_array(name, values, shape, of, sizes)
    _check_chains(mesh)
    _check_uses(mesh)
    _check_centres(mesh)
    _check_pairs(mesh)
    _check_tips(mesh)


def _fail(what: str) -> NoReturn:
    raise BadMesh(f"boundary mesh: {what}.")


def _arrays(mesh: MeshArrays) -> Iterator[tuple[str, np.ndarray, str, str]]:
    """Name, numbers, shape ("any" for any length) and what they refer to."""
    for owner, prefix in ((mesh, ""), (mesh.pairs, "pairs.")):
        for item in fields(owner):
            if told := item.metadata:
                yield prefix + item.name, getattr(owner, item.name), told["shape"], told["of"]
    for key, edges in mesh.edge_sets.items():
        yield f"edge set {key!r}", np.asarray(edges), "any", "edges"
    for element, sectors in mesh.sector_materials.items():
        yield f"sector_materials of S-element {element}", np.asarray(sectors), "any", "materials"
    for name, numbers, of in (
        ("points", [*mesh.points.values()], "nodes"),
        ("sector_materials", [*mesh.sector_materials], "elements"),
        ("tips.crack", [tip.crack for tip in mesh.tips], "cracks"),
        ("tips.element", [max(tip.element, 0) for tip in mesh.tips], "elements"),
    ):
        yield name, np.array(numbers, int), "any", of


def _check_array(name: str, values: np.ndarray, shape: str, of: str, sizes: dict[str, int]) -> None:
    wanted = tuple(values.size if axis == "any" else sizes[axis] for axis in shape.split())
    if values.shape != wanted:
        order = f" for order {sizes['points'] - 1}" if "points" in shape else ""
        _fail(f"{name} has the shape {values.shape}, {wanted} was expected{order}")
    kinds = {"": ("f", "floating-point numbers"), "truth": ("b", "true and false")}
    kind, what = kinds.get(of, ("iu", "whole numbers"))
    if values.size and values.dtype.kind not in kind:
        _fail(f"{name} holds {values.dtype}, {what} were expected")
    if not of and not np.isfinite(values).all():
        _fail(f"{name} holds numbers that are not finite")
    if kind == "iu" and values.size and (values.min() < 0 or values.max() >= sizes[of]):
        number = values.min() if values.min() < 0 else values.max()
        _fail(f"{name} refers to number {number}, 0 to {sizes[of] - 1} exist")


def _check_chains(mesh: MeshArrays) -> None:
    """The edges of an element follow one another, and end where they began if it is closed."""
    start, flat = mesh.element_start, mesh.element_edges
    if start[0] != 0 or start[-1] != len(flat) or (np.diff(start) < 1).any():
        _fail("element_start and element_edges do not fit together")
    for element, sectors in mesh.sector_materials.items():
        if len(sectors) != start[element + 1] - start[element]:
            _fail(f"sector_materials of S-element {element} are not one for each of its edges")
    first = np.where(mesh.element_reversed, mesh.edges[flat, -1], mesh.edges[flat, 0])
    last = np.where(mesh.element_reversed, mesh.edges[flat, 0], mesh.edges[flat, -1])
    inner = np.ones(len(flat), bool)
    inner[start[1:] - 1] = False
    broken = np.flatnonzero(inner & (last != np.roll(first, -1)))
    if len(broken):
        _fail(f"the edges of S-element {np.searchsorted(start, broken[0], side='right') - 1} are not a chain")
    wrong = np.flatnonzero((last[start[1:] - 1] == first[start[:-1]]) != mesh.closed)
    if len(wrong):
        _fail(f"S-element {wrong[0]} is marked closed but its edges are no loop, or the other way round")


def _check_uses(mesh: MeshArrays) -> None:
    """An edge is one element's, or two elements' in opposite directions."""
    uses = np.bincount(mesh.element_edges, minlength=len(mesh.edges))
    direction = np.where(mesh.element_reversed, -1.0, 1.0)
    same_way = np.bincount(mesh.element_edges, weights=direction, minlength=len(mesh.edges))
    wrong = np.flatnonzero((uses > 2) | ((uses == 2) & (same_way != 0)))
    if len(wrong):
        _fail(f"edge {wrong[0]} is used {uses[wrong[0]]} times or twice in the same direction")


def _check_centres(mesh: MeshArrays) -> None:
    """Each edge is passed counter-clockwise as seen from the scaling centre."""
    element = np.repeat(np.arange(mesh.elements), np.diff(mesh.element_start))
    edges = mesh.edges[mesh.element_edges]
    at = mesh.nodes[edges] - mesh.scaling_centres[element][:, None]
    along = lagrange_slopes(gll_nodes(mesh.order), gll_nodes(mesh.order)) @ at
    swept = np.where(mesh.element_reversed, -1.0, 1.0)[:, None] * cross(at, along)
    least = _FOLDED * (at**2).sum(axis=2).max(axis=1, initial=0)
    wrong = np.flatnonzero((swept <= least[:, None]).any(axis=1))
    if len(wrong):
        x, y = mesh.scaling_centres[element[wrong[0]]]
        _fail(
            f"S-element {element[wrong[0]]} does not lie around its scaling centre ({x:.6g}, {y:.6g}) m: it "
            "is not star-convex"
        )


def _check_pairs(mesh: MeshArrays) -> None:
    pairs = mesh.pairs
    same = np.flatnonzero(pairs.nodes[:, 0] == pairs.nodes[:, 1])
    if len(same):
        _fail(f"contact pair {same[0]} joins node {pairs.nodes[same[0], 0]} to itself")
    for name, values, least, most in (
        ("length of the normal", np.hypot(*pairs.normal.T), 1.0 - _UNIT, 1.0 + _UNIT),
        ("gap", pairs.gap, 0.0, np.inf),
        ("position", pairs.position, -_UNIT, 1.0 + _UNIT),
        ("arc", pairs.arc, 0.0, np.inf),
        ("weight", pairs.weight, np.finfo(float).tiny, np.inf),
    ):
        wrong = np.flatnonzero((values < least) | (values > most))
        if len(wrong):
            value = values[wrong[0]]
            _fail(f"the {name} of contact pair {wrong[0]} is {value:.6g}, not {least:.6g} to {most:.6g}")


def _check_tips(mesh: MeshArrays) -> None:
    names = [crack.name for crack in mesh.cracks]
    for what, items in (("cracks", names), ("tips", [tip.name for tip in mesh.tips])):
        if len(set(items)) < len(items):
            _fail(f"two {what} have the name {next(name for name in items if items.count(name) > 1)!r}")
    for crack in mesh.cracks:
        _check_tip(mesh, f"crack {crack.name!r}", crack.tip, crack.axis, crack.opening, crack.tip_element)
        if not (_is_number(crack.length) and crack.length > 0):
            _fail(f"the length of crack {crack.name!r} is {crack.length!r}")
    for tip in mesh.tips:
        _check_tip(mesh, f"tip {tip.name!r}", tip.position, tip.axis, tip.opening, tip.element)
        _check_two(f"arc of tip {tip.name!r}", tip.arc)
        for face in tip.faces:
            if face not in mesh.edge_sets:
                _fail(f"tip {tip.name!r} has the face {face!r}, which is no edge set")


def _check_tip(mesh: MeshArrays, what: str, tip, axis, opening: float, element: int) -> None:
    for name, vector in (("tip", tip), ("axis", axis)):
        _check_two(f"{name} of {what}", vector)
    if abs(np.hypot(*axis) - 1.0) > _UNIT:
        _fail(f"the axis of {what} has the length {np.hypot(*axis):.6g}, not 1")
    if not (_is_number(opening) and 0 <= opening < 2 * np.pi):
        _fail(f"the opening of {what} is {opening!r} rad")
    if element < -1 or element >= mesh.elements:
        _fail(f"{what} has the S-element {element}, 0 to {mesh.elements - 1} exist")
    if element >= 0:
        if mesh.closed[element]:
            _fail(f"{what} has the S-element {element}, which is closed; an open one was expected")
        if np.abs(mesh.scaling_centres[element] - tip).max() > _PLACE * np.ptp(mesh.nodes, axis=0).max():
            _fail(f"{what} is not at the scaling centre of its S-element {element}")


def _check_two(what: str, values: object) -> None:
    if not (isinstance(values, tuple) and len(values) == 2 and all(map(_is_number, values))):
        _fail(f"the {what} is {values!r}, two finite numbers were expected")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.floating)) and bool(np.isfinite(value))
