"""The bracket of examples/bracket.geo by scikit-fem: triangles of order 4 on a mesh graded to the crack tip.

Nothing of the project is used: gmsh's own mesh with curved (second order) edges, the crack's nodes doubled
here, contact by non-negative least squares, stress intensity factors by the interaction integral.
"""

from __future__ import annotations

import pathlib
import tempfile

import gmsh
import meshio
import numpy as np
import scipy.sparse.linalg as sparse_linalg
import skfem
from scipy import linalg, optimize, sparse, spatial
from skfem.helpers import ddot, eye, sym_grad, trace
from skfem.io.meshio import from_meshio

CRACK = 9  # curve in bracket.geo
MATERIALS = {"steel": (210e9, 0.30, 7850.0), "bronze": (105e9, 0.34, 8700.0)}  # Pa, -, kg/m^3


def triangulate(
    geometry: str, coarse: float, fine: float, tip_size: float
) -> tuple[meshio.Mesh, dict[str, np.ndarray]]:
    """Six-node triangles with the crack's faces separate, and where things are: tip, mouth, bolts, corner,
    load, material of each cell.

    Cells are `coarse`, `fine` at the crack and the bushes and `tip_size` at the tip, m.
    """
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        with tempfile.TemporaryDirectory() as folder:
            # without the statements that ask for quadrilaterals and fixed divisions
            lines = [
                line
                for line in pathlib.Path(geometry).read_text().splitlines()
                if not line.strip().startswith(("Transfinite", "Recombine", "Mesh."))
            ]
            plain = pathlib.Path(folder) / "plain.geo"
            plain.write_text("\n".join(lines) + "\n")
            gmsh.merge(str(plain))
        groups = {
            gmsh.model.getPhysicalName(d, t): [int(e) for e in gmsh.model.getEntitiesForPhysicalGroup(d, t)]
            for d, t in gmsh.model.getPhysicalGroups()
        }
        ends = [int(tag) for _, tag in gmsh.model.getBoundary([(1, CRACK)], oriented=False)]
        at = {tag: gmsh.model.getValue(0, tag, [])[:2] for tag in ends}
        tip, mouth = sorted(ends, key=lambda tag: at[tag][1])
        field = gmsh.model.mesh.field
        for number, (kind, entities) in enumerate(
            (
                ("PointsList", [tip]),
                ("CurvesList", [CRACK, *groups["bolts"], *groups["bushes"], *groups["fillet"]]),
            ),
            1,
        ):
            field.add("Distance", number)
            field.setNumbers(number, kind, entities)
        field.setNumber(2, "Sampling", 200)
        field.add("MathEval", 3)
        field.setString(3, "F", f"min({tip_size} + 0.25*F1, {fine} + 0.4*F2)")
        field.setAsBackgroundMesh(3)
        for option, value in (
            ("MeshSizeFromPoints", 0),
            ("MeshSizeExtendFromBoundary", 0),
            ("MeshSizeMax", coarse),
            ("Algorithm", 6),
            ("ElementOrder", 2),
        ):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.model.mesh.generate(2)
        tags, points, _ = gmsh.model.mesh.getNodes()
        points = points.reshape(-1, 3)[:, :2]
        row = np.zeros(int(tags.max()) + 1, dtype=int)
        row[tags.astype(int)] = np.arange(len(tags))
        cells, material = [], []
        for index, name in enumerate(MATERIALS):
            for entity in groups[name]:
                _, nodes = gmsh.model.mesh.getElementsByType(9, entity)
                cells.append(row[nodes.astype(int)].reshape(-1, 6))
                material.append(np.full(len(cells[-1]), index))
        on_crack = np.setdiff1d(
            row[gmsh.model.mesh.getNodes(1, CRACK, includeBoundary=True)[0].astype(int)],
            row[gmsh.model.mesh.getNodes(0, tip)[0].astype(int)],
        )
        bolts = np.unique(
            np.concatenate(
                [
                    row[gmsh.model.mesh.getNodes(1, c, includeBoundary=True)[0].astype(int)]
                    for c in groups["bolts"]
                ]
            )
        )
        places = {"tip": np.array(at[tip]), "mouth": np.array(at[mouth]), "bolts": points[bolts]}
        places |= {
            name: np.array(gmsh.model.getValue(0, groups[name][0], [])[:2]) for name in ("corner", "load")
        }
    finally:
        gmsh.finalize()
    cells, places["material"] = np.concatenate(cells), np.concatenate(material)
    # cells at the right of the line from the tip to the mouth get nodes of their own
    along = places["mouth"] - places["tip"]
    arm = points[cells[:, :3]].mean(axis=1) - places["tip"]
    places["right"] = along[0] * arm[:, 1] - along[1] * arm[:, 0] < 0.0
    double = np.arange(len(points))
    double[on_crack] = len(points) + np.arange(len(on_crack))
    cells[places["right"]] = double[cells[places["right"]]]
    used, cells = np.unique(cells, return_inverse=True)  # without the centres of arcs
    points = np.vstack([points, points[on_crack]])[used]
    return meshio.Mesh(points, {"triangle6": _ascending(cells.reshape(-1, 6))}), places


