"""Forces of the supports of a reduced model, and displacements that they are given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ..loads import EdgeMotion, Load
from ..petsc import summed
from ..record.record import Record, described, quantity
from ..system.contact.rows import rows_on
from ..system.loads import LoadColumns
from ..system.model import Model
from ..system.solve.modal_result import Modal


@described
class Supports(Record):
    """What supports bear: forces = loads s + contact force + inertia q'' + damping s' + mass s''.

    q are the modal coordinates of the whole displacement. What damps the modes acts inside the body, on its
    motion against the static displacement that follows the supports, and so adds nothing; of the latter
    Rayleigh's b alone is known.
    """

    labels: ClassVar = {"support": "names"}

    names: tuple[str, ...]
    inertia: np.ndarray = quantity(
        "sqrt(kg)",
        "modal coordinates of the static displacement under a unit displacement of a support",
        "support xy mode",
    )
    loads: np.ndarray = quantity("SI", "static forces under unit loads", "support xy load")
    contact: np.ndarray = quantity("1", "static forces under unit contact forces", "support xy force")
    damping: np.ndarray = quantity(
        "N s/m", "forces at unit rates of prescribed displacements, Rayleigh's", "support xy load"
    )
    mass: np.ndarray = quantity(
        "kg", "mass beyond the modes' share that moves with prescribed displacements", "support xy load"
    )
    moved: np.ndarray = quantity(
        "1",
        "what a unit load moves: 2 for each support before its own, and 1 along y; -1 of a force",
        "load",
        kinds="iu",
        least=-1,
    )

    def check(self) -> None:
        """Raise ValueError if a load moves a support that is none."""
        if (self.moved >= 2 * len(self.names)).any():
            raise ValueError(f"a load moves what is none of {len(self.names)} supports")

    @property
    def sizes(self) -> tuple[int, ...]:
        """Modes, loads and contact rows."""
        return tuple(table.shape[2] for table in (self.inertia, self.loads, self.contact))

    @property
    def edges(self) -> np.ndarray:
        """Unit loads that are prescribed displacements."""
        return np.flatnonzero(self.moved >= 0)

    def of_edges(self, name: str) -> np.ndarray:
        """(edges, ...): one of the arrays at the prescribed displacements."""
        table = getattr(self, name)
        return table[self.moved[self.edges] // 2, self.moved[self.edges] % 2]

    def with_modes(self, inertia: np.ndarray) -> Supports:
        """The same in further modes (supports, 2, k), whose share of the mass is theirs then."""
        flat = inertia.reshape(-1, inertia.shape[2])
        share = np.where(self.moved >= 0, flat @ flat[self.moved].T, 0.0).reshape(self.mass.shape)
        inertia = np.concatenate([self.inertia, inertia], axis=2)
        return replace(self, inertia=inertia, mass=self.mass - share)

    @classmethod
    def of(
        cls, model: Model, units: Sequence[Load], found: Modal, columns: LoadColumns, solved: np.ndarray
    ) -> Supports:
        """Of a model's modes and some unit loads, which do `columns` and under which the displacement
        unknowns are `solved` (owned, loads). Collective.
        """
        omega = 2.0 * np.pi * found.frequencies
        still, _ = at_rest(model, units, columns, solved)
        return still.with_modes(-model.support_forces.of_modes(found.shapes, omega) / omega**2)


def at_rest(
    model: Model, units: Sequence[Load], columns: LoadColumns, solved: np.ndarray
) -> tuple[Supports, np.ndarray]:
    """What supports bear where all follows them at rest, without modes; and displacements (m, 2, 2 names) of
    this rank's nodes under unit displacements of the supports. Collective.

    Parameters
    ----------
    model, units, columns, solved
        As of `Supports.of`.
    """
    forces, held = model.support_forces, model.layout.held
    names, following = forces.names, forces.following()
    contact = model.contact.rows(model.layout.owned_values(following))
    contact += rows_on(held, model.tips)(held.owned_values(following))
    loads = summed(model.comm, np.einsum("nis,nil->sl", -following, columns.nodal))
    mass = np.zeros_like(loads)
    moved = np.array([_moved(names, unit) for unit in units], dtype=int)
    for k in np.flatnonzero(moved >= 0):
        assert columns.lift is not None  # it moves
        field = model.nodal(solved[:, k]) + columns.lift.nodal[..., k]
        loads[:, k] = np.ravel(list(forces(field, np.zeros_like(field)).values()))
        mass[:, k] = np.einsum("nis,ni->s", following, model.cells.inertia_forces(field))
    damping = model.rayleigh[1] * np.where(moved >= 0, loads, 0.0)
    loads, pressed, damping, mass = (
        part.reshape(len(names), 2, part.shape[1])
        for part in (loads, -contact.T, damping, summed(model.comm, mass))
    )
    return Supports(names, np.zeros((len(names), 2, 0)), loads, pressed, damping, mass, moved), following


def _moved(names: Sequence[str], unit: Load) -> int:
    """See `Supports.moved`."""
    return 2 * names.index(unit.where) + (unit.uy != 0.0) if isinstance(unit, EdgeMotion) else -1
