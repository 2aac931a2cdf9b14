"""Loads on one face of a crack: they act on that face to the tip, whichever way the crack is drawn."""

import math

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch, read_gmsh

SIDE = 50.0  # m, of a wide plate's quadrant; half-length of the crack 1
ALUMINIUM = sb.Material(young=70e9, poisson=0.3, density=2700)
STRESS = 1e6
# Ends of the crack: every quarter turn, one between, and each in the other sense.
OPENINGS = (0.0, 0.01, 0.03)
SENSES = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.6, 0.8), (-0.6, -0.8), (0.6, -0.8)]


def wide_plate(end, opening):
    outline = [(-SIDE, -SIDE), (SIDE, -SIDE), (SIDE, SIDE), (-SIDE, SIDE)]
    line = CrackLine([(-end[0], -end[1]), end], opening=opening, name="c")
    return Plate(outline, cracks=[line]).mesh(points={"P": (SIDE, SIDE)})


def sheared(end, shear=STRESS):
    """Opposite tractions along the two faces, the left one's towards the end of the line."""
    return sb.EdgeLoad("c_left", tx=shear * end[0], ty=shear * end[1]) + sb.EdgeLoad(
        "c_right", tx=-shear * end[0], ty=-shear * end[1]
    )


def check_closed_forms(model, end, looking):
    """|K_II| = tau sqrt(pi a) and K_I = 0 under shear of the faces, a wide plate's closed form; a pressure on
    one face is the force ``2 p`` normal to the line on the supports. `looking` is the direction in which the
    left face lies at the left.
    """
    unit = STRESS * math.sqrt(math.pi)
    for first, second in sb.static(model, sheared(end), contact=False).stress_intensity.values():
        assert abs(second) == pytest.approx(unit, rel=1e-3)  # K of a plate of 50 half-lengths: 5e-4
        assert abs(first) < 1e-3 * unit
    for side, sign in (("c_left", 1.0), ("c_right", -1.0)):
        pushed = sb.static(model, sb.EdgeLoad(side, pressure=STRESS), contact=False)
        force = 2.0 * STRESS * sign * np.array([-looking[1], looking[0]])
        assert np.abs(pushed.reactions["edge1"] + force).max() < 1e-9 * 2.0 * STRESS


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "opening"),
    [
        pytest.param(end, OPENINGS[(k + shift) % 3], marks=[pytest.mark.long] * shift)
        for k, end in enumerate(SENSES)
        for shift in range(2)
    ],
)
def test_plate(end, opening):
    model = sb.Model(wide_plate(end, opening), ALUMINIUM, clamped="edge1")
    check_closed_forms(model, end, looking=np.negative(end))  # from a line's last point to its first


GEO = """
Point(1)={-50,-50,0,20}; Point(2)={50,-50,0,20}; Point(3)={50,50,0,20}; Point(4)={-50,50,0,20};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,1}; Curve Loop(1)={1:4};
%s
Physical Surface("s")={1}; Physical Curve("edge1")={1};
"""
EMBEDDED = """Point(10)={%g,%g,0,.5}; Point(11)={%g,%g,0,.5}; Line(10)={10,11}; Plane Surface(1)={1};
Curve{10} In Surface{1}; Physical Curve("crack:c")={10};"""


def gmsh_plate(end, opening, folder, outline="1:4"):
    """`wide_plate` by gmsh."""
    path, own = folder / "model.geo", f":opening={opening:g}" if opening else ""
    text = (GEO % (EMBEDDED % (-end[0], -end[1], *end))).replace("crack:c", f"crack:c{own}")
    path.write_text(text.replace("{1:4}", f"{{{outline}}}"))
    return read_gmsh(path, scale=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "opening"),
    [(end, 0.0) for end in SENSES[:2]]
    + [
        pytest.param(end, opening, marks=pytest.mark.long)
        for end in SENSES
        for opening in (0.0, 0.01, 0.03)
        if opening or end not in SENSES[:2]
    ],
)
def test_gmsh_crack(tmp_path, end, opening):
    """Drawn in every sense, in an outline of one sense or of the other, faces together or apart."""
    outline = "1:4" if end[1] >= 0.0 else "-4,-3,-2,-1"
    mesh = gmsh_plate(end, opening, tmp_path, outline)
    check_closed_forms(sb.Model(mesh, ALUMINIUM, clamped="edge1"), end, looking=end)


