"""The paper's tone burst of 300 N, 0-33 ms, case P, by scikit-fem's quartic triangles beside ours, in one run
on one core.

scikit-fem gives the matrices of meshes graded to the crack tip (those of `peer_scikit_fem.py`); the nodes of
the crack's faces make the pairs. It has neither contact nor time integration, so both are our own, made for
its matrices as well as we could:

- full: average acceleration on the unreduced matrices with consistent mass, the contact force implicit in
  each step. With w = u0 + u1 a step is one product with the mass matrix, one solve (4/h^2 M + K) w = M (8/h^2
  u0 + 4/h v0) + f0 + f1 + 2 G^T force with a matrix factorised once, and a small complementarity problem in W
  = 2 G (4/h^2 M + K)^-1 G^T. SuperLU solves (symmetric mode, minimum degree ordering; compiled loops over its
  factor, by columns or by blocks of like columns, are no faster), compiled loops do the rest, and x and y
  share one scalar mass matrix;
- reduced: lowest modes and residual flexibility with massless contact, as `sbfem_petsc.reduction` does it. A
  history then costs what ours does for as many pairs, whatever code the matrices are from: only the reduction
  tells the two apart.

Average acceleration has a period error of (omega h)^2 / 12, and beside the resonance of this burst the step
is what limits the full model at 1 us: exact propagation needs the modes, and with them the reduction is the
better use. scikit-fem's meshes are those with the fewest unknowns, of about a hundred, whose reduced history
is within 3e-3 and within 5e-4; sbfem-petsc's the mesh of the other benchmarks, one with less grading and a
coarse one.

Seconds are CPU seconds, one BLAS thread, the least of several repeats; compiling and making the meshes are
not counted, assembly is. Unknowns of sbfem-petsc are those on boundaries. The error is the relative L2
distance of u_y(A) to the independent reference (whose own is 2e-4). Without `--whole` the full model is timed
over a few hundred steps from rest and as many from the middle of the burst, where the crack breathes, and its
seconds are extrapolated, with the instant of first contact between the two.

    ./run python benchmarks/peer_transient.py
    ./run python benchmarks/peer_transient.py --whole         all steps of the full models, with their errors
    (about two and a half minutes)
"""

from __future__ import annotations

import argparse
import os
import pathlib
import sys
import time
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np
import scipy.sparse
from numba import njit
from scipy.sparse.linalg import LinearOperator, eigsh, splu
from skfem import Basis, MeshTri

import sbfem_petsc as sb
from benchmarks import peer_scikit_fem as peer
from benchmarks.transient import DURATION, FORCE, MODES, least
from examples.paper.bench import REFINED, burst, distance, known_burst, off_reference
from meshing import Beam, VNotch
from sbfem_petsc.contact.friction import rubbing_of
from sbfem_petsc.contact.law import RowLaws
from sbfem_petsc.contact.pivoting import contact_forces
from sbfem_petsc.contact.problem import Problem, empty_sets
from sbfem_petsc.loads import separate
from sbfem_petsc.reduction.outputs import LinearOutput

ORDER = 4
# Meshes and steps of the full models; the smaller step brings the period error down to that of the mesh.
MESHES = (
    (peer.MeshParameters(0.01, 1, 2, 1e-5, 0.25, 1, 5e-4, 0.3), (1e-6, 0.5e-6)),
    (peer.MeshParameters(0.0045, 1, 3, 2e-6, 0.35, 1, 1e-4, 0.3), (1e-6, 0.25e-6)),
)
OURS: tuple[dict, ...] = (
    REFINED,
    {"order": 6, "grading": 2.5, "tip_size": 5e-6},
    {"order": 4, "grading": 2.5, "tip_size": 1e-4},
)
REDUCED_STEPS = (1e-6, 4e-6)
MIDDLE = 0.016  # s, the burst's largest load
LANCZOS_VECTORS, LANCZOS_TOLERANCE = 130, 1e-6


