"""Static displacement with unilateral contact between crack faces (prefix ``static_``)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from ..checks import choice, flag
from ..contact.complementarity import one_pass_tie, solve_complementarity
from ..errors import SolveError, at_point, on_all_ranks
from ..loads import Loads, as_loads
from ..parallel import collective
from ..system.equilibrium import equilibrium
from ..system.model import Model
from ..writing import write_table

# Residual, relative to the load, beyond which a solution is refused, and beyond which the user is warned:
# displacements are wrong by ten times the residual or so (cantilevers with a length of 300 to 1000 heights).
REFUSED, ROUND_OFF = 1e-2, 1e-5


_METHODS = {"active_set": solve_complementarity, "one_pass_tie": one_pass_tie}


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
    contact_resultant : float
        Sum of all contact forces, those inside the tip elements included, N.
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
    contact_resultant: float
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

    def to_csv(self, path: str) -> None:
        """Write displacements of the named points, stress intensity factors and contact pairs as comma-separated
        values: quantity, where, number of the pair, value, unit.

        The file takes its name when it is whole.

        Raises
        ------
        TypeError, ValueError
            If it cannot be written.
        """
        rows: list[tuple[str, str, str, float, str]] = []
        for point, u in self.point_displacements.items():
            rows += [(name, point, "", float(value), "m") for name, value in zip(("u_x", "u_y"), u)]
        for tip, factors in self.stress_intensity.items():
            rows += [(name, tip, "", float(k), "Pa m^(1/2)") for name, k in zip(("K_I", "K_II"), factors)]
        rows.append(("contact_resultant", "", "", self.contact_resultant, "N"))
        crack_of = [self.model.cracks[k].name for k in self.model.pairs.crack]
        for name, values, unit in (("contact_force", self.contact_force, "N"), ("gap", self.gap, "m")):
            rows += [(name, at, str(k), float(v), unit) for k, (at, v) in enumerate(zip(crack_of, values), 1)]
        write_table(path, dict(zip(("quantity", "where", "pair", "value", "unit"), zip(*rows))))

    def __repr__(self) -> str:
        points = ", ".join(f"{n}: ({u[0]:.6g}, {u[1]:.6g})" for n, u in self.point_displacements.items())
        return (
            f"Static({points} m; {int(self.active.sum())} of {len(self.gap)} pairs in contact, resultant "
            f"{self.contact_resultant:.6g} N; {self.solver})"
        )


def static(model: Model, load, *, contact: bool = True, method: str = "active_set") -> Static:
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
    with collective(model.comm):
        flag("static", "contact", contact)
        solve = _METHODS[choice("static", "method", method, _METHODS)]
    model.require_support("static")
    found = equilibrium(model, model.load_columns([load]), contact, solve)
    _judge(found.residual)
    return Static(
        model.at_points(found.owned),
        found.force[: model.gap_operator.pairs],
        found.gap[: model.gap_operator.pairs],
        found.active[: model.gap_operator.pairs],
        float(found.force.sum()),
        model.nodal(found.owned),
        found.iterations,
        model.solver.name,
        found.residual,
        found.intensities,
        as_loads(load),
        model,
    )


def _judge(relative: float) -> None:
    """Warn or refuse where round-off in K, of a slender or softly held structure, reaches the loads."""
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
