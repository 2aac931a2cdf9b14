"""What must hold of a boundary mesh besides its topology: star-convex elements, contact pairs, cracks, "
"tips."""

from __future__ import annotations

import numpy as np

from meshing.gll import gll_nodes, lagrange_slopes
from meshing.mesh_arrays import MeshArrays

_UNIT = 1e-6  # how far a unit vector's length may be from one
_PLACE = 1e-6  # how far a tip may be from its element's centre, relative to the mesh's extent
_FOLDED = 1e-12  # smallest swept area, relative to the square of the edge's distance from the centre


class BadMesh(ValueError):
    """Arrays that do not describe a boundary mesh."""


def check_contents(mesh: MeshArrays) -> None:
    """Check the parts of a mesh whose shapes are known to fit.

    Raises
    ------
    BadMesh
        Arrays of another kind of number; elements that do not lie around their scaling centre; pairs of a
        node with itself, normals that are no unit vectors, gaps and positions that are negative, weights that
        are not positive, or any of them not finite; cracks and tips with such numbers, or whose element is
        none, closed or elsewhere.
    """
    _check_kinds(mesh)
    _check_centres(mesh)
    _check_pairs(mesh)
    _check_tips(mesh)


def _fail(what: str) -> None:
    raise BadMesh(f"boundary mesh: {what}.")


def _check_kinds(mesh: MeshArrays) -> None:
    integers = ("edges", "element_start", "element_edges", "materials")
    for name, kind, values in (
        *((name, "iu", getattr(mesh, name)) for name in integers),
        *((name, "b", getattr(mesh, name)) for name in ("element_reversed", "closed")),
        *((name, "f", getattr(mesh, name)) for name in ("nodes", "scaling_centres")),
        *((f"pairs.{name}", "iu", getattr(mesh.pairs, name)) for name in ("nodes", "crack")),
        *((f"pairs.{name}", "f", getattr(mesh.pairs, name)) for name in ("normal", "gap", "position")),
        *((f"edge set {name!r}", "iu", np.asarray(edges)) for name, edges in mesh.edge_sets.items()),
    ):
        if values.size and values.dtype.kind not in kind:
            what = {"iu": "whole numbers", "b": "true and false", "f": "floating-point numbers"}[kind]
            _fail(f"{name} holds {values.dtype}, {what} were expected")


def _check_centres(mesh: MeshArrays) -> None:
    """Each edge is passed counter-clockwise as seen from the scaling centre."""
    if not np.isfinite(mesh.scaling_centres).all():
        _fail("scaling_centres holds numbers that are not finite")
    element = np.repeat(np.arange(mesh.elements), np.diff(mesh.element_start))
    edges = mesh.edges[mesh.element_edges]
    at = mesh.nodes[edges] - mesh.scaling_centres[element][:, None]
    along = lagrange_slopes(gll_nodes(mesh.order), gll_nodes(mesh.order)) @ at
    swept = at[..., 0] * along[..., 1] - at[..., 1] * along[..., 0]
    swept = np.where(mesh.element_reversed, -1.0, 1.0)[:, None] * swept
    wrong = np.flatnonzero(
        (swept <= _FOLDED * (at**2).sum(axis=2).max(axis=1, initial=0)[:, None]).any(axis=1)
    )
    if len(wrong):
        x, y = mesh.scaling_centres[element[wrong[0]]]
        _fail(
            f"S-element {element[wrong[0]]} does not lie around its scaling centre ({x:.6g}, {y:.6g}) m: it "
            "is not star-convex"
        )


def _check_pairs(mesh: MeshArrays) -> None:
    pairs = mesh.pairs
    if not len(pairs):
        return
    same = np.flatnonzero(pairs.nodes[:, 0] == pairs.nodes[:, 1])
    if len(same):
        _fail(f"contact pair {same[0]} joins node {pairs.nodes[same[0], 0]} to itself")
    lengths = np.hypot(*pairs.normal.T)
    wrong = np.flatnonzero(~(np.abs(lengths - 1.0) <= _UNIT))
    if len(wrong):
        _fail(f"the normal of contact pair {wrong[0]} has the length {lengths[wrong[0]]:.6g}, not 1")
    for name, values, least, most in (
        ("gap", pairs.gap, 0.0, np.inf),
        ("position", pairs.position, -_UNIT, 1.0 + _UNIT),
        ("arc", pairs.arc, 0.0, np.inf),
        ("weight", pairs.weight, np.finfo(float).tiny, np.inf),
    ):
        wrong = np.flatnonzero(~((values >= least) & (values <= most)))
        wrong = np.union1d(wrong, np.flatnonzero(~np.isfinite(values)))
        if len(wrong):
            _fail(f"the {name} of contact pair {wrong[0]} is {values[wrong[0]]}")


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
        if not (isinstance(tip.arc, tuple) and len(tip.arc) == 2 and all(_is_number(v) for v in tip.arc)):
            _fail(f"the arc of tip {tip.name!r} is {tip.arc!r}, two finite numbers were expected")
        for face in tip.faces:
            if face not in mesh.edge_sets:
                _fail(f"tip {tip.name!r} has the face {face!r}, which is no edge set")


def _check_tip(mesh: MeshArrays, what: str, tip, axis, opening: float, element: int) -> None:
    for name, vector in (("tip", tip), ("axis", axis)):
        if not (isinstance(vector, tuple) and len(vector) == 2 and all(_is_number(v) for v in vector)):
            _fail(f"the {name} of {what} is {vector!r}, two finite numbers were expected")
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


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.floating)) and bool(np.isfinite(value))
