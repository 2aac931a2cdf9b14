"""Runs that would need more memory or disk than there is are refused before they start, with the size in the
sentence; what is told is what is taken.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, Plate, VNotch
from sbfem_petsc.continuation import harmonic_errors
from sbfem_petsc.petsc import MPI, PETSc
from sbfem_petsc.ranks import capacity
from sbfem_petsc.study.sweep import sweep
from sbfem_petsc.system.solve import demand
from sbfem_petsc.system.solve.demand import factor_memory, matrix_entries, require_modes
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
    monkeypatch.setattr(capacity, "FEW", 10**6)
    with pytest.raises(ValueError, match=TOLD.format(owner=owner)):
        REDUCED[owner](two_masses(0.02))


def test_a_branch_takes_what_points_there_is_room_for(monkeypatch):
    """More of them may be asked for than would ever fit; the branch that is short enough is found whole."""
    monkeypatch.setattr(capacity, "room", lambda comm, each, beside: 60)
    system = two_masses(0.02)
    branch = sb.frequency_response(system, [0.001], 0.09, 0.1, points=10**6)
    assert branch.complete and len(branch.value) < 60
    with pytest.warns(sb.BranchWarning, match="after 60 points.* no memory for more"):
        branch = sb.frequency_response(system, [0.001], 0.09, 0.1, points=10**6, largest_step=1e-4)
    assert len(branch.value) == 60 and not branch.complete


def test_room(monkeypatch):
    monkeypatch.setattr(capacity, "available_memory", lambda: 1000)
    assert capacity.room(MPI.COMM_SELF, 10.0, 100.0) == 80
    assert capacity.room(MPI.COMM_SELF, 1e-300) == 10**9


@pytest.mark.parametrize(
    "tree, left",
    [
        # version 2: caches of files are given up, those of shared memory are not; the group above counts
        (
            {
                "proc/self/cgroup": "0::/above/own\n",
                "sys/fs/cgroup/above/memory.max": "5000\n",
                "sys/fs/cgroup/above/memory.current": "4500\n",
                "sys/fs/cgroup/above/memory.stat": "anon 500\nfile 4000\nshmem 1000\nactive_file 1000\n"
                "inactive_file 2000\n",
                "sys/fs/cgroup/above/own/memory.max": "max\n",
                "sys/fs/cgroup/above/own/memory.current": "4500\n",
            },
            3500,
        ),
        # version 1, in a container that sees the path of its host
        (
            {
                "proc/self/cgroup": "5:cpu,cpuacct:/docker/1a\n4:memory:/docker/1a\n",
                "sys/fs/cgroup/memory/memory.limit_in_bytes": "2000\n",
                "sys/fs/cgroup/memory/memory.usage_in_bytes": "1800\n",
                "sys/fs/cgroup/memory/memory.stat": "inactive_file 0\ntotal_inactive_file 700\n",
            },
            900,
        ),
        ({"proc/self/cgroup": "0::/\n"}, float("inf")),
        ({}, float("inf")),
    ],
)
def test_control_groups(tree, left, tmp_path):
    for name, text in tree.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert capacity.control_group_memory(str(tmp_path)) == left


def test_a_system_that_does_not_tell_its_free_pages(monkeypatch):
    """As macOS: there is no /proc, and of the pages their number alone is known."""

    def nothing(*_, **__):
        raise FileNotFoundError

    def known(name):
        if name == "SC_AVPHYS_PAGES":
            raise ValueError("unrecognized configuration name")
        return {"SC_PHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}[name]

    monkeypatch.setattr(capacity, "open", nothing, raising=False)
    monkeypatch.setattr(capacity.os, "sysconf", known)
    assert capacity.machine_memory() == 4096000


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


def test_a_factor_and_what_it_is_made_of(monkeypatch):
    """A matrix is a value and the number of a column an entry; MUMPS is given a value and two numbers of each
    entry of one half. What is left goes with N log2 N. PETSc's own matrix has no more entries than are told;
    modes take two like it, of the stiffness and of the mass, beside the factor and vectors.
    """
    needed: list[float] = []
    monkeypatch.setattr(demand, "require_memory", lambda owner, comm, size, *_: needed.append(size))
    value, number = (np.dtype(kind).itemsize for kind in (PETSc.ScalarType, PETSc.IntType))
    given = (value + number) + 0.5 * (value + 2 * number)
    factors = []
    for size in (0.5, 0.2):
        plate = Plate([(0, 0), (1, 0), (1, 1), (0, 1)]).mesh(order=2, size=size)
        model = sb.Model(plate, sb.Material(70e9, 0.33, 2700), clamped="edge1")
        entries, unknowns = matrix_entries(model.cells), model.boundary_unknowns
        used = model.stiffness.getInfo()["nz_used"]
        assert used <= entries < 2 * used
        require_modes(model.cells, 4, 10)
        matrices = needed.pop() - factor_memory(model.cells) - 8 * unknowns * (10 + 4 * 4)
        assert 2 * used <= matrices / (value + number) < 4 * used
        factors.append((factor_memory(model.cells) - given * entries) / (unknowns * np.log2(unknowns + 1)))
    assert factors[0] == pytest.approx(factors[1], rel=1e-12) and factors[0] > value


@pytest.mark.parametrize("kind", ["run", "sweep"])
def test_a_case_larger_than_the_disk(kind, tmp_path, monkeypatch):
    """Told before anything is computed, and nothing is left but the folder."""
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(capacity.shutil, "disk_usage", lambda folder: usage._replace(free=100))
    path = written(tmp_path, CASE + SWEEP)
    told = r"would take [0-9.]+ (kB|bytes) of disk, 90 bytes are free in .*(keep fewer instants|rows fit)"
    if kind == "sweep":
        with pytest.raises(ValueError, match="sweep: 6 rows " + told):
            sweep(path, output=tmp_path / "out")
        return
    done = sbfem("run", path, "--output", tmp_path / "out", "--quiet")
    assert done.code == 2 and re.search(told, done.err), done.err


@pytest.mark.long
@pytest.mark.parametrize(
    "case",
    ["static", "load_history", "modal", "unreduced", "transient", "periodic", "quasi_periodic", "basins"],
)
def test_what_is_told_is_what_is_taken(case):
    """The estimate and the peak of the resident memory are within a factor of two of each other. What is
    looked at for the motions that tell errors includes a derivative that is seldom made.
    """
    command = [sys.executable, "-m", "tests.analysis.memory_program", case]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    expected = max(v for name, v in found["expected"].items() if name != harmonic_errors.OWNER)
    assert 0.5 < expected / found["taken"] < 2.0, found
