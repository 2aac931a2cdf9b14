"""Bodies of other codes in case files: the numbers of Python's calls, wrong entries, sweeps, reports."""

from __future__ import annotations

import inspect
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.petsc import MPI
from sbfem_petsc.study.case import body as tables
from sbfem_petsc.study.case import objects
from sbfem_petsc.study.case.case import case_from_text, read_case
from sbfem_petsc.study.case.problems import CaseError
from sbfem_petsc.study.estimates import requirements
from sbfem_petsc.study.revive import read_any
from sbfem_petsc.study.run import run_case
from sbfem_petsc.study.structure import Structure
from tests.study.small_case import sbfem

FILES = Path(__file__).parents[1] / "bodies/calculix"
CASE = """\
[body]
kind = "calculix"
file = "blocks.inp"
modes = 10

[[body.contacts]]
left = "LEFT"
right = "RIGHT"
normal = "x"
gap = 5e-6

[body.points.tip]
at = [0.08, 0.01, 0.01]
direction = "z"

[body.points.mouth]
at = "RIGHT"
direction = "x"
less = "LEFT"

[model]
damping = 0.005

[loads.shake]
kind = "force"
point = "tip"
force = 12.0

[loads.base]
kind = "support_motion"
az = { kind = "tone_burst", amplitude = 10.0, frequency = 2000.0, cycles = 3 }

[analyses.frequencies]
kind = "modal"
count = 5

[analyses.push]
kind = "static"
load = "shake"
factor = 60.0

[analyses.slow]
kind = "load_history"
load = "shake"
times = [0.0, 1.0]

[analyses.steady]
kind = "periodic"
load = "shake"
frequency = 2930.0
steps = 64

[analyses.pulse]
kind = "transient"
load = ["base", "shake"]
duration = 1e-3

[output]
pictures = false
vtu = true
"""


@pytest.fixture
def file(tmp_path):
    for name in FILES.glob("blocks*"):
        shutil.copy(name, tmp_path)
    (tmp_path / "case.toml").write_text(CASE)
    return tmp_path / "case.toml"


def test_the_numbers_of_python(file):
    """To the last digit."""
    summary = run_case(file, file.parent / "out")
    assert not summary["run"]["failed"]
    found = read_any(file.parent / "out")
    body = sb.read_calculix(FILES / "blocks")
    tip = body.at((0.08, 0.01, 0.01), "z")
    rom = sb.reduce(
        body,
        contact=body.contact("LEFT", "RIGHT", normal="x", gap=5e-6),
        loads={"shake": tip, "base": sb.SupportMotion(az=1.0)},
        points={"tip": tip, "mouth": body.at("RIGHT", "x") - body.at("LEFT", "x")},
        modes=10,
        damping=0.005,
    )
    assert found.value("frequencies", "frequencies").tolist() == sb.modal(rom, 5).frequencies.tolist()
    push = sb.static(rom, [720.0, 0.0])
    assert push.contact_resultant > 0.0 and found.value("push", "contact_resultant") == push.contact_resultant
    assert found.value("push", "displacement", "mouth") == push.displacement("mouth")
    slow = sb.load_history(rom, [12.0, 0.0], [0.0, 1.0])
    assert found.value("slow", "displacement", "tip").tolist() == slow.displacement("tip").tolist()
    orbit = sb.periodic(rom, [12.0, 0.0], 2930.0, steps=64)
    assert found.value("steady", "harmonics", "tip").tolist() == orbit.harmonics("tip")[:41].tolist()
    history = sb.transient(rom, [12.0, sb.ToneBurst(10.0, 2000.0, cycles=3)], 1e-3)
    assert found.value("pulse", "displacement", "tip").tolist() == history.displacement("tip").tolist()
    assert (file.parent / "out/pictures/push.vtu").is_file()
    assert sbfem("report", file.parent / "out").code == 0
    assert "|u_z(tip)|" in (file.parent / "out/report.html").read_text()


