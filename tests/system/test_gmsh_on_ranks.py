"""A gmsh model read on every rank: the process in which gmsh works must not take itself for a rank."""

import pytest

from tests.parallel import answer, on_ranks

PROGRAM = """
import json, sys
from pathlib import Path
from mpi4py import MPI
from meshing import read_gmsh

comm, path = MPI.COMM_WORLD, Path(sys.argv[1])
sums = comm.allgather(float(read_gmsh(path, order=2).nodes.sum()))
try:
    read_gmsh(path.with_name("bad.geo"), order=2)
except ValueError as error:
    said = comm.allgather(str(error))
if comm.rank == 0:
    print(json.dumps({"sums": sums, "said": said}))
"""


@pytest.mark.long
def test_two_ranks(tmp_path):
    square = 'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1};\nMesh.MeshSizeMax = 0.3;\n'
    (tmp_path / "good.geo").write_text(square + 'Physical Surface("steel") = {1};\n')
    (tmp_path / "bad.geo").write_text(square)
    result = answer(on_ranks(2, PROGRAM, str(tmp_path / "good.geo"), timeout=300))
    assert len(set(result["sums"])) == 1 and len(result["sums"]) == 2
    assert len(set(result["said"])) == 1 and "no physical surfaces" in result["said"][0]
