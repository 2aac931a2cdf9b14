"""Bodies of other codes: sparse M and K with the nodes that their unknowns belong to."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Mapping
from itertools import count
from typing import Any

import numpy as np
from scipy import sparse

from meshing.input_checks import LARGEST

from ..checks import Bounds, choice, flag, instance, integer, names_of, numbers_of, real, real_array, shown
from ..contact.law import ContactLaw, Unilateral, check_without_layer
from ..errors import UnknownName, at_point, warn_of_mesh
from .cells import KINDS, corners, outer_faces
from .faces import APART, ROUNDING, between, given_gap, moved, moving_pairs, normal_of, partners
from .plausibility import OWNER, UNITS, si_matrix, warn_of_mass, warn_of_order, warn_of_rounding, whole
from .rows import AXES, HELD, NONE, Contact, Row, told

# Distance of nodes in sizes of the body that rounding explains, and off a plane, a normal of three digits.
TOGETHER, LEVEL, FLAT = 1e-10, 1e-3, 1e-5


class FiniteElementModel:
    """A body given by another code's matrices, SI inside.

    Parameters
    ----------
    mass, stiffness : (n, n) sparse matrices of SciPy
        Symmetric, or one triangle of such.
    unknowns : (n, 2) array of int
        Label of the node and direction of each unknown: 0 to 2 displacements, 3 to 5 rotations.
    nodes : dict of int to (x, y, z)
        Places by label.
    sets : dict of str to sequence of int
        Labels of nodes.
    fixed : iterable of (int, int)
        Nodes and directions that are held: left out of the matrices, or in them, which a base that moves
        needs for the inertia that held nodes share.
    elements : dict of str to (e, k) array of int
        Labels by kind, as VTK names and orders them ("tetra10", "hexahedron" ...): what is drawn.
    units : {"SI", "mm-N-t", "mm-kg-mN"}
        Those of the matrices and nodes.

    Raises
    ------
    ValueError, TypeError
        If sizes do not fit, if a matrix is unsymmetric or negative on its diagonal, if an unknown has no
        stiffness, or belongs to no node.

    Warns
    -----
    UnitWarning
        If waves were slower or faster than in any solid, or the body heavier: units of another kind.
    MeshWarning
        If unknowns seem to be in another order than the rows of the matrices, or if the stiffness is rounded
        as in single precision.
    """

    def __init__(
        self,
        mass: sparse.spmatrix,
        stiffness: sparse.spmatrix,
        unknowns: Any,
        nodes: Mapping[int, Any],
        *,
        sets: Mapping[str, Iterable[int]] | None = None,
        fixed: Iterable[tuple[int, int]] = (),
        elements: Mapping[str, Any] | None = None,
        units: str = "SI",
    ) -> None:
        length, stiff, inert = UNITS[choice(OWNER, "units", units, tuple(UNITS))]
        self.mass = si_matrix("mass", mass, inert)
        self.stiffness = si_matrix("stiffness", stiffness, stiff)
        if self.mass.shape != self.stiffness.shape:
            raise ValueError(f"{OWNER}: mass has shape {self.mass.shape}, stiffness {self.stiffness.shape}")
        instance(OWNER, "nodes", nodes, Mapping, "a dict of labels to places")
        labels = real_array(OWNER, "labels of nodes", list(nodes), 1)
        if not whole(labels):
            raise ValueError(f"{OWNER}: labels of nodes = {shown([*nodes])} must be whole numbers up to 2^53")
        self.labels = labels.astype(int)
        self.places = length * real_array(OWNER, "nodes", list(nodes.values()), (len(nodes), 3))
        if (far := np.abs(self.places).max(initial=0.0)) > LARGEST:
            raise ValueError(f"{OWNER}: nodes has places {far:g} m off; give them in units = {units!r}")
        self._node = {label: k for k, label in enumerate(self.labels.tolist())}
        rows = self._pairs("unknowns", unknowns, self.mass.shape[0])
        turns = np.where(rows[:, 1] > 2, length, 1.0)  # of forces that are moments
        for part in (self.mass, self.stiffness):
            part.data *= turns[part.indices] * np.repeat(turns, np.diff(part.indptr))
        found, sides = np.unique(rows[:, 1]).tolist(), np.ptp(self.places[rows[:, 0]], axis=0)
        sides = sides > TOGETHER * sides.max()
        if found == [1, 2, 3] and sides[0]:
            raise ValueError(f"{OWNER}: unknowns has directions 1, 2 and 3; give 0, 1 and 2 for x, y and z")
        if found == [1, 2] and sides.tolist() == [True, True, False]:  # of a plane body
            raise ValueError(f"{OWNER}: unknowns has directions 1 and 2; give 0 and 1 for x and y")
        sets, elements = ({} if given is None else given for given in (sets, elements))
        instance(OWNER, "sets", sets, Mapping, "a dict of names to labels")
        instance(OWNER, "elements", elements, Mapping, "a dict of kinds to labels")
        known = {name: self._rows(f"sets[{name!r}]", sets[name]) for name in names_of(OWNER, "sets", [*sets])}
        self.sets = {name: tuple(self.labels[own].tolist()) for name, own in known.items()}
        self.elements = dict[str, np.ndarray]()
        for kind, cells in elements.items():
            count, what = KINDS[choice(OWNER, "elements", kind, tuple(KINDS))][0], f"elements[{kind!r}]"
            cells = real_array(OWNER, what, cells, 2)
            self.elements[kind] = self._rows(what, cells, (len(cells), count))
        instance(OWNER, "fixed", fixed, (list, tuple, set, frozenset, np.ndarray), "pairs (node, direction)")
        held = list(fixed) if getattr(fixed, "ndim", 1) else [fixed]
        warn_of_rounding(stiffness, self.stiffness, rows[:, 1])
        self._hold(rows, self._pairs("fixed", held or np.zeros((0, 2)), len(held)))
        self._sides = np.ptp(self.places[(self.columns != NONE).any(axis=1)], axis=0)
        own, heavy = self.stiffness.diagonal(), self.mass.diagonal()
        if (least := own.min()) <= 0.0:
            node, d = self.unknowns[own.argmin()]
            raise ValueError(
                f"{OWNER}: stiffness of node {node}, direction {d} is {least:g}; leave out what nothing holds"
            )
        if heavy.min() < 0.0:
            raise ValueError(f"{OWNER}: mass is negative, {heavy.min():g} kg on its diagonal")
        warn_of_mass(self, units, self._weight())
        warn_of_order(self)

    def _pairs(self, name: str, given: Any, count: int) -> np.ndarray:
        """(count, 2): rows of nodes, by their labels, and directions."""
        pairs = real_array(OWNER, name, given, (count, 2))
        if len(wrong := pairs[~np.isin(pairs[:, 1], np.arange(6))]):
            raise ValueError(
                f"{OWNER}: {name} has {wrong[0].tolist()}, not a node's label and a direction, 0 to 5"
            )
        return np.column_stack([self._rows(name, pairs[:, 0]), pairs[:, 1].astype(int)])

    def _rows(
        self, what: str, labels: Any, dimensions: Any = 1, owner: str = OWNER, error: type = ValueError
    ) -> np.ndarray:
        """Rows of nodes by their labels, an array of so many dimensions; an error for a label of no node."""
        known = real_array(owner, what, labels, dimensions)
        if lost := set(known.ravel().tolist()) - set(self._node):
            raise error(f"{owner}: {what} has node {min(lost):.17g}, which the body has not; is it internal?")
        return np.array([self._node[label] for label in known.ravel().tolist()], int).reshape(known.shape)

    def _hold(self, unknowns: np.ndarray, held: np.ndarray) -> None:
        """Leave out what is held; (n, 3) inertia forces of unit accelerations, kg, know of it. `columns` are
        unknowns by node and direction.
        """
        self.columns = np.full((len(self.labels), 6), NONE)
        self.columns[tuple(unknowns.T)] = np.arange(len(unknowns))
        if (self.columns != NONE).sum() < len(unknowns):
            raise ValueError(f"{OWNER}: unknowns has a node and direction twice; each has one row")
        self.columns[tuple(held.T)] = HELD
        free = self.columns[tuple(unknowns.T)] != HELD
        if not free.any():
            raise ValueError(f"{OWNER}: fixed holds all unknowns; leave some free")
        self.inertia = np.asarray(self.mass @ (unknowns[:, 1:] == np.arange(3)).astype(float))[free]
        if not free.all():
            self.mass, self.stiffness = self.mass[free][:, free], self.stiffness[free][:, free]
        self.columns[tuple(unknowns[free].T)] = np.arange(free.sum())
        named = [np.column_stack([self.labels[rows], along]) for rows, along in (unknowns[free].T, held.T)]
        self.unknowns, self.fixed = named[0], frozenset(map(tuple, named[1].tolist()))
        self.number = zlib.crc32(self.columns.tobytes() + (self.places + 0.0).tobytes())  # not -0.0

    def nodal(self, unknowns: np.ndarray) -> np.ndarray:
        """(nodes, 3): displacements at all nodes in the order of `labels`, of (n,) values of the unknowns."""
        values = real_array("nodal", "unknowns", unknowns, (len(self.unknowns),))
        return np.append(values, (0.0, 0.0))[self.columns[:, :3]]

    def at(self, place: Any, direction: Any) -> Row:
        """The displacement at a place: of a node's label, the mean of a set, the node at (x, y, z) in m.

        Parameters
        ----------
        place : int, str or (x, y, z)
        direction : {"x", "y", "z"} or (3,) vector
            A vector is made a unit one.

        Raises
        ------
        KeyError
            If there is no such node or set.
        ValueError
            If no node lies there, or one is neither an unknown nor held.
        """
        nodes, vector = self._nodes_at(place), _vector("at", "direction", direction)
        mean = sparse.csr_matrix(np.full((1, len(nodes)), 1.0 / len(nodes)))
        weights = self._along(vector, mean, nodes)
        if not weights.nnz:
            raise ValueError(f"at: {shown(place)} is held along {shown(direction)}; choose one that moves")
        return Row(weights, told(vector), self.number)

    def contact(
        self,
        left: Any,
        right: Any = None,
        *,
        normal: Any = None,
        gap: float | np.ndarray | Callable | None = None,
        matching: bool = True,
        law: ContactLaw | None = None,
        offset: float = 0.0,
        interference: bool = False,
    ) -> Contact:
        """Contact between two faces, or of one face with a rigid wall.

        Parameters
        ----------
        left, right : str or sequence of int
            Sets, or labels of nodes. Without `right` the left face meets a wall.
        normal : {"x", "y", "z"} or (3,) vector
            From left to right. Default: that of the plane through the left face, towards the right one where
            the faces are apart.
        gap : float, (left,) array or function of (x, y, z), optional
            m; a function is given arrays of the left nodes. Default: the distance of the nodes, 0 at a wall,
            of nodes in a plane across the normal.
        matching : bool
            Whether each left node has a right one before it. False: gaps are means about the left nodes,
            weighted by the elements of both faces (mortar method), so that a uniform pressure passes on as
            such; without elements the faces are triangles between their nodes, and left nodes on a line are
            points.
        law : ContactLaw, optional
            Of all pairs, without a layer. Default: `Unilateral`. Faces that rub (`Coulomb`) are those of
            plane bodies, held along one axis: their slip is along the normal turned clockwise, seen against
            it. Friction of faces that slide in two directions is no law of rows, and refused.
        offset : float
            m from the nodes to the faces, of both sides together: half the thicknesses of shells, which is
            taken off the distance of the nodes.
        interference : bool
            Let faces overlap at rest, as of a press fit; `static`, steady states and histories from
            equilibrium carry it.

        Raises
        ------
        KeyError
            If there is no such node or set.
        ValueError
            If nodes have no partner, or all lie beside the right face, if the normal is not known, if faces
            overlap, if nothing moves, or if faces that rub are not those of a plane body.

        Warns
        -----
        MeshWarning
            If nodes are corners of eight-node faces, or some lie beside a right face that does not match.
        """
        flag("contact", "matching", matching)
        law = Unilateral() if law is None else law
        check_without_layer("contact", "law", law)
        flag("contact", "interference", interference)
        offset = real("contact", "offset", offset, "m", within=Bounds(least=0.0))
        if offset and (right is None or gap is not None):
            raise ValueError(
                f"contact: offset = {offset:g} m is of two faces; at a wall or beside a gap give what is left"
            )
        one = self._face("left", left)
        other = one if right is None else self._face("right", right)
        x, y, nodes = self.places[one], self.places[other], np.append(one, other)
        means = -sparse.eye(len(x), len(nodes), format="csr")
        if matching:
            self._warn_of_corners(one)
        normal = normal_of(x, y) if normal is None else _vector("contact", "normal", normal)
        self._require_outward(one, normal)
        slip = self._slip_direction(law, nodes, normal) if law.rubs else np.zeros(3)
        if right is None and gap is None:
            gap = self._gap_of_wall(x, normal)
        elif right is not None and matching:
            means = partners(self.labels[one], x, y, normal)
        elif right is not None:
            at, faces = (self.labels[one], x, y), (self._faces(one), self._faces(other))
            means = between(at, normal, faces, lambda alone: moved(self._along(normal, alone, nodes)))
        rows, slips = (self._along(v, means, nodes) for v in (normal, slip))
        ahead = (x @ normal, y @ normal) if gap is None else (-given_gap(gap, x), np.zeros(len(y)))
        distance = means @ np.concatenate(ahead) - offset * (means.getnnz(axis=1) > 0)
        if gap is None:
            distance[np.abs(distance) < TOGETHER * self._sides.max()] = 0.0
        if (least := distance.min()) < 0.0 and not interference:
            why = f", with offset = {offset:g} m between nodes {least + offset:g} m apart" if offset else ""
            raise ValueError(
                f"contact: the faces overlap by {-least:g} m{why}; is the normal from left to right? Say "
                "interference=True if they are to press on each other at rest"
            )
        return moving_pairs(self.labels[one], law, Contact(rows, distance, (), slips, self.number))

    def _gap_of_wall(self, x: np.ndarray, normal: np.ndarray) -> float:
        """That of nodes in a plane, which a wall touches; others are refused, by more than a written normal's
        or their own digits.
        """
        own = np.linalg.eigh(np.cov(x.T, bias=True))[1][:, 0]
        off, bent = np.ptp(x @ normal), np.ptp(x @ own)
        if max(off, LEVEL / FLAT * bent) > LEVEL * self._sides.max():
            raise ValueError(
                f"contact: left nodes lie up to {off:g} m behind each other along the normal, and where "
                "the wall is, is not known; give gap, 0.0 if it touches all of them"
            )
        return 0.0

    def _require_outward(self, face: np.ndarray, normal: np.ndarray) -> None:
        """Refuse a normal towards which all elements of a face lie, as far as they are known."""
        ahead = np.zeros(0)
        for cells in self.elements.values():
            height = self.places[cells] @ normal
            own = np.ma.array(height, mask=~np.isin(cells, face)).mean(axis=1)
            ahead = np.append(ahead, (height.mean(axis=1) - own).compressed())
        if len(ahead) and ahead.min() > TOGETHER * self._sides.max():
            raise ValueError(
                "contact: the normal looks into the elements of the left face; is it from left to right, or "
                "from the body to the wall?"
            )

    def _faces(self, nodes: np.ndarray) -> list[list[int]]:
        """Outer faces of elements between nodes of a set, by their places in it, corners first."""
        place, found = {row: k for k, row in enumerate(nodes.tolist())}, []
        # faces between three of these nodes or more are shared by elements that have them
        near = {kind: cells[np.isin(cells, nodes).sum(axis=1) > 2] for kind, cells in self.elements.items()}
        for face in outer_faces(near):
            own, count = [place[row] for row in face if row in place], corners(face)
            if own[:count] == [place.get(row) for row in face[:count]]:
                found.append(own if len(own) == len(face) else own[:count])
        return found

    def _slip_direction(self, law: ContactLaw, nodes: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The one direction in which faces slide: across the normal and an axis along which they are held."""
        for d in (2, 1, 0):
            plane = (self.columns[:, d] < 0).all() or (self.columns[nodes, d] == HELD).all()
            if plane and abs(normal[d]) <= ROUNDING:
                return np.cross(normal, np.eye(3)[d])
        raise ValueError(
            f"contact: law = {law!r} rubs, and its faces slide in two directions, where friction is a cone "
            "and no law of rows; hold them along one axis, as in a plane body, or give Unilateral()"
        )

    def _warn_of_corners(self, nodes: np.ndarray) -> None:
        """Warn of corners of eight-node faces, as far as elements are known."""
        if at := {k for face in self._faces(nodes) if len(face) == 8 for k in face[:4]}:
            warn_of_mesh(
                f"contact: {len(at)} nodes are corners of eight-node faces, which carry a negative share of "
                "a pressure: pairs open where faces press; take tetrahedra, first order, or leave them out"
            )

    def summary(self) -> str:
        """Unknowns, nodes, size, mass and sets, a line each."""
        lines = [
            f"{len(self.unknowns)} free unknowns of {len(self.labels)} nodes",
            f"size {' x '.join(f'{side:.6g}' for side in self._sides)} m",
            f"{len(self.fixed)} unknowns held",
            f"mass {self._weight():.6g} kg of what is free",
        ]
        return "\n".join(lines + [f"set {name}: {len(labels)} nodes" for name, labels in self.sets.items()])

    def __repr__(self) -> str:
        return f"FiniteElementModel({len(self.unknowns)} unknowns, {len(self.labels)} nodes)"

    def _fingerprint(self) -> object:
        """What tells it from others, the same on all ranks: forces of a displacement that no other shares."""
        trial = np.random.default_rng(0).standard_normal(len(self.unknowns))
        return self.mass @ trial, self.stiffness @ trial, self.unknowns

    def _weight(self) -> float:
        """kg that moves along x, y or z."""
        along = (self.unknowns[:, 1:] == np.arange(3)).astype(float)
        return float((along * (self.mass @ along)).sum(axis=0).max())

    def _nodes_at(self, place: Any) -> np.ndarray:
        if not isinstance(place, (list, tuple)) and not np.ndim(place):
            instance("at", "place", place, (str, int, float, np.number), "a label, a set or x, y, z in m")
            given = place if isinstance(place, str) else [integer("at", "place", place)]
            return self._face("place", given, "at")
        far = np.linalg.norm(self.places - numbers_of("at", "place", place, 3, "x, y and z in m"), axis=1)
        if (least := far.min()) > APART * self._sides.max():
            one = self.labels[far.argmin()]
            raise ValueError(
                f"at: the nearest node of {shown(place)} is {one}, {least:g} m off; coordinates are in m"
            )
        near = np.flatnonzero(far <= least + TOGETHER * self._sides.max())
        if len(near) > 1:
            raise ValueError(f"at: {len(near)} nodes lie at {shown(place)}; give the label of one")
        return near

    def _face(self, name: str, given: Any, owner: str = "contact") -> np.ndarray:
        """Rows of the nodes of a set, or of labels, each once."""
        labels = at_point(self.sets, given, f"{owner}: set") if isinstance(given, str) else given
        if not len(rows := self._rows(name, labels, 1, owner, UnknownName)):
            raise ValueError(f"{owner}: {name} = {shown(given)} has no nodes")
        return np.array([*dict.fromkeys(rows.tolist())])

    def _along(self, vector: np.ndarray, shares: sparse.csr_matrix, nodes: np.ndarray) -> sparse.csr_matrix:
        """(k, n): displacements of nodes along a vector in (k, nodes) shares."""
        along = np.flatnonzero(np.abs(vector) > ROUNDING)
        missed = "and is not fixed; give it in fixed, or free it of its constraint"
        require_known(self, nodes[np.unique(shares.indices)], along, OWNER, missed)
        columns = self.columns[nodes][:, along]
        rows, d = np.nonzero(columns >= 0)
        entries = vector[along[d]], (rows, columns[rows, d])
        return shares @ sparse.csr_matrix(entries, (len(nodes), len(self.unknowns)))


