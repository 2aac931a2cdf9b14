"""Newton's linear systems for invariant curves, by KSP (prefix ``torus_``).

A curve z(theta) that a map takes to itself, P_theta(z(theta)) = z(theta + rho), is sampled at N phases; the
system for its change is D_i x_i - (shifted x)_i, with the map's derivative D_i at each sample, and where rho
and a parameter are unknowns too it is bordered by their columns and two conditions. Derivatives, unknowns and
the preconditioner's factors are shared by the ranks; what every rank needs of an iterate is exchanged.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import linalg

from ..errors import SolveError, on_all_ranks
from ..petsc import MPI, PETSc, configure, free

PREFIX = "torus_"
# Iterations of GMRES before it starts anew, and in all.
RESTART, MOST = 150, 450


class CurveMaps:
    """Derivatives of a map at the samples of a curve, on the ranks that the samples belong to: each has those
    from its own number on in steps of the ranks' count.

    Parameters
    ----------
    comm : MPI.Comm
    samples : int
    own : (n, 2 m, 2 m + p) array
        Of this rank's samples, along the state and p parameters.
    """

    def __init__(self, comm: MPI.Comm, samples: int, own: np.ndarray):
        self.comm, self.samples = comm, samples
        self.mine = slice(comm.rank, None, comm.size)
        size = own.shape[1]
        self.states, self.parameters = np.ascontiguousarray(own[:, :, :size]), own[:, :, size:]

    def mean(self) -> np.ndarray:
        """(2 m, 2 m) along the state. Collective."""
        result = self.states.sum(axis=0)
        self.comm.Allreduce(MPI.IN_PLACE, result)
        return result / self.samples

    def along(self, parameter: int) -> np.ndarray:
        """(N, 2 m) along a parameter, on all ranks. Collective."""
        result = np.zeros((self.samples, self.states.shape[1]))
        result[self.mine] = self.parameters[:, :, parameter]
        self.comm.Allreduce(MPI.IN_PLACE, result)
        return result


class Border(NamedTuple):
    """Columns of rotation and parameter, (2, N 2 m), and two conditions on all unknowns, (2, N 2 m + 2)."""

    columns: np.ndarray
    rows: np.ndarray


class CurveSystem:
    """The system of a curve, and of its rotation and parameter where there is a border.

    The preconditioner replaces the derivatives by their mean, which leaves a system for each harmonic of the
    curve. With a border that of the first one, almost singular where the curve is small, is bordered by its
    own singular vectors, and the two conditions give their amplitude and phase.

    Parameters
    ----------
    maps : CurveMaps
    shift : (N,) array
        Factor on each harmonic of the curve, in the order of the discrete Fourier transform, with which it is
        shifted by rho.
    border : Border, optional
    """

    def __init__(self, maps: CurveMaps, shift: np.ndarray, border: Border | None = None):
        self._maps, self._shift, self._border = maps, shift[:, None], border
        comm, samples, self._modes2 = maps.comm, maps.samples, maps.states.shape[1]
        self._extra = 0 if border is None else 2
        self._length = samples * self._modes2 + self._extra
        # the first rank has the numbers behind its samples
        here = len(range(comm.rank, samples, comm.size)) * self._modes2
        self._here = here + (self._extra if comm.rank == 0 else 0)
        mean, unit = maps.mean(), np.eye(self._modes2)
        self._harmonics = range(comm.rank, samples // 2 + 1, comm.size)
        self._factors = []
        for order in self._harmonics:
            matrix = mean - shift[order] * unit
            if order == 1 and border is not None:
                left, _, right = linalg.svd(matrix)
                matrix = np.block([[matrix, left[:, -1:]], [right[-1:], np.zeros((1, 1))]])
            factors, pivots, _ = linalg.lapack.zgetrf(matrix)
            at = np.flatnonzero(factors.diagonal() == 0.0)
            factors[at, at] = np.finfo(float).eps * np.abs(factors).max()  # a preconditioner may be inexact
            self._factors.append((factors, pivots))

    def solve(self, right: np.ndarray, tolerance: float, iterations: int = MOST) -> np.ndarray:
        """The unknowns, on all ranks, to a residual relative to that of zero. Collective.

        Raises
        ------
        SolveError
            If the iteration does not converge.
        """
        comm, shape = self._maps.comm, right.shape
        right = right.ravel()
        size = float(np.linalg.norm(right))
        sizes = (self._here, self._length)
        matrix = PETSc.Mat().createPython([sizes, sizes], context=self, comm=comm)
        matrix.setUp()
        given, found = matrix.createVecs()
        ksp = PETSc.KSP().create(comm)
        try:
            ksp.setOptionsPrefix(PREFIX)
            ksp.setOperators(matrix)
            ksp.setType(PETSc.KSP.Type.GMRES)
            ksp.setGMRESRestart(min(self._length, RESTART))
            ksp.setPCSide(PETSc.PC.Side.RIGHT)  # the residual is that of the system itself
            ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=iterations)
            ksp.getPC().setType(PETSc.PC.Type.PYTHON)
            ksp.getPC().setPythonContext(_Precondition(self))
            configure(ksp)
            given.array = self._own(right / size)
            ksp.solve(given, found)
            if ksp.getConvergedReason() <= 0:
                raise on_all_ranks(
                    SolveError(
                        "quasi_periodic: Newton's linear system was not solved in "
                        f"{ksp.getIterationNumber()} iterations; take more samples (its solver has options "
                        f"under -{PREFIX}ksp_...)"
                    )
                )
            return size * self._everywhere(found.array_r).reshape(shape)
        finally:
            free(comm, ksp, matrix, given, found)

    def _own(self, vector: np.ndarray) -> np.ndarray:
        """This rank's part of a vector of all unknowns."""
        count = self._maps.samples * self._modes2
        own = vector[:count].reshape(-1, self._modes2)[self._maps.mine].ravel()
        return np.append(own, vector[count:]) if self._maps.comm.rank == 0 else own

    def _everywhere(self, own: np.ndarray) -> np.ndarray:
        """All unknowns, of which this rank has its part."""
        result, count = np.zeros(self._length), self._maps.samples * self._modes2
        behind = self._extra if self._maps.comm.rank == 0 else 0
        samples = result[:count].reshape(-1, self._modes2)
        samples[self._maps.mine] = own[: len(own) - behind].reshape(-1, self._modes2)
        if behind:
            result[count:] = own[len(own) - behind :]
        self._maps.comm.Allreduce(MPI.IN_PLACE, result)
        return result

    def mult(self, matrix: PETSc.Mat, given: PETSc.Vec, result: PETSc.Vec) -> None:
        """PETSc's product."""
        vector, mine = self._everywhere(given.array_r), self._maps.mine
        count = self._maps.samples * self._modes2
        states = vector[:count].reshape(-1, self._modes2)
        image = np.matmul(self._maps.states, states[mine, :, None])[:, :, 0]
        image -= np.fft.ifft(self._shift * np.fft.fft(states, axis=0), axis=0).real[mine]
        if self._border is None:
            result.array = image.ravel()
            return
        for column, value in zip(self._border.columns, vector[count:]):
            image += value * column.reshape(-1, self._modes2)[mine]
        numbers = self._border.rows @ vector if self._maps.comm.rank == 0 else ()
        result.array = np.append(image, numbers)

    def precondition(self, own: np.ndarray) -> np.ndarray:
        """This rank's part of the preconditioner's product with a vector."""
        samples, comm = self._maps.samples, self._maps.comm
        vector, count = self._everywhere(own), samples * self._modes2
        # an amplitude of the first harmonic is as large in the samples as its two numbers
        root = np.sqrt(samples)
        harmonics = root * np.fft.rfft(vector[:count].reshape(samples, -1), axis=0, norm="forward")
        found = np.zeros((len(harmonics), self._modes2 + 1), dtype=complex)
        for order, (factors, pivots) in zip(self._harmonics, self._factors):
            right = harmonics[order]
            if len(pivots) > self._modes2:
                right = np.append(right, complex(vector[-1], vector[-2]))
            found[order, : len(pivots)] = linalg.lapack.zgetrs(factors, pivots, right)[0]
        comm.Allreduce(MPI.IN_PLACE, found)
        states = np.fft.irfft(found[:, :-1] / root, samples, axis=0, norm="forward")
        numbers = [found[1, -1].imag, found[1, -1].real] if self._extra else []
        return self._own(np.append(states, numbers))


class _Precondition:
    """Context of PETSc's preconditioner."""

    def __init__(self, system: CurveSystem):
        self._system = system

    def apply(self, pc: PETSc.PC, given: PETSc.Vec, result: PETSc.Vec) -> None:
        """PETSc's product."""
        result.array = self._system.precondition(given.array_r)
