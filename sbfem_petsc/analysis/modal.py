"""Natural frequencies and mode shapes of the structure with open cracks, by SLEPc (prefix ``modal_``)."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass

import numpy as np

from ..errors import SolveError, on_all_ranks
from ..parallel import collective
from ..petsc import PETSc, SLEPc, configure_direct
from ..system.model import Model

# Residual ||K x - w2 M x|| / ||w2 M x|| that a returned pair may have at most. Round-off leaves about
# 1e-16 cond(K)^(1/2) in the lowest modes of a slender beam; 1e-5 in a residual is 1e-10 in a frequency.
RESIDUAL_LIMIT = 1e-5


@dataclass(frozen=True, eq=False)
class Modal:
    """Natural frequencies and modes, lowest first.

    Attributes
    ----------
    frequencies : (n,) array
        Hz.
    residuals : (n,) array
        ||K x - omega^2 M x|| / ||omega^2 M x|| (rigid-body modes: relative to the lowest elastic mode).
    shapes : (owned, n) array
        This rank's displacement unknowns of the modes, mass-normalised with the auxiliary unknowns (x'M x = 1).
    point_shapes : dict of str to (n, 2) array
        Displacement of each named point, on all ranks.
    solver : str
        Eigensolver and direct solver used.
    iterations : int
    model : Model
    """

    frequencies: np.ndarray
    residuals: np.ndarray
    shapes: np.ndarray
    point_shapes: dict[str, np.ndarray]
    solver: str
    iterations: int
    model: Model

    def displacement(self, point: str) -> np.ndarray:
        """(n, 2): displacement of a named point in each mode."""
        return self.point_shapes[point]

    def nodal(self, mode: int) -> np.ndarray:
        """(m, 2): displacements of this rank's nodes in mode `mode` (0 is the lowest). Collective."""
        vector = self.model.stiffness.createVecRight()
        vector.array = self.shapes[:, mode]
        field = self.model.nodal(vector)
        vector.destroy()
        return field

    def __repr__(self) -> str:
        shown = ", ".join(f"{f:.6g}" for f in self.frequencies[:6]) + (", ..." if len(self.frequencies) > 6 else "")
        return f"Modal({len(self.frequencies)} frequencies: {shown} Hz; largest residual {self.residuals.max(initial=0):.1e}; {self.solver})"


def modal(model: Model, count: int | None = None, band: tuple[float, float] | None = None) -> Modal:
    """Natural frequencies of the undamped structure, cracks open, no contact.

    Parameters
    ----------
    model : Model
    count : int, optional
        Number of lowest frequencies (rigid-body modes of a free structure included).
    band : (low, high), optional
        All frequencies in this band, Hz. Give either `count` or `band`.

    Returns
    -------
    Modal

    Raises
    ------
    ValueError
        If neither or both are given, or a value makes no sense.
    SolveError
        If SLEPc does not converge or a residual is too large.
    """
    with collective(model.comm):
        _check_request(model, count, band)
    return _solve(model, count, 0.0) if band is None else _solve_band(model, *band)


def _check_request(model: Model, count, band) -> None:
    if (count is None) == (band is None):
        raise ValueError(f"modal: give either count or band (count = {count!r}, band = {band!r})")
    if count is not None:
        if isinstance(count, bool) or not isinstance(count, numbers.Integral):
            raise TypeError(f"modal: count = {count!r} must be an integer")
        if not 1 <= count <= model.unknowns // 2:
            raise ValueError(f"modal: count = {count} must be between 1 and half the number of unknowns ({model.unknowns // 2})")
    elif not (len(band) == 2 and all(isinstance(b, numbers.Real) and math.isfinite(b) for b in band) and 0 <= band[0] < band[1]):
        raise ValueError(f"modal: band = {band!r} must be two frequencies 0 <= low < high in Hz")