def test_backbones_take_the_modes_that_a_body_has(file):
    """A model keeps 20 and three for each up to the followed one, and a body what it was reduced to: ten, of
    which the eleventh is told before anything is solved. Unpressed blocks keep the frequency of their mode.
    """
    table = '[analyses.free]\nkind = "backbone"\nmode = 1\nstart = 1e-9\nstop = 2e-9\npoints = 5\n\n[output]'
    text = CASE[: CASE.index("[analyses.frequencies]")] + table + "\npictures = false\n"
    file.write_text(text)
    summary = run_case(file, file.parent / "out")
    assert not summary["run"]["failed"]
    found = read_any(file.parent / "out")
    rom = Structure(read_case(file), MPI.COMM_WORLD).model
    assert found.value("free", "frequency")[0] == pytest.approx(rom.frequencies[0], rel=1e-3)
    file.write_text(text.replace("mode = 1\n", "mode = 11\n"))
    with pytest.raises(
        CaseError, match=r"mode = 11 asks for 11 modes, and there are 10, those of the reduced"
    ):
        requirements(read_case(file), MPI.COMM_WORLD)


def test_other_commands(file):
    """Check, report and plots; a deck that has changed is another case; a sweep over a gap and a point."""
    file.write_text(CASE.replace("count = 5", "count = 11"))
    assert "frequencies.count = 11 asks for 11 modes, and there are 10, those of" in sbfem("check", file).err
    file.write_text(CASE)
    done = sbfem("check", file, "--json")
    assert done.answer["unknowns"] == 78 and done.answer["contact_pairs"] == 2
    key = read_case(file).key
    mesh = file.parent / "blocks_mesh.inp"
    mesh.write_text(mesh.read_text() + "**\n")
    assert read_case(file).key != key
    text = CASE.split("[analyses.slow]")[0]
    text += (
        '[sweep.parameters]\n"body.contacts[0].gap" = [5e-6, 1.0]\n"loads.shake.point" = ["tip", "mouth"]\n'
    )
    file.write_text(text)
    swept = sb.sweep(file)
    apart = swept.values["push/contact_resultant"]
    assert apart[0] > 0.0 and apart[2] == 0.0 and not swept.failed
    reached = swept.values["push/displacement/tip"]
    assert reached[0] > 10.0 * abs(reached[1])  # another point of the load is another structure
    file.write_text(text.split("[sweep")[0])
    assert sbfem("run", file, "--output", file.parent / "new", "--quiet").code == 0
    assert sbfem("report", file.parent / "new").code == 0
    report = (file.parent / "new/report.html").read_text()
    assert "78 free unknowns" in report and "displacement of tip" in report and "u_y" not in report
    assert "78 free unknowns" in sbfem("info", file.parent / "new").out
    assert sbfem("plot", file.parent / "new").code == 0
    refused = sbfem("export", file.parent / "new", "--vtu")
    assert refused.code == 2 and "results do not hold a body's matrices" in refused.err


def test_matrices(file):
    """Files of SciPy with a deck for the nodes are the same body."""
    from scipy import sparse

    body = sb.read_calculix(FILES / "blocks")
    for name in ("stiffness", "mass"):
        sparse.save_npz(file.parent / f"{name}.npz", getattr(body, name) / 1e3)
    np.savetxt(file.parent / "rows.txt", body.unknowns, fmt="%d")
    given = 'kind = "matrices"\nstiffness = "stiffness.npz"\nmass = "mass.npz"\nnodes = "blocks.inp"\n'
    text = CASE.split("[analyses.push]")[0].replace(
        'kind = "calculix"\nfile = "blocks.inp"\n', given + 'unknowns = "rows.txt"\nunits = "mm-N-t"\n'
    )
    file.write_text(text + "[output]\npictures = false\n")
    run_case(file, file.parent / "out")
    found = read_any(file.parent / "out").value("frequencies", "frequencies")
    tip = body.at((0.08, 0.01, 0.01), "z")
    own = sb.reduce(body, loads={"F": tip}, points={"tip": tip}, modes=10).frequencies[:5]
    assert found == pytest.approx(own, rel=1e-9)
    deck = file.parent / "blocks.inp"
    deck.rename(file.parent / "all.inp")
    deck.write_text("** nothing of its own\n*INCLUDE, INPUT=all.inp\n")
    keys = [read_case(file).key]
    (file.parent / "all.inp").write_text("** another\n" + (file.parent / "all.inp").read_text())
    assert read_case(file).key not in keys


