"""Static displacement with unilateral contact between crack faces (prefix ``static_``)."""

from __future__ import annotations

import math
import warnings

from ..checks import choice, flag, shown
from ..contact.complementarity import one_pass_tie, solve_complementarity
from ..errors import RoundOffWarning, SolveError, on_all_ranks
from ..loads import as_loads, separate
from ..parallel import agree, collective
from ..system.equilibrium import equilibrium
from ..system.idle_loads import warn_of_idle_loads
from ..system.model import Model
from .static_result import Static

# Residual, relative to the load or of a refined solution, beyond which it is refused, and beyond which the
# user is warned: displacements are wrong by ten times the residual or so.
REFUSED, ROUND_OFF = 1e-2, 1e-5

_METHODS = {"active_set": solve_complementarity, "one_pass_tie": one_pass_tie}


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
        raise TypeError(f"static: model = {shown(model)} is not a Model")
    with collective(model.comm):
        flag("static", "contact", contact)
        solve = _METHODS[choice("static", "method", method, _METHODS)]
        model.checked_loads(load)
    agree(model.comm, "static", load=load, contact=contact, method=method)
    model.require_support("static")
    warn_of_idle_loads("static", model, separate(load)[0])
    columns = model.load_columns([load])
    found = equilibrium(model, columns, contact, solve)
    _judge(found.residual)
    model.refinement.judge("static")
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
        columns,
        found,
    )


def _judge(relative: float) -> None:
    """Warn or refuse where round-off in K, of a slender or softly held structure, reaches the loads."""
    if not math.isfinite(relative):
        raise on_all_ranks(
            SolveError(
                "static: the displacements leave the range of numbers; are the loads of usual size, in N and "
                "Pa?"
            )
        )
    if relative > REFUSED:
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
