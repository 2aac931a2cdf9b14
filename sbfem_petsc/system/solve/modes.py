"""Natural frequencies and mode shapes of the structure with open cracks, by SLEPc (prefix ``modal_``)."""

from __future__ import annotations

import math

import numpy as np

from ...errors import failed_solve, wrong_input
from ...petsc import (
    MPI,
    PETSc,
    SLEPc,
    configure,
    free,
    scripted,
    solver_name,
    solving,
    stage,
    stepping,
    summed,
)
from ..elements.element_stiffness import NEEDED
from ..elements.elements import Elements
from ..structure import Structure
from .demand import require_modes
from .krylov_step import KrylovStep
from .modal_result import Modal
from .pencil import CondensedSolve, Pencil, is_small, top_of_band
from .stiffness import Stiffness

# Residual ||K x - w2 M x|| / ||w2 M x|| that a returned pair may have at most. Round-off leaves about
# 1e-16 cond(K)^(1/2) in the lowest modes of a slender beam; 1e-5 in a residual is 1e-10 in a frequency.
RESIDUAL_LIMIT = 1e-5
# Share of it that the change of slender modes by an inverse iteration is solved to.
SEEN = 1e-4
# How many times larger residuals of refined modes may be where both are round-off: 1.3 was measured.
WORSE = 3.0
# So many modes take far longer than to count whether they lie in the band that is estimated for them.
COUNTED = 100
# How far a small structure's pencil that counts modes goes: to where vectors behind these modes and one more
# have frequencies.
REACH = 6.0
# What the auxiliary unknowns that are left out may contribute to an S-element, see `Pencil`.
TOLERANCE = 1e-5


def lowest_modes(
    model: Structure,
    count: int,
    auxiliary_tolerance: float = TOLERANCE,
    verify: bool = True,
    kept: Pencil | None = None,
) -> Modal:
    """The `count` lowest modes; see `analysis.modal.modal` for the arguments, by a pencil that is kept of
    having counted them, if any. Collective.

    Raises
    ------
    ValueError
        If there is not enough memory for it.
    SolveError
        If SLEPc does not converge or a residual is too large.
    """
    require_modes(model.cells, count, _basis(count, 0), auxiliary_tolerance == 0.0)
    highest = top_of_band(model.cells, count)
    while True:
        with kept or Pencil(model.statics, highest, auxiliary_tolerance) as pencil:
            below = pencil.eigenvalues_below(highest**2) if count >= COUNTED and not kept else None
            if below is not None and below < count:  # the law is too low
                highest *= 1.1 * math.sqrt(count / max(below, 1))
                continue
            found = _solve_lowest(model, pencil, count, verify)
        reached = 2.0 * math.pi * float(found.frequencies[-1])
        if reached <= pencil.highest:
            return found
        # The band was estimated too low: what was left out is bounded only up to its top.
        highest, kept = 1.1 * reached, None


def modes_below(stiffness: Stiffness, frequency: float) -> tuple[int | None, Pencil | None]:
    """Number of modes below a frequency, Hz; None where the direct solver does not tell it. Of a small
    structure the pencil, up to `REACH` times that frequency, is the caller's to keep. Collective.
    """
    omega, small = 2.0 * math.pi * frequency, is_small(stiffness.layout)
    # below it S-elements have no mass but rounding
    highest = max(omega * (REACH if small else 1.0), math.sqrt(lowest_scale(stiffness.elements)))
    with Pencil(stiffness, highest, TOLERANCE) as pencil:
        below = pencil.eigenvalues_below(omega**2)
        if small and below is not None:
            pencil.counted = omega**2, below
    return below, pencil if pencil.counted[1] >= 0 else None


def _basis(count: int, attempt: int) -> int:
    """Krylov vectors for so many eigenpairs."""
    return max(count + 15, math.ceil((1.9 + 0.5 * attempt) * count))


