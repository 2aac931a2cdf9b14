"""Whole fields of an unreduced model's motion, kept while it runs as far as they take little memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...loads import Load
from ...system.fields.places import Point
from ...system.fields.sampling import Field
from ...system.model import Model
from ...system.solve.pencil import Pencil

# Bytes on each rank that the fields of a motion may take; beyond it they are not kept.
MOST = 256_000_000


class KeptFields:
    """Displacement and auxiliary unknowns at the instants of a motion.

    Parameters
    ----------
    model : Model
    pencil : Pencil
        With all auxiliary unknowns; it is not kept.
    units : sequence of Load
        The unit loads.
    instants : int
        How many there will be.

    Attributes
    ----------
    wanted : bool
        Whether they are kept: up to `MOST` bytes on each rank.
    """

    def __init__(self, model: Model, pencil: Pencil, units: Sequence[Load], instants: int):
        self.model, self.units, self._owned = model, tuple(units), pencil.owned
        self.wanted = 8.0 * instants * pencil.unknowns / self.model.comm.size <= MOST
        # where the auxiliary unknowns of each S-element of this rank begin
        self._inside = np.zeros(len(pencil.layout.part.elements), dtype=np.int64)
        for group, _, numbers in pencil.placed():
            if numbers.size:
                self._inside[group.elements] = pencil.owned + numbers[:, 0]
        self._states: list[np.ndarray] = []
        self._amplitudes: list[np.ndarray] = []

    def add(self, state: np.ndarray, amplitudes: np.ndarray) -> None:
        """Keep an instant: this rank's displacement (m) and auxiliary unknowns, and the amplitudes of the
        unit loads.
        """
        self._states.append(state)
        self._amplitudes.append(np.array(amplitudes))

    def complete(self, instants: int) -> KeptFields | None:
        """These fields if they are those of all instants."""
        return self if self.wanted and len(self._states) == instants else None

    def rolled(self) -> KeptFields:
        """The same with the last instant put first, as of a period."""
        for part in (self._states, self._amplitudes):
            part.insert(0, part.pop())
        return self

    def along(self, kind: str, points: Sequence[Point], contact: np.ndarray) -> np.ndarray:
        """(n, points, components): "displacement", m, or "stress" (xx, yy, xy), Pa. Collective.

        Parameters
        ----------
        contact : (n, c) array
            Forces of the contact rows, N.
        """
        model, columns, count = self.model, self.model.load_columns(self.units), len(self._states)
        forms = getattr(model.places(points, inertia=True, moved=columns.lift is not None), kind)
        inertia = forms.inertia
        inside = np.zeros((inertia.fields.shape[1], count))
        for element, own in inertia.own.items():
            first = self._inside[element]
            inside[own] = np.transpose(
                [state[first : first + own.stop - own.start] for state in self._states]
            )
        flat = model.comm.allreduce(inertia.fields @ inside)
        # the auxiliary unknowns, where there are any, know how supports move
        still = replace(forms, inertia=None) if model.continued_fraction else forms
        flat += still.direct(columns) @ np.array(self._amplitudes).reshape(count, -1).T
        flat += forms.rows(np.stack([state[: self._owned] for state in self._states], axis=1))
        flat += forms.contact @ contact.T
        return flat.T.reshape(count, len(points), -1)

    def field(self, instant: int, contact: np.ndarray) -> Field:
        """Of one instant, with the forces (c,) of the contact rows. Collective."""
        load = self.model.load_columns(self.units).combined(self._amplitudes[instant])
        nodal = self.model.nodal(self._states[instant][: self._owned], load)
        return Field.of_forces(self.model.tips, nodal, contact, load)
