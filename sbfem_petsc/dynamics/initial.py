"""Initial displacement and velocity given as functions of position."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..analysis.modal import Modal, modal
from ..contact.delassus import ContactRows
from ..errors import on_all_ranks
from ..parallel import collective
from ..petsc import MPI
from ..reduction.reduced_model import Reduction
from ..system.model import Model
from ..system.pencil import Pencil

# Relative difference at the points and pairs up to which modes computed again are those of a reduction.
SAME = 1e-4


def nodal_field(model: Model, function: Callable | None, what: str) -> np.ndarray:
    """(m, 2): values at this rank's nodes of a function of x and y, zero for None.

    Raises
    ------
    ValueError
        If it does not give two finite values a place; on all ranks.
    """
    places = model.part.coordinates
    field = np.zeros(places.shape)
    if function is None:
        return field
    with collective(model.comm):
        values = function(places[:, 0].copy(), places[:, 1].copy())
        try:
            field[:, 0], field[:, 1] = values
            right = bool(np.isfinite(field).all())
        except (TypeError, ValueError):
            right = False
        if not right:
            raise ValueError(
                f"transient: the {what} of start must be a function of arrays x and y that gives two finite "
                "values or arrays, u_x and u_y"
            )
    return field


def owned_values(model: Model, field: np.ndarray) -> np.ndarray:
    """This rank's displacement unknowns of a field (m, 2) at its nodes."""
    first, last = model.ranges[model.comm.rank], model.ranges[model.comm.rank + 1]
    unknowns = model.part.unknowns
    mine = (unknowns >= first) & (unknowns < last)
    values = np.zeros(last - first)
    values[unknowns[mine] - first] = field[mine]
    return values


def full_shapes(pencil: Pencil, found: Modal) -> np.ndarray:
    """(local unknowns of the pencil, n): modes with their auxiliary unknowns, by the lower half of (K -
    omega^2 M) phi = 0.
    """
    upper, lower = pencil.coupling.createVecs()[::-1]
    shapes = np.zeros((pencil.owned + lower.getLocalSize(), len(found.frequencies)), order="F")
    shapes[: pencil.owned] = found.shapes
    for k, value in enumerate((2.0 * np.pi * found.frequencies) ** 2):
        upper.array = found.shapes[:, k]
        pencil.coupling.multTranspose(upper, lower)
        shapes[pencil.owned :, k] = value * lower.array_r / pencil.auxiliary_diagonal(value)
    upper.destroy()
    lower.destroy()
    return shapes


def modal_start(model: Model, reduction: Reduction, start: tuple) -> tuple[np.ndarray, np.ndarray]:
    """Modal coordinates and velocities Phi^T M u of functions of position.

    Auxiliary unknowns start from zero: inside the S-elements that is the static displacement of what their
    boundaries do.

    Raises
    ------
    ValueError
        If the modes cannot be told from the reduction's: another model's, or multiple frequencies.
    """
    found = modal(model, len(reduction.omega))
    rows = ContactRows(model).local(found.shapes)
    model.comm.Allreduce(MPI.IN_PLACE, rows)
    mine = np.concatenate([rows, *(found.point_shapes[name].T for name in model.points)])
    theirs = np.concatenate([reduction.gap_modes, reduction.sensor_modes.reshape(-1, len(reduction.omega))])
    signs = (
        np.where((mine * theirs).sum(axis=0) < 0.0, -1.0, 1.0)
        if mine.shape == theirs.shape
        else np.ones(len(reduction.omega))
    )
    if (
        mine.shape != theirs.shape
        or (
            np.linalg.norm(signs * mine - theirs, axis=0)
            > SAME * np.linalg.norm(theirs, axis=0).max(initial=0.0)
        ).any()
    ):
        raise on_all_ranks(
            ValueError(
                "transient: the model's modes are not those of the reduction, or some have the same "
                "frequency and are not unique; give start in modal coordinates (q, v)"
            )
        )
    pencil = Pencil(model, 1.0, 0.0)
    shapes, (field, product) = full_shapes(pencil, found), pencil.mass.createVecs()
    result = []
    for function, what in zip(start, ("displacement", "velocity")):
        values = nodal_field(model, function, what)
        field.set(0.0)
        field.array[: pencil.owned] = owned_values(model, values)
        pencil.mass.mult(field, product)
        q = shapes.T @ product.array_r
        model.comm.Allreduce(MPI.IN_PLACE, q)
        result.append(signs * q)
    for item in (field, product, pencil):
        item.destroy()
    return tuple(result)
