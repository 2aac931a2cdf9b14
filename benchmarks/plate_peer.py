"""A plate with cracks that stay open by S-elements and by triangles of scikit-fem: cost at equal error.

    python benchmarks/plate_peer.py --cracks 5

The plate is clamped at its left edge, pulled at its right one; errors are those of the strain energy and of
the 20 lowest frequencies (the largest), against S-elements of order 8 on the smallest of their sizes.
scikit-fem is given the same cells, each divided into triangles from its scaling centre, graded towards the
tips as its user would grade them. Each run has a process of its own; it costs CPU time from the mesh in
memory to the result, and the memory that it adds at most to what the process had. Faces are free to overlap,
for scikit-fem has no contact. Set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import gc
import json
import pathlib
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh, splu
from skfem import FacetBasis, LinearForm, MeshTri

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import sbfem_petsc as sb
from benchmarks.peer_scikit_fem import DENSITY, ELEMENTS, YOUNG, Basis, _assemble
from benchmarks.plate import MATERIAL, forget_peak, memory, plate
from meshing import BoundaryMesh, Plate

MODES, TENSION, SHEAR = 20, 1e6, 2e5


def triangles(mesh: BoundaryMesh) -> MeshTri:
    """The cells of a mesh, each divided from its scaling centre."""
    element = np.repeat(np.arange(mesh.elements), np.diff(mesh.element_start))
    ends = mesh.edges[mesh.element_edges][:, [0, -1]]
    ends = np.where(mesh.element_reversed[:, None], ends[:, ::-1], ends)
    corners = np.concatenate([ends, len(mesh.nodes) + element[:, None]], axis=1)
    used, numbers = np.unique(corners, return_inverse=True)
    places = np.concatenate([mesh.nodes, mesh.scaling_centres])[used]
    return MeshTri(places.T.copy(), numbers.reshape(corners.shape).T.copy())


def s_elements(body: Plate, order: int, size: float) -> tuple:
    """Unknowns, strain energy, frequencies, seconds of statics and of modes, MB."""
    mesh = body.mesh(order=order, size=size)

    def statics() -> tuple[sb.Model, float]:
        model = sb.Model(mesh, MATERIAL, clamped="edge4")
        load = sb.EdgeLoad("edge2", tx=TENSION, ty=SHEAR)
        return model, sb.static(model, load, contact=False).strain_energy

    (model, energy), first, added = measured(statics)
    # `modal` would also judge the mesh
    found, second, more = measured(lambda: model.modes(MODES))
    return model.boundary_unknowns, energy, found.frequencies, first, second, added, more


def scikit_fem(body: Plate, order: int, size: float) -> tuple:
    """As `s_elements`."""
    mesh = triangles(body.mesh(order=1, size=size))

    def statics() -> tuple:
        stiffness, mass = _assemble(order, mesh)
        facets = mesh.facets_satisfying(lambda x: x[0] > 1.0 - 1e-9, boundaries_only=True)
        basis = Basis(mesh, ELEMENTS[order](), intorder=2 * order)
        free = basis.complement_dofs(basis.get_dofs(lambda x: x[0] < 1e-9))
        edge = FacetBasis(mesh, ELEMENTS[order](), facets=facets)
        pull = LinearForm(lambda v, w: v).assemble(edge)[free]
        forces = np.concatenate([TENSION * pull, SHEAR * pull])
        factors = splu(
            stiffness, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        return stiffness, mass, factors, 0.5 * forces @ factors.solve(forces) / YOUNG

    (stiffness, mass, factors, energy), first, added = measured(statics)

    def modes() -> np.ndarray:
        values = eigsh(
            stiffness,
            k=MODES,
            M=mass,
            sigma=0.0,
            OPinv=LinearOperator(stiffness.shape, matvec=factors.solve, dtype=float),
            return_eigenvectors=True,
            tol=1e-6,
            v0=np.random.default_rng(0).standard_normal(stiffness.shape[0]),
        )[0]
        return np.sqrt(np.sort(values) * YOUNG / DENSITY) / (2.0 * np.pi)

    frequencies, second, more = measured(modes)
    return stiffness.shape[0], energy, frequencies, first, second, added, more


def measured(work: Callable[[], Any]) -> tuple:
    """Result, CPU seconds and MB added at most."""
    gc.collect()
    forget_peak()
    before, start = memory()[1], time.process_time()
    result = work()
    return result, time.process_time() - start, memory()[0] - before


RUNS = {"S-elements": s_elements, "triangles": scikit_fem}


def alone(cracks: int, name: str, order: int, size: float) -> list:
    """A run in a process of its own."""
    words = [sys.executable, __file__, "--cracks", str(cracks), "--one", name, str(order), str(size)]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--cracks", type=int, default=5)
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.2, 0.1], help="of cells, m")
    parser.add_argument("--triangle-sizes", type=float, nargs="+", default=[0.2, 0.1, 0.05])
    parser.add_argument("--orders", type=int, nargs="+", default=[3, 5])
    parser.add_argument("--triangle-orders", type=int, nargs="+", default=[2, 3, 4], choices=ELEMENTS)
    parser.add_argument("--one", nargs=3, metavar=("KIND", "ORDER", "SIZE"), help="one run, as JSON")
    own = parser.parse_args()
    if own.one:
        name, order, size = own.one
        found = RUNS[name](plate(own.cracks, 0, 0), int(order), float(size))
        print(json.dumps([np.asarray(part).tolist() for part in found]))
        return
    energy, frequencies = alone(own.cracks, "S-elements", 8, min(own.sizes))[1:3]
    print("| | size, m | unknowns | error, statics | error, modes | s, statics | s, modes | MB | MB, modes |")
    print("|---|---|---|---|---|---|---|---|---|")
    runs = [("S-elements", p, size) for p in own.orders for size in own.sizes]
    runs += [("triangles", p, size) for p in own.triangle_orders for size in own.triangle_sizes]
    for name, order, size in runs:
        unknowns, own_energy, found, *cost = alone(own.cracks, name, order, size)
        static_error = abs(own_energy / energy - 1.0)
        error = np.abs(np.array(found) / frequencies - 1.0).max()
        print(
            f"| {name} of order {order} | {size:g} | {unknowns:,d} | {static_error:.1e} | {error:.1e} | "
            f"{cost[0]:.2f} | {cost[1]:.2f} | {cost[2]:.0f} | {cost[3]:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
