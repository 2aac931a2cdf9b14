"""Bodies of other codes: sparse M and K with the nodes that their unknowns belong to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from scipy import sparse

from meshing.warnings import MeshWarning

from ..checks import Bounds, choice, flag, instance, integer, names_of, numbers_of, real, real_array, shown
from ..contact.law import ContactLaw, Unilateral, check_without_layer
from ..errors import UnknownName, listed, warn
from .cells import checked_cells, outer_faces, require_known
from .faces import APART, ROUNDING, between, given_gap, moving_pairs, normal_of, partners
from .plausibility import warn_of_order, warn_of_rounding
from .rows import AXES, Contact, Row, told
from .units import UNITS, tree_of, warn_of_units

OWNER = "FiniteElementModel"
# Relative asymmetry that rounding of written files explains.
SYMMETRY = 1e-6
# Distance of nodes in sizes of the body that rounding explains.
TOGETHER = 1e-10
# Elements with eight-node faces, and how many of their nodes are corners.
EIGHT = {"quad8": 4, "hexahedron20": 8}


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
        self.mass = _matrix("mass", mass, inert)
        self.stiffness = _matrix("stiffness", stiffness, stiff)
        if self.mass.shape != self.stiffness.shape:
            raise ValueError(
                f"{OWNER}: mass has shape {self.mass.shape}, not {self.stiffness.shape} as stiffness"
            )
        self.unknowns = _labels("unknowns", unknowns, self.mass.shape[0])
        if not isinstance(nodes, Mapping) or not nodes:
            raise TypeError(f"FiniteElementModel: nodes = {shown(nodes)} must be a dict of labels to places")
        self.labels = np.array(_whole(OWNER, "nodes", list(nodes)))
        self.places = length * real_array(OWNER, "nodes", list(nodes.values()), (len(nodes), 3))
        self._node = {int(label): k for k, label in enumerate(self.labels)}
        if len(np.unique(self.unknowns, axis=0)) < len(self.unknowns):
            raise ValueError("FiniteElementModel: unknowns has a node and direction twice; each has one row")
        require_known(OWNER, "unknowns", self.unknowns[:, 0].tolist(), self._node)
        self.sets = _sets({} if sets is None else sets, self._node)
        self.elements = checked_cells(OWNER, {} if elements is None else elements, self._node)
        self.fixed = _held(fixed)
        require_known(OWNER, "fixed", [node for node, _ in self.fixed], self._node)
        moves = np.isin(self.labels, [*self.unknowns[:, 0], *(node for node, _ in self.fixed)])
        self._sides = np.ptp(self.places[moves], axis=0)
        warn_of_rounding(OWNER, stiffness, self.stiffness, self.unknowns[:, 1])
        self._hold()
        own, heavy = self.stiffness.diagonal(), self.mass.diagonal()
        if (idle := own <= 0.0).any():
            node, direction = self.unknowns[idle.argmax()]
            raise ValueError(
                f"FiniteElementModel: stiffness of node {node}, direction {direction} is "
                f"{own[idle.argmax()]:g}; leave unknowns out that nothing holds"
            )
        if heavy.min() < 0.0:
            raise ValueError(f"FiniteElementModel: mass is negative, {heavy.min():g} kg on its diagonal")
        moves = self.unknowns[:, 1] < 3
        warn_of_units(OWNER, units, (own[moves], heavy[moves]), self.places, self._weight())
        held = ~np.isin(self.labels, self.unknowns[:, 0]) | np.isin(self.labels, [a for a, _ in self.fixed])
        rows = np.array([self._node[a] for a in self.unknowns[:, 0].tolist()])
        warn_of_order(OWNER, self.stiffness, (self.places, held), (rows, self.unknowns[:, 1]))

    def _hold(self) -> None:
        """Leave out what is held; (n, 3) inertia forces of unit accelerations, kg, know of it."""
        along = (self.unknowns[:, 1:] == np.arange(3)).astype(float)
        free = np.array([tuple(pair) not in self.fixed for pair in self.unknowns.tolist()])
        if not free.any():
            raise ValueError("FiniteElementModel: fixed holds all unknowns; leave some free")
        self.inertia = np.asarray(self.mass @ along)[free]
        if not free.all():
            self.mass, self.stiffness = self.mass[free][:, free], self.stiffness[free][:, free]
            self.unknowns = self.unknowns[free]
        self._unknown = {(a, d): k for k, (a, d) in enumerate(self.unknowns.tolist())}

    def nodal(self, unknowns: np.ndarray) -> np.ndarray:
        """(nodes, 3): displacements at all nodes in the order of `labels`, of (n,) values of the unknowns."""
        values = real_array("nodal", "unknowns", unknowns, (len(self.unknowns),))
        found, moves = np.zeros(self.places.shape), self.unknowns[:, 1] < 3
        rows = [self._node[int(label)] for label in self.unknowns[moves, 0]]
        found[rows, self.unknowns[moves, 1]] = values[moves]
        return found

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
        labels, vector = self._labels_at(place), _vector("at", "direction", direction)
        rows = self._rows(labels, vector)
        if not rows.nnz:
            raise ValueError(f"at: {shown(place)} is held along {shown(direction)}; choose one that moves")
        return Row(sparse.csr_matrix(rows.mean(axis=0)), told(vector))

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
            m; a function is given arrays of the left nodes. Default: the distance of the nodes, 0 at a wall.
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
                f"contact: offset = {offset:g} m is taken off the distance of two faces' nodes; give the gap "
                "that is left, and no offset, at a wall and beside a gap"
            )
        one = self._face("left", left)
        x = self.places[[self._node[a] for a in one]]
        other = None if right is None else self._face("right", right)
        if matching:
            self._warn_of_corners(one)
        y = x if other is None else self.places[[self._node[a] for a in other]]
        vector = normal_of(x, y) if normal is None else _vector("contact", "normal", normal)
        self._require_outward(one, vector)
        along = self._slip_direction(law, one + (other or []), vector) if law.rubs else np.zeros(3)
        weights = sparse.identity(len(one), format="csr")
        rows, slips, distance = -self._rows(one, vector), -self._rows(one, along), np.zeros(len(one))
        if other is not None:
            if matching:
                share = partners(one, x, y, vector)
            else:
                weights, share = self._before(one, other, vector)
            rows = weights @ rows + self._shared(share, other, vector)
            slips = weights @ slips + self._shared(share, other, along)
            distance = share @ (y @ vector) - weights @ (x @ vector) - weights @ np.full(len(one), offset)
            distance[np.abs(distance) < TOGETHER * self._sides.max()] = 0.0
        if gap is not None:
            distance = weights @ given_gap(gap, x)
        if not interference:
            _require_apart(distance, offset)
        return moving_pairs(one, law, rows, slips, distance)

    def _require_outward(self, labels: list[int], normal: np.ndarray) -> None:
        """Refuse a normal towards which all elements of a face lie, as far as they are known."""
        rows, ahead = [self._node[a] for a in labels], np.zeros(0)
        for cells in self.elements.values():
            touches = np.isin(cells, rows)
            cells, own = cells[touches.any(axis=1)], touches[touches.any(axis=1)]
            height = self.places[cells] @ normal
            ahead = np.append(ahead, height.mean(axis=1) - np.average(height, axis=1, weights=own))
        if len(ahead) and ahead.min() > TOGETHER * self._sides.max():
            raise ValueError(
                "contact: the normal looks into the elements of the left face; is it from left to right, or "
                "from the body to the wall?"
            )

    def _before(
        self, one: list[int], other: list[int], normal: np.ndarray
    ) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
        """See `between`; what comes apart is told by places before each node alone."""
        x, y = (self.places[[self._node[a] for a in face]] for face in (one, other))
        faces, points = (self._faces(one), self._faces(other)), [[k] for k in range(len(one))]
        moves = np.ones(len(one), dtype=bool)
        _, share = between((x, y), normal, (points, faces[1]), moves)
        apart = abs(self._shared(share, other, normal) - self._rows(one, normal))
        moves = apart.max(axis=1).toarray().ravel() > ROUNDING
        weights, share = between((x, y), normal, faces, moves)
        if (beside := moves & (np.diff(weights.indptr) == 0)).any():
            said = f"{beside.sum()} of {len(one)} left nodes, node {one[beside.argmax()]} say, lie beside"
            if beside.sum() == moves.sum():
                raise ValueError(f"contact: {said} the right face; do these faces meet along this normal?")
            warn(f"contact: {said} the right face and make no pairs; are both sets right?", MeshWarning)
        alone = np.diff(weights.indptr) > 0
        alone[[k for face in faces[0] for k in face]] = False
        if faces[0] and alone.any():
            warn(
                f"contact: {alone.sum()} of {len(one)} left nodes, node {one[alone.argmax()]} say, lie on no "
                "outer face whose nodes are all in the set, and are paired alone; are both sets right?",
                MeshWarning,
            )
        return weights, share

    def _shared(self, share: sparse.csr_matrix, labels: list[int], vector: np.ndarray) -> sparse.csr_matrix:
        """Displacements of nodes along a vector in these shares."""
        met = np.unique(share.indices)
        return share[:, met] @ self._rows([labels[k] for k in met], vector)

    def _faces(self, labels: list[int]) -> list[list[int]]:
        """Outer faces of elements between nodes of a set, by their places in it, corners first."""
        place, found = {self._node[a]: k for k, a in enumerate(labels)}, []
        for corners, face in outer_faces(self.elements):
            own = [place[row] for row in face if row in place]
            if own[:corners] == [place.get(row) for row in face[:corners]]:
                found.append(own if len(own) == len(face) else own[:corners])
        return found

    def _slip_direction(self, law: ContactLaw, labels: list[int], normal: np.ndarray) -> np.ndarray:
        """The one direction in which faces slide: across the normal and an axis along which they are held."""
        for d in (2, 1, 0):
            plane = d not in self.unknowns[:, 1] or all((label, d) in self.fixed for label in labels)
            if plane and abs(normal[d]) <= ROUNDING:
                return np.cross(normal, np.eye(3)[d])
        raise ValueError(
            f"contact: law = {law!r} rubs, and its faces slide in two directions, where friction is a cone "
            "and no law of rows; hold them along one axis, as in a plane body, or give Unilateral()"
        )

    def _warn_of_corners(self, labels: list[int]) -> None:
        """Warn of corners of eight-node faces, as far as elements are known."""
        corners = [self.elements[k][:, :n].ravel() for k, n in EIGHT.items() if k in self.elements]
        if found := {self._node[a] for a in labels} & {int(row) for part in corners for row in part}:
            warn(
                f"contact: {len(found)} nodes are corners of eight-node faces, which carry a negative share "
                "of a pressure: pairs of them open where faces press, and resultants are off; take "
                "tetrahedra, elements of first order, or leave these nodes out",
                MeshWarning,
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
        along = [np.float64(self.unknowns[:, 1] == d) for d in range(3)]
        return float(max(own @ (self.mass @ own) for own in along))

    def _labels_at(self, place: Any) -> list[int]:
        if not isinstance(place, (list, tuple)) and not np.ndim(place):
            instance("at", "place", place, (str, int, float, np.number), "a label, a set or x, y, z in m")
            label = place if isinstance(place, str) else [integer("at", "place", place)]
            return self._face("place", label, "at")
        point = numbers_of("at", "place", place, 3, "x, y and z in m")
        far, nearest = tree_of(self.places).query(point)
        if far > APART * self._sides.max():
            raise ValueError(
                f"at: the nearest node of {shown(place)} is {self.labels[nearest]}, {far:g} m away; "
                "coordinates are in m"
            )
        same = np.linalg.norm(self.places - point, axis=1) <= far + TOGETHER * self._sides.max()
        if same.sum() > 1:
            raise ValueError(f"at: {same.sum()} nodes lie at {shown(place)}; give the label of one")
        return [int(self.labels[nearest])]

    def _face(self, name: str, given: Any, owner: str = "contact") -> list[int]:
        if isinstance(given, str) and given not in self.sets:
            raise UnknownName(f"{owner}: set {given!r} does not exist; the body has {listed(self.sets)}")
        found = self.sets[given] if isinstance(given, str) else _whole(owner, name, given)
        if not (labels := list(dict.fromkeys(found))):
            raise ValueError(f"{owner}: {name} = {shown(given)} has no nodes")
        if (lost := next((a for a in labels if a not in self._node), None)) is not None:
            raise UnknownName(f"{owner}: {name} has node {lost}, which does not exist in the body")
        return labels

    def _rows(self, labels: list[int], vector: np.ndarray) -> sparse.csr_matrix:
        """(nodes, n): displacements along a vector."""
        entries = []
        for k, label in enumerate(labels):
            for d in np.flatnonzero(np.abs(vector) > ROUNDING):
                unknown = self._unknown.get((label, int(d)))
                if unknown is not None:
                    entries.append((vector[d], k, unknown))
                elif (label, int(d)) not in self.fixed:
                    raise ValueError(
                        f"{OWNER}: node {label} has no unknown along {AXES[d]} and is not fixed; "
                        "give it in fixed, or free it of its constraint"
                    )
        values, *places = np.array(entries).reshape(-1, 3).T
        return sparse.csr_matrix((values, np.array(places, dtype=int)), (len(labels), len(self.unknowns)))


def nodal_field(body: FiniteElementModel, owner: str, name: str, given: Any) -> np.ndarray:
    """(nodes, 3): m, of an array, a field or a static result, named in errors of a function."""
    if (found := getattr(given, "field", given)) is None:
        raise RuntimeError(f"{owner}: fields[{name!r}] has no shapes; reduce the body with shapes=True")
    return real_array(owner, f"fields[{name!r}]", np.asarray(found), body.places.shape, "m")


def _matrix(name: str, value: Any, factor: float) -> sparse.csr_matrix:
    """Finite, symmetric, in SI; one triangle is completed."""
    if not sparse.issparse(value) or value.dtype.kind not in "iuf":
        raise TypeError(f"FiniteElementModel: {name} = {shown(value)} must be a real sparse matrix of SciPy")
    matrix = factor * sparse.csr_matrix(value, dtype=float)
    if matrix.shape[0] != matrix.shape[1] or not matrix.nnz:
        raise ValueError(f"FiniteElementModel: {name} of shape {matrix.shape} is not square, or is empty")
    real_array(OWNER, f"{name}.data", matrix.data, 1)
    lower, upper = sparse.tril(matrix, -1).tocsr(), sparse.triu(matrix, 1).tocsr()
    if bool(lower.count_nonzero()) != bool(upper.count_nonzero()):
        return (matrix + lower.T + upper.T).tocsr()
    off = abs(matrix - matrix.T).max()
    if off > SYMMETRY * abs(matrix).max():
        raise ValueError(f"FiniteElementModel: {name} is not symmetric, entries differ by up to {off:g}")
    return ((matrix + matrix.T) / 2.0).tocsr()


def _labels(name: str, given: Any, count: int) -> np.ndarray:
    """(count, 2): nodes and directions."""
    pairs = real_array(OWNER, name, given, (count, 2))
    whole = np.array(_whole(OWNER, name, pairs.ravel())).reshape(count, 2)
    if (whole[:, 1] < 0).any() or (whole[:, 1] > 5).any():
        raise ValueError(f"{OWNER}: {name} must be pairs of a node's label and a direction, 0 to 5")
    return whole


def _sets(given: Any, nodes: Mapping[int, int]) -> dict[str, tuple[int, ...]]:
    """Labels by name, of nodes that there are."""
    names_of(OWNER, "sets", list(instance(OWNER, "sets", given, Mapping, "a dict of names to labels")))
    found = {name: _whole(OWNER, f"sets[{name!r}]", labels) for name, labels in given.items()}
    for name, labels in found.items():
        require_known(OWNER, f"set {name!r}", labels, nodes)
    return found


def _held(given: Any) -> frozenset[tuple[int, int]]:
    """Nodes and directions."""
    instance(OWNER, "fixed", given, (list, tuple, set, frozenset, np.ndarray), "pairs (node, direction)")
    held = list(given) if getattr(given, "ndim", 1) else [given]
    return frozenset((int(a), int(d)) for a, d in (_labels("fixed", held, len(held)) if held else []))


def _whole(owner: str, name: str, given: Any) -> tuple[int, ...]:
    """Labels."""
    values = real_array(owner, name, given, 1)
    if (values != np.round(values)).any() or (np.abs(values) > 2.0**53).any():
        raise ValueError(f"{owner}: {name} = {shown(given)} must be labels of nodes, whole numbers")
    return tuple(map(int, values))


def _vector(owner: str, name: str, given: Any) -> np.ndarray:
    if isinstance(given, str):
        return np.eye(3)[AXES.index(choice(owner, name, given, tuple(AXES)))]
    vector = real_array(owner, name, given, 1)
    if len(vector) != 3 or not vector.any():
        raise ValueError(f"{owner}: {name} = {shown(given)} must be three numbers that are not all zero")
    return vector / np.linalg.norm(vector)


def _require_apart(distance: np.ndarray, offset: float) -> None:
    if (distance < 0.0).any():
        least = distance.min()
        why = f", with offset = {offset:g} m between nodes {least + offset:g} m apart" if offset else ""
        raise ValueError(
            f"contact: the faces overlap by {-least:g} m{why}; is the normal from left to right? Say "
            "interference=True if they are to press on each other at rest"
        )