WRONG = [
    (r"\[model\]", '[geometry]\nkind = "beam"\nlength = 1.0\nheight = 0.1\n[model]', "body stands beside"),
    (r"\[body\](.*\n)*\[model\]", "[model]", "geometry is missing; add it, or"),
    ("damping = 0.005", "damping = 0.005\nthickness = 2.0", "model.thickness is not for a"),
    (r"\[model\]", "[mesh]\norder = 3\n[model]", "mesh is not for a"),
    ('kind = "calculix"', 'kind = "calculx"', "body.kind = 'calculx' is unknown; did you mean 'calculix'"),
    ('file = "blocks.inp"', "", "body.file is missing"),
    ('direction = "z"', "direction = [1.0, 2.0]", "body.points.tip.direction has 2 entries"),
    (
        'point = "tip"',
        'point = "top"',
        "loads.shake.point = 'top' is no point of the body; did you mean 'tip'",
    ),
    ('kind = "force"', 'kind = "point_force"', "loads.shake"),
    (
        r'kind = "force"\npoint = "tip"\nforce = 12.0',
        'kind = "point_force"\npoint = "tip"\nfx = 1.0',
        "is not for a",
    ),
    (r"\[output\]", '[output]\npoints = ["A"]', "output.points = 'A' is no point of the body"),
    ("modes = 10", "modes = 0", "body.modes = 0 must be at least 1"),
    (r'kind = "transient"', 'kind = "transient"\nmodes = 5', "modes is not for a .*give body.modes"),
    (r'kind = "transient"', 'kind = "transient"\nreduced = false', "reduced is not for a .*leave it out"),
    (
        r'kind = "static"',
        'kind = "static"\nstress_at = { a = [0, 0] }',
        "stress_at is not for a .*leave it out",
    ),
    ("count = 5", "count = 5\naccuracy = 1e-3", "accuracy is not for a .*leave it out"),
]
# What only the body itself tells.
LATER = [
    ('normal = "x"', 'normal = "w"', r"body.contacts\[0\].normal is refused: .*must be one of 'x', 'y', 'z'"),
    ('file = "blocks.inp"', 'file = "block.inp"', "body.*block.inp: there is no such file"),
    ('left = "LEFT"', 'left = "LEF"', r"body.contacts\[0\] is refused: .*set 'LEF' does not exist"),
    ("gap = 5e-6", "gap = -5e-6", r"body.contacts\[0\].*overlap"),
    ('normal = "x"', "normal = [-1, 0, 0]", r"contacts\[0\].* or from the body to the wall\?\Z"),
    (
        "gap = 5e-6",
        "gap = [1.0]",
        r"body.contacts\[0\].gap is refused: .*has shape \(1,\), \(2,\) was expected",
    ),
    ('normal = "x"\n', "", r"body.contacts\[0\] is refused: .*coincident faces do not tell their side"),
    ("gap = 5e-6", 'law = { kind = "tied", compliance = 1.0 }', r"body.contacts\[0\].law is refused"),
    (r"at = \[0.08", "at = [0.8", r"body.points.tip is refused: .*coordinates are in m"),
    ('less = "LEFT"', 'less = "RIGHT"', r"body.points.mouth.less is refused: .*moves as at does"),
    ("modes = 10", "modes = 100", r"body.modes is refused: .*modes = 100 must be .*77"),
]


@pytest.mark.parametrize(("old", "new", "sentence"), WRONG + LATER)
def test_wrong_entries(file, old, new, sentence):
    """File, line, item and what was expected."""
    text, count = re.subn(old, lambda _: new, CASE, count=1)
    assert count == 1
    with pytest.raises(CaseError, match=rf"case.toml(, line \d+)?: .*{sentence}") as raised:
        case = case_from_text(text, "case.toml", str(file.parent))
        assert (old, new, sentence) in LATER
        objects.body(case)  # as `sbfem check` does
    assert "\n" not in str(raised.value)


def test_tables_are_arguments():
    """Keys of a contact are the arguments of `FiniteElementModel.contact`."""
    arguments = inspect.signature(sb.FiniteElementModel.contact).parameters
    assert set(tables.BodyContact.model_fields) == set(arguments) - {"self"}
