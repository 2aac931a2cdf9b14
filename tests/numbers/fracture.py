"""Stress intensity, T-stress, energy release rate and pressure along cracks."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from tests.numbers import bodies
from tests.numbers.table import Group

GROUP = Group(
    "fracture",
    1e-10,
    "1e-10: the instruction sets of other processors, two and three ranks move factors by up to 2e-11;\n"
    "1e-9 of pressures (1.4e-10) and 5e-9 of T (6e-10).",
    ranks=True,
)


def of(found):
    for tip, factors in sorted(found.stress_intensity.items()):
        yield f"K.{tip}", factors
        yield f"G.{tip}", found.energy_release_rate[tip]
        yield f"T.{tip}", found.t_stress[tip], 5e-9


@GROUP.case
def plate_pulled():
    yield from of(sb.static(bodies.plate(), sb.EdgeLoad("edge3", ty=1.0)))


@GROUP.case
def plate_sheared_and_pressed():
    yield from of(sb.static(bodies.plate(), sb.EdgeLoad("edge3", tx=1.0, ty=-1.0)))


@GROUP.case
def opened_plate_pulled():
    yield from of(sb.static(bodies.plate(2.0), sb.EdgeLoad("edge3", ty=1.0)))


@GROUP.case
def branching_pulled():
    yield from of(sb.static(bodies.branching(), sb.EdgeLoad("top", ty=1.0, tx=0.2)))


@GROUP.case
def interface_pulled():
    yield from of(sb.static(bodies.two_halves(), sb.EdgeLoad("top", ty=1.0)))


@GROUP.case
def interface_pressed():
    yield from of(sb.static(bodies.two_halves(), sb.EdgeLoad("top", ty=-1.0, tx=0.2)))


@GROUP.case
def beam_notch_pulled():
    yield from of(sb.static(bodies.beam(), sb.PointForce("A", fy=-100.0)))


@GROUP.case
def orthotropic_kink():
    wood = sb.OrthotropicMaterial(10.0, 1.0, 0.3, 0.7, 1.0, angle=25.0)
    shape = Plate(bodies.SQUARE, cracks=[CrackLine([(0.5, 1.0), (0.5, 0.7), (0.6, 0.5)], name="c")])
    model = sb.Model(shape.mesh(order=3, face_edges=6), wood, "edge1")
    yield from of(sb.static(model, sb.EdgeLoad("edge2", tx=1.0)))


def faces(opening):
    """Opposite tractions on both faces, and pressure on one of them alone."""
    model = bodies.small_crack(opening)
    pair = [sb.EdgeLoad("c_left", tx=1.0), sb.EdgeLoad("c_right", tx=-1.0)]
    factors = sb.static(model, pair, contact=False).stress_intensity
    yield "sheared.K", np.array([factors[tip] for tip in sorted(factors)])
    alone = sb.static(model, sb.EdgeLoad("c_left", pressure=1.0), contact=False)
    yield "pressed.reaction", next(iter(alone.reactions.values()))
    yield "pressed.K", np.array([alone.stress_intensity[tip] for tip in sorted(factors)])


@GROUP.case
def loaded_faces_closed():
    yield from faces(0.0)


@GROUP.case
def loaded_faces_open():
    yield from faces(0.01)


def pressure(model, load):
    found = sb.static(model, load)
    place, force = found.contact_pressure("c")
    yield "pressure", np.interp(np.linspace(place[0], place[-1], 7), place, force), 1e-9
    yield "pressure.first", force[:2], 1e-9
    yield "pressure.last", force[-2:], 1e-9


@GROUP.case
def pressure_left_to_right():
    """A linear pressure on the edge opposite of the held one."""
    yield from pressure(bodies.plate(), [sb.EdgeLoad("edge3", pressure=1.0), sb.PointForce("P", fy=-0.3)])


@GROUP.case
def pressure_right_to_left():
    shape = Plate(bodies.SQUARE, cracks=[CrackLine([(0.65, 0.6), (0.3, 0.45)], name="c")])
    mesh = shape.mesh(order=3, face_edges=6, points={"P": (1.0, 1.0)})
    model = sb.Model(mesh, bodies.UNIT, "edge1")
    yield from pressure(model, [sb.EdgeLoad("edge3", pressure=1.0), sb.PointForce("P", fy=-0.3)])


@GROUP.case
def pressure_of_a_drawing():
    yield from pressure(bodies.branching(), [sb.EdgeLoad("top", pressure=1.0), sb.PointForce("P", fy=-0.3)])


@GROUP.case
def closed_wedge():
    """A notch whose faces are wholly closed."""
    shape = Beam(0.134782, 0.0430349, (VNotch(0.0409181, 0.0325491, 0.0458, -26.145),))
    found = sb.static(
        sb.Model(shape.mesh(order=4, face_edges=6), bodies.ALUMINIUM),
        sb.EdgeLoad("right", tx=-209048.5, ty=169520.8),
    )
    yield "touching", int(found.active.sum())
    yield "K", found.stress_intensity["crack1"]
    yield "resultant", found.contact_resultant
