"""Natural frequencies 1-46 of the paper case with scikit-fem: the peer side of the modal benchmark.

The beam (0.4 m x 0.005 m, plane stress, unit thickness, clamped at x = 0, a V notch from the top edge whose
tip lies at (0.08, 0.0025)) is discretised with quadratic, cubic and quartic triangles on meshes that are
graded geometrically towards the crack tip and the two clamped corners. scikit-fem assembles, SciPy's
``eigsh`` finds the frequencies by shift-invert about zero. What a run costs is the CPU time from the mesh in
memory (arrays of points and triangles) to the 46 frequencies; making the mesh is not counted.

scikit-fem is treated as its expert user would treat it:

- meshes laid out by hand, so that no element is smaller than the grading asks for;
- scalar bases and scalar forms, from which the plane elasticity matrices are put together block by block: a
  third of the time of the usual forms on ``ElementVector``;
- SuperLU in symmetric mode with minimum degree ordering, without pivoting (the stiffness matrix is positive
  definite);
- as few Lanczos vectors as let ``eigsh`` converge in one pass, and a tolerance no tighter than the errors
  need;
- tried without gain: a shift inside the band (20 to 48 kHz, one quartic mesh: as many solves as about zero,
  or more); COLAMD (more fill for cubic and quartic triangles, about level for quadratic ones).

What is left on the table: element matrices made without scikit-fem's forms, from those of one reference
triangle, would take 20 ms off the quartic case at 1e-4, but that would no longer be scikit-fem's assembly.

Run alone it prints the table of the best meshes: ``./run python benchmarks/peer_scikit_fem.py``. With
``--scan`` it repeats the scan they were found by (``SCAN``, about 90 CPU seconds) and prints its winners.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # read once, when numpy is first imported
    os.environ.setdefault(_variable, "1")

import argparse
import itertools
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import LinearOperator, eigsh, splu
from skfem import Basis, BilinearForm, ElementTriP2, ElementTriP3, ElementTriP4, MeshTri

__all__ = [
    "BEST",
    "ORDERS",
    "SCAN",
    "TARGETS",
    "MeshParameters",
    "Solution",
    "best",
    "graded_mesh",
    "largest_error",
    "reference_frequencies",
    "scan",
    "solve",
]

# The paper case, SI units; the opening is the total angle.
LENGTH, HEIGHT = 0.4, 0.005
NOTCH_POSITION, NOTCH_DEPTH, NOTCH_OPENING = 0.08, 0.0025, np.radians(0.0458366)
YOUNG, POISSON, DENSITY = 70e9, 0.33, 2700.0

MODES = 46
ELEMENTS = {2: ElementTriP2, 3: ElementTriP3, 4: ElementTriP4}
ORDERS = tuple(ELEMENTS)
TARGETS = (1e-3, 1e-4, 1e-5)
LANCZOS_VECTORS = (
    74  # with these two eigsh solves 75 times, one pass without a restart, on every mesh of BEST
)
LANCZOS_TOLERANCE = (
    1e-4  # ARPACK's; measured on BEST: frequencies within 4e-11 of those converged to round-off
)
ROUND_OFF = 1e-7  # of the first frequency: the order of the unknowns alone moves it by up to 6e-8
REFERENCE_FILE = Path(__file__).resolve().parent.parent / "examples" / "reference" / "reference.json"


@dataclass(frozen=True)
class MeshParameters:
    """What a graded mesh is made from; lengths in m.

    Attributes
    ----------
    element_length : float
        Length of the elements along the beam, away from the crack and the clamped end.
    layers : int
        Layers of elements over the beam's height there.
    tip_segments : int
        Element edges on each side of the square of the beam's height around the crack tip, and of every ring
        in it.
    tip_size : float
        Size of the elements at the crack tip.
    tip_ratio : float
        Ratio of the sizes of successive rings around the tip, below 1; the nearest that gives a whole number
        of rings.
    corner_segments : int
        Element edges on each of the two inner sides of the square of half the beam's height in each clamped
        corner.
    corner_size : float
        Size of the elements in the two clamped corners; 0: no grading there.
    corner_ratio : float
        Like `tip_ratio`, for the corners.
    """

    element_length: float
    layers: int
    tip_segments: int
    tip_size: float
    tip_ratio: float
    corner_segments: int
    corner_size: float
    corner_ratio: float


@dataclass(frozen=True)
class Solution:
    """Frequencies of one mesh and what they cost.

    Attributes
    ----------
    order : int
        Order of the triangles.
    parameters : MeshParameters
        The mesh.
    frequencies : ndarray, shape (46,)
        Natural frequencies in Hz, ascending.
    unknowns : int
        Displacement unknowns after the supports.
    error : float
        Largest relative error of the frequencies against the reference.
    seconds : float
        CPU seconds from mesh in memory to frequencies, the least of the repeats.
    stages : dict of str to float
        How these seconds divide: "assembly", "factorisation", "lanczos".
    """

    order: int
    parameters: MeshParameters
    frequencies: np.ndarray = field(repr=False)
    unknowns: int
    error: float
    seconds: float
    stages: dict[str, float]


# --- reference
# -------------------------------------------------------------------------------------------------------


def reference_frequencies() -> np.ndarray:
    """Return the converged frequencies 1-46 of the paper case in Hz (their own error is 1e-6)."""
    modes = json.loads(REFERENCE_FILE.read_text())["modes"]
    return np.array(modes["crack80_nu33"]["frequency_Hz"][:MODES])


def largest_error(frequencies: np.ndarray) -> float:
    """Return the largest relative error of `frequencies` (Hz) against the reference."""
    return float(np.max(np.abs(frequencies / reference_frequencies() - 1.0)))


# --- mesh
# ------------------------------------------------------------------------------------------------------------


class _Triangulation:
    """Points and triangles under construction; chains are lists of point numbers."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float]] = []
        self.triangles: list[tuple[int, int, int]] = []

    def chain(self, x: np.ndarray | float, y: np.ndarray | float) -> list[int]:
        """Add the points (x, y), broadcast against each other, and return their numbers."""
        x, y = np.broadcast_arrays(np.atleast_1d(x), np.atleast_1d(y))
        first = len(self.points)
        self.points.extend(zip(x.tolist(), y.tolist()))
        return list(range(first, len(self.points)))

    def distance(self, one: int, other: int) -> float:
        """Return the distance between two points in m."""
        return float(np.hypot(*np.subtract(self.points[one], self.points[other])))

    def strip(self, one: list[int], other: list[int]) -> None:
        """Fill the strip between two chains that run in the same direction, always along the shorter
        diagonal.
        """
        i = j = 0
        while i < len(one) - 1 or j < len(other) - 1:
            if j == len(other) - 1:
                step_one = True
            elif i == len(one) - 1:
                step_one = False
            else:
                step_one = self.distance(one[i + 1], other[j]) < self.distance(one[i], other[j + 1])
            if step_one:
                self.triangles.append((one[i], other[j], one[i + 1]))
                i += 1
            else:
                self.triangles.append((one[i], other[j], other[j + 1]))
                j += 1

    def rings(self, outline: list[int], centre: tuple[float, float], smallest: float, ratio: float) -> None:
        """Fill the region that `outline` bounds with copies of it scaled about `centre`, and a fan in the
        last one.

        Parameters
        ----------
        outline : list of int
            An open chain that sees `centre`; both straight lines from its ends to `centre` become boundary.
        centre : tuple of float
            The point to grade to.
        smallest : float
            Scale of the last copy, 1 being the outline itself.
        ratio : float
            Scale from copy to copy, adapted to a whole number of copies.
        """
        count = max(0, round(np.log(smallest) / np.log(ratio)))
        x, y = np.array([self.points[point] for point in outline]).T
        for scale in smallest ** (np.arange(1, count + 1) / max(count, 1)):
            inner = self.chain(centre[0] + scale * (x - centre[0]), centre[1] + scale * (y - centre[1]))
            for start in range(len(outline) - 1):
                self.strip(inner[start : start + 2], outline[start : start + 2])
            outline = inner
        (tip,) = self.chain(*centre)
        self.triangles.extend((tip, *edge) for edge in itertools.pairwise(outline))

    def span(self, left: list[int], end: float, length: float, layers: int, last_layers: int) -> list[int]:
        """Fill the beam from the upright chain `left` to x = `end` and return the upright chain there.

        Rows of triangles whose apexes stand over the middle of the opposite edges; one column on either side
        where the number of layers changes.
        """
        start = self.points[left[0]][0]
        columns = max(1, round((end - start) / length))
        first, last = len(left) - 1 != layers, last_layers != layers
        if columns <= first + last:
            right = self.chain(end, np.linspace(0.0, HEIGHT, last_layers + 1))
            self.strip(left, right)
            return right
        stations = np.linspace(start, end, columns + 1)
        if first:
            upright = self.chain(stations[1], np.linspace(0.0, HEIGHT, layers + 1))
            self.strip(left, upright)
            left = upright
        stations = stations[int(first) : len(stations) - int(last)]
        middles = (stations[1:] + stations[:-1]) / 2
        right = self.chain(stations[-1], np.linspace(0.0, HEIGHT, layers + 1))
        below: list[int] = []
        for row in range(layers + 1):
            inside = middles if row % 2 else stations[1:-1]
            chain = [left[row], *self.chain(inside, row * HEIGHT / layers), right[row]]
            if below:
                self.strip(below, chain)
            below = chain
        if last:
            upright = self.chain(end, np.linspace(0.0, HEIGHT, last_layers + 1))
            self.strip(right, upright)
            right = upright
        return right


