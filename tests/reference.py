"""Converged values of an independent hp finite element code (examples/reference/reference.json) and the
paper's beam.
"""

import json
import pathlib

import numpy as np

from meshing import Beam, VNotch

DATA = json.loads(
    (pathlib.Path(__file__).parents[1] / "examples" / "reference" / "reference.json").read_text()
)


def frequencies(case: str) -> np.ndarray:
    """Natural frequencies of a case, Hz."""
    return np.array(DATA["modes"][case]["frequency_Hz"])


def statics(case: str, load: str) -> dict:
    """Static contact solution of a case under a load such as "100 N"."""
    return DATA["static"][case]["contact"][load]


def paper_beam(opening: float = 0.0458366) -> Beam:
    """Case P of the paper: 400 x 5 mm, tip at 80 mm, depth 2.5 mm, mouth 2.000 micrometres."""
    return Beam(0.400, 0.005, (VNotch(0.080, 0.0025, opening),))
