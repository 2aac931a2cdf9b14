"""Whole fields of an unreduced model's motion, kept while it runs as far as they take little memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...loads import Load
from ...system.fields.sampling import Field
from ...system.model import Model

# Bytes on each rank that the fields of a motion may take; beyond it they are not kept.
MOST = 256_000_000


class KeptFields:
    """Displacement unknowns at the instants of a motion.

    Parameters
    ----------
    model : Model
    units : sequence of Load
        The unit loads.
    instants : int
        How many there will be.

    Attributes
    ----------
    wanted : bool
        Whether they are kept: up to `MOST` bytes on each rank.
    """

    def __init__(self, model: Model, units: Sequence[Load], instants: int):
        self.model, self.units = model, tuple(units)
        self.wanted = 8.0 * instants * model.boundary_unknowns / model.comm.size <= MOST
        self._owned: list[np.ndarray] = []
        self._amplitudes: list[np.ndarray] = []

    def add(self, owned: np.ndarray, amplitudes: np.ndarray) -> None:
        """Keep an instant: this rank's displacement unknowns, m, and the amplitudes of the unit loads."""
        self._owned.append(owned)
        self._amplitudes.append(np.array(amplitudes))

    def complete(self, instants: int) -> KeptFields | None:
        """These fields if they are those of all instants."""
        return self if self.wanted and len(self._owned) == instants else None

    def rolled(self, places: int) -> KeptFields:
        """The same with the last instants put first, as of a period."""
        for part in (self._owned, self._amplitudes):
            part[:] = part[-places:] + part[:-places]
        return self

    def along(self, kind: str, points: list[tuple[float, float]], contact: np.ndarray) -> np.ndarray:
        """(n, points, components): "displacement", m, or "stress" (xx, yy, xy), Pa. Collective.

        Parameters
        ----------
        contact : (n, c) array
            Forces of the contact rows, N.
        """
        columns = self.model.load_columns(self.units)
        forms = getattr(self.model.places(points, moved=columns.lift is not None), kind)
        direct = forms.direct(columns)
        flat = forms.rows(np.stack(self._owned, axis=1)) + forms.contact @ contact.T
        flat += direct @ np.array(self._amplitudes).reshape(len(self._owned), -1).T
        return flat.T.reshape(len(self._owned), len(points), -1)

    def field(self, instant: int, contact: np.ndarray) -> Field:
        """Of one instant, with the forces (c,) of the contact rows. Collective."""
        columns = self.model.load_columns(self.units)
        amplitudes, nodal = self._amplitudes[instant], self.model.nodal(self._owned[instant])
        loads = {n: forces @ amplitudes for n, forces in columns.tip_forces.items()}
        if columns.lift is not None:
            nodal = nodal + columns.lift.nodal @ amplitudes
        return Field.of_forces(self.model.tips, nodal, contact, loads)
