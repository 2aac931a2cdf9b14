"""The iterative solvers that the documentation recommends, against the direct one."""

import json
import re

import numpy as np
import pytest

from tests.parallel import ROOT, answer, on_ranks

PAGE = (ROOT / "docs/cluster.md").read_text()
SETS = {
    re.search(r"_pc_type (\w+)", line).group(1): line
    for line in re.findall(r"^-static_ksp_type .*$", PAGE, re.M)
}
PROGRAM = """
import json, sys, warnings
import petsc4py
petsc4py.init(["x"])
from petsc4py import PETSc
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from meshing import CrackLine, Plate
comm, options = MPI.COMM_WORLD, PETSc.Options()
body = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=[CrackLine([(0.03, 0.045), (0.07, 0.055)])])
mesh = sb.on_root(comm, lambda: body.mesh(order=3, size=0.012, face_edges=2, tip_element=False))
found = {}
for name, chosen in [("direct", ""), *json.loads(sys.argv[1]).items()]:
    options.insertString(chosen)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), clamped="edge1")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        solved = sb.static(model, sb.EdgeLoad("edge3", pressure=1e6, tx=8e5))
    owned = solved.equilibrium.owned
    exact = owned if name == "direct" else exact
    off, size = (comm.allreduce(np.abs(part).max(initial=0.0), MPI.MAX) for part in (owned - exact, exact))
    found[name] = {
        "off": off / size,
        "solver": solved.solver,
        "iterations": model.solver.ksp.getIterationNumber(),
        "force": solved.contact_force.tolist(),
        "told": [str(item.message) for item in told],
    }
    model.destroy()
    for word in chosen.split():
        if word.startswith("-"):
            options.delValue(word)
if comm.rank == 0:
    print(json.dumps(found))
"""


@pytest.mark.long
def test_documented_sets_solve_as_the_direct_solver():
    """On two ranks, where domain decomposition has two subdomains: 1e-12 of the residual is asked for, which
    the condition of the stiffness, some 1e4, turns into 1e-8 of the displacements at most.
    """
    from sbfem_petsc.petsc import PETSc

    assert set(SETS) == {"gamg", "hypre", "bddc"}
    chosen = {n: line for n, line in SETS.items() if n != "hypre" or PETSc.Sys.hasExternalPackage("hypre")}
    # the direct solver, with forces that are iterated for instead of a matrix of the contact rows
    chosen["dual"] = "-contact_dual"
    found = answer(on_ranks(2, PROGRAM, json.dumps(chosen)))
    direct = found.pop("direct")
    assert sum(force > 0.0 for force in direct["force"]) > 3 and not direct["told"]
    assert set(found) == set(chosen)
    for name, one in found.items():
        np.testing.assert_allclose(one["force"], direct["force"], atol=1e-8 * max(direct["force"]))
        if name == "dual":
            assert one["off"] < 1e-8 and one["solver"] == direct["solver"]
            continue
        assert one["solver"] == f"cg + {name}"
        assert one["off"] < 1e-8 and 1 < one["iterations"] < 40, (name, one)
        # so few unknowns are no case for an iterative solver, and that is said
        assert any("direct solver" in text for text in one["told"]), one["told"]
