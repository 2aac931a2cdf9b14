"""Error of any result by meshes that are refined until two of them agree."""

from __future__ import annotations

import contextlib
import json
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from meshing.warnings import LargeDisplacementWarning, MeshWarning, UnitWarning

from ..checks import shown
from ..errors import failed_solve, warn_of_mesh, wrong_input
from ..ranks.parallel import agree
from ..record.record import Record, derived, described, quantity
from ..system.model import Model
from .analysis import analysis
from .options import EstimateOptions

# From level to level: orders that are added, factors of the largest cells and of the tips' elements, factor
# of the edges along faces.
ORDERS, CELLS, TIPS, FACES = 2, 0.75, 0.4, 1.5
# Changes are taken to fall no faster than to this part of the one before, nor is a result taken to be nearer
# than where two such falls would leave it: a last change may be small by accident, as that of an error which
# changes its sign.
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


@described
class Estimate(Record):
    """A result with its error: `value` is that of the finest level, a number, an array or a dict of these."""

    value: Any
    error: float = quantity(
        "1",
        "estimated relative error: the last change, or less where changes fall fast, but no less than 0.09 "
        "of the change before",
    )
    first_error: float = quantity("1", "that of the first level, its distance from the finest one")
    converged: bool = quantity("1", "whether the error is not larger than the accuracy asked for")
    levels: tuple[Level, ...]

    @derived("1", "displacement unknowns", "level", kinds="iu")
    def unknowns(self) -> np.ndarray:
        """Of the levels."""
        return np.array([level.unknowns for level in self.levels])

    @derived("1", "largest relative difference to the level before", "level", finite=False)
    def change(self) -> np.ndarray:
        """Of the levels, nan for the first."""
        return np.array([level.change for level in self.levels])

    @derived(text="value and levels as JSON", back=True, detail=True)
    def content(self) -> str:
        """For `_revived`: numbers in JSON have all their digits."""
        levels = [[vars(level)[f.name] for f in fields(Level)] for level in self.levels]
        return json.dumps([self.value, levels], default=_listed)

    @classmethod
    def _revived(cls, found: dict[str, Any]) -> Estimate:
        """From a file."""
        value, levels = json.loads(found.pop("content"))
        made = [
            Level(mesh, model, unknowns, _array(one), change) for mesh, model, unknowns, one, change in levels
        ]
        return cls(**found | {"value": _array(value), "levels": tuple(made)})

    def __repr__(self) -> str:
        verdict = "converged" if self.converged else "not converged"
        return (
            f"Estimate({verdict}: relative error {self.error:.2g} with {self.levels[-1]!r} after "
            f"{len(self.levels)} levels; the first one was off by {self.first_error:.2g})"
        )


def _listed(item: Any) -> Any:
    return item.tolist() if isinstance(item, (np.ndarray, np.generic)) else repr(item)


def _array(item: Any) -> Any:
    """Lists of numbers as arrays."""
    if isinstance(item, dict):
        return {name: _array(value) for name, value in item.items()}
    return np.array(item) if isinstance(item, list) else item


