"""Reduced models of systems given by their matrices."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import linalg, sparse

from meshing.warnings import BandWarning, RoundOffWarning

from ..bodies.rows import Row
from ..checks import integer, real_array, require_symmetric, shown
from ..contact.friction import Friction
from ..contact.law import ContactLaw, Coulomb, RowLaws, row_laws
from ..damping import (
    DampingTable,
    ModalDamping,
    checked_damping,
    checked_rayleigh,
    modal_ratios,
    rayleigh_ratios,
)
from ..errors import SolveError, warn
from ..petsc import MPI
from ..ranks.parallel import agreed, checked_communicator
from .outputs import LinearOutput
from .reduced_model import Lag, ReducedModel, wider_count
from .sparse import APART, parts_of_energy, sparse_modes

# Relative asymmetry of a matrix that rounding explains.
SYMMETRY = 1e-9
# Share of a frequency by which rounding of the stiffness may move it before it is told.
UNCERTAIN = 1e-4
# Of the highest eigenvalue, and of the parts of a mode's energy, what may be rounding in dense matrices.
LOST = 1e-12


@agreed()
def reduce_matrices(
    mass: np.ndarray | sparse.spmatrix,
    stiffness: np.ndarray | sparse.spmatrix,
    contact_rows: np.ndarray | sparse.spmatrix,
    gap: np.ndarray,
    *,
    loads: np.ndarray | sparse.spmatrix,
    sensors: Mapping[str, int | np.ndarray | sparse.spmatrix | Row],
    modes: int | None = None,
    damping: float | Sequence[float] | np.ndarray | DampingTable = 0.0,
    rayleigh: tuple[float, float] = (0.0, 0.0),
    compliance: np.ndarray | None = None,
    contact_laws: ContactLaw | Sequence[ContactLaw] | None = None,
    tangent_rows: np.ndarray | sparse.spmatrix | None = None,
    tangent_compliance: np.ndarray | None = None,
    comm: MPI.Comm | None = MPI.COMM_SELF,
) -> ReducedModel:
    """A system given by its matrices: textbook oscillators, bars, other codes' examples.

    All analyses take the result in the place of a model, with a number or a signal for each unit load; what
    rows that rub are refused in, docs/limits.md says.

    Parameters
    ----------
    mass, stiffness : (n, n) arrays or sparse matrices of SciPy
        Symmetric; mass positive definite; the stiffness may admit rigid-body motions, and what holds one by
        less than 1e-13 of the largest entries may pass for rounding: 0 Hz. Sparse ones are for large systems,
        by SLEPc and PETSc: the stiffness positive definite, unknowns without mass allowed.
    contact_rows : (pairs, n) array or sparse matrix
        Gap = contact_rows u + gap + compliance force.
    gap : (pairs,) array
        m.
    loads : (n, k) array or sparse matrix
        Unit loads.
    sensors : dict of str to int or (n,) row, or of str to Row
        Names of unknowns, or of rows that give means, differences and components along any direction; each
        is the y displacement of a point. Rows of a body (`Row`) are one number each, along their own.
    modes : int, optional
        Lowest modes kept; the others act by their flexibility. Default: all, of sparse matrices 80, or half
        as many as unknowns.
    damping : float, sequence of float, DampingTable or (n, n) array
        Modal damping ratio: of all modes, of each of the lowest modes that vibrate, the last one holding for
        all further modes, or by frequency; or a damping matrix that the modes make diagonal.
    rayleigh : (float, float)
        a (1/s) and b (s) of a damping matrix a M + b K beside it; see `rayleigh_factors`.
    compliance : (pairs,) array, optional
        Of elastic stops and joints, m/N of each row.
    contact_laws : ContactLaw or sequence of ContactLaw, optional
        One for all contact rows, or one for each, without a layer of their own. Default: `Unilateral`.
    tangent_rows : (pairs, n) array or sparse matrix, optional
        Slip = tangent_rows u + tangent_compliance friction; needed of rows that rub (`Coulomb`), refused
        where none is of this law.
    tangent_compliance : (pairs,) array, optional
        Of what gives way along the faces before they slip, m/N of each row.
    comm : mpi4py communicator, optional
        Ranks that work on sparse matrices, the same on each of them, together; None: all. Default: each rank
        for itself.

    Raises
    ------
    ValueError, TypeError
        If shapes do not fit, if values are not finite, if a damping matrix couples the modes, or if a contact
        row has no compliance at all: a rigid stop on an unknown whose mass is kept in full has no law in this
        form.
    """
    comm = checked_communicator("reduce_matrices", comm)
    mass = _matrix("mass", mass)
    n, gap = mass.shape[0], _array("gap", gap, 1)
    _require_shape("mass", mass, n, n)
    stiffness, pairs = _matrix("stiffness", stiffness, n, n), len(gap)
    large = sparse.issparse(mass) or sparse.issparse(stiffness)
    if large:
        mass, stiffness = sparse.csr_matrix(mass), sparse.csr_matrix(stiffness)
    contact_rows, loads = _rows("contact_rows", contact_rows, pairs, n), _rows("loads", loads, n)
    stops = _layer("compliance", compliance, pairs)
    _check_system(mass, stiffness, contact_rows)
    laws = row_laws(contact_laws, pairs, "reduce_matrices")
    slips, slack, friction = _sliding(laws, tangent_rows, tangent_compliance, n)
    contact_rows, stops = sparse.vstack([contact_rows, slips]).tocsr(), np.append(stops, slack)
    heavy = np.count_nonzero(mass.diagonal())
    default, most = (max(min(80, n // 2, heavy), 1), max(n - 1, 1)) if large else (n, n)
    modes = default if modes is None else integer("reduce_matrices", "modes", modes, least=1, most=most)
    seen = _sensor_rows(sensors, n)
    along = tuple(row.direction for row in sensors.values() if isinstance(row, Row))
    given, factors = _damping(damping, n), checked_rayleigh("reduce_matrices", rayleigh)

    pushed = loads.T.tocsr()
    columns = sparse.vstack([contact_rows, pushed]).T.tocsr()
    rigid = bool((stops <= 0.0).any())
    lowest = _modes(mass, stiffness, columns, comm)
    found = lowest(modes)
    omega = np.sqrt(found[0])
    vibrates = found[0].any() or modes == most
    # rigid-body motions are told from soft ones beside what vibrates
    _warn_of_rounding(mass, stiffness, found if vibrates else lowest(modes + 1))
    _warn_of_superelement(mass, stiffness, omega)
    if factors[0] > 0.0 and not omega.all():
        raise ValueError(
            f"reduce_matrices: rayleigh = {rayleigh} damps a rigid-body motion, which has no damping ratio; "
            "hold the system by a weak spring, or give a = 0"
        )

    def at_sensors(array: np.ndarray) -> np.ndarray:
        result = np.zeros((len(sensors), 1 if along else 2, array.shape[1]))
        result[:, -1] = array
        return result

    def made(
        found: tuple[np.ndarray, np.ndarray, np.ndarray],
        wider: Callable[[], ReducedModel | None] | None = None,
    ) -> ReducedModel:
        values, shapes, flexibility = found
        omega, kept = np.sqrt(values), len(values)
        ratios = _ratios(given, shapes, omega, modes) + rayleigh_ratios(factors, omega)
        by_contact, by_loads = np.split(flexibility, [len(stops)], axis=1)
        fields = shapes, by_loads, by_contact
        gap_modes, gap_loads, own = _seen(contact_rows, *fields)
        gaps = LinearOutput((), gap_modes, gap_loads, own + np.diag(stops))
        load_modes, loaded = _seen(pushed, shapes, by_loads)
        return ReducedModel(
            omega / (2.0 * np.pi),
            ratios,
            gaps,
            np.append(RowLaws.of(laws).rest(gap), np.zeros(len(stops) - pairs)),
            pairs,
            load_modes.T,
            loaded,
            LinearOutput(tuple(sensors), *map(at_sensors, _seen(seen, *fields))),
            LinearOutput((), *(np.zeros((0, 2, k)) for k in (kept, loads.shape[1], len(stops)))),
            np.zeros((kept, 2)),
            contact_laws=RowLaws.of(laws),
            friction=friction,
            directions=along or None,
            ranks=comm if large else None,
            whole=LinearOutput((), *fields),
            wider=wider,
            lag=Lag.of(factors[1], omega[-1], ratios[-1], stops),
        )

    # a rigid stop gives way by modes that are left out alone
    last = min(most - int(rigid and not large), heavy)
    count = min(wider_count(modes), last)

    @functools.cache
    def wider() -> ReducedModel | None:
        if count <= modes < n + rigid:
            return None
        with contextlib.suppress(SolveError):
            wide = made(lowest(count))
            return None if _stiff(wide.gap, contact_rows).size else replace(wide, whole=None)
        return None

    result = made(found, wider)
    _require_compliance(result.gap, contact_rows, pairs)
    return result


def _stiff(gaps: LinearOutput, contact_rows: sparse.csr_matrix) -> np.ndarray:
    """Rows whose gap or slip nothing but kept modes moves."""
    return np.flatnonzero((np.diag(gaps.contact) <= 0.0) & (contact_rows.getnnz(axis=1) > 0))


def _require_compliance(gaps: LinearOutput, contact_rows: sparse.csr_matrix, pairs: int) -> None:
    """Refuse them."""
    weak = _stiff(gaps, contact_rows)
    if len(weak):
        what, mend = ("slip", "tangent_compliance") if weak[0] >= pairs else ("stop", "compliance")
        raise ValueError(
            f"reduce_matrices: contact row {weak[0] % pairs}: a rigid {what} on an unknown with mass has no "
            f"compliance; keep fewer modes than unknowns or give it one ({mend})"
        )


def _warn_of_superelement(mass: Any, stiffness: Any, omega: np.ndarray) -> None:
    """Warn of modes above the highest one that a Craig-Bampton superelement has inside."""
    # modal coordinates: coupled by their mass alone
    inside = ~_coupled(stiffness) & _coupled(mass)
    if not inside.any() or inside.all():
        return
    highest = float(np.sqrt((stiffness.diagonal()[inside] / mass.diagonal()[inside]).max()))
    if beyond := int((omega > highest).sum()):
        warn(
            f"reduce_matrices: {beyond} of {len(omega)} modes lie above {highest / (2.0 * np.pi):.6g} Hz, "
            "where the modes inside this superelement (Craig-Bampton) end: they are none of the structure, "
            f"and shorten the steps; keep modes = {len(omega) - beyond}",
            BandWarning,
        )


def _warn_of_rounding(mass: Any, stiffness: Any, found: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """Warn of a mode whose frequency rounding of a stiffness moves, whose entries lie far apart, or that is
    taken for a rigid-body motion where they hold it.
    """
    values, shapes, _ = found
    if not values.any():
        return
    with np.errstate(divide="ignore"):
        most = UNCERTAIN * values / float((stiffness.diagonal() / mass.diagonal()).max())
    low = np.flatnonzero(most < 10.0 * np.finfo(float).eps)
    if not len(low):
        return
    values, shapes = np.where(values > 0.0, values, values[values > 0.0].min())[low], shapes[:, low]
    moved = np.finfo(float).eps * parts_of_energy(stiffness, shapes)
    energies = (shapes * (stiffness @ shapes)).sum(axis=0)
    rigid = (found[0][low] == 0.0) & (energies > np.maximum(2.0 * moved, APART * values))
    for k in np.flatnonzero(rigid | (moved > 2.0 * UNCERTAIN * values))[:1]:
        told, most = np.sqrt([found[0][low[k]], energies[k] + moved[k]]) / (2.0 * np.pi)
        warn(
            "reduce_matrices: entries of stiffness lie so far apart that rounding of the largest leaves mode "
            f"{low[k] + 1}, told at {told:.4g} Hz, at up to {most:.4g} Hz; make softer what is next to rigid",
            RoundOffWarning,
        )


def _coupled(matrix: np.ndarray | sparse.csr_matrix) -> np.ndarray:
    """Which unknowns have an entry beside the diagonal."""
    size = abs(matrix)
    return np.asarray(size @ np.ones(matrix.shape[0]) > size.diagonal())


def _seen(rows: sparse.csr_matrix, *fields: np.ndarray) -> list[np.ndarray]:
    """rows @ each of the fields, of which few unknowns are copied."""
    used = np.unique(rows.indices)
    few = rows[:, used]
    return [few @ field[used] for field in fields]


def _sliding(
    laws: Sequence[ContactLaw], rows: Any, compliance: Any, count: int
) -> tuple[sparse.csr_matrix, np.ndarray, Friction | None]:
    """Tangential rows and their compliance, one for each law where any rubs, and their friction."""
    pairs = len(laws)
    slips = sparse.csr_matrix((pairs, count)) if rows is None else _rows("tangent_rows", rows, pairs, count)
    slack = _layer("tangent_compliance", compliance, pairs)
    if rows is not None and not any(isinstance(law, Coulomb) for law in laws):
        raise ValueError(
            "reduce_matrices: tangent_rows say how faces slip, and none of contact_laws rubs; give "
            "contact_laws = sb.Coulomb(...), or leave tangent_rows out"
        )
    rubs = np.array([law.rubs for law in laws], dtype=bool)
    if (idle := np.flatnonzero(rubs & (slips.getnnz(axis=1) == 0))).size:
        raise ValueError(
            f"reduce_matrices: contact_laws[{idle[0]}] = {laws[idle[0]]!r} rubs; give tangent_rows, whose "
            f"row {idle[0]} says which displacements move its slip"
        )
    if not rubs.any():
        return slips[:0], slack[:0], None
    return (
        sparse.diags(rubs.astype(float)) @ slips,
        np.where(rubs, slack, 0.0),
        Friction.of(laws, np.arange(pairs)),
    )


def _modes(
    mass: Any, stiffness: Any, columns: sparse.csr_matrix, comm: MPI.Comm
) -> Callable[[int], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """What finds so many of the lowest modes, and the flexibility of the others, see `sparse_modes`."""
    if sparse.issparse(mass):
        return functools.partial(sparse_modes, mass, stiffness, columns, comm=comm)
    return functools.partial(_lowest, _dense_modes(mass, stiffness), columns)


def _lowest(
    system: tuple[np.ndarray, np.ndarray], columns: sparse.csr_matrix, modes: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lowest of all modes and the flexibility of the others under the columns, see `sparse_modes`."""
    values, vectors = system
    if not values[modes:].all():
        raise ValueError(f"reduce_matrices: modes = {modes} leaves out rigid-body motions; keep more modes")
    left = vectors[:, modes:]
    return values[:modes], vectors[:, :modes], (left / values[modes:]) @ (left.T @ columns.toarray())