def _solve_band(model: Model, low: float, high: float) -> Modal:
    """Eigenpairs nearest to the middle of the band, more of them until they reach beyond both of its ends."""
    ends = (2.0 * math.pi * np.array([low, high])) ** 2
    middle = float(ends.mean())
    count = 8
    while True:
        found = _solve(model, min(count, model.unknowns // 2), middle)
        values = (2.0 * math.pi * found.frequencies) ** 2
        reached = np.abs(values - middle).max() > ends[1] - middle
        if reached or count >= model.unknowns // 2:
            keep = (found.frequencies >= low) & (found.frequencies <= high)
            points = {name: shape[keep] for name, shape in found.point_shapes.items()}
            return Modal(found.frequencies[keep], found.residuals[keep], found.shapes[:, keep], points, found.solver, found.iterations, model)
        count *= 2


def _solve(model: Model, count: int, target: float) -> Modal:
    """`count` eigenpairs nearest to omega^2 = `target`; a structure without full support is shifted below zero."""
    stiffness, mass = model.pencil
    eps = SLEPc.EPS().create(model.comm)
    try:
        eps.setOptionsPrefix("modal_")
        eps.setOperators(stiffness, mass)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
        eps.setDimensions(count)
        eps.setTolerances(1e-10, 200)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        free = target == 0.0 and not model.supported
        shift = -_lowest_scale(model) if free else target
        eps.setTarget(shift)
        st = eps.getST()
        st.setType(SLEPc.ST.Type.SINVERT)
        package = configure_direct(st.getKSP(), positive_definite=shift <= 0.0)
        eps.setFromOptions()
        eps.solve()
        converged = eps.getConverged()
        if converged < count:
            raise on_all_ranks(SolveError(f"modal: SLEPc found {converged} of {count} eigenpairs (reason {eps.getConvergedReason()} after {eps.getIterationNumber()} iterations); "
                                          "raise -modal_eps_max_it or -modal_eps_ncv, or choose another -modal_st_pc_factor_mat_solver_type"))
        return _collect(model, eps, count, package)
    finally:
        eps.destroy()


def _collect(model: Model, eps: SLEPc.EPS, count: int, package: str) -> Modal:
    """Eigenpairs in ascending order with their residuals."""
    stiffness, mass = model.pencil
    values = np.array([eps.getEigenvalue(i).real for i in range(count)])
    order = np.argsort(values)
    values = values[order]
    owned = int(model.ranges[model.comm.rank + 1] - model.ranges[model.comm.rank])
    shapes, residuals = np.empty((owned, count)), np.empty(count)
    at_points = {name: np.empty((count, 2)) for name in model.points}
    floor = values[min(3, count - 1)] if not model.supported else 0.0
    x, kx, mx = (stiffness.createVecRight() for _ in range(3))
    boundary = model.stiffness.createVecRight()
    for k, i in enumerate(order):
        eps.getEigenvector(int(i), x)
        stiffness.mult(x, kx)
        mass.mult(x, mx)
        norm = math.sqrt(x.dot(mx))
        scale = max(abs(values[k]), floor) * mx.norm()
        kx.axpy(-values[k], mx)
        residuals[k] = kx.norm() / scale if scale > 0 else kx.norm()
        shapes[:, k] = x.array_r[:owned] / norm
        boundary.array = shapes[:, k]
        for name, shape in model.at_points(boundary).items():
            at_points[name][k] = shape
    iterations = eps.getIterationNumber()
    for vector in (x, kx, mx, boundary):
        vector.destroy()
    if not (residuals <= RESIDUAL_LIMIT).all():
        worst = int(np.argmax(residuals))
        raise on_all_ranks(SolveError(f"modal: the residual of mode {worst + 1} is {residuals[worst]:.2g}, more than {RESIDUAL_LIMIT:g}; tighten -modal_eps_tol or choose another -modal_st_pc_factor_mat_solver_type"))
    return Modal(np.sqrt(np.maximum(values, 0.0)) / (2.0 * math.pi), residuals, shapes, at_points, f"SLEPc {eps.getType()}, shift-invert by {package}", iterations, model)


def _lowest_scale(model: Model) -> float:
    """A positive omega^2 well below the elastic modes of a free structure of the model's extent, (rad/s)^2."""
    length = float(np.linalg.norm(model.extent[1] - model.extent[0]))
    speed2 = min(m.modulus / m.density for m in model.materials)
    return 1e-4 * speed2 / length**2