@analysis(EstimateOptions, rubs=True)
def estimate(
    model: Model | Callable[..., Model],
    quantity: Callable[[Model], Any],
    *,
    accuracy: float = 1e-4,
    levels: int = 6,
    mesh: Mapping[str, Any] | None = None,
    continued_fraction: int | None = None,
    tip_modes: int | None = None,
) -> Estimate:
    """A result on finer and finer meshes, until it keeps its value. Collective.

    ::

        sb.estimate(model, lambda model: sb.periodic(model, load, 3000.0).harmonics("A"), accuracy=1e-3)

    From each level to the next the order rises by two, cells shrink by a quarter, the elements on crack tips
    to 0.4 of their size with rings around them, the faces of cracks get half as many edges and pairs again,
    and the continued fraction and the pressure modes at tips a term more. `modal` and `static` do the same
    with their own quantities where they are given an accuracy.

    Parameters
    ----------
    model : Model or callable
        A model whose mesh comes from `Beam.mesh`, `Plate.mesh` or `read_gmsh`: the first level. Or a function
        that makes a model of options for the mesh (a dict: order, and from the second level on size, tip_size
        and face_edges) and the keyword arguments continued_fraction and tip_modes of `Model`. Models that are
        made here are destroyed afterwards.
    quantity : callable
        What is wanted of a model: a number, an array (frequencies, displacements, K), or a dict of these.
        Arrays must keep their shape: things at fixed places, not at pairs or nodes.
    accuracy : float
        Relative error asked for.
    levels : int
        Most levels, 2 to 8.
    mesh : dict, optional
        Options of the first mesh of a function, such as ``{"order": 4, "size": 0.01}``; default: the mesh's
        own, order 5.
    continued_fraction, tip_modes : int, optional
        Of the first level of a function; default: 1 and 4.

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
        For input that makes no sense, or a model of whose mesh it is not known how it was made.

    Warns
    -----
    MeshWarning
        If the accuracy is not reached with so many levels.
    """
    if not callable(quantity):
        raise wrong_input(f"estimate: quantity = {quantity!r} is not a function", TypeError)
    start = model if isinstance(model, Model) else _first_level(model, mesh, continued_fraction, tip_modes)
    given = {"mesh": mesh, "continued_fraction": continued_fraction, "tip_modes": tip_modes}
    for name, value in given.items() if start is model else ():
        if value is not None:
            raise wrong_input(f"estimate: {name} = {value!r} is of no use beside a model, which has its own")
    sought = Sought(quantity, lambda value: value)
    finest, _, found = refined("estimate", sought, start, accuracy=accuracy, levels=levels)
    if finest is not model:
        finest.destroy()
    return found


class Sought(NamedTuple):
    """What is computed on each level.

    Attributes
    ----------
    solve : callable
        Gives a result of a model.
    quantity : callable
        Number, array or dict of these of a result.
    least_error : callable
        Relative error that a result is known to have.
    """

    solve: Callable[[Model], Any]
    quantity: Callable[[Any], Any]
    least_error: Callable[[Any], float] = lambda result: 0.0


class FirstLevel(NamedTuple):
    """A level that is still to be made: a function as `estimate` takes it, options of mesh and model."""

    make_model: Callable[..., Model]
    mesh: Mapping[str, Any]
    options: Mapping[str, int]


def _first_level(
    make_model: Any, mesh: Any, continued_fraction: int | None, tip_modes: int | None
) -> FirstLevel:
    """Of a function, with the defaults of meshes and models; TypeError for what is none."""
    if mesh is not None and not (isinstance(mesh, Mapping) and all(isinstance(key, str) for key in mesh)):
        raise wrong_input(f"estimate: mesh = {shown(mesh)} must be a dict of options by name", TypeError)
    if not callable(make_model):
        raise wrong_input(
            f"estimate: model = {make_model!r} is neither a Model nor a function that makes one", TypeError
        )
    options = {
        "continued_fraction": 1 if continued_fraction is None else continued_fraction,
        "tip_modes": 4 if tip_modes is None else tip_modes,
    }
    return FirstLevel(make_model, {"order": 5, **(mesh or {})}, options)


