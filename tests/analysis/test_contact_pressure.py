"""Contact pressure along cracks of any course: closed forms, and the stress beside the faces."""

import math

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, read_gmsh

MATERIAL = sb.Material(young=70e9, poisson=0.3, density=2700)
MEAN, SLOPE = 1e6, 0.8e6  # Pa, and Pa over the half-width
LENGTH = 12.0  # m, of a strip of the half-width 1; end effects have fallen to 1e-9 at the crack
CRACK = [(-0.6, 0.0), (0.2, 0.0)]  # from the strip's middle line


def turned(points, degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return [(c * x - s * y, s * x + c * y) for x, y in points]


def strip(degrees, backwards, kind, tmp_path):
    """A strip with a crack across it, and the two halves of each end as sides."""
    half = LENGTH / 2
    corners = [(-1, -half), (0, -half), (1, -half), (1, half), (0, half), (-1, half)]
    outline, line = turned(corners, degrees), turned(CRACK[::-1] if backwards else CRACK, degrees)
    if kind == "plate":
        body = Plate(outline, cracks=[CrackLine(line, name="c")])
        return body.mesh(size=0.8, points={"O": outline[0], "Q": outline[2]})
    path = tmp_path / "strip.geo"
    places = enumerate(outline + line, 1)
    points = [f"Point({k})={{{x:.17g},{y:.17g},0,{0.8 if k < 7 else 0.2}}};" for k, (x, y) in places]
    lines = [f'Line({k})={{{k},{k % 6 + 1}}}; Physical Curve("edge{k}")={{{k}}};' for k in range(1, 7)]
    rest = """Line(10)={7,8}; Curve Loop(1)={1:6}; Plane Surface(1)={1}; Curve{10} In Surface{1};
    Physical Curve("crack:c")={10}; Physical Surface("s")={1};
    Physical Point("O")={1}; Physical Point("Q")={3};
    """
    path.write_text("\n".join([*points, *lines, rest]))
    return read_gmsh(path, scale=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degrees", "backwards", "kind"),  # by either mesher the crack is drawn in each of eight directions
    [
        pytest.param(
            *(45 * k, (k // 2 % 2 == 0) == (kind == "gmsh"), kind),
            marks=[pytest.mark.long] * ((k + 2 * n) % 4 > 0),
        )
        for k in range(8)
        for n, kind in enumerate(("plate", "gmsh"))
    ],
)
def test_linear_pressure(degrees, backwards, kind, tmp_path):
    """Bending with compression does not notice a closed crack: the pressure is linear along it, counted from
    the tip that comes first by x, then y. Within 1e-6: what the ends leave.
    """
    mesh = strip(degrees, backwards, kind, tmp_path)
    # halves of the ends with the moment of the linear pressure
    loads = [
        sb.EdgeLoad(f"edge{edge}", pressure=MEAN + sign * SLOPE * 2.0 / 3.0)
        for edge, sign in ((1, -1.0), (2, 1.0), (4, 1.0), (5, -1.0))
    ]
    steep = abs(math.sin(math.radians(degrees))) > 0.7
    held = [sb.Support("O"), sb.Support("Q", x=steep, y=not steep)]  # three forces, which are zero
    model = sb.Model(mesh, MATERIAL, clamped=None, supports=held)
    place, pressure = sb.static(model, loads).contact_pressure("c")
    first, last = (x for x, _ in turned(sorted(turned(CRACK, degrees)), -degrees))
    exact = MEAN + SLOPE * np.interp(place, [0.0, 0.8], [first, last])
    assert place[0] == pytest.approx(0.0, abs=1e-12) and place[-1] == pytest.approx(0.8, rel=1e-12)
    assert np.abs(pressure / exact - 1.0).max() < 1e-6


# Lines of a crack one after the other as its pressure counts, each from its first tip; drawn in either sense.
PRESSED = 1e6  # Pa
SQUARE = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)]
KINKED = [(0.03, 0.045), (0.055, 0.05), (0.075, 0.07)]
SHALLOW = [(0.07, 0.035), (0.045, 0.05), (0.03, 0.07)]
BRANCHING = [[(0.03, 0.04), (0.05, 0.06)], [(0.07, 0.045), (0.05, 0.06)], [(0.05, 0.1), (0.05, 0.06)]]
THREE_TIPS = [[(0.03, 0.04), (0.05, 0.06)], [(0.04, 0.085), (0.05, 0.06)], [(0.07, 0.05), (0.05, 0.06)]]


def plate(line):
    return Plate(SQUARE, cracks=[CrackLine(line, name="c")]).mesh(order=9)


def beam(line):
    return Beam(0.1, 0.1, cracks=[CrackLine(line, name="c")]).mesh(order=9)


def branched(lines, path):
    """A gmsh model of the square with a crack of several lines, from one junction or mouth to the other."""
    corners = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.05, 0.1), (0.0, 0.1)]
    ends = [*dict.fromkeys(end for line in lines for end in line if end not in corners)]
    number = {place: k for k, place in enumerate(corners + ends, 1)}
    text = [f"Point({k})={{{x:.17g},{y:.17g},0,.01}};" for (x, y), k in number.items()]
    text += [f'Line({k})={{{k},{k % 5 + 1}}}; Physical Curve("s{k}")={{{k}}};' for k in range(1, 6)]
    drawn = [(number[first], number[last]) for first, last in lines]
    text += [f"Line({k})={{{a},{b}}};" for k, (a, b) in enumerate(drawn, 10)]
    chosen = ",".join(str(k) for k in range(10, 10 + len(lines)))
    text += ["Curve Loop(1)={1:5}; Plane Surface(1)={1};", f"Curve{{{chosen}}} In Surface{{1}};"]
    text += [f'Physical Curve("crack:c")={{{chosen}}}; Physical Surface("s")={{1}};', ""]
    path.write_text("\n".join(text))
    return read_gmsh(path, scale=1.0, order=9)


