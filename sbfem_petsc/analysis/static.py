"""Static displacement with unilateral contact between crack faces (prefix ``static_``)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from ..contact.complementarity import one_pass_tie, solve_complementarity
from ..contact.delassus import ContactRows, delassus
from ..errors import SolveError, at_point, on_all_ranks
from ..loads import Loads, as_loads
from ..petsc import check_ksp, make_ksp, solver_name
from ..system.model import Model

# Residual, relative to the load, beyond which a solution is refused, and beyond which the user is warned:
# displacements are wrong by ten times the residual or so (cantilevers with a length of 300 to 1000 heights).
REFUSED, ROUND_OFF = 1e-2, 1e-5


class RoundOffWarning(UserWarning):
    """Round-off limits the digits of a result to less than is usual."""


@dataclass(frozen=True, eq=False)
class Static:
    """Static solution.

    Attributes
    ----------
    point_displacements : dict of str to (2,) array
        m, on all ranks.
    contact_force : (pairs,) array
        N, compression positive, all cracks in order.
    gap : (pairs,) array
        m.
    active : (pairs,) bool array
    field : (m, 2) array
        Displacements of this rank's nodes, m.
    iterations : int
        Of the active set.
    solver : str
    residual : float
        ||K u - f - G' force|| / ||f||.
    stress_intensity : dict of str to (float, float)
        K_I and K_II of each crack with a tip element, Pa m^(1/2) (Pa m^(1 - lambda) at an open notch).
    load : Loads
    model : Model
    """

    point_displacements: dict[str, np.ndarray]
    contact_force: np.ndarray
    gap: np.ndarray
    active: np.ndarray
    field: np.ndarray
    iterations: int
    solver: str
    residual: float
    stress_intensity: dict[str, tuple[float, float]]
    load: Loads
    model: Model

    def displacement(self, point: str) -> np.ndarray:
        """(2,): displacement of a named point, m."""
        return at_point(self.point_displacements, point)

    @property
    def contact_resultant(self) -> float:
        """Sum of the contact forces, N."""
        return float(self.contact_force.sum())

    def __repr__(self) -> str:
        points = ", ".join(f"{n}: ({u[0]:.6g}, {u[1]:.6g})" for n, u in self.point_displacements.items())
        return (
            f"Static({points} m; {int(self.active.sum())} of {len(self.gap)} pairs in contact, resultant "
            f"{self.contact_resultant:.6g} N; {self.solver})"
        )


def static(model: Model, load, contact: bool = True, method: str = "active_set") -> Static:
    """Static displacement under constant loads.

    Parameters
    ----------
    model : Model
    load : PointForce, EdgeLoad, a sum or a sequence of them
    contact : bool
        Whether crack faces may press on each other; False: the linear solution, which lets them overlap.
    method : {"active_set", "one_pass_tie"}
        Unilateral contact, or the paper's single correction that ties every penetrating pair and admits
        tension.

    Raises
    ------
    ValueError, KeyError, TypeError
        For unknown points and sets, values that are not finite, a structure that is not held.
    SolveError
        If the linear solve or the active set fails.
    """
    if not isinstance(model, Model):
        raise TypeError(f"static: model = {model!r} is not a Model")
    solvers = {"active_set": solve_complementarity, "one_pass_tie": one_pass_tie}
    if not isinstance(method, str) or method not in solvers:
        raise ValueError(
            f"static: method = {method!r} is unknown; use one of {', '.join(map(repr, solvers))}"
        )
    model.require_support("static")
    forces = model.load_vector(load)
    ksp = make_ksp(model.stiffness, "static_")
    rows = ContactRows(model)
    solution = forces.duplicate()
    ksp.solve(forces, solution)
    check_ksp(ksp, "static")
    gap = rows.gaps(solution) + model.pairs.gap
    contact_force, active, iterations = np.zeros(len(gap)), np.zeros(len(gap), dtype=bool), 0
    right = forces.copy()
    if contact and (gap < 0.0).any():
        result = solvers[method](delassus(rows, ksp, "static contact"), gap)
        contact_force, gap, active, iterations = result.force, result.gap, result.active, result.iterations
        rows.add_forces(right, contact_force)
        ksp.solve(right, solution)
        check_ksp(ksp, "static")
    residual = forces.duplicate()
    model.stiffness.mult(solution, residual)
    residual.axpy(-1.0, right)
    scale = forces.norm()
    _judge(residual.norm(), scale)
    field = model.nodal(solution)
    answer = Static(
        model.at_points(solution.array_r),
        contact_force,
        gap,
        active,
        field,
        iterations,
        solver_name(ksp),
        residual.norm() / scale if scale > 0 else 0.0,
        model.tips.evaluate(field),
        as_loads(load),
        model,
    )
    for item in (forces, solution, right, residual, ksp):
        item.destroy()
    return answer


def _judge(residual: float, scale: float) -> None:
    """Warn or refuse where round-off in K, of a slender or softly held structure, reaches the loads."""
    relative = residual / scale if scale > 0 else 0.0
    if not relative <= REFUSED:
        raise on_all_ranks(
            SolveError(
                f"static: the forces are in balance to {relative:.2g} of the load only: the stiffness is too "
                "badly conditioned, as where supports hardly hold the structure; stiffen them"
            )
        )
    if relative > ROUND_OFF:
        warnings.warn(
            f"static: the forces are in balance to {relative:.2g} of the load; displacements of a structure "
            "as slender or as softly held as this one may be wrong by ten times as much",
            RoundOffWarning,
            stacklevel=3,
        )
