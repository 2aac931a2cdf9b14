"""Error of any result by meshes that are refined until two of them agree."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import integer, positive
from ..errors import SolveError, on_all_ranks
from ..system.model import Model
from ..system.resolution import MeshWarning

# From level to level: orders that are added, factors of the largest cells and of the tips' elements, factor
# of the edges along faces.
ORDERS, CELLS, TIPS, FACES = 2, 0.75, 0.4, 1.5
# Changes are taken to fall no faster than to this part of the one before.
FASTEST = 0.3


@dataclass(frozen=True, eq=False)
class Level:
    """One discretisation and what it gave.

    Attributes
    ----------
    mesh : dict
        Options of the mesh.
    model : dict
        Options of the model.
    unknowns : int
        Displacement unknowns.
    value : float, array or dict of these
    change : float
        Largest relative difference to the level before; nan for the first.
    """

    mesh: dict[str, Any]
    model: dict[str, Any]
    unknowns: int
    value: Any
    change: float

    def __repr__(self) -> str:
        options = ", ".join(
            f"{name}={item:.4g}" if isinstance(item, float) else f"{name}={item}"
            for name, item in {**self.mesh, **self.model}.items()
        )
        return f"Level({options}; {self.unknowns:,d} unknowns, change {self.change:.2g})"


@dataclass(frozen=True, eq=False)
class Estimate:
    """A result with its error.

    Attributes
    ----------
    value : float, array or dict of these
        Of the finest level.
    error : float
        Estimate of its relative error: the last change, or less where changes fall fast.
    first_error : float
        That of the first level, which is the default mesh unless `start` says otherwise: its distance from
        the finest one.
    converged : bool
        Whether `error` is not larger than the accuracy asked for.
    levels : tuple of Level
    """

    value: Any
    error: float
    first_error: float
    converged: bool
    levels: tuple[Level, ...]

    def __repr__(self) -> str:
        verdict = "converged" if self.converged else "not converged"
        return (
            f"Estimate({verdict}: relative error {self.error:.2g} with {self.levels[-1]!r} after "
            f"{len(self.levels)} levels; the first one was off by {self.first_error:.2g})"
        )


def estimate(
    make_model: Callable[..., Model],
    quantity: Callable[[Model], Any],
    *,
    accuracy: float = 1e-4,
    levels: int = 6,
    start: Mapping[str, Any] | None = None,
    continued_fraction: int = 1,
    tip_modes: int = 4,
) -> Estimate:
    """A result on finer and finer meshes, until it keeps its value. Collective.

    ::

        sb.estimate(
            lambda mesh, **options: sb.Model(beam.mesh(**mesh), aluminium, **options),
            lambda model: sb.modal(model, 20).frequencies,
            accuracy=1e-5,
        )

    From each level to the next the order rises by two, cells shrink by a quarter, the elements on crack tips
    to 0.4 of their size with rings around them, the faces of cracks get half as many edges and pairs again,
    and the continued fraction and the pressure modes at tips a term more.

    Parameters
    ----------
    make_model : callable
        Makes a model of options for the mesh (a dict: order, and from the second level on size, tip_size and
        face_edges, as `Beam.mesh`, `Plate.mesh` and `read_gmsh` take them) and the keyword arguments
        continued_fraction and tip_modes of `Model`. The models are destroyed afterwards.
    quantity : callable
        What is wanted of a model: a number, an array (frequencies, displacements, K), or a dict of these.
        Arrays must keep their shape: things at fixed places, not at pairs or nodes.
    accuracy : float
        Relative error asked for.
    levels : int
        Most levels, 2 to 8.
    start : dict, optional
        Options of the first mesh, such as ``{"order": 4, "size": 0.01}``; default: the mesh's own, order 5.
    continued_fraction, tip_modes : int
        Of the first level.

    Returns
    -------
    Estimate
        Errors of an array or of each of a dict's are the largest ones, relative to the largest component; of
        ascending positive arrays, as frequencies are, component by component.

    Raises
    ------
    SolveError
        If a level gives values that are not finite, or of another shape than the one before.
    ValueError, TypeError
        For input that makes no sense.

    Warns
    -----
    MeshWarning
        If the accuracy is not reached with so many levels.
    """
    for name, function in (("make_model", make_model), ("quantity", quantity)):
        if not callable(function):
            raise on_all_ranks(TypeError(f"estimate: {name} = {function!r} is not a function"))
    positive("estimate", "accuracy", accuracy)
    integer("estimate", "levels", levels, least=2, most=8)
    mesh: dict[str, Any] = {"order": 5, **(start or {})}
    model_options = {"continued_fraction": continued_fraction, "tip_modes": tip_modes}
    done: list[Level] = []
    while len(done) < levels:
        level, cells, tips = _solve(make_model, quantity, mesh, model_options, done)
        done.append(level)
        if len(done) > 1 and _last_error(done) <= accuracy:
            break
        mesh = _finer(mesh, cells, tips)
        model_options = {name: number + 1 for name, number in model_options.items()}
    error = _last_error(done)
    result = Estimate(
        done[-1].value,
        error,
        _difference(done[0].value, done[-1].value) + error,
        error <= accuracy,
        tuple(done),
    )
    if not result.converged:
        warnings.warn(
            f"estimate: {levels} levels reach a relative error of about {error:.2g}, not {accuracy:.2g}; a "
            "quantity without a limit, such as a stress at a corner or a displacement under a point force, "
            "has none",
            MeshWarning,
            stacklevel=2,
        )
    return result


def _solve(make_model, quantity, mesh, model_options, done: list[Level]) -> tuple[Level, float, float]:
    """A level, the size of its largest cell's edges and of its smallest tip element, m."""
    model = make_model(dict(mesh), **model_options)
    if not isinstance(model, Model):
        raise on_all_ranks(TypeError(f"estimate: make_model returned {model!r}, a Model was expected"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)  # that is what the levels are for
            value = quantity(model)
        change = _difference(done[-1].value, value) if done else math.nan
        if not all(np.isfinite(item).all() for item in _items(value).values()):
            raise on_all_ranks(SolveError(f"estimate: the quantity is not finite with {mesh}"))
        unknowns, (cells, tips) = model.boundary_unknowns, _sizes(model)
    finally:
        model.destroy()
    return Level(dict(mesh), dict(model_options), unknowns, value, change), cells, tips


def _finer(mesh: dict[str, Any], cells: float, tips: float) -> dict[str, Any]:
    """Options of the next mesh; sizes of the first are measured on it."""
    finer = {**mesh, "order": min(mesh["order"] + ORDERS, 20), "size": CELLS * mesh.get("size", cells)}
    if tips < math.inf:
        finer["tip_size"] = TIPS * mesh.get("tip_size", tips)
        if "face_size" in mesh:
            finer["face_size"] = mesh["face_size"] / FACES
        else:
            finer["face_edges"] = math.ceil(FACES * mesh.get("face_edges", 12))
    return finer


def _sizes(model: Model) -> tuple[float, float]:
    """The longest straight edge, and the least reach of an S-element on a tip; inf without one.
    Collective.
    """
    part, order = model.part, model.order
    longest, reach = 0.0, math.inf
    for chain, closed, centre in zip(part.chains, part.closed, part.centres):
        corners = part.coordinates[chain[::order]]
        edges = np.diff(np.vstack([corners, corners[:1]]) if closed else corners, axis=0)
        longest = max(longest, float(np.hypot(*edges.T).max()))
        if not closed:
            reach = min(reach, float(np.hypot(*(corners - centre).T).max()))
    return max(model.comm.allgather(longest)), min(model.comm.allgather(reach))


def _items(value: Any) -> dict[str, np.ndarray]:
    """A quantity as named arrays."""
    table = value if isinstance(value, Mapping) else {"": value}
    return {str(name): np.atleast_1d(np.asarray(item)) for name, item in table.items()}


def _difference(one: Any, other: Any) -> float:
    """Largest relative difference of two values of a quantity, relative to the second."""
    first, second = _items(one), _items(other)
    if {n: a.shape for n, a in first.items()} != {n: a.shape for n, a in second.items()}:
        raise on_all_ranks(
            SolveError(
                "estimate: the quantity has another shape on a finer mesh; ask for values at fixed points, "
                "crack tips or modes, not at pairs or nodes"
            )
        )
    worst = 0.0
    for name, exact in second.items():
        scale = np.abs(exact)
        ascending = (
            exact.ndim == 1 and np.isrealobj(exact) and (exact > 0).all() and (np.diff(exact) >= 0).all()
        )
        if not ascending:
            scale = np.full(exact.shape, scale.max(initial=0.0))
        change = np.abs(first[name] - exact)
        worst = max(
            worst, float(np.divide(change, scale, out=1.0 * (change > 0), where=scale > 0).max(initial=0.0))
        )
    return worst


def _last_error(done: list[Level]) -> float:
    """Error of the last level: what further levels would add if changes kept falling as they do."""
    changes = [level.change for level in done[1:]]
    if len(changes) < 2:
        return changes[0] if changes else math.inf
    ratio = max(changes[-1] / max(changes[-2], 1e-300), FASTEST)
    return changes[-1] * ratio / (1.0 - ratio) if ratio < 0.5 else changes[-1]
