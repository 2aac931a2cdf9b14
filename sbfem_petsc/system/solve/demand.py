"""Memory that matrices and factors will take, before they are made."""

from __future__ import annotations

import math

from ...petsc import asked
from ...ranks.capacity import give_back, require_memory
from ..elements.elements import Elements

# Of a matrix, bytes an entry: a value and the number of its column.
ENTRY = 12
# Of MUMPS's factor, bytes for N log2 N: 10.3 entries measured on plates of order 5 with 55,000 to 300,000
# unknowns, and two fifths of working space; and of what it is given, an entry of one half of the matrix.
FACTOR, GIVEN = 8 * 10.3 * 1.4, 8
# Of S-elements' own mass and coupling, bytes an entry of a matrix of theirs (35 measured), and of the largest
# matrix while it is made.
INERTIA, MADE = 35, 16
COARSER = "take a coarser mesh, or more ranks on more machines"


def matrix_entries(elements: Elements, terms: int = 0) -> int:
    """Entries of a matrix over the displacement unknowns, or, with the auxiliary unknowns of so many terms
    of the continued fraction, of one over all of them; those of neighbours are counted twice. Collective.
    """
    local = sum(4 * group.nodes.size * group.nodes.shape[1] for group in elements.groups)
    return (1 + 2 * terms) * elements.layout.comm.allreduce(local)


def factor_memory(elements: Elements) -> float:
    """Bytes of a factor of the stiffness, or of a shifted one, and of the matrix that it is made of.
    Collective.
    """
    unknowns = elements.layout.count
    return (ENTRY + GIVEN) * matrix_entries(elements) + FACTOR * unknowns * math.log2(unknowns + 1)


def require_factor(elements: Elements, columns: int) -> None:
    """Refuse statics, and what rests on them, if the stiffness's factor and the columns that contact is
    solved for at a time would not find room. Collective.

    Parameters
    ----------
    columns : int
        That contact may ask for.

    Raises
    ------
    ValueError
    """
    if asked("static_ksp_type") not in (None, "preonly"):
        return  # an iterative solver's memory is another one
    unknowns = elements.layout.count
    needed = factor_memory(elements) + 16.0 * unknowns * min(256, columns)
    remedy = f"{COARSER}, or an iterative solver (-static_ksp_type cg -static_pc_type gamg)"
    _require("static", elements, needed, f"a factor of {unknowns:,d} unknowns", remedy)


def require_modes(elements: Elements, count: int, basis: int, whole: bool = False) -> None:
    """Refuse what would end in PETSc's or the system's error for want of memory. Collective.

    Parameters
    ----------
    count : int
        Modes.
    basis : int
        Vectors that the eigensolver keeps.
    whole : bool
        Whether all auxiliary unknowns are kept.

    Raises
    ------
    ValueError
    """
    # the mass and the matrix of the count, one factor at a time beside that of statics; the basis, the
    # eigenvectors and their products
    unknowns = elements.unknowns if whole else elements.layout.count
    mass = matrix_entries(elements, elements.terms if whole else 0)
    pencil = ENTRY * (matrix_entries(elements) + mass)
    needed = pencil + factor_memory(elements) + 8 * unknowns * (basis + 4 * count)
    give_back(unknowns)
    what = f"{count} modes of {unknowns:,d} unknowns"
    _require("modal", elements, needed, what, f"ask for fewer modes, {COARSER}")


def require_steps(owner: str, elements: Elements, modes: int, responses: int, *, vectors: int = 0) -> None:
    """Refuse the steps of the unreduced model if its matrices, the factor and the responses to contact would
    not find room. Collective.

    Parameters
    ----------
    modes : int
        That are damped.
    responses : int
        To unit contact forces that are kept at most.
    vectors : int
        Further vectors over all unknowns, displacements and velocities, of a linear solver.

    Raises
    ------
    ValueError
    """
    own, whole = matrix_entries(elements), matrix_entries(elements, elements.terms)
    columns = 16 + modes + 2 * responses + 2 * vectors
    needed = ENTRY * (own + whole) + INERTIA * own + MADE * whole
    needed += factor_memory(elements) + 8.0 * elements.unknowns * columns
    what = f"the unreduced model of {elements.unknowns:,d} unknowns"
    _require(owner, elements, needed, what, f"{COARSER}, or the reduced model (reduction = 'modes')")


def _require(owner: str, elements: Elements, needed: float, what: str, remedy: str) -> None:
    """Refuse what takes so many bytes of all ranks together, unless there is room."""
    comm = elements.layout.comm
    require_memory(owner, comm, needed / comm.size, what, lambda share: remedy)
