"""Static displacement with unilateral contact between crack faces (prefix ``static_``)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple, overload

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from meshing.warnings import RoundOffWarning, StepWarning

from ..checks import instance
from ..contact.complementarity import Complementarity
from ..contact.friction import STICKS, Memory
from ..contact.law import FREE
from ..errors import failed_solve, listed, warn, warn_of_mesh
from ..loads import as_loads, separate
from ..motion.loading import loading
from ..motion.rest import Rest
from ..motion.states import ModalStates
from ..petsc import chosen
from ..ranks.parallel import collective
from ..reduction.reduced_model import SYSTEM, ReducedModel, require_rows
from ..signals.signal import Constant
from ..system.fields.fracture import contact_nodal_forces, energy_release_rates, notes, t_stresses
from ..system.fields.sampling import Field
from ..system.fields.static_resolution import AtRest, warn_of_rest
from ..system.fields.tips import warn_of_tips
from ..system.idle_loads import warn_of_idle_loads
from ..system.model import Model
from ..system.solve.equilibrium import Equilibrium
from .analysis import analysis
from .estimate import Sought, refined
from .options import StaticOptions
from .static_result import ReducedStatic, Static

# Residual, relative to the load or of a refined solution, beyond which it is refused, and beyond which the
# user is warned: displacements are wrong by ten times the residual or so.
REFUSED, ROUND_OFF = 1e-2, 1e-5
# Share of the contact resultant that nothing carries next to a tip, beyond which the user is warned.
UNRESOLVED = 2e-2
# Share of the loads up to which it is left unsaid.
NEGLIGIBLE = 1e-6
# Relative error of contact pressures, in units of how much more bodies give way as a whole than their faces
# do: 0.034, 2.6e-4, 4.8e-5, 2.3e-6 were met at 1.5e11, 1.5e9, 1.5e8, 1.5e7; and the error that is warned of.
DIGITS, LOST = 2e-13, 1e-4


@overload
def static(model: Model, load, *, contact: bool = True, accuracy: float | None = None) -> Static: ...
@overload
def static(model: ReducedModel, load, *, contact: bool = True) -> ReducedStatic: ...
@analysis(StaticOptions, rubs=True)
def static(
    model: Model | ReducedModel, load, *, contact: bool = True, accuracy: float | None = None
) -> Static | ReducedStatic:
    """Static displacement under constant loads.

    Parameters
    ----------
    model : Model or ReducedModel
        A reduced one of a body or of matrices, whose residual flexibility makes it exact, has no further
        options than `contact`.
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        Of a reduced model a number for each of its unit loads.
    contact : bool
        Whether crack faces may press on each other; False: the linear solution, which lets them overlap.
        Faces that rub (`Coulomb`) are loaded in one step from rest.
    accuracy : float, optional
        Relative error asked for: finer meshes are made, as by `estimate`, until two of them agree in the
        displacements of the named points, the contact resultant, and the stress intensity factors, relative
        to the largest of them with and without contact. The result is the finest one's, `Static.model` its
        model, `Static.estimate` says what was used. Default: the model's own mesh alone.

    Raises
    ------
    ValueError, KeyError, TypeError
        For unknown points and sets, values that are not finite, a structure that is not held.
    SolveError
        If the linear solve or the active set fails.

    Warns
    -----
    MeshWarning
        If the displacement under the loads is off by about a thousandth of itself or more, because edges are
        long for how they bend (nothing is told of what single forces do next to them); if faces touch next to
        a tip over less than its S-element resolves; if the stresses around a tip are not carried by its
        edges; if the accuracy asked for is not reached.
    LargeDisplacementWarning
        If displacements are more than 5 % of the body.
    StepWarning
        If faces that rub (`Coulomb`) and stood apart close in this one step.
    RoundOffWarning
        If a structure, or a body that contact presses on, is held so softly that digits are lost.
    SolverWarning
        If the linear solver chosen by PETSc's options is a poor one for the structure.
    """
    if isinstance(model, ReducedModel):
        return _of_rows(model, load, contact, accuracy)
    instance("static", "model", model, Model, SYSTEM)
    if accuracy is None:
        found = state(model, load, contact)
        warn_of_tips("static", model.tips, [found.stress_intensity])
        warn_of_rest(model, [at_rest("static", found)])
        return found
    _prepare(model, load)
    _, found, estimate = refined(
        "static",
        Sought(
            lambda level: _solved(level, load, contact),
            _judged,
            _unresolved if contact else lambda result: 0.0,
        ),
        model,
        accuracy=accuracy,
    )
    return replace(found, estimate=estimate)


def _of_rows(reduced: ReducedModel, load, contact: bool, accuracy: float | None) -> ReducedStatic:
    if accuracy is not None:
        raise ValueError("static: accuracy is of a Model; leave it out of a reduced one")
    signals = loading("static", reduced, load).signals
    for signal in signals:
        if not isinstance(signal, Constant):
            raise ValueError(f"static: load = {signal!r} changes in time; give a number, or use load_history")
    found = reduced_states("static", reduced, np.array([[float(signal(0.0)) for signal in signals]]), contact)
    (touching,), moved, count = found.touching, found.motion, reduced.pairs
    rubbed = dict[str, Any]()
    if reduced.friction is not None:
        memory = Memory.of(touching, count)
        rubbed = {"slip": memory.slip, "friction_force": memory.force, "friction_loss": found.lost[0]}
    return ReducedStatic(
        dict(zip(moved.points, reduced.points(moved.q, moved.amplitudes, moved.contact)[0, :, -1].tolist())),
        touching.force[:count],
        touching.gap[:count],
        touching.active[:count],
        float(moved.strain_energy[0]),
        touching.iterations,
        reduced.point_directions,
        field=moved.field(0).nodal if reduced.shows else None,
        **rubbed,
    )


class ReducedStates(NamedTuple):
    """Static states of a reduced model, its contact in each, and what friction has taken since the one before
    (J), where anything rubs.
    """

    motion: ModalStates
    touching: list[Complementarity]
    lost: list[float]


def reduced_states(owner: str, reduced: ReducedModel, amplitudes: np.ndarray, contact: bool) -> ReducedStates:
    """The static states under (n, loads) amplitudes, each from the one before, the first from rest; exact,
    for the residual flexibility is that of all modes left out.
    """
    require_rows(owner, reduced)
    if not reduced.omega.all():
        raise ValueError(
            f"{owner}: the reduced model has rigid-body motions (0 Hz); hold it, say by weak springs"
        )
    rest, friction = Rest(reduced, contact), reduced.friction
    memory = None if friction is None else Memory.none(reduced.contact_laws, friction)
    places, touching, lost = list[np.ndarray](), list[Complementarity](), list[float]()
    for loads in amplitudes:
        q, found = rest(loads, memory)
        if friction is not None and memory is not None:
            former, memory = memory, Memory.of(found, reduced.gaps)
            lost.append(memory.lost_since(former, friction))
        places.append(q)
        touching.append(found)
    q, force = np.array(places), np.array([found.force for found in touching])
    return ReducedStates(ModalStates(q, np.zeros_like(q), amplitudes, force, reduced), touching, lost)


def state(model: Model, load, contact: bool, former: Static | None = None) -> Static:
    """The solution on the model's own mesh, of faces that rub after a former one. Collective."""
    _prepare(model, load)
    found = _solved(model, load, contact, former)
    _warn_of_springs(found)
    if contact:
        _warn_of_contact(found)
    if former is None:
        _warn_of_closing(found)
    return found


