"""Cracked bodies by scikit-fem, an independent finite element code: triangles of order 3 graded towards crack
tips and corners by gmsh, stress intensity factors by the interaction integral.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import gmsh
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh
from skfem import (
    Basis,
    BilinearForm,
    ElementTriP3,
    ElementVector,
    FacetBasis,
    LinearForm,
    MeshTri,
    MeshTri2,
)
from skfem.helpers import dot, sym_grad, trace

Point = tuple[float, float]


@dataclass(frozen=True)
class Body:
    """A polygon with holes, cracks and an interface.

    Attributes
    ----------
    outline : sequence of (x, y)
        Counter-clockwise.
    cracks : sequence of polylines
        They meet at their corners alone.
    circles : sequence of ((x, y), radius)
        Holes; cracks may start on them.
    interface : polyline
        Triangles at its left are of the first material, all others of the second.
    """

    outline: Sequence[Point]
    cracks: Sequence[Sequence[Point]] = ()
    circles: Sequence[tuple[Point, float]] = ()
    interface: Sequence[Point] = ()


@dataclass(frozen=True)
class Grading:
    """Edges of triangles: `slope` times the distance from the nearest singular place, from `least` to
    `largest`.
    """

    least: float
    slope: float = 0.35
    largest: float = math.inf
    singular: Sequence[Point] = field(default=())


def triangles(body: Body, grading: Grading) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n, 2) and triangles (t, 3), cut open along the cracks."""
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        corners = [occ.addPoint(x, y, 0) for x, y in body.outline]
        sides = [occ.addLine(a, b) for a, b in zip(corners, corners[1:] + corners[:1])]
        surface = [(2, occ.addPlaneSurface([occ.addCurveLoop(sides)]))]
        if body.circles:
            holes = [(2, occ.addDisk(x, y, 0, r, r)) for (x, y), r in body.circles]
            surface, _ = occ.cut(surface, holes)
        lines = []
        for line in [*body.cracks, *([body.interface] if body.interface else [])]:
            ends = [occ.addPoint(x, y, 0) for x, y in line]
            lines.append([(1, occ.addLine(a, b)) for a, b in zip(ends, ends[1:])])
        flat = [piece for line in lines for piece in line]
        parts: list = []
        if flat:
            _, parts = occ.fragment(surface, flat)
        occ.synchronize()
        cracked = []
        at = len(surface)
        for line in lines[: len(body.cracks)]:
            cracked += [tag for piece in parts[at : at + len(line)] for _, tag in piece]
            at += len(line)

        def size(dimension, tag, x, y, z, suggested):
            near = min(math.dist((x, y), p) for p in grading.singular)
            arcs = [abs(math.dist((x, y), c) - r) + 0.25 * r for c, r in body.circles]
            return min(
                max(grading.least, grading.slope * near), *(grading.slope * d for d in arcs), grading.largest
            )

        gmsh.model.mesh.setSizeCallback(size)
        for name in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{name}", 0)
        gmsh.model.mesh.generate(2)
        tags, where, _ = gmsh.model.mesh.getNodes()
        number = {int(tag): k for k, tag in enumerate(tags)}
        nodes = np.reshape(where, (-1, 3))[:, :2]
        found = gmsh.model.mesh.getElementsByType(2)[1]
        cells = np.array([number[int(tag)] for tag in found]).reshape(-1, 3)
        walls = set()
        for tag in cracked:
            ends = gmsh.model.mesh.getElementsByType(1, tag)[1].reshape(-1, 2)
            walls |= {tuple(sorted((number[int(a)], number[int(b)]))) for a, b in ends}
    finally:
        gmsh.finalize()
    return _cut_open(nodes, cells, walls)


def _cut_open(nodes: np.ndarray, cells: np.ndarray, walls: set) -> tuple[np.ndarray, np.ndarray]:
    """Corners of triangles that are joined across edges other than `walls` share a node."""
    first: dict[tuple[int, int], tuple[int, int]] = {}
    rows: list[int] = []
    columns: list[int] = []
    for number, cell in enumerate(cells):
        for k in range(3):
            a, b = k, (k + 1) % 3
            if cell[a] > cell[b]:
                a, b = b, a
            key = (int(cell[a]), int(cell[b]))
            mine = (3 * number + a, 3 * number + b)
            if key in walls:
                continue
            if key in first:
                rows += mine
                columns += first[key]
            else:
                first[key] = mine
    count = cells.size
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), (count, count))
    _, joined = connected_components(graph, directed=False)
    _, new = np.unique(joined, return_inverse=True)
    places = np.empty((new.max() + 1, 2))
    places[new] = nodes[cells.ravel()]
    return places, new.reshape(-1, 3)


