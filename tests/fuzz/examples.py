"""A legitimate call of every public function and method, small enough to be made thousands of times."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse
from mpi4py import MPI

import meshing
import sbfem_petsc as sb
from meshing import Beam, BoundaryMesh, CrackLine, Hole, Plate, VNotch
from sbfem_petsc import indicators, plot
from sbfem_petsc.continuation.bifurcations import Bifurcation
from sbfem_petsc.continuation.problems.own_tone import OwnTone
from tests.study.small_case import CASE
from tests.systems import two_masses

Arguments = dict[str, Any]


@functools.cache
def mesh() -> BoundaryMesh:
    return Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.05)]).mesh(order=2)


@functools.cache
def model() -> sb.Model:
    return sb.Model(mesh(), sb.Material(70e9, 0.33, 2700), damping=0.02)


@functools.cache
def oscillator() -> sb.ReducedModel:
    """Two masses and a stop."""
    return sb.reduce_matrices(**matrices())


def body_arguments() -> dict[str, Any]:
    """Three masses along x on springs, of which the first is held."""
    return {
        "mass": scipy.sparse.eye(2, format="csr"),
        "stiffness": scipy.sparse.csr_matrix([[2e7, -1e7], [-1e7, 1e7]]),
        "unknowns": [[2, 0], [3, 0]],
        "nodes": {1: (0.0, 0.0, 0.0), 2: (0.1, 0.0, 0.0), 3: (0.2, 0.0, 0.0)},
        "sets": {"A": [3]},
        "fixed": [(1, 0)],
        "elements": {"triangle": [[1, 2, 3]]},
        "units": "SI",
    }


def body_of_springs() -> sb.FiniteElementModel:
    return sb.FiniteElementModel(**body_arguments())


def matrices() -> Arguments:
    return {
        "mass": np.eye(2),
        "stiffness": 1e4 * np.array([[2.0, -1.0], [-1.0, 1.0]]),
        "contact_rows": np.array([[-1.0, 0.0]]),
        "gap": np.array([0.01]),
        "loads": np.array([[1.0], [0.0]]),
        "sensors": {"A": 0},
        "damping": 0.05,
        "compliance": np.array([1e-4]),
    }


PUSH = sb.PointForce("A", fy=10.0)
SHAKE = sb.EdgeMotion("left", uy=1e-6)


@functools.cache
def orbit() -> sb.Orbit:
    return sb.periodic(oscillator(), 100.0, 20.0, steps=64)


@functools.cache
def history() -> sb.History:
    return sb.transient(oscillator(), 20.0, 0.1, 1e-3)


@functools.cache
def motion() -> sb.History:
    return sb.transient(model(), PUSH, 1e-5, 1e-5, modes=6)


def locus():
    """Two points of a line of folds, made up."""
    states = np.ones((2, 2))
    return sb.Locus("fold", "load", TIME[1:3], TIME[1:3], states, np.ones(2, complex), ("begin", "end"))


@functools.cache
def branch() -> sb.Branch:
    return sb.frequency_response(oscillator(), 100.0, 20.0, 20.2, steps=64, points=40)


@functools.cache
def with_bifurcation() -> sb.Branch:
    """With a Neimark-Sacker point."""
    system = two_masses(0.02, compliance=0.1)
    return sb.frequency_response(system, [0.1], 0.092, 0.0932, steps=128, points=40)


@functools.cache
def static() -> sb.Static:
    return sb.static(model(), PUSH)


@functools.cache
def modal() -> sb.Modal:
    return sb.modal(model(), 3)


@functools.cache
def backbone() -> sb.Backbone:
    return sb.backbone(oscillator(), 1, 0.1, 0.2, refine=False, stability=False, steps=64)


@functools.cache
def swept_response() -> sb.SweptResponse:
    return sb.swept_response(oscillator(), 100.0, 20.0, 21.0, duration=2.0, steps=64)


@functools.cache
def basins() -> sb.Basins:
    return sb.basins(oscillator(), 100.0, 20.0, [sb.StartAxis([0.0, 0.01])], orbits=[orbit()])


@functools.cache
def quasi_periodic() -> sb.QuasiPeriodic:
    load = sb.Harmonic(10.0, 20.0) + sb.Harmonic(10.0, 3.1)
    return sb.quasi_periodic(oscillator(), load, (20.0, 3.1), samples=5, steps=64, stability=False)


@functools.cache
def with_own_tone() -> sb.QuasiPeriodic:
    """Behind a Neimark-Sacker point of a smooth part of a branch."""
    system = two_masses(0.02, compliance=0.1)
    branch = sb.frequency_response(system, [0.1], 0.0962, 0.0959, steps=128, points=40)
    return sb.switch_branch(branch, branch.bifurcations[0], samples=7)


@functools.cache
def quasi_periodic_branch() -> sb.QuasiPeriodicBranch:
    return sb.quasi_periodic_response(with_own_tone(), 0.095, points=2, stability=False, progress=None)


@functools.cache
def loads_in_time() -> sb.LoadHistory:
    return sb.load_history(model(), PUSH, [0.0, 1.0])


@functools.cache
def rubbing() -> sb.ReducedModel:
    one = np.eye(1)
    return sb.reduce_matrices(
        one,
        one,
        one,
        np.array([-1.0]),
        loads=one,
        sensors={"A": 0},
        compliance=np.ones(1),
        contact_laws=sb.Coulomb(0.3),
        tangent_rows=one,
        tangent_compliance=np.ones(1),
        damping=0.1,
    )


@functools.cache
def rubbing_loads() -> sb.ReducedLoadHistory:
    return sb.load_history(rubbing(), sb.Samples([0.0, 1.0, 2.0], [0.0, 1.0, -1.0]), [0.0, 1.0, 2.0])


@functools.cache
def rubbing_orbit() -> sb.Orbit:
    return sb.periodic(rubbing(), sb.Harmonic(0.5, 0.1), 0.1, steps=64)


TIME = np.linspace(0.0, 1.0, 201)[:-1]
WAVE = np.sin(2.0 * np.pi * 5.0 * TIME)

# Name of a function or class -> calls of it; of the first all arguments are replaced, with those that it
# leaves out, of further ones those that they give.
CALLS: dict[str, list[Callable[[], Arguments]]] = {
    "Material": [lambda: {"young": 70e9, "poisson": 0.33, "density": 2700.0}],
    "OrthotropicMaterial": [
        lambda: {
            "young_1": 10e9,
            "young_2": 1e9,
            "poisson_12": 0.3,
            "shear_12": 1e9,
            "density": 500.0,
            "angle": 10.0,
            "plane": "strain",
            "young_3": 1e9,
            "poisson_13": 0.3,
            "poisson_23": 0.3,
        }
    ],
    "PointForce": [lambda: {"point": "A", "fx": 1.0, "fy": 1.0}],
    "EdgeLoad": [lambda: {"edge_set": "top", "tx": 1.0, "ty": 1.0, "pressure": 1.0}],
    "SupportMotion": [lambda: {"ax": 1.0, "ay": 1.0}],
    "EdgeMotion": [lambda: {"where": "left", "ux": 1e-5, "uy": 1e-5}],
    "Loads": [lambda: {"parts": (PUSH,)}],
    "Support": [lambda: {"where": "left", "y": 1.0}],
    "Unilateral": [lambda: {}],
    "Tied": [lambda: {}],
    "Clearance": [lambda: {"width": 1e-5}],
    "Coulomb": [lambda: {"friction": 0.3, "static_friction": 0.4}],
    "Model": [
        lambda: {
            "mesh": mesh(),
            "material": sb.Material(70e9, 0.33, 2700),
            "clamped": "left",
            "damping": 0.01,
            "comm": MPI.COMM_WORLD,
        }
    ],
    "DampingTable": [lambda: {"points": [(10.0, 0.01), (100.0, 0.02)]}],
    "rayleigh_factors": [lambda: {"low": 10.0, "low_ratio": 0.01, "high": 100.0, "high_ratio": 0.02}],
    "modal": [
        lambda: {"model": model(), "count": 3},
        lambda: {"model": model(), "band": (10.0, 5000.0)},
        lambda: {"model": model(), "count": 1, "accuracy": 0.0},
        lambda: {"model": oscillator(), "count": 2},
    ],
    "static": [
        lambda: {"model": model(), "load": PUSH},
        lambda: {"model": model(), "load": PUSH, "accuracy": 0.0},
        lambda: {"model": oscillator(), "load": 100.0, "contact": True},
    ],
    "load_history": [
        lambda: {"model": model(), "load": PUSH, "time": [0.0, 1.0]},
        lambda: {"model": oscillator(), "load": 100.0, "time": [0.0, 1.0]},
    ],
    "transient": [
        lambda: {
            "model": oscillator(),
            "load": 100.0,
            "duration": 0.1,
            "step": 1e-3,
            "decimation": 2,
            "progress": None,
            "file": "history.h5",
        },
        lambda: {"model": model(), "load": PUSH, "duration": 1e-3, "step": 1e-5, "modes": 6},
    ],
    "estimate_error": [lambda: {"model": model(), "load": PUSH, "history": motion(), "decimation": 1}],
    "periodic": [
        lambda: {
            "model": oscillator(),
            "load": 100.0,
            "frequency": 20.0,
            "periods": 1,
            "steps": 64,
            "guess": orbit(),
            "stability": True,
            "longest": 8,
            "accuracy": 0.1,
            "progress": None,
        },
        lambda: {"model": model(), "load": PUSH, "frequency": 300.0, "steps": 64, "modes": 6},
        lambda: {"model": model(), "load": SHAKE, "frequency": 300.0, "steps": 64, "modes": 6},
    ],
    "frequency_response": [
        lambda: {
            "model": oscillator(),
            "load": 100.0,
            "start": 20.0,
            "stop": 20.2,
            "periods": 1,
            "steps": 64,
            "guess": orbit(),
            "points": 4,
            "largest_step": 0.05,
            "stability": False,
            "accuracy": 0.1,
            "file": "branch.h5",
            "progress": None,
        },
        lambda: {
            "model": model(),
            "load": PUSH,
            "start": 300.0,
            "stop": 300.1,
            "steps": 64,
            "modes": 6,
            "points": 2,
        },
    ],
    "load_response": [
        lambda: {
            "model": oscillator(),
            "load": 100.0,
            "frequency": 20.0,
            "start": 0.9,
            "periods": 1,
            "steps": 64,
            "guess": orbit(),
            "points": 2,
            "largest_step": 0.05,
            "stability": False,
            "accuracy": 0.1,
            "file": "branch.h5",
            "progress": None,
        },
        lambda: {"model": model(), "load": PUSH, "frequency": 300.0, "steps": 64, "modes": 6, "points": 2},
    ],
    "backbone": [
        lambda: {
            "model": oscillator(),
            "mode": 1,
            "start": 0.1,
            "stop": 0.2,
            "steps": 64,
            "points": 5,
            "largest_step": 0.05,
            "refine": False,
            "stability": False,
            "file": "backbone.h5",
            "progress": None,
        }
    ],
    "switch_branch": [lambda: {"branch": branch(), "bifurcation": None, "size": 0.1, "samples": 5}],
    "locus": [
        lambda: {
            "branch": with_bifurcation(),
            "bifurcation": with_bifurcation().bifurcations[0],
            "start": 0.99,
            "stop": 1.01,
            "points": 1,
            "largest_step": 0.01,
            "file": "line.h5",
            "progress": None,
        }
    ],
    "loci": [
        lambda: {
            "branch": branch(),
            "start": 0.5,
            "stop": 2.0,
            "kinds": ("fold",),
            "points": 3,
            "largest_step": 0.1,
            "progress": None,
        }
    ],
    "grazing_points": [lambda: {"branch": branch()}],
    "swept_response": [
        lambda: {
            "model": oscillator(),
            "load": 100.0,
            "start": 20.0,
            "stop": 21.0,
            "duration": 0.5,
            "initial": orbit(),
            "steps": 64,
            "accuracy": 0.1,
            "progress": None,
        }
    ],
    "StartAxis": [lambda: {"values": [0.0, 1.0], "kind": "velocity", "point": "A"}],
    "basins": [
        lambda: {
            "model": oscillator(),
            "load": 100.0,
            "frequency": 20.0,
            "starts": [sb.StartAxis([0.0, 0.01])],
            "orbits": (orbit(),),
            "around": orbit(),
            "steps": 64,
            "longest": 2,
            "tolerance": 1e-5,
            "limit": 10,
            "progress": None,
            "comm": MPI.COMM_SELF,
        }
    ],
    "quasi_periodic": [
        lambda: {
            "model": oscillator(),
            "load": sb.Harmonic(10.0, 20.0) + sb.Harmonic(10.0, 3.1),
            "frequencies": (20.0, 3.1),
            "samples": 5,
            "steps": 64,
            "stability": False,
            "accuracy": 0.1,
        }
    ],
    "quasi_periodic_response": [
        lambda: {
            "guess": with_own_tone(),
            "stop": 0.095,
            "parameter": "frequency",
            "points": 2,
            "largest_step": 1.0,
            "stability": False,
            "file": "tori.h5",
            "progress": None,
        }
    ],
    "reduce": [
        lambda: {"model": model(), "load": PUSH, "modes": 6},
        lambda: {"model": model(), "load": PUSH, "band": 5000.0},
        lambda: {
            "model": body_of_springs(),
            "contact": body_of_springs().contact([3], normal="x"),
            "loads": {"F": body_of_springs().at(3, "x")},
            "points": {"tip": body_of_springs().at(3, "x")},
            "modes": 1,
            "damping": 0.01,
            "rayleigh": (0.0, 0.0),
            "comm": None,
            "shapes": True,
        },
    ],
    "FiniteElementModel": [body_arguments],
    # a missing deck: the arguments are checked before it is looked for
    "read_calculix": [lambda: {"job": "missing"}],
    "read_matrices": [
        lambda: {
            "stiffness": "missing.npz",
            "mass": "missing.mtx",
            "nodes": {1: (0.0, 0.0, 0.0)},
            "unknowns": [[1, 0]],
            "sets": {"A": [1]},
            "fixed": [(1, 1)],
        }
    ],
    "join": [lambda: {"bodies": body_of_springs()}],
    "reduce_matrices": [
        lambda: {
            **matrices(),
            "modes": 2,
            "contact_laws": sb.Coulomb(0.3),
            "tangent_rows": np.array([[0.0, 1.0]]),
            "tangent_compliance": np.array([1e-4]),
            "comm": MPI.COMM_WORLD,
        }
    ],
    "write_animation": [
        lambda: {"folder": "animation", "motion": motion(), "times": [0.0], "subdivisions": 1}
    ],
    "Harmonic": [lambda: {"amplitude": 1.0, "frequency": 10.0, "phase": 0.1}],
    "ToneBurst": [lambda: {"amplitude": 1.0, "frequency": 10.0, "cycles": 5.0}],
    "Chirp": [
        lambda: {"amplitude": 1.0, "start": 1.0, "stop": 9.0, "duration": 1.0, "phase": 0.1, "taper": 0.1}
    ],
    "Step": [lambda: {"amplitude": 1.0, "time": 0.1, "rise": 0.1}],
    "Samples": [lambda: {"time": [0.0, 1.0, 2.0], "value": [0.0, 1.0, 0.0]}],
    "Custom": [lambda: {"function": np.sin, "highest_frequency": 1.0, "breaks": (0.5,)}],
    "Constant": [lambda: {"value": 1.0}],
    "on_root": [lambda: {"comm": MPI.COMM_WORLD, "work": lambda: 1}],
    "Beam": [
        lambda: {
            "length": 0.1,
            "height": 0.01,
            "notches": (VNotch(0.04, 0.004, 0.05),),
            "holes": (Hole(0.08, 0.005, 0.002),),
        }
    ],
    "Plate": [lambda: {"outline": ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))}],
    "VNotch": [lambda: {"x": 0.04, "depth": 0.004, "opening": 0.05}],
    "Hole": [lambda: {"x": 0.04, "y": 0.005, "diameter": 0.002}],
    "CrackLine": [lambda: {"points": ((0.5, 0.0), (0.5, 0.2)), "name": "c"}],
    # a missing file: its arguments are checked before it is looked for
    "read_gmsh": [
        lambda: {
            "path": "missing.geo",
            "order": 2,
            "size": 0.1,
            "scale": 1.0,
            "tip_size": 0.01,
            "grading": 2.0,
            "face_size": 0.1,
            "face_edges": 4,
            "max_unknowns": 1000,
            "time_limit": 10.0,
            "memory_limit": 1e9,
        }
    ],
    "indicators.coherent_record": [lambda: {"time": TIME, "values": WAVE, "frequencies": 5.0}],
    "indicators.spectrum": [
        lambda: {"time": TIME, "values": WAVE, "window": "hann", "detrend": "linear", "frequencies": 5.0}
    ],
    "indicators.tones": [lambda: {"time": TIME, "values": WAVE, "frequencies": [5.0]}],
    "indicators.harmonics": [lambda: {"time": TIME, "values": WAVE, "frequency": 5.0, "count": 3}],
    "indicators.harmonic_ratios": [lambda: {"c": [0.0, 1.0, 0.1, 0.01]}],
    "indicators.beta": [lambda: {"c": [0.0, 1.0, 0.1, 0.01]}],
    "indicators.gamma": [lambda: {"c": [0.0, 1.0, 0.1, 0.01]}],
    "indicators.subharmonics": [lambda: {"time": TIME, "values": WAVE, "frequency": 10.0, "count": 2}],
    "indicators.sidebands": [lambda: {"time": TIME, "values": WAVE, "carrier": 30.0, "modulation": 4.0}],
    "indicators.friction_power": [
        lambda: {"time": TIME, "slip": WAVE[:, None], "friction_force": WAVE[:, None]}
    ],
    "indicators.contact_duty": [lambda: {"time": TIME, "contact_force": WAVE, "threshold": 0.1}],
    "indicators.detection_probability": [
        lambda: {"values": [1e-3, 2e-3], "noise": 1e-3, "false_alarm": 0.05}
    ],
    "indicators.frequency_shift": [lambda: {"cracked": [1.0, 2.0], "healthy": [1.0, 2.0]}],
}


@functools.cache
def model_branch() -> sb.Branch:
    return sb.frequency_response(model(), PUSH, 300.0, 300.1, steps=64, modes=6, points=10)


@functools.cache
def two_axes() -> sb.Basins:
    axes = [sb.StartAxis([0.0, 0.01]), sb.StartAxis([0.0, 0.1], kind="velocity")]
    return sb.basins(oscillator(), 100.0, 20.0, axes, orbits=[orbit()])


def sideband_lines() -> indicators.Sidebands:
    return indicators.sidebands(TIME, WAVE, 30.0, 4.0, order=1)


LABELS = {"title": "t", "ax": None, "comm": MPI.COMM_WORLD}
CALLS |= {
    "plot.Panel": [
        lambda: {"quantity": "u (m)", "curves": {"one": (TIME, WAVE)}, "window": (0.0, 1.0), "title": "t"}
    ],
    "plot.animate_crack": [
        lambda: {
            "motion": motion(),
            "path": "crack.gif",
            "between": (0.0, 1e-5),
            "frames": 2,
            "seconds": 1.0,
            "magnification": 1.0,
            "colour": "displacement",
        }
    ],
    "plot.plot_backbone": [lambda: {"backbones": backbone(), **LABELS}],
    "plot.plot_basins": [lambda: {"basins": two_axes(), **LABELS}],
    "plot.plot_branches": [
        lambda: {
            "branches": {"a": branch()},
            "direction": "x",
            "harmonic": 1,
            "forces": {"a": 100.0},
            "window": (20.0, 20.2),
            **LABELS,
        }
    ],
    "plot.plot_contact": [lambda: {"cases": static()}],
    "plot.plot_crack": [
        lambda: {"model": model(), "fields": {"a": static()}, "colour": "displacement", "magnification": 1.0}
    ],
    "plot.plot_detection": [
        lambda: {
            "depth": [1e-3, 2e-3, 1e-3, 2e-3],
            "place": [0.1, 0.1, 0.2, 0.2],
            "probability": {"a": [0.1, 0.5, 0.2, 0.9]},
            **LABELS,
        }
    ],
    "plot.plot_discretisation": [lambda: {"mesh": mesh(), "comm": MPI.COMM_WORLD}],
    "plot.plot_field": [
        lambda: {"model": model(), "fields": {"a": static()}, "colour": "stress_xx", "magnification": 1.0}
    ],
    "plot.plot_harmonics": [lambda: {"orbits": {"a": orbit()}, "count": 3, "forces": {"a": 100.0}, **LABELS}],
    "plot.plot_histories": [
        lambda: {"panels": [plot.Panel("u", {"one": (TIME, WAVE)})], "comm": MPI.COMM_WORLD}
    ],
    "plot.plot_history": [lambda: {"motion": motion(), "direction": "x", "window": (0.0, 1e-5), **LABELS}],
    "plot.plot_friction_power": [lambda: {"motions": rubbing_loads(), "window": (0.0, 2.0), **LABELS}],
    "plot.plot_hysteresis": [lambda: {"motions": rubbing_loads(), "pair": 0, "window": (0.0, 2.0), **LABELS}],
    "plot.plot_losses": [lambda: {"orbits": [rubbing_orbit()], **LABELS}],
    "plot.plot_slips": [lambda: {"motion": rubbing_loads(), "window": (0.0, 2.0), **LABELS}],
    "plot.plot_loci": [lambda: {"loci": locus(), "unit": 100.0, "label": "force (N)", **LABELS}],
    "plot.plot_lines": [lambda: {"motions": quasi_periodic(), "order": 2, **LABELS}],
    "plot.plot_load_history": [
        lambda: {"history": loads_in_time(), "direction": "y", "crack": "crack1", **LABELS}
    ],
    "plot.plot_modes": [lambda: {"modal": modal(), "modes": [0], "columns": 1}],
    "plot.plot_multipliers": [lambda: {"subject": orbit(), **LABELS}],
    "plot.plot_quasi_periodic": [lambda: {"branches": quasi_periodic_branch(), "point": "1", **LABELS}],
    "plot.plot_orbit": [lambda: {"orbit": orbit(), "pairs": {"first": 0}, **LABELS}],
    "plot.plot_sidebands": [lambda: {"sidebands": sideband_lines(), **LABELS}],
    "plot.plot_spectra": [
        lambda: {
            "spectra": {"a": (np.arange(1.0, 99.0), WAVE[:98])},
            "quantity": "u (m)",
            "window": (1.0, 50.0),
            "lines": {"tone": 5.0},
            "harmonics": {"family": [5.0, 10.0]},
            "comm": MPI.COMM_WORLD,
        }
    ],
    "plot.plot_swept": [lambda: {"branch": branch(), "swept": swept_response(), **LABELS}],
    "plot.save_picture": [lambda: {"drawing": None, "path": "picture.png"}],
    "plot.save_pictures": [lambda: {"folder": "."}],
    "save": [lambda: {"path": "results.h5", "result": {"modes": modal(), "push": static()}}],
    "read": [lambda: {"path": "given/results.h5"}],
    "write_modes": [lambda: {"path": "modes.vtu", "modal": modal(), "modes": [0], "subdivisions": 1}],
    "write_vtu": [
        lambda: {
            "path": "fields.vtu",
            "model": model(),
            "fields": {"push": static()},
            "stress": False,
            "subdivisions": 1,
        }
    ],
    "estimate": [
        lambda: {
            "model": model(),
            "quantity": lambda model: float(model.boundary_unknowns),
            "accuracy": 0.1,
            "levels": 2,
        },
        lambda: {
            "model": small,
            "quantity": lambda model: float(model.boundary_unknowns),
            "levels": 2,
            "mesh": {"order": 1},
            "continued_fraction": 0,
            "tip_modes": 1,
        },
    ],
    "sweep": [
        lambda: {
            "case": "given/small.toml",
            "parameters": {"model.damping": [0.01]},
            "output": "sweep",
            "analyses": ["push"],
            "comm": MPI.COMM_WORLD,
            "replace": True,
        }
    ],
}


def small(mesh: Arguments, **options: Any) -> sb.Model:
    return sb.Model(Beam(0.1, 0.01).mesh(**{"order": 1, **mesh}), sb.Material(70e9, 0.3, 2700), **options)


# Calls with a model that ranks share: for `tests/system/two_ranks.py`.
SHARED: dict[str, list[Callable[[], Arguments]]] = {}
SHARED["swept_response"] = [
    lambda: {
        "model": model(),
        "load": PUSH,
        "start": 300.0,
        "stop": 301.0,
        "duration": 0.02,
        "steps": 64,
        "modes": 6,
    }
]
SHARED["basins"] = [
    lambda: {
        "model": model(),
        "load": PUSH,
        "frequency": 300.0,
        "starts": [sb.StartAxis([0.0])],
        "steps": 64,
        "modes": 6,
        "longest": 1,
        "tolerance": 1e-3,
        "limit": 4,
    }
]
SHARED["backbone"] = [
    lambda: {
        "model": model(),
        "mode": 1,
        "start": 1e-4,
        "stop": 1.1e-4,
        "damping": False,
        "modes": 6,
        "steps": 64,
        "points": 5,
        "largest_change": 0.4,
        "interactions": False,
        "refine": False,
        "stability": False,
    }
]
SHARED["quasi_periodic"] = [
    lambda: {
        "model": model(),
        "load": sb.PointForce("A", fy=sb.Harmonic(10.0, 6000.0) + sb.Harmonic(20.0, 565.0)),
        "frequencies": (6000.0, 565.0),
        "samples": 5,
        "steps": 64,
        "modes": 6,
        "stability": False,
    }
]
SHARED["grazing_points"] = [lambda: {"branch": model_branch(), "every": False}]
SHARED["loci"] = [
    lambda: {
        "branch": model_branch(),
        "start": 0.9,
        "stop": 1.1,
        "parameter": "load",
        "kinds": ("fold",),
        "points": 2,
    }
]


def fold() -> Bifurcation:
    """Of `model_branch`, made up."""
    state = model_branch().states[0]
    return Bifurcation("fold", 300.05, 1.0 + 0.0j, state, state.astype(complex), 0, 300.05, 1e-6)


def shared_tones() -> sb.QuasiPeriodic:
    """With a tone of its own, made up."""
    found = sb.quasi_periodic(**SHARED["quasi_periodic"][0]())
    return replace(found, own=OwnTone(model_branch().period, "frequency", None, 5, MPI.COMM_WORLD))


SHARED["switch_branch"] = [
    lambda: {"branch": model_branch(), "bifurcation": fold(), "size": 0.1, "samples": 5}
]
SHARED["locus"] = [
    lambda: {
        "branch": model_branch(),
        "bifurcation": fold(),
        "start": 0.9,
        "stop": 1.1,
        "parameter": "load",
        "points": 2,
    }
]
SHARED["quasi_periodic_response"] = [
    lambda: {"guess": shared_tones(), "stop": 560.0, "points": 2, "largest_step": 1.0, "stability": False}
]


# Objects whose public methods are called. They are results: their constructors are not a user's.
OBJECTS: dict[str, Callable[[], Any]] = {
    "Modal": modal,
    "Static": static,
    "LoadHistory": loads_in_time,
    "History": history,
    "Orbit": orbit,
    "Branch": branch,
    "Backbone": backbone,
    "Locus": locus,
    "SweptResponse": swept_response,
    "Basins": basins,
    "QuasiPeriodic": quasi_periodic,
    "QuasiPeriodicBranch": quasi_periodic_branch,
    "FiniteElementModel": body_of_springs,
    "ReducedModel": oscillator,
    "ReducedModal": lambda: sb.modal(oscillator(), 2),
    "ReducedStatic": lambda: sb.static(oscillator(), 100.0),
    "ReducedLoadHistory": lambda: sb.load_history(oscillator(), 100.0, [0.0, 1.0]),
    "Model": model,
    "BoundaryMesh": mesh,
    "Beam": lambda: Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.05)]),
    "Plate": lambda: Plate(
        [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], cracks=[CrackLine([(0.5, 0.0), (0.5, 0.2)])]
    ),
    "DampingTable": lambda: sb.DampingTable([(10.0, 0.01), (100.0, 0.02)]),
    "Harmonic": lambda: sb.Harmonic(1.0, 10.0),
    "Samples": lambda: sb.Samples([0.0, 1.0], [0.0, 1.0]),
}

# Arguments of methods, by "Class.method" or by the name of the argument, where it has no default.
ARGUMENTS: Arguments = {
    "point": "A",
    "place": (0.05, 0.005),
    "crack": "crack1",
    "support": "left",
    "FiniteElementModel.at.place": 3,
    "FiniteElementModel.at.direction": "x",
    "FiniteElementModel.nodal.unknowns": np.ones(2),
    "FiniteElementModel.contact.left": "A",
    "FiniteElementModel.contact.right": None,
    "FiniteElementModel.contact.normal": "x",
    "FiniteElementModel.contact.gap": 1e-3,
    "FiniteElementModel.contact.matching": True,
    "FiniteElementModel.contact.law": sb.Tied(),
    "FiniteElementModel.contact.offset": 0.0,
    "FiniteElementModel.contact.interference": False,
    "Samples.from_csv.path": "given/wave.csv",
    "BoundaryMesh.load.path": "given/mesh.h5",
    "BoundaryMesh.with_gap.gap": 1e-6,
    "BoundaryMesh.export.path": "written.vtk",
    "start": (0.01, 0.005),
    "end": (0.02, 0.005),
    "path": "written.csv",
    "mode": 0,
    "count": 2,
    "k": 0,
    "time": 0.01,
    "t": 0.01,
    "order": 1,
    "frequency": 20.0,
    "m": 1,
    "n": 0,
    "index": 0,
    "Branch.orbit.k": 0,
    "Branch.orbit.index": 0,
    "QuasiPeriodic.line.m": 1,
    "QuasiPeriodicBranch.line.point": "1",
}

# Public for their own modules' sake only: they take what other rooms have checked.
INTERNAL = {
    "Branch": {"conditions"},
    "Model": {
        "keep",
        "load_columns",
        "checked_loads",
        "require_support",
        "equilibrium",
        "require_frictionless",
        "nodal",
        "places",
        "mesh_options",
        "remade",
        "damping_ratios",
        "destroy",
    },
    "ReducedModel": {"output_at", "output_along", "field", "require_frictionless"},
    "Static": {"at_places"},
    "Modal": {"selected"},
    "BoundaryMesh": {"element_nodes", "outline_edges"},
    "Beam": {"check_point", "triangle"},
}

# Warnings, errors and parts of results: nobody calls them with arguments.
NOT_CALLED = {
    "SolveError", "SolverFailure", "UnknownName", "LoadWarning", "BandWarning", "MeshWarning",
    "RanksDiffer", "StepWarning", "BranchWarning", "AccuracyWarning",
    "UnitWarning", "LargeDisplacementWarning", "PlaceWarning",
    "IncompleteHistory", "GmshWarning", "ContactPairs", "Crack", "Tip", "__version__", "Estimate",
}  # fmt: skip


def write_files() -> None:
    """What the calls read, in the present folder."""
    os.makedirs("given", exist_ok=True)
    with open("given/wave.csv", "w", encoding="utf-8") as file:
        file.write("time,value\n0,0\n1,1\n2,0\n")
    sb.transient(oscillator(), 20.0, 0.01, 1e-3, file="given/history.h5")
    sb.save("given/orbit.h5", orbit())
    sb.save("given/branch.h5", branch())
    mesh().save("given/mesh.h5")
    sb.save("given/results.h5", modal())
    with open("given/small.toml", "w", encoding="utf-8") as file:
        file.write(CASE)


@functools.cache
def names() -> dict[str, Any]:
    """What known inputs speak of; files stand in the folder of the first of them."""
    given, burst = matrices(), sb.PointForce("A", fy=sb.Harmonic(10.0, 500.0))
    few: Arguments = {"modes": 6, "steps": 64}

    def changed(**changes: Any) -> sb.ReducedModel:
        return sb.reduce_matrices(**{**given, **changes})

    def finite(*values: Any) -> tuple[str, float]:
        assert all(np.isfinite(value).all() for value in values)
        return "finite", float(np.abs(values[0]).max())

    def steady(*arguments: Any, **options: Any) -> Any:
        found = sb.periodic(*arguments, 300.0, **{**few, **options})
        return finite(found.displacement("A"), found.contact_force)

    def moved(*arguments: Any, **options: Any) -> Any:
        found = sb.transient(*arguments, 1e-3, **{"modes": 6, **options})
        return finite(found.displacement("A"), found.contact_force)

    with open("notes.txt", "w", encoding="utf-8") as file:
        file.write("no folder\n")
    return {
        **{"sb": sb, "np": np, "os": os, "nan": np.nan, "inf": np.inf, "ind": indicators, "plot": plot},
        **{"Beam": Beam, "VNotch": VNotch, "read_gmsh": meshing.read_gmsh, "write_vtu": sb.write_vtu},
        "W": os.getcwd(),
        "READ": {"mesh": BoundaryMesh.load}
        | dict.fromkeys(("hist", "full", "curve", "orbit", "results"), sb.read),
        "beam": Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.05)]),
        **{"mesh": mesh(), "mat": sb.Material(70e9, 0.33, 2700), "model": model(), "F": PUSH, "FH": burst},
        **{"M2": given["mass"], "K2": given["stiffness"], "matrices": changed, "osc": oscillator()},
        **{"red": sb.reduce(model(), PUSH, modes=8), "md": sb.modal(model(), 8), "st": static()},
        "hist": sb.transient(model(), burst, 1e-3, modes=6),
        "orb": sb.periodic(model(), PUSH, 300.0, **few),
        "cur": sb.frequency_response(model(), PUSH, 300.0, 302.0, points=5, **few),
        **{"T": 0.1 * np.arange(1000) / 1000, "U": np.sin(20.0 * np.pi * np.arange(1000) / 1000)},
        **{"PER": steady, "TRN": moved, "MO": lambda found: finite(sb.modal(found, 4).frequencies)},
    }


def public() -> dict[str, Any]:
    """Every public name and what it stands for."""
    found = {name: getattr(sb, name) for name in sb.__all__}
    found |= {name: getattr(meshing, name) for name in meshing.__all__}
    found |= {f"plot.{name}": getattr(plot, name) for name in plot.__all__}
    for name in indicators.__all__:
        item = getattr(indicators, name)
        if not isinstance(item, type):
            found[f"indicators.{name}"] = item
    return found
