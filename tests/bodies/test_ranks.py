"""A body that two ranks reduce together: the numbers of SciPy's dense matrices, errors on both."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

import sbfem_petsc as sb
from tests.parallel import answer, on_ranks

FILES = Path(__file__).parent / "calculix"
PROGRAM = """
import json, sys
import sbfem_petsc as sb
from mpi4py import MPI
from scipy.sparse import csr_matrix

body = sb.read_calculix(sys.argv[1])
tip = body.at((0.08, 0.01, 0.01), "z")
given = dict(loads={"F": tip}, points={"tip": tip}, modes=12)
rom = sb.reduce(body, contact=body.contact("LEFT", "RIGHT", normal="x", gap=1e-6), damping=0.01, **given)
orbit = sb.periodic(rom, 12.0, 2930.0)
one = csr_matrix([[1.0]])  # of which one rank has no row
stop = dict(contact_rows=one, gap=[0.0], loads=one, sensors={"mass": 0}, compliance=[1e-6])
single = sb.reduce_matrices(one, 4e4 * one, **stop, comm=MPI.COMM_WORLD)
found = {
    "ranks": rom.comm.size,
    "frequencies": rom.frequencies.tolist(),
    "single": float(single.omega[0]),
    "flexibility": (rom.gap.contact + (rom.gap.modes / rom.omega**2) @ rom.gap.modes.T).tolist(),
    "static": float(sb.static(rom, 800.0).displacement("tip")),
    "harmonics": abs(orbit.harmonics("tip"))[:4].tolist(),
}
for change in (-1.0, 1.0 + MPI.COMM_WORLD.rank):
    parts = body.mass, change * body.stiffness, body.unknowns, dict(zip(body.labels, body.places))
    try:
        sb.reduce(sb.FiniteElementModel(*parts) if change > 0 else body, damping=change, **given)
    except (ValueError, sb.SolveError) as error:
        found.setdefault("errors", []).append(str(error))
told = MPI.COMM_WORLD.gather(found)
if told is not None:
    print("\\n" + json.dumps({"told": told}), flush=True)
"""


@pytest.mark.long
def test_two_ranks_beside_dense():
    """Frequencies and flexibility of the gaps by SciPy; statics and harmonics of dense matrices; another
    body on rank 1 is told of on both.
    """
    body = sb.read_calculix(FILES / "blocks")
    k, m = body.stiffness.toarray(), body.mass.toarray()
    crack, tip = body.contact("LEFT", "RIGHT", normal="x", gap=1e-6), body.at((0.08, 0.01, 0.01), "z")
    rows, f = crack.rows.toarray(), tip.weights.toarray()
    dense = sb.reduce_matrices(
        m, k, rows, crack.gap, loads=f.T, sensors={"tip": f[0]}, modes=12, damping=0.01
    )
    told = answer(on_ranks(2, PROGRAM, str(FILES / "blocks")))["told"]
    assert len(told) == 2 and told[0] == told[1] and told[0]["ranks"] == 2
    found = told[0]
    own = np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)[:12]) / (2 * np.pi)
    assert found["single"] == pytest.approx(200.0, rel=1e-12)
    assert found["frequencies"] == pytest.approx(own, rel=1e-9)
    assert np.array(found["flexibility"]) == pytest.approx(rows @ np.linalg.solve(k, rows.T), rel=1e-8)
    assert found["static"] == pytest.approx(float(sb.static(dense, 800.0).displacement("tip")), rel=1e-7)
    right = abs(sb.periodic(dense, 12.0, 2930.0).harmonics("tip"))[:4]
    assert np.abs(found["harmonics"] - right).max() < 1e-6 * right.max()
    assert len(found["errors"]) == 2 and "model differs between the ranks" in found["errors"][1]