class Solution:
    """Plane elasticity on cut triangles.

    Parameters
    ----------
    nodes, cells : arrays
        Of `triangles`.
    constants : callable
        (Lame's first constant for the plane problem, shear modulus) at places (2, ...).
    traction : callable
        Traction (2, ...) on the outline from places (2, ...) and outward normals.
    pulled : callable
        Whether a facet's middle (2, n) is loaded.
    circles : sequence of ((x, y), radius)
        Sides with both ends on one are bent onto it.
    """

    def __init__(
        self,
        nodes: np.ndarray,
        cells: np.ndarray,
        constants: Callable,
        traction: Callable,
        pulled: Callable,
        circles: Sequence[tuple[Point, float]] = (),
    ):
        mesh = MeshTri(np.ascontiguousarray(nodes.T), np.ascontiguousarray(cells.T))
        if circles:
            mesh = _bent(MeshTri2.from_mesh(mesh), circles)
        self.basis = Basis(mesh, ElementVector(ElementTriP3()), intorder=8)
        self._middles = mesh.p[:, mesh.t].mean(axis=1)
        self._lame = [np.asarray(c)[:, None] for c in constants(self._middles)]

        @BilinearForm
        def stiffness(u, v, w):
            e, f = sym_grad(u), sym_grad(v)
            return self._lame[0] * trace(e) * trace(f) + 2.0 * self._lame[1] * np.einsum("ij...,ij...", e, f)

        @LinearForm
        def load(v, w):
            return dot(traction(w.x, w.n), v)

        facets = mesh.facets_satisfying(pulled, boundaries_only=True)
        force = load.assemble(FacetBasis(mesh, ElementVector(ElementTriP3()), facets=facets, intorder=8))
        self._matrix = stiffness.assemble(self.basis)
        self.u = self._free(self._matrix, force)

    def _free(self, matrix, force: np.ndarray) -> np.ndarray:
        """Solution held at three displacements, for forces in balance."""
        from petsc4py import PETSc

        p = self.basis.mesh.p
        low = int(np.argmin(p[0] + p[1]))
        right = int(np.argmin(p[1] - p[0]))
        held = np.array([*self.basis.nodal_dofs[:, low], self.basis.nodal_dofs[1, right]])
        free = np.setdiff1d(np.arange(len(force)), held)
        inner = matrix.tocsr()[free][:, free].tocsr()
        petsc = PETSc.Mat().createAIJ(
            inner.shape, csr=(inner.indptr.astype("i4"), inner.indices.astype("i4"), inner.data)
        )
        solver = PETSc.KSP().create()
        solver.setOperators(petsc)
        solver.setType("preonly")
        solver.getPC().setType("cholesky")
        solver.getPC().setFactorSolverType("mumps")
        x, b = petsc.createVecs()
        b.array = force[free]
        solver.solve(b, x)
        u = np.zeros(len(force))
        u[free] = x.array
        for item in (solver, petsc, x, b):
            item.destroy()
        return u

    def opening(self, mouth: Point) -> np.ndarray:
        """(2,): displacement of the upper corner of a mouth less that of the lower one."""
        p = self.basis.mesh.p
        corners = np.flatnonzero(np.hypot(*(p - np.array(mouth)[:, None])) < 1e-9)
        u = self.u[self.basis.nodal_dofs[:, corners]].T
        upper, lower = np.argmax(u[:, 1]), np.argmin(u[:, 1])
        return u[upper] - u[lower]

    def frequencies(self, count: int, density: Callable) -> np.ndarray:
        """The lowest natural frequencies of the free body that are not rigid-body motions, Hz."""
        rho = np.asarray(density(self._middles))[:, None]

        @BilinearForm
        def mass(u, v, w):
            return rho * dot(u, v)

        values = eigsh(self._matrix, count + 3, mass.assemble(self.basis), sigma=-1e-2)[0]
        return np.sqrt(np.sort(values)[3:]) / (2.0 * np.pi)

    def energy_release_rate(self, tip: Point, ahead: Point, radius: float) -> float:
        """J over a disc; an interface may run along the crack."""
        disc = self._disc(tip, ahead, radius)
        energy = 0.5 * np.einsum("ij...,ij...", disc.stress, disc.gradient)
        return disc.integral(np.einsum("ijqe,iqe->jqe", disc.stress, disc.gradient[:, 0]), energy)

    def intensity(self, tip: Point, ahead: Point, radius: float, young: float) -> tuple[float, float]:
        """K_I, K_II of a straight crack in one material by the interaction integral over a disc.

        Parameters
        ----------
        ahead : (x, y)
            Direction in which the crack points.
        radius : float
            The disc holds no other crack and no kink.
        young : float
            E in plane stress, E / (1 - nu^2) in plane strain.
        """
        disc = self._disc(tip, ahead, radius)
        kappa = 1.0 + 2.0 * disc.shear / (disc.first + disc.shear)
        result = []
        for mode in (0, 1):
            other = _williams_gradient(*disc.polar, mode, disc.shear, kappa)
            other_stress = _stress(other, disc.first, disc.shear)
            energy = np.einsum("ij...,ij...", disc.stress, other)
            flow = np.einsum("ijqe,iqe->jqe", disc.stress, other[:, 0])
            flow += np.einsum("ijqe,iqe->jqe", other_stress, disc.gradient[:, 0])
            result.append(0.5 * young * disc.integral(flow, energy))
        return result[0], result[1]

    def _disc(self, tip: Point, ahead: Point, radius: float) -> _Disc:
        c, s = np.array(ahead) / np.hypot(*ahead)
        turn = np.array([[c, s], [-s, c]])
        off = self._middles - np.array(tip)[:, None]
        near = np.flatnonzero((off**2).sum(axis=0) < (1.5 * radius) ** 2)
        basis = Basis(self.basis.mesh, ElementVector(ElementTriP3()), intorder=12, elements=near)
        first, shear = (value[near] for value in self._lame)
        place = np.asarray(basis.global_coordinates()) - np.array(tip)[:, None, None]
        local = np.einsum("ij,jqe->iqe", turn, place)
        gradient = np.einsum("ia,abqe,jb->ijqe", turn, basis.interpolate(self.u).grad, turn)
        return _Disc(local, gradient, first, shear, radius, basis.dx)


