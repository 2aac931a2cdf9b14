"""Whether cells, order and terms carry a frequency: errors of natural frequencies, estimated cell by cell."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.polynomial import legendre

from meshing.gll import gll_nodes, lagrange_values

from ...errors import listed, warn_of_mesh
from ...selement.coefficients import edge_nodes
from ...selement.leading_unknowns import reduced_fraction
from ...selement.sectors import Sectors
from ...selement.solution import STACK, SElement, solve_selements
from ..elements.elements import Elements
from ..elements.shapes import Group
from ..solve.modal_result import Modal
from ..solve.modes import lowest_scale
from ..solve.stiffness import Stiffness

# Orders and terms that the estimate looks beyond those of the model.
MORE_ORDERS, MORE_TERMS = 2, 1
# What still further orders, and edges that act together, add to what two orders on single edges take off: on
# cantilevers of length 8, 10 and 20 heights the latter is 0.65 to 0.75 of the error at p = 3 to 9 where
# waves limit it, 0.4 to 0.55 where a clamped corner does.
FURTHER = 1.4
# Relative error of a frequency beyond which the user is warned: errors of 1e-3 are not missed.
WARNED = 7e-4
# Relative error of an amplitude beyond which the user is warned, and the damping ratio that an undamped mode
# is looked at with: next to a resonance the error of its frequency counts times the inverse of the ratio.
WARNED_AMPLITUDE, LEAST_DAMPING = 3e-3, 1e-3
# Share of the displacement under a load that jumps in modes that are not computed beyond which the user is
# warned: on a cantilever under tension peaks were off by an eighth of it.
WARNED_MISSING = 0.03
# Size of the largest cell times omega / c_s (c_s: shear waves) below which no mode was off by 5e-4, for
# orders 0, 1, 2, ...: on the same cantilevers, in which waves of bending are the shortest, 1e-3 is passed at
# 0.05, 0.41, 1.2, 2.3 and 4 with p = 2, 3, 4, 5 and 9.
SAFE = (0.0, 0.0, 0.03, 0.25, 0.8, 1.5, 2.0)
# The same without a continued fraction, with the mass alone: 1e-3 is passed at 0.6.
SAFE_MASS = 0.3
# Cells smaller than this share of what is safe are left out of the estimates: a thousandth of them for 80
# modes of the beam with a notch. With 0.4 the lowest modes of a short beam lose nearly all of theirs.
LEFT_OUT = 0.3
# Share of the errors of waves that cells may have which warnings leave out beside larger ones: it changed the
# largest of eight errors by 4 % at most, of cantilevers, beams with a notch and plates with cracks.
NEGLIGIBLE = 0.03
Acting = Callable[[SElement, Group, np.ndarray, int], tuple[np.ndarray, np.ndarray]]
# S-elements that are looked at at a time, and what left-out auxiliary unknowns contribute to one, see
# `Pencil`.
_BATCH, _TOLERANCE = 1024, 1e-6
# Size of a cell times omega / c_s up to which a further term of the continued fraction changes nothing: the
# largest of eight errors by 1e-4 at .6 to 1.6, by nearly all of it at 4 in order 7.
SHORT = 1.6
# Modes whose errors are estimated: the highest ones, since modes of several kinds take turns.
LOOKED_AT = 8


def frequency_errors(found: Modal, modes: Sequence[int], negligible: float = 0.0) -> np.ndarray:
    """Estimated relative errors of natural frequencies, which are too high. Collective.

    The dynamic stiffness of each S-element is taken with two orders and, of large ones, one term of the
    continued fraction more: what the modes' energy loses by them as they are, and by the two further
    polynomials on each edge, one edge by itself. Small cells next to tips and corners are left out: this is
    about waves, not about singularities.

    Parameters
    ----------
    found : Modal
    modes : sequence of int
        0 is the lowest.
    negligible : float
        Share of the errors of waves that S-elements may have together which are left out as well.

    Returns
    -------
    (len(modes),) array
    """
    statics, elements = found.model.statics, found.model.cells
    modes = list(modes)
    omega = 2.0 * np.pi * found.frequencies[modes]
    shapes = elements.layout.nodal(found.shapes[:, modes])
    edges = Edges(statics, len(modes))

    def acting(element: SElement, group: Group, u: np.ndarray, more: int) -> tuple[np.ndarray, np.ndarray]:
        material = elements.materials[group.material]
        waves = omega**2 * (material.density / material.modulus) * group.sizes[:, None, None] ** 2
        force = _dynamic(element, u, waves, elements.terms + more)
        return force, u * force

    lost = energies_lost(edges, _looked_at(elements, float(omega.max()), negligible), shapes, acting)
    if not statics.supported:  # rigid-body modes have nothing to lose
        lost[omega**2 < lowest_scale(elements)] = 0.0
    return np.divide(lost, 2.0 * omega**2, out=np.zeros(len(modes)), where=omega > 0.0)


def warn_of_modes(owner: str, found: Modal) -> None:
    """Warn if one of the highest modes is off by more than `WARNED`. Collective."""
    count = len(found.frequencies)
    if not count or not needs_look(found.model.cells, float(found.frequencies[-1])):
        return
    looked_at = np.arange(max(0, count - LOOKED_AT), count)
    told = f"{owner}: mode {{}} at {{:.5g}} Hz is too high by {{}}"
    _warn_of_worst(found, looked_at, _kept_errors(found, looked_at), WARNED, told)


def warn_of_band(owner: str, found: Modal, ratios: np.ndarray, highest: float) -> None:
    """Warn if errors of the modes next to the highest frequency of a load (Hz) change amplitudes there by
    more than `WARNED_AMPLITUDE`, or the computed modes end close above it. Collective.
    """
    if highest <= 0.0:
        return
    statics, top = found.model.statics, float(found.frequencies[-1])
    if top < 2.0 * highest:
        warn_of_mesh(
            f"{owner}: the load has frequencies up to {highest:.4g} Hz, and the highest of the "
            f"{len(found.frequencies)} modes is at {top:.4g} Hz, less than twice as high: what the others do "
            f"at {highest:.4g} Hz is missing; ask for more modes, or smaller cells, which have more"
        )
    near = np.flatnonzero(found.frequencies <= 1.2 * highest)[-LOOKED_AT:]
    if not len(near) or not needs_look(statics.elements, 2.0 * float(found.frequencies[near[-1]])):
        return
    own, damping = found.frequencies[near], np.maximum(ratios[near], LEAST_DAMPING)
    errors = 2.0 * _kept_errors(found, near) * own**2
    errors /= np.abs(own**2 - highest**2 + 2j * damping * own * highest)
    told = (
        f"{owner}: the load has frequencies up to {highest:.4g} Hz, where the error of mode {{}} "
        "({:.5g} Hz) changes its amplitude by {}"
    )
    _warn_of_worst(found, near, errors, WARNED_AMPLITUDE, told, at=highest)


def warn_of_jumps(
    owner: str, found: Modal, ratios: np.ndarray, shares: np.ndarray, duration: float, whole: bool = False
) -> None:
    """Warn if errors of modes, or modes that are not computed, change by more than `WARNED_AMPLITUDE` what
    loads without a highest frequency move. Collective.

    Parameters
    ----------
    found : Modal
    ratios : (modes,) array
        Of damping.
    shares : (loads, modes) array
        Of the static displacement under each such load in each mode.
    duration : float
        Of the motion, s: what a mode's frequency is off by adds up as long, or until it has died out.
    whole : bool
        Whether what is above the computed modes swings too.
    """
    statics, most = found.model.statics, shares.max(axis=0, initial=0.0)
    missing = 1.0 - shares.sum(axis=1).min(initial=1.0)
    if missing > WARNED_MISSING and not whole:
        warn_of_mesh(
            f"{owner}: a load jumps, or has no known highest frequency, and {missing:.1g} of the "
            f"displacement under it is that of modes above the {len(most)} computed ones, which end at "
            f"{found.frequencies[-1]:.4g} Hz: it follows the load at once instead of swinging; ask for more "
            "modes"
        )
    moved = np.flatnonzero(most > WARNED_AMPLITUDE)
    if not len(moved) or not needs_look(statics.elements, 2.0 * float(found.frequencies[moved[-1]])):
        return
    turns = np.minimum(
        2.0 * np.pi * found.frequencies[moved] * duration, 1.0 / np.maximum(ratios[moved], LEAST_DAMPING)
    )
    # an error takes no more of an amplitude than all of it
    errors = most[moved] * np.minimum(_kept_errors(found, moved) * turns, 1.0)
    told = (
        f"{owner}: a load jumps, or has no known highest frequency, and the error of mode {{}} ({{:.5g}} Hz) "
        "changes what it moves by {}"
    )
    _warn_of_worst(found, moved, errors, WARNED_AMPLITUDE, told)


def needs_look(elements: Elements, frequency: float) -> bool:
    """Whether a cell is large enough for waves of a frequency (Hz) to be in doubt. Collective."""
    return cells_in_waves(elements, frequency) > _safe(elements)


def cells_in_waves(elements: Elements, frequency: float) -> float:
    """Largest size of an S-element times omega / c_s. Collective."""
    sizes = [
        float(group.sizes.max()) / _shear_speed(elements, group)
        for group in elements.groups
        if len(group.sizes)
    ]
    return 2.0 * np.pi * frequency * max(elements.layout.comm.allgather(max(sizes, default=0.0)))


def _warn_of_worst(
    found: Modal, modes: np.ndarray, errors: np.ndarray, most: float, told: str, *, at: float | None = None
) -> None:
    """Warn of the mode with the largest error, unless that is at most `most`, of which its number, frequency
    and error are told, and of the cells at a frequency, Hz, by default its own.
    """
    worst = int(np.argmax(errors))
    if not errors[worst] > most:
        return
    own = float(found.frequencies[modes[worst]])
    share = f"about {errors[worst]:.1g} of itself" if errors[worst] < 0.1 else "a tenth of itself or more"
    what, statics = told.format(modes[worst] + 1, own, share), found.model.statics
    elements, layout = statics.elements, statics.layout
    terms, waves = elements.terms, cells_in_waves(elements, own if at is None else at) / (2.0 * np.pi)
    points = [support.where for support in statics.supports if support.where in layout.points]
    why = (
        f"the largest cell is {waves:.2g} wavelengths of shear long there, too long for order "
        f"{layout.order} and {terms} term{'s' * (terms != 1)} of the continued fraction; make cells smaller "
        "(size), the order higher, or both"
    )
    if points:
        # what a point takes has a logarithm: the estimate sees its next term, whatever the wavelength
        why += (
            f". Supports on single points ({listed(points)}) may be the reason as well: a body gives way to "
            "a point without limit as cells shrink; hold short edges instead"
        )
    warn_of_mesh(f"{what}: {why}")


def _kept_errors(found: Modal, modes: np.ndarray) -> np.ndarray:
    """`frequency_errors`, once for the modes of a model."""
    key = ("frequency_errors", len(found.frequencies), *modes.tolist())
    return found.model.keep(key, lambda: frequency_errors(found, modes.tolist(), NEGLIGIBLE))


def _safe(elements: Elements) -> float:
    """Cells whose size times omega / c_s is less are in no doubt."""
    safe = SAFE[min(elements.layout.order, len(SAFE) - 1)]
    return safe if elements.terms else min(safe, SAFE_MASS)


def _shear_speed(elements: Elements, group: Group) -> float:
    material = elements.materials[group.material]
    return float(np.sqrt(material.elasticity[..., 2, 2].min() * material.modulus / material.density))


def _looked_at(elements: Elements, omega: float, negligible: float) -> list[tuple[Group, int | None]]:
    """S-elements whose errors at omega count, by groups, and the terms of the continued fraction that they
    are looked at with. Collective.

    Errors of waves go with the area and at least with (size omega / c_s)^(2 order - 2): those of cells which
    have less than a share of the mean of it are together less than this share of all. Second order and less
    lose as much by tips and corners, in small cells.
    """
    groups = elements.moving
    waves = [group.sizes * omega / _shear_speed(elements, group) for group in groups]
    parts = [(group.sizes**2, long ** (2 * elements.layout.order - 2)) for group, long in zip(groups, waves)]
    area, total = (
        elements.layout.comm.allreduce(float(sum(part)))
        for part in ((a.sum() for a, _ in parts), (a @ e for a, e in parts))
    )
    least = negligible * total / area if elements.layout.order > 2 else 0.0
    found = [
        (group, long, np.flatnonzero((long >= LEFT_OUT * _safe(elements)) & (error >= least)))
        for group, long, (_, error) in zip(groups, waves, parts)
    ]
    return [
        (group.select(rows), _terms(elements, long[rows].max())) for group, long, rows in found if len(rows)
    ]


def _terms(elements: Elements, waves: float) -> int:
    """Of the continued fraction that S-elements of a size times omega / c_s are looked at with."""
    return elements.terms + (MORE_TERMS if waves > SHORT or not elements.terms else 0)


def energies_lost(
    edges: Edges, found: list[tuple[Group, int | None]], shapes: np.ndarray, acting: Acting
) -> np.ndarray:
    """(columns,): what displacements lose of their energies in two orders less, twice. Collective.

    Parameters
    ----------
    edges : Edges
        New ones, with loads on them if there are any.
    found : list of (Group, int or None)
        S-elements that are looked at, and the terms of the continued fraction that they take.
    shapes : (m, 2, columns) array
        Displacements of this rank's nodes.
    acting : callable
        Forces (k, n, columns) of an S-element, as it is or in the higher order, and what its energies are the
        sum of over n.
    """
    elements, lost = edges.elements, np.zeros(shapes.shape[-1])
    for groups, terms in _alike(found):
        alike = list(zip(groups, _richer(elements, groups, terms)))
        if sum(len(group.sizes) for group in groups) <= _BATCH:
            lost += _add_alike(edges, alike, shapes, acting)
            continue
        for group, rich in alike:
            for first in range(0, len(group.sizes), _BATCH):
                some = group.select(slice(first, first + _BATCH))
                lost += _add_alike(edges, [(some, rich)], shapes, acting)
    return elements.layout.comm.allreduce(lost) + FURTHER * edges.energies()


def _alike(found: list[tuple[Group, int | None]]) -> Iterator[tuple[list[Group], int | None]]:
    """Groups that are solved at once, and the terms of the continued fraction that they take."""
    alike: dict[tuple[int, int, bool, int | None], list[Group]] = {}
    for group, terms in found:
        if not len(group.sizes):  # as of a rank that has no S-elements
            continue
        alike.setdefault((group.material, len(group.shape), group.closed, terms), []).append(group)
    for (_, _, _, terms), groups in alike.items():
        for first in range(0, len(groups), STACK):
            yield groups[first : first + STACK], terms


def _richer(elements: Elements, groups: list[Group], terms: int | None) -> list[SElement]:
    """The S-elements of some groups in a higher order."""
    order, material = elements.layout.order, elements.materials[groups[0].material]
    whole = _prolongation(len(groups[0].shape), order, groups[0].closed)
    shapes = np.stack([whole @ group.shape for group in groups])
    stack = Sectors(shapes, order + MORE_ORDERS, material.elasticity)
    return solve_selements(stack, groups[0].closed, terms, density=material.densities)


def _add_alike(
    edges: Edges, alike: list[tuple[Group, SElement]], shapes: np.ndarray, acting: Acting
) -> np.ndarray:
    """Energies that S-elements of groups that are solved at once lose; residuals go to `edges`."""
    elements, groups = edges.elements, [group for group, _ in alike]
    order, some = elements.layout.order, groups[0]
    whole = _prolongation(len(some.shape), order, some.closed)
    own = _own(len(some.shape), order, some.closed)
    nodes = np.concatenate([group.nodes for group in groups])
    turns = np.concatenate([group.rotations for group in groups])
    scale, members = elements.materials[some.material].modulus * elements.thickness, len(nodes)
    local = np.matmul(turns[:, None], shapes[nodes])
    coarse = local.reshape(members, 2 * len(some.shape), -1)
    fine = np.matmul(whole, local.reshape(members, len(some.shape), -1)).reshape(members, 2 * len(whole), -1)
    force, energy = np.empty_like(fine), np.empty((members, fine.shape[-1]))
    first = 0
    for group, rich in alike:
        rows = slice(first, first := first + len(group.sizes))
        force[rows], left = acting(rich, group, fine[rows], MORE_TERMS)
        _, there = acting(group.solution, group, coarse[rows], 0)
        energy[rows] = there.sum(axis=1) - left.sum(axis=1)  # one by one: of the lowest modes little is left
    blocks = np.matmul(np.matmul(own.T, np.stack([rich.stiffness for _, rich in alike])), own)
    members_of = np.repeat(np.arange(len(groups)), [len(group.sizes) for group in groups])
    edges.add(nodes, some.closed, turns, scale * np.matmul(own.T, force), scale * blocks[members_of])
    return scale * energy.sum(axis=0)


def _dynamic(element: SElement, u: np.ndarray, waves: np.ndarray, terms: int) -> np.ndarray:
    """(k, n, modes): dynamic stiffness of an S-element times displacements, each at its own frequency."""
    result = element.stiffness @ u - waves * (element.mass @ u)
    coupling, inertia = reduced_fraction(element, float(waves.max()), _TOLERANCE, terms)
    if len(inertia):
        share = 1.0 - inertia[:, None] * waves
        # next to a frequency of the cell alone the fraction means nothing but "much too large a cell"
        share = np.where(share >= 0.0, np.maximum(share, 1e-3), np.minimum(share, -1e-3))
        result -= waves**2 * (coupling @ ((coupling.T @ u) / share))
    return result


@functools.cache
def _prolongation(nodes: int, order: int, closed: bool) -> np.ndarray:
    """From nodal values to those of an order higher by `MORE_ORDERS` on the same edges."""
    higher = order + MORE_ORDERS
    edges = edge_nodes(nodes, order, closed)
    table = lagrange_values(gll_nodes(order), gll_nodes(higher))
    result = np.zeros((len(edges) * higher + (not closed), nodes))
    for k, edge in enumerate(edges):
        rows = (k * higher + np.arange(higher + 1)) % len(result)
        result[np.ix_(rows, edge)] = table
    return result


@functools.cache
def _own(nodes: int, order: int, closed: bool) -> np.ndarray:
    """Displacements along x and y of the further polynomials, by columns."""
    further = further_polynomials(nodes, order, closed)
    return np.einsum("nb,ij->nibj", further, np.eye(2)).reshape(2 * len(further), -1)


@functools.cache
def further_polynomials(nodes: int, order: int, closed: bool) -> np.ndarray:
    """(nodes of the higher order, edges * MORE_ORDERS): further polynomials on the edges, zero at their
    ends.
    """
    higher = order + MORE_ORDERS
    degrees = range(order + 1, higher + 1)
    at = gll_nodes(higher)
    values = np.stack([legendre.legval(at, np.eye(n + 1)[n] - np.eye(n + 1)[n - 2]) for n in degrees], axis=1)
    edges = len(edge_nodes(nodes, order, closed))
    result = np.zeros((edges * higher + (not closed), edges * MORE_ORDERS))
    for k in range(edges):
        rows = (k * higher + np.arange(1, higher)) % len(result)
        result[rows, k * MORE_ORDERS : (k + 1) * MORE_ORDERS] = values[1:-1]
    return result


class Edges:
    """Residuals and stiffnesses of further polynomials on the S-elements' edges, by the edges' nodes."""

    def __init__(self, statics: Stiffness, modes: int):
        self._layout, self.elements, self.modes = statics.layout, statics.elements, modes
        self.found: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        # where springs act the S-elements alone are not in balance: nothing is said of these edges
        self._elastic: dict[frozenset[int], np.ndarray] = {}
        for support in statics.supports:
            for edge in self._layout.part.edge_sets.get(support.where, ()):
                key = frozenset(int(node) for node in edge)
                springs = np.array(support.springs) > 0.0
                self._elastic[key] = springs | self._elastic.get(key, np.zeros(2, dtype=bool))
        # nor of those at a support on a point, whose reaction is singular
        points = self._layout.points
        held = [points[s.where][2] for s in statics.supports if s.where in points]
        self.single = np.isin(self._layout.part.nodes, held)
        # nor of edges all whose nodes are of S-elements that are left out
        self.left = np.zeros_like(self.single)

    def add(
        self, nodes: np.ndarray, closed: bool, turns: np.ndarray, residual: np.ndarray, blocks: np.ndarray
    ) -> None:
        """Add the shares of S-elements with such nodes (k, n), (k, 4 edges, modes) and (k, 4 edges, 4 edges)
        for MORE_ORDERS of two, in the frame of their group's shape, into which (k, 2, 2) turn.
        """
        order, size = self._layout.order, 2 * MORE_ORDERS
        edges = nodes[:, edge_nodes(nodes.shape[1], order, closed)]
        own = np.stack(
            [blocks[:, i : i + size, i : i + size] for i in range(0, blocks.shape[1], size)], axis=1
        )
        turns = np.einsum("ab,kij->kaibj", np.eye(MORE_ORDERS), turns).reshape(-1, 1, size, size)
        back = turns.swapaxes(-1, -2)
        forces = (back @ residual.reshape(*edges.shape[:2], size, -1)).reshape(-1, size, residual.shape[-1])
        self._add(edges.reshape(-1, order + 1), forces, (back @ own @ turns).reshape(-1, size, size))

    def pull(self, edges: np.ndarray, forces: np.ndarray) -> None:
        """Add loads (edges, 4, modes) on the further polynomials of edges (edges, order + 1)."""
        self._add(edges, -forces, np.zeros((*forces.shape[:2], forces.shape[1])))

    def _add(self, edges: np.ndarray, forces: np.ndarray, blocks: np.ndarray) -> None:
        part, order = self._layout.part, self._layout.order
        # seen from its other end: odd polynomials change sign
        nodes = part.nodes[edges]
        odd = np.repeat([(-1.0) ** n for n in range(order + 1, order + MORE_ORDERS + 1)], 2)
        from_end = nodes[:, 0] > nodes[:, -1]
        signs = np.where(from_end[:, None], odd, 1.0)
        nodes = np.where(from_end[:, None], nodes[:, ::-1], nodes)
        self.found.append(
            (nodes, signs[..., None] * forces, signs[..., None] * blocks * signs[:, None], self._free(edges))
        )

    def _free(self, edges: np.ndarray) -> np.ndarray:
        """(edges, 4): of the further polynomials' unknowns those of which something is said."""
        part = self._layout.part
        free = (part.unknowns[edges] >= 0).any(axis=1)
        free &= ~(self.single[edges].any(axis=1) | self.left[edges].all(axis=1))[:, None]
        if self._elastic:
            none = np.zeros(2, dtype=bool)
            springs = [self._elastic.get(frozenset(edge), none) for edge in edges.tolist()]
            free &= ~np.array(springs, dtype=bool).reshape(-1, 2)
        return np.tile(free, MORE_ORDERS)

    def energies(self) -> np.ndarray:
        """(modes,): what the further polynomials take off each mode's energy, edge by edge. Collective."""
        comm = self._layout.comm
        found = self.found if comm.size == 1 else [part for own in comm.allgather(self.found) for part in own]
        if not found:
            return np.zeros(self.modes)
        nodes, forces, blocks, frees = (np.concatenate(parts) for parts in zip(*found))
        edges, place = np.unique(nodes, axis=0, return_inverse=True)
        place = place.ravel()
        force, stiffness, free = (
            np.zeros((len(edges), *a.shape[1:]), a.dtype) for a in (forces, blocks, frees)
        )
        np.add.at(force, place, forces)
        np.add.at(stiffness, place, blocks)
        free[place] = frees
        force *= free[..., None]
        stiffness = np.where(free[..., None] & free[:, None], stiffness, np.eye(free.shape[1]))
        return (force * np.linalg.solve(stiffness, force)).sum(axis=(0, 1))
