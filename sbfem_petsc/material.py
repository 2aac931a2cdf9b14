"""Linear elastic materials in the plane, validated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


def positive(owner: str, name: str, value: float, unit: str) -> float:
    """`value` as a float, or an error sentence that names the item, its value and what was expected."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{owner}: {name} = {value!r} is not a number; give it in {unit}")
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{owner}: {name} = {value!r} must be a positive, finite number ({unit})")
    return float(value)


@dataclass(frozen=True)
class Material:
    """Isotropic linear elastic material.

    Parameters
    ----------
    young : float
        Young's modulus, Pa.
    poisson : float
        Poisson's ratio, -1 < nu < 0.5 (plane stress admits 0.5 too).
    density : float
        kg/m^3.
    plane : {"stress", "strain"}

    Raises
    ------
    ValueError, TypeError
        With a sentence that names the value and what was expected.
    """

    young: float
    poisson: float
    density: float
    plane: str = "stress"

    def __post_init__(self) -> None:
        positive("Material", "young", self.young, "Pa")
        positive("Material", "density", self.density, "kg/m^3")
        _check_plane(self.plane)
        if isinstance(self.poisson, bool) or not isinstance(
            self.poisson, (int, float, np.integer, np.floating)
        ):
            raise TypeError(f"Material: poisson = {self.poisson!r} is not a number")
        upper_ok = self.poisson <= 0.5 if self.plane == "stress" else self.poisson < 0.5
        if not (self.poisson > -1.0 and upper_ok):
            limit = (
                "-1 < poisson <= 0.5 in plane stress"
                if self.plane == "stress"
                else "-1 < poisson < 0.5 in plane strain"
            )
            raise ValueError(f"Material: poisson = {self.poisson!r} is outside its range ({limit})")

    isotropic = True

    @property
    def modulus(self) -> float:
        """Modulus that the elasticity matrix is scaled with, Pa."""
        return float(self.young)

    @property
    def elasticity(self) -> np.ndarray:
        """(3, 3) matrix D in units of `modulus`; strains are (xx, yy, 2 xy)."""
        nu = self.poisson
        if self.plane == "stress":
            return np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - nu)]]) / (1.0 - nu * nu)
        return np.array([[1.0 - nu, nu, 0.0], [nu, 1.0 - nu, 0.0], [0.0, 0.0, 0.5 - nu]]) / (
            (1.0 + nu) * (1.0 - 2.0 * nu)
        )

    def __repr__(self) -> str:
        return (
            f"Material(young={self.young:g} Pa, poisson={self.poisson:g}, density={self.density:g} kg/m^3, "
            f"plane={self.plane!r})"
        )


@dataclass(frozen=True)
class OrthotropicMaterial:
    """Orthotropic linear elastic material with its first principal axis turned by `angle`.

    Parameters
    ----------
    young_1, young_2, young_3 : float
        Young's moduli along the principal axes, Pa; axis 3 is normal to the plane and matters in plane strain
        only (`young_3` defaults to `young_2`).
    poisson_12, poisson_13, poisson_23 : float
        -eps_2 / eps_1 under stress along 1, and so on; the last two matter in plane strain only (default:
        `poisson_12`).
    shear_12 : float
        Shear modulus, Pa.
    density : float
        kg/m^3.
    angle : float
        From the x axis to principal axis 1, degrees, counter-clockwise.
    plane : {"stress", "strain"}
    """

    young_1: float
    young_2: float
    poisson_12: float
    shear_12: float
    density: float
    angle: float = 0.0
    plane: str = "stress"
    young_3: float | None = None
    poisson_13: float | None = None
    poisson_23: float | None = None

    def __post_init__(self) -> None:
        for name in ("young_1", "young_2", "shear_12"):
            positive("OrthotropicMaterial", name, getattr(self, name), "Pa")
        positive("OrthotropicMaterial", "density", self.density, "kg/m^3")
        _check_plane(self.plane)
        if self.young_3 is not None:
            positive("OrthotropicMaterial", "young_3", self.young_3, "Pa")
        for name in ("poisson_12", "angle", "poisson_13", "poisson_23"):
            value = getattr(self, name)
            if value is None and name in ("poisson_13", "poisson_23"):
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
                raise TypeError(f"OrthotropicMaterial: {name} = {value!r} is not a number")
            if not math.isfinite(value):
                raise ValueError(f"OrthotropicMaterial: {name} = {value!r} must be finite")
        if not np.linalg.eigvalsh(self._compliance())[0] > 0.0:
            raise ValueError(
                f"OrthotropicMaterial: poisson_12 = {self.poisson_12!r} with these moduli gives an "
                "indefinite elasticity; poisson_12^2 < young_1 / young_2 is needed (and the like for axis "
                "3)"
            )

    isotropic = False

    def _compliance(self) -> np.ndarray:
        """(4, 4) compliance of (11, 22, 33, 12)."""
        e3 = self.young_2 if self.young_3 is None else self.young_3
        nu13 = self.poisson_12 if self.poisson_13 is None else self.poisson_13
        nu23 = self.poisson_12 if self.poisson_23 is None else self.poisson_23
        s = np.diag([1.0 / self.young_1, 1.0 / self.young_2, 1.0 / e3, 1.0 / self.shear_12])
        s[0, 1] = s[1, 0] = -self.poisson_12 / self.young_1
        if self.plane == "strain":
            s[0, 2] = s[2, 0] = -nu13 / self.young_1
            s[1, 2] = s[2, 1] = -nu23 / self.young_2
        return s

    @property
    def modulus(self) -> float:
        """Modulus that the elasticity matrix is scaled with, Pa."""
        return float(max(self.young_1, self.young_2))

    @property
    def elasticity(self) -> np.ndarray:
        """(3, 3) matrix D in the x, y axes in units of `modulus`; strains are (xx, yy, 2 xy)."""
        if self.plane == "stress":
            principal = np.linalg.inv(self._compliance()[np.ix_([0, 1, 3], [0, 1, 3])])
        else:
            principal = np.linalg.inv(self._compliance())[np.ix_([0, 1, 3], [0, 1, 3])]
        c, s = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
        # strains of the principal axes from those of x, y
        turn = np.array(
            [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
        )
        return turn.T @ principal @ turn / self.modulus


def _check_plane(plane: str) -> None:
    if plane not in ("stress", "strain"):
        raise ValueError(f'plane = {plane!r} is unknown; use "stress" or "strain"')