@dataclass(frozen=True)
class Matrices:
    """The clamped beam: u_x of all free nodes, then u_y.

    Attributes
    ----------
    stiffness, mass : sparse (n, n) matrices
    gaps : sparse (pairs, n) matrix
        G: opening of the pairs, from the tip to the mouth.
    initial_gap : (pairs,) array
        m.
    load : (n,) array
        1 N at A along y.
    sensor : int
        u_y(A).
    """

    stiffness: scipy.sparse.csc_matrix
    mass: scipy.sparse.csr_matrix
    gaps: scipy.sparse.csr_matrix
    initial_gap: np.ndarray
    load: np.ndarray
    sensor: int


def matrices(points: np.ndarray, triangles: np.ndarray) -> Matrices:
    """Assemble a mesh of `peer.graded_mesh` and pair the nodes of the crack's faces."""
    mesh = MeshTri(points, triangles)
    stiffness, mass = peer._assemble(ORDER, mesh)
    basis = Basis(mesh, peer.ELEMENTS[ORDER](), intorder=2)
    x, y = basis.doflocs[:, basis.complement_dofs(basis.get_dofs(lambda place: place[0] < 1e-9))]
    count, slope = len(x), np.tan(peer.NOTCH_OPENING / 2)
    height, offset = y - (peer.HEIGHT - peer.NOTCH_DEPTH), x - peer.NOTCH_POSITION
    on_face = (height > 1e-6 * peer.NOTCH_DEPTH) & (
        np.abs(np.abs(offset) - height * slope) < 1e-3 * height * slope
    )
    left, right = (np.flatnonzero(on_face & side) for side in (offset < 0, offset > 0))
    left, right = left[np.argsort(height[left])], right[np.argsort(height[right])]
    if len(left) != len(right) or not np.allclose(height[left], height[right]):
        raise RuntimeError("the nodes of the crack's two faces do not match")
    pairs = len(left)
    gaps = scipy.sparse.csr_matrix(
        (np.repeat([1.0, -1.0], pairs), (np.tile(np.arange(pairs), 2), np.concatenate([right, left]))),
        shape=(pairs, 2 * count),
    )
    sensor = count + int(np.argmin(np.hypot(x - peer.LENGTH, y - peer.HEIGHT)))
    load = np.zeros(2 * count)
    load[sensor] = 1.0
    return Matrices(
        peer.YOUNG * stiffness, peer.DENSITY * mass, gaps, 2.0 * height[right] * slope, load, sensor
    )


def factorise(matrix):
    """SuperLU of a symmetric positive definite matrix."""
    return splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


# --- reduced
# ---------------------------------------------------------------------------------------------------------


def reduce_sparse(system: Matrices, modes: int) -> tuple[sb.ReducedModel, np.ndarray, np.ndarray]:
    """Lowest modes and residual flexibility of the pairs and the load, the modes' vectors and the residual
    ones.
    """
    factors, unknowns, pairs = factorise(system.stiffness), system.stiffness.shape[0], len(system.initial_gap)
    eigenvalues, shapes = eigsh(
        system.stiffness,
        k=modes,
        M=system.mass,
        sigma=0.0,
        which="LM",
        ncv=LANCZOS_VECTORS,
        tol=LANCZOS_TOLERANCE,
        OPinv=LinearOperator(system.stiffness.shape, matvec=factors.solve, dtype=float),
        v0=np.random.default_rng(0).standard_normal(unknowns),
    )
    columns = np.concatenate([system.gaps.T.toarray(), system.load[:, None]], axis=1)
    forces = shapes.T @ columns
    residual = factors.solve(columns) - shapes @ (forces / eigenvalues[:, None])
    gap_columns = system.gaps @ residual
    sensor_modes, sensor_columns = np.zeros((1, 2, modes)), np.zeros((1, 2, pairs + 1))
    sensor_modes[0, 1], sensor_columns[0, 1] = shapes[system.sensor], residual[system.sensor]
    contact = 0.5 * (gap_columns[:, :pairs] + gap_columns[:, :pairs].T)
    reduced = sb.ReducedModel(
        np.sqrt(eigenvalues) / (2.0 * np.pi),
        np.zeros(modes),
        LinearOutput((), system.gaps @ shapes, gap_columns[:, pairs:], contact),
        system.initial_gap,
        pairs,
        forces[:, pairs:],
        system.load[None] @ residual[:, pairs:],
        LinearOutput(("A",), sensor_modes, sensor_columns[..., pairs:], sensor_columns[..., :pairs]),
        LinearOutput((), np.zeros((0, 2, modes)), np.zeros((0, 2, 1)), np.zeros((0, 2, pairs))),
        np.zeros((modes, 2)),
    )
    return reduced, shapes, residual


