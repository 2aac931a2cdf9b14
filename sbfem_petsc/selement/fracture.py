"""T-stress of a crack's tip element, and energy release rates from stress intensity factors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from .coefficients import SElementError
from .dense import SchurForm
from .face_tractions import FaceTractions
from .intensity import InvariantSpace, invariant_space
from .singular_modes import characteristic_roots, is_isotropic

# The uniform stress along a crack and the rotation have the exponent 1 exactly; the faces of a notch turn it.
_WINDOW = 0.05


@dataclass(frozen=True, eq=False)
class TStressRow:
    """T-stress of a non-dimensional tip element as a linear form: the stress along the crack, xi^0, that the
    singular stresses leave.

    In units: T (Pa) is ``E / h row @ u + 1 / (h thickness) of_tractions(...) @ force`` for displacements in m
    and forces on the faces in N.

    Attributes
    ----------
    row : (n,) array
        For boundary displacements in units of the size.
    """

    row: np.ndarray
    _space: InvariantSpace
    _stress_of: np.ndarray

    def placed(self, rotation: np.ndarray, size: float, modulus: float) -> np.ndarray:
        """(nodes, 2): the row for displacements (m) of an S-element of size (m) and modulus (Pa) placed with
        ``v_reference = rotation @ v``, nodes in the reference order; T in Pa.
        """
        return modulus / size * (self.row.reshape(-1, 2) @ rotation)

    def of_tractions(self, tractions: FaceTractions) -> np.ndarray:
        """(m,): what forces on the faces, in units of E h thickness, add at given boundary displacements.

        T is then the stress along the crack in the presence of the pressure, as in the body under tension
        that superposition relates it to. A traction on one face alone has a logarithm, and no T of its own;
        the part of T that has a limit is given, with the logarithm taken as zero on the element's boundary. A
        pressure with a logarithm leaves none: nan.
        """
        space = self._space
        inflow = space.amplitudes @ tractions.forcing
        rest_inflow = space.rest_amplitudes @ tractions.forcing
        powers = tractions.growth.diagonal()
        linear = np.empty((len(space.fields), len(powers)))
        for power in np.unique(powers):
            of = powers == power
            if power == 1.0:
                # the linear part of the field: along the other modes it follows the pressure
                shifted = np.eye(len(rest_inflow)) - space.rest_generator
                linear[:, of] = -space.rest @ linalg.solve(shifted, rest_inflow[:, of])
            else:
                shifted = power * np.eye(len(inflow)) - space.generator
                linear[:, of] = space.fields @ linalg.solve(shifted, inflow[:, of])
        columns = self._stress_of @ linear @ tractions.monomials
        if tractions.logarithm:
            columns.reshape(-1, tractions.modes)[:, -1] = np.nan
        return columns


def t_stress_row(
    radial: SchurForm, shape: np.ndarray, elasticity: np.ndarray, axis: np.ndarray
) -> TStressRow | None:
    """T-stress of a crack in one material from the radial modes with the exponent 1; None of a notch.

    Parameters
    ----------
    radial : SchurForm
        Of A of the S-element.
    shape : (nodes, 2) array
        Boundary nodes about the tip, in units of the size.
    elasticity : (3, 3) array
        D in units of the modulus.
    axis : (2,) array
        Unit vector from the tip to the mouth.

    Raises
    ------
    SElementError
        If the sectors around the tip are of several materials.
    """
    if np.ndim(elasticity) != 2:
        raise SElementError(
            "the T-stress of a tip in several materials is not one number; ask for the stress in each of them"
        )
    space = invariant_space(radial, 1.0 - _WINDOW, 1.0 + _WINDOW)
    if space is None or len(space.generator) != 2:
        return None
    compliance = np.linalg.inv(elasticity)
    along, normal = -axis, np.array([axis[1], -axis[0]])
    linear = [np.array([[0.0, -1.0], [1.0, 0.0]])]
    for tensor in (
        np.outer(along, along),
        np.outer(normal, normal),
        np.outer(along, normal) + np.outer(normal, along),
    ):
        xx, yy, twice = compliance @ tensor[[0, 1, 0], [0, 1, 1]]
        linear.append(np.array([[xx, 0.5 * twice], [0.5 * twice, yy]]))
    columns = np.stack([(shape @ gradient.T).ravel() for gradient in linear], axis=1)
    stress_of = np.linalg.pinv(columns)[1]
    return TStressRow(stress_of @ space.fields @ space.amplitudes, space, stress_of)


def energy_release_rate(intensity: np.ndarray, elasticity: np.ndarray, axis: np.ndarray) -> float:
    """G (J/m^2) of a crack that grows straight ahead, of any plane elasticity.

    Parameters
    ----------
    intensity : (2,) array
        K_I and K_II, Pa m^(1/2).
    elasticity : (3, 3) array
        D, Pa, in the axes of `axis`; strains are (xx, yy, 2 xy).
    axis : (2,) array
        Unit vector from the tip to the mouth.

    Notes
    -----
    Sih, Paris, Irwin (1965), in the axes along (ahead of) and across the crack; ``(K_I^2 + K_II^2) / E'``
    in isotropic materials, E' = E in plane stress and E / (1 - nu^2) in plane strain.
    """
    first, second = np.asarray(intensity, dtype=float)
    c, s = -axis[0], -axis[1]
    # stresses in x, y from those along and across the crack
    turn = np.array(
        [[c * c, s * s, -2.0 * c * s], [s * s, c * c, 2.0 * c * s], [c * s, -c * s, c * c - s * s]]
    )
    compliance = turn.T @ np.linalg.inv(elasticity) @ turn
    mu = characteristic_roots(compliance / compliance.max())
    opening = -0.5 * first * compliance[1, 1] * ((first * mu.sum() + second) / mu.prod()).imag
    sliding = 0.5 * second * compliance[0, 0] * (second * mu.sum() + first * mu.prod()).imag
    return float(opening + sliding)


def interface_energy_release_rate(intensity: np.ndarray, elasticities: np.ndarray) -> float:
    """G (J/m^2) of a crack between two isotropic materials that grows along the interface.

    Parameters
    ----------
    intensity : (2,) array
        K_I and K_II at any reference length, Pa m^(1/2).
    elasticities : (2, 3, 3) array
        D of both materials, Pa.

    Notes
    -----
    ``(1 - beta^2) |K|^2 (1 / E'_1 + 1 / E'_2) / 2`` with Dundurs' second parameter (Rice 1988).

    Raises
    ------
    SElementError
        If a material is not isotropic.
    """
    for elasticity in elasticities:
        if not is_isotropic(elasticity):
            raise SElementError(
                "the energy release rate of an interface crack is given for isotropic materials alone; one "
                "of the two is not"
            )
    beta = dundurs(elasticities)[1]
    flexibility = sum(np.linalg.inv(d)[0, 0] for d in elasticities)
    return float(0.5 * (1.0 - beta**2) * flexibility * np.sum(np.square(intensity)))


def dundurs(elasticities: np.ndarray) -> tuple[float, float]:
    """Dundurs' parameters alpha and beta of two isotropic materials (2, 3, 3), the first one above."""
    (first, second) = ((d[2, 2], 1.0 + 2.0 * d[2, 2] / (d[0, 1] + d[2, 2])) for d in elasticities)
    (g1, k1), (g2, k2) = first, second
    total = g1 * (k2 + 1.0) + g2 * (k1 + 1.0)
    return (
        float((g1 * (k2 + 1.0) - g2 * (k1 + 1.0)) / total),
        float((g1 * (k2 - 1.0) - g2 * (k1 - 1.0)) / total),
    )
