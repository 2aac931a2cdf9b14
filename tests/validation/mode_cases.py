"""Modes, forced motion, backbones."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, Plate, VNotch
from tests.systems import two_masses
from tests.validation.page import Row, case


def mass_with_stop(energy: float) -> float:
    """Frequency of m = 1, k = 10 with a stop of stiffness 50 at 0.01, Hz: quarter turns of two circles."""
    free, touching = math.sqrt(10.0), math.sqrt(60.0)
    amplitude = math.sqrt(2.0 * energy / 10.0)
    if amplitude <= 0.01:
        return free / (2.0 * math.pi)
    offset = 0.01 - 50.0 * 0.01 / 60.0
    radius = math.sqrt(offset**2 + (2.0 * energy - 10.0 * 0.01**2) / 60.0)
    half = math.pi + 2.0 * math.asin(0.01 / amplitude)
    return 1.0 / (half / free + 2.0 * math.acos(offset / radius) / touching)


@case(
    "Mass with a one-sided stop",
    "code_aster SDND122: m = 1, k = 10, stop of stiffness 50 at 0.01 m. Closed form of the frequency over "
    "the energy; "
    "the manual's computed 0.6466939 Hz at 6.50108e-3 J agrees with it.",
)
def one_sided_stop() -> Iterator[Row]:
    one = np.ones((1, 1))
    system = sb.reduce_matrices(
        one, 10.0 * one, -one, np.array([0.01]), loads=one, sensors={"m": 0}, compliance=np.array([1 / 50])
    )
    branch = sb.backbone(system, 1, 1e-4, 1.0)
    for energy in (1e-3, 0.00650108331626, 1.0):
        near = int(np.argmin(np.abs(np.log(branch.energy / energy))))
        exact = mass_with_stop(float(branch.energy[near]))
        yield Row(f"frequency at {branch.energy[near]:.4g} J, Hz", exact, float(branch.frequency[near]), 1e-5)


@case(
    "Two masses with stops on both sides",
    "code_aster SDND123: m = (1, 1), k = (1, 1), stops of stiffness 30 at +-1 of the first mass: second "
    "mode. The "
    "manual regularises the stops.",
)
def two_sided_stops() -> Iterator[Row]:
    stiffness = np.array([[1.0, -1.0], [-1.0, 2.0]])[::-1, ::-1]
    system = sb.reduce_matrices(
        np.eye(2),
        stiffness,
        np.array([[1.0, 0.0], [-1.0, 0.0]]),
        np.ones(2),
        loads=np.array([[0.0], [1.0]]),
        sensors={"1": 0, "2": 1},
        compliance=np.full(2, 1 / 30),
    )
    branch = sb.backbone(system, 2, 0.5, 1.5)
    order = np.argsort(branch.energy)
    at = float(np.interp(1.19768, branch.energy[order], branch.frequency[order]))
    note = "stops exact here and met from 1.809 J on, the motion is linear; regularised they act before"
    yield Row("frequency at 1.19768 J, Hz", 0.257905285, at, 3e-3, note=note)


@case(
    "Two masses with a stop under a harmonic force",
    "NLvib (Krack, Gross), example 03: m = (1, 1), k = (0, 1, 1), damping 0.03 k, force 0.1 on the second "
    "mass, stop of stiffness 100 at 1 of the first one. The figures are read from its plot, to about 1 %.",
    long=True,
)
def two_masses_with_a_stop() -> Iterator[Row]:
    turn = 2.0 * np.pi
    system = two_masses()
    branch = sb.frequency_response(system, [0.1], 0.5 / turn, 0.9 / turn, steps=2048)
    (grazing,) = sb.grazing_points(branch)[:1]
    yield Row("first contact, rad/s", 0.582, turn * grazing.value, 1e-2)
    amplitude = np.abs(branch.harmonics("2")[:, 1])
    top = int(amplitude.argmax())
    yield Row("largest first harmonic of the second mass", 0.936, float(amplitude[top]), 1e-2)
    yield Row("at, rad/s", 0.751, turn * float(branch.value[top]), 1e-2)
    folds = np.array([turn * item.value for item in branch.bifurcations if item.kind == "fold"])
    for published in (0.7556, 0.655):
        found = float(folds[np.argmin(np.abs(folds - published))])
        yield Row(f"fold at {published:g} rad/s", published, found, 1e-2)


def simply_supported(**options) -> sb.Model:
    """NAFEMS' beam 5: 10 x 2 x 2 m; its ends keep their height, a point its place along the beam."""
    outline = [(0, 0), (10, 0), (10, 2), (0, 2)]
    mesh = Plate(outline, edge_names=["bottom", "right", "top", "left"]).mesh(
        size=1.0, points={"O": (0, 1), "M": (5, 1), "N": (5, 0)}
    )
    ends = [sb.Support(name, x=False, y=True) for name in ("left", "right")]
    return sb.Model(
        mesh,
        sb.Material(2e11, 0.3, 8000),
        clamped=None,
        thickness=2.0,
        supports=[*ends, sb.Support("O", x=True, y=False)],
        **options,
    )


