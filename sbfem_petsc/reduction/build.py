"""Reduced models of structures."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import sparse

from meshing.warnings import BandWarning

from ..bodies.finite_element_model import FiniteElementModel
from ..bodies.rows import Contact, Row, of_body
from ..checks import flag, instance, optional_integer, positive, real, shown
from ..damping import DampingTable, ModalDamping, checked_damping, checked_rayleigh
from ..errors import warn
from ..loads import Load, SupportMotion, separate
from ..petsc import MPI, summed
from ..ranks.parallel import agreed, checked_communicator, collective
from ..system.fields.tips import warn_of_tips
from ..system.idle_loads import warn_of_idle_loads
from ..system.model import Model, count_below, has_modes
from ..system.solve.modal_result import Modal
from ..system.solve.pencil import top_of_band
from ..system.solve.static_solver import block_width
from .left_out import BEHIND, OF_BOTH, OF_MODES, Space, left_out, loads_in_modes, unit_accelerations
from .matrices import reduce_matrices
from .outputs import LinearOutput
from .reduced_model import Lag, ReducedModel, wider_count
from .supports import Supports

# Modes by default: all up to this multiple of the highest load frequency, and at least so many.
BAND, LEAST_MODES = 8.0, 80
# The same for an accuracy of 1e-3 of the lowest harmonics, and one mode more, and where vectors stand behind
# them; of loads of no known band the default is the least. The error falls as the square of the band, with
# vectors faster: 15 motions of beams, plates, bimaterials.
ACCURATE_BAND, BAND_BESIDE, ACCURATE_LEAST, ACCURATE = 16.0, 12.0, 12, 1e-3
# Most modes that it begins with, unless the usual ones are more, and that it grows to; the same by default
# of what computes many motions or cycles: twice as many take eight times as long.
MOST_MODES, MOST_OF_MANY = 320, 2 * LEAST_MODES


@agreed()
def reduce(
    model: Model | FiniteElementModel,
    load=None,
    *,
    modes: int | None = None,
    band: float | None = None,
    contact: Contact | None = None,
    loads: Mapping[str, Row | SupportMotion] | None = None,
    points: Mapping[str, Row] | None = None,
    damping: float | Sequence[float] | np.ndarray | DampingTable | None = None,
    rayleigh: tuple[float, float] | None = None,
    comm: MPI.Comm | None = None,
    shapes: bool = True,
) -> ReducedModel:
    """Reduce a model to its lowest modes and the residual flexibility of its contact, loads and named points.

    The result stands in the place of the model in every dynamic analysis with loads at the same places.
    Analyses called with the model itself make it on their own, once, and find it again.

    Parameters
    ----------
    model : Model or FiniteElementModel
        Held against every rigid-body motion.
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        Only the places and components that are not zero matter, not the amplitudes.
    modes : int, optional
        Number of modes.
    band : float, optional
        All modes up to this frequency, Hz. Default of both: 80 modes. Give one of them at most. Of a Model.
    contact : Contact, optional
        Of a body, as of `FiniteElementModel.contact`.
    loads, points : dict of str to Row
        Of a body: unit loads in the order of a later load's numbers, and what is seen, a number each. A load
        may be a `SupportMotion` of numbers: displacements are relative to the base, the load's number is a
        factor on its accelerations.
    damping : float, sequence of float or DampingTable, optional
        Modal damping of a body, as of `reduce_matrices`, default 0; a Model has its own.
    rayleigh : (float, float), optional
        a (1/s) and b (s) of a damping matrix a M + b K of a body beside it, default none.
    comm : mpi4py communicator, optional
        Ranks that reduce a body, read alike on each of them, together; default: all. A Model has its own.
    shapes : bool
        Keep what all unknowns of a body do, for fields, files and pictures of the whole: 8 bytes for each
        unknown and mode, load and contact row.

    Returns
    -------
    ReducedModel

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense; on all ranks.
    """
    if isinstance(model, FiniteElementModel):
        if load is not None or band is not None:
            raise ValueError("reduce: a body takes loads and modes, not load and band")
        damped = (
            checked_damping("reduce", 0.0 if damping is None else damping),
            checked_rayleigh("reduce", (0.0, 0.0) if rayleigh is None else rayleigh),
        )
        ranks = checked_communicator("reduce", comm)
        found = _reduced_body(model, contact, (loads, points), modes, damped, ranks)
        if flag("reduce", "shapes", shapes):
            return replace(found, body=model, contact=contact)
        return replace(found, whole=None)
    if not isinstance(model, Model):
        raise TypeError(
            f"reduce: model = {shown(model)} is not a Model or FiniteElementModel; for matrices use "
            "reduce_matrices"
        )
    with collective(model.comm):
        if any(given is not None for given in (contact, loads, points, damping, rayleigh, comm)):
            raise ValueError(
                "reduce: contact, loads, points, damping, rayleigh and comm are of a FiniteElementModel; a "
                "Model has its own"
            )
    most = model.boundary_unknowns // 2
    with collective(model.comm):
        model.checked_loads(load, constant=False)
        if modes is not None and band is not None:
            raise ValueError(
                f"reduce: give modes or band, not both (modes = {shown(modes)}, band = {shown(band)})"
            )
        modes = optional_integer("reduce", "modes", modes, least=1, most=most)
        if band is not None:
            band = positive("reduce", "band", band, "Hz")
    model.require_support("the reduction")
    if modes is None:
        modes = modes_up_to(model, band, 1) if band is not None else default_modes(model, 0.0)
    return reduced(model, tuple(separate(load)[0]), modes)


def _reduced_body(
    body: FiniteElementModel,
    contact: Contact | None,
    named: tuple[Mapping[str, Row | SupportMotion] | None, Mapping[str, Row] | None],
    modes: int | None,
    damped: tuple[ModalDamping, tuple[float, float]],
    comm: MPI.Comm,
) -> ReducedModel:
    """A body of another code, by its matrices."""
    n = len(body.unknowns)
    none = sparse.csr_matrix((0, n))
    pairs = Contact(none, np.zeros(0), (), none)
    if contact is not None:
        _of_body(
            "contact", instance("reduce", "contact", contact, Contact, "a Contact, of body.contact"), body
        )
        pairs = contact
    for name, given in zip(("loads", "points"), named, strict=True):
        if not isinstance(given, Mapping) or not given:
            raise TypeError(
                f"reduce: {name} = {shown(given)} must be a dict of names to rows, {{'tip': body.at(...)}}"
            )
        for key, row in given.items():
            if not isinstance(key, str):
                raise TypeError(f"reduce: {name} has the name {shown(key)}; names are strings")
            item = f"{name}[{key!r}]"
            if name == "loads" and isinstance(row, SupportMotion):
                values = [real("reduce", f"{item}.{d}", a, "m/s^2") for d, a in row.components.items()]
                if not any(values):
                    raise ValueError(f"reduce: {item} = {row!r} moves nothing; give an acceleration, say 1.0")
                continue
            known: Row = instance("reduce", item, row, Row, "a Row, of body.at")
            _of_body(item, known, body)
            if not known.weights.count_nonzero():
                raise ValueError(f"reduce: {item} = {row!r} is zero whatever moves; is it a row less itself?")
    loads, points = named
    assert loads is not None and points is not None
    return inspect.unwrap(reduce_matrices)(  # ranks have agreed on the body
        body.mass,
        body.stiffness,
        pairs.rows,
        pairs.gap,
        loads=sparse.hstack([_column(body, load) for load in loads.values()]),
        sensors=points,
        modes=modes,
        damping=damped[0],
        rayleigh=damped[1],
        contact_laws=pairs.laws,
        tangent_rows=pairs.slips if any(law.rubs for law in pairs.laws) else None,
        comm=comm,
    )


def _column(body: FiniteElementModel, load: Row | SupportMotion) -> sparse.spmatrix:
    """(n, 1): forces of a unit load."""
    if isinstance(load, Row):
        return load.weights.T
    return sparse.csr_matrix(-body.inertia @ np.array([[load.ax], [load.ay], [load.az]], dtype=float))


def _of_body(name: str, given: Row | Contact, body: FiniteElementModel) -> None:
    if not of_body(given, count := len(body.unknowns), body.number):
        raise ValueError(
            f"reduce: {name} is of another body, of {given.size} unknowns for {count}, or of other nodes; "
            "use one body"
        )


def default_modes(model: Model, highest: float) -> int:
    """Number of modes up to `BAND` times the highest load frequency (Hz), at least `LEAST_MODES`."""
    return modes_up_to(model, BAND * highest, LEAST_MODES)


def most_modes(model: Model) -> int:
    """Number of modes that the mesh is good for."""
    return max(model.boundary_unknowns // 4, 1)


def modes_for(
    model: Model, highest: float, accuracy: float, most: int = MOST_MODES, vectors: bool = False
) -> int:
    """Number of modes that an accuracy of harmonics asks for, by the highest load frequency (Hz), to begin
    with, with vectors behind them or without; so many at most, or those up to `BAND` times that frequency.
    """
    band = BAND_BESIDE if vectors else ACCURATE_BAND
    band *= math.sqrt(ACCURATE / accuracy) * highest
    modes = modes_beyond(model, band, ACCURATE_LEAST if highest > 0.0 else LEAST_MODES)
    return modes if modes <= most else modes_beyond(model, BAND * highest, most)


def modes_beyond(model: Model, frequency: float, least: int) -> int:
    """Number of modes up to a frequency (Hz) and one more, at least so many, if the mesh is good for them."""
    return min(max(least, 1 + _below(model, frequency, least)), most_modes(model))


def _below(model: Model, frequency: float, count: int) -> int:
    """Number of modes below a frequency (Hz), of those that the mesh is good for: counted by inertia where
    those that are known, or so many, do not pass it, and computed otherwise, or in growing numbers where the
    direct solver counts none; all where they end below it.
    """
    elements, omega, most = model.statics.elements, 2.0 * math.pi * frequency, most_modes(model)
    if omega > top_of_band(elements, most):
        return most
    count = min(count, most)
    # of slender structures the law is too high by about this share: to count costs a fifth of modes in vain
    stout = min(1.0, 4.0 * math.sqrt(elements.layout.area) / elements.layout.perimeter)
    beyond = has_modes(model) or omega > stout * top_of_band(elements, count)
    while True:
        below = count_below(model, frequency) if beyond else None
        if below is not None:
            return min(below, most)
        known = model.modes(count).frequencies
        if count == most or known[-1] >= frequency:
            return int((known < frequency).sum())
        count, beyond = min(math.ceil(1.5 * count), most), True


def modes_up_to(model: Model, frequency: float, least: int) -> int:
    """Number of modes computed so that the highest of them passes a frequency, Hz."""
    most = most_modes(model)
    count = min(max(least, 8), most)
    below = _below(model, frequency, count)
    while count < most and count <= below:
        count = min(math.ceil(1.5 * count), most)
    top = float(model.modes(count).frequencies[-1])
    if count == most and top < frequency:
        warn(
            f"the {count} modes that the mesh is good for end at {top:.6g} Hz, below the {frequency:.6g} Hz "
            f"that were wanted ({BAND:g} times the loads' highest frequency by default); refine the mesh, "
            "or choose modes",
            BandWarning,
        )
    if least < 8:
        count = max(1, int((model.modes(count).frequencies <= frequency).sum()))
    return count


def reduced(model: Model, units: tuple[Load, ...], modes: int, vectors: bool = False) -> ReducedModel:
    """The reduced model for some unit loads and a number of modes, made once; with vectors behind them that
    stand for those that are left out, if there are any. Collective.
    """
    warn_of_idle_loads("reduce", model, units)
    warn_of_tips("reduce", model.tips)
    own = _kept(model, units, modes)
    if not vectors:
        return own
    return model.keep(("behind", units, modes), lambda: _beside(own, BEHIND)) or own


def wider(system: ReducedModel) -> ReducedModel | None:
    """The same structure in further modes, and the same signs of those it has: what is found in it tells what
    modes that are left out do. Of a Model a few vectors stand for all of them, see `left_out`, more of them
    where it has some; of matrices they are those of `in_further_modes`. The system itself where none are left
    out; None where nothing is known of them or there is no room for them. Collective.
    """
    own, model = system.natural, system.model
    if model is None or model.layout.freed or own >= model.boundary_unknowns // 2:
        return in_further_modes(system)
    if not system.vectors:
        return _beside(system, OF_MODES)
    more = _beside(_as(system, _kept(model, system.loads, own)), OF_BOTH)
    return system if more is not None and more.vectors == system.vectors else more


def _beside(own: ReducedModel, space: Space) -> ReducedModel | None:
    """A model with vectors behind its modes; itself where there are none, None where there is no memory for
    them. Collective.
    """
    model = own.model
    assert model is not None  # the caller has looked
    # vectors behind modes are told of by more of them, which hold them
    spaces = (OF_MODES,) if space is OF_MODES else (BEHIND, OF_BOTH)
    try:
        found = model.keep(("left out", own.loads, own.natural, spaces), lambda: left_out(own, spaces))
    except ValueError:
        return None
    return found[space].beside(own) if found else own


def in_further_modes(system: ReducedModel) -> ReducedModel | None:
    """The same structure in half as many modes again, with vectors behind them where it has some, whatever it
    is made of. Collective.
    """
    own, model = system.natural, system.model
    if model is None or model.layout.freed:
        more = None if system.wider is None else system.wider()
    else:
        try:
            count = min(wider_count(own), max(model.boundary_unknowns // 2, own))
            more = reduced(model, system.loads, count, vectors=system.vectors > 0)
        except ValueError:  # for which there is no memory
            return None
    if more is None or more.natural == own:
        return None if more is None else system
    return _as(system, more)


def _as(system: ReducedModel, other: ReducedModel) -> ReducedModel:
    """The same structure in other modes with a system's gaps and damping, which may be others than those that
    it was reduced with; further modes follow the last one.
    """
    known = min(system.natural, other.natural)
    mine, top, further = system.damping[known - 1], other.damping[known - 1], other.damping[known:]
    further = further * (mine / top) if top else np.full(len(further), mine)
    damping = np.append(system.damping[:known], further)
    return replace(other, initial_gap=system.initial_gap, damping=damping, contact_laws=system.contact_laws)


def _kept(model: Model, units: tuple[Load, ...], modes: int) -> ReducedModel:
    return model.keep(("reduced", units, modes), lambda: _reduce(model, units, model.modes(modes)))


def _reduce(model: Model, units: tuple[Load, ...], found: Modal) -> ReducedModel:
    model.require_support("the reduction")
    gap, tips, layout, compliance = model.contact, model.tips.intensities, model.layout, model.compliance
    translation = found.auxiliary_inertia - summed(model.comm, found.shapes.T @ unit_accelerations(model))
    columns = model.load_columns(units)
    forces = columns.forces
    width = block_width(layout)
    solved = np.concatenate(
        [model.solver.columns(forces[:, k : k + width], "reduction") for k in range(0, len(units), width)]
        or [forces],
        axis=1,
    )
    supports = Supports.of(model, units, found, columns, solved)

    omega2 = (2.0 * np.pi * found.frequencies) ** 2
    load_modes = loads_in_modes(model, units, found.shapes.T @ forces, translation)
    # the auxiliary unknowns have a share in these, too
    load_modes[:, supports.edges] = omega2[:, None] * supports.of_edges("inertia").T
    gap_modes = gap.rows(found.shapes)
    still = load_modes / omega2[:, None], gap_modes.T / omega2[:, None]

    def output(names, rows, contact: np.ndarray, direct=0.0) -> LinearOutput:
        """Of the modes and the residual flexibility, from responses at rest."""
        modes = gap_modes if rows is gap.rows else rows(found.shapes)
        loads, shape = rows(solved) + direct, contact.shape[:-1]
        static = LinearOutput(names, np.zeros((*shape, 0)), loads.reshape(*shape, len(units)), contact)
        return static.with_modes(modes.reshape(*shape, len(omega2)), *still)

    gaps = output((), gap.rows, compliance.gaps, columns.gaps)
    gaps = replace(gaps, contact=0.5 * (gaps.contact + gaps.contact.T))
    points = 0.0 if columns.lift is None else columns.lift.points.reshape(-1, len(units))
    work = summed(model.comm, forces.T @ solved) + columns.flexibility - load_modes.T @ still[0]
    work[np.ix_(supports.edges, supports.edges)] = 0.0  # these are no forces
    damping = model.damping_ratios(2.0 * np.pi * found.frequencies)
    return ReducedModel(
        found.frequencies,
        damping,
        gaps,
        gap.initial.copy(),
        gap.pairs,
        load_modes,
        0.5 * (work + work.T),
        output(tuple(model.points), layout.point_rows, compliance.points, points),
        output(tips.names, tips.rows, compliance.tips, columns.tips),
        translation,
        units,
        model,
        found,
        gap.laws,
        tips.facts,
        gap.friction,
        supports=supports,
        lag=Lag.of(model.rayleigh[1], math.sqrt(omega2[-1]), damping[-1], gap.flexibility.diagonal()),
    )