# --- full
# ------------------------------------------------------------------------------------------------------------


class State(NamedTuple):
    """Displacements and velocities, advanced in place."""

    u: np.ndarray
    v: np.ndarray


class ScalarMass(NamedTuple):
    """One direction's mass matrix by compressed rows."""

    starts: np.ndarray
    columns: np.ndarray
    values: np.ndarray


class Pairs(NamedTuple):
    """Unknowns at both ends of the pairs, their gaps, responses of all unknowns to their forces."""

    right: np.ndarray
    left: np.ndarray
    initial_gap: np.ndarray
    responses: np.ndarray


@njit(cache=True)
def _momentum(mass, state, by_u, by_v, right):
    """right := M (by_u u + by_v v), u_x of all nodes before u_y; the scalar mass matrix serves both."""
    starts, columns, values = mass
    u, v = state
    half = u.size // 2
    for i in range(half):
        along_x, along_y = 0.0, 0.0
        for k in range(starts[i], starts[i + 1]):
            j = columns[k]
            along_x += values[k] * (by_u * u[j] + by_v * v[j])
            along_y += values[k] * (by_u * u[half + j] + by_v * v[half + j])
        right[i], right[half + i] = along_x, along_y


@njit(cache=True)
def _advance(w, state, rate, pairs, problem):
    """Contact and the new u and v from w = u0 + u1 without contact. Returns the number of exchanges of the
    active set, -1: not solved.
    """
    u, v = state
    right, left, initial_gap, responses = pairs
    free, force, closed, exchanges = problem.free, problem.force, False, 0
    for k in range(force.size):
        free[k] = initial_gap[k] + (w[right[k]] - u[right[k]]) - (w[left[k]] - u[left[k]])
        closed = closed or free[k] < 0.0
    if closed:
        exchanges = contact_forces(problem)
        for k in range(force.size):
            if force[k] > 0.0:
                twice = 2.0 * force[k]
                for i in range(u.size):
                    w[i] += twice * responses[k, i]
    else:
        force[:], problem.state[:] = 0.0, 0
    for i in range(u.size):
        change = w[i] - 2.0 * u[i]
        u[i] += change
        v[i] = rate * change - v[i]
    return exchanges