def graded_mesh(parameters: MeshParameters) -> tuple[np.ndarray, np.ndarray]:
    """Make the mesh of the paper case.

    Around the crack tip a square of the beam's height is filled with rings that are scaled copies of one
    another; the crack's faces are two of the rays. Each clamped corner has a square of half the height,
    filled in the same way. Staggered rows of triangles make up the rest.

    Parameters
    ----------
    parameters : MeshParameters
        What it is made from.

    Returns
    -------
    points : ndarray, shape (2, points)
        Coordinates in m.
    triangles : ndarray of int, shape (3, triangles)
        Corner points, anticlockwise.
    """
    mesh = _Triangulation()
    segments, half = parameters.tip_segments, HEIGHT / 2
    if parameters.corner_size > 0:
        count = parameters.corner_segments
        left = mesh.chain(half, np.linspace(0.0, HEIGHT, 2 * count + 1))
        middle = mesh.chain(np.linspace(half, 0.0, count + 1)[1:], half)
        for side, y in ((left[: count + 1], 0.0), (left[: count - 1 : -1], HEIGHT)):
            mesh.rings(side + middle, (0.0, y), parameters.corner_size / half, parameters.corner_ratio)
    else:
        left = mesh.chain(0.0, np.linspace(0.0, HEIGHT, parameters.layers + 1))
    left = mesh.span(left, NOTCH_POSITION - half, parameters.element_length, parameters.layers, segments)
    right = mesh.chain(NOTCH_POSITION + half, np.linspace(0.0, HEIGHT, segments + 1))
    bottom = mesh.chain(NOTCH_POSITION + np.linspace(-half, half, segments + 1)[1:-1], 0.0)
    mouth = NOTCH_DEPTH * np.tan(NOTCH_OPENING / 2)
    offsets = np.linspace(half, mouth, (segments + 1) // 2 + 1)[1:]
    top_right = mesh.chain(NOTCH_POSITION + offsets, HEIGHT)
    top_left = mesh.chain(NOTCH_POSITION - offsets, HEIGHT)
    outline = [*top_left[::-1], *left[::-1], *bottom, *right, *top_right]
    mesh.rings(
        outline, (NOTCH_POSITION, HEIGHT - NOTCH_DEPTH), parameters.tip_size / half, parameters.tip_ratio
    )
    mesh.span(right, LENGTH, parameters.element_length, parameters.layers, parameters.layers)

    points = np.ascontiguousarray(np.array(mesh.points).T)
    triangles = np.ascontiguousarray(np.array(mesh.triangles).T)
    one, two = (
        points[:, triangles[1]] - points[:, triangles[0]],
        points[:, triangles[2]] - points[:, triangles[0]],
    )
    area = (one[0] * two[1] - one[1] * two[0]) / 2
    if not np.isclose(np.abs(area).sum(), LENGTH * HEIGHT - NOTCH_DEPTH * mouth, rtol=1e-12):
        raise RuntimeError(f"the triangles of {parameters} do not fill the beam")
    triangles[1:, area < 0] = triangles[:0:-1, area < 0]
    return points, triangles


# --- frequencies
# -----------------------------------------------------------------------------------------------------

_MASS = BilinearForm(lambda u, v, w: u * v)
_GRADIENT_XX = BilinearForm(lambda u, v, w: u.grad[0] * v.grad[0])
_GRADIENT_XY = BilinearForm(lambda u, v, w: u.grad[0] * v.grad[1])
_GRADIENT_YY = BilinearForm(lambda u, v, w: u.grad[1] * v.grad[1])


def _assemble(order: int, mesh: MeshTri) -> tuple[scipy.sparse.csc_matrix, scipy.sparse.csr_matrix]:
    """Return stiffness / Young's modulus and mass / density of the clamped beam, all u_x before all u_y."""
    basis = Basis(mesh, ELEMENTS[order](), intorder=2 * order)
    free = basis.complement_dofs(basis.get_dofs(lambda x: x[0] < 1e-9))
    mass, xx, xy, yy = (
        form.assemble(basis)[free][:, free] for form in (_MASS, _GRADIENT_XX, _GRADIENT_XY, _GRADIENT_YY)
    )
    plane, shear = 1.0 / (1.0 - POISSON**2), 0.5 / (1.0 + POISSON)
    coupling = plane * POISSON * xy.T + shear * xy
    stiffness = scipy.sparse.bmat(
        [[plane * xx + shear * yy, coupling], [coupling.T, plane * yy + shear * xx]], format="csc"
    )
    return stiffness, scipy.sparse.block_diag((mass, mass), format="csr")


def solve(order: int, mesh_parameters: MeshParameters, repeats: int = 1) -> Solution:
    """Compute the frequencies 1-46 on one mesh.

    Parameters
    ----------
    order : int
        Order of the triangles: 2, 3 or 4.
    mesh_parameters : MeshParameters
        The mesh; it is made before the clock starts.
    repeats : int
        How often to compute, everything anew; the least CPU time counts.

    Returns
    -------
    Solution
        Frequencies, unknowns, error and seconds.
    """
    points, triangles = graded_mesh(mesh_parameters)
    records = []
    for _ in range(repeats):
        mesh = MeshTri(points, triangles)
        started = time.process_time()
        stiffness, mass = _assemble(order, mesh)
        assembled = time.process_time()
        factors = splu(
            stiffness, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        factorised = time.process_time()
        unknowns = stiffness.shape[0]
        eigenvalues = eigsh(
            stiffness,
            k=MODES,
            M=mass,
            sigma=0.0,
            which="LM",
            ncv=LANCZOS_VECTORS,
            tol=LANCZOS_TOLERANCE,
            OPinv=LinearOperator(stiffness.shape, matvec=factors.solve, dtype=float),
            return_eigenvectors=False,
            v0=np.random.default_rng(0).standard_normal(unknowns),
        )
        frequencies = np.sqrt(np.sort(eigenvalues) * YOUNG / DENSITY) / (2 * np.pi)
        ended = time.process_time()
        records.append((ended - started, assembled - started, factorised - assembled, ended - factorised))
    seconds, *stages = min(records)
    return Solution(
        order,
        mesh_parameters,
        frequencies,
        unknowns,
        largest_error(frequencies),
        seconds,
        dict(zip(("assembly", "factorisation", "lanczos"), stages)),
    )


# --- scan
# ------------------------------------------------------------------------------------------------------------

# One grid for each order and target: every combination of the values is tried. They were narrowed down by a
# random search over wider ones (about 700 meshes).
SCAN: dict[tuple[int, float], dict[str, tuple]] = {
    (4, 1e-3): {
        "element_length": (0.0115, 0.012, 0.0125),
        "layers": (1,),
        "tip_segments": (1, 2),
        "tip_size": (3e-4, 2e-4, 1e-4),
        "tip_ratio": (0.2,),
        "corner_segments": (1,),
        "corner_size": (0.0, 1e-3),
        "corner_ratio": (0.3,),
    },
    (4, 1e-4): {
        "element_length": (0.0065, 0.007, 0.0075, 0.008),
        "layers": (1,),
        "tip_segments": (2,),
        "tip_size": (3e-5, 2e-5, 1e-5),
        "tip_ratio": (0.12, 0.2),
        "corner_segments": (1,),
        "corner_size": (1e-3, 5e-4),
        "corner_ratio": (0.3,),
    },
    (4, 1e-5): {
        "element_length": (0.006, 0.0065),
        "layers": (2,),
        "tip_segments": (2, 3),
        "tip_size": (2e-6, 1e-6),
        "tip_ratio": (0.4, 0.5),
        "corner_segments": (1,),
        "corner_size": (3e-4, 1e-4),
        "corner_ratio": (0.3,),
    },
    (3, 1e-3): {
        "element_length": (0.006, 0.0065, 0.007),
        "layers": (1, 2),
        "tip_segments": (2,),
        "tip_size": (2e-4, 1e-4),
        "tip_ratio": (0.25, 0.35),
        "corner_segments": (1,),
        "corner_size": (0.0, 1e-3),
        "corner_ratio": (0.2,),
    },
    (3, 1e-4): {
        "element_length": (0.0037, 0.004, 0.0043),
        "layers": (2,),
        "tip_segments": (2, 3),
        "tip_size": (2e-5, 1e-5),
        "tip_ratio": (0.35, 0.45),
        "corner_segments": (1,),
        "corner_size": (1e-3, 5e-4),
        "corner_ratio": (0.3,),
    },
    (3, 1e-5): {
        "element_length": (0.0025, 0.0028),
        "layers": (3,),
        "tip_segments": (4, 5),
        "tip_size": (1e-6,),
        "tip_ratio": (0.5, 0.58),
        "corner_segments": (1, 2),
        "corner_size": (5e-5,),
        "corner_ratio": (0.3,),
    },
    (2, 1e-3): {
        "element_length": (0.002, 0.0024),
        "layers": (2, 3),
        "tip_segments": (4,),
        "tip_size": (2e-4, 1e-4),
        "tip_ratio": (0.35, 0.45),
        "corner_segments": (1, 2),
        "corner_size": (1e-3,),
        "corner_ratio": (0.45,),
    },
    (2, 1e-4): {
        "element_length": (0.001, 0.0012),
        "layers": (5,),
        "tip_segments": (6, 8),
        "tip_size": (2e-5, 1e-5),
        "tip_ratio": (0.65,),
        "corner_segments": (2,),
        "corner_size": (5e-4, 1e-4),
        "corner_ratio": (0.5,),
    },
    (2, 1e-5): {
        "element_length": (0.00056,),
        "layers": (9,),
        "tip_segments": (14,),
        "tip_size": (1e-6,),
        "tip_ratio": (0.8,),
        "corner_segments": (4,),
        "corner_size": (1e-5,),
        "corner_ratio": (0.65,),
    },
}

# The cheapest mesh of each grid, as ``--scan`` finds it (meshes that differ by less than the noise of timing
# may swap).
BEST: dict[tuple[int, float], MeshParameters] = {
    (2, 1e-3): MeshParameters(0.002, 3, 4, 1e-4, 0.35, 2, 1e-3, 0.45),
    (3, 1e-3): MeshParameters(0.0065, 2, 2, 2e-4, 0.25, 1, 0.0, 0.2),
    (4, 1e-3): MeshParameters(0.0115, 1, 2, 3e-4, 0.2, 1, 0.0, 0.3),
    (2, 1e-4): MeshParameters(0.001, 5, 6, 1e-5, 0.65, 2, 1e-4, 0.5),
    (3, 1e-4): MeshParameters(0.004, 2, 3, 2e-5, 0.35, 1, 5e-4, 0.3),
    (4, 1e-4): MeshParameters(0.008, 1, 2, 2e-5, 0.2, 1, 5e-4, 0.3),
    (2, 1e-5): MeshParameters(0.00056, 9, 14, 1e-6, 0.8, 4, 1e-5, 0.65),
    (3, 1e-5): MeshParameters(0.0028, 3, 4, 1e-6, 0.58, 1, 5e-5, 0.3),
    (4, 1e-5): MeshParameters(0.0065, 2, 2, 1e-6, 0.5, 1, 1e-4, 0.3),
}


def best(error: float) -> dict[int, MeshParameters | None]:
    """Return the cheapest mesh of the scan that reaches an error, for each order.

    Parameters
    ----------
    error : float
        Largest relative error allowed in the frequencies 1-46, one of `TARGETS`.

    Returns
    -------
    dict of int to MeshParameters or None
        From order to mesh; None where no mesh of the scan reaches the error.

    Raises
    ------
    ValueError
        If the scan was not made for this error.
    """
    if error not in TARGETS:
        raise ValueError(
            f"the scan was made for the errors {', '.join(f'{target:g}' for target in TARGETS)}, not "
            f"{error:g}"
        )
    return {order: BEST.get((order, error)) for order in ORDERS}


def grid(order: int, target: float) -> Iterator[MeshParameters]:
    """Yield the meshes that the scan tries for an order and a target."""
    values = SCAN[order, target]
    for combination in itertools.product(*values.values()):
        yield MeshParameters(**dict(zip(values, combination)))


def scan(order: int, target: float, finalists: int = 3, repeats: int = 3) -> tuple[Solution | None, int]:
    """Try all meshes of one grid.

    Parameters
    ----------
    order, target : int, float
        Key into `SCAN`.
    finalists : int
        So many meshes with the fewest unknowns among those that reach the target are timed again with
        `repeats`; the fastest wins. (The seconds of a single run fluctuate by more than neighbours in a grid
        differ.)
    repeats : int
        See `solve`.

    Returns
    -------
    winner : Solution or None
        The cheapest that reaches the target with `ROUND_OFF` to spare, None if there is none.
    tried : int
        Number of meshes in the grid.
    """
    solutions = [solve(order, parameters) for parameters in grid(order, target)]
    reached = sorted(
        (solution for solution in solutions if solution.error <= target - ROUND_OFF),
        key=lambda solution: (solution.unknowns, solution.error),
    )[:finalists]
    if len(reached) > 1:
        reached = [solve(order, solution.parameters, repeats) for solution in reached]
    return min(reached, key=lambda solution: solution.seconds, default=None), len(solutions)


# --- command
# ---------------------------------------------------------------------------------------------------------


def _row(target: float, solution: Solution) -> str:
    """Return one line of the table."""
    times = f"{solution.seconds:13.3f}" + "".join(f"{seconds:14.3f}" for seconds in solution.stages.values())
    return f"{target:7.0e}{f'P{solution.order}':>6}{solution.unknowns:10,d}{solution.error:11.2e}{times}"


def main() -> None:
    """Print the table of the best meshes, or repeat the scan."""
    parser = argparse.ArgumentParser(
        description="Frequencies 1-46 of the paper case with scikit-fem.", allow_abbrev=False
    )
    parser.add_argument(
        "--scan", action="store_true", help="repeat the scan that found the meshes (below two minutes)"
    )
    parser.add_argument(
        "--repeats", type=int, default=5, help="runs of each mesh, the fastest counts (default 5)"
    )
    options = parser.parse_args()
    print(" target order  unknowns      error  CPU seconds      assembly factorisation       Lanczos")
    for target in TARGETS:
        for order in ORDERS:
            if options.scan:
                winner, tried = scan(order, target)
                if winner is None:
                    print(f"{target:7.0e}{f'P{order}':>6}  none of {tried} meshes reaches it")
                    continue
                values = ", ".join(
                    f"{getattr(winner.parameters, item.name):g}" for item in fields(MeshParameters)
                )
                known = (
                    "as in BEST" if winner.parameters == BEST.get((order, target)) else "not the one in BEST"
                )
                print(f"{_row(target, winner)}   of {tried}: ({values}), {known}", flush=True)
            elif parameters := best(target)[order]:
                # A mesh that takes seconds needs no repetition to be timed within a few per cent.
                first = solve(order, parameters)
                solution = first if first.seconds > 2.0 else solve(order, parameters, options.repeats)
                print(_row(target, solution), flush=True)
            else:
                print(f"{target:7.0e}{f'P{order}':>6}  no mesh of the scan reaches it")


if __name__ == "__main__":
    main()