@pytest.mark.long
@pytest.mark.filterwarnings("error::RuntimeWarning")  # of steps in which damping takes all there is
@pytest.mark.parametrize("opening", [0.0, 0.03])
def test_beam_and_its_mirror_image(opening):
    """K_II turns its sign with the body, K_I does not, in statics and in slow motion, whichever way the crack
    is drawn; a pressure on the face that lies at the left of a line pushes along its normal.
    """
    first, last, height = np.array([0.05, 0.012]), np.array([0.062, 0.022]), 0.04
    along, length = (last - first) / math.dist(first, last), math.dist(first, last)
    expected = None
    for mirrored in (False, True):
        turn = np.array([1.0, -1.0 if mirrored else 1.0])
        ends = [tuple(np.array([0.0, height * mirrored]) + turn * end) for end in (first, last)]
        for line in (ends, ends[::-1]):
            mesh = Beam(0.1, height, cracks=[CrackLine(line, opening=opening, name="c")]).mesh()
            model = sb.Model(mesh, ALUMINIUM, clamped="left", rayleigh=(0.0, 1e-5))
            upper, lower = ("c_left", "c_right")[:: 1 if (line is ends) != mirrored else -1]
            x, y = STRESS * turn * along
            load = sb.EdgeLoad(upper, tx=x, ty=y) + sb.EdgeLoad(lower, tx=-x, ty=-y)
            found = sb.static(model, load, contact=False).stress_intensity
            values = np.array([found["c:1"], found["c:2"]]) * [1.0, turn[1]]  # by place: from the left
            expected = values if expected is None else expected
            np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
            frequency = sb.modal(model, 1).frequencies[0] / 300.0
            orbit = sb.periodic(model, load, frequency, steps=64, contact=False)
            peaks = [np.abs(orbit.stress_intensity(tip)[:, 1]).max() for tip in ("c:1", "c:2")]
            np.testing.assert_allclose(peaks, np.abs(expected[:, 1]), rtol=1e-4)
            pushed = sb.static(model, sb.EdgeLoad(upper, pressure=STRESS), contact=False)
            exact = STRESS * length * turn * [-along[1], along[0]]
            assert np.abs(pushed.reactions["left"] - exact).max() < 1e-9 * STRESS * length


GMSH_NOTCH = """
Point(1)={0,0,0,.02}; Point(2)={.1,0,0,.02}; Point(3)={.1,.04,0,.02}; Point(4)={0,.04,0,.02};
Point(5)={%(right)g,.04,0,.01}; Point(6)={.05,.02,0,.01}; Point(7)={%(left)g,.04,0,.01};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,5}; Line(4)={%(sense)s}; Line(5)={6,7}; Line(6)={7,4}; Line(7)={4,1};
Curve Loop(1)={1,2,3,%(sign)s4,5,6,7}; Plane Surface(1)={1}; Physical Surface("s")={1};
Physical Curve("left")={7}; Physical Curve("crack:crack1:right")={4}; Physical Curve("crack:crack1:left")={5};
"""


