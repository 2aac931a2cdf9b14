"""Runs one analysis of some size; tells what memory it was expected to take, and what it took at most."""

from __future__ import annotations

import json
import sys
import warnings
from typing import Any

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, Plate, VNotch
from sbfem_petsc.ranks import capacity

EXPECTED: dict[str, float] = {}
STEEL = sb.Material(210e9, 0.3, 7800)


def plate(size: float) -> sb.Model:
    mesh = Plate([(0, 0), (1, 0), (1, 1), (0, 1)], edge_names=["bottom", "right", "top", "left"]).mesh(
        order=4, size=size
    )
    return sb.Model(mesh, STEEL, clamped="left", damping=0.01)


def beam(modes: int) -> sb.ReducedModel:
    mesh = Beam(0.3, 0.02, [VNotch(0.1, 0.01, 0.001)]).mesh(order=4)
    return sb.reduce(sb.Model(mesh, STEEL, damping=0.005), sb.PointForce("A", fy=1.0), modes=modes)


def resident(name: str) -> int:
    with open("/proc/self/status", encoding="ascii") as file:
        line = next(line for line in file if line.startswith(name))
    return 1024 * int(line.split()[1])


def watched(owner: str, comm: Any, needed: float, *further: Any) -> None:
    EXPECTED[owner] = EXPECTED.get(owner, 0.0) + needed


def main(name: str) -> None:
    warnings.simplefilter("ignore")
    force, pull = sb.PointForce("A", fy=300.0), sb.EdgeLoad("right", tx=1e6)
    wave = sb.PointForce("A", fy=sb.Harmonic(300.0, 180.0))
    tones = sb.PointForce("A", fy=sb.Harmonic(30.0, 6000.0) + sb.Harmonic(200.0, 565.0))
    structural = name in ("static", "modal", "unreduced", "load_history")
    subject = plate(0.025) if structural else beam(20 if name == "quasi_periodic" else 40)
    run = {
        "static": lambda: sb.static(subject, pull),
        "modal": lambda: sb.modal(subject, 20),
        "unreduced": lambda: sb.transient(
            subject, sb.EdgeLoad("right", tx=sb.Harmonic(1e6, 100.0)), 1e-4, 1e-5, reduction=None, modes=10
        ),
        "load_history": lambda: sb.load_history(subject, pull, np.linspace(0.0, 1.0, 200)),
        "transient": lambda: sb.transient(subject, wave, 0.2, 4e-7, decimation=1),
        "periodic": lambda: sb.periodic(subject, force, 180.0, steps=60_000),
        "swept_response": lambda: sb.swept_response(
            subject, force, 150.0, 160.0, duration=20.0, steps=2000, initial=None
        ),
        "quasi_periodic": lambda: sb.quasi_periodic(
            subject, tones, (6000.0, 565.0), samples=501, steps=512, stability=False
        ),
        "basins": lambda: sb.basins(
            subject,
            force,
            180.0,
            [sb.StartAxis(np.linspace(0.0, 1e-6, 100)), sb.StartAxis(np.linspace(0.0, 1e-6, 200), mode=2)],
            steps=48,
            limit=1,
        ),
        "frequency_response": lambda: sb.frequency_response(
            subject, force, 150.0, 170.0, points=150, largest_step=0.15, steps=2048
        ),
        "backbone": lambda: sb.backbone(
            subject, 1, 1e-6, 1e-2, points=60, largest_change=0.05, steps=8192, refine=False, stability=False
        ),
    }[name]
    small = None if structural else beam(6)
    if small is not None:  # what is compiled and loaded once
        sb.periodic(small, force, 180.0, steps=64)
        sb.transient(small, wave, 1e-3, 1e-5)
    capacity.require_memory = watched
    for module in list(sys.modules.values()):
        if getattr(module, "require_memory", None) is not None and module is not capacity:
            module.require_memory = watched
    before = resident("VmRSS")
    with open("/proc/self/clear_refs", "w", encoding="ascii") as file:
        file.write("5")  # the peak begins anew
    try:
        run()
    except sb.SolveError as error:
        print(error)
    taken = resident("VmHWM") - before
    print(json.dumps({"expected": EXPECTED, "taken": taken}))


if __name__ == "__main__":
    main(sys.argv[1])
