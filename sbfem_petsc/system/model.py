"""The discrete structure: S-elements on their ranks, numbered unknowns, assembled matrices, supports and
loads.
"""

from __future__ import annotations

import functools
import math
import numbers

import numpy as np

from meshing.boundary_mesh import BoundaryMesh

from ..errors import UnknownName, on_all_ranks
from ..loads import EdgeLoad, Loads, SupportMotion, as_loads
from ..material import Material, OrthotropicMaterial
from ..parallel import collective
from ..petsc import MPI, PETSc
from ..selement.basis import tabulated
from ..signals import Signal
from ..supports import as_supports
from . import partition
from .assembly import assemble, block_triples
from .shapes import Group, solve_groups
from .tips import TipIntensities


class Model:
    """A structure of S-elements with its material, supports and damping.

    Parameters
    ----------
    mesh : BoundaryMesh
        On every rank, or on rank 0 alone (None elsewhere): each rank then receives its part.
    material : Material, OrthotropicMaterial or dict of str to these
        One for all, or one for each of the mesh's material names.
    clamped : str, sequence of str or None
        Edge sets or points held fixed in both directions; None for a free structure.
    continued_fraction : int
        Terms of the continued fraction for the inertia of each S-element (Mcf of the paper); 0: mass matrix
        alone.
    damping : float
        Modal damping ratio of every dynamic analysis. An unreduced model meets it in its computed modes, and
        has none beyond them (see `full_transient`).
    rayleigh : (float, float)
        a (1/s) and b (s) of a damping matrix a M + b K, which adds a / (2 omega) + b omega / 2 to the ratio
        of a mode; see `rayleigh_factors`.
    thickness : float
        m.
    supports : sequence of Support
        Further supports: single directions, elastic supports.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Attributes
    ----------
    boundary_unknowns : int
        Displacement unknowns on the boundaries of the S-elements, after the supports.
    unknowns : int
        The same with the auxiliary unknowns of the continued fraction.
    elements, shapes : int
        Number of S-elements and of different shapes among them.
    area, perimeter : float
        m^2, m; the faces inside a tip element carry no edges and are not counted.

    Raises
    ------
    ValueError, TypeError, KeyError
        One sentence that names the item, on all ranks.
    """

    def __init__(
        self,
        mesh,
        material,
        clamped="left",
        continued_fraction: int = 1,
        damping: float = 0.0,
        thickness: float = 1.0,
        supports=(),
        comm: MPI.Comm | None = None,
        rayleigh: tuple[float, float] = (0.0, 0.0),
    ):
        self.comm = MPI.COMM_WORLD if comm is None else comm
        with collective(self.comm):
            self.continued_fraction = _integer("continued_fraction", continued_fraction, 0, 20)
            self.damping = _real("damping", damping, lower=0.0, below=1.0)
            self.rayleigh = _rayleigh(rayleigh)
            self.thickness = _real("thickness", thickness, above=0.0)
            self.supports = as_supports(clamped, supports)
        mesh, numbering, self.part = self._distribute(mesh)
        self.order, self.points, self.cracks, self.crack_tips, self.pairs = (
            mesh["order"],
            mesh["points"],
            mesh["cracks"],
            mesh["tips"],
            mesh["pairs"],
        )
        self.edge_set_names, self.material_names = mesh["edge_sets"], mesh["material_names"]
        self.elements = mesh["elements"]
        self.ranges = numbering
        self.boundary_unknowns = int(self.ranges[-1])
        with collective(self.comm):
            self.materials = _materials(material, self.material_names)
            if self.boundary_unknowns == 0:
                raise ValueError(
                    f"clamped = {clamped!r} with supports = {supports!r} leaves no free displacement"
                )
        self.groups, self.shapes = solve_groups(
            self.comm, self.part, self.order, self.materials, self.continued_fraction
        )
        auxiliary = sum(g.solution.inertia.size * len(g.sizes) for g in self.groups)
        self.unknowns = self.boundary_unknowns + self.comm.allreduce(auxiliary)

    # ------------------------------------------------------------------ distribution
    def _distribute(self, mesh):
        """Common facts, row ranges and this rank's part; from the mesh of every rank, or scattered by rank
        0.
        """
        comm = self.comm
        everywhere = all(comm.allgather(mesh is not None))
        parts = None
        with collective(comm):
            if mesh is not None and not isinstance(mesh, BoundaryMesh):
                raise TypeError(
                    f"Model: mesh = {mesh!r} is not a BoundaryMesh; call its .mesh() or read_gmsh(path)"
                )
            if comm.rank == 0 and mesh is None:
                raise ValueError("Model: mesh is None on rank 0; give the mesh on rank 0 at least")
            if mesh is not None and (everywhere or comm.rank == 0):
                numbering = partition.number_unknowns(mesh, self._fixed(mesh), comm.size)
                facts = {
                    "order": mesh.order,
                    "elements": mesh.elements,
                    "cracks": mesh.cracks,
                    "tips": mesh.tips,
                    "material_names": tuple(mesh.material_names),
                    "edge_sets": tuple(mesh.edge_sets),
                    "pairs": mesh.pairs,
                    "points": {
                        name: (tuple(mesh.nodes[n]), tuple(numbering.unknowns[n]))
                        for name, n in mesh.points.items()
                    },
                    "pair_unknowns": numbering.unknowns[mesh.pairs.nodes].reshape(-1, 2, 2),
                    "extent": (mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)),
                    "measures": _measures(mesh),
                }
                wanted = [comm.rank] if everywhere else range(comm.size)
                parts = [(facts, numbering.ranges, partition.extract(mesh, numbering, r)) for r in wanted]
        facts, ranges, part = parts[0] if everywhere else comm.scatter(parts)
        self._pair_unknowns, self.extent, (self.area, self.perimeter) = (
            facts["pair_unknowns"],
            facts["extent"],
            facts["measures"],
        )
        return facts, ranges, part

    def _fixed(self, mesh) -> np.ndarray:
        """(nodes, 2): displacements held fixed by the supports."""
        fixed = np.zeros((len(mesh.nodes), 2), dtype=bool)
        for support in self.supports:
            if support.where in mesh.edge_sets:
                nodes = np.unique(mesh.edges[np.asarray(mesh.edge_sets[support.where], dtype=int)])
            elif support.where in mesh.points:
                nodes = np.array([mesh.points[support.where]])
            else:
                raise UnknownName(
                    f"support {support.where!r} is neither an edge set ({_listed(mesh.edge_sets)}) nor a "
                    f"point ({_listed(mesh.points)}) of the mesh"
                )
            fixed[nodes] |= np.array(support.fixed)
        return fixed

    # ------------------------------------------------------------------ matrices
    def unknowns_of(self, group: Group) -> np.ndarray:
        return self.part.unknowns[group.nodes].reshape(len(group.sizes), -1)

    def scales(self, group: Group) -> tuple[float, np.ndarray]:
        """Stiffness scale E t (N/m) and inertia scale rho h^2 t (kg), (k,)."""
        material = self.materials[group.material]
        return material.modulus * self.thickness, material.density * group.sizes**2 * self.thickness

    @functools.cached_property
    def stiffness(self) -> PETSc.Mat:
        """K over the displacement unknowns, N/m; with the rigid-body motions as near null space for multigrid
        where every node has both unknowns or none.
        """
        free = self.part.unknowns >= 0
        blocks = all(self.comm.allgather(bool((free[:, 0] == free[:, 1]).all())))
        matrix = assemble(self.comm, self.ranges, self.stiffness_triples(), block_size=2 if blocks else 1)
        if blocks:
            places = matrix.createVecRight()
            first, last = self.ranges[self.comm.rank], self.ranges[self.comm.rank + 1]
            owned = free & (self.part.unknowns >= first) & (self.part.unknowns < last)
            array = places.array
            array[self.part.unknowns[owned] - first] = self.part.coordinates[owned]
            motions = PETSc.NullSpace().createRigidBody(places)
            matrix.setNearNullSpace(motions)
            motions.destroy()
            places.destroy()
        return matrix

    def stiffness_triples(self) -> list:
        triples = []
        for group in self.groups:
            unknowns = self.unknowns_of(group)
            triples.append(
                block_triples(
                    unknowns, unknowns, self.scales(group)[0] * group.turned_both(group.solution.stiffness)
                )
            )
        return triples + self.spring_triples()

    def spring_triples(self) -> list:
        triples = []
        values, _, weights = tabulated(self.order, self.order + 2)
        for support in self.supports:
            springs = np.array(support.springs)
            if not springs.any():
                continue
            if support.where in self.edge_set_names:
                edges = self.part.edge_sets[support.where]
                if len(edges) == 0:
                    continue
                lengths, _ = self._edge_metric(edges)
                blocks = np.einsum(
                    "eq,q,qa,qb,i,ij->eaibj",
                    lengths,
                    weights,
                    values,
                    values,
                    springs * self.thickness,
                    np.eye(2),
                )
                unknowns = self.part.unknowns[edges].reshape(len(edges), -1)
                triples.append(
                    block_triples(unknowns, unknowns, blocks.reshape(len(edges), unknowns.shape[1], -1))
                )
            elif self.comm.rank == 0:
                unknowns = np.array(self.points[support.where][1])[None, :]
                triples.append(block_triples(unknowns, unknowns, np.diag(springs)[None]))
        return triples

    def _edge_metric(self, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """|dx/d eta| (edges, points) and outward unit normals (edges, points, 2) at the Gauss points of
        boundary edges.
        """
        _, derivatives, _ = tabulated(self.order, self.order + 2)
        tangent = derivatives @ self.part.coordinates[edges]
        length = np.sqrt((tangent**2).sum(axis=2))
        # the material lies on the left of an edge, so the outward normal is the tangent turned clockwise
        return length, np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1) / length[..., None]

    # ------------------------------------------------------------------ loads, contact rows, supports
    def load_vector(self, load) -> PETSc.Vec:
        """Nodal forces (N) over the displacement unknowns of constant loads.

        Raises
        ------
        KeyError, ValueError, TypeError
            If a point or edge set does not exist or a component is not finite.
        """
        with collective(self.comm):
            loads = self.checked_loads(load)
        vector = self.stiffness.createVecRight()
        vector.set(0.0)
        for item in loads.parts:
            if isinstance(item, EdgeLoad):
                self._add_edge_load(vector, item)
            elif isinstance(item, SupportMotion):
                self._add_inertia(vector, item)
            elif self.comm.rank == 0:
                for number, value in zip(self.points[item.point][1], (item.fx, item.fy)):
                    if number >= 0:
                        vector.setValue(int(number), value, addv=True)
        vector.assemble()
        return vector

    def checked_loads(self, load, constant: bool = True) -> Loads:
        """The loads, each with an existing place and finite components, or signals unless `constant`."""
        loads = as_loads(load)
        for item in loads.parts:
            if isinstance(item, EdgeLoad):
                if not isinstance(item.edge_set, str) or item.edge_set not in self.edge_set_names:
                    raise UnknownName(
                        f"EdgeLoad: edge set {item.edge_set!r} does not exist; the mesh has "
                        f"{_listed(self.edge_set_names)}"
                    )
                components = {"tx": item.tx, "ty": item.ty, "pressure": item.pressure}
            elif isinstance(item, SupportMotion):
                components = {"ax": item.ax, "ay": item.ay}
            else:
                if not isinstance(item.point, str) or item.point not in self.points:
                    raise UnknownName(
                        f"PointForce: point {item.point!r} does not exist; the mesh has "
                        f"{_listed(self.points)}"
                    )
                components = {"fx": item.fx, "fy": item.fy}
            for name, value in components.items():
                if isinstance(value, Signal) and not constant:
                    continue
                if not isinstance(value, numbers.Real) or isinstance(value, bool):
                    raise TypeError(
                        f"{type(item).__name__}: {name} = {value!r} must be a number"
                        + (" (signals are for transient and periodic)" if isinstance(value, Signal) else "")
                    )
                if not math.isfinite(value):
                    raise ValueError(f"{type(item).__name__}: {name} = {value!r} must be a finite number")
        return loads

    def _add_edge_load(self, vector: PETSc.Vec, load: EdgeLoad) -> None:
        edges = self.part.edge_sets[load.edge_set]
        if len(edges) == 0:
            return
        values, _, weights = tabulated(self.order, self.order + 2)
        length, normal = self._edge_metric(edges)
        traction = np.array([load.tx, load.ty]) - load.pressure * normal
        forces = self.thickness * np.einsum("q,eq,qa,eqi->eai", weights, length, values, traction)
        unknowns = self.part.unknowns[edges].ravel()
        keep = unknowns >= 0
        vector.setValues(unknowns[keep].astype(PETSc.IntType), forces.ravel()[keep], addv=True)

    def _add_inertia(self, vector: PETSc.Vec, load: SupportMotion) -> None:
        for group in self.groups:
            acceleration = np.tile([load.ax, load.ay], len(group.shape))
            forces = -self.scales(group)[1][:, None] * (group.turned_both(group.solution.mass) @ acceleration)
            unknowns = self.unknowns_of(group)
            keep = unknowns >= 0
            vector.setValues(unknowns[keep].astype(PETSc.IntType), forces[keep], addv=True)

    def contact_rows(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Row of G for each contact pair: (unknowns, coefficients), replicated on all ranks."""
        rows = []
        for unknowns, normal in zip(self._pair_unknowns, self.pairs.normal):
            numbers_, values = unknowns.ravel(), np.concatenate([normal, -normal])
            keep = (numbers_ >= 0) & (values != 0.0)
            rows.append((numbers_[keep].astype(PETSc.IntType), values[keep]))
        return rows

    @functools.cached_property
    def supported(self) -> bool:
        """Whether the supports admit no rigid-body motion. Collective."""
        lower, upper = self.extent
        centre, size = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
        gram = np.zeros((3, 3))
        for support in self.supports:
            acts = np.array(support.fixed) | (np.array(support.springs) > 0)
            if support.where in self.edge_set_names:
                places = self.part.coordinates[np.unique(self.part.edge_sets[support.where])]
            else:
                places = np.array([self.points[support.where][0]])
            for x, y in (places - centre) / size:
                rows = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])[acts]
                gram += rows.T @ rows
        gram = self.comm.allreduce(gram)
        return bool(np.linalg.eigvalsh(gram)[0] > 1e-9 * max(np.trace(gram), 1.0))

    def require_support(self, analysis: str) -> None:
        """Raise ValueError, on all ranks, if the supports admit a rigid-body motion."""
        if not self.supported:
            held = _listed([s.where for s in self.supports]) if self.supports else "nothing"
            raise on_all_ranks(
                ValueError(
                    f"{analysis} needs a structure held against every rigid-body motion, but the supports "
                    f"({held}) leave one free; clamp an edge set or add supports"
                )
            )

    # ------------------------------------------------------------------ fields
    @functools.cached_property
    def _ghosts(self) -> tuple[PETSc.Scatter, PETSc.Vec, np.ndarray]:
        """Scatter from the distributed displacement unknowns to those of this rank's nodes."""
        needed = self.part.unknowns[self.part.unknowns >= 0].astype(PETSc.IntType)
        source = PETSc.IS().createGeneral(needed, comm=PETSc.COMM_SELF)
        target = PETSc.Vec().createSeq(len(needed))
        vector = self.stiffness.createVecRight()
        scatter = PETSc.Scatter().create(vector, source, target, None)
        vector.destroy()
        return scatter, target, self.part.unknowns >= 0

    def nodal(self, vector: PETSc.Vec) -> np.ndarray:
        """Displacements (m, 2) of this rank's nodes from a vector over the displacement unknowns; 0 where
        held fixed. Collective.
        """
        scatter, target, free = self._ghosts
        scatter.scatter(vector, target)
        result = np.zeros(self.part.unknowns.shape)
        result[free] = target.array_r
        return result

    @functools.cached_property
    def tips(self) -> TipIntensities:
        """Stress intensity factors of the crack tips from nodal displacements. Collective."""
        return TipIntensities(self)

    def at_points(self, owned: np.ndarray) -> dict[str, np.ndarray]:
        """Displacement of every named point, on all ranks. Collective.

        Parameters
        ----------
        owned : (k,) or (k, n) array
            This rank's displacement unknowns, of one field or of n fields.

        Returns
        -------
        dict of str to (2,) or (n, 2) array
        """
        first, last = self.ranges[self.comm.rank], self.ranges[self.comm.rank + 1]
        unknowns = np.array([u for _, u in self.points.values()]).reshape(-1, 2)
        table = np.zeros((len(self.points), *owned.shape[1:], 2))
        for k in (0, 1):
            mine = (unknowns[:, k] >= first) & (unknowns[:, k] < last)
            table[mine, ..., k] = owned[unknowns[mine, k] - first]
        self.comm.Allreduce(MPI.IN_PLACE, table)
        return dict(zip(self.points, table))

    def destroy(self) -> None:
        """Free the PETSc objects now instead of at garbage collection, which ranks reach at different
        times.
        """
        for name in ("stiffness", "_ghosts"):
            held = self.__dict__.pop(name, None)
            for item in held if isinstance(held, tuple) else (held,):
                if isinstance(item, PETSc.Object):
                    item.destroy()

    def damping_ratios(self, omega: np.ndarray) -> np.ndarray:
        """Damping ratios of modes with angular frequencies `omega` (rad/s): the modal ratio and Rayleigh's a
        / (2 omega) + b omega / 2.
        """
        a, b = self.rayleigh
        return self.damping + 0.5 * (
            np.divide(a, omega, out=np.zeros(len(omega)), where=omega > 0.0) + b * omega
        )

    def __repr__(self) -> str:
        rayleigh = (
            f", Rayleigh damping {self.rayleigh[0]:g} 1/s M + {self.rayleigh[1]:g} s K"
            if any(self.rayleigh)
            else ""
        )
        return (
            f"Model({self.elements} S-elements of {self.shapes} shapes, order {self.order}, "
            f"{self.boundary_unknowns} boundary unknowns, "
            f"{self.unknowns} unknowns with continued_fraction={self.continued_fraction}, {len(self.pairs)} "
            f"contact pairs, damping ratio {self.damping:g}{rayleigh}, "
            f"{self.comm.size} rank{'s' if self.comm.size > 1 else ''})"
        )


def rayleigh_factors(ratio: float, low: float, high: float) -> tuple[float, float]:
    """a (1/s) and b (s) of a M + b K that give a damping ratio at two frequencies (Hz); it is smaller between
    them and larger outside.
    """
    low, high = 2.0 * math.pi * _real("low", low, above=0.0), 2.0 * math.pi * _real("high", high, above=0.0)
    ratio = _real("ratio", ratio, lower=0.0, below=1.0)
    return 2.0 * ratio * low * high / (low + high), 2.0 * ratio / (low + high)


def _measures(mesh) -> tuple[float, float]:
    """Area (m^2) and length of the outline (m), edges taken as polylines through their nodes."""
    chain = mesh.nodes[mesh.edges]
    lengths = np.linalg.norm(np.diff(chain, axis=1), axis=2).sum(axis=1)
    outline = np.bincount(mesh.element_edges, minlength=len(mesh.edges)) == 1
    centre = np.repeat(mesh.scaling_centres, np.diff(mesh.element_start), axis=0)[:, None]
    arm = chain[mesh.element_edges] - centre
    swept = (arm[:, :-1, 0] * arm[:, 1:, 1] - arm[:, :-1, 1] * arm[:, 1:, 0]).sum(axis=1)
    return float(0.5 * np.where(mesh.element_reversed, -swept, swept).sum()), float(lengths[outline].sum())


def _materials(material, names: tuple[str, ...]) -> list:
    """One material per name of the mesh."""
    kinds = (Material, OrthotropicMaterial)
    if isinstance(material, kinds):
        return [material] * len(names)
    if not isinstance(material, dict):
        raise TypeError(
            f"Model: material = {material!r} must be a Material or a dict of material names to Materials"
        )
    missing = [n for n in names if n not in material]
    if missing:
        raise UnknownName(
            f"Model: no material is given for {_listed(missing)}; the mesh has {_listed(names)}"
        )
    for name in names:
        if not isinstance(material[name], kinds):
            raise TypeError(f"Model: material[{name!r}] = {material[name]!r} is not a Material")
    return [material[n] for n in names]


def _listed(names) -> str:
    return ", ".join(repr(n) for n in names) or "none"


def _integer(name: str, value, lower: int, upper: int) -> int:
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise TypeError(f"Model: {name} = {value!r} must be an integer")
    if not lower <= value <= upper:
        raise ValueError(f"Model: {name} = {value!r} must be between {lower} and {upper}")
    return int(value)


def _rayleigh(value) -> tuple[float, float]:
    if isinstance(value, str) or not hasattr(value, "__len__") or len(value) != 2:
        raise TypeError(f"Model: rayleigh = {value!r} must be two numbers, a in 1/s and b in s of a M + b K")
    return tuple(_real(f"rayleigh[{k}]", part, lower=0.0) for k, part in enumerate(value))


def _real(
    name: str, value, above: float | None = None, lower: float | None = None, below: float = math.inf
) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(f"Model: {name} = {value!r} must be a number")
    if not (
        math.isfinite(value)
        and (above is None or value > above)
        and (lower is None or value >= lower)
        and value < below
    ):
        bound = f"above {above:g}" if above is not None else f"at least {lower:g}"
        raise ValueError(
            f"Model: {name} = {value!r} must be finite, {bound}"
            + (f" and below {below:g}" if math.isfinite(below) else "")
        )
    return float(value)
