"""Lowest modes plus residual flexibility for contact pairs, loads and sensors; contact carries no mass
(MacNeal 1971).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ..analysis.modal import modal
from ..contact.delassus import ContactRows
from ..loads import PointForce, SupportMotion
from ..petsc import MPI, check_ksp, make_ksp
from ..system.model import Model


@dataclass(frozen=True, eq=False)
class Reduction:
    """A model in modal coordinates q with the static flexibility R = K^-1 - Phi Omega^-2 Phi^T of what was
    left out.

    q'' + 2 zeta Omega q' + Omega^2 q = load_modes s + gap_modes^T force,
    gap = gap_modes q + gap_flexibility force + gap_loads s + initial_gap,
    displacement = sensor_modes q + sensor_loads s + sensor_pairs force,
    with the amplitudes s(t) of unit loads and the contact forces.

    Attributes
    ----------
    frequencies : (m,) array
        Hz.
    omega : (m,) array
        rad/s.
    damping : (m,) array
        Modal damping ratios.
    gap_modes : (pairs, m) array
    gap_flexibility : (pairs, pairs) array
        G R G^T, m/N.
    gap_loads : (pairs, loads) array
        G R f, m per unit load.
    load_modes : (m, loads) array
        Phi^T f.
    load_flexibility : (loads, loads) array
        f^T R f.
    initial_gap : (pairs,) array
        m.
    points : tuple of str
    sensor_modes, sensor_loads, sensor_pairs : (points, 2, m), (points, 2, loads), (points, 2, pairs) arrays
    translation : (m, 2) array
        Modal coordinates of a unit translation along x and y: Phi^T M r.
    tips : tuple of str
        Cracks with a tip element.
    tip_modes, tip_loads, tip_pairs : (tips, 2, m), (tips, 2, loads), (tips, 2, pairs) arrays
        K_I and K_II.
    """

    frequencies: np.ndarray
    omega: np.ndarray
    damping: np.ndarray
    gap_modes: np.ndarray
    gap_flexibility: np.ndarray
    gap_loads: np.ndarray
    load_modes: np.ndarray
    load_flexibility: np.ndarray
    initial_gap: np.ndarray
    points: tuple[str, ...]
    sensor_modes: np.ndarray
    sensor_loads: np.ndarray
    sensor_pairs: np.ndarray
    translation: np.ndarray
    tips: tuple[str, ...]
    tip_modes: np.ndarray
    tip_loads: np.ndarray
    tip_pairs: np.ndarray

    def __repr__(self) -> str:
        return (
            f"Reduction({len(self.omega)} modes up to {self.frequencies[-1]:.6g} Hz, {len(self.initial_gap)} "
            f"contact pairs, {self.load_modes.shape[1]} unit loads)"
        )


def communicator(model: Model | Reduction) -> MPI.Comm:
    """Ranks that work on a model together; a Reduction is each rank's own.

    Raises
    ------
    TypeError
        If it is neither.
    """
    if not isinstance(model, (Model, Reduction)):
        raise TypeError(f"model = {model!r} must be a Model or a Reduction")
    return MPI.COMM_SELF if isinstance(model, Reduction) else model.comm


def check_reduction(model: Model, reduction: Reduction, unit_loads, what: str) -> None:
    """Raise ValueError if a reduction was made for another model or other loads, as far as it tells."""
    if reduction.load_modes.shape[1] != len(unit_loads):
        raise ValueError(
            f"{what}: the reduction has {reduction.load_modes.shape[1]} unit loads, the load has "
            f"{len(unit_loads)}; reduce the model again"
        )
    if len(reduction.initial_gap) != len(model.pairs) or not np.allclose(
        reduction.damping, model.damping_ratios(reduction.omega), rtol=1e-6, atol=0.0
    ):
        raise ValueError(
            f"{what}: the reduction was made for a model of other contact pairs or damping; reduce the model "
            "again, with reduction = 'modes'"
        )
    for k, unit in enumerate(unit_loads):
        # a force at a point acts on the modes as they move that point
        if isinstance(unit, PointForce):
            moved = (
                reduction.sensor_modes[reduction.points.index(unit.point), 0 if unit.fx else 1]
                if unit.point in reduction.points
                else np.inf
            )
            if (
                np.abs(reduction.load_modes[:, k] - moved).max()
                > 1e-6 * np.abs(reduction.load_modes[:, k]).max()
            ):
                raise ValueError(
                    f"{what}: the reduction was made for other loads than {unit!r}; reduce the model again, "
                    "with reduction = 'modes'"
                )


def reduce(model: Model, unit_loads, modes: int) -> Reduction:
    """Reduce a model to its lowest modes and the residual flexibility of its contact pairs and loads.

    Parameters
    ----------
    model : Model
        Held against every rigid-body motion.
    unit_loads : sequence of Load
        One column each.
    modes : int

    Notes
    -----
    One static solve a contact pair and a load (prefix ``static_``), one eigenvalue problem (prefix
    ``modal_``). All that is kept is small and the same on every rank.
    """
    model.require_support("the reduction")
    found = modal(model, modes)
    rows = ContactRows(model)
    pairs, loads = len(rows.rows), len(unit_loads)
    gap_modes = rows.local(found.shapes)
    model.comm.Allreduce(MPI.IN_PLACE, gap_modes)
    sensor_modes = (
        np.stack([found.point_shapes[name].T for name in model.points])
        if model.points
        else np.zeros((0, 2, modes))
    )

    # inertia forces of unit accelerations, the auxiliary unknowns' share included
    translation = found.auxiliary_inertia.copy()
    owned_share = np.zeros_like(translation)
    for k, motion in enumerate((SupportMotion(ax=1.0), SupportMotion(ay=1.0))):
        vector = model.load_vector(motion)
        owned_share[:, k] = -(found.shapes.T @ vector.array_r)
        vector.destroy()
    model.comm.Allreduce(MPI.IN_PLACE, owned_share)
    translation += owned_share

    ksp = make_ksp(model.stiffness, "static_")
    right, solution = model.stiffness.createVecs()
    columns = pairs + loads
    gap_columns, load_modes = np.empty((pairs, columns)), np.empty((modes, loads))
    sensor_columns, tip_columns = np.empty((len(model.points), 2, columns)), []
    load_vectors = [model.load_vector(load) for load in unit_loads]
    work = np.zeros((loads, columns))
    for k in range(columns):
        if k < pairs:
            right.set(0.0)
            rows.add_forces(right, np.eye(pairs)[k])
        else:
            load_vectors[k - pairs].copy(right)
            load_modes[:, k - pairs] = found.shapes.T @ right.array_r
        ksp.solve(right, solution)
        check_ksp(ksp, "reduction")
        gap_columns[:, k] = rows.gaps(solution)
        for name, value in enumerate(model.at_points(solution.array_r).values()):
            sensor_columns[name, :, k] = value
        tip_columns.append(np.array(list(model.tips.evaluate(model.nodal(solution)).values())).reshape(-1, 2))
        work[:, k] = [vector.dot(solution) for vector in load_vectors]
    model.comm.Allreduce(MPI.IN_PLACE, load_modes)
    for k, unit in enumerate(unit_loads):
        if isinstance(unit, SupportMotion):
            load_modes[:, k] = -translation @ [unit.ax, unit.ay]
    tip_modes = np.stack(
        [np.array(list(model.tips.evaluate(found.nodal(k)).values())).reshape(-1, 2) for k in range(modes)],
        axis=-1,
    )
    tip_columns = np.stack(tip_columns, axis=-1) if columns else np.zeros((len(model.tips.names), 2, 0))
    for item in (right, solution, ksp, *load_vectors):
        item.destroy()

    omega = 2.0 * np.pi * found.frequencies
    modal_columns = np.concatenate([gap_modes.T, load_modes], axis=1) / omega[:, None] ** 2

    def residual(columns_of, modes_of):
        return columns_of - modes_of @ modal_columns

    gap_columns, sensor_columns, tip_columns = (
        residual(gap_columns, gap_modes),
        residual(sensor_columns, sensor_modes),
        residual(tip_columns, tip_modes),
    )
    work = residual(work, load_modes.T)
    flexibility = gap_columns[:, :pairs]
    return Reduction(
        found.frequencies,
        omega,
        model.damping_ratios(omega),
        gap_modes,
        0.5 * (flexibility + flexibility.T),
        gap_columns[:, pairs:],
        load_modes,
        0.5 * (work[:, pairs:] + work[:, pairs:].T),
        model.pairs.gap.copy(),
        tuple(model.points),
        sensor_modes,
        sensor_columns[..., pairs:],
        sensor_columns[..., :pairs],
        translation,
        model.tips.names,
        tip_modes,
        tip_columns[..., pairs:],
        tip_columns[..., :pairs],
    )


def reduce_matrices(
    mass: np.ndarray,
    stiffness: np.ndarray,
    contact_rows: np.ndarray,
    gap: np.ndarray,
    loads: np.ndarray,
    sensors: dict[str, int],
    modes: int | None = None,
    damping: float | np.ndarray = 0.0,
    compliance: np.ndarray | None = None,
) -> Reduction:
    """A system given by its matrices: textbook oscillators, bars, other codes' examples.

    `transient`, `periodic`, `frequency_response` and `load_response` take the result in the place of a model,
    with a number or a signal for each unit load.

    Parameters
    ----------
    mass, stiffness : (n, n) arrays
        Mass positive definite; the stiffness may admit rigid-body motions.
    contact_rows : (pairs, n) array
        Gap = contact_rows u + gap + compliance force.
    gap : (pairs,) array
    loads : (n, k) array
        Unit loads.
    sensors : dict of str to int
        Names of unknowns; each is the y displacement of a point.
    modes : int, optional
        Lowest modes kept; the others act by their flexibility. Default: all.
    damping : float or (n, n) array
        Modal damping ratio, or a damping matrix that the modes make diagonal, such as a M + b K.
    compliance : (pairs,) array, optional
        Of elastic stops, m/N.

    Raises
    ------
    ValueError
        If shapes do not fit, if a damping matrix couples the modes, or if a contact row has no compliance at
        all: a rigid stop on an unknown whose mass is kept in full has no law in this form.
    """
    mass, stiffness, contact_rows, gap, loads = (
        np.asarray(item, dtype=float) for item in (mass, stiffness, contact_rows, gap, loads)
    )
    n, pairs = len(mass), len(gap)
    for name, array, shape in (
        ("mass", mass, (n, n)),
        ("stiffness", stiffness, (n, n)),
        ("contact_rows", contact_rows, (pairs, n)),
        ("loads", loads, (n, *loads.shape[1:2])),
    ):
        if array.shape != shape or not np.isfinite(array).all():
            raise ValueError(
                f"reduce_matrices: {name} has shape {array.shape}; finite values of shape {shape} are "
                "expected"
            )
    modes = n if modes is None else modes
    values, vectors = linalg.eigh(stiffness, mass)
    # rigid-body modes come out at round-off's level
    values = np.where(values < 1e-12 * values[-1], 0.0, values)
    kept, left = vectors[:, :modes], vectors[:, modes:]
    omega = np.sqrt(values[:modes])
    columns = np.concatenate([contact_rows.T, loads], axis=1)
    flexibility = (left / values[modes:]) @ (left.T @ columns)
    gap_flexibility = contact_rows @ flexibility[:, :pairs] + np.diag(
        np.zeros(pairs) if compliance is None else compliance
    )
    weak = np.flatnonzero(np.diag(gap_flexibility) <= 0.0)
    if len(weak):
        raise ValueError(
            f"contact row {weak[0]}: a rigid stop on an unknown with mass has no compliance; keep fewer "
            "modes than unknowns or give the stop a compliance"
        )
    index = list(sensors.values())

    def at_sensors(array):
        result = np.zeros((len(index), 2, array.shape[1]))
        result[:, 1] = array[index]
        return result

    return Reduction(
        omega / (2.0 * np.pi),
        omega,
        _ratios(damping, kept, omega),
        contact_rows @ kept,
        gap_flexibility,
        contact_rows @ flexibility[:, pairs:],
        kept.T @ loads,
        loads.T @ flexibility[:, pairs:],
        gap,
        tuple(sensors),
        at_sensors(kept),
        at_sensors(flexibility[:, pairs:]),
        at_sensors(flexibility[:, :pairs]),
        np.zeros((modes, 2)),
        (),
        np.zeros((0, 2, modes)),
        np.zeros((0, 2, loads.shape[1])),
        np.zeros((0, 2, pairs)),
    )


def _ratios(damping, modes: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Modal damping ratios from one number or a damping matrix."""
    if np.ndim(damping) == 0:
        return np.full(len(omega), float(damping))
    modal = modes.T @ np.asarray(damping, dtype=float) @ modes
    own = np.diag(modal)
    coupling = np.abs(modal - np.diag(own)).max(initial=0.0)
    if coupling > 1e-9 * np.abs(own).max():
        raise ValueError(
            "reduce_matrices: the damping matrix couples the modes (up to "
            f"{coupling / np.abs(own).max():.2g} of the largest modal damping); give modal damping ratios, "
            "or a matrix such as a M + b K"
        )
    rigid = omega == 0.0
    if (np.abs(own[rigid]) > 1e-9 * np.abs(own).max()).any():
        raise ValueError(
            "reduce_matrices: the damping matrix damps a rigid-body motion, which has no damping ratio; hold "
            "the system by a weak spring"
        )
    return np.where(rigid, 0.0, own / (2.0 * np.where(rigid, 1.0, omega)))
