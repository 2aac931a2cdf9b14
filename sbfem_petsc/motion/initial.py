"""Initial displacement and velocity given as functions of position."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshing.gll import shape_functions
from meshing.input_checks import values_at

from ..errors import wrong_input
from ..petsc import summed
from ..ranks.parallel import collective
from ..reduction.reduced_model import ReducedModel
from ..selement.coefficients import edge_nodes
from ..selement.interior_motion import interior_fields
from ..system.elements.elements import Elements
from ..system.elements.shapes import Group
from ..system.solve.pencil import Pencil

# Gauss points along the radius, for functions that cells resolve.
RADIAL_POINTS = 8
# Auxiliary unknowns that start: of the greatest inertia in their S-element, down to this share of it. The
# others are fast and small, and known to few digits.
LEAST_INERTIA = 0.1


def momentum(
    pencil: Pencil, function: Callable | None, what: str, less: np.ndarray | None = None
) -> np.ndarray:
    """(local unknowns of the pencil,): the integral of density times a function of x and y over the whole
    body, with the fields that the displacement and auxiliary unknowns stand for. Collective.

    Parameters
    ----------
    pencil : Pencil
        With all auxiliary unknowns.
    function : callable or None
        Of x and y; None is zero.
    what : str
        For messages.
    less : (m, 2) array, optional
        Displacements of this rank's nodes whose static field is taken off the function.

    Raises
    ------
    ValueError
        If the function does not give two finite values a place; on all ranks.
    """
    layout = pencil.layout
    nodal, inside = np.zeros(layout.part.coordinates.shape), np.zeros(len(pencil.auxiliary_inertia()))
    if function is None:
        return np.zeros(pencil.owned + len(inside))
    with collective(layout.comm):
        known: dict[int, _Weights] = {}  # one for each shape
        for group, scale, numbers in pencil.placed():
            weights = known.setdefault(id(group.solution), _Weights(pencil.elements, group))
            on_nodes, on_auxiliary = weights.integrals(
                group, function, what, None if less is None else less[group.nodes]
            )
            np.add.at(nodal, group.nodes, scale * on_nodes)
            inside[numbers] = scale * on_auxiliary
    return np.concatenate([layout.summed(nodal), inside])


class _Weights:
    """Quadrature over S-elements of one shape, and the fields of their unknowns there."""

    def __init__(self, elements: Elements, group: Group):
        eta, along = np.polynomial.legendre.leggauss(group.order + 3)
        xi, inwards = np.polynomial.legendre.leggauss(RADIAL_POINTS)
        self._levels = 0.5 * (xi + 1.0)
        self._edges = edge_nodes(len(group.shape), group.order, group.closed)
        self._values, slopes = shape_functions(group.order, eta)
        outline = group.shape[self._edges]
        (x, y), (dx, dy) = (np.moveaxis(table @ outline, -1, 0) for table in (self._values, slopes))
        self._places = np.stack([x, y], axis=-1)
        area = (x * dy - y * dx) * along  # on the boundary; xi dxi of it inside
        densities = elements.materials[group.material].densities
        if densities is not None:
            area = area * densities[:, None]
        self._area = 0.5 * np.einsum("l,eq->leq", self._levels * inwards, area)
        self._static, self._auxiliary = interior_fields(group.solution, self._levels, elements.terms)
        self._centres = elements.layout.part.centres

    def integrals(
        self, group: Group, function: Callable, what: str, less: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(k, nodes, 2) in each S-element's own frame, and (k, a): in units of rho h^2 t; of the function
        less the static field of displacements (k, nodes, 2), if there are any.
        """
        turned = np.einsum("k,eqi,kij->keqj", group.sizes, self._places, group.rotations)
        rays = self._levels[None, :, None, None, None] * turned[:, None]
        places = self._centres[group.elements][:, None, None, None] + rays
        field = _values(function, places.reshape(-1, 2), what).reshape(places.shape)
        field = np.einsum("kleqj,kij->kleqi", field, group.rotations)  # in the reference frame
        count, depth = len(group.sizes), len(self._levels)
        if less is not None:
            flat = np.einsum("kni,kji->knj", less, group.rotations).reshape(count, -1)
            static = np.einsum("lnm,km->kln", self._static, flat, optimize=True)
            static = static.reshape(count, depth, -1, 2)[:, :, self._edges]
            field -= np.einsum("qa,kleai->kleqi", self._values, static, optimize=True)
        on_edges = np.einsum("leq,qa,kleqi->kleai", self._area, self._values, field, optimize=True)
        on_rays = np.zeros((count, depth, len(group.shape), 2))
        for edge, nodes in enumerate(self._edges):
            on_rays[:, :, nodes] += on_edges[:, :, edge]
        flat = on_rays.reshape(count, depth, -1)
        on_nodes = np.einsum("lnm,kln->km", self._static, flat, optimize=True).reshape(count, -1, 2)
        on_auxiliary = np.einsum("lna,kln->ka", self._auxiliary, flat, optimize=True)
        return np.einsum("kni,kij->knj", on_nodes, group.rotations), on_auxiliary


def _values(function: Callable, places: np.ndarray, what: str) -> np.ndarray:
    """(m, 2): a user's function at places, checked."""
    field = np.zeros(places.shape)
    values = values_at(f"transient: the {what} of initial", function, places)
    try:
        right = not any(np.iscomplexobj(value) for value in values)
        field[:, 0], field[:, 1] = values
        right = right and bool(np.isfinite(field).all())
    except (TypeError, ValueError):
        right = False
    if not right:
        raise ValueError(
            f"transient: the {what} of initial must be a function of arrays x and y that gives two finite "
            "values or arrays, u_x and u_y"
        )
    return field


def modal_start(reduced: ReducedModel, initial: tuple) -> tuple[np.ndarray, np.ndarray]:
    """Modal coordinates and velocities of functions of position: integrals of density times mode times
    function, over the inside of the S-elements as well; what stands for further modes rests.

    Raises
    ------
    ValueError
        If the reduced model has no model behind it; on all ranks.
    """
    model, found = reduced.model, reduced.modal
    if model is None or found is None:
        raise wrong_input(
            "transient: initial by functions of x and y needs a model; give modal coordinates (q, v)"
        )
    with Pencil(model.statics, 1.0, 0.0) as pencil:
        shapes, result = pencil.full_shapes(found.shapes, 2.0 * np.pi * found.frequencies), []
        for function, what in zip(initial, ("displacement", "velocity")):
            q = summed(model.comm, shapes.T @ momentum(pencil, function, what))
            result.append(np.pad(q, (0, reduced.vectors)))
    return result[0], result[1]


def unreduced_state(pencil: Pencil, function: Callable | None, what: str) -> np.ndarray:
    """(local unknowns of the pencil,): a function of x and y as a state of the unreduced model: its values at
    the nodes, and inside the S-elements the nearest field, in the mean square, that the auxiliary unknowns
    add. Collective.

    Raises
    ------
    ValueError
        If it does not give two finite values a place; on all ranks.
    """
    inertia, layout = pencil.auxiliary_inertia(), pencil.layout
    state = np.zeros(pencil.owned + len(inertia))
    if function is None:
        return state
    with collective(layout.comm):
        nodal = _values(function, layout.part.coordinates, what)
    state[: pencil.owned] = layout.owned_values(nodal)
    left = momentum(pencil, function, what, nodal)[pencil.owned :]
    for _, _, numbers in pencil.placed():
        own = numbers[:, inertia[numbers[0]] >= LEAST_INERTIA * inertia[numbers[0]].max(initial=0.0)]
        state[pencil.owned + own] = left[own] / inertia[own]
    return state
