"""A chain of four blocks that rub, by Siconos beside ours, in one run on one core: the same M, K and rows.

Siconos is a code of nonsmooth mechanics with rigid contact and exact friction, in steps of Moreau and Jean's
scheme, which is of the first order; ours gives the blocks a flexibility of 1e-10 of a spring's and takes
steps of the second order. Nobody has the exact motion: what is told is how far the two are apart at each
millisecond, which falls with Siconos' steps. Seconds are CPU seconds of the history alone, compiled before.

    apt-get install python3-siconos    (Debian 12's 4.4; the environment has to see the system's packages)
    ./run python benchmarks/peer_siconos.py
    (about ten seconds)
"""

from __future__ import annotations

import os
import pathlib
import sys
import time
from typing import Any

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np

import sbfem_petsc as sb

COUNT, COEFFICIENTS = 4, (0.1, 0.2, 0.3, 0.4)
PRESSURES, PUSH = np.array([2.0, 1.5, 1.0, 1.2]), sb.Harmonic(4.0, 1.3)
DURATION, STEP = 2.0, 1e-4


def chain() -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of four blocks in a row, of which each rubs and inclined springs press on it."""
    stiffness = np.zeros((2 * COUNT, 2 * COUNT))
    for k in range(COUNT):
        along, inclined = np.zeros(2 * COUNT), np.zeros(2 * COUNT)
        along[k], inclined[k], inclined[COUNT + k] = 1.0, 0.5, 1.0
        if k:
            along[k - 1] = -1.0
        stiffness += 100.0 * np.outer(along, along) + 20.0 * np.outer(inclined, inclined)
    return np.diag(np.repeat([1.0, 0.1], COUNT)), stiffness


def siconos_history(kernel: Any, duration: float, step: float) -> np.ndarray:
    """(n + 1, 4): displacements along the plane by the module `siconos.kernel`."""
    mass, stiffness = chain()
    body = kernel.LagrangianLinearTIDS(np.zeros(2 * COUNT), np.zeros(2 * COUNT), mass)
    body.setKPtr(stiffness)
    system = kernel.NonSmoothDynamicalSystem(0.0, duration)
    system.insertDynamicalSystem(body)
    relations = []
    for k, coefficient in enumerate(COEFFICIENTS):
        relations.append(np.zeros((2, 2 * COUNT)))
        relations[k][0, COUNT + k] = relations[k][1, k] = 1.0
        law = kernel.NewtonImpactFrictionNSL(0.0, 0.0, coefficient, 2)
        system.link(kernel.Interaction(law, kernel.LagrangianLinearTIR(relations[k])), body)
    problem = kernel.FrictionContact(2)
    options = problem.numericsSolverOptions()
    options.dparam[0], options.iparam[0] = 1e-10, 10000
    scheme, clock = kernel.MoreauJeanOSI(0.5), kernel.TimeDiscretisation(0.0, step)
    simulation = kernel.TimeStepping(system, clock, scheme, problem)
    found = np.zeros((round(duration / step) + 1, COUNT))
    for n in range(1, len(found)):
        force = np.append(np.zeros(COUNT), -PRESSURES)
        force[COUNT - 1] = PUSH((n - 0.5) * step)
        body.setFExtPtr(force)
        simulation.computeOneStep()
        found[n] = body.q()[:COUNT]
        simulation.nextStep()
    return found


def reduced_chain() -> sb.ReducedModel:
    """The same for this code; loads are the push on the last block and the pressures on all."""
    mass, stiffness = chain()
    loads = np.zeros((2 * COUNT, 2))
    loads[COUNT - 1, 0], loads[COUNT:, 1] = 1.0, -PRESSURES
    slack = np.full(COUNT, 1e-10)
    return sb.reduce_matrices(
        mass,
        stiffness,
        np.eye(2 * COUNT)[COUNT:],
        np.zeros(COUNT),
        loads=loads,
        sensors={f"x{k}": k for k in range(COUNT)},
        compliance=slack,
        tangent_rows=np.eye(2 * COUNT)[:COUNT],
        tangent_compliance=slack,
        contact_laws=[sb.Coulomb(coefficient) for coefficient in COEFFICIENTS],
    )


def history(reduced: sb.ReducedModel, duration: float, step: float) -> sb.History:
    """Ours, from rest under the pressures."""
    return sb.transient(reduced, [PUSH, 1.0], duration, step, initial="equilibrium", progress=None)


def places(found: sb.History) -> np.ndarray:
    """(n + 1, 4): displacements along the plane."""
    return np.stack([found.displacement(f"x{k}")[:, 1] for k in range(COUNT)], axis=1)


def main() -> None:
    """Print distances and times."""
    try:
        import siconos.kernel as kernel
    except ImportError:
        sys.exit("Siconos is not installed, or not seen by this Python: apt-get install python3-siconos")
    reduced = reduced_chain()
    history(reduced, 0.01, STEP)
    begin = time.process_time()
    x = places(history(reduced, DURATION, STEP))
    print(f"sbfem-petsc, step {STEP:g} s: {time.process_time() - begin:.3f} CPU s")
    for step in (1e-3, 2.5e-4, 1e-4):
        begin = time.process_time()
        other = siconos_history(kernel, DURATION, step)
        spent = time.process_time() - begin
        apart = np.abs(x[:: round(1e-3 / STEP)] - other[:: round(1e-3 / step)]).max()
        print(
            f"Siconos, step {step:g} s: {spent:.3f} CPU s, {apart / np.abs(x).max():.1e} of the largest apart"
        )


if __name__ == "__main__":
    main()
