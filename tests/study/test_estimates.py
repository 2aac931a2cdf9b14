"""What `sbfem check` expects of memory, against peaks that `benchmarks/plate.py` measured."""

import json

import pytest

from sbfem_petsc.study.estimates import model_memory
from tests.parallel import ROOT

MEASURED = json.loads((ROOT / "benchmarks/memory.json").read_text())
CASES = [(row, kind) for row in MEASURED for kind in ("static", "modal") if f"{kind}_MB_a_rank" in row]


@pytest.mark.parametrize(
    "row, kind", CASES, ids=lambda v: v if isinstance(v, str) else f"{v['boundary_unknowns']}-{v['ranks']}"
)
def test_memory_is_never_below_the_measured(row, kind):
    """Between the peaks of all ranks together and one and a half times that."""
    measured = 2**20 * row["ranks"] * row[f"{kind}_MB_a_rank"]
    expected = model_memory(kind, row["boundary_unknowns"], ranks=row["ranks"])
    assert measured < expected < 1.5 * measured
