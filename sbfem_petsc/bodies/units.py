"""Units of bodies of other codes, and a warning of those that no solid has."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.warnings import UnitWarning

from ..errors import warn

# m, N/m and kg in one unit of length, stiffness and mass.
UNITS = {"SI": (1.0, 1.0, 1.0), "mm-N-t": (1e-3, 1e3, 1e3), "mm-kg-mN": (1e-3, 1.0, 1.0)}
# m/s and kg/m^3: speeds of waves as the matrices tell them, within 1.5 of sqrt(E / density) of solid elements
# (50 to 18,000 m/s), and what no solid weighs.
SLOWEST, FASTEST, HEAVIEST = 10.0, 1e5, 3e4


def warn_of_units(
    owner: str, units: str, diagonals: tuple[np.ndarray, np.ndarray], places: np.ndarray, weight: float
) -> None:
    """Warn of waves and densities that no solid has.

    Parameters
    ----------
    diagonals : (n,), (n,) arrays
        N/m and kg of displacements: sqrt(K_ii / M_ii) is about 3 c over the spacing of nodes in elements of
        first and second order.
    places : (m, 3) array
        m, of the nodes.
    weight : float
        kg.
    """
    stiffness, mass = (diagonal[diagonals[1] > 0.0] for diagonal in diagonals)
    far = tree_of(places).query(places, min(4, len(places)))[0].reshape(len(places), -1)
    far = np.where(far > 0.0, far, np.inf).min(axis=1)  # of nodes that lie in one place to the next
    far, said = far[np.isfinite(far)], []
    if len(far) and len(mass):
        speed = np.sqrt(np.median(stiffness / mass)) * np.median(far) / 3.0
        if not SLOWEST <= speed <= FASTEST:
            said.append(f"waves run at about {speed:.3g} m/s, {SLOWEST:g} to {FASTEST:g} m/s are usual")
    box = float(np.prod(np.ptp(places, axis=0)))
    if box > 0.0 and weight > HEAVIEST * box:
        said.append(f"a mass of {weight:.3g} kg in {box:.3g} m^3 is more than any solid's")
    if said:
        warn(
            f"{owner}: {' and '.join(said)}; are units = {units!r} those of the matrices and nodes?",
            UnitWarning,
        )


def tree_of(places: np.ndarray) -> Any:
    """What finds nearest places; loaded where it is needed, for analyses of models know of bodies, too."""
    from scipy.spatial import cKDTree

    return cKDTree(places)
