"""What an S-element is made of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Sectors(NamedTuple):
    """Sectors that the edges of a boundary span with the scaling centre.

    Attributes
    ----------
    shape : (nodes, 2) array
        Boundary nodes about the scaling centre, counter-clockwise, in units of the S-element's size; from
        face to face of an open one.
    order : int
    elasticity : (3, 3) or (edges, 3, 3) array
        D in units of the modulus, of all sectors or of each.
    """

    shape: np.ndarray
    order: int
    elasticity: np.ndarray