def require_known(body: FiniteElementModel, nodes: np.ndarray, along: Any, owner: str, missed: str) -> None:
    """Refuse nodes, by their rows, that neither move nor are held in some directions."""
    if (lost := body.columns[nodes][:, along] == NONE).any():
        k, d = np.argwhere(lost)[0]
        label, axis = body.labels[nodes[k]], AXES[along[d]]
        raise ValueError(f"{owner}: node {label} has no unknown along {axis} {missed}")


def join(*bodies: FiniteElementModel) -> FiniteElementModel:
    """Several bodies as one, each where it is, for contact between them; nothing else connects them.

    Parameters
    ----------
    *bodies : FiniteElementModel
        Labels of nodes of the first one stay; those of a further one that are in use are moved up by a power
        of ten, as often as it takes: by 100, and by 200 the next time. A set's name that is in use gets the
        body's number: "LEFT" is "LEFT.2" of the second, and "LEFT.2.2" where that is in use, too.

    Returns
    -------
    FiniteElementModel
        In SI. Rows and contacts of its parts are not its own: make them of it.

    Raises
    ------
    TypeError
        If there is none, or one is no body.
    """
    if not bodies:
        raise TypeError("join: no body is given; give two or more")
    nodes, sets, fixed = dict[int, np.ndarray](), dict[str, tuple[int, ...]](), list[tuple[int, int]]()
    unknowns, cells = [], dict[str, list[np.ndarray]]()
    for number, body in enumerate(bodies, 1):
        instance("join", f"body {number}", body, FiniteElementModel, "a FiniteElementModel")
        own = body.labels.tolist()
        step = 10 ** len(str(max(own) - min(0, *own)))
        up = next(up for up in count(0, step) if nodes.keys().isdisjoint(label + up for label in own))
        nodes |= {label + up: place for label, place in zip(own, body.places)}
        for name, labels in body.sets.items():
            while name in sets:
                name += f".{number}"
            sets[name] = tuple(label + up for label in labels)
        unknowns.append(body.unknowns + [up, 0])
        fixed += [(label + up, d) for label, d in body.fixed]
        for kind, rows in body.elements.items():
            cells.setdefault(kind, []).append(body.labels[rows] + up)
    mass, stiffness = map(sparse.block_diag, zip(*((body.mass, body.stiffness) for body in bodies)))
    elements = {kind: np.concatenate(parts) for kind, parts in cells.items()}
    whole = mass, stiffness, np.concatenate(unknowns), nodes
    found = FiniteElementModel(*whole, sets=sets, fixed=fixed, elements=elements)
    found.inertia = np.concatenate([body.inertia for body in bodies])  # of what is held, too
    return found


def nodal_field(body: FiniteElementModel, owner: str, name: str, given: Any) -> np.ndarray:
    """(nodes, 3): m, of an array, a field or a static result, named in errors of a function."""
    if (found := getattr(given, "field", given)) is None:
        raise RuntimeError(f"{owner}: fields[{name!r}] has no shapes; reduce the body with shapes=True")
    return real_array(owner, f"fields[{name!r}]", np.asarray(found), body.places.shape, "m")


def _vector(owner: str, name: str, given: Any) -> np.ndarray:
    if isinstance(given, str):
        return np.eye(3)[AXES.index(choice(owner, name, given, tuple(AXES)))]
    wanted = "'x', 'y', 'z' or three numbers that are not all zero"
    vector = np.array(numbers_of(owner, name, given, 3, wanted))
    if not vector.any():
        raise ValueError(f"{owner}: {name} = {shown(given)} must be {wanted}")
    return vector / math.hypot(*vector)
