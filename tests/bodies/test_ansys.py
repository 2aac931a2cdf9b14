"""A file of Ansys' own, that `ansys-mapdl-reader` brings: a beam of 1 x 1 x 5 in, clamped at one end."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import sbfem_petsc as sb

# Young's modulus, Poisson's ratio and density of the example, lbf, in and s.
YOUNG, POISSON, DENSITY, LENGTH = 16.9e6, 0.31, 4.14e-4, 5.0


@pytest.fixture
def example():
    pytest.importorskip("ansys.mapdl.reader")
    from ansys.mapdl.reader import Archive, examples

    mesh = Archive(examples.hexarchivefile)
    return examples.fullfile, dict(zip(mesh.nnum.tolist(), mesh.nodes.tolist()))


def test_frequencies_in_closed_form(example):
    """Two in bending with shear (Timoshenko), in torsion and along: 1 %, the clamp holds Poisson's
    contraction too.
    """
    file, nodes = example
    body = sb.read_matrices(file, file, nodes)
    assert len(body.unknowns) == 900 and len(body.fixed) == 63
    assert all(body.places[body._node[label], 2] == 0.0 for label, _ in body.fixed)
    bending = 1.8751041**2 / (2 * np.pi) * np.sqrt(YOUNG / 12 / DENSITY) / LENGTH**2
    shear = 1 + 0.5 * (1.8751041 / LENGTH) ** 2 / 12 * (1 + YOUNG / (5 / 6 * YOUNG / 2 / (1 + POISSON)))
    torsion = np.sqrt(0.1406 * 6 * YOUNG / 2 / (1 + POISSON) / DENSITY) / (4 * LENGTH)
    along = np.sqrt(YOUNG / DENSITY) / (4 * LENGTH)
    tip = body.at((0.0, 0.0, 5.0), "x")
    found = sb.reduce(body, loads={"F": tip}, points={"tip": tip}, modes=6).frequencies
    assert found[[0, 1, 2, 5]] == pytest.approx([bending / shear, bending / shear, torsion, along], rel=0.01)


def test_wrong_files(example, tmp_path):
    """One that is none of Ansys', and nodes of another body."""
    none = tmp_path / "none.full"
    none.write_bytes(b"\x00" * 500)
    with pytest.raises(ValueError, match="none.full is missing or cut") as raised:
        sb.read_matrices(none, none, example[1])
    assert "\n" not in str(raised.value)
    with pytest.raises(ValueError, match="unknowns has node .*, which the body has not"):
        sb.read_matrices(example[0], example[0], {1: (0.0, 0.0, 0.0)})


def test_without_the_library(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ansys.mapdl.reader", None)
    file = tmp_path / "some.full"
    file.write_bytes(b"\x00" * 500)
    with pytest.raises(ValueError, match="nor .full of Ansys, by ansys-mapdl-reader"):
        sb.read_matrices(file, file, {1: (0.0, 0.0, 0.0)})
