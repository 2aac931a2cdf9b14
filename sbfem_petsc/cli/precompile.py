"""Compiles all kernels before an analysis asks for them: ``python -m sbfem_petsc.cli.precompile``, once after
an installation; they are kept where `contact.compiled.compiled` says.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.beam import Beam
from meshing.shapes.features import VNotch

from ..analysis.basins import basins
from ..analysis.response import load_response
from ..analysis.transient import transient
from ..contact.law import Coulomb
from ..contact.precompile import compile_kernels
from ..loads import PointForce
from ..material import Material
from ..reduction.matrices import reduce_matrices
from ..signals.waves import Harmonic
from ..system.model import Model


def compile_all() -> None:
    """Those of the time steps, which most analyses ask for, first; others by the shortest calls of theirs."""
    compile_kernels()
    one = np.eye(1)
    stop = np.ones(1)
    mass = reduce_matrices(
        one, one, one, stop, loads=one, sensors={"x": 0}, damping=0.2 * one, compliance=stop
    )
    rubs: dict[str, Any] = {"contact_laws": Coulomb(0.1), "tangent_rows": one, "tangent_compliance": stop}
    slider = reduce_matrices(one, one, one, stop, loads=one, sensors={"x": 0}, compliance=stop, **rubs)
    load_response(slider, [Harmonic(0.1, 0.2)], 0.2, 1.0, stop=1.001, steps=64, progress=None)
    basins(mass, [Harmonic(0.1, 0.2)], 0.2, (one, one), steps=64)
    beam = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.0)]).mesh(order=1)
    with Model(beam, Material(70e9, 0.33, 2700)) as model:
        push = PointForce("A", fy=Harmonic(1.0, 1e4))
        transient(model, push, 1e-5, 1e-6, reduction=None, progress=None)


if __name__ == "__main__":
    compile_all()