class FullModel:
    """The unreduced model with one time step."""

    def __init__(self, system: Matrices, step: float):
        self.system, self.step = system, step
        self.factors = factorise(system.stiffness + 4.0 / step**2 * system.mass)
        half = system.mass.shape[0] // 2
        scalar = system.mass[:half, :half].tocsr()
        self.mass = ScalarMass(scalar.indptr, scalar.indices, scalar.data)
        self.right, self.left = (
            np.array(
                [
                    system.gaps[k].indices[system.gaps[k].data == sign][0]
                    for k in range(len(system.initial_gap))
                ]
            )
            for sign in (1.0, -1.0)
        )
        self.responses = np.ascontiguousarray(self.factors.solve(system.gaps.T.toarray()).T)
        flexibility = 2.0 * (system.gaps @ self.responses.T)
        self.flexibility = 0.5 * (flexibility + flexibility.T)

    def run(
        self, amplitude: np.ndarray, u: np.ndarray | None = None, v: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Steps under a load from a state (rest if none is given): u_y(A) and contact resultant at their
        ends, the last u and v.
        """
        size, pairs, loaded, step = (
            self.responses.shape[1],
            len(self.responses),
            self.system.sensor,
            self.step,
        )
        u, v = (np.zeros(size) if state is None else state.copy() for state in (u, v))
        state, right = State(u, v), np.empty(size)
        contact, gap = Pairs(self.right, self.left, self.system.initial_gap, self.responses), np.empty(pairs)
        laws, rubbing = RowLaws.unilateral(pairs).table, rubbing_of(None, self.flexibility, pairs)
        known = laws, rubbing, np.zeros(pairs, dtype=np.int8), empty_sets(pairs)
        problem = Problem(self.flexibility, gap, gap, *known, np.zeros(pairs))
        drive, solve, by_u, by_v = (
            amplitude[:-1] + amplitude[1:],
            self.factors.solve,
            8.0 / step**2,
            4.0 / step,
        )
        sensed, resultant = np.empty(len(drive)), np.empty(len(drive))
        for s in range(len(drive)):
            _momentum(self.mass, state, by_u, by_v, right)
            right[loaded] += drive[s]
            exchanges = _advance(solve(right), state, 2.0 / step, contact, problem)
            if exchanges < 0:
                raise RuntimeError(f"the contact problem of step {s} was not solved")
            sensed[s], resultant[s] = u[loaded], problem.force.sum()
        return sensed, resultant, u, v


@dataclass(frozen=True)
class FullRun:
    """Cost of a full model, and its history's error where all of it was run."""

    nonzeros: int
    prepared: float
    open_step: float
    breathing_step: float
    seconds: float
    error: float | None
    peak: float | None
    lost: float | None


class Recovery(NamedTuple):
    """Modes and residual vectors by which modal coordinates, contact forces and loads give displacements."""

    shapes: np.ndarray
    residual: np.ndarray


def run_full(system: Matrices, reduced, recovery: Recovery, step: float, own) -> FullRun:
    """Time the full model at one step; `reduced` is the history of the same mesh that states in the middle
    of the burst are taken from.
    """
    shapes, residual = recovery
    signal = separate(burst(FORCE))[1][0]
    prepared, model = least(lambda: FullModel(system, step), 1)
    k = round(MIDDLE / reduced.step)
    states = reduced.states
    u = shapes @ states.q[k] + residual @ np.append(states.contact[k], states.amplitudes[k])
    v = shapes @ states.v[k]
    early, middle = signal(step * np.arange(own.steps + 1)), signal(MIDDLE + step * np.arange(own.steps + 1))
    model.run(early[:3])
    open_step = least(lambda: model.run(early), own.repeats)[0] / own.steps
    breathing_step = least(lambda: model.run(middle, u, v), own.repeats)[0] / own.steps
    count, before = (
        round(DURATION / step),
        round(reduced.time[np.argmax(reduced.contact_resultant > 0.0)] / step),
    )
    seconds, error, peak, lost = before * open_step + (count - before) * breathing_step, None, None, None
    if own.whole:
        time_points = step * np.arange(count + 1)
        amplitude = signal(time_points)
        seconds, (sensed, resultant, u, v) = least(lambda: model.run(amplitude), 1)
        times, exact = known_burst(FORCE)
        error = distance(np.interp(times, time_points[1:], sensed), exact)
        peak = float(resultant.max())
        work = np.cumsum(0.5 * (amplitude[1:] + amplitude[:-1]) * np.diff(sensed, prepend=0.0))
        lost = float(
            (work[-1] - 0.5 * (v @ (system.mass @ v) + u @ (system.stiffness @ u))) / np.abs(work).max()
        )
    return FullRun(model.factors.L.nnz, prepared, open_step, breathing_step, seconds, error, peak, lost)


# --- command
# ---------------------------------------------------------------------------------------------------------


def prepare(mesh, repeats: int):
    """Least CPU seconds from a boundary mesh to the reduced model, the last model and its reduced one."""
    seconds, model = np.inf, None
    for _ in range(repeats):
        if model is not None:
            model.destroy()
        began = time.process_time()
        model = sb.Model(
            mesh, sb.Material(young=peer.YOUNG, poisson=peer.POISSON, density=peer.DENSITY), clamped="left"
        )
        reduced = sb.reduce(model, burst(FORCE), modes=MODES)
        seconds = min(seconds, time.process_time() - began)
    return seconds, model, reduced


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--repeats", type=int, default=3, help="runs of each, the fastest counts (default 3)")
    parser.add_argument(
        "--steps",
        type=int,
        default=660,
        help="steps of the full models that are timed, from rest and again from the middle of the burst "
        "(default 660)",
    )
    parser.add_argument(
        "--whole",
        action="store_true",
        help="run the full models over all 33 ms (about two and a half minutes)",
    )
    own = parser.parse_args()
    if own.repeats < 1 or own.steps < 1:
        parser.error("--repeats and --steps must be at least 1")
    signals = separate(burst(FORCE))[1]
    ours, notes = None, []

    def line(name, size, step, spent, found):
        (unknowns, pairs), (before, seconds), (error, peak) = size, spent, found
        judged = f"{'':12s}{'':11s}" if error is None else f"{error:12.2e}{peak:11.0f}"
        print(
            f"{name:26s}{unknowns:9,d}{pairs:7d}{step * 1e6:10.4g}{before:11.2f}"
            f"{1e3 * seconds * step / DURATION:12.4f}{seconds:11.3f}{judged}{seconds / ours:11.2f}",
            flush=True,
        )

    def history(reduced, step):
        return least(lambda: sb.transient(reduced, signals, DURATION, step, progress=None), own.repeats)

    print(
        "model                      unknowns  pairs  step, us  before, s   ms a step   33 ms, s    L2 error  "
        "  peak, N     / ours"
    )
    for k, choice in enumerate(OURS):
        mesh = Beam(
            length=peer.LENGTH,
            height=peer.HEIGHT,
            notches=[
                VNotch(x=peer.NOTCH_POSITION, depth=peer.NOTCH_DEPTH, opening=np.degrees(peer.NOTCH_OPENING))
            ],
        ).mesh(**choice)
        if k == 0:
            prepare(mesh, 1)[1].destroy()
        before, model, reduced = prepare(mesh, own.repeats)
        if k == 0:
            sb.transient(reduced, signals, 1e-5, 1e-6)
        for step in REDUCED_STEPS:
            seconds, found = history(reduced, step)
            ours = ours or seconds
            line(
                "sbfem-petsc, reduced",
                (model.boundary_unknowns, len(model.pairs)),
                step,
                (before, seconds),
                (off_reference(found, FORCE), found.contact_resultant.max()),
            )
        model.destroy()
    for parameters, steps in MESHES:
        points, triangles = peer.graded_mesh(parameters)
        assembly, system = least(partial(matrices, points, triangles), own.repeats)
        size = system.stiffness.shape[0], len(system.initial_gap)
        reducing, (reduced, *recovery) = least(partial(reduce_sparse, system, MODES), own.repeats)
        histories = {}
        for step in REDUCED_STEPS:
            seconds, histories[step] = history(reduced, step)
            line(
                f"scikit-fem P{ORDER}, reduced",
                size,
                step,
                (assembly + reducing, seconds),
                (off_reference(histories[step], FORCE), histories[step].contact_resultant.max()),
            )
        for step in steps:
            run = run_full(system, histories[REDUCED_STEPS[0]], Recovery(*recovery), step, own)
            line(
                f"scikit-fem P{ORDER}, full",
                size,
                step,
                (assembly + run.prepared, run.seconds),
                (run.error, run.peak),
            )
            notes.append(
                f"full, {size[0]:,d} unknowns, {step * 1e6:g} us: {1e3 * run.open_step:.3f} ms a step with "
                f"the crack open, {1e3 * run.breathing_step:.3f} ms breathing; {run.nonzeros:,d} numbers in "
                "L"
                + (
                    ""
                    if run.lost is None
                    else f"; contact dissipated {run.lost:.1e} of the largest external work"
                )
            )
    print(
        '"before": from the mesh to the reduction, or to the factors and the responses to unit forces of the '
        'pairs; "/ ours": 33 ms over those of the first line'
    )
    print(
        "full: "
        + (
            "all steps run"
            if own.whole
            else f"extrapolated from {own.steps} steps with the crack open and {own.steps} breathing; errors "
            "with --whole"
        )
    )
    print("\n".join(notes))


if __name__ == "__main__":
    main()