def _solve_lowest(model: Structure, pencil: Pencil, count: int, verify: bool) -> Modal:
    """The `count` lowest eigenpairs, none left out.

    A single-vector Krylov method meets the second vector of a multiple eigenvalue through round-off only and
    may stop before; the number of eigenvalues below the last ones found tells.
    """
    wanted = count
    for attempt in range(4):
        found = _solve(model, pencil, wanted, attempt=attempt)
        values = (2.0 * math.pi * found.frequencies) ** 2
        if verify and pencil.counted[1] == count - 1 == (values < pencil.counted[0]).sum():
            break  # above these, a further vector would be one of a value that is found
        # far enough below for round-off not to count the last one itself: a residual of 1e-7 is usual; the
        # eigenvalues that are counted are those of the assembled stiffness, refined or not
        chosen = found.shapes[:, :count]
        squares = float(_inner(pencil.layout.comm, chosen, chosen).max())
        margin = max(
            1e-6,
            30.0 * float(found.residuals[:count].max()),
            10.0 * pencil.statics.refinement.scale * squares / max(values[count - 1], np.finfo(float).tiny),
        )
        last = values[count - 1] * (1.0 - margin)
        if not verify or margin > 0.5 or values[count - 1] <= lowest_scale(pencil.elements) * 1e-3:
            break  # the assembled stiffness cannot tell; below rigid-body modes there is nothing
        below = pencil.eigenvalues_below(last)
        if below is None or below <= int((values[:count] < last).sum()):
            break
        wanted = min(max(wanted, below) + 4, pencil.unknowns // 2)
    else:
        raise failed_solve(
            f"modal: {below} frequencies lie below {found.frequencies[count - 1]:.8g} Hz, but the "
            f"eigensolver found {int((values[:count] < last).sum())} of them; raise -modal_eps_ncv or "
            "tighten -modal_eps_tol"
        )
    return found.selected(np.arange(count))


def modes_in_band(
    model: Structure, band: tuple[float, float], auxiliary_tolerance: float = TOLERANCE, verify: bool = True
) -> Modal:
    """Eigenpairs nearest to the middle of the band, more of them until they reach beyond both of its ends and
    none is left out.
    """
    (low, high), elements = band, model.cells
    ends = (2.0 * math.pi * np.array(band)) ** 2
    middle = float(ends.mean())
    require_modes(elements, 8, _basis(8, 0))
    # half as high again: what is left out has its largest effect at the top, where frequencies are asked for
    with Pencil(model.statics, 1.5 * float(np.sqrt(ends[1])), auxiliary_tolerance) as pencil:
        count, most, expected = 8, pencil.unknowns // 2, None
        carried = min(most, elements.layout.count // 2)
        below = pencil.eigenvalues_below(ends[1]) if verify else None
        if below is not None:
            lower = pencil.eigenvalues_below(ends[0]) if ends[0] > 0.0 else 0
            assert lower is not None  # by the same direct solver
            expected = below - lower
            if expected > carried:
                end = top_of_band(elements, carried) / (2.0 * math.pi)
                raise wrong_input(
                    f"modal: band = ({low:g}, {high:g}) Hz holds {expected} frequencies, more than half of "
                    f"the {2 * carried} unknowns on boundaries, with which the mesh carries modes up to some "
                    f"{end:.1g} Hz; lower the band, or refine the mesh"
                )
            count = min(max(count, expected + 4), most)
            require_modes(elements, count, _basis(count, 0))
        for attempt in range(12):
            found = _solve(model, pencil, min(count, most), target=middle, attempt=attempt)
            values = (2.0 * math.pi * found.frequencies) ** 2
            keep = np.flatnonzero((found.frequencies >= low) & (found.frequencies <= high))
            reached = np.abs(values - middle).max() > ends[1] - middle or count >= most
            # a frequency on an end of the band may be counted on the other side of it
            near = (found.frequencies >= low * (1.0 - 1e-6)) & (found.frequencies <= high * (1.0 + 1e-6))
            if reached and (expected is None or near.sum() >= expected):
                return found.selected(keep)
            count = min(2 * count, most)
    raise failed_solve(
        f"modal: the band of {low:g} to {high:g} Hz holds {expected} frequencies, but the eigensolver "
        f"found {len(keep)}; raise -modal_eps_ncv or tighten -modal_eps_tol"
    )


def _solve(model: Structure, pencil: Pencil, count: int, *, target: float = 0.0, attempt: int) -> Modal:
    """`count` eigenpairs nearest to omega^2 = `target`; a structure without full support is shifted below
    zero.
    """
    comm, supported = pencil.layout.comm, pencil.statics.supported
    shift = -lowest_scale(pencil.elements) if target == 0.0 and not supported else target
    solve = CondensedSolve(pencil, shift, prefix="modal_st_", what="modal")
    eps = SLEPc.EPS().create(comm)
    st = eps.getST()
    outer = st.getKSP()
    inner = outer.getPC()
    step = KrylovStep(solve)
    try:
        eps.setOptionsPrefix("modal_")
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
        # 1.9 vectors a pair are mostly enough without a restart. The tolerance is far below what an
        # eigenvalue needs: it keeps the iteration going until the further vectors of multiple eigenvalues
        # have come up; each new attempt gives it more room.
        eps.setDimensions(count, _basis(count, attempt))
        eps.setTolerances((1e-12, 1e-14)[min(attempt, 1)], 200)
        # convergence is looked at where a basis is full: a shorter way there from its restart saves solves
        eps.setKrylovSchurRestart(0.8)
        eps.setPurify(False)  # the mass is definite: no infinite eigenvalues to purify from
        eps.setOperators(pencil.stiffness, pencil.mass)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(shift)
        st.setType(SLEPc.ST.Type.SINVERT)
        st.setMatMode(SLEPc.ST.MatMode.SHELL)
        outer.setOptionsPrefix("modal_condensed_")
        outer.setType(PETSc.KSP.Type.PREONLY)
        inner.setType(PETSc.PC.Type.PYTHON)
        inner.setPythonContext(step)
        configure(eps)
        step.watch(eps)
        with stage("Modes"), solving("modal"), stepping(eps), scripted(inner):
            eps.solve()
        converged = eps.getConverged()
        if converged < count:
            raise failed_solve(
                f"modal: SLEPc found {converged} of {count} eigenpairs (reason "
                f"{eps.getConvergedReason()} after {eps.getIterationNumber()} iterations); "
                "raise -modal_eps_max_it or -modal_eps_ncv, or choose another "
                "-modal_st_pc_factor_mat_solver_type"
            )
        return _collect(model, eps, solve, count)
    finally:
        step.release()
        free(comm, inner, outer, st, eps)
        solve.release()


def _collect(model: Structure, eps: SLEPc.EPS, solve: CondensedSolve, count: int) -> Modal:
    """Eigenpairs in ascending order with their residuals."""
    pencil = solve.pencil
    layout, statics, comm = pencil.layout, pencil.statics, pencil.layout.comm
    values = np.array([eps.getEigenvalue(i).real for i in range(count)])
    order = np.argsort(values)
    values = values[order]
    x = pencil.stiffness.createVecRight()
    array = np.empty((x.getLocalSize(), count), order="F")
    for k, i in enumerate(order):
        eps.getEigenvector(int(i), x)
        array[:, k] = x.array_r
    x.destroy()
    kx, mx = pencil.stiff_products(array), pencil.heavy_products(array)
    # modes whose product with the assembled stiffness is mostly round-off, and so is their Rayleigh quotient
    lengths, momenta = (np.sqrt(_inner(comm, field, field)) for field in (array, mx))
    noise = statics.refinement.scale * lengths / momenta
    slender = np.flatnonzero(noise > NEEDED * np.abs(values))
    if not (statics.supported and solve.refinement):
        slender = slender[:0]
    if len(slender):
        # those next to them, too, for a factorisation's round-off reaches ten times that of the matrix,
        # unless it makes them worse by more than round-off would
        noise = np.maximum(noise, 10.0 * statics.refinement.scale * lengths**2 / _inner(comm, array, mx))
        near = np.flatnonzero(noise > NEEDED * np.abs(values))
        shapes, inertia = array[:, near], mx[:, near]
        refined = kx[:, near].copy()
        refined[: pencil.owned] = statics.refinement.operator(shapes[: pencil.owned])
        quotients = _inner(comm, shapes, refined) / _inner(comm, shapes, inertia)
        errors = [
            comm.allreduce(_misfits(product, value, inertia))
            for product, value in ((kx[:, near], values[near]), (refined, quotients))
        ]
        kept = np.isin(near, slender) | (errors[1] <= WORSE**2 * errors[0])
        kx[:, near[kept]], values[near[kept]] = refined[:, kept], quotients[kept]
    # a rigid-body mode has no strain energy to compare with: an elastic scale of the structure stands in
    floor = lowest_scale(pencil.elements) if not statics.supported else 0.0
    sizes = np.maximum(np.abs(values), floor) * momenta
    residuals = np.sqrt(comm.allreduce(_misfits(kx, values, mx))) / sizes
    if len(slender):
        # the forces of rounded displacements hide the residual; the change by an inverse iteration does not
        shapes = array[:, slender]
        change = solve.nearer(values[slender] * mx[:, slender], shapes, SEEN * RESIDUAL_LIMIT) - shapes
        residuals[slender] = np.sqrt(_inner(comm, change, change) / _inner(comm, shapes, shapes))
    # what round-off in K x alone may leave: a slender or softly held structure's lowest modes meet this limit
    # first
    stiffest = statics.matrix.norm(PETSc.NormType.NORM_INFINITY)
    round_off = 1e3 * np.finfo(float).eps * stiffest * lengths / sizes
    array /= np.sqrt(_inner(comm, array, mx))
    del kx, mx
    shapes = array[: pencil.owned].copy(order="F")
    inertia = summed(comm, array[pencil.owned :].T @ pencil.auxiliary_translation())
    limits = np.maximum(RESIDUAL_LIMIT, round_off)
    limits[slender] = RESIDUAL_LIMIT
    if len(slender):
        statics.refinement.judge("modal")
    if not (residuals <= limits).all():
        worst = int(np.argmax(residuals / limits))
        raise failed_solve(
            f"modal: the residual of mode {worst + 1} is {residuals[worst]:.2g}, more than "
            f"{limits[worst]:.2g}; tighten -modal_eps_tol or choose another "
            "-modal_st_pc_factor_mat_solver_type"
        )
    return Modal(
        np.sqrt(np.maximum(values, 0.0)) / (2.0 * math.pi),
        residuals,
        shapes,
        layout.at_points(shapes),
        inertia,
        f"SLEPc {eps.getType()}, shift-invert by {solver_name(solve.ksp)}",
        eps.getIterationNumber(),
        pencil.unknowns,
        model,
    )


def _inner(comm: MPI.Comm, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n,): inner products of the columns of two distributed arrays."""
    return summed(comm, np.einsum("ij,ij->j", one, other))


def _misfits(kx: np.ndarray, values: np.ndarray, mx: np.ndarray) -> np.ndarray:
    """(n,): squares of this rank's part of K x - value M x, without another array of that size."""
    return np.array([((kx[:, k] - value * mx[:, k]) ** 2).sum() for k, value in enumerate(values)])


def lowest_scale(elements: Elements) -> float:
    """A positive omega^2 well below the elastic modes of a free structure of the model's extent,
    (rad/s)^2.
    """
    length = float(np.linalg.norm(elements.layout.extent[1] - elements.layout.extent[0]))
    speed2 = min(m.modulus / m.density for m in elements.materials)
    return 1e-4 * speed2 / length**2
