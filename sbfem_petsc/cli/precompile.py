"""Compiles all kernels before an analysis asks for them: ``python -m sbfem_petsc.cli.precompile``, once after
an installation; they are kept where `contact.compiled.compiled` says.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import sbfem_petsc as sb
from meshing.beam import Beam
from meshing.shapes.features import VNotch

from ..contact.precompile import compile_kernels


def compile_all() -> None:
    """Those of the time steps, which most analyses ask for, first; others by the shortest calls of theirs."""
    compile_kernels()
    one = np.eye(1)
    stop = np.ones(1)
    mass = sb.reduce_matrices(
        one, one, one, stop, loads=one, sensors={"x": 0}, damping=0.2 * one, compliance=stop
    )
    rubs: dict[str, Any] = {"contact_laws": sb.Coulomb(0.1), "tangent_rows": one, "tangent_compliance": stop}
    slider = sb.reduce_matrices(one, one, one, stop, loads=one, sensors={"x": 0}, compliance=stop, **rubs)
    sb.load_response(slider, [sb.Harmonic(0.1, 0.2)], 0.2, 1.0, stop=1.001, steps=64, progress=None)
    sb.basins(mass, [sb.Harmonic(0.1, 0.2)], 0.2, (one, one), steps=64)
    beam = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.0)]).mesh(order=2)
    with sb.Model(beam, sb.Material(70e9, 0.33, 2700)) as model:
        push = sb.PointForce("A", fy=sb.Harmonic(1.0, 1e4))
        sb.transient(model, push, 1e-5, 1e-6, reduction=None, progress=None)


if __name__ == "__main__":
    compile_all()
