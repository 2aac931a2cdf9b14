"""Faces that were drawn apart: two bodies with meshes of their own, given gaps, lines that close."""

import re

import numpy as np
import pytest

from meshing import Beam, CrackLine, Plate, VNotch, read_gmsh

# A roller of radius 1 above a block, each with points and sizes of its own.
ROLLER = """
Point(1)={{0,{y},0,{f}}}; Point(2)={{Sin({a}),{y}+1-Cos({a}),0,{f}}}; Point(3)={{1,{y}+1,0,0.5}};
Point(4)={{0,{y}+1,0,0.5}};
Circle(1)={{1,4,2}}; Circle(2)={{2,4,3}}; Line(3)={{3,4}}; Line(4)={{4,1}};
Curve Loop(1)={{1:4}}; Plane Surface(1)={{1}};
Point(11)={{{x},0,0,{g}}}; Point(12)={{{x}+0.8,0,0,{g}}}; Point(13)={{{x}+0.8,-1,0,0.5}};
Point(14)={{{x},-1,0,0.5}};
Line(11)={{11,12}}; Line(12)={{12,13}}; Line(13)={{13,14}}; Line(14)={{14,11}};
Curve Loop(2)={{11:14}}; Plane Surface(2)={{2}};
Physical Surface("roller")={{1}}; Physical Surface("block")={{2}};
Physical Curve("crack:c:{roller}")={{1}}; Physical Curve("crack:c:{block}")={{11}};
"""
DRAWN = {"y": 0, "f": 0.05, "g": 0.07, "a": 0.5, "x": 0, "roller": "right", "block": "left"}


def drawn(folder, **changes):
    path = folder / "roller.geo"
    path.write_text(ROLLER.format(**{**DRAWN, **changes}))
    return read_gmsh(path, order=4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, id="apart"),
        pytest.param({"g": 0.0502}, id="nearly alike", marks=pytest.mark.long),
        pytest.param({"roller": "left", "block": "right"}, id="other names", marks=pytest.mark.long),
        pytest.param({"y": 0.01}, id="gap"),
        pytest.param({"x": 0.2}, id="beside each other in part"),
        pytest.param({"f": 0.03, "g": 0.3}, id="coarse block", marks=pytest.mark.long),
    ],
)
def test_roller_on_a_block(tmp_path, changes):
    """Every pair's nodes lie above each other, on the circle and on the line; the gap is their distance along
    the normal that halves the angle between the faces.
    """
    mesh = drawn(tmp_path, **changes)
    pairs, y = mesh.pairs, changes.get("y", 0)
    roller, block = (pairs.nodes if "roller" not in changes else pairs.nodes[:, ::-1]).T
    upper, lower = mesh.nodes[roller], mesh.nodes[block]
    assert np.abs(upper[:, 0] - lower[:, 0]).max() < 1e-9
    assert np.abs(np.hypot(upper[:, 0], upper[:, 1] - y - 1) - 1).max() < 1e-9
    assert np.abs(lower[:, 1]).max() < 1e-12
    x = upper[:, 0]
    exact = (1 + y - np.sqrt(1 - x**2)) * np.cos(0.5 * np.arcsin(x))
    inner = pairs.weight > 0
    assert np.abs(pairs.gap - exact)[inner].max() < 2e-4  # the normals at coarse nodes are means
    assert x.min() == pytest.approx(changes.get("x", 0), abs=1e-9)
    assert x.max() == pytest.approx(min(np.sin(0.5), changes.get("x", 0) + 0.8), abs=1e-9)
    assert mesh.area == pytest.approx(0.8 + np.pi / 4, rel=1e-6)
    # no slivers: vertices that were nearly beside each other are
    ends = mesh.nodes[mesh.edges[mesh.edge_sets["c_right"]][:, [0, -1]]]
    assert np.hypot(*(ends[:, 1] - ends[:, 0]).T).min() > 0.2 * min(
        changes.get("f", 0.05), changes.get("g", 0.07)
    ) * (1 if len(changes) else 0.9)


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"y": -0.01}, "crack 'c': the faces overlap by 0.0"),
        ({"x": 0.6}, "share 0 end nodes and do not lie beside each other"),
        ({"a": 1.5}, "right face: near (0.9"),
    ],
)
def test_faces_that_do_not_face_each_other(tmp_path, changes, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        drawn(tmp_path, **changes)


def test_crack_that_closes_on_itself():
    """A loop has one pair for each of its places, and two at its corners."""
    corners = [(0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7), (0.3, 0.3)]
    mesh = Plate([(0, 0), (1, 0), (1, 1), (0, 1)], cracks=[CrackLine(corners)]).mesh(order=3)
    pairs = mesh.pairs
    assert pairs.weight.sum() == pytest.approx(1.6) and not mesh.tips
    assert np.linalg.norm(pairs.weight @ pairs.normal) < 1e-12
    rows = np.column_stack([pairs.nodes, np.round(pairs.normal, 6)])
    assert len(np.unique(rows, axis=0)) == len(rows)
    _, times = np.unique(pairs.nodes, axis=0, return_counts=True)
    assert (times == 2).sum() == 4 and times.max() == 2


def test_cracks_end_to_end():
    """A line drawn as two cracks has the pairs of one, but for where they are named."""
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    halves = [[(0.3, 0.5), (0.5, 0.5)], [(0.5, 0.5), (0.7, 0.5)]]
    mesh = Plate(square, cracks=[CrackLine(points) for points in halves]).mesh(order=3)
    assert len(np.unique(np.sort(mesh.pairs.nodes, axis=1), axis=0)) == len(mesh.pairs)
    inside = sum(np.abs(mesh.scaling_centres[tip.element] - tip.position).max() for tip in mesh.tips)
    assert inside == 0.0 and mesh.pairs.weight.sum() < 0.4


def test_given_gaps():
    """A number, a function and an array say the same; finer meshes ask the function again."""
    mesh = Beam(0.1, 0.01, [VNotch(0.05, 0.005, 0.0)]).mesh(order=3)
    assert (mesh.pairs.gap == 0).all()
    assert (mesh.with_gap("crack1", 1e-6).pairs.gap == 1e-6).all()
    wedge = mesh.with_gap("crack1", lambda x, y: 1e-3 * (y - 0.005))
    height = mesh.nodes[mesh.pairs.nodes[:, 0], 1] - 0.005
    assert wedge.pairs.gap == pytest.approx(1e-3 * height, abs=1e-15)
    assert (mesh.with_gap("crack1", 1e-3 * height).pairs.gap == wedge.pairs.gap).all()
    finer = wedge.recipe.remade({"order": 5})
    assert finer.order == 5
    assert finer.pairs.gap == pytest.approx(
        1e-3 * (finer.nodes[finer.pairs.nodes[:, 0], 1] - 0.005), abs=1e-15
    )
    for crack, gap, said in (
        ("c", 1.0, "crack 'c' does not exist; the mesh has 'crack1'"),
        ("crack1", -1.0, "is -1 m at pair 0; gaps are finite and not negative"),
        ("crack1", lambda x, y: np.nan * x, "is nan m at pair 0"),
        ("crack1", np.zeros(3), "has the shape (3,)"),
        ("crack1", lambda x: x, "failed as a function of arrays x and y: TypeError"),
        ("crack1", "wide", "a distance in m, a function of arrays x and y"),
        ("crack1", None, "a distance in m, a function of arrays x and y"),
    ):
        with pytest.raises((TypeError, ValueError), match=re.escape(said)):
            mesh.with_gap(crack, gap)
