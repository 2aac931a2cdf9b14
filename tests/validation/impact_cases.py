"""Contact in time: bars, rods, masses with stops."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import sbfem_petsc as sb
from meshing import CrackLine, Plate
from tests.validation.page import Row, case


class Bar:
    """A bar of linear finite elements, free at both ends, in front of a rigid stop at its lower end.

    Parameters
    ----------
    length, young, density : float
        m, Pa, kg/m^3; the section is 1 m^2.
    gap : float
        m.
    gravity : float
        m/s^2, towards the stop.
    elements, modes : int
    """

    def __init__(self, length, young, density, gap, *, gravity=0.0, elements, modes):
        size = length / elements
        ends = np.arange(elements)
        mass, stiffness = np.zeros((2, elements + 1, elements + 1))
        for i, j, m, k in ((0, 0, 2, 1), (0, 1, 1, -1), (1, 0, 1, -1), (1, 1, 2, 1)):
            np.add.at(mass, (ends + i, ends + j), density * size / 6.0 * m)
            np.add.at(stiffness, (ends + i, ends + j), young / size * k)
        rows = np.zeros((1, elements + 1))
        rows[0, 0] = 1.0
        self.mass, self.gravity = mass, gravity
        self.reduced = sb.reduce_matrices(
            mass,
            stiffness,
            rows,
            np.array([gap]),
            loads=-mass.sum(axis=1)[:, None],
            sensors={str(k): k for k in range(elements + 1)},
            modes=modes,
        )

    def run(self, velocity: float, duration: float, step: float) -> sb.History:
        """From a uniform velocity."""
        shapes = self.reduced.points.modes[:, 1, :]
        start = shapes.T @ self.mass @ np.full(len(self.mass), velocity)
        return sb.transient(self.reduced, [self.gravity], duration, step, initial=(0.0 * start, start))


def touching(
    history: sb.History, force: float, *, after: float = 0.0, before: float = math.inf
) -> tuple[float, float]:
    """First and last time between two at which the contact force is more than a quarter of `force`."""
    inside = (history.time > after) & (history.time < before)
    held = history.time[inside & (history.contact_resultant > 0.25 * force)]
    return float(held[0]), float(held[-1])


LATE = "the free rod's own end starts at rest; relative to the largest"
RIPPLE = "relative to the fall; high modes keep energy of the jump, less the more there are"


@case(
    "Bouncing bar",
    "Doyen, Ern, Piperno, SIAM J. Sci. Comput. 33:223 (2011); NLstep example 01. Dropped from 5 m, L = 10, "
    "E = 900, "
    "rho = 1, g = 10: closed form. 800 linear finite elements in 400 modes, contact without mass.",
)
def bouncing_bar() -> Iterator[Row]:
    bar = Bar(10.0, 900.0, 1.0, 5.0, gravity=10.0, elements=800, modes=400)
    found = bar.run(0.0, 5.0, 1e-4)
    first, last = touching(found, 300.0, before=2.5)
    yield Row("first contact, s", 1.0, first, 1e-3, note="to 1/4 of the force")
    yield Row("end of first contact, s", 5 / 3, last, 1e-3, note="to 1/4 of the force")
    for at, height in {1.91667: 1.1458333, 2.16667: 2.9166667, 2.66667: 3.8888889}.items():
        here = 5.0 + np.interp(at, found.time, found.displacement("0")[:, 1])
        yield Row(
            f"height of the lower end at {at:g} s, m", height, float(here), 1e-2, scale=5.0, note=RIPPLE
        )
    during = (found.time > 1.05) & (found.time < 1.6)
    mean = float(found.contact_resultant[during].mean())
    yield Row("mean contact force from 1.05 to 1.6 s, N", 30.0 * (10.0 + 10.0 * 0.325), mean, 1e-3)


@case(
    "Rod on a wall",
    "code_aster SDNV100: L = 0.2 m, E = 2e11 Pa, rho = 8000 kg/m3, 100 m/s, gap 2 mm: one-dimensional waves.",
    long=True,
)
def rod_on_a_wall() -> Iterator[Row]:
    found = Bar(0.2, 2e11, 8000.0, 2e-3, elements=800, modes=400).run(-100.0, 1.6e-4, 5e-9)
    first, last = touching(found, 4e9)
    yield Row("begin of contact, s", 2e-5, first, 5e-3, scale=8e-5, note="relative to its duration")
    yield Row("end of contact, s", 1e-4, last, 5e-3, scale=8e-5, note="relative to its duration")
    during = (found.time > 2.4e-5) & (found.time < 9.6e-5)
    yield Row("mean stress at the wall, Pa", 4e9, float(found.contact_resultant[during].mean()), 2e-3)
    free = found.time > 1.2e-4
    ends = np.mean([found.velocity(str(k))[free, 1].mean() for k in range(0, 801, 20)])
    yield Row("velocity of rebound, m/s", 100.0, float(ends), 5e-3, note="mean of the rod after contact")


@case(
    "Two rods",
    "code_aster SDNL111: rods of 1 m and 4e-4 m2, E = 2e11 Pa, rho = 7800 kg/m3, nu = 0; one at -1 m/s onto "
    "one that "
    "is clamped: one-dimensional waves. A plate of 2 x 0.02 m with a crack through it, on very soft springs.",
    long=True,
)
def two_rods() -> Iterator[Row]:
    height, section = 0.02, 4e-4
    corners = [(0, 0), (2, 0), (2, height), (0, height)]
    line = CrackLine([(1, height), (1, 0)], name="c")
    mesh = Plate(corners, cracks=[line]).mesh(size=0.02, points={"E": (2, height)}, face_edges=1)
    model = sb.Model(
        mesh,
        sb.Material(2e11, 0.0, 7800),
        clamped="edge4",
        thickness=section / height,
        supports=[sb.Support("edge2", x=1e4, y=1e4)],
    )
    # The function cannot tell the two faces apart: the free rod's own end starts at rest.
    start = (None, lambda x, y: (np.where(x > 1.0 + 1e-9, -1.0, 0.0), 0.0 * x))
    found = sb.transient(model, sb.EdgeLoad("edge2", tx=1e-30), 1.2e-3, 1e-6, modes=160, initial=start)
    force = 0.5 * math.sqrt(2e11 * 7800) * section
    period = 4.0 / math.sqrt(2e11 / 7800)
    during = (found.time > 0.1 * period) & (found.time < 0.9 * period)
    resultant = found.contact_resultant
    _, last = touching(found, force)
    yield Row("mean contact force, N", 7899.37, float(resultant[during].mean()), 5e-3)
    yield Row("duration of contact, s", 7.8994e-4, last, 1e-2, note="to 1/4 of the force")
    impulse = float(resultant.sum() * found.step)
    moved = found.displacement((1.0 + 1e-6, 0.5 * height))[:, 0]
    for at, place in ((2e-4, -1.0000e-4), (4e-4, -1.9497e-4), (6e-4, -0.9497e-4), (8e-4, 0.1006e-4)):
        here = float(np.interp(at, found.time, moved))
        yield Row(
            f"displacement of the free rod's end at {at:g} s, m", place, here, 1e-2, scale=1.95e-4, note=LATE
        )
    yield Row("impulse, N s", force * period, impulse, 5e-3, note=LATE)