def _dense_modes(mass: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All eigenvalues, rising, and mass-normalised vectors."""
    if linalg.eigvalsh(mass)[0] <= 0.0:
        raise ValueError(
            "reduce_matrices: mass is not positive definite; give each unknown a mass or condense it"
        )
    values, vectors = linalg.eigh(stiffness, mass)
    # rigid-body modes come out at round-off's level, and so do low ones of what is held beside very high ones
    again = np.abs(values) < LOST * np.abs(values).max()
    if again.any():
        if held := _held(stiffness):
            inverse, vectors = linalg.eigh(mass, stiffness)
            values = 1.0 / inverse[::-1]
            vectors = vectors[:, ::-1] * np.sqrt(values)
            again = values > np.sqrt(values[0] * values[-1])  # which the lowest ones leave few digits
        some = vectors[:, again]
        values[again], turned = linalg.eigh(some.T @ (stiffness @ some), some.T @ (mass @ some))
        vectors[:, again] = some @ turned
        if not held:
            # rounding of what the matrix is made of has left as much above 0 as below
            least = np.maximum(LOST * parts_of_energy(stiffness, vectors), -values[again].min())
            values[again & (np.abs(values) <= least)] = 0.0
            order = np.argsort(values, kind="stable")
            values, vectors = values[order], vectors[:, order]
    if values[0] < 0.0:
        raise ValueError(
            f"reduce_matrices: stiffness is indefinite (least eigenvalue {values[0]:g} of M^-1 K)"
        )
    return values, vectors


def _held(stiffness: np.ndarray) -> bool:
    """Whether no rigid-body motion is left: no pivot is lost in round-off."""
    try:
        pivots = np.diag(linalg.cholesky(stiffness)) ** 2
    except linalg.LinAlgError:
        return False
    return bool((pivots > len(stiffness) * 1e-14 * np.diag(stiffness)).all())


def _array(name: str, value: Any, dimensions: int) -> np.ndarray:
    """A finite real array of so many dimensions."""
    return real_array("reduce_matrices", name, value, dimensions)


def _layer(name: str, value: Any, pairs: int) -> np.ndarray:
    """Compliances of so many rows, none by default."""
    layer = np.zeros(pairs) if value is None else real_array("reduce_matrices", name, value, (pairs,))
    if (layer < 0.0).any():
        raise ValueError(f"reduce_matrices: {name} {layer.min():g} m/N is negative")
    return layer


def _require_shape(name: str, matrix: Any, *shape: int) -> None:
    """ValueError unless it has so many rows, and columns if they are told."""
    expected = shape + matrix.shape[len(shape) :]
    if matrix.shape != expected:
        raise ValueError(f"reduce_matrices: {name} has shape {matrix.shape}, {expected} was expected")


def _matrix(name: str, value: Any, *shape: int) -> np.ndarray | sparse.csr_matrix:
    """A finite real matrix, sparse if it was."""
    if sparse.issparse(value):
        entries = value if value.format == "csr" and value.has_canonical_format else sparse.coo_matrix(value)
        real_array("reduce_matrices", f"{name}.data", entries.data, 1)
        value = sparse.csr_matrix(entries, dtype=float)
    else:
        value = _array(name, value, 2)
    _require_shape(name, value, *shape)
    return value


def _rows(name: str, value: Any, *shape: int) -> sparse.csr_matrix:
    """A finite real matrix, sparse."""
    rows = sparse.csr_matrix(_matrix(name, value, *shape), copy=True)
    rows.eliminate_zeros()
    return rows


def _check_system(mass: Any, stiffness: Any, contact_rows: sparse.csr_matrix) -> None:
    """Refuse what makes no system."""
    if mass.shape[0] == 0:
        raise ValueError("reduce_matrices: mass is empty; give at least one unknown")
    require_symmetric("reduce_matrices", "mass", mass, SYMMETRY)
    require_symmetric("reduce_matrices", "stiffness", stiffness, SYMMETRY)
    if (idle := np.flatnonzero(contact_rows.getnnz(axis=1) == 0)).size:
        raise ValueError(f"reduce_matrices: contact_rows[{idle[0]}] is zero; no displacement moves its gap")


def _sensor_rows(sensors: Any, count: int) -> sparse.csr_matrix:
    """(sensors, count): the rows of the sensors."""
    if not isinstance(sensors, Mapping):
        raise TypeError(
            f"reduce_matrices: sensors = {shown(sensors)} must be a dict of names to unknowns, {{'tip': 3}}"
        )
    if len({isinstance(place, Row) for place in sensors.values()}) > 1:
        raise TypeError("reduce_matrices: some sensors are Rows of a body and some are none; give one kind")
    rows = sparse.lil_matrix((len(sensors), count))
    for k, (name, place) in enumerate(sensors.items()):
        place = place.weights if isinstance(place, Row) else place
        if not isinstance(name, str):
            raise TypeError(f"reduce_matrices: sensors has the name {name!r}; names are strings")
        item = f"sensors[{name!r}]"
        if sparse.issparse(place) or isinstance(place, (list, tuple)) or getattr(place, "ndim", 0):
            row = _rows(item, place).toarray().ravel() if sparse.issparse(place) else _array(item, place, 1)
            if len(row) != count:
                raise ValueError(f"reduce_matrices: {item} has {len(row)} entries, {count} were expected")
            rows[k] = row
        else:
            rows[k, integer("reduce_matrices", item, place, least=0, most=count - 1)] = 1.0
    return rows.tocsr()


def _damping(value: Any, count: int) -> ModalDamping | np.ndarray:
    """Modal damping or a damping matrix as a user gives it for so many unknowns."""
    sequence = isinstance(value, (list, tuple, np.ndarray))
    rows = value.ndim > 1 if isinstance(value, np.ndarray) else sequence and any(map(np.ndim, value))
    if not rows:
        damping = checked_damping("reduce_matrices", value)
        if isinstance(damping, tuple) and len(damping) > count:
            raise ValueError(
                f"reduce_matrices: damping has {len(damping)} ratios for {count} unknowns; give one a mode "
                "at most"
            )
        return damping
    matrix = _array("damping", value, 2)
    if matrix.shape != (count, count):
        raise ValueError(
            f"reduce_matrices: damping has shape {matrix.shape}, {(count, count)} was expected of a matrix; "
            "ratios by frequency are a DampingTable"
        )
    require_symmetric("reduce_matrices", "damping", matrix, SYMMETRY)
    return matrix


def _ratios(
    damping: ModalDamping | np.ndarray, shapes: np.ndarray, omega: np.ndarray, modes: int
) -> np.ndarray:
    """Modal damping ratios of checked damping, a matrix of which is to be diagonal in so many modes."""
    if not isinstance(damping, np.ndarray):
        return modal_ratios(damping, omega)
    modal = shapes.T @ damping @ shapes
    every, modal = np.diag(modal), modal[:modes, :modes]
    own = every[:modes]
    coupling = np.abs(modal - np.diag(own)).max(initial=0.0)
    if coupling > 1e-9 * np.abs(own).max():
        raise ValueError(
            "reduce_matrices: the damping matrix couples the modes (up to "
            f"{coupling / np.abs(own).max():.2g} of the largest modal damping); give modal damping ratios, "
            "or a matrix such as a M + b K"
        )
    if own.min(initial=0.0) < -1e-9 * np.abs(own).max():
        raise ValueError(
            "reduce_matrices: the damping matrix feeds energy into a mode; its diagonal must not be negative"
        )
    own = np.maximum(every, 0.0)
    rigid = omega == 0.0
    if (np.abs(own[rigid]) > 1e-9 * np.abs(own).max()).any():
        raise ValueError(
            "reduce_matrices: the damping matrix damps a rigid-body motion, which has no damping ratio; hold "
            "the system by a weak spring"
        )
    return np.where(rigid, 0.0, own / (2.0 * np.where(rigid, 1.0, omega)))
