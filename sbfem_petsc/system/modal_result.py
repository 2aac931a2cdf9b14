"""Natural frequencies and modes as a result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import integer
from ..errors import at_point
from ..parallel import agreed
from ..writing import write_table
from .structure import Structure


@dataclass(frozen=True, eq=False)
class Modal:
    """Natural frequencies and modes, lowest first.

    Attributes
    ----------
    frequencies : (n,) array
        Hz.
    residuals : (n,) array
        ||K x - omega^2 M x|| / ||omega^2 M x|| (rigid-body modes: relative to the lowest elastic mode); of
        slender structures' lowest modes, where round-off hides it, the relative change ||omega^2 K^-1 M x -
        x|| / ||x||.
    shapes : (owned, n) array
        This rank's displacement unknowns of the modes, mass-normalised with the auxiliary unknowns (x'M x =
        1).
    point_shapes : dict of str to (n, 2) array
        Displacement of each named point, on all ranks.
    auxiliary_inertia : (n, 2) array
        Share of the auxiliary unknowns in the inertia force of a unit acceleration along x and y, per mode,
        on all ranks.
    solver : str
        Eigensolver and direct solver used.
    iterations : int
    unknowns : int
        Displacement unknowns and those auxiliary ones that the band needed.
    model : Model
        With an accuracy asked for, the finest one.
    estimate : Estimate or None
        Errors of the frequencies, where an accuracy was asked for.
    """

    frequencies: np.ndarray
    residuals: np.ndarray
    shapes: np.ndarray
    point_shapes: dict[str, np.ndarray]
    auxiliary_inertia: np.ndarray
    solver: str
    iterations: int
    unknowns: int
    model: Structure
    estimate: Any = None

    def _fingerprint(self) -> object:
        """What tells it from others, the same on all ranks."""
        return self.model, self.frequencies, self.point_shapes

    def displacement(self, point: str) -> np.ndarray:
        """(n, 2): displacement of a named point in each mode."""
        return at_point(self.point_shapes, point)

    @agreed()
    def nodal(self, mode: int) -> np.ndarray:
        """(m, 2): displacements of this rank's nodes in mode `mode` (0 is the lowest). Collective."""
        mode = integer("nodal", "mode", mode, least=0, most=len(self.frequencies) - 1)
        return self.model.nodal(self.shapes[:, mode])

    def to_csv(self, path: str) -> None:
        """Write frequencies, residuals and the modes' displacements of all named points as comma-separated
        values.

        The file takes its name when it is whole.

        Raises
        ------
        TypeError, ValueError
            If it cannot be written.
        """
        columns = {
            "mode": np.arange(1, len(self.frequencies) + 1),
            "frequency_Hz": self.frequencies,
            "residual": self.residuals,
        }
        for point, shape in self.point_shapes.items():
            columns |= {f"{axis}_{point}_per_sqrt_kg": shape[:, k] for k, axis in enumerate(("ux", "uy"))}
        write_table(path, columns)

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
