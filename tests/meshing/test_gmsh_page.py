"""docs/gmsh_models.md: its example gives what it prints, and its statements hold (the others are held by
test_users_models.py and test_hostile_files.py, whose cases they are).
"""

import re
from pathlib import Path

import numpy as np
import pytest

from meshing import read_gmsh
from meshing.gmsh.files import KNOWN
from meshing.warnings import LARGEST

PAGE = Path(__file__).parents[2] / "docs" / "gmsh_models.md"


def block(language):
    """Text of the first block of code in a language."""
    return re.search(rf"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    (folder / "plate.geo").write_text(block("geo"))
    return folder / "plate.geo"


@pytest.mark.slow
def test_the_example(model, monkeypatch, capsys):
    """Printed as on the page; lengths and places are those drawn, the mesh's counts are gmsh's affair."""
    monkeypatch.chdir(model.parent)
    exec(block("python"), {})
    printed, shown = capsys.readouterr().out.splitlines(), block("text").splitlines()
    counted = "S-elements|edges|displ|nodes|contact"
    counts = re.compile(rf"(?<![.\w-])\d+(?= (?:{counted}))|S-element \d+|of [\d.e-]+ to [\d.e-]+ m$")
    assert [counts.sub("#", line) for line in printed] == [counts.sub("#", line) for line in shown]
    mesh = read_gmsh(model, order=5, scale=1e-3)
    assert mesh.area == pytest.approx(0.12 * 0.04 - np.pi * 0.008**2, rel=1e-9)
    assert mesh.cracks[0].length == pytest.approx(0.018) and mesh.tips[0].position == pytest.approx(
        (0.04, 0.022)
    )
    assert mesh.nodes[mesh.points["P"]] == pytest.approx([0.12, 0.04])


def test_numbers_on_the_page():
    import inspect

    defaults = {name: item.default for name, item in inspect.signature(read_gmsh).parameters.items()}
    text = " ".join(PAGE.read_text().split())
    assert defaults["max_unknowns"] == 1_000_000 and "(one million)" in text
    assert f"time_limit={defaults['time_limit']}" in text
    assert f"larger than {LARGEST:g} m is warned of" in text
    assert all(f"`{ending}`" in text for ending in KNOWN)
    assert defaults["trust"] is False and "`trust=True`" in text


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("binary", [0, 1])
def test_mesh_files(model, tmp_path, version, binary):
    """Versions 2 and 4, ASCII and binary, give one mesh."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.merge(str(model))
        gmsh.model.mesh.generate(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(tmp_path / "plate.msh"))
    finally:
        gmsh.finalize()
    mesh = read_gmsh(tmp_path / "plate.msh", order=2, scale=1e-3)
    assert set(mesh.edge_sets) == {"clamp", "load", "hole", "c_right", "c_left"}
    assert list(mesh.points)[0] == "P" and len(mesh.tips) == 1
    # 8 mm circle by chords of at most 6 mm: the area is off by less than 1 %
    assert mesh.area == pytest.approx(0.12 * 0.04 - np.pi * 0.008**2, rel=1e-2)
    cut = (tmp_path / "plate.msh").read_bytes()
    (tmp_path / "cut.msh").write_bytes(cut[: len(cut) // 2])
    with pytest.raises(ValueError, match=r"cut\.msh: "):
        read_gmsh(tmp_path / "cut.msh", order=2)


def test_angle_section_with_one_element_as_its_corner(tmp_path):
    section = re.findall(r"```geo\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]
    (tmp_path / "angle.geo").write_text(section)
    mesh = read_gmsh(tmp_path / "angle.geo", scale=1e-3)
    assert sorted(np.diff(mesh.element_start)) == [4, 4, 6]
    assert mesh.area == pytest.approx(0.1**2 - 0.07**2)


def test_loads_on_edges_between_two_materials(tmp_path):
    """tx and ty act once on each; a pressure would act to one side on some and to the other on others: .8 of
    it was left of a seam of ten edges.
    """
    import sbfem_petsc as sb

    (tmp_path / "two.geo").write_text(
        'SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 1, .5}; Rectangle(2) = {0, .5, 0, 1, .5};\n'
        "Coherence; Mesh.MeshSizeMax = 0.2; e = 1e-3;\n"
        'Physical Surface("low") = {1}; Physical Surface("high") = {2};\n'
        'Physical Curve("foot") = Curve In BoundingBox{-e, -e, -e, 1 + e, e, e};\n'
        'Physical Curve("seam") = Curve In BoundingBox{-e, .5 - e, -e, 1 + e, .5 + e, e};\n'
    )
    mesh = read_gmsh(tmp_path / "two.geo", order=2)
    steel = sb.Material(210e9, 0.3, 7800.0)
    model = sb.Model(mesh, {"low": steel, "high": steel}, clamped="foot", thickness=0.5)
    pulled = sb.static(model, sb.EdgeLoad("seam", tx=30.0, ty=-8.0))
    assert pulled.reactions["foot"] == pytest.approx([-15.0, 4.0])
    for pressure in (1.0, sb.Harmonic(1.0, 100.0)):
        with pytest.raises(
            ValueError, match=r"pressure on 'seam' acts .* on both sides of \d of its edges; give tx"
        ):
            sb.transient(model, sb.EdgeLoad("seam", ty=1.0, pressure=pressure), 1e-4)
