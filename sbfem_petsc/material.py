"""Linear elastic materials in the plane, validated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np

from meshing.input_checks import check_said

from .checks import Bounds, real, said

# Moduli (Pa) and densities (kg/m^3) beyond these are slips of units; their products would leave the numbers'
# range.
LEAST, MOST = 1e-30, 1e30
PLANES = ("stress", "strain")
_PLANE = said("plane stress or plane strain", one_of=PLANES)


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

    young: float = field(metadata=said("Young's modulus", "Pa", gt=0))
    poisson: float = field(metadata=said("Poisson's ratio", gt=-1, le=0.5))
    density: float = field(metadata=said("density", "kg/m^3", gt=0))
    plane: str = field(default="stress", metadata=_PLANE)

    def __post_init__(self) -> None:
        check_said(self)
        _require_usual(self, "young", "density")
        if self.plane == "strain" and self.poisson == 0.5:
            raise ValueError("Material: poisson = 0.5 must be above -1 and below 0.5 in plane strain")

    isotropic = True
    densities = None  # of sectors, relative to `density`

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


_ANGLE = said("from the x axis to axis 1, counter-clockwise", "degree")
_NORMAL = said("normal to the plane, plane strain only; default: young_2", "Pa", gt=0)
_OUT_OF_PLANE = said("plane strain only; default: poisson_12")


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

    young_1: float = field(metadata=said("Young's modulus along axis 1", "Pa", gt=0))
    young_2: float = field(metadata=said("Young's modulus along axis 2", "Pa", gt=0))
    poisson_12: float = field(metadata=said("-eps_2 / eps_1 under stress along 1"))
    shear_12: float = field(metadata=said("shear modulus", "Pa", gt=0))
    density: float = field(metadata=said("density", "kg/m^3", gt=0))
    angle: float = field(default=0.0, kw_only=True, metadata=_ANGLE)
    plane: str = field(default="stress", kw_only=True, metadata=_PLANE)
    young_3: float | None = field(default=None, kw_only=True, metadata=_NORMAL)
    poisson_13: float | None = field(default=None, kw_only=True, metadata=_OUT_OF_PLANE)
    poisson_23: float | None = field(default=None, kw_only=True, metadata=_OUT_OF_PLANE)

    def __post_init__(self) -> None:
        check_said(self)
        _require_usual(self, "young_1", "young_2", "young_3", "shear_12", "density")
        if not np.linalg.eigvalsh(self.compliance())[0] > 0.0:
            raise ValueError(
                f"OrthotropicMaterial: poisson_12 = {self.poisson_12!r} with these moduli gives an "
                "indefinite elasticity; poisson_12^2 < young_1 / young_2 is needed (and the like for axis "
                "3)"
            )

    isotropic = False
    densities = None

    def compliance(self) -> np.ndarray:
        """(4, 4) compliance of (11, 22, 33, 12), 1/Pa; in plane stress nothing is coupled with 33."""
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
        principal = np.linalg.inv(self.compliance())[np.ix_([0, 1, 3], [0, 1, 3])]
        c, s = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
        # strains of the principal axes from those of x, y
        turn = np.array(
            [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
        )
        return turn.T @ principal @ turn / self.modulus


@dataclass(frozen=True)
class SectorMaterials:
    """Materials of the sectors of one S-element, as one material.

    Attributes
    ----------
    parts : tuple of Material or OrthotropicMaterial
        Of the sector that each edge spans with the scaling centre.
    """

    parts: tuple[Material | OrthotropicMaterial, ...]

    # turned and reflected copies of an outline have their materials elsewhere
    isotropic = False

    @property
    def modulus(self) -> float:
        """Pa."""
        return max(part.modulus for part in self.parts)

    @property
    def density(self) -> float:
        """kg/m^3."""
        return max(part.density for part in self.parts)

    @property
    def elasticity(self) -> np.ndarray:
        """(edges, 3, 3): D of each sector in units of `modulus`."""
        return np.stack([part.elasticity * (part.modulus / self.modulus) for part in self.parts])

    @property
    def densities(self) -> np.ndarray:
        """(edges,): densities in units of `density`."""
        return np.array([part.density for part in self.parts]) / self.density


AnyMaterial = Material | OrthotropicMaterial | SectorMaterials


def _require_usual(material: Material | OrthotropicMaterial, *names: str) -> None:
    """Raise ValueError unless moduli and densities are of a size that can be computed with."""
    for own in fields(material):
        value = getattr(material, own.name)
        if own.name in names and value is not None:
            within = Bounds(least=LEAST, most=MOST)
            real(type(material).__name__, own.name, value, own.metadata["unit"], within=within)
