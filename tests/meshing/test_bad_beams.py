"""Bad input for beams and mesh files: one sentence each, before any work."""

import math

import numpy as np
import pytest

from meshing import Beam, Hole, VNotch
from sbfem_petsc.checks import numbers_of, shown

LENGTH, HEIGHT = 0.4, 0.005
NOTCH = VNotch(0.08, 0.0025, 0.05)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Beam(0, HEIGHT), "length = 0 must be finite and above 0 and at most 1e+100 (m)"),
        (lambda: Beam(LENGTH, -1.0), "height = -1.0 must"),
        (lambda: Beam(math.nan, HEIGHT), "length = nan must be finite"),
        (lambda: Beam(LENGTH, math.inf), "height = inf must"),
        (lambda: VNotch(0.08, 0, 1), "depth = 0 must"),
        (lambda: VNotch(0.08, -0.001, 1), "depth = -0.001 must"),
        (lambda: VNotch(math.nan, 0.001, 1), "x = nan must"),
        (lambda: VNotch(0.08, 0.001, -1), "opening is -1 degrees"),
        (lambda: VNotch(0.08, 0.001, 60, 60), "leans 90 degrees"),
        (lambda: VNotch(0.08, 0.001, 0, math.nan), "tilt = nan"),
        (lambda: Hole(0.1, 0.0025, 0), "diameter = 0 must"),
        (lambda: Hole(0.1, math.nan, 0.001), "y = nan"),
        (
            lambda: Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.006, 0)]),
            "notch 1: depth 0.006 m is not less than the beam's height 0.005 m",
        ),
        (lambda: Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.005, 0)]), "not less than the beam's height"),
        (lambda: Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.00499, 0)]), "within 1 %"),
        (
            lambda: Beam(LENGTH, HEIGHT, [NOTCH, VNotch(0.5, 0.001, 0)]),
            "notch 2: its tip at x = 0.5 m is outside the beam",
        ),
        (lambda: Beam(LENGTH, HEIGHT, [VNotch(-0.1, 0.001, 0)]), "outside the beam"),
        (lambda: Beam(LENGTH, HEIGHT, [VNotch(0.001, 0.0025, 60)]), "its mouth reaches x = "),
        (lambda: Beam(LENGTH, HEIGHT, [NOTCH, VNotch(0.08, 0.001, 0)]), "notches 1 and 2 overlap"),
        (
            lambda: Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.0025, 0, 30), VNotch(0.081, 0.0025, 0, -30)]),
            "notches 1 and 2 overlap",
        ),
        (
            lambda: Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.0025, 60), VNotch(0.0815, 0.002, 60)]),
            "notches 1 and 2 overlap",
        ),
        (
            lambda: Beam(LENGTH, HEIGHT, holes=[Hole(0.1, 0.0025, 0.005)]),
            "hole 1: centre y = 0.0025 m with diameter 0.005 m leaves or touches the domain",
        ),
        (lambda: Beam(LENGTH, HEIGHT, holes=[Hole(0.4, 0.0025, 0.001)]), "leaves or touches the domain"),
        (
            lambda: Beam(LENGTH, HEIGHT, holes=[Hole(0.1, 0.0025, 0.002), Hole(0.101, 0.0025, 0.001)]),
            "holes 1 and 2 overlap",
        ),
        (
            lambda: Beam(LENGTH, HEIGHT, [NOTCH], [Hole(0.0805, 0.0025, 0.002)]),
            "hole 1 touches or cuts notch 1",
        ),
        (
            lambda: Beam(LENGTH, HEIGHT, [NOTCH], [Hole(0.08, 0.0015, 0.002)]),
            "hole 1 touches or cuts notch 1",
        ),
    ],
)
def test_shapes(make, says):
    with pytest.raises(ValueError) as caught:
        make()
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Beam("0.4", HEIGHT),
        lambda: Beam(True, HEIGHT),
        lambda: Beam(LENGTH, HEIGHT, NOTCH),
        lambda: Beam(LENGTH, HEIGHT, [Hole(0.1, 0.0025, 0.001)]),
        lambda: Beam(LENGTH, HEIGHT, holes=3),
        lambda: VNotch(None, 0.001, 0),
        lambda: Beam(LENGTH, HEIGHT).mesh(order=2.5),
        lambda: Beam(LENGTH, HEIGHT).mesh(points={"P": 3}),
    ],
)
def test_wrong_types(make):
    with pytest.raises(TypeError):
        make()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"order": 0}, "order = 0 must be between 1 and 20"),
        ({"order": 21}, "order = 21 must be between 1 and 20"),
        ({"size": 0}, "size = 0 must be finite and above 0"),
        ({"size": math.nan}, "size = nan must"),
        ({"size": 1e-6}, "size 1e-06 m is below"),
        ({"tip_size": 0}, "tip_size = 0 must"),
        ({"tip_size": -1e-4}, "tip_size = -0.0001 must"),
        ({"tip_size": 1e-12}, "below 1e-06 of the body's size 0.005 m"),
        ({"tip_size": 0.0025}, "does not fit around the tip of notch 1"),
        ({"grading": 1.0}, "grading is 1"),
        ({"grading": math.inf}, "grading = inf"),
        ({"layout": "star"}, "layout = 'star' must be one of 'tip', 'vertex'"),
        ({"corner_size": 0.0025}, "corner_size 0.0025 m"),
        ({"corner_size": 0.0}, "corner_size = 0.0 must"),
        ({"corner_size": 1e-4, "corners": ["top"]}, "corners = 'top' must be one of 'left', 'right'"),
        ({"points": {"P": (0.5, 0.001)}}, "point 'P' at (0.5, 0.001) m is outside the beam"),
        ({"points": {"P": (0.08, 0.004)}}, "in or on notch 1"),
        ({"points": {"P": (0.065, 0.0025)}}, "in or on hole 1"),
        ({"points": {"P": (math.nan, 0.0)}}, "x = nan must"),
        ({"points": {"A": (0.1, 0.0)}}, "point 'A': this name is the mesh's own"),
        (
            {"points": {"P": (0.0801, 0.0024), "Q": (0.0801, 0.0024)}, "tip_size": 1e-3},
            "crack 'crack1': tip_size 0.001 m does not fit in the cells around the tip",
        ),
    ],
)
def test_mesh_options(options, says):
    with pytest.raises(ValueError) as caught:
        Beam(LENGTH, HEIGHT, [NOTCH], [Hole(0.065, 0.0025, 0.002)]).mesh(**options)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_inconsistent_arrays():
    import dataclasses

    mesh = Beam(LENGTH, HEIGHT).mesh(order=2)
    with pytest.raises(ValueError, match="marked closed"):
        dataclasses.replace(mesh, closed=~mesh.closed)
    with pytest.raises(ValueError, match="not a chain"):
        dataclasses.replace(mesh, element_reversed=~mesh.element_reversed)
    with pytest.raises(ValueError, match="refers to number 100000"):
        dataclasses.replace(mesh, points={"A": 100000})
    with pytest.raises(ValueError, match="for order 3"):
        dataclasses.replace(mesh, order=3)


class Number(np.float64):
    """As NumPy 2 prints its numbers."""

    def __repr__(self):
        return f"np.float64({float(self)!r})"


def test_numbers_of_numpy_are_shown_as_numbers():
    value = [Number(1.0), (Number(-2.5), 3), {"a": [Number(0.5)]}]
    assert shown(Number(1.0)) == "1.0" and shown(value) == "[1.0, (-2.5, 3), {'a': [0.5]}]"
    with pytest.raises(ValueError, match=r"x = \[1.0, 2.0\] must be three"):
        numbers_of("f", "x", [Number(1.0), Number(2.0)], 3, "three")
    around = [1.0]
    around.append(around)
    assert shown(around) == "<list>"  # which holds itself