def places_of(lines, place):
    """Points of the lines, one after the other, at places (m), and unit normals there."""
    for line in lines:
        for first, last in zip(np.array(line), np.array(line)[1:]):
            length = math.dist(first, last)
            if place <= length * (1 + 1e-12):
                along = (last - first) / length
                return first + place * along, np.array([-along[1], along[0]])
            place -= length
    raise AssertionError("beyond the crack")


CASES = {
    "kinked": lambda path: (plate(KINKED), [KINKED]),
    "kinked, drawn backwards": lambda path: (plate(KINKED[::-1]), [KINKED]),
    "kinked upwards": lambda path: (plate(SHALLOW), [SHALLOW[::-1]]),
    "kinked upwards, drawn backwards": lambda path: (plate(SHALLOW[::-1]), [SHALLOW[::-1]]),
    "in a beam": lambda path: (beam(KINKED), [KINKED]),
    "in a beam, drawn backwards": lambda path: (beam(KINKED[::-1]), [KINKED]),
    "kinked, gmsh": lambda path: (branched([KINKED[:2], KINKED[1:]], path), [KINKED]),
    "branching": lambda path: (branched(BRANCHING, path), BRANCHING),
    "branching, lines in another order": lambda path: (branched(BRANCHING[::-1], path), BRANCHING),
    "branching, lines drawn backwards": lambda path: (
        branched([line[::-1] for line in BRANCHING[:2]] + BRANCHING[2:], path),
        BRANCHING,
    ),
    "three tips": lambda path: (branched(THREE_TIPS[::-1], path), THREE_TIPS),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if k % 4 else ()) for k, name in enumerate(CASES)]
)
def test_pressure_next_to_each_tip(name, tmp_path):
    """The pressure inside each tip's S-element is the normal stress of the field at the same places, where a
    crack is not loaded alike along its course: 1e-3 of the pressure, of an S-element's angular resolution.
    """
    mesh, lines = CASES[name](tmp_path / "model.geo")
    (bottom,) = {"bottom", "edge1", "s1"} & set(mesh.edge_sets)
    model = sb.Model(mesh, MATERIAL, clamped=bottom, contact_laws=sb.Tied())  # closed under any load
    sides = {"top", "edge3", "s3", "s4", "left", "edge4", "s5"} & set(mesh.edge_sets)
    found = sb.static(model, [sb.EdgeLoad(side, pressure=PRESSED) for side in sorted(sides)])
    place, pressure = found.contact_pressure("c")
    assert place[0] == pytest.approx(0.0, abs=1e-12) and (np.diff(place) >= 0.0).all()
    starts = np.concatenate([[0.0], np.cumsum([sum(map(math.dist, line, line[1:])) for line in lines])])
    assert len(mesh.tips) == {1: 2, 3: 2 + (name == "three tips")}[len(lines)]
    for tip in mesh.tips:
        reach = abs(tip.arc[1] - tip.arc[0])
        line = next(k for k, ends in enumerate(lines) if tip.position in (ends[0], ends[-1]))
        at_start = lines[line][0] == tip.position
        at_tip = starts[line] if at_start else starts[line + 1]
        assert tip.arc[0] == pytest.approx(at_tip, abs=1e-12)
        near = np.abs(place - at_tip) < reach * (1 - 1e-9)
        near &= np.abs(place - at_tip) > 1e-9
        near &= (place > at_tip) == at_start
        assert near.sum() >= 7
        for where, value in zip(place[near], pressure[near]):
            point, normal = places_of(lines, where)
            xx, yy, xy = found.stress(tuple(point))
            stress = normal @ np.array([[xx, xy], [xy, yy]]) @ normal
            assert value == pytest.approx(-stress, abs=1e-3 * PRESSED)
