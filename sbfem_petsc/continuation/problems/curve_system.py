"""Newton's linear systems for invariant curves, by KSP (prefix ``torus_``).

A curve z(theta) that a map takes to itself, P_theta(z(theta)) = z(theta + rho), is sampled at N phases; the
system for its change is D_i x_i - (shifted x)_i, with the map's derivative D_i at each sample, and where rho
and a parameter are unknowns too it is bordered by their columns and two conditions. Derivatives, unknowns and
the preconditioner's factors are shared by the ranks; what every rank needs of an iterate is exchanged.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg

from ...errors import failed_solve
from ...motion.preparation import period_memory
from ...petsc import MPI
from ...ranks.capacity import require_memory
from ...reduction.reduced_model import ReducedModel
from ..linear import GmresSettings, by_gmres

PREFIX = "torus_"
# Relative residual of the linear systems, and vectors that GMRES keeps.
LINEAR, KEPT = 1e-8, 150
# Reciprocal condition of a harmonic's system below which it is singular but for rounding.
SINGULAR = 1e-14


def filtered(states: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """The samples (N, ...) of a real curve whose harmonics, in the order of the discrete Fourier transform,
    are multiplied by factors (N,).
    """
    return np.fft.ifft(factors[:, None] * np.fft.fft(states, axis=0), axis=0).real


def shift(samples: int, turns: float) -> np.ndarray:
    """(N,) factors on the harmonics of a curve that take it to its samples so many turns further on."""
    factors = np.exp(2j * np.pi * np.fft.fftfreq(samples, 1.0 / samples) * turns)
    if samples % 2 == 0:  # the highest harmonic of a real function is a cosine
        factors[samples // 2] = np.cos(np.pi * samples * turns)
    return factors


def tangents(states: np.ndarray, turns: float = 0.0) -> np.ndarray:
    """Derivative of a curve (N, ...) with its phase in turns, at phases further on."""
    samples = len(states)
    orders = np.fft.fftfreq(samples, 1.0 / samples)
    return filtered(states, 2j * np.pi * orders * shift(samples, turns))


def resampled(states: np.ndarray, samples: int) -> np.ndarray:
    """A real curve (N, ...) at so many phases; harmonics that they do not resolve are left out."""
    harmonics = np.fft.rfft(states, axis=0, norm="forward")
    kept = np.zeros((samples // 2 + 1, states.shape[1]), dtype=complex)
    common = min(len(harmonics), len(kept))
    kept[:common] = harmonics[:common]
    return np.fft.irfft(kept, samples, axis=0, norm="forward")


def require_room(
    owner: str, reduced: ReducedModel, comm: MPI.Comm, *, samples: int, steps: int, orders: int
) -> None:
    """Refuse a curve whose motions and derivatives would take more memory than is free. Collective."""
    rows = len(reduced.initial_gap)
    size = 2 * len(reduced.omega) + rows - reduced.gaps
    mine = math.ceil(samples / comm.size)  # of this rank
    # the derivatives and the preconditioner's factors of two curves and an iteration, and work
    derivatives = 8.0 * mine * size**2 * 7
    motions = 8.0 * mine * steps * (size + rows)
    krylov = 8.0 * mine * size * KEPT
    period = period_memory(reduced, steps, orders)
    require_memory(
        owner,
        comm,
        derivatives + motions + krylov + period,
        f"{samples:,d} samples of {steps:,d} steps and {len(reduced.omega)} modes",
        lambda share: "give fewer samples, steps or modes, or take more ranks on more machines",
    )


class CurveMaps:
    """Derivatives of a map along the state at the samples of a curve, on the ranks that the samples belong
    to: each has those from its own number on in steps of the ranks' count.

    Parameters
    ----------
    comm : MPI.Comm
    samples : int
    states : (n, 2 m, 2 m) array
        Of this rank's samples.
    """

    def __init__(self, comm: MPI.Comm, samples: int, states: np.ndarray):
        self.comm, self.samples, self.states, self.size = comm, samples, states, states.shape[1]
        self.mine = slice(comm.rank, None, comm.size)

    def mean(self) -> np.ndarray:
        """(2 m, 2 m). Collective."""
        result = self.states.sum(axis=0)
        self.comm.Allreduce(MPI.IN_PLACE, result)
        return result / self.samples


class Harmonics:
    """Preconditioner: the derivatives are replaced by their mean, which leaves a system for each harmonic of
    the curve. With a border that of the first one, almost singular where the curve is small, is bordered by
    its own singular vectors, and the two conditions give their amplitude and phase.

    Parameters
    ----------
    maps : CurveMaps
    shift : (N,) array
        Factor on each harmonic of the curve, in the order of the discrete Fourier transform, with which it is
        shifted by rho.
    bordered : bool

    Raises
    ------
    SolveError
        If the system of a harmonic is singular.
    """

    def __init__(self, maps: CurveMaps, shift: np.ndarray, bordered: bool = False):
        self.maps, self.shift, self.bordered = maps, shift, bordered
        mean = maps.mean()
        if not np.isfinite(mean).all():
            raise failed_solve("quasi_periodic: the map's derivative is beyond the range of numbers")
        self._mine = range(maps.comm.rank, maps.samples // 2 + 1, maps.comm.size)
        self._factors = []
        least = 1.0
        for order in self._mine:
            matrix = mean - shift[order] * np.eye(maps.size)
            if order == 1 and bordered:
                left, _, right = linalg.svd(matrix)
                matrix = np.block([[matrix, left[:, -1:]], [right[-1:], np.zeros((1, 1))]])
            factors, pivots, _ = linalg.lapack.zgetrf(matrix)
            self._factors.append((factors, pivots))
            least = min(least, float(linalg.lapack.zgecon(factors, np.linalg.norm(matrix, 1))[0]))
        if not maps.comm.allreduce(least, MPI.MIN) > SINGULAR:
            raise failed_solve(
                "quasi_periodic: the motion is not isolated, as where a mode without damping is driven "
                "at its own frequency by a combination of the tones; give damping, or other frequencies"
            )

    def solve(self, vector: np.ndarray) -> np.ndarray:
        """The preconditioner's product with all unknowns. Collective."""
        samples, size = self.maps.samples, self.maps.size
        # an amplitude of the first harmonic is as large in the samples as its two numbers
        root = np.sqrt(samples)
        states = vector[: samples * size].reshape(samples, -1)
        harmonics = root * np.fft.rfft(states, axis=0, norm="forward")
        found = np.zeros((len(harmonics), size + 1), dtype=complex)
        for order, (factors, pivots) in zip(self._mine, self._factors):
            right = harmonics[order]
            if len(pivots) > size:
                right = np.append(right, complex(vector[-1], vector[-2]))
            found[order, : len(pivots)] = linalg.lapack.zgetrs(factors, pivots, right)[0]
        self.maps.comm.Allreduce(MPI.IN_PLACE, found)
        states = np.fft.irfft(found[:, :-1] / root, samples, axis=0, norm="forward")
        return np.append(states, [found[1, -1].imag, found[1, -1].real] if self.bordered else [])