def notched(kind, tilt, tmp_path):
    """The body with a notch of 0.2 degrees whose axis leans by `tilt` degrees, drawn or of a gmsh model."""
    if kind in ("top", "bottom"):
        return Beam(0.1, 0.04, [VNotch(0.05, 0.02, 0.2, tilt, edge=kind)]).mesh()
    notch = VNotch(0.05, 0.02, 0.2, tilt)
    path = tmp_path / "notch.geo"
    sense, sign = ("5,6", "") if kind == "gmsh" else ("6,5", "-")
    places = {"right": 0.05 + notch.right_offset, "left": 0.05 + notch.left_offset}
    path.write_text(GMSH_NOTCH % {**places, "sense": sense, "sign": sign})
    return read_gmsh(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "tilt"),
    [
        pytest.param(kind, tilt, marks=[pytest.mark.long] * (tilt in (0.0, 10.0)))
        for kind in ("top", "gmsh")
        for tilt in (-10.0, 0.0, 10.0, 25.0)
    ]
    + [(kind, tilt) for kind in ("bottom", "gmsh, a face drawn the other way") for tilt in (-10.0, 25.0)],
)
def test_notch(kind, tilt, tmp_path):
    """The supports take up a pressure on one face as the chord from its mouth to the tip says."""
    mesh = notched(kind, tilt, tmp_path)
    model = sb.Model(mesh, ALUMINIUM, clamped="left")
    tip, crack = np.array(mesh.tips[0].position), mesh.cracks[0].name
    for side, out in ((f"{crack}_left", 1.0), (f"{crack}_right", -1.0)):
        face = mesh.nodes[np.unique(mesh.edges[mesh.edge_sets[side]])]
        chord = out * (face[np.argmax(np.hypot(*(face - tip).T))] - tip)  # with the material on the left
        found = sb.static(model, sb.EdgeLoad(side, pressure=STRESS), contact=False)
        exact = -STRESS * np.array([-chord[1], chord[0]])
        assert np.abs(found.reactions["left"] - exact).max() < 1e-9 * STRESS * np.hypot(*chord)
        pulled = sb.static(model, sb.EdgeLoad(side, tx=STRESS, ty=-2 * STRESS), contact=False)
        exact = -STRESS * np.hypot(*chord) * np.array([1.0, -2.0])
        assert np.abs(pulled.reactions["left"] - exact).max() < 1e-9 * 2 * STRESS * np.hypot(*chord)


@pytest.mark.slow
def test_both_placements_are_met():
    """Of tip elements that are symmetric to round-off, rounding decides which are reflected shapes."""
    turns = set()
    for end in SENSES[::-1]:
        model = sb.Model(wide_plate(end, 0.01), ALUMINIUM, clamped="edge1")
        turns |= {round(float(np.linalg.det(faces.rotation))) for faces in model.tips.faces.values()}
        if len(turns) > 1:
            break
    assert turns == {-1, 1}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "reduced", "kind"),
    [
        pytest.param(SENSES[0], True, "plate", marks=pytest.mark.long),
        pytest.param(SENSES[1], True, "gmsh", marks=pytest.mark.long),
        pytest.param(SENSES[4], True, "plate", marks=pytest.mark.long),
        pytest.param(SENSES[0], False, "gmsh", marks=pytest.mark.long),
    ],
)
def test_histories_and_steady_states(end, reduced, kind, tmp_path):
    """Slow motion goes through the static states of the closed form: 0.05 Hz beside a lowest frequency of
    5 Hz; also without a reduced model.
    """
    opening, frequency = 0.01, 0.05
    mesh = wide_plate(end, opening) if kind == "plate" else gmsh_plate(end, opening, tmp_path)
    model = sb.Model(mesh, ALUMINIUM, clamped="edge1", rayleigh=(0.0, 1e-3))
    exact = STRESS * math.sqrt(math.pi)
    options = {} if reduced else {"reduction": None}
    orbit = sb.periodic(model, sheared(end), frequency, steps=64, **options)
    raised = sb.ToneBurst(STRESS, frequency, cycles=1.0)
    history = sb.transient(model, sheared(end, raised), 1.0 / frequency, step=1.0 / 64 / frequency, **options)
    for tip in ("c:1", "c:2"):
        assert np.abs(orbit.stress_intensity(tip)[:, 1]).max() == pytest.approx(exact, rel=2e-3)
        found = np.abs(history.stress_intensity(tip)[:, 1])
        assert found == pytest.approx(math.sqrt(math.pi) * np.abs(raised(history.time)), abs=2e-3 * exact)