def refined(
    owner: str, sought: Sought, start: Model | FirstLevel, *, accuracy: float, levels: int = 6
) -> tuple[Model, Any, Estimate]:
    """Solve on finer and finer meshes until a quantity keeps its value. Collective.

    Parameters
    ----------
    owner : str
        For messages.
    sought : Sought
    start : Model or FirstLevel
        The first level; a model that is given is not destroyed.
    accuracy, levels
        See `estimate`.

    Returns
    -------
    finest : Model
        All models but this one and `start` are destroyed.
    result
        That of `solve` on it.
    estimate : Estimate
    """
    first = start if isinstance(start, Model) else None
    if isinstance(start, Model):
        make_model, mesh = start.remade, {"order": start.order, **start.mesh_options(owner)}
        options = {"continued_fraction": start.continued_fraction, "tip_modes": start.tips.modes}
    else:
        make_model, mesh, options = start.make_model, dict(start.mesh), dict(start.options)
    done: list[Level] = []
    model, result, error, first_known = first, None, math.inf, 0.0
    try:
        while True:
            if model is None:
                with _warned_once(done):
                    model = _made(owner, make_model, mesh, options)
                if not done:  # the ranks of a function's models are known from here on
                    asked = {"quantity": sought.solve, "accuracy": accuracy, "levels": levels}
                    agree(model.comm, owner, asked)
            with _warned_once(done):
                warnings.simplefilter("ignore", MeshWarning)  # that is what the levels are for
                result = sought.solve(model)
            value = _finite(owner, sought.quantity(result), mesh)
            change = _difference(done[-1].value, value) if done else math.nan
            done.append(Level(dict(mesh), dict(options), model.boundary_unknowns, value, change))
            known = sought.least_error(result)
            error, first_known = max(_last_error(done), known), first_known if len(done) > 1 else known
            if len(done) == levels or (len(done) > 1 and error <= accuracy):
                break
            mesh = _finer(mesh, *_sizes(model))
            options = {name: number + 1 for name, number in options.items()}
            if model is not first:
                model.destroy()
            model = None
    except BaseException:
        if model is not None and model is not first:
            model.destroy()
        raise
    found = Estimate(
        done[-1].value,
        error,
        max(_difference(done[0].value, done[-1].value), first_known) + error,
        error <= accuracy,
        tuple(done),
    )
    if not found.converged:
        warn_of_mesh(
            f"{owner}: {levels} levels reach a relative error of about {error:.2g}, not {accuracy:.2g}; a "
            "quantity without a limit, such as a stress at a corner or a displacement under a point force, "
            "has none"
        )
    return model, result, found


@contextlib.contextmanager
def _warned_once(done: Sequence[Level]) -> Iterator[None]:
    """What warnings say of the first level is not said of finer ones again."""
    with warnings.catch_warnings():
        for kind in (UnitWarning, LargeDisplacementWarning) if done else ():
            warnings.simplefilter("ignore", kind)
        yield


def _finite(owner: str, value: Any, mesh: Mapping[str, Any]) -> Any:
    """A level's value, if it is finite throughout."""
    if not all(np.isfinite(item).all() for item in _items(value).values()):
        raise failed_solve(f"{owner}: the quantity is not finite with {mesh}")
    return value


def _made(owner: str, make_model: Callable[..., Model], mesh: Mapping[str, Any], options: Any) -> Model:
    """The model that a function makes of a mesh's options."""
    try:
        made = make_model(dict(mesh), **options)
    except TypeError as error:
        if "keyword argument" not in str(error) and "positional argument" not in str(error):
            raise
        raise wrong_input(
            f"{owner}: model cannot be made with mesh = {shown(mesh)} and {shown(options)}: {error}",
            TypeError,
        ) from error
    if not isinstance(made, Model):
        raise wrong_input(f"{owner}: make_model returned {made!r}, a Model was expected", TypeError)
    return made


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
    part, order = model.layout.part, model.order
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
    arrays = {str(name): np.atleast_1d(np.asarray(item)) for name, item in table.items()}
    for array in arrays.values():
        if array.dtype.kind not in "iufc":
            raise wrong_input(
                f"estimate: the quantity is {shown(value)}; a number, an array of numbers or a dict of "
                "them was expected",
                TypeError,
            )
    return arrays


def _difference(one: Any, other: Any) -> float:
    """Largest relative difference of two values of a quantity, relative to the second."""
    first, second = _items(one), _items(other)
    if {n: a.shape for n, a in first.items()} != {n: a.shape for n, a in second.items()}:
        raise failed_solve(
            "estimate: the quantity has another shape on a finer mesh; ask for values at fixed points, "
            "crack tips or modes, not at pairs or nodes"
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
    left = changes[-1] * ratio / (1.0 - ratio) if ratio < 0.5 else changes[-1]
    return max(left, FASTEST**2 * changes[-2])