BEAM = "plane stress against the book's beam"


@case(
    "Deep simply supported beam",
    "NAFEMS, Selected Benchmarks for Forced Vibration, tests 5, 5H, 5T: 10 x 2 x 2 m, E = 200 GPa, rho = "
    "8000, "
    "1e6 N/m, 2 % damping: beam with shear.",
)
def deep_beam() -> Iterator[Row]:
    model = simply_supported(damping=0.02)
    modes = sb.modal(model, 12)
    bending = np.abs(modes.displacement("M")[:, 1]), np.abs(modes.displacement("M")[:, 0])
    across = modes.frequencies[bending[0] > 10 * bending[1]]
    yield Row("first bending frequency, Hz", 42.650, float(across[0]), 1e-2, note=BEAM)
    yield Row("third bending frequency, Hz", 283.47, float(across[1]), 2e-2, note=BEAM)
    second = modes.frequencies[(modes.frequencies > 120) & (modes.frequencies < 180)]
    yield Row(
        "second bending frequency, Hz",
        148.15,
        float(second[np.argmin(np.abs(second - 148.15))]),
        2e-2,
        note=BEAM,
    )
    load = sb.EdgeLoad("top", ty=-1e6 / 2.0)
    static = sb.static(model, load)
    yield Row(
        "static deflection at midspan, m", 0.538e-3, -float(static.displacement("M")[1]), 2e-2, note=BEAM
    )
    frequency = float(across[0])
    orbit = sb.periodic(model, load, frequency=frequency)
    yield Row(
        "peak deflection at resonance, m", 13.45e-3, float(np.abs(orbit.harmonics("M")[1])), 2e-2, note=BEAM
    )
    history = sb.transient(model, load, 0.03, 2e-5)
    peak = history.displacement("M")[:, 1].argmin()
    yield Row("peak after a step, m", 1.043e-3, -float(history.displacement("M")[peak, 1]), 2e-2, note=BEAM)
    yield Row("its time, s", 0.0117, float(history.time[peak]), 2e-2, note=BEAM)


@case(
    "Axial mode of the deep beam",
    "NAFEMS, tests 5: 10 m, E = 200 GPa, rho = 8000: c / (4 L). The upper half with rollers along its lower "
    "edge.",
)
def axial_mode() -> Iterator[Row]:
    outline = [(0, 0), (10, 0), (10, 1), (0, 1)]
    mesh = Plate(outline, edge_names=["bottom", "right", "top", "left"]).mesh(size=1.0)
    held = [sb.Support("left", x=True, y=False), sb.Support("bottom", x=False, y=True)]
    model = sb.Model(mesh, sb.Material(2e11, 0.3, 8000), clamped=None, supports=held)
    yield Row(
        "frequency, Hz", 125.0, float(sb.modal(model, 3).frequencies[0]), 1e-2, note="inertia across the bar"
    )


@case(
    "Cracked cantilever",
    "Rizos, Aspragathos, Dimarogonas, J. Sound Vib. 138:381 (1990), known second hand: 300 x 20 x 20 mm, "
    "steel, crack "
    "at 140 mm, depth 10 mm. Nothing is held: ratios of cracked to uncracked frequencies of an open crack.",
)
def rizos() -> Iterator[Row]:
    steel = sb.Material(2.06e11, 0.3, 7800)
    whole = sb.modal(sb.Model(Beam(0.3, 0.02).mesh(), steel), 4).frequencies
    cracked = sb.modal(sb.Model(Beam(0.3, 0.02, [VNotch(0.14, 0.01, 0.0)]).mesh(), steel), 4).frequencies
    for k, (a, b) in enumerate(((171.0, 185.2), (987.0, 1160.6), (3034.0, 3259.0))):
        yield Row(f"ratio of frequencies {k + 1}", a / b, float(cracked[k] / whole[k]), None)
