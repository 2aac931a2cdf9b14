"""Runs that would need more memory or disk than there is are refused before they start, with the size in the
sentence; what is told is what is taken.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys

import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc import capacity
from sbfem_petsc.study.sweep import sweep
from tests.parallel import ROOT
from tests.study.small_case import CASE, SWEEP, sbfem, written
from tests.systems import two_masses

TOLD = r"{owner}: .* would take [0-9.e+]+ ([kMGT]B|bytes) of memory, [0-9.]+ ([kM]B|bytes) are free; .+"
PUSH = sb.PointForce("A", fy=10.0)
STARTS = [sb.StartAxis(list(map(float, range(10_000))))]
TONES = [sb.Harmonic(0.1, 0.09) + sb.Harmonic(0.1, 0.013)]

# Of a reduced model, whose own arrays alone count.
REDUCED = {
    "transient": lambda system: sb.transient(system, [sb.Harmonic(0.1, 0.1)], 1e4, 0.01, decimation=1),
    "periodic": lambda system: sb.periodic(system, [0.1], 0.092, steps=10**7),
    "frequency_response": lambda system: sb.frequency_response(system, [0.1], 0.09, 0.1, points=10**6),
    "load_response": lambda system: sb.load_response(system, [0.1], 0.09, points=10**6),
    "swept_response": lambda system: sb.swept_response(system, [0.1], 0.09, 0.1, duration=1e5),
    "backbone": lambda system: sb.backbone(system, 1, 1e-3, 2e-3, points=10**6),
    "quasi_periodic": lambda system: sb.quasi_periodic(system, TONES, (0.09, 0.013), samples=10**4),
    "basins": lambda system: sb.basins(system, [0.1], 0.092, STARTS, steps=64),
}
# Of a structure: matrices and factors -> the owner of the sentence.
STRUCTURES = {
    "modal": lambda model: sb.modal(model, 4),
    "modal in a band": lambda model: sb.modal(model, band=(10.0, 5000.0)),
    "static": lambda model: sb.static(model, PUSH),
    "load_history": lambda model: sb.load_history(model, PUSH, [0.0] * 1000),
    "transient": lambda model: sb.transient(model, PUSH, 1e-4, 1e-5, reduction=None, modes=4),
    "periodic": lambda model: sb.periodic(model, PUSH, 700.0, reduction=None, steps=10**6),
    "modal of reduce": lambda model: sb.reduce(model, PUSH, modes=4),
}


@pytest.mark.parametrize("owner", REDUCED)
def test_reduced_models(owner, monkeypatch):
    """Half a megabyte is free: the system itself fits, so much of it does not."""
    monkeypatch.setattr(capacity, "available_memory", lambda: 500_000)
    with pytest.raises(ValueError, match=TOLD.format(owner=owner)):
        REDUCED[owner](two_masses(0.02))


@pytest.mark.parametrize("case", STRUCTURES)
def test_structures(case, monkeypatch):
    model = sb.Model(
        Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.001)]).mesh(order=1, face_edges=2),
        sb.Material(70e9, 0.33, 2700),
        damping=0.02,
        rayleigh=(0.0, 1e-6),
    )
    monkeypatch.setattr(capacity, "available_memory", lambda: 5000)
    with pytest.raises(ValueError, match=TOLD.format(owner=case.split()[0])):
        STRUCTURES[case](model)


@pytest.mark.parametrize("kind", ["run", "sweep"])
def test_a_case_larger_than_the_disk(kind, tmp_path, monkeypatch):
    """Told before anything is computed, and nothing is left but the folder."""
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(capacity.shutil, "disk_usage", lambda folder: usage._replace(free=100))
    path = written(tmp_path, CASE + SWEEP)
    told = r"would take [0-9.]+ kB of disk, 90 bytes are free in .*(keep fewer instants|rows fit)"
    if kind == "sweep":
        with pytest.raises(ValueError, match="sweep: 6 rows " + told):
            sweep(path, output=tmp_path / "out")
        return
    done = sbfem("run", path, "--output", tmp_path / "out", "--quiet")
    assert done.code == 2 and re.search(told, done.err), done.err


@pytest.mark.long
@pytest.mark.parametrize(
    "case", ["static", "modal", "unreduced", "transient", "periodic", "quasi_periodic", "basins"]
)
def test_what_is_told_is_what_is_taken(case):
    """The estimate and the peak of the resident memory are within a factor of two of each other."""
    command = [sys.executable, "-m", "tests.analysis.memory_program", case]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    expected = max(found["expected"].values())
    assert 0.5 < expected / found["taken"] < 2.0, found