class CurveBorder:
    """The linearised equations of a curve with one more row, see `problem.Border`, by KSP in units of the
    unknowns. Collective.

    Parameters
    ----------
    harmonics : Harmonics
    columns : (2, N 2 m) array
        Derivatives of the equations along rotation and parameter; (0, N 2 m) where the rotation is known: the
        parameter is held then, and the row is about it alone.
    phase : (N 2 m + 2,) array or None
        The condition on where the curve begins, where there are columns.
    row : array
    units : (array, float)
        Of the unknowns, and of the equations.
    """

    sign: float | None = None

    def __init__(
        self,
        harmonics: Harmonics,
        columns: np.ndarray,
        phase: np.ndarray | None,
        row: np.ndarray,
        units: tuple[np.ndarray, float],
    ):
        self._harmonics, self._maps, (self.units, self.unit) = harmonics, harmonics.maps, units
        scaled = row * self.units
        self.size, self._extra = float(np.linalg.norm(scaled)), len(columns)
        self._coordinates = self._maps.samples * self._maps.size
        if phase is not None:
            self._rows = np.array([phase, scaled / self.size])
            self._columns = columns * (self.units[-2:, None] / self.unit)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`.

        Raises
        ------
        SolveError
            If the iteration does not converge; a `PetscFailure` if PETSc cannot do it.
        """
        right = np.append(right[:-1] / self.unit, right[-1] / self.size)
        known, held = (right, ()) if self._extra else (right[:-1], right[-1:])
        size = float(np.linalg.norm(known)) or 1.0
        remedy = f"take more samples, or another solver or more iterations under -{PREFIX}ksp_..."
        settings = GmresSettings("quasi_periodic", PREFIX, LINEAR, KEPT, remedy)
        own = by_gmres(self._maps.comm, self.own(known / size), self.product, self.nearby, settings)
        return self.units * np.append(size * self.everywhere(own), held)

    def own(self, vector: np.ndarray) -> np.ndarray:
        """This rank's part of a vector of all unknowns; the first rank has the numbers behind its samples."""
        own = vector[: self._coordinates].reshape(-1, self._maps.size)[self._maps.mine].ravel()
        return np.append(own, vector[self._coordinates :]) if self._maps.comm.rank == 0 else own

    def everywhere(self, own: np.ndarray) -> np.ndarray:
        """All unknowns, of which this rank has its part."""
        result = np.zeros(self._coordinates + self._extra)
        behind = self._extra if self._maps.comm.rank == 0 else 0
        samples, count = result[: self._coordinates].reshape(-1, self._maps.size), len(own) - behind
        samples[self._maps.mine] = own[:count].reshape(-1, self._maps.size)
        result[len(result) - behind :] = own[count:]
        self._maps.comm.Allreduce(MPI.IN_PLACE, result)
        return result

    def product(self, own: np.ndarray) -> np.ndarray:
        """This rank's part of the system's left side."""
        maps, vector = self._maps, self.everywhere(own)
        states = vector[: self._coordinates].reshape(-1, maps.size)
        image = np.matmul(maps.states, states[maps.mine, :, None])[:, :, 0]
        image -= filtered(states, self._harmonics.shift)[maps.mine]
        if not self._extra:
            return image.ravel()
        for column, value in zip(self._columns, vector[self._coordinates :]):
            image += value * column.reshape(-1, maps.size)[maps.mine]
        return np.append(image, self._rows @ vector if maps.comm.rank == 0 else ())

    def nearby(self, own: np.ndarray) -> np.ndarray:
        """This rank's part of the preconditioner's product with a vector."""
        return self.own(self._harmonics.solve(self.everywhere(own)))