def at_rest(name: str, found: Static) -> AtRest:
    """What is asked of cells and order of a state; the name is for messages. Collective."""
    pairs = found.model.pairs.nodes[found.equilibrium.force[: len(found.gap)] != 0.0]
    acceleration = found.columns.acceleration[:, 0]
    return AtRest(name, found.field, found.load, acceleration, pairs.ravel(), found.strain_energy)


def _prepare(model: Model, load) -> None:
    with collective(model.comm):
        model.checked_loads(load)
    model.require_support("static")
    warn_of_idle_loads("static", model, separate(load)[0])


def _judged(found: Static) -> dict[str, np.ndarray]:
    """What an accuracy is asked of."""
    quantities: dict[str, np.ndarray] = {}
    if found.point_displacements:
        quantities["displacements"] = np.array(list(found.point_displacements.values()))
    if found.stress_intensity:
        # K_I vanishes where a crack closes: what contact leaves below zero is `unresolved_contact`'s matter
        factors = np.nan_to_num(list(found.stress_intensity.values()))
        if found.active.any() or found.contact_resultant > 0.0:
            factors[:, 0] = np.maximum(factors[:, 0], 0.0)
        free = found.model.equilibrium(found.columns, False).intensities
        quantities["stress intensity factors"] = np.array([factors, np.nan_to_num(list(free.values()))])
    if len(found.contact_force):
        quantities["contact resultant"] = np.array(found.contact_resultant)
    return quantities or {"strain energy": np.array(found.strain_energy)}