def _ascending(cells: np.ndarray) -> np.ndarray:
    """Six-node triangles with their corners in ascending order: scikit-fem's elements above order 2 rely on
    it and it sorts straight triangles only.
    """
    order = np.argsort(cells[:, :3], axis=1)
    following = np.roll(order, -1, axis=1)
    # the node between corners a and b is 3 + 0, 1, 2 for {0, 1}, {1, 2}, {2, 0}
    middle = 3 + np.array([0, 2, 1])[order + following - 1]
    return np.take_along_axis(cells, np.hstack([order, middle]), axis=1)


class Peer:
    """Matrices of the bracket, unit thickness.

    Parameters
    ----------
    geometry : str
        bracket.geo
    coarse, fine, tip_size : float
        Cell sizes, m.
    """

    def __init__(self, geometry: str, coarse: float = 0.012, fine: float = 0.0025, tip_size: float = 2e-7):
        mesh, self.places = triangulate(geometry, coarse, fine, tip_size)
        self.basis = skfem.Basis(from_meshio(mesh), skfem.ElementVector(skfem.ElementTriP4()), intorder=8)
        young, poisson, density = (
            np.array([m[k] for m in MATERIALS.values()])[self.places["material"]][:, None] for k in range(3)
        )
        self.shear, self.lame = (
            young / (2.0 * (1.0 + poisson)),
            young * poisson / (1.0 - poisson**2),
        )  # plane stress

        @skfem.BilinearForm
        def stiffness(u, v, w):
            return 2.0 * self.shear * ddot(sym_grad(u), sym_grad(v)) + self.lame * trace(sym_grad(u)) * trace(
                sym_grad(v)
            )

        @skfem.BilinearForm
        def mass(u, v, w):
            return density * (u[0] * v[0] + u[1] * v[1])

        self.stiffness, self.mass = stiffness.assemble(self.basis), mass.assemble(self.basis)
        boundary = self.basis.mesh.boundary_facets()
        ends = self.basis.mesh.p[:, self.basis.mesh.facets[:, boundary]].T  # (facets, 2, 2)
        distance, _ = spatial.cKDTree(self.places["bolts"]).query(ends)
        held = boundary[distance.max(axis=1) < 1e-9]
        self.free = self.basis.complement_dofs(self.basis.get_dofs(held))
        self.solve = sparse_linalg.splu(self.stiffness[self.free][:, self.free].tocsc()).solve

    def dofs_at(self, place: np.ndarray) -> np.ndarray:
        """x and y unknown of a vertex."""
        vertex = int(
            np.linalg.norm(self.basis.mesh.p[:, : self.basis.mesh.nvertices].T - place, axis=1).argmin()
        )
        return self.basis.nodal_dofs[:, vertex]

    def frequencies(self, count: int) -> np.ndarray:
        """Lowest natural frequencies, crack open, Hz."""
        size = len(self.free)
        inverse = sparse_linalg.LinearOperator((size, size), matvec=self.solve)
        k, m = (matrix[self.free][:, self.free] for matrix in (self.stiffness, self.mass))
        values = sparse_linalg.eigsh(k, count, m, sigma=0.0, OPinv=inverse, return_eigenvectors=False)
        return np.sqrt(np.sort(values)) / (2.0 * np.pi)

    def static(self, force: float, contact: bool) -> dict:
        """Displacement (2,) of the corner, m, contact resultant, N/m, K_I and K_II, Pa m^(1/2), under a force
        up at the load's point, N/m.
        """
        right = np.zeros(self.basis.N)
        right[self.dofs_at(self.places["load"])[1]] = force
        solution = np.zeros(self.basis.N)
        solution[self.free] = self.solve(right[self.free])
        resultant = 0.0
        if contact:
            rows = self._gap_rows()[:, self.free]
            flexible = self.solve(rows.T.toarray())
            # minimise 1/2 p' W p + g' p over p >= 0 with W = L L'
            factor = linalg.cholesky(rows @ flexible, lower=True)
            start = rows @ solution[self.free]
            pressure, _ = optimize.nnls(
                factor.T, -linalg.solve_triangular(factor, start, lower=True), maxiter=10000
            )
            solution[self.free] += flexible @ pressure
            resultant = float(pressure.sum())
        return {
            "corner": solution[self.dofs_at(self.places["corner"])],
            "resultant": resultant,
            "intensity": self._intensity(solution),
        }

    def _gap_rows(self) -> sparse.csr_matrix:
        """Rows of the gaps: normal displacement of the right face minus that of the left one, node by
        node.
        """
        tip, line = self.places["tip"], self.places["mouth"] - self.places["tip"]
        length = np.linalg.norm(line)
        axis = line / length
        normal = np.array([axis[1], -axis[0]])
        locations = self.basis.doflocs.T - tip
        on_line = (
            (np.abs(locations @ normal) < 1e-9)
            & (locations @ axis > 1e-9)
            & (locations @ axis < length + 1e-9)
        )
        sides = []
        for cells in (self.places["right"], ~self.places["right"]):
            dofs = np.intersect1d(np.unique(self.basis.element_dofs[:, cells]), np.flatnonzero(on_line))
            dofs = dofs[np.lexsort((dofs, np.round(locations[dofs] @ axis, 10)))].reshape(-1, 2)  # x before y
            sides.append(dofs)
        assert sides[0].shape == sides[1].shape and not np.intersect1d(*sides).size
        count = len(sides[0])
        columns = np.hstack(sides)
        values = np.tile(np.concatenate([normal, -normal]), (count, 1))
        return sparse.csr_matrix(
            (values.ravel(), (np.repeat(np.arange(count), 4), columns.ravel())), shape=(count, self.basis.N)
        )

    def _intensity(self, solution: np.ndarray, outer: float = 5e-3) -> np.ndarray:
        """K_I and K_II by the interaction integral over a disk, radius in m, in which the faces do not
        touch.
        """
        young, poisson, _ = MATERIALS["steel"]
        shear, kappa = young / (2.0 * (1.0 + poisson)), (3.0 - poisson) / (1.0 + poisson)
        line = self.places["mouth"] - self.places["tip"]
        ahead = -line / np.linalg.norm(line)
        frame = np.array([ahead, [-ahead[1], ahead[0]]])  # rows: along and across the ligament
        place = np.einsum(
            "ij,jeq->ieq", frame, self.basis.global_coordinates() - self.places["tip"][:, None, None]
        )
        z = place[0] + 1j * place[1]
        radius = np.abs(z)
        gradient = np.einsum("ik,kleq,jl->ijeq", frame, self.basis.interpolate(solution).grad, frame)
        strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
        stress = 2.0 * self.shear * strain + self.lame * trace(strain) * eye(1.0 + 0.0 * radius, 2)
        share = np.minimum(radius / outer, 1.0)
        slope = (
            -30.0 * (share * (1.0 - share)) ** 2 / outer * place / radius
        )  # of q = 1 - 10 s^3 + 15 s^4 - 6 s^5
        factors = []
        for amplitude, other in (
            (1.0, 0.5),
            (-1j, -1.5),
        ):  # Muskhelishvili's potentials of the unit modes: psi'' = other * phi'
            potential = amplitude / (2.0 * np.sqrt(2.0 * np.pi * z))
            second = -0.5 * potential / z
            along = (
                kappa * potential - potential.conj() - z * second.conj() - (other * potential).conj()
            ) / (2.0 * shear)
            total, difference = 4.0 * potential.real, 2.0 * (z.conj() * second + other * potential)
            mode = np.array(
                [
                    [0.5 * (total - difference.real), 0.5 * difference.imag],
                    [0.5 * difference.imag, 0.5 * (total + difference.real)],
                ]
            )
            u_along = np.array([along.real, along.imag])
            density = np.einsum("ijeq,ieq,jeq->eq", stress, u_along, slope) + np.einsum(
                "ijeq,ieq,jeq->eq", mode, gradient[:, 0], slope
            )
            density -= ddot(mode, strain) * slope[0]
            factors.append(0.5 * young * float((density * self.basis.dx).sum()))
        return np.array(factors)
