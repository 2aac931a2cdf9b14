"""S-elements a second: random quadrilaterals without symmetry, stiffness alone and with inertia.

    python benchmarks/kernel.py --order 5 --count 200 --terms 1

Both paths of the stiffness are timed (structured doubling and the ordered Schur form), and their largest
relative difference is printed. CPU time of one thread; set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from meshing.gll import gll_nodes
from sbfem_petsc.material import Material
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement


def quadrilaterals(count: int, order: int, seed: int = 0) -> list[np.ndarray]:
    """Nodes of `count` convex quadrilaterals near a square, about the mean of their corners, of unit size."""
    generator = np.random.default_rng(seed)
    fraction = 0.5 * (1.0 + gll_nodes(order))[:-1, None]
    shapes = []
    for _ in range(count):
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        corners += generator.uniform(-0.3, 0.3, (4, 2))
        corners -= corners.mean(axis=0)
        corners /= np.linalg.norm(corners, axis=1).max()
        following = np.roll(corners, -1, axis=0)
        shapes.append(np.concatenate([a + fraction * (b - a) for a, b in zip(corners, following)]))
    return shapes


def rate(shapes: list[np.ndarray], order: int, elasticity: np.ndarray, **options) -> float:
    """S-elements a CPU second, the better of two runs (a first one warms up)."""
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        for shape in shapes:
            solve_selement(Sectors(shape, order, elasticity), True, **options)
        best = min(best, time.process_time() - start)
    return len(shapes) / best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--order", type=int, default=5)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--terms", type=int, default=1)
    arguments = parser.parse_args()
    order, elasticity = arguments.order, Material(1.0, 0.3, 1.0).elasticity
    shapes = quadrilaterals(arguments.count, order)
    difference = 0.0
    for shape in shapes:
        fast, slow = (
            solve_selement(Sectors(shape, order, elasticity), True, method=m).stiffness
            for m in ("doubling", "schur")
        )
        difference = max(difference, float(np.abs(fast - slow).max() / np.abs(slow).max()))
    result = {
        "unknowns": 8 * order,
        "terms": arguments.terms,
        "stiffness_per_second": rate(shapes, order, elasticity),
        "with_inertia_per_second": rate(shapes, order, elasticity, terms=arguments.terms),
        "schur_stiffness_per_second": rate(shapes, order, elasticity, method="schur"),
        "difference": difference,
    }
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