@dataclass(frozen=True)
class _Disc:
    """Quadrature points around a tip, in axes ahead of the crack and across it."""

    local: np.ndarray
    gradient: np.ndarray
    first: np.ndarray
    shear: np.ndarray
    radius: float
    weight: np.ndarray

    @property
    def stress(self) -> np.ndarray:
        return _stress(self.gradient, self.first, self.shear)

    @property
    def polar(self) -> tuple[np.ndarray, np.ndarray]:
        return np.hypot(*self.local), np.arctan2(self.local[1], self.local[0])

    def integral(self, flow: np.ndarray, energy: np.ndarray) -> float:
        """Of (flow_j - energy delta_1j) times the gradient of (1 - r^2 / R^2)^2."""
        share = np.clip(1.0 - (self.local**2).sum(axis=0) / self.radius**2, 0.0, None)
        slope = -4.0 / self.radius**2 * share * self.local
        total = np.einsum("jqe,jqe->qe", flow, slope) - energy * slope[0]
        return float((total * self.weight).sum())


def _bent(mesh: MeshTri2, circles: Sequence[tuple[Point, float]]) -> MeshTri2:
    """Middles of sides put on circles."""
    places = mesh.doflocs.copy()
    facets = mesh.boundary_facets()
    ends, middles = mesh.p[:, mesh.facets[:, facets]], mesh.dofs.facet_dofs[0, facets]
    for centre, radius in circles:
        off = np.hypot(*(ends - np.array(centre)[:, None, None])) - radius
        on = middles[(np.abs(off) < 1e-9 * radius).all(axis=0)]
        arm = places[:, on] - np.array(centre)[:, None]
        places[:, on] = np.array(centre)[:, None] + radius * arm / np.hypot(*arm)
    return MeshTri2(places, mesh.t)


def _stress(gradient: np.ndarray, first, shear) -> np.ndarray:
    strain = 0.5 * (gradient + np.swapaxes(gradient, 0, 1))
    stress = 2.0 * shear * strain
    stress[0, 0] += first * (strain[0, 0] + strain[1, 1])
    stress[1, 1] += first * (strain[0, 0] + strain[1, 1])
    return stress


def _williams_gradient(r: np.ndarray, theta: np.ndarray, mode: int, shear, kappa) -> np.ndarray:
    """(2, 2, ...): gradient of the displacements of a unit K_I (mode 0) or K_II (1) about a crack along the
    negative x axis, by complex potentials: 2 mu (u + i v) = kappa phi - z conj(phi') - conj(psi).
    """
    z = r * np.exp(1j * theta)
    a = 1.0 / math.sqrt(2.0 * math.pi) if mode == 0 else -1j / math.sqrt(2.0 * math.pi)
    # phi = a sqrt(z), and psi = b sqrt(z) with b from the free faces
    b = np.conj(a) - 0.5 * a
    root = np.sqrt(r) * np.exp(0.5j * theta)
    d_phi, dd_phi, d_psi = 0.5 * a / root, -0.25 * a / (root * z), 0.5 * b / root
    by_z = kappa * d_phi - np.conj(d_phi)
    by_conj = -z * np.conj(dd_phi) - np.conj(d_psi)
    by_x, by_y = (by_z + by_conj) / (2.0 * shear), 1j * (by_z - by_conj) / (2.0 * shear)
    return np.array([[by_x.real, by_y.real], [by_x.imag, by_y.imag]])
