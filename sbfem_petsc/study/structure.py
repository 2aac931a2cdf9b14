"""A model that the analyses of a case share."""

from __future__ import annotations

from typing import Any

from .case import objects
from .case.case import Case
from .kinds.kind import Run
from .quantities import Tree


class Structure:
    """A model, which keeps its modes and reductions, for cases that differ in loads and analyses only.

    Parameters
    ----------
    case : Case
    comm : mpi4py communicator
    mesh : BoundaryMesh, optional
        On rank 0 at least. Default: made.
    """

    def __init__(self, case: Case, comm: Any, mesh: Any = None):
        self.comm = comm
        self.model = objects.model(case, comm, mesh)

    def points(self, case: Case) -> tuple[str, ...]:
        """Points whose motion is kept."""
        chosen = case.tables.output.points
        return tuple(self.model.points) if chosen is None else tuple(chosen)

    def solve(self, case: Case, name: str, **run: Any) -> Any:
        """Result of an analysis of a case of this structure, with the file and progress of a `Run`.
        Collective.
        """
        return case.tables.analyses[name].solve(case, self.model, Run(**run))

    def tree(self, case: Case, name: str, result: Any) -> Tree:
        """Quantities of a result of `solve`. Collective."""
        return case.tables.analyses[name].tree(result, self.points(case))

    def release(self, result: Any) -> None:
        """Free the finer model that a result of an accuracy asked for was computed on."""
        if getattr(result, "estimate", None) is not None and result.model is not self.model:
            result.model.destroy()

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.model.destroy()
