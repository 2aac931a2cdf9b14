"""Whether cells and order carry a state at rest: errors of the displacement, estimated cell by cell."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from meshing.gll import gll_nodes, tabulated

from ...errors import listed, warn_of_mesh
from ...loads import EdgeLoad, Loads, PointForce
from ...selement.coefficients import edge_nodes
from ...selement.solution import SElement
from ..elements.shapes import Group
from ..layout.layout import Layout
from ..model import Model
from ..solve.stiffness import Stiffness
from ..supports import edge_metric
from .resolution import MORE_ORDERS, Edges, energies_lost, further_polynomials

# Relative error of displacements under the loads beyond which the user is warned. On 50 beams, blocks and
# plates with holes and cracks in orders 1 to 5, from 63 % to 6e-6, .59 to 1.46 of it is told, the least where
# more than a tenth is missed.
WARNED = 1e-3
# An error is estimated where the next polynomials on the edges, if they fall as the last two do, may have
# more than `WARNED`: they have .4 times as much energy as is told, or more.
SAFE = 2.5
# Part of their doubts, or of the body in the middle of these, in which states of a model differ that are
# looked at one by one. By the doubts alone 76 of 581 loads on plates had the error of another one, .53 to 1.9
# times theirs, and 7 were told of or not for it; in the same place none is a quarter off.
ALIKE = 0.01
# Of the states of a history, which are in most doubt, at most.
LOOKED_AT = 4
# Strain energy in units of E t |u|^2 that is rounding, as of a body that its supports move as a whole.
_ROUND_OFF, _TINY = 1e-12, 1e-300
_NONE = np.empty(0, dtype=int)


class AtRest(NamedTuple):
    """A static state.

    Attributes
    ----------
    name : str
        The analysis, and what tells the state from others, for messages.
    field : (m, 2) array
        Displacements of this rank's nodes, m.
    load : Loads
        Constant ones.
    acceleration : (2,) array
        Of the supports, m/s^2.
    pressed : (n,) int array
        Nodes that contact forces act on, by their numbers in the mesh.
    energy : float
        Strain energy, J.
    """

    name: str
    field: np.ndarray
    load: Loads
    acceleration: np.ndarray
    pressed: np.ndarray
    energy: float


def warn_of_rest(model: Model, states: Sequence[AtRest]) -> None:
    """Warn if displacements of one of some states are off by more than `WARNED`, of that which is off most
    among the `LOOKED_AT` in most doubt. Collective.
    """
    doubts, middles = _doubts(model.statics, states)
    error, worst, order, looked_at = WARNED, None, model.layout.order, set[tuple]()
    for k in np.argsort(-doubts, kind="stable"):
        if doubts[k] <= error or len(looked_at) == LOOKED_AT:
            break
        # states in as much doubt about the same place, as of other amplitudes of a load, are alike: large
        # meshes take seconds for one
        alike = np.rint([np.log(doubts[k]) / ALIKE, *(middles[k] / ALIKE)]).astype(int).tolist()
        if (key := ("static_error", *alike)) in looked_at:
            continue
        looked_at.add(key)
        found = model.keep(key, functools.partial(static_error, model.statics, states[k]))
        if found > error:
            error, worst = found, states[k]
    if worst is None:
        return
    points = _single_forces(model.statics, worst.load)
    beside = f"; what forces on points ({listed(points)}) add next to these is not in it" if points else ""
    warn_of_mesh(
        f"{worst.name}: the displacement under the loads is too small by about {error:.1g} of itself"
        f"{' or more' * (error > 0.1)}, or the forces of prescribed displacements too large: edges of order "
        f"{order} are too long for how they bend there; take a higher order (order={order + 2} or more in "
        f"mesh), smaller cells (size), or both, or accuracy= of static{beside}"
    )


def static_error(statics: Stiffness, state: AtRest) -> float:
    """Estimated relative error of the displacement under the loads, which is too small. Collective.

    It is the share of the strain energy that S-elements take too much of in their order, and that the two
    further polynomials on each edge would add, one edge by itself. Nothing is said of S-elements on which
    single forces act, whose displacements have no limit, nor of edges that are pressed on.
    """
    layout, elements, edges = statics.layout, statics.elements, Edges(statics, 1)
    single, heavy = _acted_on(statics, state.load), bool(state.acceleration.any())

    def acting(element: SElement, group: Group, u: np.ndarray, more: int) -> tuple[np.ndarray, np.ndarray]:
        force = element.stiffness @ u
        if not heavy:
            return force, u * force
        material = elements.materials[group.material]
        inertia = (material.density / material.modulus) * group.sizes[:, None, None] ** 2
        pull = inertia * (
            element.mass @ np.tile(group.rotations @ state.acceleration[:, None], (u.shape[1] // 2, 1))
        )
        return force + pull, u * (force + 2.0 * pull)

    groups = elements.moving if heavy else elements.groups
    acted_on = [single[group.nodes].any(axis=1) for group in groups]
    left = [group.nodes[rows].ravel() for group, rows in zip(groups, acted_on)]
    everywhere = layout.comm.allgather(np.unique(layout.part.nodes[np.concatenate([*left, _NONE])]))
    edges.left |= np.isin(layout.part.nodes, np.concatenate(everywhere))
    edges.single |= np.isin(layout.part.nodes, state.pressed)
    _pull(edges, state.load, elements.thickness, layout)
    looked_at = [(group.select(~rows), 0 if heavy else None) for group, rows in zip(groups, acted_on)]
    lost = float(energies_lost(edges, looked_at, state.field[..., None], acting)[0])
    return lost / (lost + 2.0 * state.energy)


def _doubts(statics: Stiffness, states: Sequence[AtRest]) -> tuple[np.ndarray, np.ndarray]:
    """(states,): no less than the error of each as it would be told, by the highest polynomials of the
    displacement on the edges; 0 where nothing is strained. (states, 2): the middle of what it is made of, in
    units of the body. Collective.
    """
    elements, layout = statics.elements, statics.layout
    order, places, found = layout.order, layout.part.coordinates, np.zeros((len(states), 3))
    single = [_acted_on(statics, state.load) for state in states]
    last_two = _last_two(order)
    alike = itertools.groupby(elements.groups, lambda group: (group.material, len(group.shape), group.closed))
    for (_, count, closed), some in alike:
        groups = list(some)
        nodes = np.concatenate([group.nodes for group in groups])
        edges, scale = nodes[:, edge_nodes(count, order, closed)], elements.scales(groups[0])[0]
        where = np.concatenate([np.ones((len(nodes), 1)), places[nodes[:, 0]]], axis=1)
        for k, state in enumerate(states):
            parts = last_two @ state.field[edges]
            if order == 2:  # slopes, of which what a rigid body has says nothing
                parts[..., 0, :] -= _turned(parts[..., 0, :], last_two[0] @ places[edges])
            lower, highest = np.moveaxis(parts[..., 0] ** 2 + parts[..., 1] ** 2, -1, 0)
            falls = highest / np.maximum(np.maximum(lower, highest), _TINY)
            own = (highest * falls ** min(1.0, 0.5 * (order - 1))).sum(axis=1)
            own[single[k][nodes].any(axis=1)] = 0.0
            found[k] += SAFE * scale * order * own @ where
    ends = [side.max(initial=-np.inf) for side in (*places.T, *-places.T)]
    size = [np.abs(state.field).max(initial=0.0) for state in states]
    most, found = np.max(layout.comm.allgather(ends + size), axis=0), layout.comm.allreduce(found)
    span, size = (most[:2] + most[2:4]).max(), most[4:]
    energies = 2.0 * np.array([state.energy for state in states])
    strained = energies > _ROUND_OFF * elements.modulus * elements.thickness * size**2
    middles = found[:, 1:] / np.maximum(found[:, :1] * span, _TINY)
    return np.divide(found[:, 0], energies, out=np.zeros(len(states)), where=strained), middles


@functools.cache
def _last_two(order: int) -> np.ndarray:
    """(2, order + 1): coefficients of the last two Legendre polynomials of nodal values."""
    return np.linalg.inv(legendre.legvander(gll_nodes(order), order))[-2:]


def _turned(slopes: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(k, edges, 2): what the mean turn of each S-element adds to slopes of the displacement along its edges,
    whose directions and lengths are alike.
    """
    across = along[..., ::-1] * [-1.0, 1.0]
    turns = (across * slopes).sum(axis=(1, 2)) / (along**2).sum(axis=(1, 2))
    return turns[:, None, None] * across


def _acted_on(statics: Stiffness, load: Loads) -> np.ndarray:
    """(m,) bool: this rank's nodes that single forces act on, those of supports included."""
    points = statics.layout.points
    return np.isin(statics.layout.part.nodes, [points[name][2] for name in _single_forces(statics, load)])


def _single_forces(statics: Stiffness, load: Loads) -> list[str]:
    """Points on which forces of loads and supports act."""
    held = [support.where for support in statics.supports if support.where in statics.layout.points]
    return held + [part.point for part in load.parts if isinstance(part, PointForce)]


def _pull(edges: Edges, load: Loads, thickness: float, layout: Layout) -> None:
    """Add what tractions do to the further polynomials on their edges."""
    order = layout.order
    values, _, weights = tabulated(order + MORE_ORDERS, order + 2)
    further = values @ further_polynomials(order + 1, order, False)
    for part in load.parts:
        if isinstance(part, EdgeLoad):
            where = layout.part.edge_sets[part.edge_set]
            length, normal = edge_metric(layout.part.coordinates[where], order)
            forces = np.einsum("q,eq,qb,eqi->ebi", weights, length, further, part.traction(normal))
            edges.pull(where, thickness * forces.reshape(len(where), 2 * MORE_ORDERS, 1))
