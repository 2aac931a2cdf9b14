"""Initial displacement and velocity given as functions of position."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from ..errors import on_all_ranks
from ..parallel import collective
from ..petsc import MPI
from ..reduction.reduced_model import ReducedModel
from ..selement.basis import shape_functions
from ..selement.coefficients import edge_nodes
from ..selement.interior import InteriorSampler
from ..system.model import Model
from ..system.modes import Modal
from ..system.pencil import Pencil
from ..system.resolution import MeshWarning, caller_level
from ..system.shapes import Group

# Share of a start inside the S-elements, root mean square, beyond which is warned: u_y = x^2 on beams
# of 100 mm moves the free end wrong by 5e-5, 2e-4, 3e-3 and 3e-2 at 6e-5, 2.3e-4, 3e-4 and 1.2e-3.
UNSEEN = 2.5e-4


def nodal_field(model: Model, function: Callable | None, what: str) -> np.ndarray:
    """(m, 2): values at this rank's nodes of a function of x and y, zero for None.

    Raises
    ------
    ValueError
        If it does not give two finite values a place; on all ranks.

    Warns
    -----
    MeshWarning
        If the function has inside the S-elements what its values on their boundaries do not determine.
    """
    places = model.part.coordinates
    if function is None:
        return np.zeros(places.shape)
    with collective(model.comm):
        field = _values(function, places, what)
        parts = np.array([_unseen(model, function, group, field, what) for group in model.groups])
    unseen, whole = model.comm.allreduce(parts.reshape(-1, 2).sum(axis=0))
    if unseen > UNSEEN**2 * whole:
        warnings.warn(
            f"transient: inside the S-elements the {what} of start differs by {np.sqrt(unseen / whole):.1g} "
            "of itself (root mean square) from the static field of its values on their boundaries, in which "
            "the motion starts; displacements may be off by ten times as much. Make cells smaller (size)",
            MeshWarning,
            stacklevel=caller_level(),
        )
    return field


def _values(function: Callable, places: np.ndarray, what: str) -> np.ndarray:
    """(m, 2): a user's function at places, checked."""
    field = np.zeros(places.shape)
    try:
        values = function(places[:, 0].copy(), places[:, 1].copy())
    except Exception as error:  # whatever a user's function does
        raise ValueError(
            f"transient: the {what} of start failed as a function of arrays x and y: "
            f"{type(error).__name__}: {error}"
        ) from error
    try:
        right = not any(np.iscomplexobj(value) for value in values)
        field[:, 0], field[:, 1] = values
        right = right and bool(np.isfinite(field).all())
    except (TypeError, ValueError):
        right = False
    if not right:
        raise ValueError(
            f"transient: the {what} of start must be a function of arrays x and y that gives two finite "
            "values or arrays, u_x and u_y"
        )
    return field


def _unseen(
    model: Model, function: Callable, group: Group, field: np.ndarray, what: str
) -> tuple[float, float]:
    """Integrals over the S-elements of one shape: squares of what the function has there beyond the static
    displacement of its boundary values, and of itself.
    """
    eta, along = np.polynomial.legendre.leggauss(group.order + 1)
    xi, inwards = np.polynomial.legendre.leggauss(4)
    levels = 0.5 * (xi + 1.0)
    elasticity = model.materials[group.material].elasticity
    sampler = InteriorSampler(group.solution.radial, group.shape, group.order, group.closed, elasticity, eta)
    places = sampler.positions(levels, model.part.centres[group.elements], group.sizes, group.rotations)
    rays = sampler.radial_fields(field[group.nodes], group.rotations, levels)
    static = sampler.displacement(rays, group.rotations)
    exact = _values(function, places.reshape(-1, 2), what).reshape(places.shape)
    # area of a point's share: xi |x cross dx/deta| of its edge
    values, slopes = shape_functions(group.order, eta)
    outline = group.shape[edge_nodes(len(group.shape), group.order, group.closed)]
    (x, y), (dx, dy) = np.moveaxis(values @ outline, -1, 0), np.moveaxis(slopes @ outline, -1, 0)
    area = np.einsum("k,l,eq->kleq", group.sizes**2, levels * inwards, np.abs(x * dy - y * dx) * along)
    integrals = [np.sum(area[..., None] * part**2) for part in (exact - static, exact)]
    return float(integrals[0]), float(integrals[1])


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


def modal_start(reduced: ReducedModel, start: tuple) -> tuple[np.ndarray, np.ndarray]:
    """Modal coordinates and velocities Phi^T M u of functions of position.

    Auxiliary unknowns start from zero: inside the S-elements that is the static displacement of what their
    boundaries do.

    Raises
    ------
    ValueError
        If the reduced model has no model behind it; on all ranks.
    """
    model, found = reduced.model, reduced.modal
    if model is None or found is None:
        raise on_all_ranks(
            ValueError(
                "transient: a start by functions of x and y needs a model; give modal coordinates (q, v)"
            )
        )
    pencil = Pencil(model, 1.0, 0.0)
    try:
        shapes, (field, product) = full_shapes(pencil, found), pencil.mass.createVecs()
        result = []
        for function, what in zip(start, ("displacement", "velocity")):
            values = nodal_field(model, function, what)
            field.set(0.0)
            field.array[: pencil.owned] = owned_values(model, values)
            pencil.mass.mult(field, product)
            q = shapes.T @ product.array_r
            model.comm.Allreduce(MPI.IN_PLACE, q)
            result.append(q)
        field.destroy()
        product.destroy()
    finally:
        pencil.destroy()
    return result[0], result[1]
