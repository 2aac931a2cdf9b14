"""What `sbfem check` expects of memory, against peaks that `benchmarks/plate.py` measured."""

import json

import pytest

import sbfem_petsc as sb
from meshing import Beam
from sbfem_petsc.study.costs import Size
from sbfem_petsc.study.estimates import model_memory
from sbfem_petsc.study.kinds.swept_response import SweptResponse
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


def test_a_swept_response_keeps_both_directions():
    """Its numbers in both of a run's files, of a point along x and y."""
    model = sb.Model(Beam(0.1, 0.01).mesh(order=2), sb.Material(70e9, 0.33, 2700), damping=0.02)
    asked = {"start": 400.0, "stop": 500.0, "duration": 0.05, "steps": 64, "modes": 4}
    found = sb.swept_response(model, sb.PointForce("A", fy=1.0), **asked)
    kept = [found.frequency, found.contact_peak, found.point_amplitudes, found.x_amplitudes]
    kind = SweptResponse(kind="swept_response", load="push", back=False, **asked)
    cost = kind.cost(Size(None, model.unknowns, 0, len(found.points)))
    assert cost.disk == pytest.approx(2 * sum(part.nbytes for part in kept), rel=0.1)
    assert cost.memory == 8 * (0.05 * 500 * 64) * (2 + 1)
    assert kind.model_copy(update={"back": True}).cost(Size(None, model.unknowns, 0, 1)).disk == 2 * cost.disk
