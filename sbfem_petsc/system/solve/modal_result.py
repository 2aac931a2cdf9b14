"""Natural frequencies and modes as a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...checks import integer, shown
from ...errors import SolveError, at_point
from ...ranks.parallel import agreed, whole
from ...record.record import Record, described, quantity
from ..fields.places import Point, checked_place
from ..structure import Structure


@described
class Modal(Record):
    """Natural frequencies and modes, lowest first.

    `shapes` (owned, n) are this rank's displacement unknowns of the modes, mass-normalised with the auxiliary
    unknowns (x'M x = 1), `model` what they are of (with an accuracy asked for, the finest one); both None of
    modes that were read, whose `fields` are those of all nodes.
    """

    frequencies: np.ndarray = quantity("Hz", "natural frequencies, open cracks", "mode", least=0.0, row=True)
    residuals: np.ndarray = quantity(
        "1",
        "||K x - omega^2 M x|| / ||omega^2 M x||; of rigid-body modes relative to the lowest elastic one; of "
        "slender structures' lowest modes the relative change ||omega^2 K^-1 M x - x|| / ||x||",
        "mode",
    )
    shapes: np.ndarray
    point_shapes: dict[str, np.ndarray] = quantity(
        "1/sqrt(kg)", "displacement in each mode", "mode place xy", called="displacement", by="place"
    )
    auxiliary_inertia: np.ndarray = quantity(
        "sqrt(kg)",
        "share of the auxiliary unknowns in the inertia force of a unit acceleration",
        "mode xy",
        detail=True,
    )
    solver: str = quantity(text="eigensolver and direct solver")
    iterations: int = quantity("1", "iterations of the eigensolver")
    unknowns: int = quantity("1", "displacement unknowns and those auxiliary ones that the band needed")
    model: Structure
    estimate: Any = quantity(
        text="errors of the frequencies, where an accuracy was asked for", part="Estimate", default=None
    )
    fields: np.ndarray | None = quantity(
        "1/sqrt(kg)", "displacements of the nodes", "mode node xy", distributed=True, default=None, repr=False
    )

    @agreed()
    def _gathered(self) -> dict[str, Any]:
        """The modes' fields, on rank 0. Collective."""
        if self.model is None:
            return {"fields": self.fields}
        part, comm = self.model.layout.part, self.model.comm
        modes = [whole(comm, part.nodes, self.model.nodal(shape)) for shape in self.shapes.T]
        return {"fields": np.array(modes) if comm.rank == 0 else None}

    def _fingerprint(self) -> object:
        """What tells it from others, the same on all ranks."""
        return self.model, self.frequencies, self.point_shapes

    def displacement(self, point: Point) -> np.ndarray:
        """(n, 2): displacement of a named point, or of any point (x, y) in m, in each mode. Collective for
        (x, y).
        """
        if isinstance(point, str):
            return at_point(self.point_shapes, point)
        return self._displacement_at(checked_place("displacement", point))

    @agreed()
    def _displacement_at(self, place: tuple[float, float]) -> np.ndarray:
        """(n, 2): displacement at a place in each mode. Collective."""
        if self.model is None:
            raise SolveError(
                "modes that were read from a file know their named points and nodes alone; solve them again"
            )
        forms = self.model.places([place], inertia=True).displacement
        return forms.modes(self.shapes, 2.0 * np.pi * self.frequencies).T

    @agreed()
    def nodal(self, mode: int) -> np.ndarray:
        """(m, 2): displacements of this rank's nodes in mode `mode` (0 is the lowest). Collective."""
        mode = integer("nodal", "mode", mode, least=0, most=len(self.frequencies) - 1)
        if self.fields is not None:
            return self.fields[mode]
        return self.model.nodal(self.shapes[:, mode])

    def selected(self, keep: np.ndarray) -> Modal:
        """Some of the modes."""
        return replace(
            self,
            frequencies=self.frequencies[keep],
            residuals=self.residuals[keep],
            shapes=self.shapes[:, keep],
            point_shapes={name: shape[keep] for name, shape in self.point_shapes.items()},
            auxiliary_inertia=self.auxiliary_inertia[keep],
        )

    def __repr__(self) -> str:
        shown = ", ".join(f"{f:.6g}" for f in self.frequencies[:6]) + (
            ", ..." if len(self.frequencies) > 6 else ""
        )
        return (
            f"Modal({len(self.frequencies)} frequencies: {shown} Hz; largest residual "
            f"{self.residuals.max(initial=0):.1e}; {self.solver})"
        )


def chosen_modes(owner: str, modes: Sequence[int], count: int) -> list[int]:
    """Numbers of modes of `count`, 0 the lowest, checked; TypeError or ValueError for what is none."""
    if (
        not isinstance(modes, (list, tuple, range, np.ndarray))
        or getattr(modes, "ndim", 1) != 1
        or not len(modes)
    ):
        raise TypeError(f"{owner}: modes = {shown(modes)} must be a sequence of numbers")
    return [integer(owner, f"modes[{k}]", m, least=0, most=count - 1) for k, m in enumerate(modes)]
