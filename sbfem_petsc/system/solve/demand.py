"""Memory that matrices and factors will take, before they are made."""

from __future__ import annotations

import math
from typing import Any

from ...petsc import PETSc
from ...ranks.capacity import give_back, require_memory

# Of a matrix, bytes an entry: a value and the number of its column.
ENTRY = 12
# Of MUMPS's factor, bytes for N log2 N: 10.3 entries measured on plates of order 5 with 55,000 to 300,000
# unknowns, and two fifths of working space; and of what it is given, an entry of one half of the matrix.
FACTOR, GIVEN = 8 * 10.3 * 1.4, 8
COARSER = "take a coarser mesh, or more ranks on more machines"


def matrix_entries(model: Any, terms: int = 0) -> int:
    """Entries of a matrix over the displacement unknowns, or, with the auxiliary unknowns of so many terms
    of the continued fraction, of one over all of them; those of neighbours are counted twice. Collective.
    """
    local = sum(4 * group.nodes.size * group.nodes.shape[1] for group in model.groups)
    return (1 + 2 * terms) * model.comm.allreduce(local)


def factor_memory(model: Any) -> float:
    """Bytes of a factor of the stiffness, or of a shifted one, and of the matrix that it is made of.
    Collective.
    """
    unknowns = model.boundary_unknowns
    return (ENTRY + GIVEN) * matrix_entries(model) + FACTOR * unknowns * math.log2(unknowns + 1)


def require_factor(model: Any) -> None:
    """Refuse statics, and what rests on them, if the stiffness's factor and the columns that contact is
    solved for at a time would not find room. Collective.

    Raises
    ------
    ValueError
    """
    if PETSc.Options().getString("static_ksp_type", "preonly") != "preonly":
        return  # an iterative solver's memory is another one
    block = min(256, int(model.tip_rows[-1]))
    needed = factor_memory(model) + 16.0 * model.boundary_unknowns * block
    require_memory(
        "static",
        model.comm,
        needed / model.comm.size,
        f"a factor of {model.boundary_unknowns:,d} unknowns",
        lambda share: f"{COARSER}, or an iterative solver (-static_ksp_type cg -static_pc_type gamg)",
    )


def require_modes(model: Any, count: int, basis: int, whole: bool = False) -> None:
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
    unknowns = model.unknowns if whole else model.boundary_unknowns
    mass = matrix_entries(model, model.continued_fraction if whole else 0)
    pencil = ENTRY * (matrix_entries(model) + mass)
    needed = pencil + factor_memory(model) + 8 * unknowns * (basis + 4 * count)
    give_back(unknowns)
    require_memory(
        "modal",
        model.comm,
        needed / model.comm.size,
        f"{count} modes of {unknowns:,d} unknowns",
        lambda share: f"ask for fewer modes, {COARSER}",
    )


def require_steps(owner: str, model: Any, modes: int, responses: int, *, vectors: int = 0) -> None:
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
    matrices = matrix_entries(model, model.continued_fraction) + matrix_entries(model)
    columns = 16 + modes + 2 * min(len(model.gap_operator), responses) + 2 * vectors
    needed = ENTRY * matrices + factor_memory(model) + 8.0 * model.unknowns * columns
    require_memory(
        owner,
        model.comm,
        needed / model.comm.size,
        f"the unreduced model of {model.unknowns:,d} unknowns",
        lambda share: f"{COARSER}, or the reduced model (reduction = 'modes')",
    )
