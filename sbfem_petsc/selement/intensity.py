"""Stress intensity factors from the singular radial modes of an open S-element with its scaling centre on a
tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from .dense import SchurForm, reordered, separation
from .face_tractions import FaceTractions
from .sectors import Sectors
from .singular_modes import TipMode, TipSectors

# Exponents closer than this are those of a crack, where each mode opens and slides. Modes that do one of the
# two by less than this share of the other are told apart: of materials that are symmetric about the axis.
_ALIKE, _PURE = 1e-2, 1e-8
# Exponents from here on are those of bounded stresses, but for rounding.
_REGULAR = 1.0 - 1e-9


@dataclass(frozen=True, eq=False)
class InvariantSpace:
    """A subspace of radial modes and its complement: ``u = fields c + rest r``.

    Attributes
    ----------
    fields : (n, k) array
        ``xi u,xi = A u`` in it is ``xi c,xi = generator c``.
    amplitudes : (k, n) array
        c from u.
    generator : (k, k) array
    rest : (n, n - k) array
    rest_amplitudes : (n - k, n) array
        r from u.
    rest_generator : (n - k, n - k) array
    """

    fields: np.ndarray
    amplitudes: np.ndarray
    generator: np.ndarray
    rest: np.ndarray
    rest_amplitudes: np.ndarray
    rest_generator: np.ndarray


def invariant_space(radial: SchurForm, low: float, high: float) -> InvariantSpace | None:
    """The radial modes with low < Re(lambda) < high, by an ordered Schur form; None if there are none."""
    exponents = radial.triangle.diagonal()  # their real parts: both of a complex pair stand there
    (triangle, basis), count = reordered(radial, (low < exponents) & (exponents < high))
    if count == 0:
        return None
    inside, outside = triangle[:count, :count], triangle[count:, count:]
    mixing = separation(inside, outside, -triangle[:count, count:])
    fields, others = basis[:, :count], basis[:, count:]
    return InvariantSpace(
        fields, fields.T - mixing @ others.T, inside, others + fields @ mixing, others.T, outside
    )


@dataclass(frozen=True, eq=False)
class IntensityRows:
    """Stress intensity factors of a non-dimensional tip element as linear forms of its boundary
    displacements.

    Attributes
    ----------
    rows : (2, n) array
        K_I and K_II (opening and sliding of the faces) for boundary displacements in units of the size and
        stresses in units of the modulus; lengths in units of the size.
    exponents : (2,) array
        Exponents lambda of the displacement modes r^lambda that give K_I and K_II: 1/2 at a crack; nan where
        a wide notch has no such singularity. Real parts where they are complex.
    amplitudes : (s, n) array
        Amplitudes of the singular modes, c, for boundary displacements; ``xi c,xi = generator c``.
    generator : (s, s) array
    strength : (2, s) array
        K_I and K_II of the amplitudes at xi = 1: ``rows = strength @ amplitudes``.
    errors : (2,) array
        Of the factors at nodal displacements that are exact with K_I or K_II alone, in units of it: what the
        edges do not carry. Less with more edges or a higher order around the tip (where one order does not
        do: strong orthotropy, E1 / E2 = 14, wants 16 edges of order 5).
    oscillation : float
        Imaginary part eps of the exponents, 0 where the stresses do not oscillate.

    Notes
    -----
    In units: K_i (Pa m^(1 - lambda_i)) is ``E h^-lambda_i rows[i] @ u + h^-lambda_i / thickness columns[i] @
    force`` for displacements in m and, from `of_tractions`, forces on the faces in N.
    """

    rows: np.ndarray
    exponents: np.ndarray
    amplitudes: np.ndarray
    generator: np.ndarray
    strength: np.ndarray
    errors: np.ndarray
    oscillation: float = 0.0

    def placed(self, rotation: np.ndarray, size: float, modulus: float) -> np.ndarray:
        """(2, nodes, 2): the rows for displacements (m) of a placed S-element in its own frame, nodes in the
        reference order; K_i in Pa m^(1 - lambda_i).

        Parameters
        ----------
        rotation : (2, 2) array
            From the element's frame to the reference frame. A reflection turns the sense of sliding.
        size : float
            m.
        modulus : float
            Pa.
        """
        return self._scale(rotation, size)[:, None, None] * modulus * (self.rows.reshape(2, -1, 2) @ rotation)

    def placed_of_tractions(
        self, tractions: FaceTractions, rotation: np.ndarray, size: float, thickness: float
    ) -> np.ndarray:
        """(2, m): what forces on the faces (N) of a placed S-element add to K_i, Pa m^(1 - lambda_i)."""
        return self._scale(rotation, size)[:, None] / thickness * self.of_tractions(tractions)

    def _scale(self, rotation: np.ndarray, size: float) -> np.ndarray:
        return size ** -np.nan_to_num(self.exponents, nan=1.0) * np.array([1.0, np.linalg.det(rotation)])

    def of_tractions(self, tractions: FaceTractions) -> np.ndarray:
        """(2, m): what forces on the faces, in units of E h thickness, add to K_I and K_II at given boundary
        displacements.
        """
        inflow = self.amplitudes @ tractions.forcing
        if not len(inflow):
            return np.zeros((2, inflow.shape[1]))
        following = linalg.solve_sylvester(-self.generator, tractions.growth, inflow)
        return self.strength @ following @ tractions.monomials


def intensity_rows(
    radial: SchurForm,
    sectors: Sectors,
    axis: np.ndarray,
    *,
    reference_length: float = 1.0,
) -> IntensityRows:
    """Linear forms for K_I and K_II.

    Parameters
    ----------
    radial : SchurForm
        Of A of the S-element.
    sectors : Sectors
        About the tip.
    axis : (2,) array
        Unit vector from the tip to the mouth.
    reference_length : float
        Length at which the stress intensity factors of complex exponents are taken, in units of the size.

    Notes
    -----
    ``K_i = sqrt(2 pi) lim r^(1 - lambda_i) sigma_i`` straight ahead of the tip, sigma_I normal to the axis,
    sigma_II shear. A crack between two materials has exponents 1/2 +- i eps, and the limit does not exist; as
    in Rice (1988) ``K_I + i K_II = K L^(i eps)`` with the complex K of ``sigma_I + i sigma_II = K r^(i eps) /
    sqrt(2 pi r)`` and the reference length L: sqrt(2 pi L) times the tractions of the singular field at the
    distance L. For another length the pair turns by eps ln(L' / L).

    The space of the singular modes (0 < lambda < 1) is separated from the rest by an ordered Schur form and a
    Sylvester equation: the pair of a crack's modes shares the exponent 1/2, and an element without symmetry
    splits it into a pair that is close to 1/2 only to the accuracy of its edges. That space is compared at
    the nodes with the modes in closed form, which loses no order: stresses from the S-element's own modes
    were a hundred times less accurate than its exponents.

    Raises
    ------
    SElementError
        If the singular space does not belong to the modes of the tip.
    """
    n = len(radial.triangle)
    space = invariant_space(radial, 0.05, 0.95)
    if space is None:
        none = np.zeros((2, n)), np.full(2, np.nan), np.zeros((0, n)), np.zeros((0, 0)), np.zeros((2, 0))
        return IntensityRows(*none, np.zeros(2))
    found = np.linalg.eigvals(space.generator)
    modes = TipSectors(*sectors, axis).modes(found)
    fields, strength, exponents = _mode_strength(modes, reference_length)
    factors = strength @ linalg.lstsq(fields, space.fields)[0]
    rows = factors @ space.amplitudes
    misses = (rows @ fields - strength) @ np.linalg.pinv(strength)
    return IntensityRows(
        rows,
        exponents,
        space.amplitudes,
        space.generator,
        factors,
        np.linalg.norm(misses, axis=0),
        max((mode.exponent.imag for mode in modes), default=0.0),
    )


def _mode_strength(
    modes: list[TipMode], reference_length: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The tip's modes at the nodes (n, count), their K_I and K_II (2, count), and the real parts of the
    exponents of these (2,).
    """
    columns: list[np.ndarray] = []
    tractions: list[np.ndarray] = []
    exponents: list[float] = []
    for mode in modes:
        traction = np.sqrt(2.0 * np.pi) * mode.traction
        if mode.exponent.imag == 0.0:
            columns.append(mode.displacement.real)
            tractions.append(traction.real)
        else:
            turned = traction * reference_length ** (1j * mode.exponent.imag)
            columns += [2.0 * mode.displacement.real, -2.0 * mode.displacement.imag]
            tractions += [2.0 * turned.real, -2.0 * turned.imag]
        exponents += [mode.exponent.real] * (len(columns) - len(exponents))
    strength, real = np.array(tractions).T, np.array(exponents)
    result = np.full(2, np.nan)
    lead = real < real.min() + _ALIKE
    sizes = np.abs(strength)
    apart = (sizes.min(axis=0) < _PURE * sizes.max(axis=0)).all()
    if lead.sum() > 1 and not apart:  # a crack: both modes open and slide; weaker ones have no part in K
        strength[:, ~lead] = 0.0
        result[:] = real[lead].mean()
    else:
        # a notch: the mode that opens most, relative to its sliding, gives K_I, the one that opens least K_II
        ratio = sizes[0] - sizes[1]
        only = np.zeros_like(strength)
        for i, k in enumerate((int(np.argmax(ratio)), int(np.argmin(ratio)))):
            # a rotation, which coarse elements may count among singular fields, is none
            if real[k] < _REGULAR and (len(real) > 1 or (ratio[k] > 0.0) == (i == 0)):
                only[i, k], result[i] = strength[i, k], real[k]
        strength = only
    return np.array(columns).T, strength, result
