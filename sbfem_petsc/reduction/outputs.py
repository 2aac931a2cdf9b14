"""Linear output of a reduced model: what its coordinates, loads and contact forces make of some quantity."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..checks import shown
from ..errors import UnknownName, listed
from ..record.record import Record, described, quantity


@described
class LinearOutput(Record):
    """y = modes q + loads s + contact force, for gaps, displacements of points and stress intensity factors
    alike. `names` are those of the first axis, none of contact rows.
    """

    labels: ClassVar = {"*": "names"}

    names: tuple[str, ...]
    modes: np.ndarray = quantity("SI", "shares of modal coordinates", "* mode")
    loads: np.ndarray = quantity("SI", "shares of unit loads beyond those of the modes", "* load")
    contact: np.ndarray = quantity("SI", "shares of unit contact forces beyond those of the modes", "* force")

    def with_modes(self, modes: np.ndarray, by_loads: np.ndarray, by_contact: np.ndarray) -> LinearOutput:
        """The same in further modes, whose share of the static responses is theirs then.

        Parameters
        ----------
        modes : (..., k) array
        by_loads, by_contact : (k, l), (k, c) arrays
            Their coordinates at rest under unit loads and contact forces.
        """
        return LinearOutput(
            self.names,
            np.concatenate([self.modes, modes], axis=-1),
            self.loads - modes @ by_loads,
            self.contact - modes @ by_contact,
        )

    def __call__(self, q: np.ndarray, amplitudes: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(n, ...) values of (n, m) coordinates, (n, l) load amplitudes and (n, c) contact forces."""
        shape = self.modes.shape[:-1]
        rows = int(np.prod(shape, dtype=int))
        flat = [part.reshape(rows, part.shape[-1]).T for part in (self.modes, self.loads, self.contact)]
        return (q @ flat[0] + amplitudes @ flat[1] + force @ flat[2]).reshape(len(q), *shape)

    def rates(self, velocity: np.ndarray) -> np.ndarray:
        """(n, ...) rates of (n, m) velocities: the residual flexibility moves without inertia and is left
        out.
        """
        shape = self.modes.shape[:-1]
        return (velocity @ self.modes.reshape(-1, self.modes.shape[-1]).T).reshape(len(velocity), *shape)

    def of(self, name: str, kind: str) -> LinearOutput:
        """The output of one name.

        Raises
        ------
        UnknownName
            If there is none of this `kind`; the sentence lists those that are.
        """
        if not isinstance(name, str) or name not in self.names:
            raise UnknownName(f"{kind} {shown(name)} does not exist; the model has {listed(self.names)}")
        k = self.names.index(name)
        return LinearOutput((), self.modes[k], self.loads[k], self.contact[k])