def _unresolved(found: Static) -> float:
    """Share of the contact resultant that pairs and pressure modes do not carry; 0 where that is nothing
    beside the loads. It falls with the square of the loads: those that vanish leave one of rounding.
    """
    missed = sum(map(abs, found.unresolved_contact.values()))
    columns = found.columns
    pulled = 0.0 if columns.lift is None else np.abs(columns.lift.forces).sum()
    loads = found.model.comm.allreduce(float(np.abs(columns.nodal).sum() + pulled))
    return missed / (missed + max(found.contact_resultant, 0.0)) if missed > NEGLIGIBLE * loads else 0.0


def _warn_of_contact(found: Static) -> None:
    share = _unresolved(found)
    if share <= UNRESOLVED:
        return
    missed = found.unresolved_contact
    name = max(missed, key=lambda tip: abs(missed[tip]))
    total = sum(missed.values())
    off = f"misses about {total:.4g} N" if total >= 0.0 else f"is too large by about {-total:.4g} N"
    warn_of_mesh(
        f"static: next to the tip of {name} the faces touch over less than its S-element resolves: the "
        f"contact resultant of {found.contact_resultant:.4g} N {off}, "
        "see unresolved_contact; give a smaller tip_size"
    )


def _shared_forces(model: Model, memory: Memory | None) -> tuple[str, ...]:
    """A sentence where gaps and slips that are held at nodes in which faces bend or cracks meet depend on
    each other, whose single forces are then not determined.
    """
    pairs, count = model.pairs, len(model.pairs)
    if memory is None:
        return ()
    laws = [model.tips.laws[model.cracks[k].name] for k in pairs.crack]
    rigid = np.array([[not law.compliance, not getattr(law, "tangential_compliance", 0.0)] for law in laws])
    held = np.stack([memory.normal[:count] != FREE, memory.tangential[:count] == STICKS], axis=1)
    held &= rigid.reshape(-1, 2)
    closed = np.flatnonzero(held.any(axis=1))
    nodes, ends = np.unique(pairs.nodes[closed], return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = sparse.coo_array((np.ones(len(closed)), tuple(ends.T)), shape=(len(nodes), len(nodes)))
    places, of_node = csgraph.connected_components(graph, directed=False)
    of_pair, found = of_node[ends[:, 0]], list[int]()
    directions = np.stack([pairs.normal, pairs.normal[:, ::-1] * [1.0, -1.0]], axis=1)[closed]
    rings = np.bincount(of_pair, minlength=places) >= np.bincount(of_node, minlength=places)
    for place in np.flatnonzero(rings):
        mine = np.flatnonzero(of_pair == place)
        rows = np.zeros((len(mine), 2, len(nodes), 2))
        for row, pair in zip(rows, mine):
            row[:, ends[pair, 0]], row[:, ends[pair, 1]] = directions[pair], -directions[pair]
        kept = rows[held[closed[mine]]].reshape(-1, 2 * len(nodes))
        if np.linalg.matrix_rank(kept) < len(kept):
            found += closed[mine].tolist()
    if not found:
        return ()
    names = listed(sorted({model.cracks[k].name for k in pairs.crack[found]}))
    return (
        f"forces of the {len(found)} single pairs where faces of {names} bend or meet and hold are one set "
        "of several, that of the least friction: what they are together, and all else, is determined",
    )


def _warn_of_closing(found: Static) -> None:
    """Warn where faces that rub have come together in one step: what they slid while they were apart does not
    resist.
    """
    gaps, friction = found.model.contact, found.model.contact.friction
    if friction is None:
        return
    rows = friction.rows[friction.static > 0.0]
    closed = int((found.equilibrium.active[rows] & (gaps.initial[rows] > 0.0)).sum())
    if closed:
        warn(
            f"static: {closed} of {len(rows)} contact rows that rub stood apart and close in this one step, "
            "as if their faces had met before they slid; friction depends on the way there: take "
            "load_history with so many states that its results no longer change",
            StepWarning,
        )


def _solved(model: Model, load, contact: bool, former: Static | None = None) -> Static:
    """Of the model as it is."""
    columns = model.load_columns([load])
    found = model.equilibrium(columns, contact, None if former is None else former.equilibrium.memory)
    _judge(found.residual)
    model.statics.refinement.judge("static")
    model.statics.judge("static", found.owned)
    model.solver.judge("static")
    points, field = model.layout.at_points(found.owned), model.nodal(found.owned, columns)
    if columns.lift is not None:
        points = {name: u + lift[:, 0] for (name, u), lift in zip(points.items(), columns.lift.points)}
    pressed = contact_nodal_forces(model.contact, model.tips, found.force)
    return Static(
        points,
        found.force[: model.contact.pairs],
        found.gap[: model.contact.pairs],
        found.active[: model.contact.pairs],
        float(found.force[: len(model.contact.laws)].sum()),
        field,
        found.iterations,
        model.solver.name,
        found.residual,
        found.intensities,
        energy_release_rates(model.tips, found.intensities),
        t_stresses(model.tips, Field.of_forces(model.tips, field, found.force, columns)),
        model.support_forces(field, columns.nodal[..., 0] + pressed),
        as_loads(load),
        model,
        columns,
        found,
        notes=notes(model.tips, found.force, columns.tip_forces) + _shared_forces(model, found.memory),
        tip_facts=model.tips.intensities.facts,
        pair_cracks=tuple(model.cracks[k].name for k in model.pairs.crack),
        loads=tuple(map(repr, as_loads(load).parts)),
        **_rubbed(model, found),
    )


def _rubbed(model: Model, found: Equilibrium) -> dict[str, Any]:
    """What faces that rub have beside the others."""
    if found.memory is None:
        return {}
    pairs, memory = model.contact.pairs, found.memory
    return dict(
        slip=memory.slip[:pairs],
        friction_force=memory.force[:pairs],
        slid=np.abs(memory.slip - memory.kept)[:pairs],
        friction_loss=found.friction_loss,
    )


def _warn_of_springs(found: Static) -> None:
    """Warn where a body gives way as a whole so much more than its faces do that the compliance of contact
    has few digits of theirs.
    """
    compliance = found.model.contact.kept_compliance  # none where larger problems are solved without it
    touching = np.flatnonzero(found.active)
    one, row, other = touching[:-2], touching[1:-1], touching[2:]
    pairs = found.model.pairs
    within = pairs.crack[one] == pairs.crack[other]
    one, row, other = one[within], row[within], other[within]
    if compliance is None or not len(row):
        return
    # what a row's gap gives way beside the line through its neighbours', on which faces are that turn
    places, gaps = pairs.arc, compliance.gaps
    share = (places[other] - places[row]) / (places[other] - places[one])
    rest, own = 1.0 - share, gaps.diagonal()
    between = np.median(
        own[row]
        + share**2 * own[one]
        + rest**2 * own[other]
        - 2.0 * (share * gaps[one, row] + rest * gaps[row, other] - share * rest * gaps[one, other])
    )
    lost = DIGITS * float(own[touching].max() / max(between, 1e-300))
    if lost > LOST:
        warn(
            f"static: a body that springs hardly hold gives way {own[touching].max() / between:.1g} times "
            f"more than its faces do, and contact pressures may be off by {min(lost, 1.0):.0e} of "
            "themselves; make the springs that hold it stiffer",
            RoundOffWarning,
        )


def _judge(relative: float) -> None:
    """Warn or refuse where round-off in K, of a slender or softly held structure, reaches the loads."""
    if not math.isfinite(relative):
        raise failed_solve(
            "static: the displacements leave the range of numbers; are the loads of usual size, in N and Pa?"
        )
    if relative > REFUSED:
        left = "the options -static_... leave that (leave them out), or " if chosen("static_") else ""
        raise failed_solve(
            f"static: the forces are in balance to {relative:.2g} of the load only: {left}the stiffness is "
            "too badly conditioned, as where supports hardly hold the structure; stiffen them"
        )
    if relative > ROUND_OFF:
        warn(
            f"static: the forces are in balance to {relative:.2g} of the load; displacements of a structure "
            "as slender or as softly held as this one may be wrong by ten times as much",
            RoundOffWarning,
        )
